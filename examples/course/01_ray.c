/* 1. A ray and a triangle.

   A ray o + t d meets the plane of a triangle a, b, c where o + t d = a + u (b - a) + v (c - a).
   Three equations, three unknowns: Cramer's rule gives t, u, v as ratios of triple products
   (Moeller and Trumbore 1997). The point is within the triangle if u, v and 1 - u - v are all
   positive. They are its barycentric coordinates: the weights of the corners, whose mean is the
   point.

   Look at: the colours of the left panel, red at corner a, green at b, blue at c.
   Check:   ten thousand rays against the library's, which also never slips through an edge.
   Exercise: shade the triangle by the cosine between ray and normal, in the right panel, where
   it is lit from the eye. (The normal is along (b - a) x (c - a). Solution: compile with
   -DSOLUTION.)

   Compile: cc -O2 -march=native 01_ray.c -o 01_ray -lm -lpthread */
#define ITN_IMPLEMENTATION
#include "course.h"

static itn_vec3 minus(itn_vec3 a, itn_vec3 b) {
    itn_vec3 r = {a.x - b.x, a.y - b.y, a.z - b.z};
    return r;
}
static itn_vec3 cross(itn_vec3 a, itn_vec3 b) {
    itn_vec3 r = {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
    return r;
}
static float dot(itn_vec3 a, itn_vec3 b) { return a.x * b.x + a.y * b.y + a.z * b.z; }

/* Returns whether the ray meets the triangle in front of its origin. */
static int meets(const itn_ray *ray, const itn_vec3 corner[3], float *t, float *u, float *v) {
    itn_vec3 e1 = minus(corner[1], corner[0]), e2 = minus(corner[2], corner[0]);
    itn_vec3 s = minus(ray->origin, corner[0]);
    itn_vec3 p = cross(ray->direction, e2), q = cross(s, e1);
    float determinant = dot(e1, p); /* 0: the ray runs along the plane */
    *t = dot(e2, q) / determinant, *u = dot(s, p) / determinant;
    *v = dot(ray->direction, q) / determinant;
    return determinant != 0 && *u > 0 && *v > 0 && *u + *v < 1 && *t > 0;
}

int main(void) {
    static itn_vec3 corner[3] = {{-.9f, -.7f, 0}, {.8f, -.5f, .6f}, {.1f, .9f, -.4f}};
    static int indices[3] = {0, 1, 2};
    static float colours[3][PANEL * PANEL], shades[PANEL * PANEL];
    itn_mesh mesh = ITN_ZERO;
    itn_bvh *bvh;
    itn_error error;
    itn_hit hit;
    float t, u, v;
    int agree = 0, hits = 0;
    for (int i = 0; i < PANEL * PANEL; i++) { /* parallel rays towards -z, one for each pixel */
        itn_ray ray = {{0, 0, 5}, {0, 0, -1}, 0, INFINITY};
        ray.origin.x = 2 * ((float)(i % PANEL) + .5f) / PANEL - 1;
        ray.origin.y = 1 - 2 * ((float)(i / PANEL) + .5f) / PANEL;
        if (!meets(&ray, corner, &t, &u, &v)) continue;
        colours[0][i] = 1 - u - v, colours[1][i] = u, colours[2][i] = v;
#ifdef SOLUTION
        itn_vec3 n = cross(minus(corner[1], corner[0]), minus(corner[2], corner[0]));
        shades[i] = fabsf(dot(n, ray.direction)) / sqrtf(dot(n, n));
#endif
    }

    mesh.positions = &corner[0].x, mesh.vertex_count = 3;
    mesh.triangles = indices, mesh.triangle_count = 1;
    need(itn_bvh_create(&mesh, NULL, &bvh, &error), &error);
    for (int i = 0; i < 10000; i++) {
        itn_ray ray = {{0, 0, 5}, {0, 0, -5}, 0, INFINITY};
        ray.origin.x = (float)(4 * uniform() - 2), ray.direction.x = (float)(2 * uniform() - 1);
        ray.origin.y = (float)(4 * uniform() - 2), ray.direction.y = (float)(2 * uniform() - 1);
        int mine = meets(&ray, corner, &t, &u, &v), theirs = itn_bvh_nearest(bvh, &ray, &hit);
        hits += theirs;
        agree += mine == theirs && (!mine || fabsf(t - hit.t) < 1e-4f);
    }
    itn_bvh_free(bvh);
    printf("%d of 10000 rays hit\n", hits);
    check("rays on which both agree", agree, 10000, 0);

    itn_image page = new_page(2);
    show(&page, 0, colours[0], PANEL, PANEL, 3, 1, "barycentric coordinates");
    show(&page, 1, shades, PANEL, PANEL, 1, 1, "exercise: the cosine");
    save_page(&page, "01_ray.png");
    return wrong;
}
