/* Media, surfaces and lights for one number at a time, in the last lane; the other lanes hold other
   numbers. Slopes by both parameters of what has two come from two calls. */
#ifndef ONE_H
#define ONE_H
#include "../itn.h"

typedef struct one_dual {
    float v, d[2];
} one_dual;

static inline itn__floats one_lanes(float x) {
    itn__floats v = itn__splat(.37f);
    ITN__LANE(v, ITN__LANES - 1) = x;
    return v;
}
static inline itn__vectors one_vectors(itn_vec3 a) {
    itn__vectors v = itn__vectors_of(itn__splat(.48f), itn__splat(.64f), itn__splat(.6f));
    ITN__LANE(v.x, ITN__LANES - 1) = a.x, ITN__LANE(v.y, ITN__LANES - 1) = a.y;
    ITN__LANE(v.z, ITN__LANES - 1) = a.z;
    return v;
}
static inline float one_of(itn__floats v) { return ITN__LANE(v, ITN__LANES - 1); }
static inline itn_vec3 one_vector(itn__vectors v) { return itn__lane_vector(&v, ITN__LANES - 1); }
static inline int one_mask(itn__ints mask) { return ITN__LANE(mask, ITN__LANES - 1) != 0; }
static inline one_dual one_make(itn__num first, itn__num second) {
    one_dual r;
    r.v = one_of(first.v), r.d[0] = one_of(first.d), r.d[1] = one_of(second.d);
    return r;
}

static inline float one_flight(float sigma_t, float u) {
    return one_of(itn__sample_flight(one_lanes(1 / sigma_t), one_lanes(u)));
}
static inline one_dual one_transmittance(float sigma_t, float t) {
    itn__num f = itn__transmittance(itn__variable(one_lanes(sigma_t)), one_lanes(t));
    return one_make(f, itn__constant(f.v));
}
static inline float one_minus_cosine(itn_vec3 a, itn_vec3 b) {
    return one_of(itn__vone_minus_cosine(one_vectors(a), one_vectors(b)));
}
static inline one_dual one_phase(float g, float x, float y) {
    itn__num p = itn__hg(itn__variable(one_lanes(g)), one_lanes(x), one_lanes(y));
    return one_make(p, itn__constant(p.v));
}
static inline itn_vec3 one_sample_phase(itn_vec3 d, float g, float u, float v, float *x,
                                        float *y) {
    itn__floats xs, ys;
    itn__medium medium = ITN_ZERO;
    itn__phase phase;
    medium.shapes = 1, phase.shape[0] = g;
    itn__phase_make(&phase, &medium);
    itn__vectors to = itn__phase_turn(&phase, one_vectors(d), one_lanes(u), one_lanes(v), &xs, &ys);
    *x = one_of(xs), *y = one_of(ys);
    return one_vector(to);
}

static inline one_dual one_fresnel(float cos_i, float eta, float *cos_t) {
    itn__floats c = one_lanes(cos_i), e = one_lanes(eta);
    itn__num t, f = itn__fresnel(itn__variable(c), itn__constant(e), &t);
    one_dual r = one_make(f, itn__fresnel(itn__constant(c), itn__variable(e), &t));
    *cos_t = one_of(t.v);
    return r;
}
static inline itn__nvectors one_still(itn__vectors v) { /* with slopes 0 */
    itn__floats zero = itn__splat(0);
    return itn__nvectors_of(v, itn__vectors_of(zero, zero, zero));
}
static itn_distribution one_distribution; /* of what is rough; suites set it and set it back */
static inline one_dual one_rough(itn_vec3 i, itn_vec3 o, const itn_vec3 *drawn, float alpha,
                                 float eta, float *pdf) {
    itn__vectors from = one_vectors(i), to = one_vectors(o), m = one_vectors(drawn ? *drawn : i);
    itn__floats a = one_lanes(alpha), e = one_lanes(eta), density;
    itn__nvectors ni = one_still(from), no = one_still(to);
    itn__num f, g, x = itn__variable(a), y = itn__constant(e);
    f = itn__rough(one_distribution, &ni, &no, drawn ? &m : NULL, &x, &y, &density);
    x = itn__constant(a), y = itn__variable(e);
    g = itn__rough(one_distribution, &ni, &no, drawn ? &m : NULL, &x, &y, &density);
    *pdf = one_of(density);
    return one_make(f, g);
}
static inline itn_vec3 one_sample_facet(itn_vec3 i, float alpha, float u, float v) {
    itn__vectors from = one_vectors(i);
    return one_vector(itn__sample_facet(&from, one_lanes(alpha), one_lanes(u), one_lanes(v)));
}
static inline int one_sample_dielectric(itn_vec3 i, itn_vec3 m, float eta, float u, itn_vec3 *o) {
    itn__vectors from = one_vectors(i), facet = one_vectors(m), to;
    itn__ints good = itn__sample_dielectric(&from, &facet, one_lanes(eta), one_lanes(u), &to);
    *o = one_vector(to);
    return one_mask(good);
}
static inline itn_vec3 one_sample_cosine(float u, float v) {
    itn__floats lanes[3];
    itn__vectors o;
    lanes[0] = one_lanes(u), lanes[1] = one_lanes(v), lanes[2] = one_lanes(0);
    itn__bsdfs[ITN_SURFACE_DIFFUSE].sample(NULL, lanes, &o);
    return one_vector(o);
}

static inline itn__towards one_towards(itn_vec3 d) {
    itn__towards to;
    to.d = one_vectors(d);
    itn__map_coordinates(&to);
    return to;
}
static inline void one_map_coordinates(itn_vec3 d, float *u, float *v) {
    itn__towards to = one_towards(d);
    *u = one_of(to.u), *v = one_of(to.v);
}
static inline itn_vec3 one_map_direction(float u, float v) {
    return one_vector(itn__map_directions(one_lanes(u), one_lanes(v)));
}
static inline float one_light_pdf(const itn__light *light, itn_vec3 d) {
    itn__towards to = one_towards(d);
    return one_of(itn__light_models[light->kind].pdf(light, &to));
}
static inline itn_vec3 one_light_sample(const itn__light *light, float u, float v) {
    return one_vector(itn__light_models[light->kind].sample(light, one_lanes(u), one_lanes(v)));
}
static inline int one_pick(const float *table, int count, float u, float *rest) {
    itn__floats place;
    itn__ints entry = itn__pick(table, itn__splat_int(0), count, one_lanes(u), &place);
    *rest = one_of(place);
    return ITN__LANE(entry, ITN__LANES - 1);
}
#endif
