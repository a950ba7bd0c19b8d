/* Media with a sigma_t and g for each channel. Whatever the channels share in a walk, each of them
   must come out as if it were alone: its image and derivatives are compared, region by region, with
   those of a scene of one channel that has its values, within 4.5 standard errors of the
   difference, which themselves must be small.

   ITN_LONG_TESTS=1 in the environment takes 40 times the samples; SHOW=1 prints all comparisons. */
#define ITN_IMPLEMENTATION
#include "../itn.h"

#include "check.h"
#include "solids.h"
#include "stage.h"

enum { SPECTRAL_SIZE = 8, SPECTRAL_PIXELS = SPECTRAL_SIZE * SPECTRAL_SIZE, MOST_PARAMETERS = 24 };

/* What differs between channels. */
typedef struct spectrum {
    double sigma_t[3], albedo[3], g[3];
} spectrum;

typedef enum kind { SPECTRAL_MATCHED, SPECTRAL_ROUGH, SPECTRAL_SKY, NESTED } kind;

typedef struct subject {
    const char *name;
    kind what;
    spectrum medium;
    double largest; /* standard error of the image's mean, relative to it */
} subject;

/* A medium with its values in all channels (channel -1) or in one. */
static void add_medium(stage *s, const char *name, const spectrum *m, int channel) {
    int c = channel < 0 ? 0 : channel, k;
    itn_medium_desc *medium = stage_medium(s, name, m->sigma_t[c], m->albedo[c], m->g[c]);
    for (k = 0; k < 3 && channel < 0; k++) {
        medium->albedo[k] = (float)m->albedo[k];
        if (m->sigma_t[1] != m->sigma_t[0]) medium->sigma_t_rgb[k] = (float)m->sigma_t[k];
        if (m->g[1] != m->g[0]) medium->g_rgb[k] = (float)m->g[k];
    }
}

static itn_light_desc *grey_sky(stage *s) {
    itn_light_desc *light = stage_sky(s, "sky");
    int c;
    for (c = 0; c < 3; c++) light->sky.radiance[c] = .6f;
    return light;
}

/* The scene with all channels (channel -1), or that of one of them. All light is grey. */
static itn_scene *spectral_make_scene(const subject *in, int channel) {
    static const spectrum plain = {{1.5, 1.5, 1.5}, {.9, .8, .7}, {.2, .2, .2}};
    itn_mesh ball = solids_sphere(1, 2), core = solids_sphere(.6, 1);
    itn_image map = stage_patch(1, .1, .4, 6);
    itn_scene *scene;
    stage s;
    stage_begin(&s, SPECTRAL_SIZE, 4, 30);
    s.desc.film.channels = channel < 0 ? 3 : 1;
    s.desc.camera.eye.y = 1;
    add_medium(&s, "m", &in->medium, channel);
    if (in->what == SPECTRAL_MATCHED) {
        stage_object(&s, &ball, "m", NULL);
        stage_map(&s, "light", &map);
    } else if (in->what == SPECTRAL_ROUGH) {
        stage_dielectric(&s, "glass", 1.4, .3);
        stage_object(&s, &ball, "m", "glass");
        stage_map(&s, "light", &map);
        stage_constant(&s, "room", .3);
    } else if (in->what == SPECTRAL_SKY) {
        stage_diffuse(&s, "floor", .5);
        stage_object(&s, NULL, NULL, "floor");
        stage_object(&s, &ball, "m", NULL);
        grey_sky(&s);
    } else { /* a core in a shell of one sigma_t and g for all, which is frosted */
        add_medium(&s, "shell", &plain, channel);
        stage_dielectric(&s, "glass", 1.3, .4);
        stage_object(&s, &ball, "shell", "glass");
        stage_object(&s, &core, "m", NULL);
        stage_constant(&s, "room", .5);
        stage_map(&s, "light", &map);
    }
    scene = stage_make(&s);
    itn_image_free(&map);
    itn_mesh_free(&core), itn_mesh_free(&ball);
    return scene;
}

/* All parameters but indices of refraction, which take paths of their own. */
static int parameters_of(const itn_scene *scene, int *parameters) {
    int k, count = 0;
    for (k = 0; k < itn_parameter_count(scene); k++) {
        const char *name = itn_parameter_get(scene, k)->name;
        if (!strstr(name, ".ior")) parameters[count++] = k;
    }
    return count;
}

/* The index of what parameter `name` is called in the scene of one channel; -1 if it belongs to
   another channel. */
static int name_alone(const itn_scene *alone, const char *name, int channel) {
    char base[ITN_NAME_SIZE];
    size_t length = strlen(name);
    int index = itn_parameter_find(alone, name);
    if (index >= 0) return index;
    strcpy(base, name);
    base[length - 2] = 0;
    return name[length - 1] == "rgb"[channel] ? itn_parameter_find(alone, base) : -1;
}

/* Mean of a region (0: all, 1 to 4: quarters) of a plane and its variance. */
static void region_mean(const float *value, const float *variance, int region, double *mean,
                        double *spread) {
    int x, y, count = 0;
    *mean = *spread = 0;
    for (y = 0; y < SPECTRAL_SIZE; y++)
        for (x = 0; x < SPECTRAL_SIZE; x++) {
            int quarter = 1 + 2 * (y >= SPECTRAL_SIZE / 2) + (x >= SPECTRAL_SIZE / 2);
            if (region && quarter != region) continue;
            *mean += value[y * SPECTRAL_SIZE + x], *spread += variance[y * SPECTRAL_SIZE + x],
                count++;
        }
    *mean /= count, *spread /= (double)count * count;
}

static void render(const itn_scene *scene, int spp, uint64_t seed, const int *parameters, int count,
                   itn_image *image) {
    itn_render_options options = ITN_ZERO;
    itn_error error;
    options.spp = spp, options.seed = seed, options.mode = ITN_MODE_REFERENCE;
    stage_need(itn_render(scene, NULL, &options, parameters, count, image, &error), &error);
}

#ifdef ITN_SANITIZED
static int samples = 64; /* per pixel */
#else
static int samples = 256;
#endif

/* Sum of (difference / standard error)^2 over comparisons, and how many. */
static double chi_square, comparisons;

/* Compares one plane (-1: the image, else a derivative) of a channel with that of the channel
   alone. `k` and `alone_k` count the planes; -1 in alone_k: must be 0. */
static void compare_plane(const subject *in, const char *name, const itn_image *image, int k,
                          const itn_image *alone, int alone_k, int channel) {
    const float *value = image->pixels + (6 * (k + 1) + channel) * SPECTRAL_PIXELS;
    const float *other = alone->pixels + 2 * (alone_k + 1) * SPECTRAL_PIXELS;
    double mean, spread, expected, error, largest = 0;
    int region;
    for (region = 0; region < SPECTRAL_PIXELS && alone_k == -2; region++)
        largest += fabs(value[region]);
    if (alone_k == -2) {
        check_report(largest == 0, __FILE__, __LINE__, "%s %s: channel %d feels it", in->name, name,
                     channel);
        return;
    }
    for (region = 0; region < 5; region++) {
        region_mean(value, value + 3 * SPECTRAL_PIXELS, region, &mean, &spread);
        region_mean(other, other + SPECTRAL_PIXELS, region, &expected, &error);
        if (region == 0) largest = fabs(expected);
        error = sqrt(error + spread);
        if (error > 0)
            chi_square += (mean - expected) * (mean - expected) / (error * error), comparisons++;
        if (getenv("SHOW"))
            printf("%-8s %-14s channel %d region %d: %9.5f, alone %9.5f, +- %.5f (%.3f, %.1f "
                   "sigma)\n", in->name, name, channel, region, mean, expected, error,
                   error / largest, (mean - expected) / error);
        if (mean == 0 && expected == 0) continue; /* what the channel does not feel at all */
        check_report(fabs(mean - expected) <= 4.5 * error, __FILE__, __LINE__,
                     "%s %s, channel %d, region %d: %.6g, alone %.6g +- %.2g: %.1f sigma", in->name,
                     name, channel, region, mean, expected, error, (mean - expected) / error);
        if (region == 0 && k < 0)
            check_report(error <= in->largest * largest * sqrt(512. / samples), __FILE__, __LINE__,
                         "%s %s, channel %d is blunt: %.3g of %.3g", in->name, name, channel,
                         error, largest);
    }
}

/* `planted`: an error in sigma_t of all channels but the last, relative. no_draw: the hero is not
   drawn but always channel 0 (reference). */
static void test_channels(const subject *in, double planted, int no_draw) {
    subject off = *in;
    int parameters[MOST_PARAMETERS], alone_parameters[MOST_PARAMETERS], count, alone_count, c, k, j;
    itn_scene *scene;
    itn_image image = ITN_ZERO;
    for (c = 0; c < 2; c++) off.medium.sigma_t[c] *= 1 + planted;
    scene = spectral_make_scene(&off, -1);
    CHECK(scene->spectral);
    if (no_draw) scene->spectral = 0;
    count = parameters_of(scene, parameters);
    render(scene, samples, 1, parameters, count, &image);
    for (c = 0; c < 3; c++) {
        itn_scene *alone = spectral_make_scene(in, c);
        itn_image picture = ITN_ZERO;
        CHECK(!alone->spectral);
        alone_count = parameters_of(alone, alone_parameters);
        render(alone, samples, (uint64_t)c + 2, alone_parameters, alone_count, &picture);
        compare_plane(in, "image", &image, -1, &picture, -1, c);
        for (k = 0; k < count; k++) {
            const char *name = itn_parameter_get(scene, parameters[k])->name;
            int index = name_alone(alone, name, c), place = -2;
            for (j = 0; j < alone_count; j++)
                if (alone_parameters[j] == index) place = j;
            compare_plane(in, name, &image, k, &picture, place, c);
        }
        itn_image_free(&picture);
        itn_scene_free(alone);
    }
    itn_image_free(&image);
    itn_scene_free(scene);
}

static const subject subjects[] = {
    {"matched", SPECTRAL_MATCHED, {{2, 4, 7}, {.95, .9, .8}, {.6, .2, -.3}}, .01},
    {"rough", SPECTRAL_ROUGH, {{1, 3, 5}, {.95, .9, .7}, {.5, .3, .2}}, .012},
    {"sky", SPECTRAL_SKY, {{1, 2, 4}, {.9, .8, .7}, {.4, .4, .4}}, .01},
    {"thick", SPECTRAL_MATCHED, {{.2, 6, 40}, {.9, .95, .9}, {0, .5, .9}}, .01},
    {"clear", SPECTRAL_ROUGH, {{0, 2, 6}, {.8, .9, .95}, {.3, .3, .3}}, .015},
    {"turns", SPECTRAL_MATCHED, {{4, 4, 4}, {.9, .9, .9}, {.9, 0, -.7}}, .012},
    {"nested", NESTED, {{1, 4, 9}, {.95, .8, .9}, {.5, 0, -.2}}, .012}};

/* ---- equal channels -------------------------------------------------------------------------- */

/* Three equal numbers are three parameters that mean what one does: the sum of the derivatives is
   the derivative of the one. */
static void test_equal(double planted) {
    static const subject equal = {
        "equal", SPECTRAL_ROUGH, {{3, 3, 3}, {.9, .9, .9}, {.4, .4, .4}}, 0};
    subject near = equal;
    itn_scene *one = spectral_make_scene(&equal, -1), *three;
    itn_image images[2] = {ITN_ZERO, ITN_ZERO};
    int parameters[3], c, region;
    near.medium.sigma_t[0] *= 1 - 1e-6, near.medium.sigma_t[2] *= 1 + planted;
    near.medium.g[0] *= 1 - 1e-6;
    three = spectral_make_scene(&near, -1);
    CHECK(!one->spectral && three->spectral);
    parameters[0] = itn_parameter_find(one, "m.sigma_t");
    render(one, samples, 11, parameters, 1, &images[0]);
    for (c = 0; c < 3; c++)
        parameters[c] = itn_parameter_find(three, c == 0   ? "m.sigma_t_r"
                                                  : c == 1 ? "m.sigma_t_g"
                                                           : "m.sigma_t_b");
    render(three, samples, 12, parameters, 3, &images[1]);
    for (c = 0; c < 3; c++)
        for (region = 0; region < 10; region++) {
            int plane = region < 5 ? 0 : 6, own = region < 5 ? 0 : 6 + 6 * c;
            double mean, spread, expected, error;
            region_mean(images[0].pixels + (plane + c) * SPECTRAL_PIXELS,
                        images[0].pixels + (plane + 3 + c) * SPECTRAL_PIXELS, region % 5, &expected,
                        &error);
            region_mean(images[1].pixels + (own + c) * SPECTRAL_PIXELS,
                        images[1].pixels + (own + 3 + c) * SPECTRAL_PIXELS, region % 5, &mean,
                        &spread);
            CHECK_MEAN(mean, sqrt(spread + error), expected, 4.5, .4 * fabs(expected) + .06);
        }
    itn_image_free(&images[0]), itn_image_free(&images[1]);
    itn_scene_free(one), itn_scene_free(three);
}

/* ---- white furnaces, extremes ---------------------------------------------------------------- */

/* A ball of albedo 1 in light 1 from everywhere: whatever the media are, each channel's mean is 1
   and derivatives are 0. Light that nobody samples (`linked` 0) comes in whole: the channels of
   every sample add up to 3, so no weight is larger. Of a map (1) every collision gets its part. */
static void test_furnace(const double sigma_t[3], const double g[3], double largest, int linked) {
    itn_mesh ball = solids_sphere(1, 1);
    itn_image image = ITN_ZERO, map = stage_patch(1, 0, 0, 0);
    itn_scene *scene;
    stage s;
    itn_medium_desc *medium;
    int parameters[MOST_PARAMETERS], count, c, i, finite = 1, spp = linked ? 1024 : 48;
    double worst = 0, mean, spread;
    stage_begin(&s, SPECTRAL_SIZE, 4, 25);
    s.desc.film.channels = 3;
    medium = stage_medium(&s, "m", 1, 1, 0);
    for (c = 0; c < 3; c++)
        medium->sigma_t_rgb[c] = (float)sigma_t[c], medium->g_rgb[c] = (float)g[c];
    stage_object(&s, &ball, "m", NULL);
    if (linked)
        stage_map(&s, "light", &map)->has_scale = 1, s.lights[0].scale = 10; /* the map has .1 */
    else
        stage_constant(&s, "light", 1);
    scene = stage_make(&s);
    render(scene, 1, 3, NULL, 0, &image);
    for (i = 0; i < SPECTRAL_PIXELS && !linked; i++) {
        double sum = (double)image.pixels[i] + image.pixels[SPECTRAL_PIXELS + i] +
                     image.pixels[2 * SPECTRAL_PIXELS + i];
        worst = fmax(worst, fabs(sum - 3));
    }
    CHECK_NEAR(worst, 0, 1e-3);
    itn_image_free(&image);
    count = parameters_of(scene, parameters);
    render(scene, spp, 4, parameters, count, &image);
    for (i = 0; i < image.plane_count * SPECTRAL_PIXELS; i++)
        finite &= !!itn__finite(image.pixels[i]);
    CHECK(finite);
    for (c = 0; c < 3; c++) {
        region_mean(image.pixels + c * SPECTRAL_PIXELS, image.pixels + (3 + c) * SPECTRAL_PIXELS, 0,
                    &mean, &spread);
        CHECK_MEAN(mean, sqrt(spread) + 1e-4, 1, 4.5, largest);
        for (i = 0; i < 2; i++) { /* sigma_t and g, parameters 0 to 2 and 6 to 8 */
            const float *plane = image.pixels + (6 * (1 + 6 * i + c) + c) * SPECTRAL_PIXELS;
            region_mean(plane, plane + 3 * SPECTRAL_PIXELS, 0, &mean, &spread);
            check_report(fabs(mean) <= 4.5 * sqrt(spread) + 1e-4, __FILE__, __LINE__,
                         "derivative %d of channel %d: %.3g +- %.2g, expected 0", i, c, mean,
                         sqrt(spread));
        }
    }
    itn_image_free(&image), itn_image_free(&map);
    itn_scene_free(scene);
    itn_mesh_free(&ball);
}

static void test_extremes(void) {
    static const double sigmas[][3] = {{1, 2, 4}, {1, 1000, 10}, {0, 1000, 1}, {0, 0, 5},
                                       {1e-30, 1, 100}, {1e-40, 0, 2}};
    static const double turns[3] = {.9, 0, -.8};
    static const double gs[][3] = {{.5, 0, -.5}, {0, .9, .999}, {-.999, .999, .1}};
    size_t i;
    for (i = 0; i < sizeof sigmas / sizeof sigmas[0]; i++)
        test_furnace(sigmas[i], gs[i % 3], .04, 0);
    test_furnace(sigmas[0], turns, .004, 1);
}

/* What is thicker than any float still gives finite numbers, of at most 3 a sample in light 1, all
   parameters asked for. */
static void test_finite(void) {
    static const spectrum media[] = {{{0, 1e12, 1}, {1, .9, 1}, {0, .999, -.999}},
                                     {{1e12, 1e-12, 1e6}, {.99, .5, 0}, {-.9, 0, .9}},
                                     {{1e-38, 1e12, 0}, {0, .5, .9}, {.1, 0, 0}}};
    itn_mesh ball = solids_sphere(1, 1);
    size_t k;
    for (k = 0; k < sizeof media / sizeof media[0]; k++) {
        int parameters[MOST_PARAMETERS], count, i, finite = 1;
        itn_image image = ITN_ZERO;
        itn_scene *scene;
        float most = 0;
        stage s;
        stage_begin(&s, SPECTRAL_SIZE, 4, 25);
        s.desc.film.channels = 3;
        add_medium(&s, "m", &media[k], -1);
        stage_dielectric(&s, "glass", 1.3, .3);
        stage_object(&s, &ball, "m", k == 1 ? "glass" : NULL);
        stage_constant(&s, "light", 1);
        scene = stage_make(&s);
        count = parameters_of(scene, parameters);
        render(scene, 6, 5, parameters, count, &image);
        for (i = 0; i < image.plane_count * SPECTRAL_PIXELS; i++)
            finite &= !!itn__finite(image.pixels[i]);
        CHECK(finite);
        itn_image_free(&image);
        render(scene, 6, 5, NULL, 0, &image);
        for (i = 0; i < 3 * SPECTRAL_PIXELS; i++)
            most = image.pixels[i] > most ? image.pixels[i] : most;
        CHECK(most > 0 && most <= 3.5f); /* roulette and rough boundaries add a little */
        itn_image_free(&image);
        itn_scene_free(scene);
    }
    itn_mesh_free(&ball);
}

/* ---- the same bits, the adjoint -------------------------------------------------------------- */

static void run_backwards(int count, void (*body)(void *task, int index), void *task, void *user) {
    (void)user;
    while (count--) body(task, count);
}

/* Rows in another order give the same bits, and the gradient of a loss is the sum of the weighted
   derivative images, whose paths it follows, and of their variances. */
static void test_adjoint(double planted) {
    itn_scene *scene = spectral_make_scene(&subjects[0], -1);
    itn_render_options options = ITN_ZERO;
    itn_image image = ITN_ZERO, again = ITN_ZERO;
    itn_error error;
    static float weights[3 * SPECTRAL_PIXELS];
    double gradient[MOST_PARAMETERS], variance[MOST_PARAMETERS];
    int parameters[MOST_PARAMETERS], count = parameters_of(scene, parameters), i, k;
    size_t bytes;
    for (i = 0; i < 3 * SPECTRAL_PIXELS; i++) weights[i] = 1 + .1f * (float)(i % 7);
    options.spp = 8, options.seed = 21; /* scales are asked for: AUTO is the reference */
    stage_need(itn_render(scene, NULL, &options, parameters, count, &image, &error), &error);
    scene->context.parallel_for = run_backwards;
    stage_need(itn_render(scene, NULL, &options, parameters, count, &again, &error), &error);
    bytes = (size_t)image.plane_count * SPECTRAL_PIXELS * sizeof(float);
    CHECK(!memcmp(image.pixels, again.pixels, bytes));
    stage_need(itn_render_gradient(scene, NULL, &options, weights, parameters, count, gradient,
                                   variance, &error), &error);
    for (k = 0; k < count; k++) {
        double sum = planted, size = 0;
        for (i = 0; i < 3 * SPECTRAL_PIXELS; i++) {
            double term = (double)weights[i] * image.pixels[6 * (k + 1) * SPECTRAL_PIXELS + i];
            sum += term, size += fabs(term);
        }
        CHECK_NEAR(gradient[k], sum, 1e-5 * size);
        CHECK(variance[k] > 0);
    }
    itn_image_free(&image), itn_image_free(&again);
    itn_scene_free(scene);
}

/* ---- the interface --------------------------------------------------------------------------- */

/* Makes a scene of a medium; returns what happened. */
static itn_result make_medium(int channels, const float sigma_t[3], const float g[3],
                              itn_scene **scene, itn_error *error) {
    itn_mesh ball = solids_sphere(1, 0);
    itn_result result;
    stage s;
    itn_medium_desc *medium;
    stage_begin(&s, SPECTRAL_SIZE, 4, 25);
    s.desc.film.channels = channels;
    medium = stage_medium(&s, "m", 7, .5, .25);
    memcpy(medium->sigma_t_rgb, sigma_t, sizeof medium->sigma_t_rgb);
    memcpy(medium->g_rgb, g, sizeof medium->g_rgb);
    stage_object(&s, &ball, "m", NULL);
    stage_constant(&s, "light", 1);
    memset(error, 0, sizeof *error);
    *scene = NULL;
    result = itn_scene_create(&s.desc, NULL, scene, error);
    itn_mesh_free(&ball);
    return result;
}

static void test_interface(void) {
    static const float none[3] = {0, 0, 0}, three[3] = {0, 10, 20}, turns[3] = {-.5f, 0, .5f};
    static const struct {
        float sigma_t[3], g[3];
        int channels;
        const char *says;
    } bad[] = {{{1, 2, 3}, {0, 0, 0}, 1, "m: sigma_t_rgb needs a film with 3 channels"},
               {{0, 0, 0}, {0, 0, .1f}, 1, "m: g_rgb needs a film with 3 channels"},
               {{1, -2, 3}, {0, 0, 0}, 3, "m: sigma_t -2 is not in"},
               {{1, 2, 2e12f}, {0, 0, 0}, 3, "m: sigma_t 2e+12 is not in"},
               {{1, 2, 3}, {0, 1, 0}, 3, "m: g 1 is not in"},
               {{1, NAN, 3}, {0, 0, 0}, 3, "is not in"}};
    static const char *const names[] = {"m.sigma_t_r", "m.sigma_t_g", "m.sigma_t_b", "m.albedo_r",
                                        "m.albedo_g", "m.albedo_b", "m.g_r", "m.g_g", "m.g_b"};
    itn_render_options options = ITN_ZERO;
    itn_image image = ITN_ZERO;
    itn_error error;
    itn_scene *scene;
    size_t k;
    for (k = 0; k < sizeof bad / sizeof bad[0]; k++) {
        CHECK(make_medium(bad[k].channels, bad[k].sigma_t, bad[k].g, &scene, &error) ==
              ITN_ERROR_ARGUMENT);
        check_report(!scene && strstr(error.message, bad[k].says) != NULL, __FILE__, __LINE__,
                     "'%s' does not say '%s'", error.message, bad[k].says);
    }
    CHECK(make_medium(3, none, none, &scene, &error) == ITN_OK); /* the one value holds */
    CHECK(itn_parameter_get(scene, itn_parameter_find(scene, "m.sigma_t"))->value == 7);
    CHECK(itn_parameter_get(scene, itn_parameter_find(scene, "m.g"))->value == .25f);
    CHECK(itn_parameter_find(scene, "m.sigma_t_r") < 0 && itn_parameter_find(scene, "m.g_b") < 0);
    itn_scene_free(scene);
    CHECK(make_medium(3, three, turns, &scene, &error) == ITN_OK);
    for (k = 0; k < 9; k++) {
        const itn_parameter *p = itn_parameter_get(scene, (int)k);
        check_report(!strcmp(p->name, names[k]), __FILE__, __LINE__, "%s is not %s", p->name,
                     names[k]);
        CHECK(k >= 3 || (p->value == three[k] && p->lower == 0 && p->upper == 1e12f &&
                         p->transform == ITN_LOG));
        CHECK(k < 6 || (p->value == turns[k - 6] && p->lower == -.999f && p->upper == .999f &&
                        p->transform == ITN_LOGIT));
    }
    CHECK_NEAR(itn_scene_thickness(scene, NULL, "m"),
               10 * 4 * scene->objects[0].volume / scene->objects[0].area, 1e-5);
    options.mode = ITN_MODE_FAST; /* which does not know such media */
    CHECK(itn_render(scene, NULL, &options, NULL, 0, &image, &error) == ITN_ERROR_UNSUPPORTED);
    CHECK(!image.pixels && strstr(error.message, "media that differ between channels"));
    options.mode = ITN_MODE_AUTO;
    CHECK(itn_render(scene, NULL, &options, NULL, 0, &image, &error) == ITN_OK);
    itn_image_free(&image);
    itn_scene_free(scene);
}

/* Samples by pixel: where there are fewer than channels, none is left without a hero; the mean over
   many seeds is that of a render with as many samples everywhere. no_draw: as in test_channels. */
static void test_few_samples(int no_draw) {
    enum { SEEDS = 400 };
    itn_scene *scene = spectral_make_scene(&subjects[0], -1);
    itn_render_options options = ITN_ZERO;
    itn_image image = ITN_ZERO, even = ITN_ZERO;
    int pixels = scene->film.width * scene->film.height, i, c, k;
    int *allotted = (int *)malloc((size_t)pixels * sizeof(int));
    double sums[3] = {0}, squares[3] = {0};
    for (i = 0; allotted && i < pixels; i++) allotted[i] = i ? 1 + i % 2 : 12;
    render(scene, 4096, 1000, NULL, 0, &even);
    if (no_draw) scene->spectral = 0;
    options.mode = ITN_MODE_REFERENCE, options.samples = allotted;
    for (k = 0; k < SEEDS; k++) {
        options.seed = (uint64_t)k;
        CHECK(itn_render(scene, NULL, &options, NULL, 0, &image, NULL) == ITN_OK);
        for (c = 0; c < 3; c++) {
            double sum = 0;
            for (i = c * pixels; i < (c + 1) * pixels; i++) sum += (double)image.pixels[i] / pixels;
            sums[c] += sum / SEEDS, squares[c] += sum * sum / SEEDS;
        }
        itn_image_free(&image);
    }
    for (c = 0; c < 3; c++) {
        double expected, error;
        region_mean(even.pixels + c * SPECTRAL_PIXELS, even.pixels + (3 + c) * SPECTRAL_PIXELS, 0,
                    &expected, &error);
        error = sqrt(error + (squares[c] - sums[c] * sums[c]) / (SEEDS - 1));
        CHECK_MEAN(sums[c], error, expected, 4.5, .02 * expected);
    }
    itn_image_free(&even);
    itn_scene_free(scene);
    free(allotted);
}

int main(void) {
    enum { COUNT = sizeof subjects / sizeof subjects[0] };
    int i;
    if (check_long()) samples *= 40;
    for (i = 0; i < COUNT; i++) test_channels(&subjects[i], 0, 0);
    if (getenv("SHOW")) printf("chi^2 %.3f of %.0f\n", chi_square / comparisons, comparisons);
    CHECK(chi_square > .7 * comparisons && chi_square < 1.3 * comparisons); /* stated errors */
    test_equal(0);
    CHECK_CATCHES(test_equal(.5));
    test_extremes();
    test_finite();
    test_few_samples(0);
    CHECK_CATCHES(test_few_samples(1));
    test_adjoint(0);
    test_interface();
    CHECK_CATCHES(test_channels(&subjects[0], .5, 0));
    CHECK_CATCHES(test_channels(&subjects[0], 0, 1));
    CHECK_CATCHES(test_adjoint(1));
    return check_end("spectral");
}
