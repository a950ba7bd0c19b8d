/* Makes the closed shapes and the images that the scenes use.

   You learn: how to make watertight meshes from formulas, check them, and write PLY, EXR and PFM.

   Compile: cc -O2 shapes.c -o shapes -lm
   Run:     ./shapes OUTDIR             writes every shape as OUTDIR/NAME.ply
            ./shapes OUTDIR NAME...     writes the shapes (or images: studio, concrete) named
   Prints:  one line a shape, `OUTDIR/blob.ply: 4800 triangles, volume 0.2652, area 2.2864`, and none
            for images

   A shape is centred, its longest side has length 1, its triangles are counter-clockwise seen from
   outside. Three constructors make all of them: a grid of points that is bent into a ring or a
   ball, a cube's surface that is pushed somewhere else, and the zero set of a field by marching
   tetrahedra. Below them every shape is one short function. */

#define ITN_IMPLEMENTATION
#include "../itn.h"

#define PI 3.14159265358979323846

typedef struct point {
    double x, y, z;
} point;

static point make_point(double x, double y, double z) {
    point p;
    p.x = x, p.y = y, p.z = z;
    return p;
}
static point add(point a, point b) { return make_point(a.x + b.x, a.y + b.y, a.z + b.z); }
static point times(point a, double s) { return make_point(a.x * s, a.y * s, a.z * s); }
static point minus(point a, point b) { return add(a, times(b, -1)); }
static point cross(point a, point b) {
    return make_point(a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x);
}
static double dot(point a, point b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
static double length(point a) { return sqrt(dot(a, a)); }
static point unit(point a) { return times(a, 1 / length(a)); }
static double clamp(double x, double lower, double upper) {
    return x < lower ? lower : x > upper ? upper : x;
}
/* 0 below a, 1 above b, smooth between. */
static double step_between(double a, double b, double x) {
    double t = clamp((x - a) / (b - a), 0, 1);
    return t * t * (3 - 2 * t);
}

/* ---- a shape under construction ---- */

typedef struct shape {
    point *points;
    int (*triangles)[3];
    int point_count, point_capacity, triangle_count, triangle_capacity;
} shape;

/* An array with room for one more entry; the program ends if memory is out. */
static void *grown(void *array, int count, int *capacity, size_t size) {
    if (count < *capacity) return array;
    *capacity = *capacity ? 2 * *capacity : 1024;
    array = realloc(array, (size_t)*capacity * size);
    if (!array) {
        fprintf(stderr, "shapes: out of memory\n");
        exit(1);
    }
    return array;
}

static int add_point(shape *s, point p) {
    s->points = (point *)grown(s->points, s->point_count, &s->point_capacity, sizeof *s->points);
    s->points[s->point_count] = p;
    return s->point_count++;
}

static void add_triangle(shape *s, int a, int b, int c) {
    s->triangles = (int(*)[3])grown(s->triangles, s->triangle_count, &s->triangle_capacity,
                                    sizeof *s->triangles);
    s->triangles[s->triangle_count][0] = a;
    s->triangles[s->triangle_count][1] = b;
    s->triangles[s->triangle_count++][2] = c;
}

/* A quadrilateral a b c d, cut along its shorter diagonal. */
static void add_quad(shape *s, int a, int b, int c, int d) {
    const point *p = s->points;
    if (length(minus(p[a], p[c])) <= length(minus(p[b], p[d]))) {
        add_triangle(s, a, b, c);
        add_triangle(s, a, c, d);
    } else {
        add_triangle(s, a, b, d);
        add_triangle(s, b, c, d);
    }
}

/* Six times the signed volume of the triangles from `first` on. */
static double volume_from(const shape *s, int first) {
    double volume = 0;
    int i;
    for (i = first; i < s->triangle_count; i++) {
        const int *t = s->triangles[i];
        volume += dot(s->points[t[0]], cross(s->points[t[1]], s->points[t[2]]));
    }
    return volume;
}

/* Turns the triangles from `first` on outside, if they are inside out. */
static void turn_outside(shape *s, int first) {
    int i;
    if (volume_from(s, first) > 0) return;
    for (i = first; i < s->triangle_count; i++) {
        int *t = s->triangles[i], swap = t[1];
        t[1] = t[2], t[2] = swap;
    }
}

/* ---- constructor 1: a bent grid ---- */

typedef point (*grid_map)(double u, double v, const void *user);

/* A ring: nu x nv points map(u, v) for u, v in [0,1), both directions closed. */
static void add_ring(shape *s, int nu, int nv, grid_map map, const void *user) {
    int first = s->point_count, first_triangle = s->triangle_count, i, j;
    for (i = 0; i < nu; i++)
        for (j = 0; j < nv; j++) add_point(s, map((double)i / nu, (double)j / nv, user));
    for (i = 0; i < nu; i++)
        for (j = 0; j < nv; j++) {
            int a = first + i * nv, b = first + (i + 1) % nu * nv, k = (j + 1) % nv;
            add_quad(s, a + j, b + j, b + k, a + k);
        }
    turn_outside(s, first_triangle);
}

/* A ball: closed in u, with the poles map(0, 0) and map(0, 1) and nv rows between them. */
static void add_ball(shape *s, int nu, int nv, grid_map map, const void *user) {
    int first_triangle = s->triangle_count, top = add_point(s, map(0, 0, user));
    int bottom = add_point(s, map(0, 1, user)), first = s->point_count, i, j;
    for (i = 0; i < nu; i++)
        for (j = 1; j <= nv; j++) add_point(s, map((double)i / nu, (double)j / (nv + 1), user));
    for (i = 0; i < nu; i++) {
        int a = first + i * nv, b = first + (i + 1) % nu * nv;
        add_triangle(s, top, a, b);
        for (j = 0; j + 1 < nv; j++) add_quad(s, a + j, a + j + 1, b + j + 1, b + j);
        add_triangle(s, bottom, b + nv - 1, a + nv - 1);
    }
    turn_outside(s, first_triangle);
}

/* ---- constructor 2: a cube's surface, moved ---- */

typedef point (*space_map)(point p);

/* n x n squares on each face of the cube [-1,1]^3, every point moved by map. */
static void add_cube(shape *s, int n, space_map map) {
    int m = n + 1, first_triangle = s->triangle_count, face, i, j, k;
    int *index = (int *)calloc((size_t)m * (size_t)m * (size_t)m, sizeof *index);
    if (!index) exit(1);
    for (i = 0; i <= n; i++)
        for (j = 0; j <= n; j++)
            for (k = 0; k <= n; k++)
                if (i % n == 0 || j % n == 0 || k % n == 0)
                    index[(i * m + j) * m + k] = add_point(
                        s, map(make_point(2. * i / n - 1, 2. * j / n - 1, 2. * k / n - 1)));
    for (face = 0; face < 6; face++) {
        int axis = face % 3, side = face < 3 ? 0 : n, stride[3], d1, d2;
        stride[0] = m * m, stride[1] = m, stride[2] = 1;
        d1 = stride[(axis + 1) % 3], d2 = stride[(axis + 2) % 3];
        for (i = 0; i < n; i++)
            for (j = 0; j < n; j++) {
                const int *a = index + side * stride[axis] + i * d1 + j * d2;
                if (side)
                    add_quad(s, a[0], a[d1], a[d1 + d2], a[d2]);
                else
                    add_quad(s, a[0], a[d2], a[d1 + d2], a[d1]);
            }
    }
    free(index);
    turn_outside(s, first_triangle);
}

/* ---- constructor 3: where a field is zero ---- */

typedef double (*field)(point p); /* negative inside */

/* A lattice of cubes, each cut into six tetrahedra around its diagonal (Freudenthal), so that faces
   of neighbours match. Each lattice edge that the surface crosses gets one point; a tetrahedron
   then holds a triangle or a quadrilateral, and the whole is closed by construction. */
typedef struct lattice {
    shape *s;
    field f;
    int n[3];      /* points in each direction */
    double size;   /* of a cube */
    point origin;
    double *values;
    int *edge_points; /* [points][7]: index + 1 of the point on the edge to each of 7 neighbours */
} lattice;

static point lattice_point(const lattice *l, const int c[3]) {
    return add(l->origin, make_point(c[0] * l->size, c[1] * l->size, c[2] * l->size));
}
static int lattice_index(const lattice *l, const int c[3]) {
    return (c[0] * l->n[1] + c[1]) * l->n[2] + c[2];
}

/* The surface point between two lattice points; kept off their ends, so that no sliver is made. */
static int edge_point(lattice *l, const int a[3], const int b[3]) {
    const int *low = a, *high = b;
    int direction, *slot;
    if (a[0] + a[1] + a[2] > b[0] + b[1] + b[2]) low = b, high = a;
    direction = (high[0] - low[0]) * 4 + (high[1] - low[1]) * 2 + high[2] - low[2] - 1;
    slot = &l->edge_points[7 * lattice_index(l, low) + direction];
    if (!*slot) {
        double from = l->values[lattice_index(l, low)], to = l->values[lattice_index(l, high)];
        double t = clamp(from / (from - to), .15, .85);
        point p = lattice_point(l, low), q = lattice_point(l, high);
        *slot = 1 + add_point(l->s, add(p, times(minus(q, p), t)));
    }
    return *slot - 1;
}

/* Adds a triangle so that `inside` lies behind it. */
static void add_facing(shape *s, int a, int b, int c, point inside) {
    const point *p = s->points;
    point normal = cross(minus(p[b], p[a]), minus(p[c], p[a]));
    if (dot(normal, minus(p[a], inside)) > 0)
        add_triangle(s, a, b, c);
    else
        add_triangle(s, a, c, b);
}

static void march_tetrahedron(lattice *l, int corners[4][3]) {
    int inside[4], outside[4], in = 0, out = 0, i, e[4];
    point behind;
    for (i = 0; i < 4; i++) {
        if (l->values[lattice_index(l, corners[i])] < 0)
            inside[in++] = i;
        else
            outside[out++] = i;
    }
    if (!in || !out) return;
    behind = lattice_point(l, corners[inside[0]]);
    if (in == 2) {
        behind = times(add(behind, lattice_point(l, corners[inside[1]])), .5);
        for (i = 0; i < 4; i++) /* around the quadrilateral */
            e[i] = edge_point(l, corners[inside[i / 2]], corners[outside[(i + 1) / 2 % 2]]);
        add_facing(l->s, e[0], e[1], e[2], behind);
        add_facing(l->s, e[0], e[2], e[3], behind);
        return;
    }
    for (i = 0; i < 3; i++)
        e[i] = in == 1 ? edge_point(l, corners[inside[0]], corners[outside[i]])
                       : edge_point(l, corners[inside[i]], corners[outside[0]]);
    if (in == 3)
        behind = times(add(add(behind, lattice_point(l, corners[inside[1]])),
                           lattice_point(l, corners[inside[2]])), 1. / 3);
    add_facing(l->s, e[0], e[1], e[2], behind);
}

/* The six tetrahedra of a cube: from corner 000 to 111 along the axes in every order. */
static void march_cube(lattice *l, int x, int y, int z) {
    static const int orders[6][3] = {{0, 1, 2}, {0, 2, 1}, {1, 0, 2},
                                     {1, 2, 0}, {2, 0, 1}, {2, 1, 0}};
    int k, i, corners[4][3];
    for (k = 0; k < 6; k++) {
        corners[0][0] = x, corners[0][1] = y, corners[0][2] = z;
        for (i = 0; i < 3; i++) {
            memcpy(corners[i + 1], corners[i], sizeof corners[i]);
            corners[i + 1][orders[k][i]]++;
        }
        march_tetrahedron(l, corners);
    }
}

static point gradient(field f, point p) {
    const double h = 1e-5;
    return times(make_point(f(make_point(p.x + h, p.y, p.z)) - f(make_point(p.x - h, p.y, p.z)),
                            f(make_point(p.x, p.y + h, p.z)) - f(make_point(p.x, p.y - h, p.z)),
                            f(make_point(p.x, p.y, p.z + h)) - f(make_point(p.x, p.y, p.z - h))),
                 .5 / h);
}

/* Evens out the triangles: every point moves to the mean of its neighbours, then back to the
   surface by Newton steps of at most `reach`. */
static void relax(shape *s, field f, double reach) {
    point *sums = (point *)calloc((size_t)s->point_count, sizeof *sums);
    int *counts = (int *)calloc((size_t)s->point_count, sizeof *counts);
    int i, k;
    if (!sums || !counts) exit(1);
    for (i = 0; i < s->triangle_count; i++)
        for (k = 0; k < 3; k++) {
            int a = s->triangles[i][k], b = s->triangles[i][(k + 1) % 3];
            sums[a] = add(sums[a], s->points[b]);
            counts[a]++;
        }
    for (i = 0; i < s->point_count; i++) {
        point p = times(add(s->points[i], times(sums[i], 1. / counts[i])), .5);
        for (k = 0; k < 3; k++) {
            point slope = gradient(f, p);
            p = minus(p, times(slope, clamp(f(p) / dot(slope, slope),
                                            -reach / length(slope), reach / length(slope))));
        }
        s->points[i] = p;
    }
    free(counts);
    free(sums);
}

/* The surface f = 0 within a box, which must hold all of it, in cubes of a size. */
static void add_field(shape *s, field f, point lower, point upper, double size) {
    lattice l;
    int c[3], i, points;
    l.s = s, l.f = f, l.size = size, l.origin = lower;
    l.n[0] = (int)ceil((upper.x - lower.x) / size) + 1;
    l.n[1] = (int)ceil((upper.y - lower.y) / size) + 1;
    l.n[2] = (int)ceil((upper.z - lower.z) / size) + 1;
    points = l.n[0] * l.n[1] * l.n[2];
    l.values = (double *)malloc((size_t)points * sizeof *l.values);
    l.edge_points = (int *)calloc((size_t)points, 7 * sizeof *l.edge_points);
    if (!l.values || !l.edge_points) exit(1);
    for (c[0] = 0; c[0] < l.n[0]; c[0]++)
        for (c[1] = 0; c[1] < l.n[1]; c[1]++)
            for (c[2] = 0; c[2] < l.n[2]; c[2]++)
                l.values[lattice_index(&l, c)] = f(lattice_point(&l, c));
    for (c[0] = 0; c[0] + 1 < l.n[0]; c[0]++)
        for (c[1] = 0; c[1] + 1 < l.n[1]; c[1]++)
            for (c[2] = 0; c[2] + 1 < l.n[2]; c[2]++) march_cube(&l, c[0], c[1], c[2]);
    for (i = 0; i < 6; i++) relax(s, f, .2 * size);
    free(l.edge_points);
    free(l.values);
}

/* ---- the smooth and the blocky ---- */

/* The lattice is drawn out by a sine, so that half of it lies on the rounding. */
static point rounded_cube(point p) {
    const double inner = .38, radius = .12;
    point q = make_point(.5 * sin(p.x * PI / 2), .5 * sin(p.y * PI / 2), .5 * sin(p.z * PI / 2));
    point core = make_point(clamp(q.x, -inner, inner), clamp(q.y, -inner, inner),
                            clamp(q.z, -inner, inner));
    return add(core, times(unit(minus(q, core)), radius));
}

/* The direction to a point of the cube's surface, evenly spread. */
static point ball(point p) {
    return unit(make_point(tan(p.x * PI / 4), tan(p.y * PI / 4), tan(p.z * PI / 4)));
}

/* A ball whose radius grows towards the corners of an icosahedron. */
static point star(point p) {
    const double golden = 1.6180339887498949;
    point d = ball(p);
    double radius = .42;
    int i;
    for (i = 0; i < 12; i++) {
        double a = i & 1 ? 1 : -1, b = (i & 2 ? 1 : -1) * golden;
        point corner = i < 4   ? make_point(0, a, b)
                       : i < 8 ? make_point(a, b, 0)
                               : make_point(b, 0, a);
        radius += .58 * exp(18 * (dot(d, unit(corner)) - 1));
    }
    return times(d, radius);
}

static point blob(point p) {
    point d = ball(p);
    double radius = 1 + .16 * sin(3.1 * d.x + 1) * cos(2.3 * d.z) + .12 * sin(4.7 * d.z + 2 * d.y) +
                    .07 * cos(6.3 * d.y - 3.9 * d.x) + .045 * sin(9 * d.x + 5 * d.z - 7 * d.y);
    return times(d, radius);
}

/* Height of the relief on a face, a, b in [-1,1]; the pattern depends on the axis of the face. */
static double relief_height(double a, double b, int axis) {
    double border = step_between(.96, .62, fabs(a)) * step_between(.96, .62, fabs(b));
    double r = sqrt(a * a + b * b), wave = 0;
    if (axis == 0) wave = 1.3 * cos(16 * r);
    if (axis == 1) wave = 1.4 * sin(3.5 * PI * a) * sin(3.5 * PI * b);
    if (axis == 2) wave = 1.4 * sin(9 * b + 3.4 * sin(4 * a));
    return -.07 * border * (1 - clamp(wave, -1, 1));
}

static point relief(point p) {
    point q = p;
    if (fabs(p.x) == 1) q.x *= 1 + relief_height(p.y, p.z, 0);
    if (fabs(p.y) == 1) q.y *= 1 + relief_height(p.z, p.x, 1);
    if (fabs(p.z) == 1) q.z *= 1 + relief_height(p.x, p.y, 2);
    return q;
}

/* A thin bent sheet with ripples. */
static point leaf(point p) {
    point d = ball(p);
    double y = d.y, width = .36 * (1 - .45 * y), x = width * d.x;
    double ripple = sin(17 * (y - 1.4 * sqrt(x * x + .001))) * (1 - y * y);
    double bend = 1.1 * x * x - .16 * y * y + .012 * ripple;
    return make_point(x, .5 * y, .02 * d.z + bend);
}

/* ---- rings and turned shapes ---- */

/* The point of a tube around a closed curve, which must not be straight anywhere. */
static point tube(point (*curve)(double t), double u, double v, double radius) {
    const double h = 1e-4;
    point here = curve(u), after = curve(u + h), before = curve(u - h);
    point tangent = unit(minus(after, before));
    point bend = minus(add(after, before), times(here, 2));
    point normal = unit(minus(bend, times(tangent, dot(bend, tangent))));
    point side = cross(tangent, normal);
    return add(here, add(times(normal, radius * cos(2 * PI * v)),
                         times(side, radius * sin(2 * PI * v))));
}

static point trefoil(double t) {
    double a = 2 * PI * t;
    return make_point(cos(a) - 2 * cos(2 * a), sin(a) + 2 * sin(2 * a), 1.1 * sin(3 * a));
}
static point knot(double u, double v, const void *user) {
    (void)user;
    return tube(trefoil, u, v, .42);
}

/* A link of a chain: user[0] is its height, user[1] turns it about the vertical. */
static point chain_link(double u, double v, const void *user) {
    const double *place = (const double *)user;
    double a = 2 * PI * u, b = 2 * PI * v, r = 1 + .17 * cos(b);
    double x = .72 * r * cos(a), z = .17 * sin(b), c = cos(place[1]), s = sin(place[1]);
    return make_point(c * x - s * z, r * sin(a) + place[0], s * x + c * z);
}

/* A toothed wheel with a hub and a rim; the outline of its cross section, radius and height. */
static point gear(double u, double v, const void *user) {
    static const double section[12][2] = {{.24, -.19}, {.24, .19}, {.36, .19},  {.40, .09},
                                          {.68, .09},  {.72, .15}, {1, .15},    {1, -.15},
                                          {.72, -.15}, {.68, -.09}, {.40, -.09}, {.36, -.19}};
    const double *corner = section[(int)(v * 12 + .5) % 12];
    double tooth = fmod(u * 18, 1), radius = corner[0];
    (void)user;
    if (radius == 1) radius -= .17 * step_between(.25, .4, fabs(tooth - .5));
    return make_point(radius * cos(2 * PI * u), radius * sin(2 * PI * u), corner[1]);
}

/* A vase: under the foot, up outside, over the lip, down inside at a wall's distance. */
static double vase_radius(double y) {
    return .15 + .16 * exp(-22 * (y + .12) * (y + .12)) + .1 * step_between(.2, .55, y) +
           .05 * step_between(-.36, -.5, y);
}
static point vase(double u, double v, const void *user) {
    const double wall = .03, floor_y = -.44;
    double y, r;
    (void)user;
    if (v < .08) {
        y = -.5, r = vase_radius(y) * v / .08;
    } else if (v <= .5) {
        y = -.5 + (v - .08) / .42, r = vase_radius(y);
    } else if (v <= .9) {
        y = .5 + (floor_y - .5) * (v - .52) / .38, r = vase_radius(y) - wall;
    } else {
        y = floor_y, r = (vase_radius(y) - wall) * (1 - v) / .1;
    }
    return make_point(r * cos(2 * PI * u), y, r * sin(2 * PI * u));
}

/* A bolt that stands on its head: six sides, and above them a shaft with a sharp thread. The head
   is an outline of radius and height, the shaft is in [.3, .94] of v. */
static point bolt(double u, double v, const void *user) {
    static const double head[7][2] = {{0, -.5},    {.24, -.5}, {.28, -.47}, {.28, -.33},
                                      {.26, -.3}, {.17, -.29}, {.14, -.27}};
    double side = cos(fmod(6 * u, 1) * PI / 3 - PI / 6), r, y;
    (void)user;
    if (v < .3) {
        double along = v * 6 / .3, t;
        int k = along < 5 ? (int)along : 5;
        t = along - k;
        r = head[k][0] + t * (head[k + 1][0] - head[k][0]);
        y = head[k][1] + t * (head[k + 1][1] - head[k][1]);
        if (r > .17) r = .17 + (r - .17) / side;
    } else if (v < .94) {
        double t = (v - .3) / .64, turn = fabs(fmod(6.5 * t - u + 1, 1) - .5);
        y = -.27 + .75 * t;
        r = .14 + .1 * turn * step_between(0, .1, t) * step_between(1, .9, t);
    } else {
        y = .5 - .02 * (1 - v) / .06, r = .14 * (1 - v) / .06;
    }
    return make_point(r * cos(2 * PI * u), y, r * sin(2 * PI * u));
}

/* ---- figures ---- */

/* Union with a fillet of about size k (polynomial smooth minimum). */
static double blend(double a, double b, double k) {
    double h = clamp(k - fabs(a - b), 0, k) / k;
    return (a < b ? a : b) - h * h * k * .25;
}
/* Distance to a capsule from a to b whose radius goes from r to s. */
static double limb(point p, double ax, double ay, double az, double r, double bx, double by,
                   double bz, double s) {
    point a = make_point(ax, ay, az), ab = minus(make_point(bx, by, bz), a), ap = minus(p, a);
    double t = clamp(dot(ap, ab) / dot(ab, ab), 0, 1);
    return length(minus(ap, times(ab, t))) - (r + t * (s - r));
}
static double ellipsoid(point p, double x, double y, double z, double rx, double ry, double rz) {
    point q = make_point((p.x - x) / rx, (p.y - y) / ry, (p.z - z) / rz);
    point g = make_point(q.x / rx, q.y / ry, q.z / rz);
    double k = length(q);
    return k < 1e-9 ? -ry : k * (k - 1) / length(g);
}

/* A dancer: one arm up, one arm out, one knee lifted. */
static double figurine(point p) {
    double d = ellipsoid(p, 0, .14, 0, .105, .15, .07);              /* chest */
    d = blend(d, ellipsoid(p, 0, -.03, 0, .095, .09, .07), .06);     /* hips */
    d = blend(d, limb(p, 0, .26, 0, .035, 0, .33, .005, .033), .03); /* neck */
    d = blend(d, ellipsoid(p, 0, .4, .01, .068, .085, .075), .02);   /* head */
    d = blend(d, limb(p, 0, .395, .08, .012, 0, .385, .1, .014), .015); /* nose */
    d = blend(d, limb(p, .1, .22, 0, .038, .2, .33, .03, .03), .03); /* arm up */
    d = blend(d, limb(p, .2, .33, .03, .03, .17, .47, .05, .02), .02);
    d = blend(d, limb(p, -.1, .22, 0, .038, -.24, .15, .03, .03), .03); /* arm out */
    d = blend(d, limb(p, -.24, .15, .03, .03, -.33, .22, .1, .02), .02);
    d = blend(d, limb(p, .05, -.06, 0, .055, .06, -.27, .01, .04), .03); /* standing leg */
    d = blend(d, limb(p, .06, -.27, .01, .04, .06, -.46, -.01, .027), .02);
    d = blend(d, limb(p, .06, -.475, -.01, .025, .07, -.475, .09, .022), .02);
    d = blend(d, limb(p, -.05, -.06, 0, .055, -.12, -.16, .14, .042), .03); /* lifted leg */
    d = blend(d, limb(p, -.12, -.16, .14, .042, -.1, -.34, .08, .027), .02);
    return blend(d, limb(p, -.1, -.35, .08, .025, -.11, -.37, .16, .02), .02);
}

/* A hound that looks to its left. */
static double hound(point p) {
    double d = limb(p, -.26, .02, 0, .105, .2, .05, 0, .13);          /* trunk */
    int i;
    for (i = 0; i < 4; i++) {
        double x = i < 2 ? .22 : -.28, z = i & 1 ? .075 : -.075;
        double knee = i < 2 ? x + .02 : x - .05;
        d = blend(d, limb(p, x, 0, z, .06, knee, -.2, z * 1.1, .034), .04);
        d = blend(d, limb(p, knee, -.2, z * 1.1, .034, x + .01, -.37, z * 1.15, .024), .02);
        d = blend(d, limb(p, x + .01, -.375, z * 1.15, .026, x + .06, -.378, z * 1.15, .022), .02);
    }
    d = blend(d, limb(p, .26, .1, 0, .08, .36, .27, .02, .06), .06);  /* neck */
    d = blend(d, ellipsoid(p, .38, .31, .03, .085, .07, .07), .03);   /* head */
    d = blend(d, limb(p, .42, .3, .05, .042, .49, .27, .1, .03), .03); /* muzzle */
    d = blend(d, limb(p, .35, .35, .08, .022, .31, .27, .12, .026), .02); /* ears */
    d = blend(d, limb(p, .37, .36, -.03, .022, .34, .29, -.08, .026), .02);
    d = blend(d, limb(p, -.34, .06, 0, .034, -.44, .16, 0, .024), .03); /* tail */
    return blend(d, limb(p, -.44, .16, 0, .024, -.47, .29, .02, .018), .02);
}

/* ---- the list ---- */

static void make_cube(shape *s) { add_cube(s, 16, rounded_cube); }
static void make_star(shape *s) { add_cube(s, 24, star); }
static void make_blob(shape *s) { add_cube(s, 20, blob); }
static void make_relief(shape *s) { add_cube(s, 32, relief); }
static void make_leaf(shape *s) { add_cube(s, 24, leaf); }
static void make_knot(shape *s) { add_ring(s, 240, 16, knot, NULL); }
static void make_gear(shape *s) { add_ring(s, 180, 12, gear, NULL); }
static void make_vase(shape *s) { add_ball(s, 64, 49, vase, NULL); }
static void make_bolt(shape *s) { add_ball(s, 60, 99, bolt, NULL); }
static void make_chain(shape *s) {
    static const double places[3][2] = {{1.42, .35}, {0, .35 + PI / 2}, {-1.42, .35}};
    int i;
    for (i = 0; i < 3; i++) add_ring(s, 56, 16, chain_link, places[i]);
}
static void make_figurine(shape *s) {
    add_field(s, figurine, make_point(-.4, -.53, -.12), make_point(.3, .53, .22), .026);
}
static void make_hound(shape *s) {
    add_field(s, hound, make_point(-.53, -.43, -.2), make_point(.55, .43, .2), .029);
}

static const struct {
    const char *name;
    void (*make)(shape *s);
} shapes[] = {{"blob", make_blob}, {"bolt", make_bolt},         {"chain", make_chain},
              {"cube", make_cube}, {"figurine", make_figurine}, {"gear", make_gear},
              {"hound", make_hound}, {"knot", make_knot},       {"leaf", make_leaf},
              {"relief", make_relief}, {"star", make_star},     {"vase", make_vase}};
enum { SHAPES = sizeof shapes / sizeof shapes[0] };

/* Copies a shape into a mesh: centred, longest side 1. */
static itn_result to_mesh(const shape *s, itn_mesh *mesh, itn_error *error) {
    double lower[3] = {1e30, 1e30, 1e30}, upper[3] = {-1e30, -1e30, -1e30}, side = 0;
    itn_result result = itn_mesh_create(s->point_count, s->triangle_count, 0, NULL, mesh, error);
    int i, k;
    if (result) return result;
    for (i = 0; i < s->point_count; i++) {
        const double xyz[3] = {s->points[i].x, s->points[i].y, s->points[i].z};
        for (k = 0; k < 3; k++) {
            if (xyz[k] < lower[k]) lower[k] = xyz[k];
            if (xyz[k] > upper[k]) upper[k] = xyz[k];
        }
    }
    for (k = 0; k < 3; k++) side = fmax(side, upper[k] - lower[k]);
    for (i = 0; i < s->point_count; i++) {
        const double xyz[3] = {s->points[i].x, s->points[i].y, s->points[i].z};
        for (k = 0; k < 3; k++)
            mesh->positions[3 * i + k] = (float)((xyz[k] - (lower[k] + upper[k]) / 2) / side);
    }
    memcpy(mesh->triangles, s->triangles, (size_t)s->triangle_count * sizeof *s->triangles);
    return ITN_OK;
}

/* Makes, checks and writes one shape; returns 0 on success. */
static int write_shape(const char *folder, int number) {
    char path[1000];
    shape s = ITN_ZERO;
    itn_mesh mesh = ITN_ZERO;
    itn_mesh_report report;
    itn_error error;
    itn_result result;
    int solid;
    snprintf(path, sizeof path, "%s/%s.ply", folder, shapes[number].name);
    shapes[number].make(&s);
    result = to_mesh(&s, &mesh, &error);
    free(s.points);
    free(s.triangles);
    if (!result) result = itn_mesh_check(&mesh, NULL, &report, &error);
    solid = !result && !report.bad_vertices && !report.open_edges && !report.flipped_edges &&
            !report.degenerate_triangles && report.volume > 0;
    if (solid) result = itn_mesh_save_ply(&mesh, path, &error);
    if (result)
        fprintf(stderr, "%s\n", error.message);
    else if (!solid)
        fprintf(stderr, "%s: %d open edges, %d flipped edges, %d flat triangles, volume %g\n",
                path, report.open_edges, report.flipped_edges, report.degenerate_triangles,
                report.volume);
    else
        printf("%s: %d triangles, volume %.4f, area %.4f\n", path, mesh.triangle_count,
               report.volume, report.area);
    itn_mesh_free(&mesh);
    return result || !solid;
}

/* ---- images ---- */

/* 1 inside a soft-edged box of half sizes a, b (degrees) around azimuth and elevation. */
static double soft_box(double azimuth, double elevation, double at_azimuth, double at_elevation,
                       double a, double b) {
    double d = fabs(fmod(azimuth - at_azimuth + 540, 360) - 180);
    return step_between(a + 5, a - 5, d) *
           step_between(b + 5, b - 5, fabs(elevation - at_elevation));
}

/* A studio: a strong warm box high at the back right, a cooler weak one at the left, dark walls. */
static void studio_texel(double u, double v, double rgb[3]) {
    double azimuth = 360 * u, elevation = 90 - 180 * v, wall = .06 + .1 * (1 - v);
    double key = 14 * soft_box(azimuth, elevation, 40, 42, 22, 16);
    double fill = 2.5 * soft_box(azimuth, elevation, 265, 20, 30, 25);
    rgb[0] = wall + key + .85 * fill;
    rgb[1] = wall + .93 * key + .95 * fill;
    rgb[2] = 1.1 * wall + .8 * key + 1.1 * fill;
}

/* A hash of two integers to [0,1), for the concrete's grain. */
static double grain(int x, int y) {
    unsigned h = (unsigned)x * 0x9e3779b9u ^ (unsigned)y * 0x85ebca6bu;
    h = (h ^ (h >> 15)) * 0x2c1b3c6du;
    h = (h ^ (h >> 12)) * 0x297a2d39u;
    return ((h ^ (h >> 15)) >> 8) / 16777216.;
}

/* Concrete: value noise of four octaves that repeats, around a reflectance of .3. */
static void concrete_texel(double u, double v, double rgb[3]) {
    double value = .3, weight = .09;
    int octave, cells = 8;
    for (octave = 0; octave < 4; octave++, cells *= 2, weight *= .6) {
        double x = u * cells, y = v * cells;
        int i = (int)x, j = (int)y, i1 = (i + 1) % cells, j1 = (j + 1) % cells;
        double s = step_between(0, 1, x - i), t = step_between(0, 1, y - j);
        double top = grain(i, j) * (1 - s) + grain(i1, j) * s;
        double bottom = grain(i, j1) * (1 - s) + grain(i1, j1) * s;
        value += weight * (top * (1 - t) + bottom * t - .5);
    }
    rgb[0] = rgb[1] = rgb[2] = value;
}

/* Writes the image of a name; returns 0 on success, -1 if there is none of that name. */
static int write_image(const char *folder, const char *name) {
    int studio = !strcmp(name, "studio"), width = studio ? 96 : 64, height = studio ? 49 : 64;
    int planes = studio ? 3 : 1, i, k;
    char path[1000];
    itn_image image = ITN_ZERO;
    itn_error error;
    itn_result result;
    if (!studio && strcmp(name, "concrete")) return -1;
    snprintf(path, sizeof path, "%s/%s.%s", folder, name, studio ? "exr" : "pfm");
    result = itn_image_create(width, height, planes, NULL, &image, &error);
    for (i = 0; !result && i < width * height; i++) {
        double u = (i % width + .5) / width, v = (double)(i / width), rgb[3];
        if (studio)
            studio_texel(u, v / (height - 1), rgb);
        else
            concrete_texel(u, (v + .5) / height, rgb);
        for (k = 0; k < planes; k++) image.pixels[k * width * height + i] = (float)rgb[k];
    }
    for (k = 0; !result && k < planes; k++) image.names[k][0] = planes == 3 ? "RGB"[k] : 'Y';
    if (!result) result = studio ? itn_image_save_exr(&image, path, &error)
                                 : itn_image_save_pfm(&image, 0, 1, path, &error);
    if (result) fprintf(stderr, "%s\n", error.message);
    itn_image_free(&image);
    return result != ITN_OK;
}

int main(int argc, char **argv) {
    int i, k, failed = 0;
    if (argc < 2) {
        fprintf(stderr, "usage: shapes OUTDIR [NAME...]\nnames:");
        for (k = 0; k < SHAPES; k++) fprintf(stderr, " %s", shapes[k].name);
        fprintf(stderr, "; images: studio concrete\n");
        return 2;
    }
    for (k = 0; argc == 2 && k < SHAPES; k++) failed |= write_shape(argv[1], k);
    for (i = 2; i < argc; i++) {
        int status = write_image(argv[1], argv[i]);
        for (k = 0; k < SHAPES; k++)
            if (!strcmp(argv[i], shapes[k].name)) status = write_shape(argv[1], k);
        if (status < 0) fprintf(stderr, "shapes: there is no shape '%s'\n", argv[i]);
        failed |= status;
    }
    return failed != 0;
}
