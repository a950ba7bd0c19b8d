/* Meshes, the watertight triangle test and the bounding volume hierarchy, against brute force over
   all triangles, against a plain test in double, and against facts (a closed surface has no way
   out). All meshes are made here. */
#define ITN_IMPLEMENTATION
#include "../itn.h"
#include "check.h"
#include "solids.h"

#ifdef ITN_SANITIZED
enum { MANY = 50000, RAYS = 10 }; /* RAYS: per cent of the rays of a test */
#else
enum { MANY = 1000000, RAYS = 100 };
#endif

/* ---- meshes ------------------------------------------------------------------------------------ */

static itn_mesh geometry_make(int vertices, int triangles) {
    itn_mesh mesh = ITN_ZERO;
    itn_error error = ITN_ZERO;
    if (itn_mesh_create(vertices, triangles, 0, NULL, &mesh, &error)) {
        printf("%s\n", error.message);
        exit(1);
    }
    mesh.vertex_count = mesh.triangle_count = 0; /* grow with add_ */
    return mesh;
}
static int add_vertex(itn_mesh *mesh, float x, float y, float z) {
    float *p = mesh->positions + 3 * mesh->vertex_count;
    p[0] = x, p[1] = y, p[2] = z;
    return mesh->vertex_count++;
}
static void add_triangle(itn_mesh *mesh, int a, int b, int c) {
    int *t = mesh->triangles + 3 * mesh->triangle_count++;
    t[0] = a, t[1] = b, t[2] = c;
}
static itn_vec3 corner(const itn_mesh *mesh, int triangle, int k) {
    const float *p = mesh->positions + 3 * mesh->triangles[3 * triangle + k];
    return itn__vec3(p[0], p[1], p[2]);
}

/* A closed grid of n x m quads, wrapped both ways: a torus of radii 1 and r. */
static itn_mesh torus(int n, int m, float r) {
    itn_mesh mesh = geometry_make(n * m, 2 * n * m);
    int i, j;
    for (i = 0; i < n; i++)
        for (j = 0; j < m; j++) {
            double a = 6.283185307179586 * i / n, b = 6.283185307179586 * j / m;
            double q = 1 + r * cos(b);
            add_vertex(&mesh, (float)(q * cos(a)), (float)(q * sin(a)), (float)(r * sin(b)));
        }
    for (i = 0; i < n; i++)
        for (j = 0; j < m; j++) {
            int a = i * m + j, b = (i + 1) % n * m + j;
            int c = (i + 1) % n * m + (j + 1) % m, d = i * m + (j + 1) % m;
            add_triangle(&mesh, a, b, c);
            add_triangle(&mesh, a, c, d);
        }
    return mesh;
}

/* A sphere, or with few rings and many sectors two fans of needles; poles on the z axis. */
static itn_mesh sphere(int sectors, int rings) {
    itn_mesh mesh = geometry_make(2 + sectors * rings, 2 * sectors * rings);
    int i, j, south = add_vertex(&mesh, 0, 0, -1), north = add_vertex(&mesh, 0, 0, 1);
    for (j = 0; j < rings; j++)
        for (i = 0; i < sectors; i++) {
            double a = 6.283185307179586 * i / sectors, b = 3.141592653589793 * (j + 1) / (rings + 1);
            add_vertex(&mesh, (float)(sin(b) * cos(a)), (float)(sin(b) * sin(a)), (float)-cos(b));
        }
    for (i = 0; i < sectors; i++) {
        int next = (i + 1) % sectors;
        add_triangle(&mesh, south, 2 + next, 2 + i);
        for (j = 0; j + 1 < rings; j++) {
            int row = 2 + j * sectors;
            add_triangle(&mesh, row + i, row + next, row + sectors + next);
            add_triangle(&mesh, row + i, row + sectors + next, row + sectors + i);
        }
        add_triangle(&mesh, north, 2 + (rings - 1) * sectors + i, 2 + (rings - 1) * sectors + next);
    }
    return mesh;
}

/* The box from (-x,-y,-z) to (x,y,z), axis-parallel faces. */
static itn_mesh box(float x, float y, float z) {
    static const int faces[12][3] = {{0, 2, 3}, {0, 3, 1}, {4, 5, 7}, {4, 7, 6}, {0, 1, 5}, {0, 5, 4},
                                     {2, 6, 7}, {2, 7, 3}, {0, 4, 6}, {0, 6, 2}, {1, 3, 7}, {1, 7, 5}};
    itn_mesh mesh = geometry_make(8, 12);
    int i;
    for (i = 0; i < 8; i++) add_vertex(&mesh, i & 1 ? x : -x, i & 2 ? y : -y, i & 4 ? z : -z);
    for (i = 0; i < 12; i++) add_triangle(&mesh, faces[i][0], faces[i][1], faces[i][2]);
    return mesh;
}

/* An open square of n x n quads in a slanted plane. */
static itn_mesh sheet(int n) {
    itn_mesh mesh = geometry_make((n + 1) * (n + 1), 2 * n * n);
    int i, j;
    for (i = 0; i <= n; i++)
        for (j = 0; j <= n; j++) {
            float s = 2.f * (float)i / (float)n - 1, t = 2.f * (float)j / (float)n - 1;
            add_vertex(&mesh, .8f * s + .1f * t, .9f * t - .2f * s, .3f * s + .4f * t);
        }
    for (i = 0; i < n; i++)
        for (j = 0; j < n; j++) {
            int a = i * (n + 1) + j, b = a + n + 1;
            add_triangle(&mesh, a, b, b + 1);
            add_triangle(&mesh, a, b + 1, a + 1);
        }
    return mesh;
}

static float signed_uniform(itn__rng *rng) { return 2 * itn__uniform(rng) - 1; }
static itn_vec3 cube_point(itn__rng *rng) {
    float x = signed_uniform(rng), y = signed_uniform(rng);
    return itn__vec3(x, y, signed_uniform(rng));
}
static itn_vec3 sphere_point(itn__rng *rng) {
    float z = signed_uniform(rng), phi = 6.2831853f * itn__uniform(rng), q = sqrtf(1 - z * z);
    return itn__vec3(q * cosf(phi), q * sinf(phi), z);
}

/* Triangles of all sizes anywhere. */
static itn_mesh soup(int n, uint64_t seed) {
    itn_mesh mesh = geometry_make(3 * n, n);
    itn__rng rng = itn__rng_make(seed, 0, 0);
    int i, k;
    for (i = 0; i < n; i++) {
        itn_vec3 centre = cube_point(&rng);
        float size = expf(-5 * itn__uniform(&rng));
        for (k = 0; k < 3; k++) {
            itn_vec3 p = itn__along(centre, size, cube_point(&rng));
            add_vertex(&mesh, p.x, p.y, p.z);
        }
        add_triangle(&mesh, 3 * i, 3 * i + 1, 3 * i + 2);
    }
    return mesh;
}

static void place(itn_mesh *mesh, float scale, float offset) {
    int i;
    for (i = 0; i < 3 * mesh->vertex_count; i++)
        mesh->positions[i] = mesh->positions[i] * scale + offset;
}

static itn_bvh *hierarchy(const itn_mesh *mesh, const int *objects) {
    itn_context context = ITN_ZERO;
    itn_error error = ITN_ZERO;
    itn_bvh *bvh = itn__bvh_new(&context, mesh->triangle_count);
    int i;
    if (!bvh) exit(1);
    for (i = 0; i < 3 * mesh->triangle_count; i++)
        memcpy(bvh->triangles[i / 3].corner[i % 3], mesh->positions + 3 * mesh->triangles[i],
               3 * sizeof(float));
    for (i = 0; objects && i < mesh->triangle_count; i++) bvh->triangles[i].object = objects[i];
    if (itn__bvh_build(bvh, &error)) exit(1);
    return bvh;
}

static itn_ray ray_of(itn_vec3 origin, itn_vec3 direction, float tmin, float tmax) {
    itn_ray ray;
    ray.origin = origin, ray.direction = direction, ray.tmin = tmin, ray.tmax = tmax;
    return ray;
}

/* ---- itn_mesh_check ---------------------------------------------------------------------------- */

static itn_mesh_report report_of(const itn_mesh *mesh) {
    itn_mesh_report report = ITN_ZERO;
    CHECK(itn_mesh_check(mesh, NULL, &report, NULL) == ITN_OK);
    return report;
}
static void expect_counts(const itn_mesh_report *r, int bad, int degenerate, int open, int flipped) {
    CHECK(r->bad_vertices == bad);
    CHECK(r->degenerate_triangles == degenerate);
    CHECK(r->open_edges == open);
    CHECK(r->flipped_edges == flipped);
}
static void swap_corners(itn_mesh *mesh, int triangle) {
    int *t = mesh->triangles + 3 * triangle, saved = t[1];
    t[1] = t[2], t[2] = saved;
}

static void swap_all(itn_mesh *mesh) {
    int i;
    for (i = 0; i < mesh->triangle_count; i++) swap_corners(mesh, i);
}

/* A sheet with two sides is flat however it lies: what rounding leaves of its volume is none. */
static void test_check_flat(void) {
    static const int corners[12] = {0, 1, 2, 0, 2, 3, 0, 2, 1, 0, 3, 2};
    static const int other_diagonal[6] = {0, 3, 1, 1, 3, 2};
    int round, i, k;
    for (round = 0; round < 100; round++) {
        itn_mesh mesh = ITN_ZERO;
        itn_mesh_report r;
        float sides[9];
        CHECK(itn_mesh_create(4, 4, 0, NULL, &mesh, NULL) == ITN_OK);
        memcpy(mesh.triangles, corners, sizeof corners);
        for (i = 0; i < 9; i++) sides[i] = (float)sin(1 + 9 * round + i);
        for (i = 0; i < 4; i++)
            for (k = 0; k < 3; k++)
                mesh.positions[3 * i + k] = sides[k] + (i == 1 || i == 2) * sides[3 + k] +
                                            (i >= 2) * sides[6 + k];
        r = report_of(&mesh);
        expect_counts(&r, 0, 0, 0, 0);
        CHECK(r.volume == 0 && r.area > 0);
        /* planted: bent along one diagonal on one side, along the other on the other */
        memcpy(mesh.triangles + 6, other_diagonal, sizeof other_diagonal);
        for (k = 0; k < 3; k++) mesh.positions[k] += 1e-4f * (float)sin(round + k);
        r = report_of(&mesh);
        expect_counts(&r, 0, 0, 0, 0);
        CHECK(r.volume != 0);
        itn_mesh_free(&mesh);
    }
}

static void test_check_closed(void) {
    itn_mesh mesh = box(.5f, 1, 1.5f);
    itn_mesh_report r = report_of(&mesh);
    expect_counts(&r, 0, 0, 0, 0);
    CHECK_NEAR(r.volume, 6, 1e-12);
    CHECK_NEAR(r.area, 2 * (1 * 2 + 2 * 3 + 3 * 1), 1e-12);
    CHECK(r.first_bad_vertex == -1 && r.first_bad_triangle == -1);
    CHECK(r.bad_indices == 0);
    swap_all(&mesh);
    r = report_of(&mesh);
    expect_counts(&r, 0, 0, 0, 0);
    CHECK_NEAR(r.volume, -6, 1e-12);
    swap_all(&mesh);
    place(&mesh, 1, 4096); /* exact in float */
    r = report_of(&mesh);
    CHECK_NEAR(r.volume, 6, 1e-9);
    itn_mesh_free(&mesh);
    mesh = torus(300, 200, .25f);
    r = report_of(&mesh);
    expect_counts(&r, 0, 0, 0, 0);
    CHECK_NEAR(r.volume / (2 * 9.869604401089358 * .0625), 1, 1e-3); /* 2 pi^2 r^2, less facets */
    itn_mesh_free(&mesh);
}

/* The box with three vertices of its own for every triangle: seams everywhere, still closed; with
   -0 for 0 in places. */
static void test_check_seams(void) {
    itn_mesh whole = box(1, 1, 1), split = geometry_make(36, 12);
    itn_mesh_report r;
    int i, k;
    for (i = 0; i < 12; i++) {
        for (k = 0; k < 3; k++) {
            itn_vec3 p = corner(&whole, i, k);
            add_vertex(&split, p.x + 1 == 0 && i % 2 ? -0.f : p.x + 1, p.y, p.z);
        }
        add_triangle(&split, 3 * i, 3 * i + 1, 3 * i + 2);
    }
    r = report_of(&split);
    expect_counts(&r, 0, 0, 0, 0);
    CHECK_NEAR(r.volume, 8, 1e-12);
    split.positions[0] += 1e-6f; /* no tolerance: it opens */
    r = report_of(&split);
    CHECK(r.open_edges > 0);
    itn_mesh_free(&whole);
    itn_mesh_free(&split);
}

static int names_edge(const int edge[2], int a, int b) {
    return (edge[0] == a && edge[1] == b) || (edge[0] == b && edge[1] == a);
}

static void test_check_faults(void) {
    itn_mesh mesh = sphere(12, 7);
    int *t = mesh.triangles, count = mesh.triangle_count, i, found = 0;
    int a = t[3 * (count - 1)], b = t[3 * (count - 1) + 1], c = t[3 * (count - 1) + 2];
    itn_mesh_report r;
    mesh.triangle_count--; /* a hole */
    r = report_of(&mesh);
    expect_counts(&r, 0, 0, 3, 0);
    CHECK(names_edge(r.open_edge, a, b) || names_edge(r.open_edge, b, c) ||
          names_edge(r.open_edge, c, a));
    mesh.triangle_count++;
    swap_corners(&mesh, 40); /* one triangle the wrong way */
    r = report_of(&mesh);
    expect_counts(&r, 0, 0, 0, 3);
    for (i = 0; i < 3; i++) found += names_edge(r.flipped_edge, t[120 + i], t[120 + (i + 1) % 3]);
    CHECK(found == 1); /* an edge of that triangle */
    swap_corners(&mesh, 40);
    mesh.positions[3 * a + 1] = NAN;
    mesh.positions[3 * 5] = INFINITY;
    r = report_of(&mesh);
    expect_counts(&r, 2, 0, 0, 0);
    CHECK(r.first_bad_vertex == (a < 5 ? a : 5));
    CHECK(r.area > 0 && r.area < 12.6 && fabs(r.volume) < 4.2); /* the finite part */
    itn_mesh_free(&mesh);
    mesh = sphere(12, 7);
    mesh.triangles[3 * 17] = mesh.vertex_count;
    mesh.triangles[3 * 30 + 2] = -1;
    r = report_of(&mesh);
    CHECK(r.bad_indices == 2 && r.first_bad_triangle == 17 && r.open_edges == 6);
    itn_mesh_free(&mesh);
}

/* Touching and degenerate parts. */
static void test_check_odd(void) {
    itn_mesh mesh = geometry_make(16, 28), one = box(1, 1, 1);
    itn_mesh_report r;
    int i, k;
    for (k = 0; k < 2; k++) { /* two boxes that share an edge of positions */
        for (i = 0; i < 8; i++) {
            const float *p = one.positions + 3 * i;
            add_vertex(&mesh, p[0] + 2.f * (float)k, p[1] + 2.f * (float)k, p[2]);
        }
        for (i = 0; i < 12; i++)
            add_triangle(&mesh, one.triangles[3 * i] + 8 * k, one.triangles[3 * i + 1] + 8 * k,
                         one.triangles[3 * i + 2] + 8 * k);
    }
    r = report_of(&mesh);
    expect_counts(&r, 0, 0, 0, 0);
    CHECK_NEAR(r.volume, 16, 1e-12);
    add_triangle(&mesh, 3, 3, 5); /* two equal corners: covers nothing */
    add_triangle(&mesh, 3, 8, 12); /* 3 and 8 are welded: the same */
    r = report_of(&mesh);
    expect_counts(&r, 0, 2, 0, 0);
    add_triangle(&mesh, 0, 1, 5); /* a third face at edges that are closed: a fin */
    r = report_of(&mesh);
    CHECK(r.flipped_edges > 0);
    itn_mesh_free(&mesh);
    mesh = geometry_make(3, 1); /* two equal corners, of which rounded products make an area */
    add_vertex(&mesh, .1f, .2f, .3f), add_vertex(&mesh, 100.3f, 50.7f, 20.9f);
    add_vertex(&mesh, 100.3f, 50.7f, 20.9f);
    add_triangle(&mesh, 0, 1, 2);
    r = report_of(&mesh);
    CHECK(r.degenerate_triangles == 1);
    itn_mesh_free(&mesh);
    mesh = geometry_make(
        4, 3); /* a zero-area triangle closes the slit of a T-joint: only the rim is open */
    add_vertex(&mesh, 0, 0, 0), add_vertex(&mesh, 2, 0, 0);
    add_vertex(&mesh, 1, 0, 0), add_vertex(&mesh, 1, 1, 0);
    add_triangle(&mesh, 0, 2, 3), add_triangle(&mesh, 2, 1, 3), add_triangle(&mesh, 0, 1, 2);
    r = report_of(&mesh);
    expect_counts(&r, 0, 1, 3, 0);
    CHECK_NEAR(r.area, 1, 0);
    itn_mesh_free(&mesh);
    itn_mesh_free(&one);
}

/* Boxes of 2 x 2 x 2, the second anywhere and either way out: their volumes are told apart. planted:
   one part more. */
static void test_check_parts(int planted) {
    static const struct {
        float size, shift[3];
        int turned, inverted;
    } second[] = {{1, {5, 0, 0}, 0, 0}, {1, {5, 0, 0}, 1, 1},         /* apart */
                  {1, {2, 2, 0}, 0, 0}, {1, {2, 2, 0}, 1, 1},         /* at a common edge, */
                  {1, {2, 2, 2}, 1, 1}, {1, {2, 0, 0}, 1, 1},         /* corner, face */
                  {.5f, {0, 0, 0}, 1, 1}, {1e-4f, {900, 800, 0}, 1, 1}, /* a cavity; small and far */
                  {0, {3, 0, 0}, 1, 0}, {2, {9, 0, 0}, 1, 1}};        /* none; larger */
    itn_mesh one = box(1, 1, 1);
    size_t k;
    int i;
    for (k = 0; k < sizeof second / sizeof *second; k++) {
        itn_mesh mesh = geometry_make(16, 24);
        itn_mesh_report r;
        for (i = 0; i < 16; i++) {
            const float *p = one.positions + 3 * (i % 8);
            float size = i < 8 ? 1 : second[k].size;
            const float *shift = second[k].shift;
            add_vertex(&mesh, size * p[0] + (i < 8 ? 0 : shift[0]),
                       size * p[1] + (i < 8 ? 0 : shift[1]), size * p[2] + (i < 8 ? 0 : shift[2]));
        }
        for (i = 0; i < 24; i++) {
            const int *t = one.triangles + 3 * (i % 12);
            int first = i < 12 ? 0 : 8, turned = i >= 12 && second[k].turned;
            add_triangle(&mesh, first + t[0], first + t[1 + turned], first + t[2 - turned]);
        }
        r = report_of(&mesh);
        CHECK(r.inverted_parts == second[k].inverted + (planted && k == 3));
        if (k != 5) expect_counts(&r, 0, second[k].size > 0 ? 0 : 12, 0, 0);
        itn_mesh_free(&mesh);
    }
    swap_all(&one);
    CHECK(report_of(&one).inverted_parts == 1);
    itn_mesh_free(&one);
}

static void test_check_arguments(void) {
    itn_mesh mesh = ITN_ZERO;
    itn_mesh_report r = ITN_ZERO;
    itn_error error = ITN_ZERO;
    CHECK(itn_mesh_check(NULL, NULL, &r, &error) == ITN_ERROR_ARGUMENT && error.message[0]);
    CHECK(itn_mesh_check(&mesh, NULL, NULL, &error) == ITN_ERROR_ARGUMENT);
    CHECK(itn_mesh_check(&mesh, NULL, &r, NULL) == ITN_OK && r.area == 0 && r.volume == 0);
    mesh.triangle_count = 1;
    CHECK(itn_mesh_check(&mesh, NULL, &r, NULL) == ITN_ERROR_ARGUMENT);
    mesh.triangle_count = -1;
    CHECK(itn_mesh_check(&mesh, NULL, &r, NULL) == ITN_ERROR_ARGUMENT);
    CHECK(itn_mesh_create(-1, 1, 0, NULL, &mesh, &error) == ITN_ERROR_ARGUMENT);
    CHECK(itn_mesh_create(1, 1, 0, NULL, NULL, &error) == ITN_ERROR_ARGUMENT);
    CHECK(itn_mesh_create(5, 4, 1, NULL, &mesh, &error) == ITN_OK);
    CHECK(mesh.uvs && mesh.uvs[23] == 0 && mesh.positions[14] == 0 && mesh.triangles[11] == 0);
    itn_mesh_free(&mesh);
    CHECK(!mesh.positions && !mesh.triangle_count);
    itn_mesh_free(&mesh);
    itn_mesh_free(NULL);
}

/* ---- closed forms ------------------------------------------------------------------------------ */

static void test_one_triangle(void) {
    itn_mesh mesh = geometry_make(3, 1);
    itn_bvh *bvh;
    itn_hit hit;
    itn_vec3 p[3];
    itn_ray ray = ray_of(itn__vec3(.25f, .5f, 3), itn__vec3(0, 0, -2), 0, 10);
    add_vertex(&mesh, 0, 0, 1), add_vertex(&mesh, 1, 0, 1), add_vertex(&mesh, 0, 1, 1);
    add_triangle(&mesh, 0, 1, 2);
    bvh = hierarchy(&mesh, NULL);
    CHECK(itn_bvh_nearest(bvh, &ray, &hit));
    CHECK(hit.t == 1 && hit.u == .25f && hit.v == .5f && hit.triangle == 0 && hit.front == 1);
    ray.tmax = 1; /* the interval is open at both ends */
    CHECK(!itn_bvh_nearest(bvh, &ray, &hit) && !itn_bvh_occluded(bvh, &ray));
    ray.tmax = 1 + FLT_EPSILON;
    CHECK(itn_bvh_nearest(bvh, &ray, &hit) && itn_bvh_occluded(bvh, &ray));
    ray.tmin = 1, ray.tmax = INFINITY;
    CHECK(!itn_bvh_nearest(bvh, &ray, &hit));
    ray.tmin = 1 - FLT_EPSILON / 2;
    CHECK(itn_bvh_nearest(bvh, &ray, &hit));
    ray = ray_of(itn__vec3(.25f, .5f, 0), itn__vec3(0, 0, 1), 0, INFINITY);
    CHECK(itn_bvh_nearest(bvh, &ray, &hit) && hit.front == 0 && hit.t == 1);
    ray.direction.z = -1; /* behind */
    CHECK(!itn_bvh_nearest(bvh, &ray, &hit));
    ray.tmin = -2;
    CHECK(itn_bvh_nearest(bvh, &ray, &hit) && hit.t == -1 && hit.front == 1);
    ray.tmin = -1;
    CHECK(!itn_bvh_nearest(bvh, &ray, &hit));
    ray = ray_of(itn__vec3(-1, .25f, 1), itn__vec3(1, 0, 0), 0, INFINITY); /* in the plane */
    CHECK(!itn_bvh_nearest(bvh, &ray, &hit));
    ray = ray_of(itn__vec3(0, 0, 0), itn__vec3(0, 0, 1), 0, INFINITY); /* a corner counts */
    CHECK(itn_bvh_nearest(bvh, &ray, &hit) && hit.u == 0 && hit.v == 0);
    itn__bvh_corners(bvh, 0, p);
    CHECK(p[1].x == 1 && p[2].y == 1 && p[0].z == 1 && bvh->triangles[0].object == 0);
    CHECK(bvh->lower.z == 1 && bvh->upper.x == 1);
    itn_bvh_free(bvh);
    itn_mesh_free(&mesh);
}

/* ---- the tree itself --------------------------------------------------------------------------- */

/* Whether the triangles of a leaf are in its box, and how often each triangle was seen. */
static void expect_leaf(const itn__pack *pack, const float bounds[6], int *seen) {
    int i, j, k;
    for (i = 0; i < ITN__PACK; i++) {
        if (!(pack->used >> i & 1)) {
            if (pack->index[i] != -1) CHECK(!"a free place with a triangle");
            continue;
        }
        seen[pack->index[i]]++;
        for (j = 0; j < 3; j++)
            for (k = 0; k < 3; k++)
                if (!(pack->corner[j][k][i] >= bounds[k] && pack->corner[j][k][i] <= bounds[k + 3]))
                    CHECK(!"a corner outside of its leaf");
    }
}

/* Checks boxes and leaves below a node; returns the number of levels. */
static int tree_depth(const itn_bvh *bvh, int index, const float bounds[6], int *seen) {
    const itn__node *node = &bvh->nodes[index];
    int i, k, deepest = 0;
    for (i = 0; i < ITN__WIDE; i++) {
        float box[6];
        int empty = node->bounds[0][i] > node->bounds[3][i], depth = 1;
        for (k = 0; k < 6; k++) {
            box[k] = node->bounds[k][i];
            if (!empty && !(k < 3 ? box[k] >= bounds[k] : box[k] <= bounds[k]))
                CHECK(!"a child outside of its parent");
        }
        if (node->child[i] < 0)
            expect_leaf(&bvh->packs[~node->child[i]], box, seen);
        else
            depth += tree_depth(bvh, node->child[i], box, seen);
        if (empty && node->child[i] != ~0) CHECK(!"a child without a box");
        deepest = depth > deepest ? depth : deepest;
    }
    return deepest;
}

/* A parallel_for that runs the second half first, and both backwards. */
static void geometry_backwards(int count, void (*body)(void *task, int index), void *task,
                               void *user) {
    int i;
    (void)user;
    for (i = count - 1; i >= count / 2; i--) body(task, i);
    for (i = count / 2 - 1; i >= 0; i--) body(task, i);
}

/* Whether the tree is the same, however the loops run. */
static void expect_same_tree(const itn_mesh *mesh, const itn_bvh *bvh) {
    itn_context context = ITN_ZERO;
    itn_bvh *other = NULL;
    context.parallel_for = geometry_backwards;
    CHECK(itn_bvh_create(mesh, &context, &other, NULL) == ITN_OK);
    CHECK(other->node_count == bvh->node_count && other->leaf_count == bvh->leaf_count);
    CHECK(memcmp(other->nodes, bvh->nodes, (size_t)bvh->node_count * sizeof(itn__node)) == 0);
    CHECK(memcmp(other->packs, bvh->packs, (size_t)bvh->leaf_count * sizeof(itn__pack)) == 0);
    itn_bvh_free(other);
}

static void expect_tree(const itn_mesh *mesh, int deepest) {
    itn_bvh *bvh = hierarchy(mesh, NULL);
    int *seen = (int *)calloc((size_t)mesh->triangle_count, sizeof(int)), i, once = 1;
    float bounds[6];
    int depth;
    memcpy(bounds, &bvh->lower, sizeof bvh->lower);
    memcpy(bounds + 3, &bvh->upper, sizeof bvh->upper);
    depth = tree_depth(bvh, 0, bounds, seen);
    check_report(depth <= deepest, __FILE__, __LINE__, "depth %d, at most %d", depth, deepest);
    for (i = 0; i < mesh->triangle_count; i++)
        once = once && seen[i] == 1 && bvh->triangles[i].index == i;
    CHECK(once);
    CHECK((uintptr_t)bvh->nodes % 64 == 0 && (uintptr_t)bvh->packs % 64 == 0);
    CHECK(sizeof(itn__pack) % 64 == 0);
    expect_same_tree(mesh, bvh);
    free(seen);
    itn_bvh_free(bvh);
}

static void test_trees(void) {
    itn_mesh mesh = sphere(100, 99);
    int i;
    expect_tree(&mesh, 15);
    itn_mesh_free(&mesh);
    mesh = soup(5000, 3);
    expect_tree(&mesh, 20);
    for (i = 0; i < mesh.vertex_count; i++) { /* sizes that halve, so that no split balances */
        float s = ldexpf(1, -(i / 3 % 120));
        mesh.positions[3 * i] *= s, mesh.positions[3 * i + 1] *= s, mesh.positions[3 * i + 2] *= s;
    }
    expect_tree(&mesh, ITN__DEPTH);
    itn_mesh_free(&mesh);
    mesh = geometry_make(3, MANY);
    add_vertex(&mesh, 0, 0, 0), add_vertex(&mesh, 1, 0, 0), add_vertex(&mesh, 0, 1, 0);
    for (i = 0; i < MANY; i++) add_triangle(&mesh, 0, 1, 2);
    expect_tree(&mesh, 20);
    itn_mesh_free(&mesh);
}

/* ---- against brute force ----------------------------------------------------------------------- */

/* The watertight test of one triangle, number by number. */
static int plain_hit(const itn__triangle *triangle, const itn__shear *s, float tmin, float tmax,
                     const itn__sides *sides, itn_hit *hit) {
    float x[3], y[3], t[3], at;
    double u, v, w, det;
    int k;
    for (k = 0; k < 3; k++) {
        const float *p = triangle->corner[k];
        float z = p[s->kz] - s->origin[s->kz];
        x[k] = p[s->kx] - s->origin[s->kx] - s->sx * z;
        y[k] = p[s->ky] - s->origin[s->ky] - s->sy * z;
        t[k] = z * s->sz;
    }
    u = (double)x[2] * y[1] - (double)y[2] * x[1];
    v = (double)x[0] * y[2] - (double)y[0] * x[2];
    w = (double)x[1] * y[0] - (double)y[1] * x[0];
    det = u + v + w;
    if (!((u >= 0 && v >= 0 && w >= 0) || (u <= 0 && v <= 0 && w <= 0)) || det == 0) return 0;
    at = (float)((0 + u * t[0] + v * t[1] + w * t[2]) / det); /* 0 first: no -0 */
    if (sides) {
        uint64_t object = itn__object_bit(triangle->object);
        if (!((det > 0 ? sides->front : sides->back) & object)) return 0;
        if ((sides->front & sides->back & object) &&
            !itn__meets_sheet(triangle, s, sides, &at))
            return 0;
    }
    if (!(at > tmin && at < tmax)) return 0;
    hit->t = at, hit->u = (float)(v / det), hit->v = (float)(w / det);
    hit->triangle = triangle->index, hit->front = det > 0;
    return 1;
}

/* The nearest hit by trying all triangles, the smaller index where t is equal. */
static int brute(const itn_bvh *bvh, const itn_ray *ray, const itn__sides *sides, itn_hit *hit) {
    itn__shear shear;
    int i, found = 0;
    if (!itn__shear_make(ray, &shear)) return 0;
    for (i = 0; i < bvh->triangle_count; i++) {
        itn_hit one;
        const itn__triangle *triangle = &bvh->triangles[i];
        if (!plain_hit(triangle, &shear, ray->tmin, ray->tmax, sides, &one)) continue;
        if (!found || one.t < hit->t) *hit = one;
        found = 1;
    }
    return found;
}

/* A point of a random triangle: inside, on an edge, or a corner. */
static itn_vec3 target(const itn_mesh *mesh, itn__rng *rng, int kind) {
    int i = (int)(itn__rng_bits(rng) % (uint32_t)mesh->triangle_count);
    itn_vec3 a = corner(mesh, i, 0), b = corner(mesh, i, 1), c = corner(mesh, i, 2);
    float s = itn__uniform(rng), r = sqrtf(itn__uniform(rng));
    if (kind == 2) return a;
    if (kind == 1) return itn__along(a, s, itn__sub(b, a));
    return itn__along(itn__along(a, r * s, itn__sub(b, a)), r * (1 - s), itn__sub(c, a));
}

/* Ray number i of many kinds, in a mesh of that scale and offset. */
static itn_ray any_ray(const itn_mesh *mesh, itn__rng *rng, int i, float scale, float offset) {
    itn_vec3 o = itn__scale(cube_point(rng), scale * (i % 2 ? 1.2f : 3.f));
    itn_vec3 middle = itn__vec3(offset, offset, offset), d = sphere_point(rng);
    float tmax = i % 3 ? INFINITY : scale * itn__uniform(rng);
    o = itn__along(o, 1, middle);
    if (i % 8 == 1) d = itn__sub(target(mesh, rng, 0), o);
    if (i % 8 == 2) d = itn__sub(target(mesh, rng, 1), o);
    if (i % 8 == 3) d = itn__sub(target(mesh, rng, 2), o);
    if (i % 8 == 4 || i % 8 == 5) { /* parallel to an axis, possibly with a coordinate of a vertex */
        itn_vec3 p = target(mesh, rng, 2);
        int axis = (int)(itn__rng_bits(rng) % 3);
        float sign = itn__uniform(rng) < .5f ? -1.f : 1.f, zero = sign * 0;
        d = itn__vec3(axis == 0 ? sign : zero, axis == 1 ? sign : zero, axis == 2 ? sign : zero);
        if (i % 8 == 4) o = itn__vec3(axis ? p.x : o.x, axis == 1 ? o.y : p.y, axis == 2 ? o.z : p.z);
    }
    if (i % 8 == 6) d.y = 0;                                             /* parallel to a plane */
    if (i % 8 == 7) o = target(mesh, rng, 0);                            /* from the surface */
    if (i % 16 == 7) d = itn__sub(target(mesh, rng, i % 3), o);          /* grazing, in a sheet */
    if (i % 5 == 0) d = itn__scale(d, ldexpf(1, (int)(itn__uniform(rng) * 40) - 20));
    return ray_of(o, d, i % 7 ? 0 : -scale * .5f * itn__uniform(rng), tmax);
}

/* Whether two hits are the same in every bit. */
static int same_hit(const itn_hit *a, const itn_hit *b) { return memcmp(a, b, sizeof *a) == 0; }

/* `error` is planted: it stretches the tmax that the hierarchy is given. */
static void expect_brute(itn_mesh mesh, int rays, float scale, float offset, float error) {
    static const itn__sides sides = {5, 6, 0, 0}; /* fronts of objects 0 and 2, backs of 1 and 2 */
    int *objects = (int *)calloc((size_t)mesh.triangle_count, sizeof(int));
    int i, wrong = 0, hits = 0, wrong_any = 0, wrong_sides = 0, side_hits = 0;
    itn__rng rng = itn__rng_make(11, 0, 0);
    itn_bvh *bvh;
    rays = rays / 100 * RAYS;
    place(&mesh, scale, offset);
    for (i = 0; i < mesh.triangle_count; i++) objects[i] = i % 3;
    bvh = hierarchy(&mesh, objects);
    for (i = 0; i < rays; i++) {
        itn_ray ray = any_ray(&mesh, &rng, i, scale, offset), given = ray;
        itn_hit hit = ITN_ZERO, expected = ITN_ZERO;
        int found = brute(bvh, &ray, NULL, &expected);
        given.tmax *= 1 + error;
        hits += found;
        wrong += itn_bvh_nearest(bvh, &given, &hit) != found || !same_hit(&hit, &expected);
        wrong_any += itn_bvh_occluded(bvh, &given) != found;
        found = brute(bvh, &ray, &sides, &expected);
        side_hits += found;
        wrong_sides += itn__bvh_trace(bvh, &given, &sides, 0, &hit) != found ||
                       !same_hit(&hit, &expected) ||
                       itn__bvh_trace(bvh, &given, &sides, 1, NULL) != found;
    }
    check_report(wrong == 0 && wrong_any == 0 && wrong_sides == 0, __FILE__, __LINE__,
                 "scale %g offset %g: %d, %d, %d of %d rays differ from brute force", scale, offset,
                 wrong, wrong_any, wrong_sides, rays);
    CHECK(hits > rays / 10 && hits < rays && side_hits > rays / 20 && side_hits < hits);
    free(objects);
    itn_bvh_free(bvh);
    itn_mesh_free(&mesh);
}

static void test_brute(void) {
    static const float scales[4] = {1e-4f, 1, 1e4f, 1}, offsets[4] = {0, 0, 0, 1e3f};
    int i;
    for (i = 0; i < 4; i++) {
        expect_brute(sphere(16, 9), 40000, scales[i], offsets[i], 0);
        expect_brute(torus(16, 8, .3f), 40000, scales[i], offsets[i], 0);
        expect_brute(box(1, .5f, .001f), 40000, scales[i], offsets[i], 0);
        expect_brute(sphere(150, 1), 20000, scales[i], offsets[i], 0); /* needles */
        expect_brute(sheet(8), 40000, scales[i], offsets[i], 0);
        expect_brute(soup(300, 5), 40000, scales[i], offsets[i], 0);
    }
    CHECK_CATCHES(expect_brute(torus(16, 8, .3f), 40000, 1, 0, .01f));
}

/* A pack of triangles within `size` of each other, at any scale, some with equal corners, some
   flat; and a ray at a point of one of them. */
static itn_ray any_pack(itn__triangle triangles[ITN__PACK], int count, itn__rng *rng, int i) {
    float size = expf(-12 * itn__uniform(rng)), far = i % 5 ? 1 : expf(6 * itn__uniform(rng));
    float scale = i % 3 ? expf(signed_uniform(rng) * (i % 3 == 1 ? 60.f : 20.f)) : 1;
    float offset = i % 2 ? 10 * signed_uniform(rng) : 0, u = itn__uniform(rng);
    float v = i % 3 ? itn__uniform(rng) * (1 - u) : 0;
    int flat = i % 4 ? 3 : (int)(itn__uniform(rng) * 3), j, k;
    const float(*p)[3] = (const float(*)[3])triangles[i % count].corner;
    float to[3];
    itn_vec3 from;
    for (j = 0; j < ITN__PACK; j++) {
        itn_vec3 centre = itn__scale(cube_point(rng), size);
        triangles[j].index = j ^ 5, triangles[j].object = i % 2 ? j & 1 : 1;
        for (k = 0; k < 9; k++)
            triangles[j].corner[k / 3][k % 3] =
                scale * (offset + (&centre.x)[k % 3] + size * signed_uniform(rng));
        for (k = 0; flat < 3 && k < 3; k++)
            triangles[j].corner[k][flat] = triangles[0].corner[0][flat];
        if (j && i % 7 == 0)
            memcpy(triangles[j].corner[j % 3], triangles[j - 1].corner[(j + 1) % 3], sizeof to);
    }
    for (k = 0; k < 3; k++) to[k] = p[0][k] + u * (p[1][k] - p[0][k]) + v * (p[2][k] - p[0][k]);
    from = itn__scale(cube_point(rng), far * scale);
    return ray_of(from, itn__sub(itn__vec3(to[0], to[1], to[2]), from),
                  i % 4 ? 0 : i % 8 ? -1 : -INFINITY,
                  i % 3 ? INFINITY : 1 + 1e-6f * signed_uniform(rng));
}

/* A pack against its triangles one by one; `error` is planted: it moves the ray's slope. */
static void expect_packs(float error) {
    itn__rng rng = itn__rng_make(81, 0, 0);
    int i, j, wrong = 0, hits = 0;
    for (i = 0; i < 5000 * RAYS; i++) {
        itn__triangle triangles[ITN__PACK];
        int count = 1 + (int)(itn__rng_bits(&rng) % ITN__PACK), found = 0;
        itn_ray ray = any_pack(triangles, count, &rng, i);
        uint32_t faces = itn__rng_bits(&rng);
        itn__sides some = ITN_ZERO, *sides = i % 17 < 8 ? &some : NULL;
        itn__shear shear;
        itn__pack pack;
        itn_hit hit = ITN_ZERO, expected = ITN_ZERO;
        int32_t slots[ITN__PACK];
        some.front = faces & 3, some.back = faces >> 2 & 3;
        if (!itn__shear_make(&ray, &shear)) continue;
        for (j = 0; j < ITN__PACK; j++) slots[j] = j;
        itn__pack_fill(&pack, triangles, slots, count);
        hit.t = expected.t = ray.tmax, hit.triangle = expected.triangle = -1;
        for (j = 0; j < count; j++) {
            itn_hit one;
            if (!plain_hit(&triangles[j], &shear, ray.tmin, ray.tmax, sides, &one)) continue;
            if (!found || one.t < expected.t ||
                (one.t == expected.t && one.triangle < expected.triangle))
                expected = one;
            found = 1;
        }
        shear.sx += error;
        wrong += itn__pack_hit(&pack, &shear, ray.tmin, sides, &hit) != found;
        wrong += !same_hit(&hit, &expected);
        hits += found;
    }
    check_report(wrong == 0, __FILE__, __LINE__, "%d packs differ from their triangles", wrong);
    CHECK(hits > 1000 * RAYS);
}

/* Moeller and Trumbore's test in double; returns the least barycentric weight, and t. */
static double plain_test(const itn_vec3 p[3], const itn_ray *ray, double *t, double *cosine) {
    double d[3], e[3], f[3], s[3], h[3], q[3], det, u, v, least, n[3], sizes;
    d[0] = ray->direction.x, d[1] = ray->direction.y, d[2] = ray->direction.z;
    e[0] = (double)p[1].x - p[0].x, e[1] = (double)p[1].y - p[0].y, e[2] = (double)p[1].z - p[0].z;
    f[0] = (double)p[2].x - p[0].x, f[1] = (double)p[2].y - p[0].y, f[2] = (double)p[2].z - p[0].z;
    s[0] = (double)ray->origin.x - p[0].x, s[1] = (double)ray->origin.y - p[0].y;
    s[2] = (double)ray->origin.z - p[0].z;
    h[0] = d[1] * f[2] - d[2] * f[1], h[1] = d[2] * f[0] - d[0] * f[2];
    h[2] = d[0] * f[1] - d[1] * f[0];
    q[0] = s[1] * e[2] - s[2] * e[1], q[1] = s[2] * e[0] - s[0] * e[2];
    q[2] = s[0] * e[1] - s[1] * e[0];
    n[0] = e[1] * f[2] - e[2] * f[1], n[1] = e[2] * f[0] - e[0] * f[2];
    n[2] = e[0] * f[1] - e[1] * f[0];
    det = e[0] * h[0] + e[1] * h[1] + e[2] * h[2];
    u = (s[0] * h[0] + s[1] * h[1] + s[2] * h[2]) / det;
    v = (d[0] * q[0] + d[1] * q[1] + d[2] * q[2]) / det;
    *t = (f[0] * q[0] + f[1] * q[1] + f[2] * q[2]) / det;
    sizes = sqrt((n[0] * n[0] + n[1] * n[1] + n[2] * n[2]) *
                 (d[0] * d[0] + d[1] * d[1] + d[2] * d[2]));
    *cosine = det / sizes; /* det = -d . n: positive when the front is seen */
    least = u < v ? u : v;
    return 1 - u - v < least ? 1 - u - v : least;
}

/* The triangle test against the plain one, on rays that are not within rounding of an edge. */
static void test_plain(float flip) {
    int i, compared = 0, wrong = 0, hits = 0;
    itn__rng rng = itn__rng_make(21, 0, 0);
    double worst = 0;
    for (i = 0; i < 4000 * RAYS; i++) {
        int k, found;
        itn_vec3 p[3], o = cube_point(&rng);
        itn_ray ray = ray_of(o, sphere_point(&rng), -INFINITY, INFINITY);
        itn_hit hit = ITN_ZERO;
        itn__shear shear;
        itn__triangle triangle;
        itn__pack pack;
        int32_t first = 0;
        double t, cosine, least;
        for (k = 0; k < 3; k++) {
            p[k] = cube_point(&rng);
            memcpy(triangle.corner[k], &p[k], sizeof p[k]);
        }
        triangle.index = triangle.object = 0;
        least = plain_test(p, &ray, &t, &cosine);
        if (fabs(cosine) < .01 || fabs(least) < 1e-3) continue;
        itn__shear_make(&ray, &shear);
        itn__pack_fill(&pack, &triangle, &first, 1);
        hit.t = INFINITY, hit.triangle = -1;
        found = itn__pack_hit(&pack, &shear, -INFINITY, NULL, &hit);
        compared++;
        if (found != (least > 0)) wrong++;
        if (!found) continue;
        hits++;
        if (hit.front != (flip * cosine > 0)) wrong++;
        if (fabs(hit.t - t) > worst) worst = fabs(hit.t - t);
        if (fabs(itn__min(itn__min(hit.u, hit.v), 1 - hit.u - hit.v) - least) > 1e-3) wrong++;
    }
    CHECK(wrong == 0);
    CHECK(compared > 3000 * RAYS && hits > 300 * RAYS);
    check_report(worst < 2e-5, __FILE__, __LINE__, "t off by %g", worst); /* 1e-7 / cosine .01 */
}

/* ---- watertightness ---------------------------------------------------------------------------- */

/* Rays from points inside a mesh that is star-shaped about its centre, at its edges and corners.
   `removed` triangles at the end of the list are planted holes. */
static void expect_tight(itn_mesh mesh, int rays, float scale, float offset, int removed) {
    static const itn__sides inside = {0, 1, 0, 0};
    int i, leaks = 0, side_leaks = 0, wrong_side = 0;
    itn__rng rng = itn__rng_make(31, 0, 0);
    itn_vec3 middle = itn__vec3(offset, offset, offset);
    itn_bvh *bvh;
    rays = rays / 100 * RAYS;
    place(&mesh, scale, offset);
    mesh.triangle_count -= removed;
    bvh = hierarchy(&mesh, NULL);
    mesh.triangle_count += removed;
    for (i = 0; i < rays; i++) {
        itn_vec3 o = i % 4 ? itn__along(middle, .3f * scale, cube_point(&rng)) : middle;
        itn_ray ray = ray_of(o, itn__sub(target(&mesh, &rng, 1 + i % 2), o), 0, INFINITY);
        itn_hit hit;
        if (i % 3 == 0) ray.direction = itn__normalize(ray.direction);
        if (!itn_bvh_nearest(bvh, &ray, &hit)) leaks++;
        if (!itn__bvh_trace(bvh, &ray, &inside, 0, &hit)) side_leaks++;
        else if (hit.front) wrong_side++;
    }
    check_report(leaks == 0 && side_leaks == 0, __FILE__, __LINE__,
                 "scale %g offset %g: %d and %d of %d rays leak", scale, offset, leaks, side_leaks,
                 rays);
    CHECK(wrong_side == 0);
    itn_bvh_free(bvh);
    itn_mesh_free(&mesh);
}

/* Rays at edges, corners and silhouettes from outside: every entry has an exit. */
static void expect_parity(itn_mesh mesh, int rays, float offset) {
    static const itn__sides outside = {1, 0, 0, 0}, inside = {0, 1, 0, 0};
    int i, lost = 0, entries = 0;
    itn__rng rng = itn__rng_make(41, 0, 0);
    itn_bvh *bvh;
    rays = rays / 100 * RAYS;
    place(&mesh, 1, offset);
    bvh = hierarchy(&mesh, NULL);
    for (i = 0; i < rays; i++) {
        itn_vec3 o = itn__along(itn__vec3(offset, offset, offset), 4, sphere_point(&rng));
        itn_vec3 d = itn__normalize(itn__sub(target(&mesh, &rng, 1 + i % 2), o));
        float slack = 8 * FLT_EPSILON * (offset + 8);
        itn_ray ray = ray_of(o, d, 0, INFINITY);
        itn_hit in, out;
        while (itn__bvh_trace(bvh, &ray, &outside, 0, &in)) {
            entries++;
            ray.tmin = in.t - slack;
            if (!itn__bvh_trace(bvh, &ray, &inside, 0, &out)) {
                lost++;
                break;
            }
            ray.tmin = itn__max(in.t, out.t);
        }
    }
    check_report(lost == 0, __FILE__, __LINE__, "%d of %d entries have no exit", lost, entries);
    CHECK(entries > rays / 2);
    itn_bvh_free(bvh);
    itn_mesh_free(&mesh);
}

static void test_tight(void) {
    expect_tight(sphere(40, 19), 400000, 1, 0, 0);
    expect_tight(sphere(40, 19), 100000, 1e-4f, 0, 0);
    expect_tight(sphere(40, 19), 100000, 1e4f, 0, 0);
    expect_tight(sphere(40, 19), 100000, 1, 1e3f, 0);
    expect_tight(sphere(700, 3), 200000, 1, 0, 0); /* needles at the poles */
    expect_tight(box(1, .5f, .7f), 200000, 1, 0, 0);
    CHECK_CATCHES(expect_tight(sphere(40, 19), 100000, 1, 0, 1)); /* a hole */
    expect_parity(sphere(40, 19), 100000, 0);
    expect_parity(torus(40, 30, .3f), 100000, 0);
    expect_parity(torus(40, 30, .3f), 100000, 100);
    expect_parity(box(1, .5f, .001f), 100000, 0);
}

/* ---- walks: sides, negative tmin, sheets ------------------------------------------------------- */

/* Whether a point is above the plane of any face: outside of a convex mesh. */
static int above_a_face(const itn_mesh *mesh, itn_vec3 o) {
    int i, k, above = 0;
    for (i = 0; i < mesh->triangle_count && !above; i++) {
        double a[3], b[3], c[3];
        for (k = 0; k < 3; k++) {
            const int *t = mesh->triangles + 3 * i;
            a[k] = (double)(&o.x)[k] - mesh->positions[3 * t[0] + k];
            b[k] = (double)mesh->positions[3 * t[1] + k] - mesh->positions[3 * t[0] + k];
            c[k] = (double)mesh->positions[3 * t[2] + k] - mesh->positions[3 * t[0] + k];
        }
        above = a[0] * (b[1] * c[2] - b[2] * c[1]) + a[1] * (b[2] * c[0] - b[0] * c[2]) +
                    a[2] * (b[0] * c[1] - b[1] * c[0]) > 0;
    }
    return above;
}

/* A walk that bounces about inside a convex mesh, each leg from the rounded point of the last hit.
   It never meets the face it leaves, and always finds a way out: unless rounding has put its origin
   outside and the ray, nearly tangent, does not meet the solid at all, at most `allowed` times.
   Without sides (planted) it meets faces again. */
static void expect_bounces(itn_mesh mesh, float scale, float offset, int filtered, int allowed) {
    static const itn__sides back = {0, 1, 0, 0};
    const itn_vec3 middle = itn__vec3(offset, offset, offset);
    itn_bvh *bvh;
    itn__rng rng = itn__rng_make(51, 0, 0);
    itn_vec3 o = middle, d = sphere_point(&rng), p[3], n;
    int i, last = -1, lost = 0, again = 0, unexplained = 0;
    place(&mesh, scale, offset);
    bvh = hierarchy(&mesh, NULL);
    for (i = 0; i < 2000 * RAYS; i++) {
        itn_ray ray = ray_of(o, d, -8 * FLT_EPSILON * (scale + offset), INFINITY);
        itn_hit hit;
        if (!itn__bvh_trace(bvh, &ray, filtered ? &back : NULL, 0, &hit)) {
            lost++;
            unexplained += !above_a_face(&mesh, o);
            o = middle;
            continue;
        }
        again += hit.triangle == last;
        last = hit.triangle;
        itn__bvh_corners(bvh, last, p);
        n = itn__cross(itn__sub(p[1], p[0]), itn__sub(p[2], p[0]));
        o = itn__along(o, hit.t, d);
        do d = sphere_point(&rng);
        while (!(itn__dot(d, n) < 0));
    }
    check_report(lost <= allowed && unexplained == 0, __FILE__, __LINE__,
                 "scale %g offset %g: lost %d, of them %d inside", scale, offset, lost, unexplained);
    CHECK(again == 0);
    itn_bvh_free(bvh);
    itn_mesh_free(&mesh);
}

static void test_walks(void) {
    static const itn__sides sides[2] = {{0, 1, 0, 0}, {1, 0, 0, 0}};
    static const int objects[12] = {0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0};
    itn_mesh mesh = box(1, 1, 1);
    itn_bvh *bvh = hierarchy(&mesh, objects);
    itn_ray ray = ray_of(itn__vec3(1 + 1e-6f, .25f, .125f), itn__vec3(1, 0, 0), 0, INFINITY);
    itn_hit hit;
    expect_bounces(sphere(40, 19), 1, 0, 1, 10);
    expect_bounces(sphere(40, 19), 1e-4f, 0, 1, 10);
    expect_bounces(sphere(40, 19), 1e4f, 0, 1, 10);
    expect_bounces(sphere(40, 19), 1, 1e3f, 1, 400);
    expect_bounces(box(1, .5f, .7f), 1, 0, 1, 10);
    CHECK_CATCHES(expect_bounces(sphere(40, 19), 1, 0, 0, 200000));
    CHECK(!itn__bvh_trace(bvh, &ray, sides, 0, &hit)); /* just beyond the wall */
    ray.tmin = -4e-6f;
    CHECK(itn__bvh_trace(bvh, &ray, sides, 0, &hit) && hit.t < 0 && hit.t > -2e-6f && !hit.front);
    ray.tmax = 0; /* both ends negative or zero */
    CHECK(itn__bvh_trace(bvh, &ray, sides, 0, &hit));
    CHECK(!itn__bvh_trace(bvh, &ray, sides + 1, 0, &hit)); /* outside: only front faces */
    ray = ray_of(itn__vec3(0, 0, 0), itn__vec3(1, .1f, 0), 0, INFINITY);
    CHECK(itn__bvh_trace(bvh, &ray, sides, 0, &hit) && hit.t == 1);
    CHECK(!itn__bvh_trace(bvh, &ray, sides + 1, 0, &hit));
    itn_bvh_free(bvh);
    itn_mesh_free(&mesh);
}

/* Rays that a flat sheet throws back at points of it meet it nowhere again; those that go through a
   boundary there do, at once. `both` as planted error is a pair of closed-object sides, which do not
   know of sheets. */
static void expect_leaving(int quads, float scale, float offset, itn__sides both) {
    itn_mesh mesh = sheet(quads);
    itn__rng rng = itn__rng_make(61, 0, 0);
    int i, again = 0, missed = 0, front = 0, hits = 0, passed = 0;
    itn_bvh *bvh;
    place(&mesh, scale, offset);
    bvh = hierarchy(&mesh, NULL);
    for (i = 0; i < 2000 * RAYS; i++) {
        itn_vec3 to = target(&mesh, &rng, i % 3), d = sphere_point(&rng);
        itn_vec3 from = itn__along(to, scale, sphere_point(&rng));
        itn_ray ray = ray_of(from, itn__sub(to, from), 0, INFINITY);
        itn__sides begun = both;
        itn_hit hit;
        if (!itn__bvh_trace(bvh, &ray, &both, 0, &hit)) {
            missed += i % 3 == 0; /* at the rim a miss is right */
            continue;
        }
        hits++;
        front += hit.front;
        ray = ray_of(itn__along(from, hit.t, ray.direction), d, 0, INFINITY);
        itn__begin_at(&begun, &bvh->triangles[hit.triangle], ray.origin, 1);
        again += itn__bvh_trace(bvh, &ray, &begun, 0, &hit);
        begun.thrown = 0, ray.tmin = -1e-5f * (scale + offset);
        passed += i % 3 || (itn__bvh_trace(bvh, &ray, &begun, 0, &hit) && hit.t == 0);
    }
    check_report(again == 0, __FILE__, __LINE__, "%d quads, scale %g, offset %g: %d met again",
                 quads, scale, offset, again);
    check_report(!both.back || hits - passed <= hits / 500, __FILE__, __LINE__,
                 "%d quads, scale %g, offset %g: %d of %d passed unseen", quads, scale, offset,
                 hits - passed, hits);
    CHECK(!both.back || missed < 20 + .1f * offset / scale); /* edge-on, or rounded off the rim */
    CHECK(!both.back || (hits > 600 * RAYS && abs(2 * front - hits) < hits / 20));
    itn_bvh_free(bvh);
    itn_mesh_free(&mesh);
}

static void test_sheets(void) {
    static const itn__sides both = {1, 1, 0, 0}, front = {1, 0, 0, 0};
    itn_mesh mesh = sheet(1);
    itn_bvh *bvh = hierarchy(&mesh, NULL);
    itn_vec3 o = itn__vec3(.1f, .2f, 0), n = itn__vec3(0, 0, 1);
    itn_ray ray = ray_of(o, n, 0, INFINITY);
    itn__sides thrown;
    itn_hit hit;
    int i;
    expect_leaving(1, 1, 0, both);
    expect_leaving(8, 1, 0, both);
    expect_leaving(8, 1e-4f, 0, both);
    expect_leaving(8, 1e4f, 0, both);
    expect_leaving(8, 1, 1e3f, both);
    CHECK_CATCHES(expect_leaving(8, 1, 0, front));
    CHECK(itn__bvh_trace(bvh, &ray, &both, 0, &hit));
    o.z = hit.t, thrown = both; /* on the sheet; moving off it by little brings it back */
    itn__begin_at(&thrown, bvh->triangles, o, 1);
    for (i = 0; i < 2; i++) {
        float step = i ? 1e-5f : 0;
        ray = ray_of(itn__vec3(o.x, o.y, o.z - step), n, 0, INFINITY);
        CHECK(itn__bvh_trace(bvh, &ray, &thrown, 0, &hit) == i);
    }
    ray = ray_of(itn__vec3(o.x, o.y, o.z + 1), n, -2, INFINITY); /* behind: sheets need t > 0 */
    CHECK(!itn__bvh_trace(bvh, &ray, &both, 0, &hit) && itn_bvh_nearest(bvh, &ray, &hit));
    itn_bvh_free(bvh);
    itn_mesh_free(&mesh);
}

/* ---- bad input --------------------------------------------------------------------------------- */

static void test_bad_rays(void) {
    static const float bad[3] = {NAN, INFINITY, -INFINITY};
    itn_mesh mesh = sphere(12, 7);
    itn_bvh *bvh = hierarchy(&mesh, NULL);
    itn_ray good = ray_of(itn__vec3(.1f, .2f, .3f), itn__vec3(.3f, .2f, -.5f), 0, INFINITY);
    itn_hit hit = ITN_ZERO;
    int i, k;
    CHECK(itn_bvh_nearest(bvh, &good, &hit));
    hit.triangle = -7;
    for (k = 0; k < 6; k++)
        for (i = 0; i < 3; i++) {
            itn_ray ray = good;
            float *field = k < 3 ? &ray.origin.x + k : &ray.direction.x + (k - 3);
            *field = bad[i];
            CHECK(!itn_bvh_nearest(bvh, &ray, &hit) && !itn_bvh_occluded(bvh, &ray));
        }
    for (i = 0; i < 3; i++) {
        itn_ray ray = good;
        ray.tmax = bad[i];
        CHECK(itn_bvh_occluded(bvh, &ray) == (i == 1));
        ray = good, ray.tmin = bad[i];
        CHECK(itn_bvh_occluded(bvh, &ray) == (i == 2));
    }
    good.tmax = -1;
    CHECK(!itn_bvh_nearest(bvh, &good, &hit));
    good.tmax = 1, good.direction = itn__vec3(0, 0, 0);
    CHECK(!itn_bvh_nearest(bvh, &good, &hit));
    CHECK(hit.triangle == -7); /* left alone */
    itn_bvh_free(bvh);
    itn_mesh_free(&mesh);
}

static void test_bad_meshes(void) {
    itn_mesh mesh = box(1, 1, 1), none = ITN_ZERO;
    itn_error error = ITN_ZERO;
    itn_bvh *bvh = NULL;
    CHECK(itn_bvh_create(NULL, NULL, &bvh, &error) == ITN_ERROR_ARGUMENT);
    CHECK(itn_bvh_create(&none, NULL, &bvh, &error) == ITN_ERROR_ARGUMENT);
    CHECK(itn_bvh_create(&mesh, NULL, NULL, &error) == ITN_ERROR_ARGUMENT);
    mesh.triangles[7] = 8;
    CHECK(itn_bvh_create(&mesh, NULL, &bvh, &error) == ITN_ERROR_ARGUMENT);
    CHECK(strstr(error.message, "triangle 2") != NULL);
    mesh.triangles[7] = 5, mesh.positions[5 * 3 + 1] = NAN;
    CHECK(itn_bvh_create(&mesh, NULL, &bvh, &error) == ITN_ERROR_ARGUMENT);
    CHECK(strstr(error.message, "vertex 5") != NULL && bvh == NULL);
    itn_bvh_free(NULL);
    itn_mesh_free(&mesh);
}

/* Meshes at the limits of the format build, and rays through them return. */
static void test_geometry_extremes(void) {
    static const float scales[5] = {3e38f, 1e30f, 1e-30f, 1e-42f, 0};
    itn__rng rng = itn__rng_make(71, 0, 0);
    int i, j;
    for (j = 0; j < 5; j++) {
        itn_mesh mesh = sphere(12, 7);
        itn_bvh *bvh;
        itn_mesh_report r;
        place(&mesh, scales[j], 0);
        bvh = hierarchy(&mesh, NULL);
        for (i = 0; i < 1000; i++) {
            itn_hit hit = ITN_ZERO;
            itn_ray ray = ray_of(itn__scale(cube_point(&rng), scales[j] * .2f), sphere_point(&rng), 0,
                                 INFINITY);
            if (itn_bvh_nearest(bvh, &ray, &hit)) CHECK(hit.t > 0 && hit.triangle >= 0);
            else if (j == 1 || j == 2) CHECK(!"inside a sphere, but no hit");
        }
        r = report_of(&mesh);
        CHECK(itn__finite(r.volume) && itn__finite(r.area));
        CHECK(scales[j] > 0 || r.degenerate_triangles == mesh.triangle_count);
        itn_bvh_free(bvh);
        itn_mesh_free(&mesh);
    }
}

/* ---- memory ------------------------------------------------------------------------------------ */

typedef struct counter {
    int calls, fail_at, live;
} counter;
static void *counted_allocate(size_t bytes, void *user) {
    counter *c = (counter *)user;
    if (++c->calls == c->fail_at) return NULL;
    c->live++;
    return malloc(bytes);
}
static void counted_free(void *block, void *user) {
    ((counter *)user)->live--;
    free(block);
}

/* One use of everything that allocates; returns its result, and must leave nothing behind. */
static itn_result use_all(const itn_mesh *mesh, const itn_context *context) {
    itn_mesh made = ITN_ZERO;
    itn_mesh_report report;
    itn_bvh *bvh = NULL;
    itn_error error = ITN_ZERO;
    itn_result result = itn_mesh_create(10, 10, 1, context, &made, &error);
    if (result) CHECK(made.positions == NULL && error.code == result && error.message[0]);
    if (!result) result = itn_mesh_check(mesh, context, &report, &error);
    if (!result) result = itn_bvh_create(mesh, context, &bvh, &error);
    if (result) CHECK(bvh == NULL);
    itn_bvh_free(bvh);
    itn_mesh_free(&made);
    return result;
}

static void test_geometry_memory(void) {
    itn_mesh mesh = sphere(12, 7);
    itn_context context = ITN_ZERO;
    counter c = ITN_ZERO;
    int k, calls;
    context.allocate = counted_allocate;
    CHECK(use_all(&mesh, &context) == ITN_ERROR_ARGUMENT); /* half an allocator */
    context.deallocate = counted_free;
    context.memory_user = &c;
    CHECK(use_all(&mesh, &context) == ITN_OK && c.live == 0);
    calls = c.calls;
    CHECK(calls > 5 && calls < 30);
    for (k = 1; k <= calls; k++) {
        c.calls = 0, c.fail_at = k;
        CHECK(use_all(&mesh, &context) == ITN_ERROR_MEMORY);
        CHECK(c.live == 0);
    }
    itn_mesh_free(&mesh);
}

/* The normal of a needle that a ray hits is perpendicular to it and faces the ray. */
static void test_normals_of_needles(void) {
    static const double heights[] = {1e-6, 1e-7, 1e-8};
    uint64_t random = 9;
    int k, i, hits = 0, none = 0, wrong = 0;
    for (k = 0; k < 3; k++)
        for (i = 0; i < 20000; i++) {
            itn_mesh mesh = solids_needles(&random, heights[k], 1);
            const float *p = mesh.positions;
            float w = (float)check_uniform(&random), v = (float)check_uniform(&random) * (1 - w);
            float u = 1 - w - v;
            itn_bvh *bvh;
            itn_ray ray;
            itn_hit hit;
            itn_vec3 n;
            itn_error error;
            solids_need(itn_bvh_create(&mesh, NULL, &bvh, &error), &error);
            ray.origin = solids_vec3(u * p[0] + v * p[3] + w * p[6], 1,
                                     u * p[2] + v * p[5] + w * p[8]);
            ray.direction = solids_vec3(0, -1, 0), ray.tmin = 0, ray.tmax = INFINITY;
            if (itn_bvh_nearest(bvh, &ray, &hit)) {
                hits++;
                if (!itn__hit_normal(bvh, &hit, ray.direction, &n)) none++;
                else wrong += !(n.y > .999f);
            }
            itn_bvh_free(bvh);
            itn_mesh_free(&mesh);
        }
    CHECK(hits > 1000 && none == 0);
    check_report(wrong == 0, __FILE__, __LINE__, "%d of %d normals are wrong", wrong, hits);
}

int main(void) {
    test_check_closed();
    test_check_flat();
    test_check_seams();
    test_check_faults();
    test_check_odd();
    test_check_parts(0);
    CHECK_CATCHES(test_check_parts(1));
    test_check_arguments();
    test_one_triangle();
    test_trees();
    expect_packs(0);
    CHECK_CATCHES(expect_packs(1e-5f));
    test_brute();
    test_plain(1);
    CHECK_CATCHES(test_plain(-1)); /* fronts and backs exchanged */
    test_tight();
    test_walks();
    test_sheets();
    test_bad_rays();
    test_bad_meshes();
    test_normals_of_needles();
    test_geometry_extremes();
    test_geometry_memory();
    return check_end("geometry");
}
