/* Derivative images against finite differences, closed forms and each other.

   A finite difference of renders at the same seeds differs from the true derivative by noise (paths
   that take another turn at the other parameter value) and by terms of fourth order in the step. So
   everything is repeated for BATCHES seeds, and the mean of derivative minus difference must be 0
   within 5 of its measured standard errors, which themselves must be small. */
#ifndef ITN_APART
#define ITN_IMPLEMENTATION
#endif
#include "../itn.h"

#include "check.h"
#include "solids.h"
#include "stage.h"

enum { BATCHES = 16, MOST_PROBES = 8, MOST_REGIONS = 5, SIZE = 16 };

typedef enum scheme {
    CENTRAL, /* four points, error of order step^4 */
    LINEAR,  /* two points, for what the image is linear in */
    FORWARD  /* four points from the value on, error of order step^3 */
} scheme;

typedef struct probe {
    const char *name; /* parameter */
    double step;
    scheme how;
    double largest; /* standard error of the comparison over the image, relative to the derivative */
} probe;

/* Means of a channel's plane: the image and its four blocks of 8 x 8, or with three channels the
   image in each. `layer` is "" or "d_m_g." */
static int region_means(const itn_image *image, const char *layer, int channels, double *means) {
    static const char *const names[2][3] = {{"Y", "", ""}, {"R", "G", "B"}};
    int c, x, y;
    for (c = 0; c < channels; c++) {
        char name[2 * ITN_NAME_SIZE];
        const float *plane;
        snprintf(name, sizeof name, "%s%s", layer, names[channels == 3][c]);
        plane = itn_image_plane(image, name);
        if (!plane) {
            printf("FAILED: no plane %s\n", name);
            exit(1);
        }
        means[c] = 0;
        for (y = 0; channels == 1 && y < 4; y++) means[1 + y] = 0;
        for (y = 0; y < SIZE; y++)
            for (x = 0; x < SIZE; x++) {
                means[c] += plane[y * SIZE + x] / (double)(SIZE * SIZE);
                if (channels == 1)
                    means[1 + 2 * (y / 8) + x / 8] += plane[y * SIZE + x] / 64.;
            }
    }
    return channels == 1 ? MOST_REGIONS : 3;
}

/* Regions' finite difference in parameter `index` at a seed, of images by the reference: there the
   same seed draws the same paths, so that most of the noise goes away in the difference. */
static void difference(const itn_scene *scene, const float *theta, const probe *p, int index,
                       const itn_render_options *options, double *out) {
    static const double offsets[3][4] = {{-2, -1, 1, 2}, {-1, 1, 0, 0}, {0, 1, 2, 3}};
    static const double weights[3][4] = {
        {1 / 12., -8 / 12., 8 / 12., -1 / 12.}, {-.5, .5, 0, 0}, {-11 / 6., 3, -1.5, 1 / 3.}};
    float *moved = (float *)malloc((size_t)itn_parameter_count(scene) * sizeof(float));
    itn_render_options reference = *options;
    int channels = itn_scene_film(scene).channels, k, r, regions;
    reference.mode = ITN_MODE_REFERENCE;
    for (r = 0; r < MOST_REGIONS; r++) out[r] = 0;
    for (k = 0; k < (p->how == LINEAR ? 2 : 4); k++) {
        double means[MOST_REGIONS], step;
        itn_image image = ITN_ZERO;
        itn_error error;
        memcpy(moved, theta, (size_t)itn_parameter_count(scene) * sizeof(float));
        moved[index] = (float)(theta[index] + offsets[p->how][k] * p->step);
        step = p->step;
        stage_need(itn_render(scene, moved, &reference, NULL, 0, &image, &error), &error);
        regions = region_means(&image, "", channels, means);
        for (r = 0; r < regions; r++) out[r] += weights[p->how][k] * means[r] / step;
        itn_image_free(&image);
    }
    free(moved);
}

/* Mean and standard error over the batches. */
static solids_mean batch_mean(const double *values) {
    solids_mean mean = ITN_ZERO;
    int b;
    for (b = 0; b < BATCHES; b++) mean.value += values[b] / BATCHES;
    for (b = 0; b < BATCHES; b++)
        mean.error += (values[b] - mean.value) * (values[b] - mean.value);
    mean.error = sqrt(mean.error / (BATCHES - 1) / BATCHES);
    return mean;
}

/* The variance plane says how much the derivative's mean over the image scatters: 16 batches know
   that to a factor of 2 (chi^2 of 15, 4 sigma), unless rare bright paths rule. */
static void compare_variance(const char *what, solids_mean measured, double claimed) {
    check_report(claimed < 2.5 * measured.error && claimed > .35 * measured.error, __FILE__,
                 __LINE__, "%s: standard error %.3g by the variance plane, %.3g measured", what,
                 claimed, measured.error);
}

/* Checks all probes of a scene; with half of the samples unless tests may be long. planted: relative
   error added to the derivatives. Runs in the scene's own parameter values unless theta is given. */
static void compare(const char *title, const itn_scene *scene, const float *theta, int spp,
                    const probe *probes, int count, double planted) {
    static double exact[MOST_PROBES][MOST_REGIONS][BATCHES];
    static double error[MOST_PROBES][MOST_REGIONS][BATCHES];
    double claimed[MOST_PROBES] = {0}, means[MOST_REGIONS];
    int parameters[MOST_PROBES], channels = itn_scene_film(scene).channels;
    int regions = channels == 1 ? MOST_REGIONS : 3, k, b, r;
    float *made = (float *)malloc((size_t)itn_parameter_count(scene) * sizeof(float));
    if (!theta) itn_parameter_values(scene, made), theta = made;
    for (k = 0; k < count; k++) parameters[k] = itn_parameter_find(scene, probes[k].name);
    for (b = 0; b < BATCHES; b++) {
        itn_render_options options = ITN_ZERO;
        itn_image image = ITN_ZERO;
        itn_error problem;
        options.spp = check_long() ? spp : spp / 2, options.seed = (uint64_t)(1000 + b);
        stage_need(itn_render(scene, theta, &options, parameters, count, &image, &problem),
                   &problem);
        for (k = 0; k < count; k++) {
            char layer[2 * ITN_NAME_SIZE], *dot;
            double fd[MOST_REGIONS];
            snprintf(layer, sizeof layer, "d_%s", probes[k].name);
            dot = strchr(layer, '.');
            if (dot) *dot = '_';
            strcat(layer, ".");
            region_means(&image, layer, channels, means);
            difference(scene, theta, &probes[k], parameters[k], &options, fd);
            for (r = 0; r < regions; r++) {
                exact[k][r][b] = means[r] * (1 + planted);
                error[k][r][b] = exact[k][r][b] - fd[r];
            }
            layer[strlen(layer) - 1] = 0;
            strcat(layer, "_variance.");
            region_means(&image, layer, channels, means);
            claimed[k] += means[0] / (SIZE * SIZE) / BATCHES / BATCHES;
        }
        itn_image_free(&image);
    }
    for (k = 0; k < count; k++) {
        char what[256];
        double scale = 0;
        for (r = 0; r < regions; r++)
            if (channels == 3 || r == 0) scale = fmax(scale, fabs(batch_mean(exact[k][r]).value));
        for (r = 0; r < regions; r++) {
            solids_mean d = batch_mean(exact[k][r]), e = batch_mean(error[k][r]);
            double largest = probes[k].largest * scale * (channels == 1 && r ? 3 : 1);
            if (!check_long()) largest *= 1.5;
            snprintf(what, sizeof what, "%s, %s, region %d: ", title, probes[k].name, r);
            check_report(fabs(e.value) <= 5 * e.error + 1e-4 * scale && e.error <= largest,
                         __FILE__, __LINE__,
                         "%sderivative %.6g +- %.2g, minus difference %.3g +- %.2g (%.1f sigma; "
                         "at most %.2g)", what, d.value, d.error, e.value, e.error,
                         e.value / e.error, largest);
            if (getenv("SHOW"))
                printf("%s%.5g +- %.2g, off %.2g +- %.2g (%.1f%%, %.1f sigma)\n", what, d.value,
                       d.error, e.value, e.error, 100 * e.error / scale, e.value / e.error);
        }
        if (!planted && channels == 1 && batch_mean(exact[k][0]).error > 1e-6 * scale)
            compare_variance(what, batch_mean(exact[k][0]), sqrt(claimed[k]));
    }
    free(made);
}

/* ---- scenes ---------------------------------------------------------------------------------------- */

/* A cloud: an index-matched sphere in two maps and a constant light. */
static void test_index_matched(double planted) {
    static const probe probes[] = {
        {"m.sigma_t", .1, CENTRAL, .1},     {"m.albedo", .03, CENTRAL, .03},
        {"m.g", .06, CENTRAL, .06},        {"light.scale", .2, LINEAR, .02},
        {"left.scale", .5, LINEAR, .02},   {"right.scale", .5, LINEAR, .02},
    };
    itn_mesh mesh = solids_sphere(1, 2);
    itn_image left = stage_patch(1, .25, .5, 3), right = stage_patch(1, .7, .3, 8);
    stage s;
    itn_scene *scene;
    stage_begin(&s, SIZE, 4, 30);
    stage_medium(&s, "m", 2, .8, .4);
    stage_object(&s, &mesh, "m", NULL);
    stage_constant(&s, NULL, .5);
    stage_map(&s, "left", &left);
    stage_map(&s, "right", &right)->scale = 2;
    scene = stage_make(&s);
    compare("index-matched", scene, NULL, 16, probes, planted ? 2 : 6, planted);
    itn_scene_free(scene);
    itn_image_free(&left), itn_image_free(&right);
    itn_mesh_free(&mesh);
}

/* A rough glass sphere full of milk, in a map and a constant light. */
static void test_rough(double planted) {
    static const probe probes[] = {
        {"glass.ior", .04, CENTRAL, .3},  {"glass.alpha", .03, CENTRAL, .2},
        {"m.sigma_t", .15, CENTRAL, .2},  {"m.albedo", .03, CENTRAL, .06},
        {"m.g", .08, CENTRAL, .2},        {"light.scale", .2, LINEAR, .02},
        {"map.scale", .2, LINEAR, .02},
    };
    itn_mesh mesh = solids_sphere(1, 2);
    itn_image map = stage_patch(1, .4, .3, 8);
    stage s;
    itn_scene *scene;
    stage_begin(&s, SIZE, 4, 28);
    stage_medium(&s, "m", 2, .8, .3);
    stage_dielectric(&s, "glass", 1.4, .3);
    stage_object(&s, &mesh, "m", "glass");
    stage_constant(&s, NULL, .2);
    stage_map(&s, "map", &map);
    scene = stage_make(&s);
    compare("rough", scene, NULL, 16, probes, planted ? 2 : 7, planted);
    itn_scene_free(scene);
    itn_image_free(&map);
    itn_mesh_free(&mesh);
}

/* A textured ball and a cloud on a checkered plane under a sky. */
static void test_planes(void) {
    static const probe probes[] = {
        {"floor.reflectance", .1, CENTRAL, .05}, {"floor.reflectance2", .05, CENTRAL, .1},
        {"paint.reflectance", .1, CENTRAL, .05}, {"m.albedo", .05, CENTRAL, .1},
        {"m.sigma_t", .1, CENTRAL, .3},          {"sky.scale", .2, LINEAR, .02},
        {"sky.sun_scale", .2, LINEAR, .05},
    };
    itn_mesh ball = solids_sphere(.7, 2), cloud = solids_sphere(.8, 1);
    itn_image texture = stage_patch(1, .5, .5, .9);
    itn_surface_desc *floor;
    itn_object_desc *object;
    stage s;
    itn_scene *scene;
    stage_begin(&s, SIZE, 5, 40);
    s.desc.camera.eye.y = 1;
    stage_medium(&s, "m", 1.5, .7, .2);
    floor = stage_diffuse(&s, "floor", .8);
    floor->texture = ITN_TEXTURE_CHECKER, floor->reflectance2[0] = .2f, floor->checker_size = .7f;
    floor = stage_diffuse(&s, "paint", .7);
    floor->texture = ITN_TEXTURE_IMAGE, floor->image = &texture;
    stage_object(&s, NULL, NULL, "floor");
    object = stage_object(&s, &ball, NULL, "paint");
    object->transform[0] = object->transform[5] = object->transform[10] = 1;
    object->transform[3] = -.8f, object->transform[7] = -.5f;
    object = stage_object(&s, &cloud, "m", NULL);
    object->transform[0] = object->transform[5] = object->transform[10] = 1;
    object->transform[3] = .8f, object->transform[7] = -.4f;
    stage_sky(&s, "sky");
    scene = stage_make(&s);
    compare("planes", scene, NULL, 16, probes, 7, 0);
    itn_scene_free(scene);
    itn_image_free(&texture);
    itn_mesh_free(&cloud), itn_mesh_free(&ball);
}

/* Three channels: albedo_r is felt by R alone, sigma_t by all. */
static void test_rgb(void) {
    static const probe probes[] = {
        {"m.albedo_r", .04, CENTRAL, .05}, {"m.albedo_b", .04, CENTRAL, .05},
        {"m.sigma_t", .1, CENTRAL, .3},    {"m.g", .08, CENTRAL, .2},
        {"floor.reflectance_g", .1, CENTRAL, .05},
        {"glass.alpha", .03, CENTRAL, .2}, {"light.scale", .2, LINEAR, .02},
    };
    static const char *const zeros[] = {"d_m_albedo_r.G", "d_m_albedo_r.B", "d_m_albedo_b.R",
                                        "d_m_albedo_b.G", "d_floor_reflectance_g.R",
                                        "d_floor_reflectance_g.B"};
    itn_mesh mesh = solids_sphere(1, 2);
    itn_image map = stage_patch(3, .6, .3, 5), image = ITN_ZERO;
    itn_render_options options = ITN_ZERO;
    itn_error error;
    int parameters[3], i, k;
    stage s;
    itn_scene *scene;
    stage_begin(&s, SIZE, 4, 35);
    s.desc.film.channels = 3;
    s.desc.camera.eye.y = 1;
    stage_medium(&s, "m", 2, .8, .3)->albedo[0] = .85f;
    s.media[0].albedo[2] = .5f;
    stage_diffuse(&s, "floor", .6);
    stage_dielectric(&s, "glass", 1.3, .3);
    stage_object(&s, NULL, NULL, "floor");
    stage_object(&s, &mesh, "m", "glass");
    stage_map(&s, NULL, &map);
    scene = stage_make(&s);
    compare("rgb", scene, NULL, 16, probes, 7, 0);
    parameters[0] = itn_parameter_find(scene, "m.albedo_r");
    parameters[1] = itn_parameter_find(scene, "m.albedo_b");
    parameters[2] = itn_parameter_find(scene, "floor.reflectance_g");
    options.spp = 8;
    stage_need(itn_render(scene, NULL, &options, parameters, 3, &image, &error), &error);
    for (k = 0; k < 6; k++) {
        const float *plane = itn_image_plane(&image, zeros[k]);
        double sum = 0;
        for (i = 0; i < SIZE * SIZE; i++) sum += fabs(plane[i]);
        check_report(sum == 0, __FILE__, __LINE__, "%s is not 0 but %g", zeros[k], sum);
    }
    itn_image_free(&image);
    itn_scene_free(scene);
    itn_image_free(&map);
    itn_mesh_free(&mesh);
}

/* A rough solid in a rough solid: the inner boundary feels both indices. */
static void test_nested(void) {
    static const probe probes[] = {
        {"outer.ior", .06, CENTRAL, .12}, {"inner.ior", .1, CENTRAL, .2},
        {"outer.alpha", .04, CENTRAL, .25}, {"inner.alpha", .04, CENTRAL, .25},
        {"shell.sigma_t", .1, CENTRAL, .25}, {"core.sigma_t", .3, CENTRAL, .2},
        {"core.albedo", .05, CENTRAL, .1},
    };
    itn_mesh outer = solids_sphere(1, 2), inner = solids_sphere(.6, 1);
    itn_image map = stage_patch(1, .06, .55, 8);
    stage s;
    itn_scene *scene;
    stage_begin(&s, SIZE, 4, 26);
    stage_medium(&s, "shell", .6, .9, .3);
    stage_medium(&s, "core", 3, .8, 0);
    stage_dielectric(&s, "outer", 1.5, .4);
    stage_dielectric(&s, "inner", 2.2, .4);
    stage_object(&s, &outer, "shell", "outer");
    stage_object(&s, &inner, "core", "inner");
    stage_constant(&s, NULL, .2);
    stage_map(&s, "map", &map);
    scene = stage_make(&s);
    compare("nested", scene, NULL, 20, probes, 7, 0);
    itn_scene_free(scene);
    itn_image_free(&map);
    itn_mesh_free(&inner), itn_mesh_free(&outer);
}

/* ---- factors that are zero ------------------------------------------------------------------------ */

/* Derivatives at albedo 0, reflectance 0, light scale 0 and sigma_t 0, where the path's value is 0
   but its derivative is not: against one-sided differences. */
static void test_zero_factors(double planted) {
    static const probe lone[][1] = {
        {{"m.albedo", .05, FORWARD, .1}},
        {{"floor.reflectance", .1, FORWARD, .1}},
        {{"map.scale", .5, FORWARD, .02}},
        {{"m.sigma_t", .08, FORWARD, .3}},
    };
    static const probe others[] = {
        {"m.sigma_t", .1, CENTRAL, .1}, {"light.scale", .2, LINEAR, .05},
    };
    itn_mesh mesh = solids_sphere(1, 1);
    itn_image map = stage_patch(1, .6, .3, 8);
    float theta[16];
    int k;
    stage s;
    itn_scene *scene;
    stage_begin(&s, SIZE, 4, 35);
    s.desc.camera.eye.y = 1;
    stage_medium(&s, "m", 1, .8, .3);
    stage_diffuse(&s, "floor", .6);
    stage_object(&s, NULL, NULL, "floor");
    stage_object(&s, &mesh, "m", NULL);
    stage_constant(&s, NULL, .3);
    stage_map(&s, "map", &map);
    scene = stage_make(&s);
    for (k = 0; k < (planted ? 1 : 4); k++) {
        char title[64];
        itn_parameter_values(scene, theta);
        theta[itn_parameter_find(scene, lone[k][0].name)] = 0;
        snprintf(title, sizeof title, "zero %.40s", lone[k][0].name);
        compare(title, scene, theta, 16, lone[k], 1, planted);
    }
    if (!planted) { /* several zeros at once: each derivative sees the others as they are */
        static const probe two[] = {{"m.albedo", .05, FORWARD, .1},
                                    {"floor.reflectance", .1, FORWARD, .1}};
        itn_parameter_values(scene, theta);
        theta[itn_parameter_find(scene, "m.albedo")] = 0;
        theta[itn_parameter_find(scene, "floor.reflectance")] = 0;
        compare("two zeros", scene, theta, 16, two, 2, 0);
        compare("two zeros, the rest", scene, theta, 16, others, 2, 0);
    }
    itn_scene_free(scene);
    itn_image_free(&map);
    itn_mesh_free(&mesh);
}

/* In the reference, a path through the cube of test_absorption brings 1 or nothing, its scale's
   derivative is the same and that of sigma_t -2 times it: so the variance of the mean of n samples
   is m (1 - m) / (n - 1), of each pixel, and four times that. planted: factor to the variances. */
static void check_variances(const itn_image *image, int spp, double planted) {
    static const char *const names[3] = {"Variance.Y", "d_light_scale_variance.Y",
                                         "d_m_sigma_t_variance.Y"};
    const float *means = itn_image_plane(image, "Y");
    double worst[3] = {0, 0, 0};
    int i, k;
    for (i = 0; i < SIZE * SIZE; i++)
        for (k = 0; k < 3; k++) {
            double m = (double)means[i], exact = m * (1 - m) / (spp - 1) * (k == 2 ? 4 : 1);
            double found = (double)itn_image_plane(image, names[k])[i] * planted;
            if (!(fabs(found - exact) <= worst[k])) worst[k] = fabs(found - exact) * (spp - 1);
        }
    for (k = 0; k < 3; k++) CHECK_NEAR(worst[k], 0, 1e-4);
}

/* Through an absorbing cube of side 2 the constant light 1 arrives as exp(-2 sigma_t): noise-free
   also in sigma_t = 0, and its scale's derivative is the value itself. */
static void test_absorption(double planted) {
    static const double rates[] = {0, 1e-6, .01, .3, 1, 3};
    itn_mesh mesh = solids_box(solids_vec3(-1, -1, -1), solids_vec3(1, 1, 1));
    int parameters[2], k;
    stage s;
    itn_scene *scene;
    float theta[8];
    stage_begin(&s, SIZE, 4, .01);
    stage_medium(&s, "m", 1, 0, 0);
    stage_object(&s, &mesh, "m", NULL);
    stage_constant(&s, NULL, 1);
    scene = stage_make(&s);
    parameters[0] = itn_parameter_find(scene, "m.sigma_t");
    parameters[1] = itn_parameter_find(scene, "light.scale");
    for (k = 0; k < 6; k++) {
        itn_render_options options = ITN_ZERO;
        itn_image image = ITN_ZERO;
        itn_error error;
        solids_mean value, slope, scale;
        double exact = exp(-2 * rates[k]), bound;
        itn_parameter_values(scene, theta);
        theta[parameters[0]] = (float)rates[k];
        options.spp = 256;
        stage_need(itn_render(scene, theta, &options, parameters, 2, &image, &error), &error);
        value = solids_plane_mean(&image, "Y", "Variance.Y");
        slope = solids_plane_mean(&image, "d_m_sigma_t.Y", "d_m_sigma_t_variance.Y");
        scale = solids_plane_mean(&image, "d_light_scale.Y", "d_light_scale_variance.Y");
        /* at sigma_t near 0, collisions drawn for the derivative's sake make some noise */
        bound = sqrt(exact * (1 - exact) / (256 * SIZE * SIZE)) * 1.2 + .003;
        CHECK_MEAN(value.value, value.error + 1e-6, exact, 4, bound);
        CHECK_MEAN(slope.value, slope.error + 2e-6, -2 * exact, 4, 2 * bound);
        CHECK_NEAR(scale.value, value.value, 1e-6);
        itn_image_free(&image);
        if (rates[k] < .3) continue;
        options.mode = ITN_MODE_REFERENCE;
        stage_need(itn_render(scene, theta, &options, parameters, 2, &image, &error), &error);
        check_variances(&image, options.spp, planted);
        itn_image_free(&image);
    }
    itn_scene_free(scene);
    itn_mesh_free(&mesh);
}

/* ---- exact identities ------------------------------------------------------------------------------ */

/* A scene for the adjoint and the loss: a cloud on a floor. channels 1 or 3; coloured: whether the
   light is. */
static itn_scene *small_scene(int channels, int size, int coloured) {
    itn_mesh mesh = solids_sphere(1, 1);
    itn_image map = stage_patch(coloured ? channels : 1, .6, .3, 8);
    stage s;
    itn_scene *scene;
    stage_begin(&s, size, 4, 35);
    s.desc.film.channels = channels;
    s.desc.camera.eye.y = 1;
    stage_medium(&s, "m", 1.5, .8, .3);
    stage_medium(&s, "unused", 1, .5, 0);
    stage_diffuse(&s, "floor", .6);
    stage_diffuse(&s, "nowhere", .6);
    stage_object(&s, NULL, NULL, "floor");
    stage_object(&s, &mesh, "m", NULL);
    stage_constant(&s, NULL, .3);
    stage_map(&s, "map", &map);
    stage_constant(&s, "dark", 0);
    scene = stage_make(&s);
    itn_image_free(&map);
    itn_mesh_free(&mesh);
    return scene;
}

/* itn_render_gradient is the weighted sum of the derivative planes at the same seed; its variance
   (one channel) that of the variance planes. */
static void test_adjoint(int channels, itn_mode mode, double planted) {
    itn_scene *scene = small_scene(channels, SIZE, 1);
    static float weights[3 * SIZE * SIZE];
    int parameters[5], k, n = channels * SIZE * SIZE, i;
    double gradient[5], variance[5];
    itn_render_options options = ITN_ZERO;
    itn_image image = ITN_ZERO;
    itn_error error;
    const char *names[] = {"m.sigma_t", "m.g", "map.scale", "m.albedo", "floor.reflectance"};
    if (mode == ITN_MODE_FAST) names[2] = "nowhere.reflectance";
    for (k = 0; k < 5; k++) {
        char name[64];
        int coloured = k > 2 || (k == 2 && mode == ITN_MODE_FAST);
        snprintf(name, sizeof name, "%s%s", names[k], channels == 3 && coloured ? "_g" : "");
        parameters[k] = itn_parameter_find(scene, name);
    }
    for (i = 0; i < n; i++) weights[i] = sinf((float)(i * i % 37)) + .2f;
    options.spp = 8, options.seed = 5, options.mode = mode;
    stage_need(itn_render(scene, NULL, &options, parameters, 5, &image, &error), &error);
    stage_need(itn_render_gradient(scene, NULL, &options, weights, parameters, 5, gradient,
                                   variance, &error), &error);
    for (k = 0; k < 5; k++) {
        double sum = 0, size = 0, spread = 0;
        const float *plane = image.pixels + (2 + 2 * k) * n;
        for (i = 0; i < n; i++) {
            double w = weights[i] * (1 + planted);
            sum += w * plane[i], size += fabs(w * plane[i]), spread += w * w * plane[n + i];
        }
        CHECK_NEAR(gradient[k], sum, 1e-6 * size);
        if (channels == 1) CHECK_NEAR(variance[k], spread, 1e-5 * spread);
    }
    /* the same without a variance, and one parameter at a time */
    for (k = 0; k < 5; k++) {
        double alone = 0;
        stage_need(itn_render_gradient(scene, NULL, &options, weights, parameters + k, 1, &alone,
                                       NULL, &error), &error);
        if (k > 0) /* alone, sigma_t of a thick enough medium changes nothing either */
            CHECK_NEAR(alone, gradient[k], 1e-5 * fabs(gradient[k]) + 1e-7);
    }
    itn_image_free(&image);
    itn_scene_free(scene);
}

/* In grey light the channels of a sample are one number, so that the variance of a gradient is that
   of a plane with the sum of the channels' weights. planted: a channel's weight that is left out. */
static void test_grey_adjoint(itn_mode mode, double planted) {
    itn_scene *scene = small_scene(3, SIZE, 0);
    static float weights[3 * SIZE * SIZE];
    static const char *const names[3] = {"m.sigma_t", "m.g", "m.albedo_g"};
    int parameters[3], k, c, i, n = SIZE * SIZE;
    double gradient[3], variance[3];
    itn_render_options options = ITN_ZERO;
    itn_image image = ITN_ZERO;
    itn_error error;
    for (k = 0; k < 3; k++) parameters[k] = itn_parameter_find(scene, names[k]);
    for (i = 0; i < 3 * n; i++) weights[i] = sinf((float)(i * i % 37)) + .2f;
    options.spp = 8, options.seed = 5, options.mode = mode;
    stage_need(itn_render(scene, NULL, &options, parameters, 3, &image, &error), &error);
    stage_need(itn_render_gradient(scene, NULL, &options, weights, parameters, 3, gradient,
                                   variance, &error), &error);
    for (k = 0; k < 3; k++) {
        const float *planes = image.pixels + 6 * (k + 1) * n;
        double spread = 0;
        for (i = 0; i < n; i++) {
            double weight = 0;
            for (c = 0; c < 3; c++)
                if (k < 2 || c == 1)
                    weight += (double)weights[c * n + i] * (c == 1 ? 1 - planted : 1);
            spread += weight * weight * (double)planes[(3 + 1) * n + i];
        }
        CHECK_NEAR(variance[k], spread, 1e-4 * spread);
    }
    itn_image_free(&image);
    itn_scene_free(scene);
}

/* What cannot matter has a derivative of exactly 0, with variance 0. */
static void test_idle_parameters(void) {
    static const char *const names[] = {"unused.sigma_t", "unused.albedo", "unused.g",
                                        "nowhere.reflectance", "dark.scale"};
    itn_scene *scene = small_scene(1, SIZE, 1);
    itn_render_options options = ITN_ZERO;
    itn_image image = ITN_ZERO;
    itn_error error;
    int parameters[5], k, i;
    for (k = 0; k < 5; k++) parameters[k] = itn_parameter_find(scene, names[k]);
    options.spp = 16;
    stage_need(itn_render(scene, NULL, &options, parameters, 5, &image, &error), &error);
    for (k = 0; k < 5; k++) {
        double sum = 0;
        for (i = 0; i < 2 * SIZE * SIZE; i++)
            sum += fabs(image.pixels[(2 + 2 * k) * SIZE * SIZE + i]);
        check_report(sum == 0, __FILE__, __LINE__, "%s has a derivative: %g", names[k], sum);
    }
    itn_image_free(&image);
    itn_scene_free(scene);
}

/* ---- the loss --------------------------------------------------------------------------------------- */

enum { LOSS_SIZE = 6, LOSS_PIXELS = LOSS_SIZE * LOSS_SIZE };

/* Mean over pixels of (E I - target)^2 from many samples, the noise of squaring taken off. */
static double expected_loss(const itn_scene *scene, const float *theta, const float *target,
                            uint64_t seed) {
    itn_render_options options = ITN_ZERO;
    itn_image image = ITN_ZERO;
    itn_error error;
    double sum = 0;
    int i;
    options.spp = check_long() ? 4096 : 768, options.seed = seed;
    stage_need(itn_render(scene, theta, &options, NULL, 0, &image, &error), &error);
    for (i = 0; i < LOSS_PIXELS; i++) {
        double residual = (double)image.pixels[i] - target[i];
        sum += residual * residual - image.pixels[LOSS_PIXELS + i];
    }
    itn_image_free(&image);
    return sum / LOSS_PIXELS;
}

/* The gradient that uses the same samples for value and derivative: wrong by their covariance. */
static void same_samples_gradient(const itn_scene *scene, const float *theta,
                                  const itn_render_options *options, const float *target,
                                  const int *parameters, int count, double *loss,
                                  double *gradient) {
    itn_image image = ITN_ZERO;
    itn_error error;
    int i, k;
    stage_need(itn_render(scene, theta, options, parameters, count, &image, &error), &error);
    *loss = 0;
    for (k = 0; k < count; k++) gradient[k] = 0;
    for (i = 0; i < LOSS_PIXELS; i++) {
        double residual = (double)image.pixels[i] - target[i];
        *loss += residual * residual / LOSS_PIXELS;
        for (k = 0; k < count; k++)
            gradient[k] += 2 * residual / LOSS_PIXELS * image.pixels[(2 + 2 * k) * LOSS_PIXELS + i];
    }
    itn_image_free(&image);
}

/* The gradient of the loss by differences at many samples, four seeds, then the loss itself, with
   standard errors; worked out once. */
enum { LOSS_COUNT = 3 };
static void expect_losses(const itn_scene *scene, const float *target, const int *parameters,
                          double *exact, double *error) {
    static const double steps[LOSS_COUNT] = {.1, .04, .1};
    static double means[LOSS_COUNT + 1], errors[LOSS_COUNT + 1];
    float theta[32];
    int k, i;
    itn_parameter_values(scene, theta);
    for (k = 0; k < LOSS_COUNT && means[LOSS_COUNT] == 0; k++) {
        float value = theta[parameters[k]];
        double fd[4], spread = 0;
        for (i = 0; i < 4; i++) {
            theta[parameters[k]] = (float)(value + steps[k]);
            fd[i] = expected_loss(scene, theta, target, (uint64_t)i);
            theta[parameters[k]] = (float)(value - steps[k]);
            fd[i] -= expected_loss(scene, theta, target, (uint64_t)i);
            fd[i] /= 2 * steps[k], means[k] += fd[i] / 4;
            theta[parameters[k]] = value;
        }
        for (i = 0; i < 4; i++) spread += (fd[i] - means[k]) * (fd[i] - means[k]);
        errors[k] = sqrt(spread / 12);
    }
    for (i = 0; i < 4 && k == LOSS_COUNT; i++)
        means[LOSS_COUNT] += expected_loss(scene, theta, target, (uint64_t)(i + 10)) / 4;
    memcpy(exact, means, sizeof means), memcpy(error, errors, sizeof errors);
}

/* At 2 samples per pixel, loss and gradient are right in the mean over many seeds. */
static void test_loss(int same_samples) {
    enum { SEEDS = 700, COUNT = LOSS_COUNT };
    static const char *const names[COUNT] = {"m.sigma_t", "m.albedo", "map.scale"};
    itn_scene *scene = small_scene(1, LOSS_SIZE, 1);
    float target[LOSS_PIXELS], theta[32];
    double sum[COUNT + 1] = {0}, square[COUNT + 1] = {0}, exact[COUNT + 1], error[COUNT + 1];
    double values[COUNT + 1];
    int parameters[COUNT], k, i, seed;
    for (i = 0; i < LOSS_PIXELS; i++) target[i] = .2f + .02f * (float)(i % 7);
    for (k = 0; k < COUNT; k++) parameters[k] = itn_parameter_find(scene, names[k]);
    itn_parameter_values(scene, theta);
    expect_losses(scene, target, parameters, exact, error);
    for (seed = 0; seed < SEEDS; seed++) {
        itn_render_options options = ITN_ZERO;
        itn_error problem;
        options.spp = 2, options.seed = (uint64_t)seed;
        if (same_samples)
            same_samples_gradient(scene, theta, &options, target, parameters, COUNT,
                                  &values[COUNT], values);
        else
            stage_need(itn_loss_gradient(scene, theta, &options, target, parameters, COUNT,
                                         &values[COUNT], values, &problem), &problem);
        for (k = 0; k <= COUNT; k++) sum[k] += values[k], square[k] += values[k] * values[k];
    }
    for (k = 0; k <= COUNT; k++) {
        double mean = sum[k] / SEEDS;
        double spread = hypot(sqrt((square[k] / SEEDS - mean * mean) / SEEDS), error[k]);
        if (getenv("SHOW"))
            printf("loss %d: %.5g +- %.2g, expected %.5g (%.1f sigma)\n", k, mean, spread, exact[k],
                   (mean - exact[k]) / spread);
        CHECK_MEAN(mean, spread, exact[k], 4.5, .12 * fabs(exact[k]));
    }
    itn_scene_free(scene);
}

/* ---- what has no derivative -------------------------------------------------------------------------- */

/* The derivative in `surface`.ior of a sphere in a sphere. */
static itn_result ior_derivative(double outer_ior, double outer_alpha, double inner_ior,
                                 double inner_alpha, const char *name, itn_error *error) {
    itn_mesh outer = solids_sphere(1, 1), inner = solids_sphere(.5, 1);
    itn_image image = ITN_ZERO;
    itn_render_options options = ITN_ZERO;
    itn_result result, again;
    stage s;
    itn_scene *scene;
    int parameter;
    double gradient = 7, loss = 7;
    static float weights[16];
    stage_begin(&s, 4, 4, 30);
    stage_dielectric(&s, "outer", outer_ior, outer_alpha);
    stage_dielectric(&s, "inner", inner_ior, inner_alpha);
    stage_object(&s, &outer, NULL, "outer");
    stage_object(&s, &inner, NULL, "inner");
    stage_constant(&s, NULL, 1);
    scene = stage_make(&s);
    options.spp = 2;
    parameter = itn_parameter_find(scene, name);
    memset(error, 0, sizeof *error);
    result = itn_render(scene, NULL, &options, &parameter, 1, &image, error);
    if (result) { /* all three refuse alike, and touch nothing */
        CHECK(image.pixels == NULL && image.width == 0);
        again = itn_render_gradient(scene, NULL, &options, weights, &parameter, 1, &gradient, NULL,
                                    NULL);
        CHECK(again == result && gradient == 7);
        again = itn_loss_gradient(scene, NULL, &options, weights, &parameter, 1, &loss, &gradient,
                                  NULL);
        CHECK(again == result && gradient == 7 && loss == 7);
        CHECK(error->code == result && (parameter < 0 || strstr(error->message, name)));
    }
    itn_image_free(&image);
    itn_scene_free(scene);
    itn_mesh_free(&inner), itn_mesh_free(&outer);
    return result;
}

static void test_unsupported(void) {
    itn_error error;
    CHECK(ior_derivative(1.5, .2, 1.7, .2, "outer.ior", &error) == ITN_OK);
    CHECK(ior_derivative(1.5, .2, 1.7, .2, "inner.ior", &error) == ITN_OK);
    CHECK(ior_derivative(1.5, .2, 1.7, 0, "inner.alpha", &error) == ITN_ERROR_ARGUMENT);
    CHECK(ior_derivative(1.5, 0, 1.7, .2, "outer.ior", &error) == ITN_ERROR_UNSUPPORTED);
    CHECK(ior_derivative(1.5, .2, 1.7, 0, "inner.ior", &error) == ITN_ERROR_UNSUPPORTED);
    CHECK(ior_derivative(1, .2, 1.7, .2, "outer.ior", &error) == ITN_ERROR_UNSUPPORTED);
    /* the inner solid's boundary, smooth, also turns with the index around it */
    CHECK(ior_derivative(1.5, .2, 1.7, 0, "outer.ior", &error) == ITN_ERROR_UNSUPPORTED);
    /* equal indices: the inner boundary vanishes as it does at index 1 in empty space */
    CHECK(ior_derivative(1.5, .2, 1.5, .2, "inner.ior", &error) == ITN_ERROR_UNSUPPORTED);
}
int main(void) {
    test_index_matched(0);
    test_rough(0);
    test_planes();
    test_rgb();
    test_nested();
    test_zero_factors(0);
    test_absorption(1);
    test_adjoint(1, ITN_MODE_REFERENCE, 0), test_adjoint(3, ITN_MODE_REFERENCE, 0);
    test_adjoint(1, ITN_MODE_FAST, 0), test_adjoint(3, ITN_MODE_FAST, 0);
    test_grey_adjoint(ITN_MODE_REFERENCE, 0), test_grey_adjoint(ITN_MODE_FAST, 0);
    test_idle_parameters();
    test_loss(0);
    test_unsupported();
    CHECK_CATCHES(test_index_matched(.5));
    CHECK_CATCHES(test_absorption(1.01));
    CHECK_CATCHES(test_grey_adjoint(ITN_MODE_FAST, .01));
    CHECK_CATCHES(test_zero_factors(.5));
    CHECK_CATCHES(test_adjoint(1, ITN_MODE_REFERENCE, 1e-4));
    CHECK_CATCHES(test_loss(1));
    return check_end("derivatives");
}
