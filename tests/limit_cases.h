/* Where methods fail: parameters that go to the ends of their ranges, one at a time, in scenes
   whose pictures are known without chance. A measurement here is the radiance of one direction and
   its derivatives; its truth comes from adding-doubling or, for a rough boundary, from an integral
   over facets, and their central differences. Include after itn.h, check.h and solids.h. */
#ifndef LIMIT_CASES_H
#define LIMIT_CASES_H
#include "adding.h"

/* What can vary. COSINE is that of the sun's distance from the zenith. */
enum {
    LIMIT_SIGMA_T, LIMIT_ALBEDO, LIMIT_G, LIMIT_ALPHA, LIMIT_IOR, LIMIT_SCALE, LIMIT_COSINE,
    LIMIT_FIELDS
};
static const char *const limit_parameters[LIMIT_COSINE] = {"m.sigma_t", "m.albedo", "m.g",
                                                           "s.alpha", "s.ior", "light.scale"};

/* Always a layer 1 thick and 200 wide, and a camera that looks straight down. */
typedef enum limit_scene {
    LIMIT_UNIFORM,  /* light 1 all around */
    LIMIT_SUN,      /* a small sun instead, whose beam has flux 1 */
    LIMIT_THROUGH,  /* the camera is in a black medium below a rough boundary, light above */
    LIMIT_MIRRORED  /* the same from above */
} limit_scene;

enum { LIMIT_VALUES = 6, LIMIT_ASKED = 3, LIMIT_QUANTITIES = 1 + LIMIT_ASKED };
typedef struct limit {
    const char *name;
    limit_scene scene;
    int field;                   /* that varies, and where it goes: */
    double end;                  /* (HUGE_VAL: to infinity) */
    double values[LIMIT_VALUES]; /* the last is the nearest */
    double rest[LIMIT_FIELDS];   /* of the other fields */
    int asked[LIMIT_ASKED];      /* derivatives; -1: none */
} limit;

#define LIMIT_MEDIUM {LIMIT_SIGMA_T, LIMIT_ALBEDO, LIMIT_G}
#define LIMIT_BY_ALPHA {LIMIT_ALPHA, -1, -1}
#define LIMIT_BY_IOR {LIMIT_ALPHA, LIMIT_IOR, -1}
enum { LIMIT_COUNT = 13 };
static const limit limits[LIMIT_COUNT] = {
    {"albedo to 0", LIMIT_UNIFORM, LIMIT_ALBEDO, 0, {.5, .1, .03, .01, 1e-4, 0},
     {2, .9, .5, 0, 0, 1, 0}, LIMIT_MEDIUM},
    {"albedo to 1", LIMIT_UNIFORM, LIMIT_ALBEDO, 1, {.5, .9, .99, .999, .9999, 1},
     {2, .9, .5, 0, 0, 1, 0}, LIMIT_MEDIUM},
    {"g to 0", LIMIT_UNIFORM, LIMIT_G, 0, {.5, .1, .01, 1e-4, 1e-6, 0},
     {2, .9, .5, 0, 0, 1, 0}, LIMIT_MEDIUM},
    {"g to 1", LIMIT_UNIFORM, LIMIT_G, 1, {.5, .8, .9, .97, .99, .999},
     {2, .9, .5, 0, 0, 1, 0}, LIMIT_MEDIUM},
    {"g to -1", LIMIT_UNIFORM, LIMIT_G, -1, {-.5, -.8, -.9, -.97, -.99, -.999},
     {2, .9, .5, 0, 0, 1, 0}, LIMIT_MEDIUM},
    {"sigma_t to 0", LIMIT_UNIFORM, LIMIT_SIGMA_T, 0, {1, .1, .01, .001, 1e-4, 1e-6},
     {2, .9, .5, 0, 0, 1, 0}, LIMIT_MEDIUM},
    {"sigma_t to infinity", LIMIT_UNIFORM, LIMIT_SIGMA_T, HUGE_VAL, {1, 3, 10, 100, 1e3, 1e4},
     {2, .9, .5, 0, 0, 1, 0}, LIMIT_MEDIUM},
    {"light to 0", LIMIT_UNIFORM, LIMIT_SCALE, 0, {1, .1, .01, 1e-4, 1e-6, 0},
     {2, .9, .5, 0, 0, 1, 0}, {LIMIT_SIGMA_T, LIMIT_ALBEDO, LIMIT_SCALE}},
    {"grazing light", LIMIT_SUN, LIMIT_COSINE, 0, {.7, .3, .1, .03, .01, .003},
     {2, .9, .5, 0, 0, 1, .5}, LIMIT_MEDIUM},
    {"alpha to 0: through", LIMIT_THROUGH, LIMIT_ALPHA, 0, {.5, .2, .1, .03, .01, .001},
     {100, 0, 0, .3, 1.5, 1, 0}, LIMIT_BY_ALPHA},
    {"alpha to 0: mirrored", LIMIT_MIRRORED, LIMIT_ALPHA, 0, {.5, .2, .1, .03, .01, .001},
     {100, 0, 0, .3, 1.5, 1, 0}, LIMIT_BY_ALPHA},
    {"ior to 1: through", LIMIT_THROUGH, LIMIT_IOR, 1, {1.5, 1.1, 1.03, 1.01, 1.001, 1.0001},
     {100, 0, 0, .3, 1.5, 1, 0}, LIMIT_BY_IOR},
    {"ior to 1: mirrored", LIMIT_MIRRORED, LIMIT_IOR, 1, {1.5, 1.1, 1.03, 1.01, 1.001, 1.0001},
     {100, 0, 0, .3, 1.5, 1, 0}, LIMIT_BY_IOR}};

/* Distance of a value from its end, or the value itself if that is infinity. */
SOLIDS_STATIC double limit_distance(const limit *l, int value) {
    return l->end < HUGE_VAL ? fabs(l->values[value] - l->end) : l->values[value];
}

/* ---- truth ----------------------------------------------------------------------------------- */

#define LIMIT_DEPTH .002 /* of the eye below the boundary */

/* The light above a boundary, axial and brightest at the zenith. */
SOLIDS_STATIC double limit_glow(double cosine) { return cosine > 0 ? pow(cosine, 4) : 0; }

/* Reflectance of a smooth boundary, and the cosine of the refracted ray. */
SOLIDS_STATIC double limit_fresnel(double cosine, double eta, double *refracted) {
    double square = 1 - (1 - cosine * cosine) / (eta * eta), s, p;
    *refracted = 0;
    if (!(square > 0)) return 1;
    *refracted = sqrt(square);
    s = (cosine - eta * *refracted) / (cosine + eta * *refracted);
    p = (eta * cosine - *refracted) / (eta * cosine + *refracted);
    return .5 * (s * s + p * p);
}

/* Looking straight at a rough boundary: the mean over GGX facets, tan theta_m = alpha tan psi, of
   what they send there times Smith's G1 (Walter et al. 2007). eta: far side over near side. */
SOLIDS_STATIC double limit_boundary(double alpha, double eta, int through) {
    enum { STEPS = 4000 };
    double sum = 0;
    int k;
    for (k = 0; k < STEPS; k++) {
        double psi = (k + .5) / STEPS * 1.57079632679489662, m = atan(alpha * tan(psi)), cosine;
        double share = limit_fresnel(cos(m), eta, &cosine), theta = 2 * m, tangent;
        if (through) share = 1 - share, theta = m - acos(cosine);
        if (share == 0 || fabs(theta) >= 1.57079632679489662) continue;
        tangent = alpha * tan(theta);
        sum += 2 * sin(psi) * cos(psi) * share * 2 / (1 + sqrt(1 + tangent * tangent)) *
               limit_glow(cos(theta));
    }
    return sum * 1.57079632679489662 / STEPS;
}

SOLIDS_STATIC double limit_radiance(limit_scene scene, const double *at) {
    double value = 0;
    switch (scene) {
    case LIMIT_UNIFORM: value = adding_uniform(at[LIMIT_SIGMA_T], at[LIMIT_ALBEDO], at[LIMIT_G]);
        break;
    case LIMIT_SUN: value = adding_beam(at[LIMIT_SIGMA_T], at[LIMIT_ALBEDO], at[LIMIT_G],
                                        at[LIMIT_COSINE]);
        break;
    case LIMIT_THROUGH: value = exp(-at[LIMIT_SIGMA_T] * (double)(float)LIMIT_DEPTH) *
                                limit_boundary(at[LIMIT_ALPHA], 1 / at[LIMIT_IOR], 1);
        break;
    case LIMIT_MIRRORED: value = limit_boundary(at[LIMIT_ALPHA], at[LIMIT_IOR], 0);
        break;
    }
    return at[LIMIT_SCALE] * value;
}

/* The same by field, from central differences over a range small against all that matters. The
   formulas go on beyond albedo 0 and 1 and light 0. */
SOLIDS_STATIC double limit_slope(limit_scene scene, const double *at, int field) {
    double moved[LIMIT_FIELDS], step = 1e-3, upper;
    if (field == LIMIT_SIGMA_T || field == LIMIT_ALPHA) step *= at[field];
    if (field == LIMIT_G) step *= fmin(1, 30 * (1 - fabs(at[field])));
    if (field == LIMIT_IOR) step *= 10 * (at[field] - 1);
    memcpy(moved, at, sizeof moved);
    moved[field] = at[field] + step, upper = limit_radiance(scene, moved);
    moved[field] = at[field] - step;
    return (upper - limit_radiance(scene, moved)) / (2 * step);
}

SOLIDS_STATIC void limit_point(const limit *l, int value, double *at) {
    memcpy(at, l->rest, sizeof l->rest);
    at[l->field] = l->values[value];
}

/* The radiance and the derivatives that are asked for. */
SOLIDS_STATIC void limit_truth(const limit *l, int value, double *truth) {
    double at[LIMIT_FIELDS];
    int k;
    limit_point(l, value, at);
    truth[0] = limit_radiance(l->scene, at);
    for (k = 0; k < LIMIT_ASKED; k++)
        truth[1 + k] = l->asked[k] >= 0 ? limit_slope(l->scene, at, l->asked[k]) : 0;
}

/* ---- measurements ---------------------------------------------------------------------------- */

SOLIDS_STATIC itn_image limit_map(void) {
    itn_image map;
    itn_error error;
    int r;
    solids_need(itn_image_create(1, 2048, 1, NULL, &map, &error), &error);
    strcpy(map.names[0], "Y");
    for (r = 0; r < 1024; r++)
        map.pixels[r] = (float)limit_glow(cos(3.14159265358979324 * r / 2047));
    return map;
}

/* The scene of a value; free with itn_scene_free. */
SOLIDS_STATIC itn_scene *limit_make(const limit *l, int value) {
    itn_mesh mesh = solids_slab(1, 100);
    itn_image map = limit_map();
    itn_light_desc light = ITN_ZERO;
    solids_desc desc = ITN_ZERO;
    double at[LIMIT_FIELDS], sine = sin(.2679 * 3.14159265358979324 / 360);
    itn_scene *scene;
    limit_point(l, value, at);
    desc.mesh = &mesh, desc.light = &light;
    desc.sigma_t = at[LIMIT_SIGMA_T], desc.albedo = at[LIMIT_ALBEDO], desc.g = at[LIMIT_G];
    desc.ior = at[LIMIT_IOR], desc.alpha = at[LIMIT_ALPHA];
    light.scale = (float)at[LIMIT_SCALE], light.has_scale = 1, light.radiance[0] = 1;
    if (l->scene == LIMIT_SUN) {
        light.type = ITN_LIGHT_SKY, light.scale = 0, light.sun_scale = 1;
        light.sun_direction = solids_vec3(sqrt(1 - at[LIMIT_COSINE] * at[LIMIT_COSINE]),
                                          at[LIMIT_COSINE], 0);
        light.sun_radius_scale = .1f;
        light.sky.sun_radiance[0] = light.sky.sun_radiance[1] = light.sky.sun_radiance[2] =
            (float)(1 / (4 * 3.14159265358979324 * sine * sine));
    }
    if (l->scene >= LIMIT_THROUGH) light.type = ITN_LIGHT_MAP, light.image = &map;
    if (l->scene == LIMIT_THROUGH)
        desc.eye = solids_vec3(0, -LIMIT_DEPTH, 0), desc.target = solids_vec3(0, 1, 0);
    scene = solids_scene(&desc);
    itn_image_free(&map);
    itn_mesh_free(&mesh);
    return scene;
}

enum { LIMIT_BATCHES = 24 };

/* How many quantities a measurement has, and their names: the radiance, and what it is
   differentiated by. */
SOLIDS_STATIC int limit_quantities(const limit *l) {
    int count = 1;
    while (count < LIMIT_QUANTITIES && l->asked[count - 1] >= 0) count++;
    return count;
}
SOLIDS_STATIC const char *limit_name(const limit *l, int quantity) {
    return quantity ? limit_parameters[l->asked[quantity - 1]] : "radiance";
}
/* What floats and the truth's own differences may be wrong by. */
SOLIDS_STATIC double limit_rounding(const double *truth, int quantity) {
    return 1e-6 * (fabs(truth[quantity]) + fabs(truth[0]));
}

/* Means over independent renders, with standard errors from their spread; `claimed`, if not NULL,
   receives those of the variance planes. */
SOLIDS_STATIC void limit_measure(const limit *l, const itn_scene *scene,
                                 const itn_render_options *options, solids_mean *means,
                                 double *claimed) {
    itn_render_options batch = *options;
    const char *names[LIMIT_ASKED];
    double square[LIMIT_QUANTITIES] = {0}, variance[LIMIT_QUANTITIES] = {0};
    solids_mean one[LIMIT_QUANTITIES];
    int b, k, count = limit_quantities(l);
    for (k = 1; k < count; k++) names[k - 1] = limit_name(l, k);
    memset(means, 0, LIMIT_QUANTITIES * sizeof *means);
    for (b = 0; b < LIMIT_BATCHES; b++) {
        batch.seed = options->seed * LIMIT_BATCHES + (uint64_t)b;
        solids_measure(scene, NULL, &batch, names, count - 1, one);
        for (k = 0; k < count; k++) {
            means[k].value += one[k].value / LIMIT_BATCHES;
            square[k] += one[k].value * one[k].value / LIMIT_BATCHES;
            variance[k] += one[k].error * one[k].error / LIMIT_BATCHES / LIMIT_BATCHES;
        }
    }
    for (k = 0; k < count; k++) {
        double spread = square[k] - means[k].value * means[k].value;
        means[k].error = sqrt(fmax(spread, 0) / (LIMIT_BATCHES - 1));
        if (claimed) claimed[k] = sqrt(variance[k]);
    }
}
#endif
