/* Boundaries: Fresnel's equations, the rough dielectric against formulas and quadratures of its own
   in double, its sampler, energy, reciprocity, and what happens at the ends of all ranges. */
#define ITN_IMPLEMENTATION
#include "../itn.h"
#include "check.h"
#include "one.h"
#include "solids.h"

static const double surface_pi = 3.14159265358979323846;

/* ---- the same physics in double, without duals ----------------------------------------------- */

typedef struct real3 {
    double x, y, z;
} real3;

static real3 real(double x, double y, double z) {
    real3 v;
    v.x = x, v.y = y, v.z = z;
    return v;
}
static double real_dot(real3 a, real3 b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
static real3 real_along(real3 a, double s, real3 b) {
    return real(a.x + s * b.x, a.y + s * b.y, a.z + s * b.z);
}

/* Through the angles: sines and tangents of their sum and difference. */
static double fresnel(double cos_i, double eta) {
    double i = acos(cos_i), sine = sin(i) / eta, t;
    if (sine >= 1) return 1;
    t = asin(sine);
    if (i < 1e-4) return pow((eta - 1) / (eta + 1), 2);
    return .5 * (pow(sin(i - t) / sin(i + t), 2) + pow(tan(i - t) / tan(i + t), 2));
}

/* G1 by the angle. */
static double smith(double cos_w, double alpha) {
    double a = 1 / (alpha * tan(acos(fabs(cos_w))));
    if (one_distribution == ITN_BECKMANN)
        return a < 1.6 ? (3.535 * a + 2.181 * a * a) / (1 + 2.276 * a + 2.577 * a * a) : 1;
    return 2 / (1 + sqrt(1 + alpha * alpha * (1 / (cos_w * cos_w) - 1)));
}

/* f cos theta_o, Walter et al. 2007, equations 20, 21 and 33, indices 1 and eta. */
static double rough(real3 i, real3 o, double alpha, double eta) {
    real3 h = o.z > 0 ? real_along(i, 1, o) : real_along(i, eta, o);
    double length = sqrt(real_dot(h, h)) * (h.z < 0 ? -1 : 1), d, g, im, om, f;
    h = real(h.x / length, h.y / length, h.z / length);
    im = real_dot(i, h), om = real_dot(o, h);
    if (im <= 0 || om * o.z <= 0) return 0;
    d = alpha * alpha / (surface_pi * pow(h.z * h.z * (alpha * alpha + 1 / (h.z * h.z) - 1), 2));
    if (one_distribution == ITN_BECKMANN)
        d = exp((1 - 1 / (h.z * h.z)) / (alpha * alpha)) / (surface_pi * pow(alpha * h.z * h.z, 2));
    g = smith(i.z, alpha) * smith(o.z, alpha), f = fresnel(im, eta);
    if (o.z > 0) return f * d * g / (4 * i.z);
    return (1 - f) * d * g * im * fabs(om) * eta * eta / (i.z * pow(im + eta * om, 2));
}

/* Share of light that a rough face sends on (up, down), for light at cosine mu, as an integral over
   facets: D(m) cos(theta_m) is uniform in u for tan^2(theta_m) = alpha^2 u / (1 - u), of
   Beckmann's for -alpha^2 ln(1 - u), and what a facet sends on is G1(i) (i.m) / (cos i cos m) times F or 1 - F and G1(o). metal: F = 1. */
static double face_albedo(double mu, double alpha, double eta, int metal, int up, int down) {
    enum { STEPS = 700, TURNS = 300 };
    double sum = 0;
    int a, b;
    real3 i = real(sqrt(1 - mu * mu), 0, mu);
    for (a = 0; a < STEPS; a++) {
        /* steps of 1 - u = (1 - s)^2 resolve the steep facets */
        double s = (a + .5) / STEPS, rest = (1 - s) * (1 - s), weight = 2 * (1 - s);
        double slope2 = one_distribution == ITN_BECKMANN ? -log(rest) : (1 - rest) / rest;
        double tangent = alpha * sqrt(slope2), cos_m = 1 / sqrt(1 + tangent * tangent);
        for (b = 0; b < TURNS; b++) {
            double phi = surface_pi * (b + .5) / TURNS,
                   share; /* the other half is its mirror image */
            real3 m = real(tangent * cos_m * cos(phi), tangent * cos_m * sin(phi), cos_m), o;
            double im = real_dot(i, m), f = metal ? 1 : im > 0 ? fresnel(im, eta) : 0;
            if (im <= 0) continue;
            share = weight * smith(mu, alpha) * im / (mu * cos_m) / ((double)STEPS * TURNS);
            o = real_along(real(-i.x, -i.y, -i.z), 2 * im, m);
            if (up && o.z > 0) sum += share * f * smith(o.z, alpha);
            if (down && f < 1) {
                double cos_t = sqrt(1 - (1 - im * im) / (eta * eta));
                o = real_along(real(-i.x / eta, -i.y / eta, -i.z / eta), im / eta - cos_t, m);
                if (o.z < 0) sum += share * (1 - f) * smith(o.z, alpha);
            }
        }
    }
    return sum;
}

/* ---- Fresnel --------------------------------------------------------------------------------- */

static one_dual fresnel_at(double cos_i, double eta, double *cos_t) {
    float c;
    one_dual f = one_fresnel((float)cos_i, (float)eta, &c);
    *cos_t = c;
    return f;
}

static void check_fresnel(double cos_i, double eta, double factor) {
    const double h = 1e-6;
    double cos_t, by_cos, by_eta, c = (float)cos_i, e = (float)eta;
    one_dual f = fresnel_at(cos_i, eta, &cos_t);
    if (fresnel(c - 2 * h, e) == 1) { /* total reflection, or too near to it for differences */
        if (fresnel(c, e) == 1) CHECK(f.v == 1 && f.d[0] == 0 && f.d[1] == 0 && cos_t == 0);
        return;
    }
    by_cos = (fresnel(c + h, e) - fresnel(c - h, e)) / (2 * h);
    by_eta = (fresnel(c, e + h) - fresnel(c, e - h)) / (2 * h);
    CHECK_NEAR(f.v, fresnel(c, e), 3e-6);
    CHECK_NEAR(f.d[0], by_cos * factor, 1e-3 * fabs(by_cos) + 1e-5);
    CHECK_NEAR(f.d[1], by_eta, 1e-3 * fabs(by_eta) + 1e-5);
    CHECK_NEAR(cos_t, sqrt(1 - (1 - c * c) / (e * e)), 2e-5);
}

/* 2 int F mu dmu: light from all sides. */
static void check_diffuse_fresnel(double eta, double expected) {
    enum { STEPS = 200000 };
    double sum = 0, cos_t;
    int k;
    for (k = 0; k < STEPS; k++) {
        double mu = (k + .5) / STEPS;
        sum += 2 * mu * fresnel_at(mu, eta, &cos_t).v / STEPS;
    }
    CHECK_NEAR(sum, expected, 2e-6);
}

static void test_fresnel(void) {
    static const double eta[6] = {1.5, 1 / 1.5, 1.33, 1 / 1.33, 4, 1.001};
    const double critical = sqrt(1 - 1 / 2.25);
    double cos_t;
    int e, k;
    CHECK_NEAR(fresnel_at(.5, 1.5, &cos_t).v, .0891867128, 1e-7);
    CHECK_NEAR(fresnel_at(.2, 1.5, &cos_t).v, .338894, 1e-6);
    CHECK_NEAR(fresnel_at(.8, 1 / 1.5, &cos_t).v, .1141411, 1e-6);
    CHECK_NEAR(fresnel_at(1, 1.5, &cos_t).v, .04, 1e-8);
    CHECK_NEAR(critical, .7453560, 1e-7);
    CHECK(fresnel_at(critical - 1e-5, 1 / 1.5, &cos_t).v == 1);
    CHECK(fresnel_at(critical + 1e-5, 1 / 1.5, &cos_t).v < 1);
    CHECK(fresnel_at(1e-6, 1.5, &cos_t).v > .9999);
    CHECK(fresnel_at(.3, 1, &cos_t).v < 1e-12);
    check_diffuse_fresnel(1.33, .065931);
    check_diffuse_fresnel(1.4, .076812);
    check_diffuse_fresnel(1.5, .091778);
    check_diffuse_fresnel(1 / 1.33, .471949);
    check_diffuse_fresnel(1 / 1.4, .528985);
    check_diffuse_fresnel(1 / 1.5, .596346);
    for (e = 0; e < 6; e++)
        for (k = 1; k < 50; k++) check_fresnel(k / 50., eta[e], 1);
    CHECK_CATCHES(check_diffuse_fresnel(1.5, .091798));
    CHECK_CATCHES(check_fresnel(.3, 1.5, -1));
}

static int draw(itn_vec3 i, float alpha, float eta, const float u[3], itn_vec3 *o) {
    return one_sample_dielectric(i, one_sample_facet(i, alpha, u[0], u[1]), eta, u[2], o);
}

/* ---- the smooth face ------------------------------------------------------------------------- */

static void test_smooth(void) {
    static const float cosines[4] = {1, .8f, .5f, .05f}, etas[3] = {1.5f, 1 / 1.5f, 1.33f};
    int c, e, k;
    for (c = 0; c < 4; c++)
        for (e = 0; e < 3; e++) {
            float sine = sqrtf(itn__max(0, 1 - cosines[c] * cosines[c])), eta = etas[e];
            itn_vec3 i = itn__vec3(.6f * sine, -.8f * sine, cosines[c]), o;
            double share = 0;
            for (k = 0; k < 1000; k++) {
                float u[3];
                u[0] = .3f, u[1] = .9f, u[2] = ((float)k + .5f) / 1000;
                CHECK(draw(i, 0, eta, u, &o));
                CHECK_NEAR(itn__length(o), 1, 3e-7);
                if (o.z > 0) { /* mirrored */
                    share += 1e-3;
                    CHECK(fabs(o.x + i.x) + fabs(o.y + i.y) + fabs(o.z - i.z) < 1e-6);
                } else { /* Snell: sin i = eta sin t, in the same plane */
                    CHECK(fabs(eta * o.x + i.x) + fabs(eta * o.y + i.y) < 2e-6);
                }
            }
            CHECK_NEAR(share, fresnel(cosines[c], eta), 1e-3);
        }
}

/* ---- the rough face -------------------------------------------------------------------------- */

/* f and its derivatives against the double formula at o's drawn by the sampler; f / pdf = G1(o). */
static void check_rough(float alpha, float eta, float mu, double factor) {
    itn_vec3 i = itn__vec3(sqrtf(itn__max(0, 1 - mu * mu)), 0, mu), o;
    itn__rng rng = itn__rng_make(1, (uint64_t)(alpha * 1000), (uint64_t)(eta * 1000));
    int k, good = 0;
    for (k = 0; k < 400; k++) {
        float u[3], pdf;
        double f, by_alpha, by_eta, h = 1e-5, unit;
        one_dual got;
        real3 ri, ro;
        u[0] = itn__uniform(&rng), u[1] = itn__uniform(&rng), u[2] = itn__uniform(&rng);
        if (!draw(i, alpha, eta, u, &o)) continue;
        if (fabs(o.z) < .02) continue; /* G1 by the angle has few digits there */
        got = one_rough(i, o, NULL, alpha, eta, &pdf);
        ri = real(i.x, i.y, i.z), ro = real(o.x, o.y, o.z);
        f = rough(ri, ro, alpha, eta), unit = f / alpha / alpha;
        if (f < 1e-20) continue; /* of Beckmann's, where floats end */
        by_alpha = (rough(ri, ro, alpha + h * alpha, eta) - rough(ri, ro, alpha - h * alpha, eta)) /
                   (2 * h * alpha);
        h *= alpha * fabs(eta - 1);
        by_eta = (rough(ri, ro, alpha, eta + h) - rough(ri, ro, alpha, eta - h)) / (2 * h);
        good += got.v > 0;
        /* a float's direction is good to 1e-7, the facet to 1e-7 over its distance from o */
        check_report(fabs(got.v / f - 1) < 2e-6 / (alpha * fabs(eta - 1)) + 2e-4, __FILE__,
                     __LINE__, "alpha %g eta %g: f %.8g, not %.8g", (double)alpha, (double)eta,
                     (double)got.v, f);
        check_report(fabs(got.d[0] * factor - by_alpha) < 1e-3 * fabs(by_alpha) + 5e-4 * f / alpha,
                     __FILE__, __LINE__, "alpha %g eta %g: df/dalpha %.8g, not %.8g", (double)alpha,
                     (double)eta, (double)got.d[0], by_alpha);
        if (fresnel(.5, eta) < 1 || o.z < 0)
            check_report(fabs(got.d[1] - by_eta) < 3e-3 * fabs(by_eta) + 5e-4 * unit, __FILE__,
                         __LINE__, "alpha %g eta %g o.z %g: df/deta %.8g, not %.8g", (double)alpha,
                         (double)eta, (double)o.z, (double)got.d[1], by_eta);
        if (one_distribution == ITN_GGX) CHECK_NEAR(got.v / pdf, smith(o.z, alpha), 1e-4);
        else CHECK(got.v / pdf < 2);
    }
    CHECK(good > 100);
}

/* A share of the light and its slopes by alpha and the index; error: standard errors of the slopes,
   as if draws were random. */
typedef struct share {
    double value, slope[2], error[2];
} share;
enum { UP, DOWN, ALL };

/* Shares as the walk finds them: f / pdf and df / pdf over the sampler's draws, one in each lane.
   told: itn__rough is told the facet that was drawn, as by the walk. */
static void told_albedo(int told, double mu, double alpha, double eta, share shares[3]) {
    enum { STEPS = 3 << 19 };
    static const uint32_t steps[3] = {2360945575u, 3518319155u, 2882110345u}; /* a lattice of three
                                                              irrational steps (Roberts 2018) */
    itn__vectors i = itn__vectors_of(itn__splat((float)sqrt(1 - mu * mu)), itn__splat(0),
                                     itn__splat((float)mu)), m, o;
    itn__floats a = itn__splat((float)alpha), e = itn__splat((float)eta), u[3], pdf;
    uint32_t k;
    int l, n;
    memset(shares, 0, 3 * sizeof *shares);
    for (k = 0; k < STEPS; k += ITN__LANES) {
        itn__num by[2], x = itn__variable(a), y = itn__constant(e);
        itn__ints good;
        for (l = 0; l < ITN__LANES; l++)
            for (n = 0; n < 3; n++)
                ITN__LANE(u[n], l) = (float)((((k + (uint32_t)l) * steps[n]) >> 8) + .5) /
                                     16777216.f;
        m = itn__sample_facet(&i, a, u[0], u[1]);
        good = itn__sample_dielectric(&i, &m, e, u[2], &o);
        itn__nvectors from = one_still(i), to = one_still(o);
        by[0] = itn__rough(one_distribution, &from, &to, told ? &m : NULL, &x, &y,
                           &pdf);
        x = itn__constant(a), y = itn__variable(e);
        by[1] = itn__rough(one_distribution, &from, &to, told ? &m : NULL, &x, &y,
                           &pdf);
        for (l = 0; l < ITN__LANES; l++) {
            share *to = &shares[ITN__LANE(o.z, l) > 0 ? UP : DOWN];
            double f = ITN__LANE(by[0].v, l), p = ITN__LANE(pdf, l), d;
            if (!ITN__LANE(good, l) || !(f > 0)) continue;
            to->value += f / p / STEPS;
            for (n = 0; n < 2; n++) {
                d = ITN__LANE(by[n].d, l) / p;
                to->slope[n] += d / STEPS, to->error[n] += d * d;
            }
        }
    }
    shares[ALL].value = shares[UP].value + shares[DOWN].value;
    for (n = 0; n < 2; n++) {
        shares[ALL].slope[n] = shares[UP].slope[n] + shares[DOWN].slope[n];
        shares[ALL].error[n] = shares[UP].error[n] + shares[DOWN].error[n];
        for (l = 0; l < 3; l++) shares[l].error[n] = sqrt(shares[l].error[n]) / STEPS;
    }
}

/* The slope of face_albedo by alpha or the index, by central differences. */
static double face_slope(double mu, double alpha, double eta, int metal, int down, int by_eta) {
    double h = .015 * (by_eta ? 1 : alpha), a = by_eta ? 0 : h, e = by_eta ? h : 0;
    return (face_albedo(mu, alpha + a, eta + e, metal, 1, down) -
            face_albedo(mu, alpha - a, eta - e, metal, 1, down)) / (2 * h);
}

static void check_albedo(double alpha, double mu, const double table[3], double factor) {
    const double ends[2] = {1.5, 1 / 1.5};
    share shares[3];
    double slope;
    int e, down;
    told_albedo(1, mu, alpha, 1e6, shares); /* F = 1 */
    slope = face_slope(mu, alpha, 1, 1, 0, 0);
    CHECK_NEAR(shares[UP].value, table[0], .0015 * table[0]);
    CHECK_NEAR(shares[UP].slope[0] * factor, slope, .01 * fabs(slope) + 4 * shares[UP].error[0]);
    for (e = 0; e < 2; e++) {
        told_albedo(1, mu, alpha, ends[e], shares);
        CHECK_NEAR(shares[UP].value, face_albedo(mu, alpha, ends[e], 0, 1, 0), .001);
        CHECK_NEAR(shares[ALL].value, table[1 + e], .002 * table[1 + e]);
        for (down = 0; down < 2; down++) { /* reflected alone, then all */
            const share *got = &shares[down ? ALL : UP];
            slope = face_slope(mu, alpha, ends[e], 0, down, 0);
            CHECK_NEAR(got->slope[0], slope, .01 * fabs(slope) + 5 * got->error[0]);
            CHECK(got->error[0] < .015 && got->error[1] < .02);
            /* What is transmitted has an edge, o_z = -i_z / eta, where the facet stands upright and
               GGX does not vanish. It moves with eta, and the detached derivative does not see
               that, so transmission is exact only straight down and for small alpha. */
            if (down && mu < 1 && alpha > .15) continue;
            slope = face_slope(mu, alpha, ends[e], 0, down, 1);
            CHECK_NEAR(got->slope[1], slope, .01 * fabs(slope) + 4 * got->error[1]);
        }
    }
}

/* From within a black layer, obliquely through its rough face, light 1 from everywhere: the share
   that the face sends on, and its slopes, that by the index with the part that the moving edge of
   transmission has, which the detached derivatives of check_albedo miss. planted: a relative error
   in the slope by the index. */
static void test_edge(double mu, double alpha, double planted) {
    const double sigma_t = 100, depth = .002, ior = 1.5, h = .015;
    static const char *const names[2] = {"s.ior", "s.alpha"};
    itn_mesh mesh = solids_slab(1, 100);
    itn_light_desc light = ITN_ZERO;
    itn_render_options options = ITN_ZERO;
    solids_desc desc = ITN_ZERO;
    solids_mean found[3];
    double passed = exp(-sigma_t * (double)(float)depth / mu), truth[3];
    itn_scene *scene;
    light.radiance[0] = 1;
    desc.mesh = &mesh, desc.light = &light, desc.sigma_t = sigma_t;
    desc.ior = ior, desc.alpha = alpha, desc.eye = solids_vec3(0, -depth, 0);
    desc.distribution = one_distribution;
    desc.target = solids_vec3(sqrt(1 - mu * mu), mu - depth, 0);
    scene = solids_scene(&desc);
    options.spp = 10000, options.mode = ITN_MODE_REFERENCE;
    solids_measure(scene, NULL, &options, names, 2, found);
    truth[0] = passed * face_albedo(mu, alpha, 1 / ior, 0, 0, 1);
    truth[1] = passed * (face_albedo(mu, alpha, 1 / (ior + h), 0, 0, 1) -
                         face_albedo(mu, alpha, 1 / (ior - h), 0, 0, 1)) / (2 * h);
    truth[2] = passed * (face_albedo(mu, alpha + h, 1 / ior, 0, 0, 1) -
                         face_albedo(mu, alpha - h, 1 / ior, 0, 0, 1)) / (2 * h);
    if (getenv("SHOW"))
        printf("edge %g %g: %.5f +- %.5f, %.5f; by ior %.4f +- %.4f, %.4f; by alpha %.4f +- %.4f, "
               "%.4f\n", mu, alpha, found[0].value, found[0].error, truth[0], found[1].value,
               found[1].error, truth[1], found[2].value, found[2].error, truth[2]);
    CHECK_MEAN(found[0].value, found[0].error, truth[0], 4, .01 * truth[0]);
    CHECK_MEAN(found[1].value, found[1].error, truth[1] * (1 + planted), 4, .02 * fabs(truth[1]));
    CHECK_MEAN(found[2].value, found[2].error, truth[2], 4, .02 * fabs(truth[2]));
    itn_scene_free(scene);
    itn_mesh_free(&mesh);
}

/* Directional albedo, separable Smith: of a mirror with F = 1, and of a face of index 1.5 (all
   light sent on) from outside and inside; quadrature good to 1e-4. At alpha 1, seen straight down,
   the mirror's is 1 - ln 2 and its slope -1/2. */
static void test_albedo(void) {
    static const double rows[8][5] = {
        {.1, 1, .9883, .9989, .9890},  {.1, .5, .9691, .9922, .9633}, {.3, 1, .8774, .9884, .8995},
        {.3, .5, .8181, .9469, .7802}, {.5, 1, .6878, .9681, .7539},  {.5, .5, .6860, .8826, .6427},
        {1, 1, .306853, .8933, .4171}, {1, .5, .4091, .6723, .4534}};
    int k;
    for (k = 0; k < 8; k++) {
        double metal = face_albedo(rows[k][1], rows[k][0], 1.5, 1, 1, 0);
        CHECK_NEAR(metal, rows[k][2], 2e-4); /* the quadrature itself */
        check_albedo(rows[k][0], rows[k][1], rows[k] + 2, 1);
    }
    CHECK_NEAR(face_slope(1, 1, 1, 1, 0, 0), -.5, 1e-3);
    CHECK_CATCHES(check_albedo(.3, 1, rows[3] + 2, 1));
    CHECK_CATCHES(check_albedo(.5, .5, rows[5] + 2, 1.03));
}

/* How many draws fall in each of 2 x 6 x 8 boxes of the sphere against the integral of the pdf;
   boxes are of equal size in s = +-sqrt(1 - |z|), small around the poles. */
static void check_histogram(float alpha, float eta, float mu, double factor) {
    enum { DRAWS = 400000, COSINES = 12, TURNS = 8, FINE = 48 };
    itn_vec3 i = itn__vec3(sqrtf(itn__max(0, 1 - mu * mu)), 0, mu), o;
    itn__rng rng = itn__rng_make(2, (uint64_t)(alpha * 1000), (uint64_t)(eta * 1000 + mu * 100));
    itn__vectors from = itn__vectors_of(itn__splat(i.x), itn__splat(i.y), itn__splat(i.z));
    itn__num a_alpha = itn__constant(itn__splat(alpha)), an_eta = itn__constant(itn__splat(eta));
    itn__floats pdf = itn__splat(0);
    int counts[COSINES][TURNS], k, c, t, a, b, l, drawn = 0;
    double total = 0;
    memset(counts, 0, sizeof counts);
    for (k = 0; k < DRAWS; k++) {
        float u[3];
        double turn;
        u[0] = itn__uniform(&rng), u[1] = itn__uniform(&rng), u[2] = itn__uniform(&rng);
        if (!draw(i, alpha, eta, u, &o)) continue;
        turn = (atan2(o.y, o.x) / (2 * surface_pi) + .5) * TURNS;
        turn = turn < TURNS ? turn : 0;
        c = (int)((sqrt(1 - fabs(o.z)) * (o.z > 0 ? 1 : -1) * .5 + .5) * COSINES), t = (int)turn;
        counts[c < COSINES ? c : COSINES - 1][t]++, drawn++;
    }
    for (c = 0; c < COSINES; c++)
        for (t = 0; t < TURNS; t++) {
            double expected = 0, sigma;
            for (a = 0; a < FINE; a++) {
                double s = 2 * (c + (a + .5) / FINE) / COSINES - 1;
                double z = s > 0 ? 1 - s * s : s * s - 1, r = sqrt(1 - z * z);
                for (b = 0; b < FINE; b += ITN__LANES) {
                    itn__vectors to = itn__vectors_of(pdf, pdf, itn__splat((float)z));
                    for (l = 0; l < ITN__LANES; l++) {
                        double phi = 2 * surface_pi * ((t + (b + l + .5) / FINE) / TURNS - .5);
                        ITN__LANE(to.x, l) = (float)(r * cos(phi));
                        ITN__LANE(to.y, l) = (float)(r * sin(phi));
                    }
                    itn__nvectors ni = one_still(from), no = one_still(to);
                    itn__rough(one_distribution, &ni, &no, NULL, &a_alpha, &an_eta, &pdf);
                    for (l = 0; l < ITN__LANES; l++)
                        expected += ITN__LANE(pdf, l) * factor * 8 * surface_pi * fabs(s) /
                                    ((double)COSINES * TURNS * FINE * FINE);
                }
            }
            total += expected;
            sigma = sqrt(expected * DRAWS) + 1;
            check_report(fabs(counts[c][t] - expected * DRAWS) <
                             5 * sigma + .01 * expected * DRAWS, __FILE__, __LINE__,
                         "alpha %g eta %g mu %g box %d %d: %d draws, pdf says %.1f", (double)alpha,
                         (double)eta, (double)mu, c, t, counts[c][t], expected * DRAWS);
        }
    CHECK_NEAR(total, (double)drawn / DRAWS, .004);
}

/* Light can go either way: f_r(i, o) = f_r(o, i), f_t(i, o) / eta^2 = f_t(o, i) (Walter et al.). */
static void check_reciprocity(float alpha, float eta, double factor) {
    itn__rng rng = itn__rng_make(3, (uint64_t)(alpha * 1000), (uint64_t)(eta * 1000));
    int k, met = 0;
    for (k = 0; k < 2000; k++) {
        float turn = 2 * (float)surface_pi * itn__uniform(&rng),
              z = .05f + .95f * itn__uniform(&rng), pdf;
        float r = sqrtf(itn__max(0, 1 - z * z)), u[3];
        itn_vec3 i = itn__vec3(r * cosf(turn), r * sinf(turn), z), o, from, to;
        double there, back;
        u[0] = itn__uniform(&rng), u[1] = itn__uniform(&rng), u[2] = itn__uniform(&rng);
        if (!draw(i, alpha, eta, u, &o) || fabs(o.z) < .05) continue;
        from = o, to = i;
        if (o.z < 0) from.z = -o.z, to.z = -i.z;
        there = one_rough(i, o, NULL, alpha, eta, &pdf).v / fabs(o.z);
        back = one_rough(from, to, NULL, alpha, o.z < 0 ? 1 / eta : eta, &pdf).v / i.z * factor;
        if (o.z < 0) there /= (double)eta * eta;
        met++;
        CHECK_NEAR(there / back, 1, 2e-3 + 4e-6 / (alpha * fabs(eta - 1)));
    }
    CHECK(met > 500);
}

static void test_rough(void) {
    static const float alphas[4] = {.05f, .2f, .5f, 1}, etas[4] = {1.5f, 1 / 1.5f, 1.1f, 1 / 1.1f};
    static const float cosines[3] = {1, .6f, .2f};
    int a, e, c;
    for (a = 0; a < 4; a++)
        for (e = 0; e < 4; e++) {
            for (c = 0; c < 3; c++) {
                check_rough(alphas[a], etas[e], cosines[c], 1);
                if (alphas[a] > .1f && fabs(etas[e] - 1) > .2)
                    check_histogram(alphas[a], etas[e], cosines[c], 1);
            }
            check_reciprocity(alphas[a], etas[e], 1);
        }
    CHECK_CATCHES(check_rough(.2f, 1.5f, .6f, -1));
    CHECK_CATCHES(check_histogram(.5f, 1.5f, .6f, 1.05));
    CHECK_CATCHES(check_reciprocity(.5f, 1.5f, 2.25));
}

/* Everything stays finite and within bounds at the ends of alpha, index and angle. */
static void test_surface_extremes(void) {
    static const float alphas[4] = {.001f, .01f, .3f, 1};
    static const float etas[6] = {1.0001f, 1 / 1.0001f, 1.001f, 1.5f, 4, .25f};
    static const float cosines[6] = {1, .999999f, .5f, .01f, 1e-4f, 1e-6f};
    static const float ends[5] = {5.9604645e-8f, .01f, .5f, .99f, .99999994f};
    int a, e, c, k, sent = 0, all = 0;
    for (a = 0; a < 4; a++)
        for (e = 0; e < 6; e++)
            for (c = 0; c < 6; c++)
                for (k = 0; k < 125; k++) {
                    float mu = cosines[c], u[3], pdf;
                    itn_vec3 i = itn__vec3(sqrtf(itn__max(0, 1 - mu * mu)), 0, mu), o;
                    one_dual f;
                    u[0] = ends[k % 5], u[1] = ends[k / 5 % 5], u[2] = ends[k / 25];
                    all++;
                    if (!draw(i, alphas[a], etas[e], u, &o)) continue;
                    sent++;
                    f = one_rough(i, o, NULL, alphas[a], etas[e], &pdf);
                    CHECK(itn__finite3(o) && fabs(itn__length(o) - 1) < 3e-7);
                    CHECK(f.v >= 0 && itn__finite(f.v) && itn__finite(pdf));
                    CHECK(itn__finite(f.d[0]) && itn__finite(f.d[1]));
                    if (f.v > 0)
                        CHECK(pdf > 0 && f.v / pdf <= 1.00001f && itn__finite(f.d[0] / f.v) &&
                              itn__finite(f.d[1] / f.v));
                }
    CHECK(sent > all / 2);
}

/* At normal incidence a nearly smooth face sends on almost everything, by Fresnel's shares. */
static void test_nearly_smooth(void) {
    share shares[3];
    told_albedo(1, 1, .001, 1.5, shares);
    CHECK_NEAR(shares[UP].value, .04, 1e-4);
    CHECK_NEAR(shares[DOWN].value, .96, 1e-4);
    told_albedo(1, .5, .001, 1 / 1.5, shares); /* total reflection */
    CHECK_NEAR(shares[ALL].value, 1, 1e-4);
}

/* A face between nearly equal indices sends on everything, of whatever alpha and index: all facets
   refract to about the same direction, which does not tell them apart. */
static void test_nearly_matched(int told) {
    static const double etas[3] = {1.0001, 1 / 1.0001, 1.001}, mus[2] = {1, .6};
    share shares[3];
    int e, m;
    for (e = 0; e < 3; e++)
        for (m = 0; m < 2; m++) {
            told_albedo(told, mus[m], .001, etas[e], shares);
            CHECK_NEAR(shares[ALL].value, 1, 1e-4);
            CHECK_NEAR(shares[ALL].slope[0], 0, 4 * shares[ALL].error[0]);
            CHECK_NEAR(shares[ALL].slope[1], 0, 4 * shares[ALL].error[1]);
        }
}

/* Cosine-distributed directions: E[cos] = 2/3, E[cos^2] = 1/2. */
static void test_cosine(void) {
    enum { STEPS = 100000 };
    double sums[4] = {0};
    int k;
    for (k = 0; k < STEPS; k++) {
        itn_vec3 o = one_sample_cosine((float)((k + .5) / STEPS),
                                        (float)(fmod(k * .61803398875, 1)));
        sums[0] += o.z / STEPS, sums[1] += (double)o.z * o.z / STEPS;
        sums[2] += o.x / STEPS, sums[3] += (double)o.x * o.x / STEPS;
        if (!(fabs(itn__length(o) - 1) < 3e-7)) CHECK(0);
    }
    CHECK_NEAR(sums[0], 2 / 3., 1e-5);
    CHECK_NEAR(sums[1], .5, 1e-5);
    CHECK_NEAR(sums[2], 0, 1e-3);
    CHECK_NEAR(sums[3], .25, 1e-3);
}

/* Both walks make the same picture of milk behind a rough face, the fast one with its control
   variate, which counts on the draws. */
static void test_rough_milk(double planted) {
    itn_mesh mesh = solids_box(solids_vec3(-.5, -.5, -.5), solids_vec3(.5, .5, .5));
    solids_desc desc = ITN_ZERO;
    solids_mean found[2];
    itn_scene *scene;
    desc.mesh = &mesh, desc.sigma_t = 6, desc.albedo = .9, desc.g = .5;
    desc.ior = 1.5, desc.alpha = .4, desc.distribution = one_distribution;
    desc.eye = solids_vec3(.9, .7, 1.6), desc.fov = 35, desc.up = solids_vec3(0, 1, 0);
    scene = solids_scene(&desc);
    for (int way = 0; way < 2; way++) {
        itn_render_options options = ITN_ZERO;
        options.spp = way ? 512 : 1024, options.seed = 4;
        solids_way(&options, 2 * way);
        solids_measure(scene, NULL, &options, NULL, 0, &found[way]);
    }
    CHECK_NEAR(found[1].value * planted, found[0].value,
               4.5 * hypot(found[0].error, found[1].error));
    CHECK(found[0].error < .004 * found[0].value);
    itn_scene_free(scene);
    itn_mesh_free(&mesh);
}

/* Beckmann's distribution, drawn from GGX: slopes by the index have no edge there. */
static void test_beckmann(void) {
    one_distribution = ITN_BECKMANN;
    check_rough(.2f, 1.5f, .6f, 1), check_rough(.5f, 1 / 1.5f, .9f, 1);
    test_edge(.5, .3, 0);
    test_rough_milk(1);
    CHECK_CATCHES(check_rough(.2f, 1.5f, .6f, -1));
    CHECK_CATCHES(test_rough_milk(1.03));
    one_distribution = ITN_GGX;
}

int main(void) {
    test_fresnel();
    test_smooth();
    test_rough();
    test_albedo();
    test_edge(.9, .5, 0), test_edge(.5, .3, 0), test_edge(.4, .5, 0);
    test_beckmann();
    test_surface_extremes();
    test_nearly_smooth();
    test_nearly_matched(1);
    test_cosine();
    CHECK_CATCHES(test_nearly_matched(0));
    CHECK_CATCHES(test_edge(.5, .3, .1));
    return check_end("surface");
}
