/* Random numbers, free flight, phase function: moments, densities and derivatives. Where a formula
   is inverted, uniform numbers are replaced by the midpoints of equal steps, so that most checks
   have no noise at all. */
#define ITN_IMPLEMENTATION
#include "../itn.h"
#include "check.h"
#include "one.h"
#include "solids.h"
#include "stage.h"

static const double medium_pi = 3.14159265358979323846;
static const float all_g[17] = {0,    1e-7f,  -1e-7f, 1e-4f, -1e-4f, .3f,   -.3f,  .6f,  -.6f,
                                .9f,  -.9f,   .99f,   -.99f, .998f,  -.998f, .999f, -.999f};

/* ---- phase function -------------------------------------------------------------------------- */

/* The formulas of the chapter in double, written in the cosine. */
static double henyey_greenstein(double g, double x) {
    double square = (1 - g) * (1 - g) + 2 * g * x;
    return (1 - g * g) / (4 * medium_pi * square * sqrt(square));
}

/* E[P_l(cos theta)] = g^l, l = 1..4, over equal steps of u. `shift` plants an error. */
static void check_moments(float g, double shift) {
    enum { STEPS = 1 << 18 };
    double moment[5] = {0}, power = 1;
    itn_vec3 forward = itn__normalize(itn__vec3(.3f, -.5f, .8f));
    int i, l;
    for (i = 0; i < STEPS; i++) {
        float x, y, u = (float)((i + .5) / STEPS);
        double c, p0 = 1, p1;
        one_sample_phase(forward, g, u, .37f, &x, &y);
        c = p1 = 1 - (double)x;
        for (l = 1; l <= 4; l++) {
            double p2 = ((2 * l + 1) * c * p1 - l * p0) / (l + 1);
            moment[l] += p1 / STEPS;
            p0 = p1, p1 = p2;
        }
    }
    for (l = 1; l <= 4; l++) {
        power *= g;
        check_report(fabs(moment[l] - power - shift) <= 5e-6, __FILE__, __LINE__,
                     "g %g: moment %d is %.8f, not %.8f", (double)g, l, moment[l], power);
    }
}

/* The density of a small span of x, from two samples with neighbouring u, is the density itself. */
static void check_density(float g) {
    int i;
    for (i = 1; i < 64; i++) {
        double a = (i - .25) / 64, b = (i + .25) / 64, mass, x, share, sum = 0;
        float xa, xb, ya, yb;
        int k;
        one_sample_phase(itn__vec3(0, 0, 1), g, (float)a, .1f, &xa, &ya);
        one_sample_phase(itn__vec3(0, 0, 1), g, (float)b, .1f, &xb, &yb);
        mass = b - a;
        /* integral of p 2 pi dx over the span by midpoints in log x or log (2 - x) */
        for (k = 0; k < 400; k++) {
            double t = (k + .5) / 400, la = log((double)(g > 0 ? xb : ya));
            double lb = log((double)(g > 0 ? xa : yb));
            x = exp(la + t * (lb - la));
            sum += 2 * medium_pi *
                   one_phase(g, (float)(g > 0 ? x : 2 - x), (float)(g > 0 ? 2 - x : x)).v * x *
                   fabs(lb - la) / 400;
        }
        share = sum / mass;
        if (xa - xb < 2e-3 && g < 0) continue; /* x, rounded to 1.2e-7 near 2, cannot tell */
        check_report(fabs(share - 1) <= (g < 0 ? 2e-3 : 3e-4), __FILE__, __LINE__,
                     "g %g, u %.3f: density / sampler = %.6f", (double)g, i / 64., share);
    }
}

/* Integrals over the sphere of p, of cos p = g and of dp/dg = 0, with the turn from the sampler's
   inverse, so that every step holds the same light. */
static void check_integrals(float g, double shift) {
    enum { STEPS = 1 << 17 };
    double integral = 0, score = 0, score_cosine = 0;
    double s = 1 - fabs((double)g);
    int i;
    /* x = s^2 (e^t - 1) resolves the peak; for negative g measured from the other end */
    double top = log(1 + 2 / (s * s));
    for (i = 0; i < STEPS; i++) {
        double t = (i + .5) / STEPS * top, y = s * s * (exp(t) - 1);
        double dy = s * s * exp(t) * top / STEPS, x = g >= 0 ? y : 2 - y;
        one_dual p = one_phase(g, (float)x, (float)(g >= 0 ? 2 - y : y));
        integral += 2 * medium_pi * p.v * dy, score += 2 * medium_pi * p.d[0] * dy;
        score_cosine += 2 * medium_pi * p.d[0] * (1 - x) * dy;
    }
    CHECK_NEAR(integral + shift, 1, 2e-5);
    CHECK_NEAR(score * s, 0, 2e-4);            /* E[score] = 0, in units of the peak's width */
    CHECK_NEAR(score_cosine, 1, 2e-4);         /* d/dg of E[cos] = g */
}

/* E[score] = 0 over the sampler's own values. */
static void check_score(float g) {
    enum { STEPS = 1 << 17 };
    double mean = 0, size = 0, tolerance = 2e-4;
    int i;
    for (i = 0; i < STEPS; i++) {
        float x, y;
        one_dual p;
        one_sample_phase(itn__vec3(0, 0, 1), g, (float)((i + .5) / STEPS), .1f, &x, &y);
        p = one_phase(g, x, y);
        mean += (double)p.d[0] / p.v / STEPS, size += fabs((double)p.d[0] / p.v) / STEPS;
    }
    check_report(fabs(mean) <= tolerance * (1 + size), __FILE__, __LINE__,
                 "g %g: E[score] %g of %g", (double)g, mean, size);
}

/* dp/dg against central differences of the double formula; p itself against it. */
static void check_slope(float g, double factor) {
    int i;
    for (i = 0; i <= 200; i++) {
        double x = i <= 100 ? 2 * pow(10, -8 + 7.5 * i / 100.) : 2 * i / 200., step, slope, p, unit;
        one_dual got;
        float fx = (float)x;
        if (g < 0 && 2 - x < .01) continue; /* 2 - x has no digits there */
        x = fx;
        step = 1e-5 * (1 - fabs((double)g));
        slope = (henyey_greenstein(g + step, x) - henyey_greenstein(g - step, x)) / (2 * step);
        p = henyey_greenstein(g, x);
        unit = fabs(slope) + p / (1 - fabs((double)g));
        got = one_phase(g, fx, 2 - fx);
        check_report(fabs(got.v / p - 1) <= 1e-5 && fabs(got.d[0] * factor - slope) <= 1e-5 * unit,
                     __FILE__, __LINE__, "g %g x %g: p %.8g (%.8g), dp/dg %.8g (%.8g)", (double)g,
                     x, (double)got.v, p, (double)got.d[0], slope);
    }
}

/* Extreme u and v: finite unit directions that agree with x; positive g turns forward. */
static void check_turns(float g) {
    static const float ends[6] = {5.9604645e-8f, 1.e-4f, .5f, .75f, .9999f, .99999994f};
    static const float directions[5][3] = {
        {0, 0, 1}, {0, 0, -1}, {1, 0, 0}, {.6f, -.8f, 0}, {-.26726124f, .53452248f, -.80178373f}};
    int d, i, j;
    for (d = 0; d < 5; d++)
        for (i = 0; i < 6; i++)
            for (j = 0; j < 6; j++) {
                itn_vec3 from = itn__vec3(directions[d][0], directions[d][1], directions[d][2]), to;
                one_dual p;
                double cosine;
                float x, y;
                to = one_sample_phase(from, g, ends[i], ends[j], &x, &y);
                p = one_phase(g, x, y);
                cosine = (double)from.x * to.x + (double)from.y * to.y + (double)from.z * to.z;
                check_report(itn__finite3(to) && x >= 0 && x <= 2 && p.v > 0 && itn__finite(p.v) &&
                                 itn__finite(p.d[0]) && itn__finite(p.d[0] / p.v) &&
                                 fabs(itn__length(to) - 1) < 3e-7 && fabs(cosine - (1 - x)) < 2e-5,
                             __FILE__, __LINE__, "g %g u %g v %g: direction or density is wrong",
                             (double)g, (double)ends[i], (double)ends[j]);
            }
}

/* The azimuth is uniform about any axis: the mean over v is along the old direction. */
static void check_azimuth(void) {
    int d, i;
    for (d = 0; d < 50; d++) {
        itn__rng rng = itn__rng_make(5, (uint64_t)d, 0);
        double mean[3] = {0};
        itn_vec3 from = itn__normalize(itn__vec3(itn__uniform(&rng) - .5f, itn__uniform(&rng) - .5f,
                                                 itn__uniform(&rng) - .5f));
        float x = 0, y;
        for (i = 0; i < 64; i++) {
            itn_vec3 to = one_sample_phase(from, .4f, .3f, ((float)i + .5f) / 64, &x, &y);
            mean[0] += to.x / 64, mean[1] += to.y / 64, mean[2] += to.z / 64;
        }
        CHECK(fabs(mean[0] - (1 - x) * from.x) < 1e-6 && fabs(mean[1] - (1 - x) * from.y) < 1e-6 &&
              fabs(mean[2] - (1 - x) * from.z) < 1e-6);
    }
}

static void test_phase(void) {
    int k;
    for (k = 0; k < 17; k++) {
        check_moments(all_g[k], 0);
        check_density(all_g[k]);
        check_integrals(all_g[k], 0);
        check_score(all_g[k]);
        check_slope(all_g[k], 1);
        check_turns(all_g[k]);
    }
    check_azimuth();
    CHECK(one_phase(.5f, .1f, 1.9f).v > one_phase(.5f, 1.9f, .1f).v); /* positive g is forward */
    CHECK(one_phase(-.5f, .1f, 1.9f).v < one_phase(-.5f, 1.9f, .1f).v);
    CHECK_CATCHES(check_moments(.3f, 1e-4));
    CHECK_CATCHES(check_integrals(.9f, 1e-3));
    CHECK_CATCHES(check_slope(.6f, 1.001));
    CHECK_CATCHES(check_slope(.6f, -1));
}

/* ---- von Mises and Fisher, mixtures ---------------------------------------------------------- */

typedef struct mixture {
    int shapes, lobes[ITN__LOBES]; /* 0 Henyey and Greenstein, 1 von Mises and Fisher */
    double shape[ITN__SHAPES];
} mixture;
static const mixture mixtures[] = {
    {1, {1}, {0}}, {1, {1}, {1e-4}}, {1, {1}, {.249}}, {1, {1}, {.251}}, {1, {1}, {4}},
    {1, {1}, {60}}, {1, {1}, {500}}, {3, {0, 0}, {.8, .7, -.3}}, {3, {0, 1}, {-.5, 1, 2}},
    {5, {1, 0, 1}, {20, .5, -.3, .2, 1}}, {7, {0, 1, 0, 1}, {.3, .1, 100, .2, -.8, .3, 5}},
    {5, {0, 1, 0}, {.6, .9, 3, .6, -.2}}}; /* its weights are divided by 1.5 */

/* The formulas in double. */
static double mixture_density(const mixture *m, const double *shape, double x) {
    double sum = 0, p = 0;
    for (int j = 1; j < m->shapes; j += 2) sum += shape[j];
    for (int k = 0; 2 * k < m->shapes; k++) {
        double a = shape[2 * k], whole = fmax(sum, 1);
        double w = (2 * k + 1 < m->shapes ? shape[2 * k + 1] : whole - sum) / whole;
        double q = a == 0 ? 1 / (4 * medium_pi)
                          : a * exp(-a * x) / (-2 * medium_pi * expm1(-2 * a));
        p += w * (m->lobes[k] ? q : henyey_greenstein(a, x));
    }
    return p;
}

/* Density, slopes by shapes, moments and their slopes, and draws, of one row. planted: an error of
   the density (1), of slopes (2), of moments (3), of draws (4). */
static void check_mixture(const mixture *m, int planted) {
    enum { BINS = 32, STEPS = 1 << 15, DRAWS = 1 << 17 };
    itn__medium medium = ITN_ZERO;
    itn__phase phase;
    itn__rng rng = itn__rng_make(7, (uint64_t)(m - mixtures), 0);
    double total = 0, score[ITN__SHAPES] = {0}, moment[5] = {0}, expected[BINS] = {0}, chi = 0;
    double top = log(1 + 2e3), slope[ITN__SHAPES], other[ITN__SHAPES], counts[2][BINS] = {{0}};
    double by[5][ITN__SHAPES] = {{0}}, worst = 0;
    itn__floats slopes[ITN__SHAPES];
    medium.shapes = m->shapes;
    for (int k = 0; k < ITN__LOBES; k++) medium.lobes[k] = m->lobes[k];
    memcpy(phase.shape, m->shape, sizeof phase.shape);
    itn__phase_make(&phase, &medium);
    for (int i = 0; i < STEPS; i++) { /* x = (e^t - 1) / 1000 */
        double t = (i + .5) / STEPS * top, x = 1e-3 * expm1(t), dx = 1e-3 * exp(t) * top / STEPS;
        double p1 = 1 - x, p0 = 1, area = 2 * medium_pi * dx;
        double p = (double)one_of(itn__phase_density(&phase, one_lanes((float)x),
                                                     one_lanes((float)(2 - x)), slopes));
        double truth = mixture_density(m, m->shape, x);
        if (planted == 1) p *= 1.001;
        total += p * area, expected[(int)(x * BINS / 2.000001)] += truth * area;
        if (truth > 1e-30) worst = fmax(worst, fabs(p / truth - 1)); /* e^-80 is the least */
        for (int l = 0; l < 5; l++) {
            moment[l] += p0 * p * area;
            for (int j = 0; j < m->shapes; j++)
                by[l][j] += p0 * area * (double)one_of(slopes[j]);
            double next = ((2 * l + 3) * (1 - x) * p1 - (l + 1) * p0) / (l + 2);
            p0 = p1, p1 = next;
        }
        for (int j = 0; j < m->shapes; j++) {
            double h = 1e-5 * (j % 2 == 0 && m->lobes[j / 2] ? fmax(1, m->shape[j]) : 1), unit;
            if (i % 64 || truth < 1e-30) continue;
            memcpy(other, m->shape, sizeof other), other[j] += h;
            slope[j] = mixture_density(m, other, x);
            other[j] -= 2 * h, slope[j] = (slope[j] - mixture_density(m, other, x)) / (2 * h);
            if (m->shapes > 1 && j % 2 && fabs(m->shape[j] - 1) < 1e-9) /* beyond, others shrink */
                slope[j] = (truth - mixture_density(m, other, x)) / h;
            unit = fabs(slope[j]) + truth;
            CHECK_NEAR((double)one_of(slopes[j]) * (planted == 2 ? 1.01 : 1) / unit,
                       slope[j] / unit, 1e-4);
        }
    }
    CHECK_NEAR(worst, 0, 4e-5);
    CHECK_NEAR(total, 1, 2e-5);
    for (int l = 0; l < 5; l++) {
        double a = itn__phase_moment(&phase, l, slope) * (planted == 3 ? 1.001 : 1);
        CHECK_NEAR(a, moment[l], 5e-5);
        for (int j = 0; j < m->shapes; j++) CHECK_NEAR(slope[j], by[l][j], 1e-4); /* l = 0: 0 */
    }
    if (m->shapes == 1 && m->shape[0] > .1)
        CHECK_NEAR(itn__phase_moment(&phase, 1, slope), 1 / tanh(m->shape[0]) - 1 / m->shape[0],
                   1e-12);
    for (int i = 0; i < DRAWS; i++) {
        float u = itn__uniform(&rng), v = itn__uniform(&rng);
        itn__floats xs, ys;
        itn_vec3 d = one_vector(itn__phase_turn(&phase, one_vectors(itn__vec3(0, 0, 1)),
                                                one_lanes(u), one_lanes(v), &xs, &ys));
        double x = one_of(xs), density, turn = atan2((double)d.y, (double)d.x) / (2 * medium_pi);
        if (!(fabs(x + (double)one_of(ys) - 2) < 1e-6 && fabs(1 - x - d.z) < 1e-5)) CHECK(0);
        density = (double)one_of(itn__phase_density(&phase, xs, ys, slopes));
        for (int j = 0; j < m->shapes; j++) score[j] += (double)one_of(slopes[j]) / density / DRAWS;
        if (planted == 4) x = fmin(x * 1.02, 2);
        counts[0][(int)(x * BINS / 2.000001)]++, counts[1][(int)((turn + .5) * (BINS - 1e-6))]++;
    }
    for (int k = 0, bins = 0; k < 2; k++, chi = 0, bins = 0) {
        for (int b = 0; b < BINS; b++) {
            double e = k ? (double)DRAWS / BINS : expected[b] * DRAWS;
            if (e > 5) chi += (counts[k][b] - e) * (counts[k][b] - e) / e, bins++;
        }
        check_report(chi < bins + 5 * sqrt(2. * bins), __FILE__, __LINE__,
                     "mixture %d: chi square %d is %.1f of %d", (int)(m - mixtures), k, chi, bins);
    }
    for (int j = 0; j < m->shapes; j++) CHECK_NEAR(score[j], 0, .03);
}

static void test_mixtures(void) {
    int count = (int)(sizeof mixtures / sizeof mixtures[0]);
    for (int k = 0; k < count; k++) check_mixture(&mixtures[k], 0);
    for (int planted = 1; planted <= 4; planted++)
        CHECK_CATCHES(check_mixture(&mixtures[9], planted));
}

/* A sphere in the light of a patch (map) or of a constant; boundary 1: frosted. */
static itn_scene *lobes_scene(const itn_mesh *mesh, const itn_image *map, int boundary,
                              const itn_lobe_desc *lobes, int count) {
    stage s;
    stage_begin(&s, 12, 3, 40);
    itn_medium_desc *medium = stage_medium(&s, "m", 3, .9, 0);
    medium->phase = count ? ITN_PHASE_MIX : ITN_PHASE_VMF, medium->kappa = 6;
    medium->lobe_count = count;
    for (int k = 0; k < count; k++) medium->lobes[k] = lobes[k];
    if (boundary) stage_dielectric(&s, "glass", 1.3, .2);
    stage_object(&s, mesh, "m", boundary ? "glass" : NULL);
    if (map) stage_map(&s, "light", map);
    else stage_constant(&s, "light", 1);
    return stage_make(&s);
}

/* Means over the picture of light and derivatives by m's parameters, and their variances. */
static int lobes_means(const itn_scene *scene, const float *theta, itn_mode mode, int scatter,
                       double *mean, double *variance) {
    itn_render_options options = ITN_ZERO;
    itn_image image;
    itn_error error;
    int parameters[9], count = 0, size = 12 * 12;
    options.mode = mode, options.spp = 64, options.max_scatter = scatter;
    for (int k = 0; k < itn_parameter_count(scene); k++)
        if (!strncmp(itn_parameter_get(scene, k)->name, "m.", 2)) parameters[count++] = k;
    stage_need(itn_render(scene, theta, &options, parameters, count, &image, &error), &error);
    for (int k = 0; k <= count; k++) {
        mean[k] = variance[k] = 0;
        for (int i = 0; i < size; i++) {
            mean[k] += (double)image.pixels[2 * k * size + i] / size;
            variance[k] += (double)image.pixels[(2 * k + 1) * size + i] / size / size;
        }
    }
    itn_image_free(&image);
    return count;
}

static const itn_lobe_desc two_lobes[3] = {
    {ITN_PHASE_HG, .7f, .5f}, {ITN_PHASE_VMF, 3, .3f}, {ITN_PHASE_HG, -.4f, .2f}};

/* Both walks agree in pictures and derivatives, within dielectrics (guided) and in constant light
   (control variate). planted: the reference has another shape. */
static void check_lobe_walks(int boundary, int constant, int count, float planted) {
    itn_mesh mesh = solids_sphere(1, 3);
    itn_image map = stage_patch(1, .3, .3, 20);
    itn_scene *scene = lobes_scene(&mesh, constant ? NULL : &map, boundary, two_lobes, count);
    double mean[2][10], variance[2][10];
    float theta[32];
    itn_parameter_values(scene, theta);
    lobes_means(scene, theta, ITN_MODE_FAST, 0, mean[0], variance[0]);
    theta[itn_parameter_find(scene, count ? "m.weight1" : "m.kappa")] += planted;
    int n = lobes_means(scene, theta, ITN_MODE_REFERENCE, 0, mean[1], variance[1]);
    CHECK(n == (count ? 2 * count + 1 : 3));
    for (int k = 0; k <= n; k++)
        CHECK_MEAN(mean[0][k], sqrt(variance[0][k] + variance[1][k]), mean[1][k], 4.5, INFINITY);
    itn_scene_free(scene), itn_image_free(&map), itn_mesh_free(&mesh);
}

/* Derivatives of a picture of single scattering by differences of pictures by the same paths. */
static void check_lobe_slopes(double planted) {
    itn_mesh mesh = solids_sphere(1, 3);
    itn_image map = stage_patch(1, .3, .3, 20);
    for (int count = 0; count <= 3; count += 3) {
        itn_scene *scene = lobes_scene(&mesh, &map, 0, two_lobes, count);
        double mean[3][10], variance[3][10];
        float theta[32];
        itn_parameter_values(scene, theta);
        int n = lobes_means(scene, theta, ITN_MODE_REFERENCE, 1, mean[0], variance[0]);
        for (int k = 3; k <= n; k++) { /* shapes: behind sigma_t and albedo */
            float *value = &theta[itn_parameter_find(scene, "m.albedo") + k - 2], own = *value;
            float step = itn_parameter_get(scene, (int)(value - theta))->upper > 1 ? .3f : .05f;
            *value = own + step, lobes_means(scene, theta, ITN_MODE_REFERENCE, 1, mean[1],
                                             variance[1]);
            *value = own - step, lobes_means(scene, theta, ITN_MODE_REFERENCE, 1, mean[2],
                                             variance[2]);
            *value = own;
            CHECK_NEAR((mean[1][0] - mean[2][0]) / (2 * step), mean[0][k] * (1 + planted),
                       .03 * fabs(mean[0][k]) + 3 * sqrt(variance[0][k]));
        }
        itn_scene_free(scene);
    }
    itn_image_free(&map), itn_mesh_free(&mesh);
}

static void test_lobe_pictures(void) {
    for (int k = 0; k < 8; k++) check_lobe_walks(k & 1, k & 2, k & 4 ? 3 : 0, 0);
    check_lobe_slopes(0);
    CHECK_CATCHES(check_lobe_walks(0, 0, 3, .2f));
    CHECK_CATCHES(check_lobe_slopes(.5));
}

/* 1 - cos keeps its digits for small angles. */
static void test_small_angles(void) {
    int k;
    for (k = 1; k < 12; k++) {
        double angle = pow(2, -k);
        itn_vec3 a = itn__vec3(0, 0, 1), b = itn__vec3((float)sin(angle), 0, (float)cos(angle));
        double x = 2 * pow(sin(angle / 2), 2);
        CHECK_NEAR(one_minus_cosine(a, b) / x, 1, 4e-6);
    }
    CHECK(one_minus_cosine(itn__vec3(1, 0, 0), itn__vec3(-1, 0, 0)) == 2);
    CHECK(one_minus_cosine(itn__vec3(1, 0, 0), itn__vec3(1, 0, 0)) == 0);
}

/* ---- free flight ----------------------------------------------------------------------------- */

static void test_flight(void) {
    static const float sigma[5] = {1e-6f, .1f, 1, 30, 1e6f};
    int k, i;
    for (k = 0; k < 5; k++) {
        enum { STEPS = 1 << 18 };
        double mean = 0, square = 0;
        for (i = 0; i < STEPS; i++) {
            double t = one_flight(sigma[k], (float)((i + .5) / STEPS));
            mean += t / STEPS, square += t * t / STEPS;
        }
        CHECK_NEAR(mean * sigma[k], 1, 1e-5);                      /* mean 1 / sigma_t */
        CHECK_NEAR(square * sigma[k] * sigma[k], 2, 1e-4);
        CHECK(itn__finite(one_flight(sigma[k], 5.9604645e-8f)));
        CHECK(one_flight(sigma[k], .99999994f) > 0);
        for (i = 0; i < 20; i++) { /* exp(-sigma t) and its slope -t exp(-sigma t) */
            float t = (float)(.25 * i / sigma[k]);
            one_dual f = one_transmittance(sigma[k], t);
            double expected = exp(-(double)sigma[k] * t);
            CHECK_NEAR(f.v / expected, 1, 2e-6);
            CHECK_NEAR(f.d[0], -(double)t * expected, 2e-6 * t * expected + 1e-30);
        }
        /* sigma T drawn by itself: the median flight is ln 2 / sigma */
        CHECK_NEAR(one_flight(sigma[k], .5f) * sigma[k], log(2.), 1e-6);
    }
    CHECK(one_transmittance(0, 5).v == 1 && one_transmittance(0, 5).d[0] == -5);
}

/* Direct transmission through thick media: of all random bits those whose flights get through, as
   the reference draws them and in lanes, where Sobol numbers go the same way. */
static void check_tail(double tau, double tolerance, double planted) {
    enum { WORDS = 1 << 14 }; /* all others' flights are shorter than 12 */
    double expected = exp(-tau) * 4294967296. * (1 + planted);
    int scalar = 0, lanes = 0;
    uint32_t bits;
    for (bits = 0; bits < WORDS; bits++) {
        itn__floats u = itn__unit_floats(itn__splat_word(bits));
        scalar += one_flight(1, itn__unit_float(bits)) > tau;
        lanes += one_flight(1, ITN__LANE(u, 0)) > tau;
    }
    CHECK_NEAR(scalar / expected, 1, tolerance);
    CHECK_NEAR(lanes / expected, 1, tolerance);
    CHECK(one_flight(1, itn__unit_float(WORDS)) < 13);
}

static void test_tails(void) {
    check_tail(13, 1e-4, 0), check_tail(15, 1e-3, 0), check_tail(16.7, .005, 0);
    check_tail(18, .01, 0), check_tail(20, .1, 0);
    CHECK_CATCHES(check_tail(15, 1e-3, .17));
}

/* ---- random numbers -------------------------------------------------------------------------- */

typedef uint32_t (*generator)(uint32_t i, uint32_t axis);

/* Bits as a function of one coordinate, all others fixed. */
static uint32_t good_bits(uint32_t i, uint32_t axis) {
    itn__rng rng = itn__rng_make(axis == 0 ? i : 7, axis == 1 ? i : 11, axis == 2 ? i : 13);
    rng.dimension = axis == 3 ? i : 2;
    return itn__rng_bits(&rng);
}
/* A counter that is barely mixed, as the planted error. */
static uint32_t bad_bits(uint32_t i, uint32_t axis) { return i * 0x9e3779b9u + axis; }

/* Equidistribution of 2^20 numbers in 4096 boxes, serial pairs in 64 x 64, single bits, pairs of
   neighbours: all by chi square, which has mean n and variance 2 n. */
static void check_stream(generator bits, uint32_t axis) {
    enum { COUNT = 1 << 20, BOXES = 4096 };
    static int box[BOXES], pair[BOXES], low[BOXES];
    double chi[3] = {0}, mean = 0, product = 0, each = (double)COUNT / BOXES;
    int ones[32] = {0}, flips[32] = {0}, b, k;
    uint32_t i, previous = bits(COUNT, axis);
    memset(box, 0, sizeof box), memset(pair, 0, sizeof pair), memset(low, 0, sizeof low);
    for (i = 0; i < COUNT; i++) {
        uint32_t x = bits(i, axis);
        double u = x / 4294967296. - .5, v = previous / 4294967296. - .5;
        box[x >> 20]++, pair[(x >> 26) << 6 | previous >> 26]++, low[x & 4095]++;
        for (b = 0; b < 32; b++) ones[b] += x >> b & 1, flips[b] += (x ^ previous) >> b & 1;
        mean += u / COUNT, product += u * v / COUNT;
        previous = x;
    }
    for (k = 0; k < BOXES; k++) {
        chi[0] += (box[k] - each) * (box[k] - each) / each;
        chi[1] += (pair[k] - each) * (pair[k] - each) / each;
        chi[2] += (low[k] - each) * (low[k] - each) / each;
    }
    for (k = 0; k < 3; k++)
        check_report(fabs(chi[k] - BOXES) < 5 * sqrt(2. * BOXES), __FILE__, __LINE__,
                     "axis %d: chi square %d is %.0f for %d", (int)axis, k, chi[k], BOXES);
    CHECK(fabs(mean) < 5 / sqrt(12. * COUNT));
    CHECK(fabs(product) < 5 / 12. / sqrt((double)COUNT));
    for (b = 0; b < 32; b++) {
        check_report(fabs(ones[b] - .5 * COUNT) < 5 * .5 * sqrt((double)COUNT), __FILE__, __LINE__,
                     "axis %d: bit %d is set %d times", (int)axis, b, ones[b]);
        check_report(fabs(flips[b] - .5 * COUNT) < 5 * .5 * sqrt((double)COUNT), __FILE__, __LINE__,
                     "axis %d: bit %d flips %d times", (int)axis, b, flips[b]);
    }
}

/* Flipping any bit of seed, pixel or sample flips each bit of a number half of the time. */
static void check_avalanche(void) {
    enum { TRIALS = 400 };
    int input, which, output;
    for (which = 0; which < 3; which++)
        for (input = 0; input < 64; input++) {
            int flips[32] = {0}, total = 0, k;
            for (k = 0; k < TRIALS; k++) {
                uint64_t a[3], difference;
                itn__rng first, second;
                uint32_t bits;
                a[0] = itn__mix64((uint64_t)k), a[1] = itn__mix64(a[0]), a[2] = itn__mix64(a[1]);
                first = itn__rng_make(a[0], a[1], a[2]);
                difference = 1ull << input, a[which] ^= difference;
                second = itn__rng_make(a[0], a[1], a[2]);
                bits = itn__rng_bits(&first) ^ itn__rng_bits(&second);
                for (output = 0; output < 32; output++) flips[output] += bits >> output & 1;
            }
            for (output = 0; output < 32; output++) {
                total += flips[output];
                CHECK(abs(flips[output] - TRIALS / 2) < 6 * sqrt(TRIALS / 4.));
            }
            CHECK(abs(total - 16 * TRIALS) < 6 * sqrt(8. * TRIALS));
        }
}

static int compare64(const void *a, const void *b) {
    uint64_t x = *(const uint64_t *)a, y = *(const uint64_t *)b;
    return x < y ? -1 : x > y;
}

/* No two of a million paths share a run of numbers in their first draws: two draws of 32 bits make
   64, of which 4 million have a chance of 4e-7 to collide. */
static void check_overlap(int pixels, int samples, uint64_t mask) {
    enum { DRAWS = 4 };
    size_t count = (size_t)pixels * (size_t)samples * DRAWS, n = 0, i, same = 0;
    uint64_t *runs = (uint64_t *)malloc(count * sizeof *runs);
    int p, s, d;
    if (!runs) exit(1);
    for (p = 0; p < pixels; p++)
        for (s = 0; s < samples; s++) {
            itn__rng rng = itn__rng_make(3, (uint64_t)p, (uint64_t)s & mask);
            uint32_t last = itn__rng_bits(&rng);
            for (d = 0; d < DRAWS; d++) {
                uint32_t next = itn__rng_bits(&rng);
                runs[n++] = (uint64_t)last << 32 | next;
                last = next;
            }
        }
    qsort(runs, count, sizeof *runs, compare64);
    for (i = 1; i < count; i++) same += runs[i] == runs[i - 1];
    CHECK(same == 0);
    free(runs);
}

/* Correlation of the numbers of neighbouring paths in every pair of dimensions, as a pixel would
   feel it. */
static void check_dimensions(void) {
    enum { DIMENSIONS = 12, PATHS = 200000 };
    static double sum[DIMENSIONS][DIMENSIONS], next[DIMENSIONS][DIMENSIONS];
    double before[DIMENSIONS] = {0};
    int p, i, j;
    for (p = 0; p < PATHS; p++) {
        itn__rng rng = itn__rng_make(0, (uint64_t)(p / 64), (uint64_t)(p % 64));
        double u[DIMENSIONS];
        for (i = 0; i < DIMENSIONS; i++) u[i] = itn__uniform(&rng) - .5;
        for (i = 0; i < DIMENSIONS; i++)
            for (j = 0; j < DIMENSIONS; j++)
                sum[i][j] += u[i] * u[j], next[i][j] += u[i] * before[j];
        memcpy(before, u, sizeof u);
    }
    for (i = 0; i < DIMENSIONS; i++)
        for (j = 0; j < DIMENSIONS; j++) {
            double limit = 5 / 12. * sqrt((double)PATHS);
            if (i != j) CHECK(fabs(sum[i][j]) < limit);
            CHECK(fabs(next[i][j]) < limit);
        }
}

static void test_random_numbers(void) {
    itn__rng a = itn__rng_make(1, 2, 3), b = itn__rng_make(1, 2, 3);
    uint32_t axis;
    int i;
    for (i = 0; i < 100; i++) CHECK(itn__rng_bits(&a) == itn__rng_bits(&b));
    for (i = 0; i < 1000000; i++) {
        float u = itn__uniform(&a);
        if (!(u > 0 && u < 1)) CHECK(0);
    }
    for (axis = 0; axis < 4; axis++) check_stream(good_bits, axis);
    check_avalanche();
    check_dimensions();
    check_overlap(1024, 1024, ~0ull);
    check_overlap(1 << 20, 1, ~0ull);
    CHECK_CATCHES(check_stream(bad_bits, 3));
    CHECK_CATCHES(check_overlap(64, 64, 62));
}

int main(void) {
    test_phase();
    test_mixtures();
    test_lobe_pictures();
    test_small_angles();
    test_flight();
    test_tails();
    test_random_numbers();
    return check_end("medium");
}
