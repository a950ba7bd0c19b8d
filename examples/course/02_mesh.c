/* 2. A picture of a mesh.

   A mesh is many triangles; a hierarchy of boxes finds the nearest one without asking all. Here
   is the figure that ships with the library, by 90,000 parallel rays: bright where the surface
   faces a lamp, dark where a second ray, from the surface to the lamp, meets something: its own
   shadow.

   Look at: the shadows that limbs throw; the right panel, how much of each ray runs inside.
   Check:   each ray enters as often as it leaves, and the lengths inside add up to the volume
   that itn_mesh_check finds from the triangles alone (divergence theorem).
   Exercise: how often do lines cross the surface? Over all directions the area of all crossings
   is half the surface (Cauchy, Crofton). Here the direction is one: sum |n.d| area over the
   triangles, and compare it with the crossings counted. (Solution: compile with -DSOLUTION.)

   Compile: cc -O2 -march=native 02_mesh.c -o 02_mesh -lm -lpthread
   Run:     ./02_mesh [MESH.ply] */
#define ITN_IMPLEMENTATION
#include "course.h"

/* Cosine to the lamp at triangle k, by its corners. */
static float facing(const itn_mesh *m, int k, const float lamp[3], double *area_seen) {
    const float *a = m->positions + 3 * m->triangles[3 * k];
    const float *b = m->positions + 3 * m->triangles[3 * k + 1];
    const float *c = m->positions + 3 * m->triangles[3 * k + 2];
    float n[3], length = 0, cosine = 0;
    for (int i = 0; i < 3; i++) {
        int j = (i + 1) % 3, l = (i + 2) % 3;
        n[i] = (b[j] - a[j]) * (c[l] - a[l]) - (b[l] - a[l]) * (c[j] - a[j]);
        length += n[i] * n[i], cosine += n[i] * lamp[i];
    }
    *area_seen = .5 * fabs(n[2]); /* |n.d| area, as n is twice the area long and d is -z */
    return fmaxf(cosine / sqrtf(length), 0);
}

int main(int argc, char **argv) {
    static const float lamp[3] = {.53f, .62f, .58f};
    static float shade[PANEL * PANEL], inside[PANEL * PANEL];
    const char *path = argc > 1 ? argv[1] : "../../scenes/shapes/figurine.ply";
    itn_mesh mesh;
    itn_mesh_report report;
    itn_bvh *bvh;
    itn_error error;
    double volume = 0, crossings = 0, seen, reach = 0;
    int uneven = 0;
    need(itn_mesh_load(path, NULL, &mesh, &error), &error);
    need(itn_mesh_check(&mesh, NULL, &report, &error), &error);
    need(itn_bvh_create(&mesh, NULL, &bvh, &error), &error);
    for (int i = 0; i < 3 * mesh.vertex_count; i++) reach = fmax(reach, fabs(mesh.positions[i]));
    for (int i = 0; i < PANEL * PANEL; i++) {
        itn_ray ray = {{0, 0, 0}, {0, 0, -1}, 0, INFINITY};
        itn_hit hit;
        int count = 0;
        ray.origin.x = (float)(reach * (2 * (i % PANEL + .5) / PANEL - 1));
        ray.origin.y = (float)(reach * (1 - 2 * (i / PANEL + .5) / PANEL));
        ray.origin.z = 2 * (float)reach;
        for (; itn_bvh_nearest(bvh, &ray, &hit); ray.tmin = hit.t, count++) {
            inside[i] += hit.front ? -hit.t : hit.t;
            if (count) continue;
            itn_ray shadow = {ray.origin, {lamp[0], lamp[1], lamp[2]}, 0, INFINITY};
            shadow.origin.z -= hit.t, shadow.tmin = 1e-4f * (float)reach;
            shade[i] = .05f + .95f * facing(&mesh, hit.triangle, lamp, &seen) *
                                  (float)!itn_bvh_occluded(bvh, &shadow);
        }
        uneven += count % 2;
        volume += inside[i], crossings += count;
    }
    double pixel = 4 * reach * reach / (PANEL * PANEL);
    printf("%d triangles of area %.5g\n", mesh.triangle_count, report.area);
    check("rays that enter and do not leave", uneven, 0, 0);
    check("volume by rays", volume * pixel, report.volume, .01 * report.volume);
#ifdef SOLUTION
    double sum = 0;
    for (int k = 0; k < mesh.triangle_count; k++) facing(&mesh, k, lamp, &seen), sum += seen;
    check("area of crossings", crossings * pixel, sum, .01 * sum);
#endif
    itn_image page = new_page(2);
    show(&page, 0, shade, PANEL, PANEL, 1, 1, "lit by a lamp");
    show(&page, 1, inside, PANEL, PANEL, 1, reach, "length inside");
    save_page(&page, "02_mesh.png");
    itn_bvh_free(bvh);
    itn_mesh_free(&mesh);
    return wrong;
}
