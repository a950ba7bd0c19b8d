/* What the film does with light: its exposure and what is behind everything. Both only scale or
   share out what the same paths bring, so all is exact, whoever renders. And the words of tissue
   optics. */
#ifndef ITN_APART
#define ITN_IMPLEMENTATION
#endif
#include "../itn.h"

#include "check.h"
#include "solids.h"
#include "stage.h"

enum { SIDE = 16, COUNT = SIDE * SIDE, MOST = 24 };

/* A ball over a checkered floor, under light that is everywhere the same (way 0) or also a sky; the
   floor ends, so that some pixels see nothing, some only that, and some both. */
static void make_stage(stage *s, const itn_mesh *ball, int channels, int sky) {
    itn_surface_desc *floor;
    stage_begin(s, SIDE, 4, 50);
    s->desc.film.channels = channels, s->desc.film.filter = ITN_FILTER_GAUSSIAN;
    stage_medium(s, "m", 2, .8, .3);
    floor = stage_diffuse(s, "floor", .5);
    floor->texture = ITN_TEXTURE_CHECKER, floor->reflectance2[0] = .2f;
    floor->reflectance2[1] = .3f, floor->reflectance2[2] = .1f;
    stage_object(s, ball, "m", NULL);
    stage_object(s, NULL, NULL, "floor")->half_size = 1.5f;
    stage_constant(s, "room", .7);
    if (sky) stage_sky(s, "sky");
}

/* Everything that a scene has, in the order of its parameters. */
static int all_parameters(const itn_scene *scene, int *parameters) {
    int count = itn_parameter_count(scene), k;
    for (k = 0; k < count && k < MOST; k++) parameters[k] = k;
    return count;
}

static itn_image render(const itn_scene *scene, const itn_render_options *options,
                        const int *parameters, int count) {
    itn_image image;
    itn_error error;
    stage_need(itn_render(scene, NULL, options, parameters, count, &image, &error), &error);
    return image;
}

/* value = expected in all of a plane, but for rounding, relative to the largest number there. */
static void compare_planes(const char *what, const float *value, const float *expected,
                           double scale, double tolerance) {
    double largest = 0, off = 0;
    int i;
    for (i = 0; i < COUNT; i++) {
        largest = fmax(largest, fabs(scale * (double)expected[i]));
        off = fmax(off, fabs((double)value[i] - scale * (double)expected[i]));
    }
    check_report(off <= tolerance * largest, __FILE__, __LINE__, "%s: off by %g of %g", what, off,
                 largest);
}

/* One plane of an image by number: channels of radiance, their variances, then of each parameter. */
static const float *plane_of(const itn_image *image, int k) {
    return image->pixels + (size_t)k * COUNT;
}

/* With exposure e the picture is e times as bright, its derivatives are e times, variances e^2 times
   those without; the derivative by the exposure is the picture over e. Sums over pixels with weights
   follow, and so do derivatives by the texels of an image. planted: an error of the exposure. */
static void test_scaling(int channels, int sky, int way, int scatterings, double planted) {
    static const float white[3] = {.37f, 20, 1.5f};
    itn_mesh ball = solids_sphere(1, 2);
    stage s;
    itn_scene *plain, *scene;
    itn_render_options options = ITN_ZERO;
    int parameters[MOST], count, c, k, own;
    itn_image before, after;
    float weights[3 * COUNT];
    double folded[MOST], variance[MOST];
    itn_error error;
    make_stage(&s, &ball, channels, sky);
    plain = stage_make(&s), count = all_parameters(plain, parameters);
    for (c = 0; c < channels; c++) {
        float e = (float)(white[c] * (1 + planted));
        if (channels == 1) s.desc.film.exposure = e;
        else s.desc.film.exposure_rgb[c] = e;
    }
    scene = stage_make(&s);
    solids_way(&options, way);
    options.max_scatter = scatterings, options.spp = way ? 64 : 16, options.seed = 3;
    if (scatterings) options.mode = ITN_MODE_AUTO;
    before = render(plain, &options, parameters, count - 1);
    own = itn_parameter_count(scene) - (count - 1);
    CHECK(own == channels);
    count = all_parameters(scene, parameters);
    after = render(scene, &options, parameters, count);
    for (k = 0; k < 2 * channels * (count - own + 1); k++) {
        double e = (double)white[k % channels];
        compare_planes(after.names[k], plane_of(&after, k), plane_of(&before, k),
                       k / channels % 2 ? e * e : e, 1e-5);
    }
    for (k = count - own; k < count; k++)
        for (c = 0; c < channels; c++) {
            const float *derivative = plane_of(&after, 2 * channels * (1 + k) + c);
            double e = k - count + own == c ? 1 / (double)white[c] : 0;
            compare_planes("derivative by exposure", derivative, plane_of(&after, c), e, 1e-5);
            compare_planes("its variance", derivative + channels * COUNT,
                           plane_of(&after, channels + c), e * e, 1e-5);
        }
    for (k = 0; k < channels * COUNT; k++) weights[k] = (float)(k * 7 % 11 - 5);
    stage_need(itn_render_gradient(scene, NULL, &options, weights, parameters, count, folded,
                                   variance, &error), &error);
    for (k = 0; k < count; k++) {
        double sum = 0, size = 0;
        for (c = 0; c < channels * COUNT; c++) {
            double part = (double)weights[c] *
                          plane_of(&after, 2 * channels * (1 + k))[c];
            sum += part, size += fabs(part);
        }
        CHECK_NEAR(folded[k], sum, 1e-5 * size);
        CHECK(variance[k] > 0);
    }
    itn_image_free(&before), itn_image_free(&after);
    itn_scene_free(plain), itn_scene_free(scene);
    itn_mesh_free(&ball);
}

/* The share of a pixel that meets nothing has the background's radiance: its derivative is that
   share; all else stays. With the background as bright as the only light the picture is as without.
   planted: it lights a little, too. */
static void test_background(int channels, int sky, int way, double planted) {
    itn_mesh ball = solids_sphere(1, 2);
    stage s;
    itn_scene *scenes[3]; /* without; of radiance 0; as bright as the light */
    itn_image images[3];
    itn_render_options options = ITN_ZERO;
    int parameters[MOST] = {0}, count, k, c, i, kinds[3] = {0, 0, 0};
    const float *share;
    make_stage(&s, &ball, channels, sky);
    s.desc.film.exposure = .5f;
    for (k = 0; k < 3; k++) {
        s.desc.film.has_background = k > 0;
        for (c = 0; c < 3; c++) s.desc.film.background[c] = k == 2 ? .7f : 0;
        if (k == 1) s.lights[0].radiance[0] *= (float)(1 + planted);
        scenes[k] = stage_make(&s);
        s.lights[0].radiance[0] = .7f;
        solids_way(&options, way);
        options.spp = 32, options.seed = 7;
        for (c = 0; c < channels && k; c++)
            parameters[c] = itn_parameter_find(scenes[k], channels == 1  ? "film.background"
                                                          : c == 0 ? "film.background_r"
                                                          : c == 1 ? "film.background_g"
                                                                   : "film.background_b");
        count = k ? channels : 1;
        if (k == 0) parameters[0] = itn_parameter_find(scenes[0], "film.exposure");
        images[k] = render(scenes[k], &options, parameters, count);
    }
    CHECK(itn_parameter_find(scenes[0], "film.background") == -1);
    for (c = 0; c < channels; c++) {
        double off = 0, whole = 0;
        share = plane_of(&images[2], 2 * channels * (1 + c) + c); /* times the exposure */
        compare_planes("share", plane_of(&images[1], 2 * channels * (1 + c) + c), share, 1, 0);
        for (i = 0; i < COUNT; i++) {
            double dark = plane_of(&images[1], c)[i], seen = plane_of(&images[2], c)[i];
            off = fmax(off, fabs(seen - dark - .7 * share[i]));
            whole = fmax(whole, fabs(seen - plane_of(&images[0], c)[i]));
            CHECK(share[i] >= 0 && share[i] <= .5f);
            kinds[share[i] == 0 ? 0 : share[i] == .5f ? 1 : 2]++;
            if (share[i] == .5f) CHECK(dark == 0);
        }
        CHECK_NEAR(off, 0, 1e-5);
        if (!sky) CHECK_NEAR(whole, 0, 1e-5);
    }
    CHECK(kinds[0] > 40 && kinds[1] > 40 && kinds[2] > 40);
    for (k = 0; k < 3; k++) itn_image_free(&images[k]), itn_scene_free(scenes[k]);
    itn_mesh_free(&ball);
}

/* An eye within a medium meets that at once, so it never sees the background. */
static void test_inside(int way) {
    itn_mesh ball = solids_sphere(1, 2);
    stage s;
    itn_scene *scene;
    itn_render_options options = ITN_ZERO;
    itn_image image;
    int parameter;
    stage_begin(&s, SIDE, .5, 50);
    s.desc.film.has_background = 1, s.desc.film.background[0] = 5;
    stage_medium(&s, "m", .5, .8, 0);
    stage_object(&s, &ball, "m", NULL);
    stage_constant(&s, NULL, 1);
    scene = stage_make(&s);
    parameter = itn_parameter_find(scene, "film.background");
    solids_way(&options, way);
    options.spp = 16;
    image = render(scene, &options, &parameter, 1);
    compare_planes("inside", plane_of(&image, 2), plane_of(&image, 0), 0, 0);
    CHECK_NEAR(solids_plane_mean(&image, "Y", "Variance.Y").value, .855, .01);
    itn_image_free(&image);
    itn_scene_free(scene);
    itn_mesh_free(&ball);
}

/* A film that sees nothing but a light of 3 through exposure e: (3 e - t)^2 and its slope. */
static void test_loss(double planted) {
    stage s;
    itn_scene *scene;
    itn_render_options options = ITN_ZERO;
    itn_error error;
    float target[COUNT];
    double loss, gradient[2], e = .8, t = 2, b = 1.5;
    int i, k, parameters[2];
    stage_begin(&s, SIDE, 4, 10);
    stage_diffuse(&s, "floor", .5);
    stage_object(&s, NULL, NULL, "floor")->plane_y = -9;
    stage_constant(&s, NULL, 3);
    s.desc.film.exposure = (float)(e * (1 + planted));
    for (i = 0; i < COUNT; i++) target[i] = (float)t;
    for (k = 0; k < 4; k++) {
        double l = k / 2 ? b : 3;
        s.desc.film.background[0] = k / 2 ? (float)b : 0;
        scene = stage_make(&s);
        parameters[0] = itn_parameter_find(scene, "film.exposure");
        parameters[1] = itn_parameter_find(scene, k / 2 ? "film.background" : "light.scale");
        options.mode = k % 2 ? ITN_MODE_FAST : ITN_MODE_REFERENCE, options.spp = 4;
        stage_need(itn_loss_gradient(scene, NULL, &options, target, parameters, 2, &loss, gradient,
                                     &error), &error);
        CHECK_NEAR(loss, (l * e - t) * (l * e - t), 1e-5);
        CHECK_NEAR(gradient[0], 2 * (l * e - t) * l, 1e-5);
        CHECK_NEAR(gradient[1], 2 * (l * e - t) * (k / 2 ? e : e * l), 1e-5);
        itn_scene_free(scene);
    }
}

/* Derivatives by the values of a map and of a texture are e times those without. */
static void test_texels(void) {
    itn_image map = stage_patch(1, .6, .3, 4), texture = stage_patch(1, .5, .5, .5), out[2];
    itn_scene *scene;
    itn_render_options options = ITN_ZERO;
    itn_error error;
    float weights[COUNT];
    int i, k, item;
    stage s;
    stage_begin(&s, SIDE, 4, 50);
    stage_diffuse(&s, "floor", .5);
    s.surfaces[0].texture = ITN_TEXTURE_IMAGE, s.surfaces[0].image = &texture;
    stage_object(&s, NULL, NULL, "floor");
    stage_map(&s, "map", &map);
    for (i = 0; i < COUNT; i++) weights[i] = (float)(i % 7) - 2;
    options.spp = 16;
    for (item = 0; item < 2; item++) {
        for (k = 0; k < 2; k++) {
            s.desc.film.exposure = k ? 6 : 1;
            scene = stage_make(&s);
            stage_need(itn_render_texel_gradient(scene, NULL, &options, weights,
                                                 item ? "map" : "floor", &out[k], &error), &error);
            itn_scene_free(scene);
        }
        for (i = 0; i < out[0].width * out[0].height; i++)
            CHECK_NEAR(out[1].pixels[i], 6 * out[0].pixels[i],
                       1e-5 * fabs(out[1].pixels[i]) + 1e-7);
        itn_image_free(&out[0]), itn_image_free(&out[1]);
    }
    itn_image_free(&map), itn_image_free(&texture);
}

static itn_result read_scene(const char *film, itn_scene **scene, itn_error *error) {
    char text[400];
    snprintf(text, sizeof text, "film %s\ncamera eye 0 1 3 target 0 0 0\n"
             "surface s type diffuse reflectance .5\nobject plane surface s\n"
             "light constant radiance 1\n", film);
    return itn_scene_from_memory(text, strlen(text), "x", NULL, 0, NULL, scene, error);
}

/* In scene files, and as parameters. */
static void test_files(void) {
    static const struct {
        const char *film, *name, *fault;
        double value;
    } rows[] = {
        {"width 4", "film.exposure", NULL, 1},
        {"exposure .25", "film.exposure", NULL, .25},
        {"channels 3 exposure .25", "film.exposure", NULL, .25},
        {"channels 3 exposure .25 .5 2", "film.exposure_b", NULL, 2},
        {"background 0", "film.background", NULL, 0},
        {"background .3 channels 3", "film.background_g", NULL, .300000012},
        {"background .3 .4 .5 channels 3", "film.background_b", NULL, .5},
        {"exposure 0", NULL, "x:1: film: exposure 0 is ", 0},
        {"exposure -1", NULL, "x:1: film: exposure -1 is ", 0},
        {"background -1", NULL, "x:1: film: background -1 is not in [0, 1e+18]", 0},
        {"background", NULL, "x:1: background ", 0},
        {"exposure 1 2 3", NULL, "x:1: a colour of three numbers needs a film", 0},
        {"exposure 1 2", NULL, "x:1: exposure takes ", 0}};
    size_t i;
    for (i = 0; i < sizeof rows / sizeof *rows; i++) {
        itn_scene *scene = NULL;
        itn_error error;
        itn_result result = read_scene(rows[i].film, &scene, &error);
        if (rows[i].fault) {
            check_report(result == ITN_ERROR_FORMAT && !scene &&
                             !strncmp(error.message, rows[i].fault, strlen(rows[i].fault)),
                         __FILE__, __LINE__, "film %s: %s", rows[i].film,
                         result ? error.message : "accepted");
        } else if (CHECK(result == ITN_OK)) {
            int k = itn_parameter_find(scene, rows[i].name);
            const itn_parameter *p = itn_parameter_get(scene, k);
            check_report(p && p->value == (float)rows[i].value && p->transform == ITN_LOG, __FILE__,
                         __LINE__, "film %s: %s", rows[i].film, rows[i].name);
            itn_scene_free(scene);
        }
    }
}

/* A photo of a ball in units of its own: what it is made of and the exposure are found together. */
static void test_unknown(double exposure, uint64_t seed, double planted) {
    static const char *const names[] = {"m.sigma_t", "m.albedo", "m.g", "film.exposure"};
    static const float start[3] = {3, .6f, 0};
    itn_mesh ball = solids_sphere(1, 2);
    itn_image map = stage_patch(1, .65, .35, 4), photo, guess;
    itn_refine_options refine = ITN_ZERO;
    itn_render_options options = ITN_ZERO;
    itn_refine_outcome outcome;
    itn_estimate estimates[4];
    itn_error error;
    itn_scene *scene;
    float theta[MOST];
    double truth[4] = {2, .8, .4, exposure * (1 + planted)}, sum[2] = {0, 0};
    int parameters[4], k, i;
    stage s;
    stage_begin(&s, SIDE, 4, 26);
    s.desc.film.exposure = (float)exposure;
    stage_medium(&s, "m", 2, .8, .4);
    stage_object(&s, &ball, "m", NULL);
    stage_map(&s, NULL, &map);
    scene = stage_make(&s);
    for (k = 0; k < 4; k++) parameters[k] = itn_parameter_find(scene, names[k]);
    options.spp = 512, options.seed = seed;
    photo = render(scene, &options, NULL, 0);
    itn_parameter_values(scene, theta);
    for (k = 0; k < 3; k++) theta[parameters[k]] = start[k];
    theta[parameters[3]] = 1, options.spp = 16;
    stage_need(itn_render(scene, theta, &options, NULL, 0, &guess, &error), &error);
    for (i = 0; i < COUNT; i++) sum[0] += photo.pixels[i], sum[1] += guess.pixels[i];
    theta[parameters[3]] = (float)(sum[0] / sum[1]);
    refine.spp = 32, refine.target_variance = plane_of(&photo, 1), refine.outcome = &outcome;
    refine.final_spp = 256, refine.seed = seed, refine.seconds = 20;
    stage_need(itn_refine(scene, theta, photo.pixels, parameters, 4, &refine, estimates, &error),
               &error);
    CHECK(outcome.explained);
    for (k = 0; k < 4; k++) {
        const itn_estimate *e = &estimates[k];
        if (getenv("SHOW"))
            printf("exposure %g: %s %g +- %g, truth %g\n", exposure, names[k], e->value,
                   e->standard_error, truth[k]);
        CHECK(e->determined);
        check_report(fabs(e->value - truth[k]) <= 4 * e->standard_error &&
                         e->standard_error < .2 * fabs(truth[k]),
                     __FILE__, __LINE__, "exposure %g: %s %g +- %g, truth %g", exposure, names[k],
                     e->value, e->standard_error, truth[k]);
    }
    itn_image_free(&photo), itn_image_free(&guess), itn_image_free(&map);
    itn_scene_free(scene);
    itn_mesh_free(&ball);
}

/* mu_a, mu_s, mu_s' of sigma_t, albedo, g. */
static void coefficients(const double x[3], double mu[3]) {
    mu[0] = x[0] * (1 - x[1]), mu[1] = x[0] * x[1], mu[2] = mu[1] * (1 - x[2]);
}

/* The words of tissue optics, and their errors from slopes by differences; unknowns stand in another
   order among others. planted: an error of a covariance. */
static void test_tissue(double planted) {
    static const char *const names[5] = {"m.g", "light.scale", "m.albedo", "", "m.sigma_t"};
    static const double deviations[5] = {.05, .3, .01, 1, .4};
    static const int place[3] = {4, 2, 0}; /* of sigma_t, albedo, g */
    double covariance[25], x[3] = {3, .9, .6}, mu[3], up[3], down[3], slopes[3][3];
    double found[3], errors[3];
    int parameters[5], i, j, k, known;
    itn_mesh ball = solids_sphere(1, 1);
    itn_scene *scene;
    float theta[MOST];
    itn_tissue tissue;
    stage s;
    stage_begin(&s, SIDE, 4, 26);
    s.desc.film.channels = 3;
    stage_medium(&s, "m", 2, .8, .4)->albedo[2] = .7f;
    stage_object(&s, &ball, "m", NULL);
    stage_constant(&s, NULL, 1);
    scene = stage_make(&s);
    CHECK(itn_scene_tissue(scene, NULL, "m", 2, NULL, 0, NULL, &tissue) == 1);
    CHECK_NEAR(tissue.mu_a, .6, 1e-6), CHECK_NEAR(tissue.mu_s, 1.4, 1e-6);
    CHECK_NEAR(tissue.mu_s_prime, .84, 1e-6);
    CHECK(tissue.mu_a_error == 0 && tissue.mu_s_error == 0 && tissue.mu_s_prime_error == 0);
    CHECK(!itn_scene_tissue(scene, NULL, "n", 0, NULL, 0, NULL, &tissue));
    CHECK(!itn_scene_tissue(scene, NULL, NULL, 0, NULL, 0, NULL, &tissue));
    CHECK(!itn_scene_tissue(scene, NULL, "m", 3, NULL, 0, NULL, &tissue));
    CHECK(!itn_scene_tissue(scene, NULL, "m", -1, NULL, 0, NULL, &tissue));
    itn_scene_free(scene);
    s.desc.film.channels = 1;
    scene = stage_make(&s);
    itn_parameter_values(scene, theta);
    for (i = 0; i < 5; i++) parameters[i] = itn_parameter_find(scene, names[i]);
    for (i = 0; i < 3; i++) theta[parameters[place[i]]] = (float)x[i];
    for (i = 0; i < 25; i++)
        covariance[i] = deviations[i / 5] * deviations[i % 5] * (i / 5 == i % 5 ? 1 : .3);
    for (i = 0; i < 3; i++) {
        double h = 1e-5, save = x[i];
        x[i] = save + h, coefficients(x, up), x[i] = save - h, coefficients(x, down), x[i] = save;
        for (k = 0; k < 3; k++) slopes[k][i] = (up[k] - down[k]) / (2 * h);
    }
    coefficients(x, mu);
    for (known = 0; known < 2; known++) { /* then g is not among the unknowns */
        if (known) parameters[0] = itn_parameter_find(scene, "film.exposure");
        CHECK(itn_scene_tissue(scene, theta, "m", 0, parameters, 5, covariance, &tissue) == 1);
        found[0] = tissue.mu_a, found[1] = tissue.mu_s, found[2] = tissue.mu_s_prime;
        errors[0] = tissue.mu_a_error, errors[1] = tissue.mu_s_error;
        errors[2] = tissue.mu_s_prime_error;
        for (k = 0; k < 3; k++) {
            double variance = 0;
            for (i = 0; i < 3 - known; i++)
                for (j = 0; j < 3 - known; j++)
                    variance += slopes[k][i] * slopes[k][j] *
                                covariance[5 * place[i] + place[j]] * (1 + planted);
            CHECK_NEAR(found[k], mu[k], 1e-6 * mu[k]);
            CHECK_NEAR(errors[k], sqrt(variance), 1e-5 * sqrt(variance));
        }
    }
    itn_scene_free(scene);
    itn_mesh_free(&ball);
}

int main(void) {
    int way, channels, sky;
    for (way = 0; way < SOLIDS_WAYS; way++)
        for (channels = 1; channels <= 3; channels += 2)
            for (sky = 0; sky < 2; sky++) {
                test_scaling(channels, sky, way, 0, 0);
                test_background(channels, sky, way, 0);
            }
    test_scaling(1, 1, 0, 1, 0);
    test_inside(0), test_inside(2);
    test_loss(0);
    test_texels();
    test_files();
    test_tissue(0);
    test_unknown(.01, 2, 0);
    if (check_long()) test_unknown(.37, 1, 0), test_unknown(100, 3, 0);
    CHECK_CATCHES(test_scaling(1, 0, 0, 0, 1e-4));
    CHECK_CATCHES(test_scaling(3, 1, 2, 0, 1e-4));
    CHECK_CATCHES(test_background(1, 0, 0, .01));
    CHECK_CATCHES(test_loss(1e-4));
    CHECK_CATCHES(test_tissue(1e-3));
    CHECK_CATCHES(test_unknown(.01, 2, .5));
    return check_end("exposure");
}
