/* Lights for one direction at a time, in numbers instead of lanes: the formulas of [light] once
   more, which those in lanes must equal. */
#ifndef SCALAR_H
#define SCALAR_H
#include "../itn.h"
#include "frame.h"

/* 1 - cos of the angle between unit vectors, exact also for small angles. */
static inline float scalar_one_minus_cosine(itn_vec3 a, itn_vec3 b) {
    itn_vec3 chord = itn__sub(a, b);
    return itn__min(.5f * itn__dot(chord, chord), 2);
}

/* Direction of u, v and back. */
static itn_vec3 scalar_map_direction(float u, float v) {
    float phi = 2 * ITN__PI * u, theta = ITN__PI * v, sine = sinf(theta);
    return itn__vec3(sinf(phi) * sine, cosf(theta), -cosf(phi) * sine);
}

static void scalar_map_coordinates(itn_vec3 d, float *u, float *v) {
    float phi = atan2f(d.x, -d.z) * (.5f / ITN__PI);
    *u = phi < 0 ? itn__min(phi + 1, .99999994f) : phi;
    *v = atan2f(sqrtf(d.x * d.x + d.z * d.z), d.y) * (1 / ITN__PI);
}

/* Cell and position within it of u, v on a grid of nodes: column c at (c + .5)/width, wrapping;
   row r at bottom r/(height - 1). */
static void scalar_grid_locate(int width, int height, float bottom, float u, float v, int *c0,
                               int *c1, int *r, float *fx, float *fy) {
    float x = u * (float)width - .5f, y = v / bottom * (float)(height - 1);
    if (x < 0) x += (float)width;
    x = x > 0 ? x : 0, y = y > 0 ? y : 0; /* also from NaN */
    *c0 = (int)x < width ? (int)x : width - 1;
    *c1 = *c0 + 1 < width ? *c0 + 1 : 0;
    *r = (int)y < height - 1 ? (int)y : height - 2;
    *fx = itn__min(x - (float)*c0, 1), *fy = itn__min(y - (float)*r, 1);
}

static inline float scalar_mix(float a, float b, float t) { return a + t * (b - a); }

static void scalar_map_radiance(const itn__light *light, itn_vec3 d, float rgb[3]) {
    int c0, c1, r, c;
    float u, v, fx, fy;
    const float *top, *below;
    scalar_map_coordinates(d, &u, &v);
    scalar_grid_locate(light->width, light->height, 1, u, v, &c0, &c1, &r, &fx, &fy);
    top = light->map + 3 * (size_t)r * (size_t)light->width, below = top + 3 * light->width;
    for (c = 0; c < 3; c++)
        rgb[c] = scalar_mix(scalar_mix(top[3 * c0 + c], top[3 * c1 + c], fx),
                          scalar_mix(below[3 * c0 + c], below[3 * c1 + c], fx), fy);
}

/* One channel of the sky above the horizon; its rare negative values are taken as 0. */
static float scalar_sky_radiance(const itn_sky *sky, int channel, float cos_theta, float cos_gamma,
                               float gamma) {
    const float *a = sky->coefficients[channel];
    float cos2 = cos_gamma * cos_gamma, chord2 = 1 + a[8] * a[8] - 2 * a[8] * cos_gamma;
    float mie = (1 + cos2) / (chord2 * sqrtf(chord2));
    float f = (1 + a[0] * expf(a[1] / (cos_theta + .01f))) *
              (a[2] + a[3] * expf(a[4] * gamma) + a[5] * cos2 + a[6] * mie +
               a[7] * sqrtf(cos_theta));
    return itn__min(itn__max(f * sky->radiance[channel], 0), 2 * ITN__MAX_RADIANCE);
}

/* Radiance of a light, without its scale, in direction d. */
static void scalar_light_radiance(const itn__light *light, itn_vec3 d, float rgb[3]) {
    float x = scalar_one_minus_cosine(d, light->to_sun);
    int k;
    rgb[0] = rgb[1] = rgb[2] = 0;
    if (light->kind == ITN__LIGHT_MAP) {
        scalar_map_radiance(light, d, rgb);
    } else if (light->kind == ITN__LIGHT_SKY) {
        float gamma = 2 * asinf(sqrtf(.5f * x));
        if (d.y < 0) return;
        for (k = 0; k < 3; k++) rgb[k] = scalar_sky_radiance(&light->sky, k, d.y, 1 - x, gamma);
    } else if (light->kind == ITN__LIGHT_CONSTANT || x <= light->sun_cone) {
        memcpy(rgb, light->radiance, sizeof light->radiance);
    }
}

/* First entry of an increasing table[count] that is above u in (0,1) times the last; *rest receives
   u's place between its neighbours, again uniform in [0,1]. */
static int scalar_pick(const float *table, int count, float u, float *rest) {
    int entry = 0;
    float before, width;
    u *= table[count - 1];
    while (table[entry] <= u && entry < count - 1) entry++;
    before = entry ? table[entry - 1] : 0, width = table[entry] - before;
    *rest = width > 0 ? itn__clamp((u - before) / width, 0, 1) : .5f;
    return entry;
}

/* Draws x in [-1,1] with density 1 - |x|. */
static float scalar_sample_tent(float u) {
    float x = 2 * u - 1, root = sqrtf(1 - fabsf(x));
    return x < 0 ? root - 1 : 1 - root;
}

static float scalar_grid_pdf(const itn__grid *grid, float u, float v) {
    int c0, c1, r;
    float fx, fy;
    const float *top;
    if (v > grid->bottom) return 0;
    scalar_grid_locate(grid->width, grid->height, grid->bottom, u, v, &c0, &c1, &r, &fx, &fy);
    top = grid->density + (size_t)r * (size_t)grid->width;
    return scalar_mix(scalar_mix(top[c0], top[c1], fx),
                    scalar_mix(top[grid->width + c0], top[grid->width + c1], fx), fy);
}

static itn_vec3 scalar_grid_sample(const itn__grid *grid, float u, float v) {
    int r = scalar_pick(grid->rows, grid->height, v, &v), c;
    size_t first = (size_t)r * (size_t)grid->width;
    c = scalar_pick(grid->nodes + first, grid->width, u, &u);
    u = ((float)c + .5f + scalar_sample_tent(u)) / (float)grid->width;
    v = fabsf((float)r + scalar_sample_tent(v)) / (float)(grid->height - 1);
    return scalar_map_direction(u - floorf(u), (v > 1 ? 2 - v : v) * grid->bottom);
}

/* Density over solid angle with which d is drawn. */
static float scalar_light_pdf(const itn__light *light, itn_vec3 d) {
    if (light->kind == ITN__LIGHT_CONSTANT) return 0;
    if (light->kind == ITN__LIGHT_SUN)
        return scalar_one_minus_cosine(d, light->to_sun) <= light->sun_cone
                   ? 1 / (2 * ITN__PI * light->sun_cone) : 0;
    {
        float u, v, sine;
        scalar_map_coordinates(d, &u, &v);
        sine = sqrtf(d.x * d.x + d.z * d.z);
        return sine > 0 ? scalar_grid_pdf(&light->grid, u, v) / (2 * ITN__PI * ITN__PI * sine) : 0;
    }
}

static itn_vec3 scalar_light_sample(const itn__light *light, float u, float v) {
    itn_vec3 s, t;
    float x, sine, phi = 2 * ITN__PI * v;
    if (light->kind != ITN__LIGHT_SUN) return scalar_grid_sample(&light->grid, u, v);
    x = u * light->sun_cone, sine = sqrtf(x * (2 - x));
    scalar_frame(light->to_sun, &s, &t);
    return itn__normalize(scalar_to_world(itn__vec3(sine * cosf(phi), sine * sinf(phi), 1 - x), s,
                                          t, light->to_sun));
}

/* Radiance of a light in the scene's channels. */
static void scalar_scene_radiance(const itn_scene *scene, const itn__light *light, itn_vec3 d,
                                float rgb[3]) {
    scalar_light_radiance(light, d, rgb);
    if (scene->film.channels == 1 && light->kind == ITN__LIGHT_SKY) rgb[0] = itn__luminance(rgb);
}

/* Density with which itn__draw_lights draws direction d. */
static float scalar_lights_pdf(const itn_scene *scene, itn_vec3 d) {
    float pdf = 0;
    int i;
    for (i = 0; i < scene->light_count; i++)
        if (scene->lights[i].share > 0)
            pdf += scene->lights[i].share * scalar_light_pdf(&scene->lights[i], d);
    return pdf;
}

/* Draws a direction to a light by three uniforms; pdf receives its density. Returns 0 where no light
   is sampled. */
static int scalar_draw_light(const itn_scene *scene, itn__rng *rng, itn_vec3 *direction,
                           float *pdf) {
    const itn__light *chosen = NULL;
    float u, v;
    int i;
    for (i = 0; i < scene->light_count && !chosen; i++)
        if (scene->lights[i].share > 0) chosen = &scene->lights[i];
    if (!chosen) return 0;
    u = itn__uniform(rng);
    for (i = 0; i < scene->light_count; i++) {
        if (!(scene->lights[i].share > 0)) continue;
        chosen = &scene->lights[i];
        if (u < chosen->share) break;
        u -= chosen->share;
    }
    u = itn__uniform(rng), v = itn__uniform(rng);
    *direction = scalar_light_sample(chosen, u, v);
    *pdf = scalar_lights_pdf(scene, *direction);
    return *pdf > 0;
}
#endif
