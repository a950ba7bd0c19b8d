/* Lights: their radiance, the densities with which they are sampled, and what arrives on a surface,
   against quadratures in double. */
#define ITN_IMPLEMENTATION
#include "../itn.h"
#include "check.h"
#include "one.h"
#include "solids.h"

static const double pi = 3.14159265358979323846;

/* The Hosek-Wilkie sky for turbidity 3, ground albedo .15, sun at 60 degrees, R, G, B. The numbers
   were computed from a table under this license:

   Copyright (c) 2012 - 2013, Lukas Hosek and Alexander Wilkie. All rights reserved.
   Redistribution and use in source and binary forms, with or without modification, are permitted
   provided that the following conditions are met:
   * Redistributions of source code must retain the above copyright notice, this list of
     conditions and the following disclaimer.
   * Redistributions in binary form must reproduce the above copyright notice, this list of
     conditions and the following disclaimer in the documentation and/or other materials provided
     with the distribution.
   * None of the names of the contributors may be used to endorse or promote products derived from
     this software without specific prior written permission.
   THIS SOFTWARE IS PROVIDED BY THE COPYRIGHT HOLDERS AND CONTRIBUTORS "AS IS" AND ANY EXPRESS OR
   IMPLIED WARRANTIES, INCLUDING, BUT NOT LIMITED TO, THE IMPLIED WARRANTIES OF MERCHANTABILITY
   AND FITNESS FOR A PARTICULAR PURPOSE ARE DISCLAIMED. IN NO EVENT SHALL THE COPYRIGHT HOLDERS BE
   LIABLE FOR ANY DIRECT, INDIRECT, INCIDENTAL, SPECIAL, EXEMPLARY, OR CONSEQUENTIAL DAMAGES
   (INCLUDING, BUT NOT LIMITED TO, PROCUREMENT OF SUBSTITUTE GOODS OR SERVICES; LOSS OF USE, DATA,
   OR PROFITS; OR BUSINESS INTERRUPTION) HOWEVER CAUSED AND ON ANY THEORY OF LIABILITY, WHETHER IN
   CONTRACT, STRICT LIABILITY, OR TORT (INCLUDING NEGLIGENCE OR OTHERWISE) ARISING IN ANY WAY OUT
   OF THE USE OF THIS SOFTWARE, EVEN IF ADVISED OF THE POSSIBILITY OF SUCH DAMAGE. */
static const itn_sky sky = {
    {{-1.07009729f, -.183901643f, 1.91568571f, 5.39974686f, -3.87281834f, .965212528f,
      .142394768f, .0879904436f, .699068785f},
     {-1.08019412f, -.182494114f, 1.35130131f, 3.36346639f, -4.95046067f, .951531163f,
      .125748228f, 1.74406109f, .684971587f},
     {-1.06727076f, -.1887265f, .68670071f, .166813941f, -2.24239154f, .831768481f, .077190505f,
      3.15772945f, .681278175f}},
    {6.54064327f, 10.1626235f, 16.7692864f},
    {2.33268e6f, 1.85154e6f, 1.36141e6f}};

/* ---- helpers --------------------------------------------------------------------------------- */

static itn_light_desc sky_light(double radius_scale) {
    itn_light_desc light = ITN_ZERO;
    light.type = ITN_LIGHT_SKY, light.sky = sky, light.sun_radius_scale = (float)radius_scale;
    light.sun_direction = solids_vec3(.5, sqrt(.75), 0);
    return light;
}

static itn_light_desc map_light(const itn_image *image) {
    itn_light_desc light = ITN_ZERO;
    light.type = ITN_LIGHT_MAP, light.image = image;
    return light;
}

/* Maps to try: 0 smooth, 1 noise, 2 one bright pixel, 3 poles only, 4 constant. */
static itn_image make_map(int width, int height, int kind) {
    itn_image image;
    itn_error error;
    int r, c;
    itn__rng rng = itn__rng_make(9, (uint64_t)width, (uint64_t)height);
    solids_need(itn_image_create(width, height, 1, NULL, &image, &error), &error);
    strcpy(image.names[0], "Y");
    for (r = 0; r < height; r++)
        for (c = 0; c < width; c++) {
            float *p = &image.pixels[r * width + c], u = itn__uniform(&rng);
            double across = 2 * pi * (c + .5) / width, down = pi * r / (height - 1);
            *p = 1;
            if (kind == 0) *p = (float)(2 + sin(across) * sin(down) + cos(down) * .7);
            if (kind == 1) *p = u * u * 3;
            if (kind == 2) *p = r == height / 3 && c == width / 4 ? 1000 : .01f;
            if (kind == 3) *p = r == 0 || r == height - 1 ? 1.f : 0;
        }
    return image;
}

/* A diffuse square in a light, seen from above: nothing but direct light. */
static itn_scene *plane_scene(const itn_light_desc *light, int channels, int size) {
    itn_surface_desc surface = ITN_ZERO;
    itn_object_desc object = ITN_ZERO;
    itn_scene_desc desc = ITN_ZERO;
    itn_scene *scene;
    itn_error error;
    int k;
    surface.name = "s", surface.type = ITN_SURFACE_DIFFUSE;
    for (k = 0; k < 3; k++) surface.reflectance[k] = .5f;
    object.half_size = 10, object.surface = "s";
    desc.surfaces = &surface, desc.objects = &object, desc.lights = light;
    desc.surface_count = desc.object_count = desc.light_count = 1;
    desc.film.width = desc.film.height = size, desc.film.channels = channels;
    desc.camera.eye = solids_vec3(0, 5, .1);
    solids_need(itn_scene_create(&desc, NULL, &scene, &error), &error);
    return scene;
}

/* Radiance of a map by bilinear interpolation, in double. */
static double map_value(const itn_image *map, double u, double v) {
    double x = u * map->width - .5, y = v * (map->height - 1), fx = x - floor(x), fy;
    int c0 = ((int)floor(x) + map->width) % map->width, c1 = (c0 + 1) % map->width, r = (int)y;
    if (r > map->height - 2) r = map->height - 2;
    fy = y - r;
#define MAP_AT(r, c) ((double)map->pixels[(r) * map->width + (c)])
    return (1 - fy) * ((1 - fx) * MAP_AT(r, c0) + fx * MAP_AT(r, c1)) +
           fy * ((1 - fx) * MAP_AT(r + 1, c0) + fx * MAP_AT(r + 1, c1));
#undef MAP_AT
}

/* ---- maps ------------------------------------------------------------------------------------ */

/* A map becomes what it has everywhere, a constant light, and the rest, which is sampled. Density:
   integrates to 1 over the sphere, agrees with a histogram of the draws; the mean of radiance /
   density is the rest's power, and its relative spread is at most largest_spread. */
static void check_map(int width, int height, int kind, double largest_spread, double factor) {
    enum { COLUMNS = 12, ROWS = 8, FINE = 160, DRAWS = 200000 };
    itn_image map = make_map(width, height, kind);
    itn_light_desc desc = map_light(&map);
    itn_scene *scene = plane_scene(&desc, 1, 4);
    const itn__light *light = &scene->lights[0];
    const itn__light_model *model = &itn__light_models[light->kind];
    float constant = scene->lights[1].radiance[0];
    itn__rng rng = itn__rng_make(4, (uint64_t)(width * 100 + height), (uint64_t)kind);
    itn__towards to;
    itn__floats rgb[3], pdf, x, y;
    double expected[ROWS][COLUMNS], power = 0, total = 0, mean = 0, square = 0, spread, worst = 0;
    double least = INFINITY;
    int counts[ROWS][COLUMNS], r, c, a, b, k, l;
    memset(counts, 0, sizeof counts), memset(expected, 0, sizeof expected);
    for (r = 0; r < ROWS; r++)
        for (c = 0; c < COLUMNS; c++)
            for (a = 0; a < FINE; a++)
                for (b = 0; b < FINE; b += ITN__LANES) {
                    double v = (r + (a + .5) / FINE) / ROWS, u[ITN__LANES];
                    double area = 2 * pi * pi * sin(pi * v) / (ROWS * COLUMNS) / (FINE * FINE);
                    x = itn__splat(0);
                    for (l = 0; l < ITN__LANES; l++) {
                        u[l] = (c + (b + l + .5) / FINE) / COLUMNS;
                        ITN__LANE(x, l) = (float)u[l];
                    }
                    to.d = itn__map_directions(x, itn__splat((float)v));
                    itn__map_coordinates(&to);
                    model->radiance(light, NULL, 3, &to, rgb), pdf = model->pdf(light, &to);
                    for (l = 0; l < ITN__LANES; l++) {
                        worst = fmax(worst, fabs((double)(ITN__LANE(rgb[0], l) + constant) -
                                                 map_value(&map, u[l], v)));
                        expected[r][c] += factor * ITN__LANE(pdf, l) * area;
                        power += ITN__LANE(rgb[0], l) * area;
                    }
                }
    CHECK_NEAR(worst, 0, kind == 2 ? .05 : 1e-4);
    CHECK(scene->light_count == 1 + (constant > 0) && scene->last_sampled == (kind == 4 ? -1 : 0));
    for (k = 0; k < width * height; k++) least = fmin(least, (double)map.pixels[k]);
    CHECK_NEAR(constant, least, 1e-7 * least);
    if (kind == 4) CHECK_NEAR(power, 0, 1e-4);
    if (kind == 4) goto done; /* nothing is sampled */
    x = y = itn__splat(0);
    for (k = 0; k < DRAWS; k += ITN__LANES) {
        for (l = 0; l < ITN__LANES; l++)
            ITN__LANE(x, l) = itn__uniform(&rng), ITN__LANE(y, l) = itn__uniform(&rng);
        to.d = model->sample(light, x, y);
        itn__map_coordinates(&to);
        model->radiance(light, NULL, 3, &to, rgb), pdf = model->pdf(light, &to);
        for (l = 0; l < ITN__LANES; l++) {
            double density = ITN__LANE(pdf, l), ratio = (double)ITN__LANE(rgb[0], l) / density;
            if (!(density > 0) || !itn__finite(density) ||
                !(fabs(itn__length(itn__lane_vector(&to.d, l)) - 1) < 1e-6))
                CHECK(0);
            c = (int)(ITN__LANE(to.u, l) * COLUMNS), r = (int)(ITN__LANE(to.v, l) * ROWS);
            counts[r < ROWS ? r : ROWS - 1][c < COLUMNS ? c : COLUMNS - 1]++;
            mean += ratio / DRAWS, square += ratio * ratio / DRAWS;
        }
    }
    for (r = 0; r < ROWS; r++)
        for (c = 0; c < COLUMNS; c++) {
            double e = expected[r][c] * DRAWS;
            total += expected[r][c];
            check_report(fabs(counts[r][c] - e) < 5 * sqrt(e + 1) + .004 * e, __FILE__, __LINE__,
                         "map %d x %d kind %d box %d %d: %d draws, density says %.1f", width,
                         height, kind, r, c, counts[r][c], e);
        }
    spread = sqrt(itn__max((float)(square / (mean * mean) - 1), 0));
    CHECK_NEAR(total, 1, .002);
    CHECK_NEAR(mean / power, 1, 5 * spread / sqrt((double)DRAWS) + .001);
    check_report(spread <= largest_spread, __FILE__, __LINE__,
                 "map %d x %d kind %d: radiance / density spreads by %.3f", width, height, kind,
                 spread);
done:
    itn_scene_free(scene);
    itn_image_free(&map);
}

/* A map that is turned is that map, to whoever turns with it: values, densities and draws. */
static void check_turned_map(float degrees, double planted) {
    itn_image map = make_map(17, 9, 1);
    itn_light_desc desc = map_light(&map);
    itn_scene *before = plane_scene(&desc, 1, 4), *after;
    double angle = (double)degrees * pi / 180 + planted, c = cos(angle), s = sin(angle);
    itn__rng rng = itn__rng_make(8, 1, 1);
    desc.rotate = degrees, after = plane_scene(&desc, 1, 4);
    const itn__light *a = &before->lights[0], *b = &after->lights[0];
    for (int k = 0; k < 200; k++) {
        float u = itn__uniform(&rng), v = itn__uniform(&rng), there[3], here[3];
        itn_vec3 d = one_light_sample(a, u, v), turned = one_light_sample(b, u, v);
        itn_vec3 e = solids_vec3(c * d.x + s * d.z, d.y, c * d.z - s * d.x);
        CHECK_NEAR(itn__length(itn__sub(turned, e)), 0, 2e-6);
        itn__light_radiance(a, NULL, 1, d, there), itn__light_radiance(b, NULL, 1, e, here);
        CHECK_NEAR(here[0], there[0], 1e-4);
        CHECK_NEAR(one_light_pdf(b, e), one_light_pdf(a, d), 1e-4 * one_light_pdf(a, d) + 1e-5);
    }
    itn_scene_free(before), itn_scene_free(after), itn_image_free(&map);
}

static void test_maps(void) {
    check_map(64, 33, 0, .05, 1);
    check_map(64, 33, 1, .1, 1);
    check_map(37, 24, 1, .15, 1);
    check_map(48, 25, 2, .1, 1);
    check_map(16, 9, 3, 1, 1);
    check_map(64, 33, 4, .05, 1);
    check_map(2, 2, 1, 1, 1);
    check_map(1, 2, 1, 1, 1);
    check_map(1, 2, 4, 1, 1);
    check_map(1, 64, 0, .1, 1);
    CHECK_CATCHES(check_map(64, 33, 0, .05, 1.01));
    CHECK_CATCHES(check_map(64, 33, 0, .001, 1));
}

/* Directions and coordinates: the published layout, and back. */
static void test_light_directions(void) {
    itn_vec3 d = one_map_direction(.25f, .5f);
    float u, v;
    int k;
    CHECK(fabs(d.x - 1) < 1e-6 && fabs(d.y) < 1e-6 && fabs(d.z) < 1e-6);
    d = one_map_direction(0, .5f);
    CHECK(fabs(d.z + 1) < 1e-6);
    d = one_map_direction(.7f, 0);
    CHECK(fabs(d.y - 1) < 1e-6);
    for (k = 0; k < 1000; k++) {
        float a = (float)(fmod(k * .61803398875, 1)), b = (float)((k + .5) / 1000);
        one_map_coordinates(one_map_direction(a, b), &u, &v);
        CHECK(fabs(v - b) < 1e-6 && (fabs(u - a) < 1e-5 || fabs(fabs(u - a) - 1) < 1e-5));
        CHECK(u >= 0 && u < 1 && v >= 0 && v <= 1);
    }
    one_map_coordinates(itn__vec3(0, 1, 0), &u, &v);
    CHECK(u >= 0 && u < 1 && v == 0);
    one_map_coordinates(itn__vec3(-1e-30f, 0, -1), &u, &v);
    CHECK(u >= 0 && u < 1 && fabs(v - .5) < 1e-6);
}

/* ---- sky and sun ----------------------------------------------------------------------------- */

static void check_sky_at(const itn__light *light, double theta, double azimuth,
                         const double rgb[3]) {
    float got[3];
    int k;
    itn__light_radiance(light, NULL, 3,
                        itn__vec3((float)(sin(theta) * cos(azimuth)), (float)cos(theta),
                                         (float)(sin(theta) * sin(azimuth))), got);
    for (k = 0; k < 3; k++) CHECK_NEAR(got[k], rgb[k], 2e-5 * rgb[k]);
}

/* Radiances that the authors' own code gives for this sky. */
static void test_light_sky(void) {
    static const double zenith[3] = {3.631779, 5.522326, 10.403060};
    static const double sunward[3] = {16.307778, 19.157592, 21.983152};
    static const double opposite[3] = {3.434738, 6.607357, 13.081977};
    itn_light_desc desc = sky_light(1);
    itn_scene *scene = plane_scene(&desc, 3, 4);
    const itn__light *light = &scene->lights[0];
    itn_sky dark = sky;
    float rgb[3];
    CHECK(scene->light_count == 2);
    check_sky_at(light, 0, 0, zenith);
    check_sky_at(light, pi / 6, 0, sunward);
    check_sky_at(light, pi / 3, pi, opposite);
    CHECK_CATCHES(check_sky_at(light, pi / 6, .02, sunward));
    itn__light_radiance(light, NULL, 3, itn__vec3(.6f, -.8f, 0), rgb); /* nothing below the horizon */
    CHECK(rgb[0] == 0 && rgb[1] == 0 && rgb[2] == 0);
    itn_scene_free(scene);
    dark.coefficients[0][2] = -50; /* negative: taken as 0 */
    desc.sky = dark;
    scene = plane_scene(&desc, 3, 4);
    itn__light_radiance(&scene->lights[0], NULL, 3, itn__vec3(0, 1, 0), rgb);
    CHECK(rgb[0] == 0 && rgb[1] > 0);
    itn_scene_free(scene);
}

/* The sun's cone: its solid angle, its power under widening, draws inside and uniform. */
static void check_sun(double radius_scale, double power_factor) {
    itn_light_desc desc = sky_light(radius_scale);
    itn_scene *scene = plane_scene(&desc, 3, 4);
    const itn__light *sun = &scene->lights[1];
    double half = .2679 * pi / 180, natural = 4 * pi * pow(sin(half / 2), 2);
    double solid_angle = 4 * pi * pow(sin(half * radius_scale / 2), 2), mean = 0;
    int k, inside = 0;
    CHECK(sun->kind == ITN__LIGHT_SUN);
    CHECK_NEAR(2 * pi * sun->sun_cone / solid_angle, 1, 1e-5);
    for (k = 0; k < 3; k++)
        CHECK_NEAR(sun->radiance[k] * 2 * pi * sun->sun_cone /
                       (power_factor * sky.sun_radiance[k] * natural), 1, 1e-5);
    for (k = 0; k < 10000; k++) {
        float rgb[3], u = (float)((k + .5) / 10000), v = (float)fmod(k * .61803398875, 1);
        itn_vec3 d = one_light_sample(sun, u, v);
        itn__light_radiance(sun, NULL, 3, d, rgb);
        inside += rgb[0] > 0 && fabs(one_light_pdf(sun, d) * solid_angle - 1) < 1e-4;
        mean += one_minus_cosine(d, sun->to_sun) / sun->sun_cone / 10000;
    }
    CHECK(inside == 10000); /* those too that rounding puts beyond the rim */
    CHECK_NEAR(mean, .5, .01);
    itn_scene_free(scene);
}

static void test_sun(void) {
    check_sun(1, 1);
    check_sun(10, 1);
    check_sun(70, 1);
    check_sun(300, 1);
    CHECK_CATCHES(check_sun(70, 1.001));
}

/* ---- what arrives on a surface --------------------------------------------------------------- */

/* .5 / pi int L cos over the upper half. */
static double irradiated(const itn_image *map, double radius_scale, int channel) {
    enum { ROWS = 600, COLUMNS = 1200 };
    double sum = 0, half = .2679 * pi / 180;
    itn__light light;
    int r, c;
    memset(&light, 0, sizeof light);
    light.kind = ITN__LIGHT_SKY, light.sky = sky;
    light.to_sun = itn__vec3(.5f, (float)sqrt(.75), 0);
    for (r = 0; r < ROWS; r++)
        for (c = 0; c < COLUMNS; c++) {
            double v = .5 * (r + .5) / ROWS, u = (c + .5) / COLUMNS, radiance;
            float rgb[3];
            itn_vec3 d = one_map_direction((float)u, (float)v);
            if (!map) itn__light_radiance(&light, NULL, 3, d, rgb);
            radiance = map ? map_value(map, u, v) : rgb[channel];
            sum += radiance * cos(pi * v) * sin(pi * v) * pi * pi / ((double)ROWS * COLUMNS);
        }
    if (!map) { /* a cone of angle a, all above the horizon: cos at its axis times pi sin^2 a */
        double natural = 4 * pi * pow(sin(half / 2), 2);
        double wide = 4 * pi * pow(sin(half * radius_scale / 2), 2);
        sum += sky.sun_radiance[channel] * natural / wide * sqrt(.75) * pi *
               pow(sin(half * radius_scale), 2);
    }
    return .5 / pi * sum;
}

/* Mean against quadrature; the relative variance of one sample stays below `largest`. */
static void check_plane(const itn_light_desc *desc, const itn_image *map, int channel,
                        double expected, double largest) {
    static const char *const value[3] = {"R", "G", "B"};
    static const char *const variance[3] = {"Variance.R", "Variance.G", "Variance.B"};
    itn_scene *scene = plane_scene(desc, map ? 1 : 3, 16);
    itn_render_options options = ITN_ZERO;
    itn_image image = ITN_ZERO;
    itn_error error;
    solids_mean mean;
    double relative;
    options.spp = 128, options.seed = 5;
    solids_need(itn_render(scene, NULL, &options, NULL, 0, &image, &error), &error);
    mean = solids_plane_mean(&image, map ? "Y" : value[channel],
                             map ? "Variance.Y" : variance[channel]);
    mean.error += 1e-6 * expected; /* of quadrature: a constant map has no variance */
    CHECK_MEAN(mean.value, mean.error, expected, 4, .01 * expected);
    relative = pow(mean.error / mean.value, 2) * 128 * 256;
    check_report(relative < largest, __FILE__, __LINE__, "relative variance per sample %.3f",
                 relative);
    itn_image_free(&image);
    itn_scene_free(scene);
}

static void test_planes(void) {
    static const double scales[3] = {1, 20, 70};
    itn_light_desc desc;
    int k, c;
    for (k = 0; k < 3; k++)
        for (c = 0; c < 3; c++) {
            desc = sky_light(scales[k]);
            check_plane(&desc, NULL, c, irradiated(NULL, scales[k], c), .5);
        }
    for (k = 0; k < 5; k++) {
        itn_image map = make_map(32, 17, k);
        desc = map_light(&map);
        check_plane(&desc, &map, 0, irradiated(&map, 1, 0), k > 1 ? 3 : 1);
        itn_image_free(&map);
    }
    desc = sky_light(70);
    CHECK_CATCHES(check_plane(&desc, NULL, 1, 1.02 * irradiated(NULL, 70, 1), .5));
    CHECK_CATCHES(check_plane(&desc, NULL, 1, irradiated(NULL, 70, 1), 1e-4));
}

/* The same ball twice: index-matched, where lights are sampled, and with a smooth face of index
   1.0001, through which they can only be met by chance or, if they are sharp, by links. */
static void light_check_chance(const itn_image *map, double scale) {
    static const char *const names[1] = {"m.sigma_t"};
    itn_mesh mesh = solids_sphere(1, 3);
    itn_light_desc light = map_light(map);
    solids_mean means[2][2];
    int k, j;
    light.scale = 1;
    for (k = 0; k < 2; k++) {
        solids_desc desc = ITN_ZERO;
        desc.mesh = &mesh, desc.sigma_t = 2, desc.albedo = .8, desc.g = .4;
        desc.light = &light, desc.ior = k ? 1.0001 : 0;
        desc.eye = solids_vec3(0, 1, 3), desc.fov = 40;
        solids_measure_desc(&desc, k ? 300 : 50, (uint64_t)k, names, 1, means[k]);
        light.scale = (float)scale;
    }
    for (j = 0; j < 2; j++) {
        double error = sqrt(pow(means[0][j].error, 2) + pow(means[1][j].error, 2));
        CHECK_MEAN(means[0][j].value, error, means[1][j].value, 4,
                   .02 * fabs(means[1][j].value) + .004 * means[1][0].value);
    }
    itn_mesh_free(&mesh);
}

static void test_chance(void) {
    int k;
    for (k = 0; k < 2; k++) {
        itn_image map = make_map(8, 5, k);
        light_check_chance(&map, 1);
        if (k == 1) CHECK_CATCHES(light_check_chance(&map, 1.05));
        itn_image_free(&map);
    }
}

/* ---- spherical harmonics --------------------------------------------------------------------- */

/* They are orthonormal by quadrature, and the first nine are what textbooks say. */
static void check_harmonics(double planted) {
    enum { ROWS = 512, COLUMNS = 32 };
    static double product[ITN__HARMONICS][ITN__HARMONICS];
    itn__floats basis[ITN__HARMONICS];
    double y[ITN__HARMONICS];
    memset(product, 0, sizeof product);
    for (int i = 0; i < ROWS * COLUMNS; i++) {
        double cosine = (i / COLUMNS + .5) * 2 / ROWS - 1, sine = sqrt(1 - cosine * cosine);
        double phi = 2 * pi * (i % COLUMNS + .3) / COLUMNS;
        double a = sine * sin(phi), c = sine * cos(phi);
        itn__vectors d = one_vectors(solids_vec3(a, cosine, c));
        const double known[9] = {
            .5 / sqrt(pi), .4886025 * a, .4886025 * cosine, .4886025 * c, 1.0925484 * a * c,
            1.0925484 * a * cosine, .3153916 * (3 * cosine * cosine - 1), 1.0925484 * c * cosine,
            .5462742 * (c * c - a * a)};
        itn__harmonics(4, &d, basis);
        for (int k = 0; k < ITN__HARMONICS; k++) y[k] = (double)one_of(basis[k]);
        y[12] *= 1 + planted;
        for (int k = 0; k < 9 && i % 5 == 0; k++) CHECK_NEAR(y[k], known[k], 1e-6);
        for (int k = 0; k < ITN__HARMONICS * ITN__HARMONICS; k++)
            product[k / ITN__HARMONICS][k % ITN__HARMONICS] +=
                y[k / ITN__HARMONICS] * y[k % ITN__HARMONICS] * 4 * pi / (ROWS * COLUMNS);
    }
    for (int k = 0; k < ITN__HARMONICS * ITN__HARMONICS; k++)
        CHECK_NEAR(product[k / ITN__HARMONICS][k % ITN__HARMONICS], k % (ITN__HARMONICS + 1) == 0,
                   2e-4);
}

static itn_light_desc harmonic_light(int count, int channels, double first) {
    itn_light_desc light = ITN_ZERO;
    light.type = ITN_LIGHT_SH, light.harmonic_count = channels * count;
    for (int k = 0; k < channels * count; k++)
        light.harmonics[k] = k % count ? (float)sin(k * 1.7 + 1 + k / count) : (float)first;
    return light;
}

/* Draws in proportion to |luminance|, which is 0 on some lines: the mean of luminance / density is
   the first coefficient times sqrt(4 pi), and little varies. */
static void check_harmonic_draws(int planted) {
    enum { DRAWS = 1 << 17 };
    itn_light_desc desc = harmonic_light(25, 3, 2);
    itn_scene *scene = plane_scene(&desc, 3, 4);
    const itn__light *light = &scene->lights[0];
    const itn__light_model *model = &itn__light_models[light->kind];
    itn__rng rng = itn__rng_make(9, 0, 0);
    double mean = 0, square = 0, expected = 0, least = 0;
    for (int c = 0; c < 3; c++)
        expected += sqrt(4 * pi) * (double)light->harmonics[c] *
                    (c == 1 ? .7152 : c ? .0722 : .2126);
    for (int i = 0; i < DRAWS; i += ITN__LANES) {
        itn__floats u = itn__splat(0), v = u, rgb[3], pdf;
        itn__towards to;
        for (int k = 0; k < ITN__LANES; k++)
            ITN__LANE(u, k) = itn__uniform(&rng), ITN__LANE(v, k) = itn__uniform(&rng);
        to.d = model->sample(light, u, v), itn__map_coordinates(&to);
        model->radiance(light, NULL, 3, &to, rgb), pdf = model->pdf(light, &to);
        for (int k = 0; k < ITN__LANES; k++) {
            const float one[3] = {ITN__LANE(rgb[0], k), ITN__LANE(rgb[1], k), ITN__LANE(rgb[2], k)};
            double ratio = (double)itn__luminance(one) / ITN__LANE(pdf, k);
            if (planted) ratio = fabs(ratio);
            if (!itn__finite(ratio)) CHECK(0);
            mean += ratio / DRAWS, square += ratio * ratio / DRAWS, least = fmin(least, ratio);
        }
    }
    CHECK(least < 0 && square < 2 * (double)(light->power * light->power));
    CHECK_NEAR(mean, expected, 5 * sqrt((square - mean * mean) / DRAWS));
    itn_scene_free(scene);
}

/* Pictures are linear: the derivative by a coefficient is the picture in that harmonic alone, by the
   same paths; and the sum of all, times the coefficients, is the picture. Both walks agree where
   much of the radiance is negative. */
static void check_harmonic_pictures(int channels, double planted) {
    enum { PIXELS = 16 };
    itn_light_desc desc = harmonic_light(9, channels, .3);
    itn_scene *scene = plane_scene(&desc, channels, 4);
    itn_render_options options = ITN_ZERO;
    itn_image image, basis;
    itn_error error;
    float theta[64];
    int parameters[27], n = 9 * channels, size = PIXELS * channels;
    const itn_parameter *last;
    options.spp = 64, options.mode = ITN_MODE_REFERENCE;
    parameters[0] = itn_parameter_find(scene, channels == 3 ? "light.c00_r" : "light.c00");
    for (int k = 1; k < n; k++) parameters[k] = parameters[0] + k;
    last = itn_parameter_get(scene, parameters[n - 1]);
    CHECK(!strcmp(last->name, channels == 3 ? "light.c22_b" : "light.c22"));
    CHECK(last->transform == ITN_LINEAR && last->lower == -last->upper && last->upper > 500);
    CHECK_NEAR(itn_parameter_from_coordinate(last, itn_parameter_to_coordinate(last, -.4)), -.4,
               1e-12);
    solids_need(itn_render(scene, NULL, &options, parameters, n, &image, &error), &error);
    for (int k = 0; k < n; k++) {
        itn_parameter_values(scene, theta);
        for (int j = 0; j < n; j++) theta[parameters[j]] = j == k;
        solids_need(itn_render(scene, theta, &options, NULL, 0, &basis, &error), &error);
        for (int i = 0; i < size; i++) {
            float slope = image.pixels[(2 + 2 * k) * size + i];
            CHECK_NEAR(slope * (1 + planted), basis.pixels[i], 1e-5);
            image.pixels[i] -= itn_parameter_get(scene, parameters[k])->value * slope;
        }
        itn_image_free(&basis);
    }
    for (int i = 0; i < size; i++) CHECK_NEAR(image.pixels[i], 0, 1e-4);
    options.mode = ITN_MODE_FAST;
    CHECK(itn_render(scene, NULL, &options, parameters, 1, &basis, &error) ==
          ITN_ERROR_UNSUPPORTED);
    itn_image_free(&image);
    itn_scene_free(scene);
}

static void check_harmonic_walks(double factor) {
    static const char *const names[2] = {"m.sigma_t", "light.scale"};
    itn_mesh mesh = solids_sphere(1, 3);
    itn_light_desc light = harmonic_light(9, 1, .4);
    solids_mean means[2][3];
    for (int k = 0; k < 2; k++) {
        solids_desc desc = ITN_ZERO;
        itn_render_options options = ITN_ZERO;
        desc.mesh = &mesh, desc.sigma_t = 2, desc.albedo = .8, desc.g = .4, desc.light = &light;
        desc.eye = solids_vec3(0, 1, 3), desc.fov = 40;
        options.spp = 60, options.seed = (uint64_t)k;
        options.mode = k ? ITN_MODE_REFERENCE : ITN_MODE_FAST;
        itn_scene *scene = solids_scene(&desc);
        solids_measure(scene, NULL, &options, names, 2, means[k]);
        itn_scene_free(scene);
    }
    for (int j = 0; j < 3; j++) {
        double error = sqrt(pow(means[0][j].error, 2) + pow(means[1][j].error, 2));
        CHECK_MEAN(factor * means[0][j].value, error, means[1][j].value, 4, .02);
    }
    itn_mesh_free(&mesh);
}

static void test_harmonics(void) {
    check_harmonics(0), check_harmonic_draws(0), check_harmonic_pictures(1, 0);
    check_harmonic_pictures(3, 0), check_harmonic_walks(1);
    CHECK_CATCHES(check_harmonics(1e-3));
    CHECK_CATCHES(check_harmonic_draws(1));
    CHECK_CATCHES(check_harmonic_pictures(1, 1e-3));
    CHECK_CATCHES(check_harmonic_walks(1.5));
}

/* What a half-space behind smooth glass of index 1.5 (albedo .9, g .4) sends into direction (.6,
   .8, 0) of a sun's light, if that scatters once. out[1] and [2]: its derivatives by albedo, g. */
static void links_half_space(const itn_light_desc *light, double out[3]) {
    const double n = 1.5, albedo = .9, g = .4, view = .8;
    double sun = light->sun_direction.y, cosine, share[2], in[2], irradiance, p[2];
    int k;
    for (k = 0; k < 2; k++) { /* Fresnel, and the cosines inside */
        double mu = k ? view : sun, s, q;
        in[k] = sqrt(1 - (1 - mu * mu) / (n * n));
        s = (mu - n * in[k]) / (mu + n * in[k]), q = (in[k] - n * mu) / (in[k] + n * mu);
        share[k] = 1 - (s * s + q * q) / 2;
    }
    cosine = -(light->sun_direction.x * .6 / (n * n) + in[0] * in[1]);
    for (k = 0; k < 2; k++) {
        double h = g + (k ? 1e-6 : 0), chord = 1 + h * h - 2 * h * cosine;
        p[k] = (1 - h * h) / (4 * pi * pow(chord, 1.5));
    }
    irradiance = 2 * pi * (1 - cos(.2679 * pi / 180)) * (double)light->sky.sun_radiance[0];
    out[1] = share[0] * share[1] * irradiance * sun / (n * n) / (in[0] + in[1]) * p[0];
    out[0] = albedo * out[1], out[2] = out[0] * (p[1] / p[0] - 1) / 1e-6;
}

static void check_half_space_links(double planted) {
    static const char *const names[2] = {"m.albedo", "m.g"};
    itn_mesh mesh = solids_slab(10, 40);
    itn_light_desc light = sky_light(1);
    itn_render_options options = ITN_ZERO;
    solids_desc desc = ITN_ZERO;
    solids_mean means[3];
    itn_scene *scene;
    double expected[3];
    int k;
    for (k = 0; k < 3; k++) light.sky.radiance[k] = 0, light.sky.sun_radiance[k] = 1e5f;
    links_half_space(&light, expected);
    desc.mesh = &mesh, desc.sigma_t = 4, desc.albedo = .9, desc.g = .4, desc.ior = 1.5;
    desc.light = &light, desc.eye = solids_vec3(.6, .8, 0), desc.up = solids_vec3(0, 0, 1);
    scene = solids_scene(&desc);
    options.spp = 16, options.max_scatter = 1;
    solids_measure(scene, NULL, &options, names, 2, means);
    for (k = 0; k < 3; k++)
        CHECK_MEAN(means[k].value, means[k].error, planted * expected[k], 4,
                   .02 * fabs(expected[k]));
    itn_scene_free(scene);
    itn_mesh_free(&mesh);
}

/* A cube of milk in smooth glass under a sky of radiance 1 and a sun of natural size, against a
   path tracer that sums over all ways of collimated light through a cube, reflections included:
   .496572 +- .000117. Both walks; the stated error is that of the samples and of the blur. */
static void check_cube_links(double expected) {
    itn_mesh mesh = solids_box(solids_vec3(0, 0, 0), solids_vec3(1, 1, 1));
    itn_light_desc light = ITN_ZERO;
    solids_desc desc = ITN_ZERO;
    itn_scene *scene;
    int way, k;
    light.type = ITN_LIGHT_SKY, light.sun_direction = solids_vec3(.42, .866, .27);
    for (k = 0; k < 3; k++) {
        light.sky.coefficients[k][2] = 1, light.sky.radiance[k] = 1;
        light.sky.sun_radiance[k] = 50000;
    }
    desc.mesh = &mesh, desc.sigma_t = 5, desc.albedo = .95, desc.g = .5, desc.ior = 1.5;
    desc.light = &light, desc.eye = solids_vec3(2.5, 2, 4), desc.target = solids_vec3(.5, .5, .5);
    desc.up = solids_vec3(0, 1, 0), desc.fov = 12, desc.width = desc.height = 8;
    scene = solids_scene(&desc);
    for (way = 0; way < 2 * SOLIDS_WAYS; way++) {
        itn_render_options options = ITN_ZERO;
        itn_render_stats stats = ITN_ZERO;
        solids_mean mean;
        options.spp = way < SOLIDS_WAYS ? 64 : 512, options.seed = 1, options.stats = &stats;
        solids_way(&options, way % SOLIDS_WAYS);
        solids_measure(scene, NULL, &options, NULL, 0, &mean);
        mean.error = sqrt(mean.error * mean.error + stats.blur * stats.blur);
        CHECK_MEAN(mean.value, mean.error, expected, 3, way < SOLIDS_WAYS ? .02 : .007);
    }
    itn_scene_free(scene);
    itn_mesh_free(&mesh);
}

/* The same with an index-matched block of another medium inside: what scatters there last must not
   be lost. */
static void check_inner_links(double expected) {
    static const char cube[] = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 0 0 1\nv 1 0 1\nv 1 1 1\n"
                               "v 0 1 1\nf 4 3 2 1\nf 5 6 7 8\nf 1 2 6 5\nf 2 3 7 6\nf 3 4 8 7\n"
                               "f 4 1 5 8\n";
    static const char flat[] = "coefficients_r 0 0 1 0 0 0 0 0 0\n"
                               "coefficients_g 0 0 1 0 0 0 0 0 0\n"
                               "coefficients_b 0 0 1 0 0 0 0 0 0\nradiance 1 1 1\n"
                               "sun_radiance 50000 50000 50000\n";
    static const char text[] =
        "film width 8 height 8\ncamera eye 2.5 2 4 target .5 .5 .5 fov 18\n"
        "medium milk sigma_t 5 albedo .95 g .5\nmedium tea sigma_t 9 albedo .6 g .2\n"
        "surface glass type dielectric\nobject mesh cube.obj medium milk surface glass\n"
        "object mesh cube.obj medium tea scale .7 translate .15 .28 .28\n"
        "light sky flat.sky sun .42 .866 .27\n";
    const itn_file files[2] = {{"cube.obj", cube, sizeof cube - 1},
                               {"flat.sky", flat, sizeof flat - 1}};
    itn_scene *scene;
    itn_error error;
    int way;
    solids_need(itn_scene_from_memory(text, sizeof text - 1, NULL, files, 2, NULL, &scene, &error),
                &error);
    for (way = 0; way < SOLIDS_WAYS; way++) {
        itn_render_options options = ITN_ZERO;
        itn_render_stats stats = ITN_ZERO;
        solids_mean mean;
        options.spp = 256, options.stats = &stats;
        solids_way(&options, way);
        solids_measure(scene, NULL, &options, NULL, 0, &mean);
        mean.error = sqrt(mean.error * mean.error + stats.blur * stats.blur);
        CHECK_MEAN(mean.value, mean.error, expected, 3, .008);
    }
    itn_scene_free(scene);
}

static void test_links(void) {
    itn_image map = make_map(64, 33, 2);
    check_half_space_links(1);
    CHECK_CATCHES(check_half_space_links(1.1));
    check_cube_links(.496572);
    check_inner_links(.2149); /* by 1024 samples of each walk, +- .0007 */
    CHECK_CATCHES(check_inner_links(.1863)); /* without what scatters last in the block */
    CHECK_CATCHES(check_cube_links(.4746)); /* without what comes by reflections */
    light_check_chance(&map, 1);
    CHECK_CATCHES(light_check_chance(&map, 1.2));
    itn_image_free(&map);
}

int main(void) {
    test_light_directions();
    test_maps();
    check_turned_map(100, 0);
    check_turned_map(-360, 0);
    check_turned_map(-37.5f, 0);
    CHECK_CATCHES(check_turned_map(100, .001));
    test_light_sky();
    test_sun();
    test_planes();
    test_chance();
    test_harmonics();
    test_links();
    return check_end("light");
}
