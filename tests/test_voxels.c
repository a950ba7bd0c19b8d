/* The voxel tables, against brute force: whatever they call free is traced through the tree, cells
   and slabs are compared with triangles clipped to them in double, distances with a search over all
   cells. All meshes are made here. */
#define ITN_IMPLEMENTATION
#include "../itn.h"
#include "accountant.h"
#include "check.h"
#include "solids.h"

#ifdef ITN_SANITIZED
enum { FEWER = 10 };
#else
enum { FEWER = 1 };
#endif

/* ---- meshes ---------------------------------------------------------------------------------- */

/* Several meshes in one, each an object of its own. */
typedef struct world {
    itn_mesh mesh;
    int *objects;
    itn_bvh *bvh;
    uint64_t closed;
    itn_vec3 lower, upper; /* box for the tables */
} world;

static itn_mesh join(itn_mesh a, itn_mesh b) {
    itn_mesh both;
    itn_error error;
    int i;
    solids_need(itn_mesh_create(a.vertex_count + b.vertex_count,
                                a.triangle_count + b.triangle_count, 0, NULL, &both, &error),
                &error);
    memcpy(both.positions, a.positions, sizeof(float) * 3 * (size_t)a.vertex_count);
    memcpy(both.positions + 3 * a.vertex_count, b.positions,
           sizeof(float) * 3 * (size_t)b.vertex_count);
    memcpy(both.triangles, a.triangles, sizeof(int) * 3 * (size_t)a.triangle_count);
    for (i = 0; i < 3 * b.triangle_count; i++)
        both.triangles[3 * a.triangle_count + i] = b.triangles[i] + a.vertex_count;
    itn_mesh_free(&a);
    itn_mesh_free(&b);
    return both;
}

static float voxels_signed_uniform(itn__rng *rng) { return 2 * itn__uniform(rng) - 1; }
static itn_vec3 voxels_sphere_point(itn__rng *rng) {
    float z = voxels_signed_uniform(rng), phi = 6.2831853f * itn__uniform(rng),
          q = sqrtf(1 - z * z);
    return itn__vec3(q * cosf(phi), q * sinf(phi), z);
}

/* Stretches, then turns by a fixed rotation (if turned), then scales and moves. */
static void voxels_place(itn_mesh *mesh, itn_vec3 stretch, int turned, float scale,
                         itn_vec3 offset) {
    static const float turn[3][3] = {{.8f, -.36f, .48f}, {.6f, .48f, -.64f}, {0, .8f, .6f}};
    int i, j, k;
    for (i = 0; i < mesh->vertex_count; i++) {
        float *p = mesh->positions + 3 * i, q[3];
        q[0] = p[0] * stretch.x, q[1] = p[1] * stretch.y, q[2] = p[2] * stretch.z;
        for (j = 0; j < 3; j++) {
            p[j] = turned ? 0 : q[j];
            for (k = 0; k < 3 && turned; k++) p[j] += turn[j][k] * q[k];
        }
        p[0] = p[0] * scale + offset.x, p[1] = p[1] * scale + offset.y;
        p[2] = p[2] * scale + offset.z;
    }
}

/* Triangles of all sizes anywhere, an open thing. */
static itn_mesh voxels_soup(int n, uint64_t seed) {
    itn_mesh mesh;
    itn_error error;
    itn__rng rng = itn__rng_make(seed, 0, 0);
    int i, j;
    solids_need(itn_mesh_create(3 * n, n, 0, NULL, &mesh, &error), &error);
    for (i = 0; i < n; i++) {
        itn_vec3 centre = voxels_sphere_point(&rng);
        float size = expf(-5 * itn__uniform(&rng));
        for (j = 0; j < 3; j++) {
            itn_vec3 p = itn__along(centre, size, voxels_sphere_point(&rng));
            float *q = mesh.positions + 3 * (3 * i + j);
            q[0] = p.x, q[1] = p.y, q[2] = p.z;
            mesh.triangles[3 * i + j] = 3 * i + j;
        }
    }
    return mesh;
}

/* A ball of two fans of needles. */
static itn_mesh needles(int sectors) {
    itn_mesh mesh;
    itn_error error;
    int i;
    solids_need(itn_mesh_create(sectors + 2, 2 * sectors, 0, NULL, &mesh, &error), &error);
    for (i = 0; i < sectors; i++) {
        double a = 6.283185307179586 * i / sectors;
        int *t = mesh.triangles + 6 * i, next = (i + 1) % sectors;
        mesh.positions[3 * i] = (float)cos(a), mesh.positions[3 * i + 1] = (float)sin(a);
        t[0] = i, t[1] = next, t[2] = sectors;
        t[3] = next, t[4] = i, t[5] = sectors + 1;
    }
    mesh.positions[3 * sectors + 2] = 1, mesh.positions[3 * sectors + 5] = -1;
    return mesh;
}

/* An open square, half_width to each side of the origin, facing up. */
static itn_mesh square(float half_width) {
    static const int triangles[6] = {0, 1, 2, 2, 1, 3};
    itn_mesh mesh;
    itn_error error;
    int i;
    solids_need(itn_mesh_create(4, 2, 0, NULL, &mesh, &error), &error);
    for (i = 0; i < 4; i++) {
        mesh.positions[3 * i] = i & 1 ? half_width : -half_width;
        mesh.positions[3 * i + 2] = i & 2 ? -half_width : half_width;
    }
    memcpy(mesh.triangles, triangles, sizeof triangles);
    return mesh;
}

enum { BALL, CUBE, SLAB, NEEDLES, TWINS, GROUND, SOUP, SHAPES };
static const char *const shape_names[SHAPES] = {"ball",  "cube",   "slab", "needles",
                                                "twins", "ground", "soup"};

static world world_make(int shape, int turned, float scale, float distance) {
    world w = ITN_ZERO;
    itn_vec3 one = solids_vec3(1, 1, 1), zero = solids_vec3(0, 0, 0);
    itn_error error;
    int first = 0, i;
    switch (shape) {
    case BALL: w.mesh = solids_sphere(1, 4); break;
    case CUBE: w.mesh = solids_box(solids_vec3(-1, -1, -1), one); break;
    case SLAB: w.mesh = solids_slab(.004, 1); break;
    case NEEDLES: w.mesh = needles(300); break;
    case SOUP: w.mesh = voxels_soup(600, 5); break;
    case TWINS: /* touching along a face */
        w.mesh = join(solids_box(solids_vec3(-1, -.5, -.5), solids_vec3(0, .5, .5)),
                      solids_box(zero, solids_vec3(.7, .4, .4)));
        first = 12;
        break;
    default: /* a ball above and in a vast plane */
        w.mesh = solids_sphere(1, 3);
        first = w.mesh.triangle_count;
        w.mesh = join(w.mesh, square(500));
    }
    voxels_place(&w.mesh, one, turned, scale, solids_vec3(distance * scale, 0, 0));
    w.closed = shape == SOUP ? 0 : shape == TWINS ? 3 : 1;
    w.objects = (int *)calloc((size_t)w.mesh.triangle_count, sizeof(int));
    w.bvh = itn__bvh_new(&w.mesh.context, w.mesh.triangle_count);
    for (i = 0; i < 3 * w.mesh.triangle_count; i++)
        memcpy(w.bvh->triangles[i / 3].corner[i % 3], w.mesh.positions + 3 * w.mesh.triangles[i],
               3 * sizeof(float));
    for (i = first; first && i < w.mesh.triangle_count; i++)
        w.objects[i] = w.bvh->triangles[i].object = 1;
    solids_need(itn__bvh_build(w.bvh, &error), &error);
    w.lower = w.bvh->lower, w.upper = w.bvh->upper;
    if (shape == GROUND) {
        w.lower = itn__vec3((distance - 1) * scale, -scale, -scale);
        w.upper = itn__vec3((distance + 1) * scale, scale, scale);
    }
    return w;
}
static void world_free(world *w) {
    itn_bvh_free(w->bvh);
    free(w->objects);
    itn_mesh_free(&w->mesh);
}
static void free_tables(itn__voxels *voxels) {
    itn_context context = ITN_ZERO;
    itn__free_blocks(&context, voxels);
}
static itn__voxels *tables(const world *w, int resolution) {
    itn_context context = ITN_ZERO;
    itn__voxels *voxels = NULL;
    itn_error error;
    solids_need(itn__voxels_make(&context, w->bvh, w->closed, w->lower, w->upper, resolution,
                                 &voxels, &error),
                &error);
    return voxels;
}

/* ---- reading the tables ---------------------------------------------------------------------- */

static int cell_of(const itn__voxels *v, itn_vec3 p, int at[3]) {
    at[0] = (int)floorf((p.x - v->lower.x) * v->inverse_cell);
    at[1] = (int)floorf((p.y - v->lower.y) * v->inverse_cell);
    at[2] = (int)floorf((p.z - v->lower.z) * v->inverse_cell);
    if (at[0] < 0 || at[1] < 0 || at[2] < 0) return -1;
    if (at[0] >= v->size[0] || at[1] >= v->size[1] || at[2] >= v->size[2]) return -1;
    return (at[2] * v->size[1] + at[1]) * v->size[0] + at[0];
}
static int chess(const int a[3], const int b[3]) {
    int x = abs(a[0] - b[0]), y = abs(a[1] - b[1]), z = abs(a[2] - b[2]);
    return x > y ? (x > z ? x : z) : (y > z ? y : z);
}
static int holds_triangles(const itn__voxels *v, int cell) { return !(v->cells[cell] >> 24); }
/* How far around a cell the table says there is nothing; -1: the cell holds triangles. */
static int empty_reach(const itn__voxels *v, int cell) { return (v->cells[cell] >> 24) - 1; }

/* What a table says of the block around a cell; below, of n.x in the coordinates of x. */
typedef struct region {
    double n[3], below, against;
    int reach;
} region;

static double along(const double n[3], const double p[3]) {
    return n[0] * p[0] + n[1] * p[1] + n[2] * p[2];
}
static double along3(const double n[3], itn_vec3 p) { return n[0] * p.x + n[1] * p.y + n[2] * p.z; }

/* Returns 0 if the table has no more to say than empty_reach. */
static int read_region(const itn__voxels *v, const int at[3], int cell, region *r) {
    const float lower[3] = {v->lower.x, v->lower.y, v->lower.z};
    uint32_t word = (uint32_t)v->cells[cell], plane = (uint32_t)v->planes[cell];
    double middle[3];
    int k;
    if (!(word & 0xffffff)) return 0;
    for (k = 0; k < 3; k++) {
        r->n[k] = (int8_t)(word >> 8 * k & 255);
        middle[k] = lower[k] + (at[k] + .5) * v->cell;
    }
    r->reach = v->cells[cell] >> 24, r->against = plane >> 24;
    r->below = (int16_t)(plane & 0xffff) / 32. * v->cell + along(r->n, middle);
    return 1;
}

enum { BY_CUBE = 1, BY_SLAB = 2, BY_NORMALS = 4 };

/* In which ways a segment is called free. */
static int claims(const itn__voxels *v, itn_vec3 p, itn_vec3 q, itn_vec3 d) {
    int from[3], to[3], cell = cell_of(v, p, from), found = 0, distance;
    region r;
    if (cell < 0) return 0;
    cell_of(v, q, to);
    distance = chess(from, to);
    if (distance <= empty_reach(v, cell)) found |= BY_CUBE;
    if (read_region(v, from, cell, &r) && distance <= r.reach) {
        if (along3(r.n, p) < r.below && along3(r.n, q) < r.below) found |= BY_SLAB;
        if (along3(r.n, d) < -r.against) found |= BY_NORMALS;
    }
    return found;
}

/* What is wrong with the tables on trial. */
enum { NOTHING, RAISED_REGION, WIDER_CONE, LARGER_CUBE, DROPPED_LEAF };

static void plant(itn__voxels *v, int fault) {
    int i, cells = v->size[0] * v->size[1] * v->size[2], leaf = v->leaves[0];
    for (i = 0; i < cells; i++) {
        uint32_t plane = (uint32_t)v->planes[i], below = plane & 0xffff;
        if (fault == RAISED_REGION && v->cells[i] & 0xffffff)
            v->planes[i] = (int32_t)((plane & 0xffff0000) | ((below + 1200) & 0xffff));
        if (fault == WIDER_CONE) v->planes[i] = (int32_t)((plane >> 25 << 24) | (plane & 0xffffff));
        if (fault == LARGER_CUBE && empty_reach(v, i) >= 0) v->cells[i] += 1 << 24;
        if (fault == DROPPED_LEAF && holds_triangles(v, i)) v->leaves[v->first[i]] = leaf;
    }
}

/* ---- claims against the tree ----------------------------------------------------------------- */

typedef struct claim_count {
    long long segments, claimed, cube, slab, normals, wrong;
} claim_count;

static itn_vec3 triangle_point(const itn__triangle *t, itn__rng *rng) {
    float a = itn__uniform(rng), b = itn__uniform(rng);
    itn_vec3 p = itn__vec3(t->corner[0][0], t->corner[0][1], t->corner[0][2]);
    itn_vec3 e = itn__sub(itn__vec3(t->corner[1][0], t->corner[1][1], t->corner[1][2]), p);
    itn_vec3 f = itn__sub(itn__vec3(t->corner[2][0], t->corner[2][1], t->corner[2][2]), p);
    if (a + b > 1) a = 1 - a, b = 1 - b;
    return itn__along(itn__along(p, a, e), b, f);
}

/* A start: on a triangle, near one, or anywhere in the grid. */
static itn_vec3 random_start(const world *w, const itn__voxels *v, itn__rng *rng) {
    float kind = itn__uniform(rng), pick = itn__uniform(rng);
    const itn__triangle *t =
        &w->bvh->triangles[(int)(pick * (float)w->bvh->triangle_count) % w->bvh->triangle_count];
    itn_vec3 p = triangle_point(t, rng);
    if (kind < .2f) return p;
    if (kind < .7f && t->object == 0)
        return itn__along(p, 2.5f * itn__uniform(rng) * v->cell, voxels_sphere_point(rng));
    p.x = v->lower.x + itn__uniform(rng) * v->cell * (float)v->size[0];
    p.y = v->lower.y + itn__uniform(rng) * v->cell * (float)v->size[1];
    p.z = v->lower.z + itn__uniform(rng) * v->cell * (float)v->size[2];
    return p;
}

/* Traces what is claimed free among `count` segments. */
static claim_count try_claims(const world *w, const itn__voxels *v, long long count,
                              uint64_t seed) {
    claim_count sum = ITN_ZERO;
    itn__sides back = ITN_ZERO;
    itn__rng rng = itn__rng_make(seed, 0, 0);
    back.back = w->closed;
    for (; sum.segments < count; sum.segments++) {
        itn_hit hit;
        itn_ray ray;
        itn_vec3 q;
        int found;
        if (!(sum.segments & 0xffffff)) rng = itn__rng_make(seed, (uint64_t)sum.segments, 0);
        ray.origin = random_start(w, v, &rng), ray.direction = voxels_sphere_point(&rng);
        ray.tmin = 0, ray.tmax = -logf(itn__uniform(&rng)) * v->cell;
        q = itn__along(ray.origin, ray.tmax, ray.direction);
        found = claims(v, ray.origin, q, ray.direction);
        if (!found) continue;
        sum.claimed++;
        sum.cube += !!(found & BY_CUBE), sum.slab += !!(found & BY_SLAB);
        sum.normals += !!(found & BY_NORMALS);
        if (found & (BY_CUBE | BY_SLAB))
            sum.wrong += itn__bvh_trace(w->bvh, &ray, NULL, 1, &hit);
        else
            sum.wrong += itn__bvh_trace(w->bvh, &ray, &back, 1, &hit);
    }
    return sum;
}

static void claims_hold(int shape, int turned, int resolution, float scale, float distance,
                        long long count, int fault, claim_count *total) {
    world w = world_make(shape, turned, scale, distance);
    itn__voxels *v = tables(&w, resolution);
    claim_count sum;
    plant(v, fault);
    sum = try_claims(&w, v, count / FEWER, (uint64_t)(shape * 100 + resolution));
    check_report(sum.wrong == 0, __FILE__, __LINE__,
                 "%s, turned %d, %d cells, scale %g, distance %g: %lld of %lld claims wrong",
                 shape_names[shape], turned, resolution, (double)scale, (double)distance,
                 sum.wrong, sum.claimed);
    total->segments += sum.segments, total->claimed += sum.claimed, total->cube += sum.cube;
    total->slab += sum.slab, total->normals += sum.normals;
    if (shape == BALL && distance == 0) { /* not by saying nothing */
        CHECK((double)sum.claimed > .2 * (double)sum.segments); /* a half is outside */
        CHECK((double)sum.normals > .05 * (double)sum.segments);
    }
    if (shape != BALL && shape != CUBE && shape != NEEDLES && shape != SLAB && shape != GROUND)
        CHECK(sum.normals == 0);
    free_tables(v);
    world_free(&w);
}
static void all_claims_hold(void) {
    static const int resolutions[3] = {5, 24, 90};
    long long count = check_long() ? 3000000 : 20000;
    claim_count total = ITN_ZERO;
    int shape, k;
    for (shape = 0; shape < SHAPES; shape++)
        for (k = 0; k < 3; k++) {
            claims_hold(shape, 0, resolutions[k], 1, 0, count, NOTHING, &total);
            claims_hold(shape, 1, resolutions[k], 1e-4f, 0, count, NOTHING, &total);
            claims_hold(shape, 1, resolutions[k], 1e4f, 3, count, NOTHING, &total);
            claims_hold(shape, k & 1, resolutions[k], 1, 300, count, NOTHING, &total);
        }
    printf("voxels: %lld of %lld segments claimed free: by cube %lld, slab %lld, normals %lld\n",
           total.claimed, total.segments, total.cube, total.slab, total.normals);
    CHECK(total.claimed >= 200000 / FEWER);
}

/* ---- cells and slabs against clipping -------------------------------------------------------- */

typedef struct polygon {
    int count;
    double p[12][3];
} polygon;

/* A triangle in units of cells, cut to the box. */
static polygon clip(const itn__voxels *v, const itn__triangle *t, const double lower[3],
                    const double upper[3]) {
    const float origin[3] = {v->lower.x, v->lower.y, v->lower.z};
    polygon in, out;
    int i, j, k, side;
    in.count = 3;
    for (j = 0; j < 3; j++)
        for (k = 0; k < 3; k++) in.p[j][k] = ((double)t->corner[j][k] - origin[k]) / v->cell;
    for (k = 0; k < 3; k++)
        for (side = 0; side < 2; side++, in = out) {
            out.count = 0;
            for (i = 0; i < in.count; i++) {
                const double *a = in.p[i], *b = in.p[(i + 1) % in.count];
                double da = side ? upper[k] - a[k] : a[k] - lower[k];
                double db = side ? upper[k] - b[k] : b[k] - lower[k];
                if (da >= 0) memcpy(out.p[out.count++], a, sizeof in.p[0]);
                if ((da >= 0) == (db >= 0)) continue;
                for (j = 0; j < 3; j++)
                    out.p[out.count][j] = a[j] + da / (da - db) * (b[j] - a[j]);
                out.p[out.count++][k] = side ? upper[k] : lower[k];
            }
        }
    return in;
}
static polygon clip_block(const itn__voxels *v, const itn__triangle *t, const int at[3], int reach,
                          double margin) {
    double lower[3], upper[3];
    int k;
    for (k = 0; k < 3; k++)
        lower[k] = at[k] - reach - margin, upper[k] = at[k] + reach + 1 + margin;
    return clip(v, t, lower, upper);
}

/* Whether the triangle is in one of the leaves that a cell lists. */
static int listed(const world *w, const itn__voxels *v, int cell, int index) {
    int i, k;
    for (i = v->first[cell]; i < v->first[cell + 1]; i++)
        for (k = 0; k < ITN__PACK; k++)
            if (w->bvh->packs[v->leaves[i]].index[k] == index) return 1;
    return 0;
}
/* How many leaves a cell lists that have no triangle within a margin of it. */
static int idle_leaves(const world *w, const itn__voxels *v, const int at[3], int cell,
                       double margin) {
    int i, k, idle = 0;
    for (i = v->first[cell]; i < v->first[cell + 1]; i++) {
        const itn__pack *pack = &w->bvh->packs[v->leaves[i]];
        int touches = 0;
        for (k = 0; k < ITN__PACK && !touches; k++)
            touches = pack->index[k] >= 0 &&
                      clip_block(v, &w->bvh->triangles[pack->index[k]], at, 0, margin).count > 0;
        idle += !touches;
    }
    return idle;
}

/* Whether n.x of the polygon is beyond a bound, with what rounding in its use may take. */
static int bound_holds(const itn__voxels *v, const polygon *cut, const region *r) {
    const float lower[3] = {v->lower.x, v->lower.y, v->lower.z};
    int i, k, holds = 1;
    for (i = 0; i < cut->count; i++) {
        double x[3];
        for (k = 0; k < 3; k++) x[k] = lower[k] + cut->p[i][k] * v->cell;
        holds = holds && along(r->n, x) - .0005 * v->cell > r->below;
    }
    return holds;
}

/* Whether all that runs against n by more than `against` runs against the triangle's normal. */
static int cone_holds(const itn__triangle *t, const double n[3], double against) {
    double e[3], f[3], m[3], length, a;
    int k;
    if (against * against >= along(n, n)) return 1; /* no claim */
    for (k = 0; k < 3; k++) {
        e[k] = (double)t->corner[1][k] - t->corner[0][k];
        f[k] = (double)t->corner[2][k] - t->corner[0][k];
    }
    for (k = 0; k < 3; k++)
        m[k] = e[(k + 1) % 3] * f[(k + 2) % 3] - e[(k + 2) % 3] * f[(k + 1) % 3];
    length = sqrt(m[0] * m[0] + m[1] * m[1] + m[2] * m[2]);
    a = along(n, m) / length;
    return a > 0 && along(n, n) - a * a <= against * against;
}

/* Looks at `count` cells, most of them near a triangle: the leaves of all triangles that touch a
   cell are listed, no others; planes hold what lies in the cell or block; cubes are empty. */
static void cells_hold(int shape, int turned, int resolution, float scale, float distance,
                       int count, int fault) {
    world w = world_make(shape, turned, scale, distance);
    itn__voxels *v = tables(&w, resolution);
    itn__rng rng = itn__rng_make(7, (uint64_t)shape, (uint64_t)resolution);
    int missing = 0, extra = 0, bound_wrong = 0, cube_wrong = 0, cone_wrong = 0, i;
    plant(v, fault);
    for (; count > 0; count--) {
        int at[3], cell = cell_of(v, random_start(&w, v, &rng), at), regional;
        region r;
        if (cell < 0) continue;
        regional = read_region(v, at, cell, &r);
        if (holds_triangles(v, cell))
            extra += idle_leaves(&w, v, at, cell, shape == GROUND ? .1 : .02);
        for (i = 0; i < w.bvh->triangle_count; i++) {
            const itn__triangle *t = &w.bvh->triangles[i];
            polygon cut = clip_block(v, t, at, 0, .01), part;
            missing += cut.count && !listed(&w, v, cell, t->index);
            if (empty_reach(v, cell) >= 0)
                cube_wrong += clip_block(v, t, at, empty_reach(v, cell), .005).count > 0;
            if (!regional) continue;
            part = clip_block(v, t, at, r.reach, .005);
            bound_wrong += !bound_holds(v, &part, &r);
            if (part.count) cone_wrong += !cone_holds(t, r.n, r.against);
        }
    }
    check_report(!missing && !extra && !bound_wrong && !cube_wrong && !cone_wrong,
                 __FILE__, __LINE__,
                 "%s, turned %d, %d cells, scale %g, distance %g: %d triangles missing, %d leaves "
                 "extra, %d out of bounds, %d in cubes, %d of cones",
                 shape_names[shape], turned, resolution, (double)scale, (double)distance, missing,
                 extra, bound_wrong, cube_wrong, cone_wrong);
    free_tables(v);
    world_free(&w);
}
static void all_cells_hold(void) {
    static const int resolutions[3] = {6, 31, 70};
    int shape, k;
    for (shape = 0; shape < SHAPES; shape++)
        for (k = 0; k < 3; k++) {
            cells_hold(shape, k & 1, resolutions[k], 1, 0, 200 / FEWER, NOTHING);
            cells_hold(shape, 1, resolutions[k], 1e-4f, 0, 100 / FEWER, NOTHING);
            cells_hold(shape, 1, resolutions[k], 1e4f, 100, 100 / FEWER, NOTHING);
        }
}

/* Every cell's cube is as large as it can be: its reach is the chessboard distance to the nearest
   cell that holds triangles or is outside, less one. It has a region if triangles are that near. */
static void distances_are_exact(int shape, int resolution) {
    world w = world_make(shape, 1, 1, 0);
    itn__voxels *v = tables(&w, resolution);
    int cells = v->size[0] * v->size[1] * v->size[2], cell, i, wrong = 0;
    for (cell = 0; cell < cells; cell += 1 + cells / (2000 / FEWER)) {
        int at[3], other[3], k, distance = ITN__REACH, border = ITN__REACH;
        itn__cell_place(v, cell, at);
        for (i = 0; i < cells; i++) {
            if (!holds_triangles(v, i)) continue;
            itn__cell_place(v, i, other);
            distance = chess(at, other) < distance ? chess(at, other) : distance;
        }
        for (k = 0; k < 3; k++) {
            border = at[k] + 1 < border ? at[k] + 1 : border;
            border = v->size[k] - at[k] < border ? v->size[k] - at[k] : border;
        }
        wrong += empty_reach(v, cell) != (border < distance ? border : distance) - 1;
        wrong += ((v->cells[cell] & 0xffffff) != 0) !=
                 (distance <= 1 && distance < border);
    }
    check_report(!wrong, __FILE__, __LINE__, "%s, %d cells: %d distances wrong", shape_names[shape],
                 resolution, wrong);
    free_tables(v);
    world_free(&w);
}

/* ---- other properties ------------------------------------------------------------------------ */

static void backwards(int count, void (*body)(void *, int), void *task, void *user) {
    (void)user;
    while (count-- > 0) body(task, count);
}
static int voxels_same(const itn__voxels *a, const itn__voxels *b) {
    size_t cells = itn__cell_count(a), k = sizeof(int32_t);
    return itn__cell_count(b) == cells &&
           !memcmp(a->cells, b->cells, cells * k) && !memcmp(a->planes, b->planes, cells * k) &&
           !memcmp(a->first, b->first, (cells + 1) * k) &&
           !memcmp(a->leaves, b->leaves, (size_t)a->first[cells] * k);
}
/* The tables do not depend on how loops are run. */
static void order_does_not_matter(int shape) {
    world w = world_make(shape, 1, 1, 0);
    itn__voxels *a = tables(&w, 40), *b = NULL;
    itn_context context = ITN_ZERO;
    itn_error error;
    context.parallel_for = backwards;
    CHECK(itn__voxels_make(&context, w.bvh, w.closed, w.lower, w.upper, 40, &b, &error) ==
          ITN_OK);
    CHECK(voxels_same(a, b));
    free_tables(a);
    free_tables(b);
    world_free(&w);
}

/* An allocation may fail at any call. */
static void memory_may_fail(void) {
    world w = world_make(BALL, 0, 1, 0);
    long fail;
    for (fail = 1; fail < 100; fail++) {
        accountant a = ITN_ZERO;
        itn_context context = count_context(&a);
        itn__voxels *v = NULL;
        itn_error error = ITN_ZERO;
        itn_result result;
        a.fail_at = fail;
        result = itn__voxels_make(&context, w.bvh, 1, w.lower, w.upper, 12, &v, &error);
        if (result == ITN_OK) {
            CHECK(a.calls < fail && v);
            itn__free_blocks(&context, v);
            CHECK(a.live == 0);
            break;
        }
        CHECK(result == ITN_ERROR_MEMORY && error.code == result && !v && a.live == 0);
    }
    CHECK(fail > 7 && fail < 100);
    world_free(&w);
}

static itn_result make_box(const world *w, itn_vec3 lower, itn_vec3 upper, int resolution) {
    itn_context context = ITN_ZERO;
    itn__voxels *v = NULL;
    itn_error error = ITN_ZERO;
    itn_result result =
        itn__voxels_make(&context, w->bvh, 1, lower, upper, resolution, &v, &error);
    CHECK(!result == (v != NULL) && result == error.code);
    free_tables(v);
    return result;
}
static void bad_boxes_are_refused(void) {
    world w = world_make(BALL, 0, 1, 0);
    itn_vec3 zero = solids_vec3(0, 0, 0), one = solids_vec3(1, 1, 1), bad = one;
    CHECK(make_box(&w, zero, one, 4) == ITN_OK);
    CHECK(make_box(&w, zero, one, 300) == ITN_ERROR_UNSUPPORTED); /* too many */
    CHECK(make_box(&w, zero, one, 0) == ITN_ERROR_UNSUPPORTED);
    CHECK(make_box(&w, zero, one, -3) == ITN_ERROR_UNSUPPORTED);
    CHECK(make_box(&w, one, zero, 4) == ITN_ERROR_UNSUPPORTED);
    CHECK(make_box(&w, zero, zero, 4) == ITN_ERROR_UNSUPPORTED);
    bad.y = NAN;
    CHECK(make_box(&w, zero, bad, 4) == ITN_ERROR_UNSUPPORTED);
    bad.y = INFINITY;
    CHECK(make_box(&w, zero, bad, 4) == ITN_ERROR_UNSUPPORTED);
    CHECK(make_box(&w, solids_vec3(-3e38, 0, 0), solids_vec3(3e38, 1, 1), 4) ==
          ITN_ERROR_UNSUPPORTED); /* the extent overflows */
    CHECK(make_box(&w, zero, solids_vec3(1e-39, 1e-39, 1e-39), 4) == ITN_ERROR_UNSUPPORTED);
    CHECK(make_box(&w, solids_vec3(2, 2, 2), solids_vec3(3, 3, 3), 4) == ITN_OK); /* empty */
    world_free(&w);
}

/* Grids keep to their limits, thin boxes get thin cells, far ones large cells. */
static void grids_fit(void) {
    static const int resolutions[4] = {1, 64, 150, 250};
    int shape, k;
    for (shape = 0; shape < SHAPES; shape++)
        for (k = 0; k < 4; k++) {
            world w = world_make(shape, 0, 1, k == 1 ? 1000 : 0);
            itn__voxels *v = tables(&w, FEWER > 1 && k > 1 ? 90 : resolutions[k]);
            double total = (double)v->size[0] * v->size[1] * v->size[2];
            double end = v->lower.x + (double)v->cell * v->size[0];
            CHECK(total <= 16777216 && v->size[0] >= 3 && v->size[1] >= 3 && v->size[2] >= 3);
            CHECK(v->lower.x < w.lower.x - .9 * v->cell && end > w.upper.x + .9 * v->cell);
            if (k == 0) CHECK(total <= 125);
            if (k == 1) CHECK(v->cell >= .9f); /* at x = 1000, rounding makes for large cells */
            if (shape == SLAB && k == 2 && FEWER == 1) CHECK(v->cell < .6f * 2 / 150);
            free_tables(v);
            world_free(&w);
        }
}

/* Triangles that no ray can hit are left out, and those without area that one may hit are not. */
static void flat_triangles(void) {
    itn_mesh mesh = solids_sphere(1, 2);
    itn_error error;
    itn_context context = ITN_ZERO;
    itn__voxels *v = NULL;
    itn_bvh *bvh;
    int *t = mesh.triangles, cell, at[3];
    itn_vec3 p = solids_vec3(.1, .2, .3);
    mesh.positions[0] = p.x, mesh.positions[1] = p.y, mesh.positions[2] = p.z;
    mesh.positions[3] = .2f, mesh.positions[4] = .4f, mesh.positions[5] = .6f;
    t[0] = t[1] = 0, t[2] = 1;
    solids_need(itn_bvh_create(&mesh, NULL, &bvh, &error), &error);
    solids_need(itn__voxels_make(&context, bvh, 1, bvh->lower, bvh->upper, 30, &v, &error),
                &error);
    cell = cell_of(v, solids_vec3(.15, .3, .45), at);
    CHECK(empty_reach(v, cell) >= 0);
    free_tables(v);
    itn_bvh_free(bvh);
    t[0] = 0, t[1] = 1, t[2] = 2;
    memcpy(mesh.positions + 6, mesh.positions, 2 * sizeof(float)); /* a needle */
    mesh.positions[8] = .3000001f;
    solids_need(itn_bvh_create(&mesh, NULL, &bvh, &error), &error);
    solids_need(itn__voxels_make(&context, bvh, 1, bvh->lower, bvh->upper, 30, &v, &error),
                &error);
    CHECK(empty_reach(v, cell_of(v, solids_vec3(.15, .3, .45), at)) < 0);
    free_tables(v);
    itn_bvh_free(bvh);
    itn_mesh_free(&mesh);
}

int main(void) {
    claim_count ignored = ITN_ZERO;
    int shape, k;
    all_claims_hold();
    all_cells_hold();
    for (shape = 0; shape < SHAPES; shape++) {
        order_does_not_matter(shape);
        for (k = 5; k <= 35; k += 15) distances_are_exact(shape, k / (FEWER > 1 ? 2 : 1));
    }
    memory_may_fail();
    bad_boxes_are_refused();
    grids_fit();
    flat_triangles();
    CHECK_CATCHES(claims_hold(BALL, 1, 24, 1, 0, 40000 * FEWER, RAISED_REGION, &ignored));
    CHECK_CATCHES(claims_hold(BALL, 1, 24, 1, 0, 40000 * FEWER, WIDER_CONE, &ignored));
    CHECK_CATCHES(cells_hold(BALL, 1, 24, 1, 0, 200, RAISED_REGION));
    CHECK_CATCHES(cells_hold(BALL, 1, 24, 1, 0, 200, WIDER_CONE));
    CHECK_CATCHES(cells_hold(BALL, 1, 24, 1, 0, 200, LARGER_CUBE));
    CHECK_CATCHES(cells_hold(BALL, 1, 24, 1, 0, 200, DROPPED_LEAF));
    return check_end("voxels");
}
