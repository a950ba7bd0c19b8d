/* Maps that tilt normals, blends and measured surfaces: images in constant light against formulas,
   derivatives against formulas, differences and each other, a table made of a formula, its sampler,
   and what is refused. */
#define ITN_IMPLEMENTATION
#include "../itn.h"
#include "check.h"
#include "solids.h"
#include "stage.h"

enum { MAPS_SIDE = 16, MAPS_TEXELS = MAPS_SIDE * MAPS_SIDE, MAPS_CELLS = 90 * 90 * 180 };
static const double maps_pi = 3.14159265358979323846, maps_slope[2] = {.5, .3};

/* A PFM file of values(column, row from the top, channel). */
static itn_file maps_file(const char *name, int channels, double (*value)(int, int, int)) {
    const size_t head = 12, size = head + sizeof(float) * (size_t)channels * MAPS_TEXELS;
    char *bytes = (char *)malloc(size);
    float v;
    itn_file file;
    file.name = name, file.bytes = bytes, file.size = size;
    memcpy(bytes, channels == 1 ? "Pf\n16 16\n-1\n" : "PF\n16 16\n-1\n", head);
    for (int k = 0; k < channels * MAPS_TEXELS; k++) { /* from the lowest row on */
        int texel = k / channels, row = MAPS_SIDE - 1 - texel / MAPS_SIDE;
        v = (float)value(texel % MAPS_SIDE, row, k % channels);
        memcpy(bytes + head + sizeof v * (size_t)k, &v, sizeof v);
    }
    return file;
}
/* A ramp whose seam is far from texture coordinates 0, and its normal. */
static double maps_ramp(int column, int row, int c) {
    double s = (column + .5) / MAPS_SIDE, t = 1 - (row + .5) / MAPS_SIDE;
    (void)c;
    return maps_slope[0] * (s > .5 ? s - 1 : s) + maps_slope[1] * (t > .5 ? t - 1 : t);
}
static double maps_normal(int column, int row, int c) {
    double n[3] = {-maps_slope[0], -maps_slope[1], 1};
    (void)column, (void)row;
    return .5 + .5 * n[c] / sqrt(n[0] * n[0] + n[1] * n[1] + 1);
}
static double maps_waves(int column, int row, int c) {
    (void)c;
    return .1 * sin(maps_pi / 4 * column) * cos(maps_pi / 4 * row);
}

static itn_file maps_files[5];

static itn_scene *maps_scene(const char *surfaces, const char *object, double height) {
    char text[1500];
    itn_scene *scene;
    itn_error error;
    snprintf(text, sizeof text, "film width 4 height 4 background 0\n"
             "camera eye .02 %g 0 target .02 0 .001 up 0 0 1 fov 10\n%s\nobject %s\n"
             "light constant radiance 1\n", height, surfaces, object);
    stage_need(itn_scene_from_memory(text, strlen(text), NULL, maps_files, 5, NULL, &scene, &error),
               &error);
    return scene;
}
static solids_mean maps_mean(const char *surfaces, const char *object, double height,
                             itn_mode mode, const char *by, int spp) {
    itn_scene *scene = maps_scene(surfaces, object, height);
    itn_render_options options = ITN_ZERO;
    solids_mean found[2];
    options.spp = spp, options.mode = mode;
    solids_measure(scene, NULL, &options, &by, by != NULL, found);
    itn_scene_free(scene);
    return found[by != NULL];
}

/* ---- tilts ----------------------------------------------------------------------------------- */

/* A diffuse plane tilted by an angle has rho (1 + cos) / 2 in a constant light; from both sides. */
static void test_tilt(double planted) {
    static const char *const maps[2] = {"bump ramp.pfm bump_scale 1", "normal normal.pfm"};
    double square = maps_slope[0] * maps_slope[0] + maps_slope[1] * maps_slope[1];
    double truth = .4 * (1 + 1 / sqrt(1 + square)) * (1 + planted);
    for (int k = 0; k < 8; k++) {
        itn_mode mode = k & 1 ? ITN_MODE_FAST : ITN_MODE_REFERENCE;
        char surface[100];
        snprintf(surface, sizeof surface, "surface s type diffuse reflectance .8 %s", maps[k / 4]);
        solids_mean m = maps_mean(surface, "plane surface s", k & 2 ? -.5 : .5, mode, NULL, 2000);
        CHECK_MEAN(m.value, m.error, truth, 4, .0015);
    }
    truth = -.4 * square * pow(1 + square, -1.5) * (1 + planted); /* by the scale, at 1 */
    solids_mean m = maps_mean("surface s type diffuse reflectance .8 bump ramp.pfm",
                              "plane surface s", .5, ITN_MODE_AUTO, "s.bump_scale", 4000);
    CHECK_MEAN(m.value, m.error, truth, 4, .003);
    m = maps_mean("surface s type diffuse reflectance .8 bump ramp.pfm bump_scale 0",
                  "plane surface s", .5, ITN_MODE_AUTO, NULL, 16);
    CHECK_NEAR(m.value, .8, 1e-6);
}

/* From descs; of a PNG file's image the codes count, not their light. */
static void test_tilt_codes(double planted) {
    static char names[3][ITN_NAME_SIZE] = {"R", "G", "B"};
    static const float code[3] = {.25f, .5f, .9f}; /* light by the curve of sRGB: */
    static const float light[3] = {.0508760887f, .214041140f, .787412289f};
    float pixels[2][12], normal[2];
    for (int k = 0; k < 2; k++) {
        itn_image map = ITN_ZERO;
        itn_render_options options = ITN_ZERO;
        solids_mean found;
        stage s;
        stage_begin(&s, 8, 3, 20);
        for (int i = 0; i < 12; i++) pixels[k][i] = (k ? light : code)[i / 4];
        map.width = map.height = 2, map.plane_count = 3, map.names = names, map.pixels = pixels[k];
        map.codes = k ? 255 : 0;
        stage_diffuse(&s, "s", .8)->normal = &map;
        stage_object(&s, NULL, NULL, "s")->half_size = 100;
        stage_constant(&s, "lamp", 1);
        itn_scene *scene = stage_make(&s);
        options.spp = 50, options.mode = ITN_MODE_REFERENCE;
        solids_measure(scene, NULL, &options, NULL, 0, &found);
        normal[k] = (float)found.value;
        itn_scene_free(scene);
    }
    CHECK_NEAR(normal[1] * (1 + planted), normal[0], 2e-4);
    CHECK(fabsf(normal[0] - .8f) > .01f);
}

/* Which way: light from +x, -x, +z, -z on a plane whose normal leans to -x and, as bitangents are
   normal x tangent, by that map to +z, by heights to -z; seen from above and from below. */
static double maps_lit; /* where the light is, in turns from -z */
static double maps_lamp(int column, int row, int c) {
    double turn = (column + .5) / MAPS_SIDE - maps_lit;
    (void)c;
    return row > 4 && row < 11 && fabs(turn - floor(turn + .5)) < .13 ? 10 : 0;
}
static void test_tilt_ways(int planted) {
    static const double sides[4] = {.25, .75, .5, 0}; /* +x -x +z -z */
    for (int k = 0; k < 4; k++) {
        double seen[4];
        for (int j = 0; j < 4; j++) {
            char text[200];
            solids_mean m;
            itn_scene *scene;
            itn_error error;
            itn_render_options options = ITN_ZERO;
            maps_lit = sides[j];
            itn_file files[2] = {maps_files[k / 2], maps_file("lamp.pfm", 1, maps_lamp)};
            snprintf(text, sizeof text, "film width 4 height 4\ncamera eye .02 %g 0 target .02 0 "
                     ".001 up 0 0 1 fov 10\nsurface s type diffuse reflectance .8 %s %s\n"
                     "object plane surface s\nlight map lamp.pfm", k % 2 ? -.5 : .5,
                     k / 2 ? "normal" : "bump", files[0].name);
            stage_need(itn_scene_from_memory(text, strlen(text), NULL, files, 2, NULL, &scene,
                                             &error), &error);
            options.spp = 200, options.mode = ITN_MODE_REFERENCE;
            solids_measure(scene, NULL, &options, NULL, 0, &m);
            seen[j] = m.value;
            itn_scene_free(scene);
            free((void *)(uintptr_t)files[1].bytes);
        }
        int below = k % 2, to_z = (k / 2 != 0) ^ below ^ planted;
        CHECK(below ? seen[0] > 1.2 * seen[1] : seen[1] > 1.2 * seen[0]);
        CHECK(to_z ? seen[2] > 1.1 * seen[3] : seen[3] > 1.1 * seen[2]);
    }
}

/* Slopes of an image by the scale of heights against its differences by the same random numbers. */
static void test_tilt_slopes(const char *surface, const char *object, int spp, double planted) {
    itn_scene *scene = maps_scene(surface, object, 3);
    itn_render_options options = ITN_ZERO;
    const char *by = "s.bump_scale";
    int at = itn_parameter_find(scene, by);
    float theta[20], h = .05f;
    solids_mean found[2], ends[2];
    options.spp = spp, options.mode = ITN_MODE_REFERENCE;
    itn_parameter_values(scene, theta);
    solids_measure(scene, theta, &options, &by, 1, found);
    options.spp = 4 * spp;
    for (int k = 0; k < 2; k++) {
        theta[at] += k ? 2 * h : -h;
        solids_measure(scene, theta, &options, NULL, 0, &ends[k]);
    }
    double slope = (ends[1].value - ends[0].value) / (2 * (double)h), error = ends[0].error / h;
    if (getenv("SHOW")) printf("%s: %g +- %g, %g +- %g\n", surface, found[1].value, found[1].error,
                               slope, error);
    CHECK_NEAR(found[1].value * (1 + planted), slope, 4 * hypot(found[1].error, error));
    itn_scene_free(scene);
}

/* Heights times what the image has by them add up to scale times what it has by that, path by path;
   by normals to a formula. */
static void test_tilt_texels(double planted) {
    float weights[3 * 16];
    itn_render_options options = ITN_ZERO;
    itn_image image;
    itn_error error;
    double sum[3] = {0, 0, 0}, m[3] = {-maps_slope[0], -maps_slope[1], 1}, square = 0;
    for (int k = 0; k < 48; k++) weights[k] = 1 / 16.f;
    options.spp = 2000, options.mode = ITN_MODE_REFERENCE;
    itn_scene *scene = maps_scene("surface s type diffuse reflectance .8 bump ramp.pfm",
                                  "plane surface s", .5);
    int at = itn_parameter_find(scene, "s.bump_scale");
    double whole;
    stage_need(itn_render_gradient(scene, NULL, &options, weights, &at, 1, &whole, NULL, &error),
               &error);
    stage_need(itn_render_texel_gradient(scene, NULL, &options, weights, "s.bump", &image, &error),
               &error);
    CHECK(image.plane_count == 2 && image.width == MAPS_SIDE && !strcmp(image.names[0], "Y"));
    for (int k = 0; k < MAPS_TEXELS; k++)
        sum[0] += (double)image.pixels[k] * maps_ramp(k % MAPS_SIDE, k / MAPS_SIDE, 0);
    CHECK_NEAR(sum[0] * (1 + planted), whole, 1e-3 * fabs(whole));
    CHECK(itn_render_texel_gradient(scene, NULL, &options, weights, "s", &image, &error) ==
          ITN_ERROR_ARGUMENT);
    itn_image_free(&image);
    itn_scene_free(scene);
    scene = maps_scene("surface s type diffuse reflectance .8 normal normal.pfm",
                       "plane surface s", .5);
    stage_need(itn_render_texel_gradient(scene, NULL, &options, weights, "s.normal", &image,
                                         &error), &error);
    CHECK(image.plane_count == 6 && !strcmp(image.names[2], "B"));
    for (int k = 0; k < 3; k++) square += m[k] * m[k], sum[k] = 0;
    for (int k = 0; k < 3 * MAPS_TEXELS; k++) sum[k / MAPS_TEXELS] += (double)image.pixels[k];
    for (int k = 0; k < 3; k++) { /* of .4 (1 + b / |m|) by 2 m */
        double truth = .8 * ((k == 2) - m[k] / square);
        CHECK_NEAR(sum[k] * (1 + planted), truth, .15 * fabs(truth));
    }
    CHECK_NEAR(sum[0] * m[0] + sum[1] * m[1] + sum[2] * m[2], 0, 1e-4); /* longer is no other */
    itn_image_free(&image);
    itn_scene_free(scene);
}

/* ---- blends ---------------------------------------------------------------------------------- */

#define MAPS_PARTS                                                                                 \
    "surface a type diffuse reflectance .8\n"                                                      \
    "surface b type conductor eta .2 k 3 alpha .3\nsurface c type mirror reflectance .5\n"
/* A blend's image is the sum of its parts' times weights, which are its slopes. */
static void test_blend(double planted) {
    static const char *const parts[3] = {"plane surface a", "plane surface b", "plane surface c"};
    static const char *const by[3] = {"s.weight1", "s.weight2", "s.weight3"};
    const char *blend = MAPS_PARTS "surface s type blend surfaces a b c weights .5 .2 .1";
    for (int k = 0; k < 2; k++) {
        itn_mode mode = k ? ITN_MODE_FAST : ITN_MODE_REFERENCE;
        solids_mean each[3], whole = maps_mean(blend, "plane surface s", 3, mode, NULL, 1000);
        for (int p = 0; p < 3; p++) {
            each[p] = maps_mean(MAPS_PARTS, parts[p], 3, mode, NULL, 300);
            solids_mean slope = maps_mean(blend, "plane surface s", 3, mode, by[p], 4000);
            CHECK_MEAN(slope.value * (1 + planted), hypot(slope.error, each[p].error),
                       each[p].value, 4, .02);
        }
        CHECK_MEAN(whole.value, whole.error, .5 * each[0].value + .2 * each[1].value +
                   .1 * each[2].value, 4, .01);
    }
    solids_mean m = maps_mean(MAPS_PARTS "surface s type blend surfaces a b weights .5 0",
                              "plane surface s", 3, ITN_MODE_AUTO, "s.weight2", 2000);
    solids_mean part = maps_mean(MAPS_PARTS, parts[1], 3, ITN_MODE_REFERENCE, NULL, 300);
    CHECK_MEAN(m.value, hypot(m.error, part.error), part.value, 4, .02);
}

#define MAPS_SLAB "mesh slab.obj medium m surface s"
/* A blend that is tilted as a whole is one of tilted parts; one with a map of its own keeps it. */
static void test_tilted_blend(double planted) {
    for (int k = 0; k < 4; k++) {
        itn_mode mode = k % 2 ? ITN_MODE_FAST : ITN_MODE_REFERENCE;
        const char *own = k / 2 ? "bump ramp.pfm" : "", *whole = k / 2 ? "" : "bump ramp.pfm";
        double cosine = 1 / sqrt(1 + maps_slope[0] * maps_slope[0] + maps_slope[1] * maps_slope[1]);
        char text[300];
        snprintf(text, sizeof text, "surface a type diffuse reflectance .8 %s\n"
                 "surface b type diffuse reflectance .2 normal normal.pfm\n"
                 "surface s type blend surfaces a b weights .6 .2 %s", own, whole);
        solids_mean m = maps_mean(text, "plane surface s", .5, mode, NULL, 1000);
        CHECK_MEAN(m.value * (1 + planted), m.error, .26 * (1 + cosine), 4, .005);
    }
}

/* What loses nothing looks as the light around it: glass, or nothing, coated white, with a medium
   inside that scatters all. */
static void test_coated(const char *glass, double white) {
    for (int k = 0; k < 2; k++) {
        char text[400];
        snprintf(text, sizeof text, "medium m sigma_t 1 albedo 1\nsurface g type dielectric %s\n"
                 "surface w type diffuse reflectance %g\n"
                 "surface s type blend surfaces g w weights .7 .3", glass, white);
        solids_mean m = maps_mean(text, MAPS_SLAB, 3, k ? ITN_MODE_FAST : ITN_MODE_REFERENCE, NULL,
                                  100);
        CHECK_MEAN(m.value, m.error + 5e-4, 1, 4, .02);
    }
}

/* Both walks see the same of tilted glass, rough and smooth, and of a blend tilted as a whole. */
static void test_tilted_solids(double planted) {
    static const char *const surfaces[3] = {
        "surface s type dielectric alpha .4 bump waves.pfm",
        "surface s type dielectric bump waves.pfm bump_scale .5",
        "surface g type dielectric alpha .2\nsurface w type diffuse reflectance .5\n"
        "surface s type blend surfaces g w weights .7 .2 bump waves.pfm"};
    for (int k = 0; k < 3; k++) {
        char text[400];
        solids_mean m[2];
        snprintf(text, sizeof text, "medium m sigma_t 2 albedo .8\n%s", surfaces[k]);
        for (int j = 0; j < 2; j++)
            m[j] = maps_mean(text, MAPS_SLAB, 3, j ? ITN_MODE_FAST : ITN_MODE_REFERENCE, NULL,
                             j ? 500 : 2000);
        CHECK_MEAN(m[0].value * (1 + planted), hypot(m[0].error, m[1].error), m[1].value, 4, .007);
    }
}

/* ---- measured -------------------------------------------------------------------------------- */

/* rho / pi and GGX of alpha .3 with F = 1. */
static double maps_brdf(const double i[3], const double o[3], double rho) {
    double h[3], length = 0, ih = 0, t, g = 1, a2 = .09;
    for (int k = 0; k < 3; k++) h[k] = i[k] + o[k], length += h[k] * h[k];
    for (int k = 0; k < 3; k++) h[k] /= sqrt(length), ih += h[k] * i[k];
    t = (1 - h[2] * h[2]) / a2 + h[2] * h[2];
    for (int k = 0; k < 2; k++) {
        double z = k ? o[2] : i[2];
        g *= 2 / (1 + sqrt(1 + a2 * (1 / (z * z) - 1)));
    }
    return rho / maps_pi + .3 * g / (maps_pi * a2 * t * t) / (4 * i[2] * o[2]);
}
static itn_file maps_table(void) {
    static const double scale[3] = {1 / 1500., 1.15 / 1500, 1.66 / 1500};
    size_t size = 12 + 24 * (size_t)MAPS_CELLS;
    unsigned char *bytes = (unsigned char *)malloc(size);
    const int sizes[3] = {90, 90, 180};
    itn_file file;
    file.name = "table.binary", file.bytes = bytes, file.size = size;
    for (int k = 0; k < 12; k++) bytes[k] = (unsigned char)(sizes[k / 4] >> k % 4 * 8 & 255);
    for (int at = 0; at < MAPS_CELLS; at++) {
        double x = at / 16200 + .5, y = at / 180 % 90 + .5, z = at % 180 + .5, w[2][3];
        double th = maps_pi / 2 * x * x / 8100, td = maps_pi / 180 * y, pd = maps_pi / 180 * z;
        for (int k = 0; k < 2; k++) { /* i and o, half-way to which is h */
            double side = k ? -1 : 1, a = side * sin(td) * cos(pd), b = side * sin(td) * sin(pd);
            w[k][0] = cos(th) * a + sin(th) * cos(td), w[k][1] = b;
            w[k][2] = cos(th) * cos(td) - sin(th) * a;
        }
        for (int c = 0; c < 3; c++) {
            double f = w[0][2] > 0 && w[1][2] > 0 ? maps_brdf(w[0], w[1], .1 * (c + 1)) : -1;
            uint64_t bits;
            f = f < 0 ? -1 : f / scale[c];
            memcpy(&bits, &f, 8);
            for (int k = 0; k < 8; k++)
                bytes[12 + 8 * ((size_t)c * MAPS_CELLS + (size_t)at) + (size_t)k] =
                    (unsigned char)(bits >> 8 * k & 255);
        }
    }
    return file;
}

/* The table against its formula in each channel, and how many draws fall in boxes of the hemisphere
   against the integral of the density. */
static void test_measured(double mu, double planted) {
    enum { DRAWS = 60000, BOXES = 6, TURNS = 8, FINE = 24 };
    static const char text[] = "film channels 3\ncamera eye 0 1 0 target 0 0 .1\nsurface s type "
                               "measured table.binary\nobject plane surface s\n"
                               "light constant radiance 1";
    itn_scene *scene;
    itn_error error;
    itn__site site;
    itn__factor f;
    itn__floats pdf;
    itn__ints through;
    int counts[BOXES][TURNS] = {{0}};
    float theta[20], sine = (float)sqrt(1 - mu * mu);
    itn__vectors n = itn__splat_vector(itn__vec3(0, 0, 1));
    itn__vectors d = itn__splat_vector(itn__vec3(-.6f * sine, -.8f * sine, -(float)mu));
    itn__rng rng = itn__rng_make(5, 6, 7);
    stage_need(itn_scene_from_memory(text, sizeof text - 1, NULL, maps_files, 5, NULL, &scene,
                                     &error), &error);
    itn_parameter_values(scene, theta);
    f.count = 0;
    for (int k = 0; k < DRAWS; k += ITN__LANES) {
        itn__floats u[3];
        itn__vectors o;
        itn__site_make(&site, scene->surfaces, theta, 3, &n, NULL, &d);
        for (int c = 0; c < 3; c++)
            for (int l = 0; l < ITN__LANES; l++) ITN__LANE(u[c], l) = itn__uniform(&rng);
        itn__ints good = itn__bsdf_sample(&site, u, &o, &f, &pdf, &through);
        o = itn__vto_local(o, site.frame[0], site.frame[1], site.frame[2]);
        for (int l = 0; l < ITN__LANES; l++) {
            double turn = atan2(ITN__LANE(o.y, l), ITN__LANE(o.x, l)) / (2 * maps_pi) + .5;
            int box = (int)(BOXES * (double)ITN__LANE(o.z, l)), t = (int)(turn * TURNS) % TURNS;
            if (ITN__LANE(good, l)) counts[box < BOXES ? box : BOXES - 1][t]++;
        }
    }
    for (int at = 0; at < BOXES * TURNS; at++) {
        double expected = 0;
        for (int k = 0; k < FINE * FINE; k++) {
            double z = (at / TURNS + (k / FINE + .5) / FINE) / BOXES, r = sqrt(1 - z * z);
            double phi = 2 * maps_pi * ((at % TURNS + (k % FINE + .5) / FINE) / TURNS - .5);
            double i[3], o[3] = {r * cos(phi), r * sin(phi), z};
            itn_vec3 local = itn__vec3((float)o[0], (float)o[1], (float)o[2]);
            itn__vectors to = itn__splat_vector(local);
            to = itn__vto_world(to, site.frame[0], site.frame[1], site.frame[2]);
            itn__bsdf_eval(&site, &to, &f, &pdf, &through);
            expected += DRAWS * (double)ITN__LANE(pdf, 0) * 2 * maps_pi /
                        ((double)BOXES * TURNS * FINE * FINE) * (1 + planted);
            i[0] = ITN__LANE(site.i.x, 0), i[1] = ITN__LANE(site.i.y, 0), i[2] = mu;
            for (int c = 0; c < 3 && z > .05 && k % 7 == 0; c++)
                CHECK_NEAR(ITN__LANE(f.value[c], 0) / z / maps_brdf(i, o, .1 * (c + 1)), 1, .01);
        }
        CHECK_NEAR(counts[at / TURNS][at % TURNS], expected, 5 * sqrt(expected) + .03 * expected);
    }
    itn_scene_free(scene);
}

/* ---- what is refused ------------------------------------------------------------------------- */

static void test_maps_refused(void) {
    static const char *const cases[][2] = {
        {"surface s type blend surfaces a weights .5 .1", "a blend has 1 and 2"},
        {"surface s type blend surfaces a x weights .5 .1", "there is no surface 'x'"},
        {"surface s type blend surfaces a s weights .5 .1", "'s' is a blend, too"},
        {"surface s type blend surfaces a a weights .6 .5", "the weights' sum, 1.1, is above 1"},
        {"surface s type blend surfaces a a weights .6 -.5", "weight2 -0.5 is not in [0, 1]"},
        {"surface s type blend surfaces weights", "a blend has 1 to 4096"},
        {"surface s type blend surfaces a", "weights is missing"},
        {"surface s type blend surfaces d e weights .5 .1", "second dielectric"},
        {"surface s type blend surfaces d a weights .5 .1", "no inside for a dielectric"},
        {"surface s type measured", "ends too early"},
        {"surface s type measured none", "none"},
        {"surface s type measured ramp.pfm", "is no table of 90 x 90 x 180"},
        {"surface s type diffuse reflectance 1 bump ramp.pfm normal normal.pfm", "either a bump"},
        {"surface s type diffuse reflectance 1 bump_scale 2", "either a bump"},
        {"surface s type diffuse reflectance 1 bump table.binary", "table.binary"},
        {"surface s type diffuse reflectance 1 normal ramp.pfm", "image value -"}};
    for (size_t k = 0; k < sizeof cases / sizeof *cases; k++) {
        char text[800];
        itn_scene *scene;
        itn_error error;
        snprintf(text, sizeof text, "camera eye 0 1 0 target 0 0 .1\nsurface a type diffuse "
                 "reflectance 1\nsurface d type dielectric\nsurface e type dielectric\n%s\n"
                 "object plane surface s\nlight constant radiance 1", cases[k][0]);
        int refused = itn_scene_from_memory(text, strlen(text), NULL, maps_files, 5, NULL, &scene,
                                            &error) != ITN_OK;
        check_report(refused && strstr(error.message, cases[k][1]), __FILE__, __LINE__, "%s: %s",
                     cases[k][0], refused ? error.message : "is taken");
    }
    itn_scene *scene = maps_scene("surface s type mirror reflectance 1 bump ramp.pfm",
                                  "plane surface s", 1);
    itn_render_options options = ITN_ZERO;
    itn_image image;
    itn_error error;
    float weights[16] = {0};
    int at = itn_parameter_find(scene, "s.bump_scale");
    CHECK(itn_render(scene, NULL, &options, &at, 1, &image, &error) == ITN_ERROR_UNSUPPORTED);
    CHECK(itn_render_texel_gradient(scene, NULL, &options, weights, "s.bump", &image, &error) ==
          ITN_ERROR_UNSUPPORTED);
    itn_scene_free(scene);
}

int main(void) {
    static const char slab[] =
        "v -2 -1 -2\nv 2 -1 -2\nv -2 0 -2\nv 2 0 -2\nv -2 -1 2\nv 2 -1 2\nv -2 0 2\nv 2 0 2\n"
        "f 1 3 2\nf 2 3 4\nf 5 6 7\nf 6 8 7\nf 1 2 5\nf 2 6 5\nf 3 7 4\nf 4 7 8\nf 1 5 3\n"
        "f 3 5 7\nf 2 4 6\nf 4 8 6\n";
    static const char waves[] = " bump waves.pfm bump_scale .5";
    char glass[200], brass[200], blend[400];
    maps_files[0] = maps_file("ramp.pfm", 1, maps_ramp);
    maps_files[1] = maps_file("normal.pfm", 3, maps_normal);
    maps_files[2] = maps_file("waves.pfm", 1, maps_waves);
    maps_files[3] = maps_table();
    maps_files[4].name = "slab.obj", maps_files[4].bytes = slab;
    maps_files[4].size = sizeof slab - 1;
    snprintf(brass, sizeof brass, "surface s type conductor eta .2 k 3 alpha .4%s", waves);
    snprintf(glass, sizeof glass, "surface s type ward reflectance .8 alpha_x .4 alpha_y .2%s",
             waves);
    snprintf(blend, sizeof blend, "%ssurface s type blend surfaces a b weights .5 .3%s",
             MAPS_PARTS, waves);
    test_tilt(0);
    test_tilt_slopes(brass, "plane surface s", 2000, 0);
    test_tilt_slopes(glass, "plane surface s", 2000, 0);
    test_tilt_slopes(blend, "plane surface s", 2000, 0);
    test_tilt_slopes("surface s type measured table.binary bump waves.pfm bump_scale .5",
                     "plane surface s", 2000, 0);
    test_tilt_texels(0);
    test_tilt_codes(0);
    test_tilt_ways(0);
    test_blend(0);
    test_coated("ior 1.5", 1), test_coated("ior 1", 1), test_coated("ior 1 alpha .2", 1);
    test_tilted_solids(0), test_tilted_blend(0);
    test_tilt_slopes("medium m sigma_t 2 albedo .8\nsurface s type dielectric alpha .4 "
                     "bump waves.pfm", MAPS_SLAB, 2000, 0);
    test_measured(.9, 0), test_measured(.3, 0);
    test_maps_refused();
    CHECK_CATCHES(test_tilt(.01));
    CHECK_CATCHES(test_tilt_texels(.1));
    CHECK_CATCHES(test_tilt_codes(.01));
    CHECK_CATCHES(test_tilt_ways(1));
    CHECK_CATCHES(test_blend(.2));
    CHECK_CATCHES(test_coated("ior 1.5", .8));
    CHECK_CATCHES(test_measured(.9, .2));
    CHECK_CATCHES(test_tilted_solids(.1));
    CHECK_CATCHES(test_tilted_blend(.05));
    CHECK_CATCHES(test_tilt_slopes(brass, "plane surface s", 2000, .5));
    for (int k = 0; k < 4; k++) free((void *)(uintptr_t)maps_files[k].bytes);
    return check_end("maps");
}
