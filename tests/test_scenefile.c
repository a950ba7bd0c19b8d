/* Scene and sky files: every keyword, every kind of error with its line, damage of every kind, and
   the shipped scenes. The sky is compared with numbers that the authors' own program printed. */
#define _XOPEN_SOURCE 700 /* mkdtemp */
#define ITN_IMPLEMENTATION
#include "../itn.h"
#include "accountant.h"
#include "check.h"
#include <unistd.h>

#ifndef ITN_SCENES
#define ITN_SCENES "../scenes" /* from this file's folder or the current one */
#endif

static char scenefile_directory[64];

static const char *scenefile_in_directory(const char *name) {
    static char path[160];
    snprintf(path, sizeof path, "%s/%s", scenefile_directory, name);
    return path;
}

static void write_bytes(const char *name, const char *bytes, size_t size) {
    FILE *file = fopen(scenefile_in_directory(name), "wb");
    if (!file || fwrite(bytes, 1, size, file) != size || fclose(file)) {
        printf("cannot write %s\n", scenefile_in_directory(name));
        exit(1);
    }
}
static void write_text(const char *name, const char *text) {
    write_bytes(name, text, strlen(text));
}

/* ---- the files of the tests ---- */

static const char *const cube_text = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 0\nv 0 0 1\n"
                                     "v 1 0 1\nv 0 1 1\nv 1 1 1\nf 1 3 4 2\nf 5 6 8 7\n"
                                     "f 1 2 6 5\nf 3 7 8 4\nf 1 5 7 3\nf 2 4 8 6\n";
static const char *const open_text = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n";

/* Turbidity 3, ground albedo .15, elevation 60 degrees. */
static const char *const sky_text =
    "# numbers of Hosek and Wilkie's data set, see the licence in scenes/t3-e60.sky\n"
    "coefficients_r -1.07009729 -0.183901643 1.91568571 5.39974686 -3.87281834 0.965212528 "
    "0.142394768 0.0879904436 0.699068785\n"
    "coefficients_g -1.08019412 -0.182494114 1.35130131 3.36346639 -4.95046067 0.951531163 "
    "0.125748228 1.74406109 0.684971587\n"
    "coefficients_b -1.06727076 -0.1887265 0.68670071 0.166813941 -2.24239154 0.831768481 "
    "0.077190505 3.15772945 0.681278175\n"
    "radiance 6.54064327 10.1626235 16.7692864\n"
    "sun_radiance 2.3e6 1.8e6 1.3e6\n";

/* Every keyword and every field once. */
static const char *const full_text =
    "# a comment\n"
    "film height 32 width 16 channels 3 filter gaussian deviation .75 # another\n"
    "\n"
    "camera target 0 0 0 eye 0 0 5 up 0 0.1 0 fov 40\n"
    "medium milk sigma_t 12.5 albedo 0.9 0.8 0.7 phase hg g -0.25\n"
    "medium tea albedo 0.5 sigma_t 1e2 0 300 g 0 0.2 -0.3\n"
    "surface glass type dielectric ior 1.33 alpha 0.2\n"
    "surface clear type dielectric\n"
    "surface paint type diffuse reflectance 0.3\n"
    "surface tiles reflectance checker 0.5 0.25 2 type diffuse\n"
    "surface mosaic type diffuse reflectance checker 0.1 0.2 0.3 0.4 0.5 0.6 0.5\n"
    "surface poster type diffuse reflectance 0.5 0.6 0.7 texture image.pfm\n"
    "object plane y -1 half 7 surface tiles\n"
    "object mesh cube.obj medium milk surface glass scale 2 rotate 0 0 1 90 translate 1 2 3\n"
    "object mesh open.obj surface paint scale 1 2 3\n"
    "object mesh open.obj medium tea force translate 0 0 9\n"
    "light constant radiance 1 2 3\n"
    "light map image.pfm scale 0.5 name window\n"
    "light sky a.sky sun 1 2 3 scale 0 sun_scale 2 sun_radius_scale 10 name heaven\n";

static void write_files(void) {
    itn_image image;
    int k;
    write_text("cube.obj", cube_text);
    write_text("open.obj", open_text);
    write_text("a.sky", sky_text);
    write_text("bad.sky", "radiance 1 2 3\n\nradiance 1 2 3\n");
    write_text("hot.sky", "coefficients_r 0 0 1e30 0 0 0 0 0 0\ncoefficients_g 0 0 1e30 0 0 0 0 0 0\n"
                          "coefficients_b 0 0 1e30 0 0 0 0 0 0\nradiance 1 1 1\n"
                          "sun_radiance 1 1 1\n");
    CHECK(itn_image_create(4, 3, 1, NULL, &image, NULL) == ITN_OK);
    strcpy(image.names[0], "Y");
    for (k = 0; k < 12; k++) image.pixels[k] = (float)k / 12;
    CHECK(itn_image_save_pfm(&image, 0, 1, scenefile_in_directory("image.pfm"), NULL) == ITN_OK);
    for (k = 0; k < 12; k++) image.pixels[k] = 2; /* more than a surface reflects */
    CHECK(itn_image_save_pfm(&image, 0, 1, scenefile_in_directory("bright.pfm"), NULL) == ITN_OK);
    image.pixels[4] = -1e-5f, image.pixels[6] = NAN, image.pixels[11] = INFINITY;
    CHECK(itn_image_save_pfm(&image, 0, 1, scenefile_in_directory("negative.pfm"), NULL) == ITN_OK);
    itn_image_free(&image);
    CHECK(itn_image_create(4, 1, 1, NULL, &image, NULL) == ITN_OK);
    strcpy(image.names[0], "Y");
    CHECK(itn_image_save_pfm(&image, 0, 1, scenefile_in_directory("row.pfm"), NULL) == ITN_OK);
    itn_image_free(&image);
    CHECK(itn_image_create(4, 3, 2, NULL, &image, NULL) == ITN_OK);
    strcpy(image.names[0], "layer.A"), strcpy(image.names[1], "layer.R");
    CHECK(itn_image_save_exr(&image, scenefile_in_directory("layers.exr"), NULL) == ITN_OK);
    itn_image_free(&image);
}

/* Loads a text as a scene. On failure checks what every failure promises. */
static itn_scene *load_text(const char *text, const itn_context *context, itn_error *error) {
    itn_scene *const untouched = (itn_scene *)(void *)scenefile_directory, *scene = untouched;
    itn_error inner = ITN_ZERO;
    itn_result result;
    write_text("scene.itn", text);
    result = itn_scene_load(scenefile_in_directory("scene.itn"), context, &scene, &inner);
    if (error) *error = inner;
    if (!result) return scene;
    CHECK(scene == untouched);
    CHECK(inner.code == result && inner.message[0]);
    return NULL;
}

/* ---- what a file means ---- */

static float value_of(const itn_scene *scene, const char *name) {
    int index = itn_parameter_find(scene, name);
    return index < 0 ? NAN : itn_parameter_get(scene, index)->value;
}

/* Checks the scene of full_text; `milk_g` is what the file should say. */
static void check_full_scene(const itn_scene *scene, float milk_g) {
    itn_film_desc film = itn_scene_film(scene);
    CHECK(film.width == 16 && film.height == 32 && film.channels == 3);
    CHECK(film.filter == ITN_FILTER_GAUSSIAN && film.deviation == .75f);
    CHECK(value_of(scene, "milk.sigma_t") == 12.5f && value_of(scene, "milk.g") == milk_g);
    CHECK(value_of(scene, "milk.albedo_r") == .9f && value_of(scene, "milk.albedo_g") == .8f);
    CHECK(value_of(scene, "milk.albedo_b") == .7f);
    CHECK(value_of(scene, "tea.sigma_t_r") == 100 && value_of(scene, "tea.sigma_t_g") == 0);
    CHECK(value_of(scene, "tea.sigma_t_b") == 300 && value_of(scene, "tea.g_r") == 0);
    CHECK(value_of(scene, "tea.g_g") == .2f && value_of(scene, "tea.g_b") == -.3f);
    CHECK(itn_parameter_find(scene, "tea.sigma_t") < 0 && itn_parameter_find(scene, "tea.g") < 0);
    CHECK(value_of(scene, "tea.albedo_r") == .5f && value_of(scene, "tea.albedo_b") == .5f);
    CHECK(value_of(scene, "glass.ior") == 1.33f && value_of(scene, "glass.alpha") == .2f);
    CHECK(value_of(scene, "clear.ior") == 1.5f && itn_parameter_find(scene, "clear.alpha") < 0);
    CHECK(value_of(scene, "paint.reflectance_g") == .3f);
    CHECK(value_of(scene, "tiles.reflectance_r") == .5f);
    CHECK(value_of(scene, "tiles.reflectance2_b") == .25f);
    CHECK(value_of(scene, "mosaic.reflectance_b") == .3f);
    CHECK(value_of(scene, "mosaic.reflectance2_r") == .4f);
    CHECK(value_of(scene, "poster.reflectance_g") == .6f);
    CHECK(value_of(scene, "light.scale") == 1 && value_of(scene, "window.scale") == .5f);
    CHECK(value_of(scene, "heaven.scale") == 0 && value_of(scene, "heaven.sun_scale") == 2);
}

static void test_scenefile_full(void) {
    itn_error error = ITN_ZERO;
    itn_scene *scene = load_text(full_text, NULL, &error);
    if (!check_report(scene != NULL, __FILE__, __LINE__, "%s", error.message)) return;
    check_full_scene(scene, -.25f);
    CHECK_CATCHES(check_full_scene(scene, .25f));
    itn_scene_free(scene);
}

/* Paths between quotes, also with the words of fields in them; a map that is turned and mended. */
static void test_quotes(int planted) {
    char text[600];
    itn_error error = ITN_ZERO;
    write_text("my 'cube' type.obj", cube_text);
    sprintf(text, "camera eye 0 1 9 target 0 0 0\nmedium m sigma_t 1 albedo .5\n"
            "object mesh \"my 'cube' type.obj\" medium m\nlight map 'negative.pfm' "
            "rotate -90 %s\n", planted ? "" : "repair");
    itn_scene *scene = load_text(text, NULL, &error);
    CHECK(scene && scene->lights[0].turn == .75f);
    for (int k = 0; scene && k < 36; k++) {
        float value = scene->lights[0].map[k];
        int bad = k / 3 == 4 || k / 3 == 6 || k / 3 == 11;
        CHECK(value == (bad ? 0 : 2));
    }
    itn_scene_free(scene);
}

/* The same file with other line ends and a byte order mark. */
static void test_line_ends(const char *newline) {
    char text[4000] = "\xef\xbb\xbf", *to = text + 3;
    const char *from;
    itn_scene *scene;
    itn_error error;
    for (from = full_text; *from; from++)
        if (*from == '\n')
            to += sprintf(to, "%s", newline);
        else
            *to++ = *from;
    scene = load_text(text, NULL, &error);
    CHECK(scene != NULL);
    if (scene) check_full_scene(scene, -.25f);
    itn_scene_free(scene);
    sprintf(to, "light bulb");
    CHECK(!load_text(text, NULL, &error) && error.line == 20);
}

/* What is left out is as documented, and objects stand where their transforms say. */
static void test_defaults_and_transform(void) {
    itn_scene *a = load_text("camera eye 0 0 5 target 0 0 0\nmedium m sigma_t 1 albedo 0.5\n"
                             "object mesh cube.obj medium m scale 2 rotate 0 0 1 90 "
                             "translate 1 2 3\nlight constant radiance 1\n", NULL, NULL);
    itn_scene *b = load_text("film width 128 height 128 channels 1 filter box\n"
                             "camera eye 0 0 5 target 0 0 0 up 0 1 0 fov 30\n"
                             "medium m sigma_t 1 albedo 0.5 phase hg g 0\n"
                             "object mesh a:moved.obj medium m\n"
                             "light constant radiance 1 scale 1 name light\n", NULL, NULL);
    itn_ray ray = ITN_ZERO;
    itn_hit hit = ITN_ZERO;
    CHECK(a && !b); /* there is none yet; the colon is a part of the name */
    /* x, y, z go to 1 - 2y, 2 + 2x, 3 + 2z */
    write_text("a:moved.obj", "v 1 2 3\nv 1 4 3\nv -1 2 3\nv -1 4 3\nv 1 2 5\nv 1 4 5\nv -1 2 5\n"
                              "v -1 4 5\nf 1 3 4 2\nf 5 6 8 7\nf 1 2 6 5\nf 3 7 8 4\nf 1 5 7 3\n"
                              "f 2 4 8 6\n");
    b = load_text("film width 128 height 128 channels 1 filter box\n"
                  "camera eye 0 0 5 target 0 0 0 up 0 1 0 fov 30\n"
                  "medium m sigma_t 1 albedo 0.5 phase hg g 0\n"
                  "object mesh a:moved.obj medium m\n"
                  "light constant radiance 1 scale 1 name light\n", NULL, NULL);
    CHECK(b != NULL);
    if (a && b) {
        CHECK(!memcmp(&a->film, &b->film, sizeof a->film));
        CHECK_NEAR(a->camera.eye.z, b->camera.eye.z, 1e-6);
        CHECK_NEAR(a->camera.right.x, b->camera.right.x, 1e-6);
        CHECK_NEAR(a->camera.up.y, b->camera.up.y, 1e-6);
        CHECK(a->parameter_count == b->parameter_count);
        CHECK_NEAR(a->origin[0], 0, 1e-6);
        CHECK_NEAR(a->origin[1], 3, 1e-6);
        CHECK_NEAR(a->origin[2], 4, 1e-6);
        CHECK_NEAR(b->origin[2], 4, 1e-6);
        ray.origin = itn__vec3(-3, .3f, .2f), ray.direction = itn__vec3(1, 0, 0), ray.tmax = 10;
        CHECK(itn_bvh_nearest(a->bvh, &ray, &hit) && hit.front);
        CHECK_NEAR(hit.t, 2, 1e-5);
        ray.origin.y = 1.01f;
        CHECK(!itn_bvh_nearest(a->bvh, &ray, &hit));
    }
    itn_scene_free(a);
    itn_scene_free(b);
}

/* The coefficients of tissue optics say the same as sigma_t, albedo and g. planted: an error of g. */
static void test_tissue_words(double planted) {
    static const struct {
        const char *text, *name;
        double value;
    } rows[] = {
        {"mu_a 0.5 mu_s 4.5", "x.sigma_t", 5},
        {"mu_a 0.5 mu_s 4.5", "x.albedo_b", .9},
        {"mu_s 4.5 g 0.2 mu_a 0.5", "x.g", .2},
        {"mu_a 0.5 mu_s' 3 g 0.5", "x.sigma_t", 6.5},
        {"g 0.5 mu_s_prime 3 mu_a 0.5", "x.albedo_g", 6 / 6.5},
        {"mu_a 0 mu_s 2", "x.albedo_r", 1},
        {"mu_a 2 mu_s 0", "x.albedo_r", 0},
        {"mu_a 0 mu_s 0", "x.sigma_t", 0},
        {"mu_a 0.1 0.2 0.3 mu_s 2", "x.sigma_t_g", 2.2},
        {"mu_a 0.1 0.2 0.3 mu_s 0.9 0.8 0.7", "x.sigma_t", 1}, /* all the same */
        {"mu_a 0.1 0.2 0.3 mu_s 0.9 0.8 0.7", "x.albedo_b", .7},
        {"mu_a 1 mu_s' 1 2 3 g 0 0.5 0.75", "x.sigma_t_b", 13},
        {"mu_a 1 mu_s' 1 2 3 g 0 0.5 0.75", "x.g_g", .5},
        {"mu_a 1 mu_s' 1 2 3 g 0 0.5 0.75", "x.albedo_g", .8},
        {"mu_a 1 kappa 4 phase vmf mu_s 1", "x.kappa", 4},
        {"sigma_t 30 albedo 0.9 phase mix hg 0.8 weight 0.7 hg -0.3 weight 0.3", "x.weight1", .7},
        {"sigma_t 30 albedo 0.9 phase mix hg 0.8 weight 0.7 hg -0.3 weight 0.3", "x.g2", -.3},
        {"vmf 9 weight .5 sigma_t 3 phase mix hg 0.1 weight .5 albedo 0.9", "x.kappa1", 9},
        {"sigma_t 3 phase mix hg 0.1 weight 1 albedo 0.9", "x.g1", .1}};
    size_t i;
    for (i = 0; i < sizeof rows / sizeof rows[0]; i++) {
        char text[300];
        itn_error error;
        itn_scene *scene;
        snprintf(text, sizeof text, "film channels 3\ncamera eye 0 0 5 target 0 0 0\nmedium x %s\n"
                 "object mesh cube.obj medium x\nlight constant radiance 1\n", rows[i].text);
        scene = load_text(text, NULL, &error);
        if (!check_report(scene != NULL, __FILE__, __LINE__, "%s: %s", rows[i].text, error.message))
            continue;
        CHECK_NEAR(value_of(scene, rows[i].name), rows[i].value * (1 + planted),
                   1e-6 * fabs(rows[i].value));
        CHECK(itn_parameter_find(scene, "x.weight2") < 0); /* the last is what is left */
        itn_scene_free(scene);
    }
}

/* ---- errors ---- */

/* A line put behind the two good ones of `base`, so that it is line 3. */
typedef struct bad_line {
    const char *text;
    itn_result code;
    const char *says; /* part of the message */
} bad_line;

static const bad_line bad_lines[] = {
    {"sphere", ITN_ERROR_FORMAT, "'sphere' is none of: film camera medium object surface light"},
    {"Medium x sigma_t 1 albedo 1", ITN_ERROR_FORMAT, "'Medium' is none of"},
    {"mediumx sigma_t 1 albedo 1", ITN_ERROR_FORMAT, "'mediumx' is none of"},
    {"object", ITN_ERROR_FORMAT, "object: '' is none of: mesh plane"},
    {"object sphere", ITN_ERROR_FORMAT, "object: 'sphere' is none of: mesh plane"},
    {"object medium m mesh cube.obj", ITN_ERROR_FORMAT, "'medium' is none of: mesh plane"},
    {"light sh", ITN_ERROR_FORMAT, "sh: the line ends too early"},
    {"light sh 1 2", ITN_ERROR_FORMAT, "light: sh has 1, 4, 9, 16 or 25 coefficients"},
    {"light sh 1 2 3", ITN_ERROR_FORMAT, "with 3 channels three times as many"},
    {"light sh 1 1 1 1 1 1 1 1 1 1 1 1 1 1 1 1 1 1 1 1 1 1 1 1 1 1 1 1 1 1 1 1 1 1 1 1 1 1 1 1 1 1 "
     "1 1 1 1 1 1 1 1 1 1 1 1 1 1 1 1 1 1 1 1 1 1 1 1 1 1 1 1 1 1 1 1 1 1 1 1 1 1", ITN_ERROR_FORMAT,
     "sh has 1, 4, 9"},
    {"light sh 1 1 1 1e30", ITN_ERROR_FORMAT, "c11"},
    {"light sh 1 1 1 x", ITN_ERROR_FORMAT, "'x' is none of"},
    {"light sh none.txt", ITN_ERROR_FILE, "none.txt"},
    {"light sh scene.itn", ITN_ERROR_FORMAT, "scene.itn"},
    {"light bulb", ITN_ERROR_FORMAT, "'bulb' is none of: constant map sky sh"},
    {"camera eye 0 0 1 target 0 0 0", ITN_ERROR_FORMAT, "line 1"},
    {"film widht 3", ITN_ERROR_FORMAT, "film: 'widht' is none of: width height channels filter"},
    {"film width 3 width 3", ITN_ERROR_FORMAT, "width is given twice"},
    {"film width", ITN_ERROR_FORMAT, "width"},
    {"film width 3 4", ITN_ERROR_FORMAT, "width"},
    {"film width 0", ITN_ERROR_FORMAT, "film: width 0 is not in [1, 65536]"},
    {"film width -1", ITN_ERROR_FORMAT, "width"},
    {"film width 65537", ITN_ERROR_FORMAT, "width"},
    {"film width 2.5", ITN_ERROR_FORMAT, "whole"},
    {"film height x", ITN_ERROR_FORMAT, "height"},
    {"film channels 2", ITN_ERROR_FORMAT, "channels"},
    {"film channels 4", ITN_ERROR_FORMAT, "channels"},
    {"film filter tent", ITN_ERROR_FORMAT, "tent"},
    {"film filter", ITN_ERROR_FORMAT, "filter"},
    {"film deviation 0.5", ITN_ERROR_FORMAT, "that of filter gaussian"},
    {"film filter box deviation 0.5", ITN_ERROR_FORMAT, "that of filter gaussian"},
    {"film filter gaussian deviation 5", ITN_ERROR_FORMAT, "deviation 5 is not in [0.1, 4]"},
    {"medium", ITN_ERROR_FORMAT, "medium"},
    {"medium x", ITN_ERROR_FORMAT, "a medium has either sigma_t and albedo"},
    {"medium x sigma_t 1", ITN_ERROR_FORMAT, "a medium has either sigma_t and albedo"},
    {"medium sigma_t 1 albedo 1", ITN_ERROR_FORMAT, "medium: '1' is none of: sigma_t"},
    {"medium 1x sigma_t 1 albedo 1", ITN_ERROR_FORMAT, "name '1x'"},
    {"medium x.y sigma_t 1 albedo 1", ITN_ERROR_FORMAT, "name 'x.y'"},
    {"medium abcdefghijklmnopqrstuvwxyz1234567 sigma_t 1 albedo 1", ITN_ERROR_FORMAT, "name"},
    {"medium m sigma_t 1 albedo 1", ITN_ERROR_FORMAT, "m: another medium has this name"},
    {"medium x sigma_t nan albedo 1", ITN_ERROR_FORMAT, "'nan' is not a finite number"},
    {"medium x sigma_t inf albedo 1", ITN_ERROR_FORMAT, "'inf' is not a finite number"},
    {"medium x sigma_t 1e39 albedo 1", ITN_ERROR_FORMAT, "'1e39' is not a finite number"},
    {"medium x sigma_t 1,5 albedo 1", ITN_ERROR_FORMAT, "'1,5' is not a finite number"},
    {"medium x sigma_t 0x10 albedo 1", ITN_ERROR_FORMAT, "'0x10'"},
    {"medium x sigma_t -1 albedo 1", ITN_ERROR_FORMAT, "sigma_t"},
    {"medium x sigma_t 1 albedo 1.01", ITN_ERROR_FORMAT, "albedo 1.01 is not in [0, 1]"},
    {"medium x sigma_t 1 albedo 1 1", ITN_ERROR_FORMAT, "albedo"},
    {"medium x sigma_t 1 albedo 1 1 1", ITN_ERROR_FORMAT, "channels 3"},
    {"medium x sigma_t 1 albedo 1 g 1", ITN_ERROR_FORMAT, "g 1 is not in"},
    {"medium x sigma_t 1 2 albedo 1", ITN_ERROR_FORMAT, "sigma_t"},
    {"medium x sigma_t 1 2 3 4 albedo 1", ITN_ERROR_FORMAT, "sigma_t"},
    {"medium x sigma_t 1 2 -3 albedo 1", ITN_ERROR_FORMAT, "sigma_t -3 is not in"},
    {"medium x sigma_t 1 2 3 albedo 1", ITN_ERROR_FORMAT, "channels 3"},
    {"medium x sigma_t 1 albedo 1 g 0 0.1", ITN_ERROR_FORMAT, "g"},
    {"medium x sigma_t 1 albedo 1 g 0 0.1 1", ITN_ERROR_FORMAT, "g 1 is not in"},
    {"medium x sigma_t 1 albedo 1 g 0 0.1 0.2", ITN_ERROR_FORMAT, "channels 3"},
    {"medium x sigma_t 1 albedo 1 phase rayleigh", ITN_ERROR_FORMAT, "rayleigh"},
    {"medium x sigma_t 1 albedo 1 phase", ITN_ERROR_FORMAT, "phase: '' is none of: hg"},
    {"medium x sigma_t 1 albedo 1 phase vmf", ITN_ERROR_FORMAT, "kappa is missing"},
    {"medium x sigma_t 1 albedo 1 phase vmf kappa 501", ITN_ERROR_FORMAT,
     "kappa 501 is not in [0, 500]"},
    {"medium x sigma_t 1 albedo 1 phase vmf kappa -1", ITN_ERROR_FORMAT, "kappa -1 is not in"},
    {"medium x sigma_t 1 albedo 1 kappa 1", ITN_ERROR_FORMAT, "'kappa' is none of: sigma_t"},
    {"medium x sigma_t 1 albedo 1 phase vmf kappa 1 g 0", ITN_ERROR_FORMAT, "'g' is none of"},
    {"medium x mu_a 1 mu_s' 1 phase vmf kappa 1", ITN_ERROR_FORMAT, "'mu_s'' is none of"},
    {"medium x sigma_t 1 albedo 1 phase mix", ITN_ERROR_FORMAT, "x: a mixture has 1 to 4 lobes"},
    {"medium x sigma_t 1 albedo 1 phase mix hg 1 weight 1", ITN_ERROR_FORMAT,
     "medium: hg 1 is not in [-0.999, 0.999]"},
    {"medium x sigma_t 1 albedo 1 phase mix hg 0 weight 0.5", ITN_ERROR_FORMAT,
     "x: the weights of its lobes add up to 0.5, not to 1"},
    {"medium x sigma_t 1 albedo 1 phase mix hg 0 weight 1.5 hg 0 weight -0.5", ITN_ERROR_FORMAT,
     "weight 1.5 is not in [0, 1]"},
    {"medium x sigma_t 1 albedo 1 phase mix hg 0 hg 0 weight 1", ITN_ERROR_FORMAT,
     "lobes hg G weight W or vmf K weight W"},
    {"medium x sigma_t 1 albedo 1 phase mix weight 1 hg 0", ITN_ERROR_FORMAT,
     "lobes hg G weight W or vmf K weight W"},
    {"medium x sigma_t 1 albedo 1 phase mix hg 0 weight 1 weight 0", ITN_ERROR_FORMAT,
     "lobes hg G weight W or vmf K weight W"},
    {"medium x sigma_t 1 albedo 1 phase mix hg 0 weight 1 hg 0", ITN_ERROR_FORMAT, "weight"},
    {"medium x sigma_t 1 albedo 1 phase mix hg 0 weight .2 hg 0 weight .2 vmf 0 weight .2 hg 0 "
     "weight .2 hg 0 weight .2", ITN_ERROR_FORMAT, "up to 4 lobes"},
    {"medium x mu_a 1", ITN_ERROR_FORMAT, "either sigma_t and albedo, or mu_a and mu_s"},
    {"medium x mu_s 1 g 0", ITN_ERROR_FORMAT, "either sigma_t and albedo, or mu_a and mu_s"},
    {"medium x mu_a 1 mu_s' 1", ITN_ERROR_FORMAT, "mu_s' (or mu_s_prime) and g"},
    {"medium x mu_a 1 mu_s' 1 mu_s_prime 1 g 0", ITN_ERROR_FORMAT, "either sigma_t and albedo"},
    {"medium x mu_a 1 mu_s 1 mu_s' 1 g 0", ITN_ERROR_FORMAT, "either sigma_t and albedo"},
    {"medium x sigma_t 1 albedo 1 mu_a 1", ITN_ERROR_FORMAT, "either sigma_t and albedo"},
    {"medium x sigma_t 1 mu_s 1", ITN_ERROR_FORMAT, "either sigma_t and albedo"},
    {"medium x mu_a 1 mu_s -1", ITN_ERROR_FORMAT, "mu_s -1 is not in [0, 1e+12]"},
    {"medium x mu_a 1e12 mu_s 1e12", ITN_ERROR_FORMAT, "x: sigma_t 2e+12 is not in"},
    {"medium x mu_a 1 2 3 mu_s 1", ITN_ERROR_FORMAT, "channels 3"},
    {"surface x ior 1.5", ITN_ERROR_FORMAT, "surface: '' is none of: dielectric diffuse"},
    {"surface x type metal", ITN_ERROR_FORMAT, "'metal' is none of: dielectric diffuse"},
    {"surface x type dielectric ior 0", ITN_ERROR_FORMAT, "ior"},
    {"surface x type dielectric ior 4.1", ITN_ERROR_FORMAT, "ior"},
    {"surface x type dielectric alpha 0.0001", ITN_ERROR_FORMAT, "alpha"},
    {"surface x type dielectric alpha 1.5", ITN_ERROR_FORMAT, "alpha"},
    {"surface x type dielectric reflectance 1", ITN_ERROR_FORMAT,
     "surface: 'reflectance' is none of: type ior alpha"},
    {"surface x type diffuse reflectance 1 ior 1", ITN_ERROR_FORMAT,
     "surface: 'ior' is none of: reflectance"},
    {"surface x type diffuse", ITN_ERROR_FORMAT, "reflectance"},
    {"surface x type diffuse reflectance", ITN_ERROR_FORMAT, "reflectance"},
    {"surface x type diffuse reflectance 2", ITN_ERROR_FORMAT, "reflectance"},
    {"surface x type diffuse reflectance 1 1 1", ITN_ERROR_FORMAT, "channels 3"},
    {"surface x type diffuse texture image.pfm", ITN_ERROR_FORMAT, "reflectance"},
    {"surface x type diffuse reflectance texture none.pfm", ITN_ERROR_FILE, "none.pfm"},
    {"surface x type diffuse reflectance texture cube.obj", ITN_ERROR_FORMAT, "cube.obj"},
    {"surface x type diffuse reflectance checker 0 1", ITN_ERROR_FORMAT, "checker"},
    {"surface x type diffuse reflectance checker 0 1.5 1", ITN_ERROR_FORMAT,
     "x: reflectance2 1.5 is not in [0, 1]"},
    {"surface x type diffuse reflectance checker 0 1 0", ITN_ERROR_FORMAT, "SIZE"},
    {"surface x type diffuse reflectance checker 0 0 0 1 1 1 1", ITN_ERROR_FORMAT, "channels 3"},
    {"surface x type diffuse reflectance 1 checker 0 1 1", ITN_ERROR_FORMAT, "reflectance"},
    {"object mesh", ITN_ERROR_FORMAT, "mesh"},
    {"object mesh \"my cube.obj\" medium m", ITN_ERROR_FILE, "/my cube.obj: cannot read"},
    {"object mesh \"cube.obj medium m", ITN_ERROR_FORMAT, "quote does not end"},
    {"object mesh 'cube.obj\" medium m", ITN_ERROR_FORMAT, "quote does not end"},
    {"object mesh \"\" medium m", ITN_ERROR_FILE, "cannot read"},
    {"object mesh none.obj medium m", ITN_ERROR_FILE, "none.obj"},
    {"object mesh scene.itn medium m", ITN_ERROR_FORMAT, "scene.itn"},
    {"object mesh cube.obj medium x", ITN_ERROR_FORMAT, "no medium 'x'"},
    {"object mesh cube.obj medium m surface m", ITN_ERROR_FORMAT, "no surface 'm'"},
    {"object mesh cube.obj medium m half 3", ITN_ERROR_FORMAT, "object: 'half' is none of: mesh"},
    {"object mesh cube.obj medium m scale 1 2", ITN_ERROR_FORMAT, "scale"},
    {"object mesh cube.obj medium m scale 0", ITN_ERROR_FORMAT, "scale"},
    {"object mesh cube.obj medium m scale -1", ITN_ERROR_FORMAT, "scale"},
    {"object mesh cube.obj medium m rotate 0 0 0 10", ITN_ERROR_FORMAT, "axis"},
    {"object mesh cube.obj medium m rotate 0 0 1", ITN_ERROR_FORMAT, "rotate"},
    {"object mesh cube.obj medium m translate 1 2", ITN_ERROR_FORMAT, "translate"},
    {"object mesh cube.obj medium m translate 3e38 0 0 translate 3e38 0 0", ITN_ERROR_FORMAT,
     "large"},
    {"object mesh cube.obj medium m force force", ITN_ERROR_FORMAT, "twice"},
    {"object mesh cube.obj", ITN_ERROR_FORMAT, "neither"},
    {"object mesh open.obj medium m", ITN_ERROR_MESH, "closed"},
    {"object plane", ITN_ERROR_FORMAT, "surface is missing"},
    {"object plane surface m", ITN_ERROR_FORMAT, "no surface"},
    {"object plane y 0 half 0 surface m", ITN_ERROR_FORMAT, "half"},
    {"object plane 3 surface m", ITN_ERROR_FORMAT, "object: '3' is none of: plane"},
    {"light constant", ITN_ERROR_FORMAT, "radiance is missing"},
    {"light constant radiance -1", ITN_ERROR_FORMAT, "radiance"},
    {"light constant radiance 1 2 3", ITN_ERROR_FORMAT, "channels 3"},
    {"light constant radiance 1 scale -1", ITN_ERROR_FORMAT, "scale"},
    {"light constant radiance 1 sun 0 1 0", ITN_ERROR_FORMAT, "light: 'sun' is none of: constant"},
    {"light constant radiance 1 name 7", ITN_ERROR_FORMAT, "name '7'"},
    {"light map", ITN_ERROR_FORMAT, "map"},
    {"light map none.exr", ITN_ERROR_FILE, "none.exr"},
    {"light map row.pfm", ITN_ERROR_FORMAT, "at least 1 x 2"},
    {"light map row.pfm name dusk", ITN_ERROR_FORMAT, "dusk: needs an image"},
    {"light map image.pfm rotate 400", ITN_ERROR_FORMAT, "rotate 400 is not in"},
    {"light map image.pfm rotate", ITN_ERROR_FORMAT, "rotate"},
    {"light constant radiance 1 repair", ITN_ERROR_FORMAT, "'repair' is none of"},
    {"light map negative.pfm", ITN_ERROR_FORMAT, "(repair takes those that are"},
    {"light map layers.exr", ITN_ERROR_FORMAT, "'layer.A', 'layer.R'"},
    {"surface s type diffuse reflectance texture bright.pfm", ITN_ERROR_FORMAT,
     "s: image value 2"},
    {"object mesh cube.obj medium m scale 1e-30 scale 1e-30", ITN_ERROR_FORMAT, "too small"},
    {"light sky a.sky", ITN_ERROR_FORMAT, "sun is missing"},
    {"light sky hot.sky sun 0 1 0", ITN_ERROR_FORMAT, "radiance beyond"},
    {"light sky a.sky sun 1 0 0", ITN_ERROR_FORMAT, "horizon"},
    {"light sky a.sky sun 0 1 0 sun_radius_scale 0", ITN_ERROR_FORMAT, "sun_radius_scale"},
    {"light sky a.sky sun 0 1 0 sun_radius_scale 321", ITN_ERROR_FORMAT, "[0.01, 320]"},
    {"light sky none.sky sun 0 1 0", ITN_ERROR_FILE, "none.sky"},
    {"light sky bad.sky sun 0 1 0", ITN_ERROR_FORMAT, "bad.sky:3: radiance is given twice"}};

static const char *const base = "camera eye 0 0 5 target 0 0 0\nmedium m sigma_t 1 albedo 0.5\n";
static const char *const rest = "object mesh cube.obj medium m\nlight constant radiance 1\n";

/* Every bad line must be refused at line `line` with its code and words. */
static void check_bad_lines(int line) {
    char text[600];
    size_t i;
    for (i = 0; i < sizeof bad_lines / sizeof bad_lines[0]; i++) {
        const bad_line *bad = &bad_lines[i];
        itn_error error = ITN_ZERO;
        accountant memory = ITN_ZERO;
        itn_context context = count_context(&memory);
        itn_scene *scene;
        snprintf(text, sizeof text, "%s%s\n%s", base, bad->text, rest);
        scene = load_text(text, &context, &error);
        check_report(!scene && error.code == bad->code && error.line == line &&
                         strstr(error.message, "scene.itn:3: ") && strstr(error.message, bad->says),
                     __FILE__, __LINE__, "'%s' gave %d, line %d: %s", bad->text, (int)error.code,
                     error.line, error.message);
        itn_scene_free(scene);
        CHECK(memory.live == 0);
    }
}

static void test_other_errors(void) {
    char text[6000];
    itn_error error;
    itn_scene *scene = NULL;
    itn_context half = ITN_ZERO;
    int i;
    CHECK(itn_scene_load(NULL, NULL, &scene, &error) == ITN_ERROR_ARGUMENT);
    CHECK(itn_scene_load(scenefile_in_directory("scene.itn"), NULL, NULL, NULL) ==
          ITN_ERROR_ARGUMENT);
    CHECK(itn_scene_load(scenefile_in_directory("none.itn"), NULL, &scene, &error) ==
          ITN_ERROR_FILE);
    CHECK(itn_scene_load(scenefile_in_directory("none.itn"), NULL, &scene, NULL) == ITN_ERROR_FILE);
    half.allocate = count_allocate;
    CHECK(itn_scene_load(scenefile_in_directory("scene.itn"), &half, &scene, &error) ==
          ITN_ERROR_ARGUMENT);
    CHECK(scene == NULL);
    CHECK(!load_text("", NULL, &error) && strstr(error.message, "no camera"));
    sprintf(text, "camera eye 0 0 5 target 0 0 0\n%s", rest);
    CHECK(!load_text(text, NULL, &error) && strstr(error.message, "no medium 'm'"));
    sprintf(text, "%slight constant radiance 1\n", base);
    CHECK(!load_text(text, NULL, &error) && strstr(error.message, "1 to 64 objects"));
    sprintf(text, "%sobject mesh cube.obj medium m\n", base);
    CHECK(!load_text(text, NULL, &error) && strstr(error.message, "1 to 64 lights, not 0"));
    strcpy(text, base);
    for (i = 0; i < 65; i++) strcat(text, "object mesh open.obj medium m force\n");
    CHECK(!load_text(text, NULL, &error) && error.line == 67 && strstr(error.message, "64"));
    strcpy(text, "camera eye 1 1 1 target 1 1 1\nmedium m sigma_t 1 albedo 1\n");
    strcat(text, rest);
    CHECK(!load_text(text, NULL, &error) && error.line == 1);
    strcpy(text, "\ncamera eye 0 9 0.00001 target 0 0 0\nmedium m sigma_t 1 albedo 1\n");
    strcat(text, rest);
    CHECK(!load_text(text, NULL, &error) && error.line == 2 && strstr(error.message, "parallel"));
    strcpy(text, "camera eye 0 0 9 target 0 0 0 up 0 1e-24 0\nmedium m sigma_t 1 albedo 1\n");
    strcat(text, rest);
    scene = load_text(text, NULL, &error);
    CHECK(scene != NULL); /* how long up is does not matter */
    itn_scene_free(scene);
    scene = NULL;
    strcpy(text, "film channels 1\ncamera eye 1 1 1 target 0 0 0\n"
                 "medium m sigma_t 1 albedo 1 1 1\n");
    strcat(text, rest);
    CHECK(!load_text(text, NULL, &error) && error.line == 3);
    for (i = 0; i < 2; i++) { /* a light without a name has one all the same */
        sprintf(text, "%slight constant radiance 1%s\nlight constant radiance 1%s\n%s", base,
                i ? " name light2" : "", i ? "" : " name light", rest);
        CHECK(!load_text(text, NULL, &error) && error.line == 4);
        CHECK(strstr(error.message, "another light has this name"));
        CHECK(strstr(error.message, i ? "4: light2: " : "4: light: "));
    }
    sprintf(text, "%ssurface m type dielectric\n%slight constant radiance 1 name m\n", base, rest);
    scene = load_text(text, NULL, &error); /* items of a kind are told apart */
    CHECK(scene != NULL);
    itn_scene_free(scene), scene = NULL;
    sprintf(text, "%ssurface s type dielectric\nsurface s type diffuse reflectance 1\n%s", base, rest);
    CHECK(!load_text(text, NULL, &error) && error.line == 4);
    CHECK(strstr(error.message, "s: another surface has this name") != NULL);
    sprintf(text, "%smedium x sigma_t 1 \\\n albedo 0.5 \\\n g 2\n%s", base, rest);
    CHECK(!load_text(text, NULL, &error) && error.line == 5 && strstr(error.message, "g 2 is"));
    write_bytes("scene.itn", "camera\0 eye 0 0 1 target 0 0 0\n", 31);
    CHECK(itn_scene_load(scenefile_in_directory("scene.itn"), NULL, &scene, &error) ==
          ITN_ERROR_FORMAT);
}

/* An item may be called like another's keyword: an error of it has its line all the same. planted:
   the line that is expected, less the right one. */
static void test_names_like_keywords(int planted) {
    static const char *const names[] = {"camera", "film", "object", "scene"};
    char text[600];
    itn_error error;
    size_t i;
    for (i = 0; i < sizeof names / sizeof names[0]; i++) {
        sprintf(text, "film width 3\n%ssurface %s type diffuse reflectance texture bright.pfm\n%s",
                base, names[i], rest);
        CHECK(!load_text(text, NULL, &error));
        CHECK(error.line == 4 + planted);
    }
    sprintf(text, "film width 3\n%slight map row.pfm name camera\n%s", base, rest);
    CHECK(!load_text(text, NULL, &error) && error.line == 4);
    sprintf(text, "%s%slight sky hot.sky sun 0 1 0 name camera\n", base, rest);
    CHECK(!load_text(text, NULL, &error) && error.line == 5 && strstr(error.message, "beyond"));
}

/* A scene in memory, with some files beside it there and others on the disk; nothing outlives the
   call. planted: a number that a file in memory says otherwise. */
static void test_from_memory(float planted) {
    itn_file files[3] = {{"cube.obj", NULL, 0}, {"open.obj", NULL, 0}, {"a.sky", NULL, 0}};
    char *text = (char *)malloc(strlen(full_text)), changed[2000], sky[2000];
    accountant memory = ITN_ZERO;
    itn_context context = count_context(&memory);
    itn_error error = ITN_ZERO;
    itn_scene *scene = NULL;
    files[0].bytes = cube_text, files[0].size = strlen(cube_text);
    files[1].bytes = open_text, files[1].size = strlen(open_text);
    strcpy(sky, sky_text), *strstr(sky, "6.54064327") = '7'; /* another one than on the disk */
    files[2].bytes = sky, files[2].size = strlen(sky);
    memcpy(text, full_text, strlen(full_text)); /* no zero behind it */
    CHECK(itn_scene_from_memory(text, strlen(full_text), scenefile_in_directory("x.itn"), files, 3,
                                &context, &scene, &error) == ITN_OK);
    free(text);
    if (scene) check_full_scene(scene, -.25f + planted);
    if (scene) CHECK(scene->lights[2].radiance[0] == 7.54064327f);
    itn_scene_free(scene), scene = NULL;
    CHECK(itn_scene_from_memory(full_text, strlen(full_text), scenefile_in_directory("none/x.itn"),
                                files, 2, &context, &scene, &error) == ITN_ERROR_FILE);
    CHECK(!scene && error.line == 12 && strstr(error.message, "none/image.pfm"));
    CHECK(memory.live == 0);
    sprintf(changed, "%s%ssurface s type metal\n", base, rest);
    CHECK(itn_scene_from_memory(changed, strlen(changed), NULL, files, 3, NULL, &scene, &error) ==
          ITN_ERROR_FORMAT);
    CHECK(!strncmp(error.message, "scene:5: ", 9) && error.line == 5);
    changed[strlen(base) + strlen(rest)] = 0;
    CHECK(itn_scene_from_memory(changed, strlen(changed), NULL, files, 3, NULL, &scene, NULL) ==
          ITN_OK);
    itn_scene_free(scene), scene = NULL;
    CHECK(itn_scene_from_memory(NULL, 3, NULL, NULL, 0, NULL, &scene, &error) ==
          ITN_ERROR_ARGUMENT);
    CHECK(itn_scene_from_memory(changed, 3, NULL, NULL, 1, NULL, &scene, &error) ==
          ITN_ERROR_ARGUMENT);
    CHECK(itn_scene_from_memory(changed, (size_t)1 << 25, NULL, NULL, 0, NULL, &scene, &error) ==
          ITN_ERROR_ARGUMENT);
}

/* ---- damage ---- */

/* Loads what is in scene.itn; it may fail, but must keep its promises. Returns whether it did. */
static int try_scene(void) {
    static char untouched;
    accountant memory = ITN_ZERO;
    itn_context context = count_context(&memory);
    itn_scene *scene = (itn_scene *)(void *)&untouched;
    itn_error error = ITN_ZERO;
    itn_result result =
        itn_scene_load(scenefile_in_directory("scene.itn"), &context, &scene, &error);
    int kept = !result || (scene == (itn_scene *)(void *)&untouched && error.message[0]);
    if (!result) itn_scene_free(scene);
    check_report(kept && memory.live == 0, __FILE__, __LINE__, "%s", error.message);
    return !result;
}

/* Reads a sky file. */
static itn_result load_sky(const char *path, itn_sky *sky, itn_error *error) {
    itn__buffer bytes = ITN_ZERO;
    itn_result result = itn__read_file(path, 1 << 20, NULL, &bytes, error);
    itn_context context = ITN_ZERO;
    itn_file file;
    file.name = path, file.bytes = bytes.bytes, file.size = bytes.size;
    if (!result) result = itn__sky_from_memory(&context, &file, sky, error);
    itn__buffer_free(&bytes);
    return result;
}

static int try_sky(void) {
    itn_sky sky;
    itn_error error = ITN_ZERO;
    itn_result result = load_sky(scenefile_in_directory("damaged.sky"), &sky, &error);
    CHECK(!result || error.message[0]);
    return !result;
}

/* Cuts a text at every length; returns how many of the cut ones were taken. */
static int cut(const char *name, const char *text, int (*attempt)(void)) {
    size_t length;
    int taken = 0;
    for (length = 0; length < strlen(text); length++) {
        write_bytes(name, text, length);
        taken += attempt();
    }
    return taken;
}

/* Changes a few bytes of a text at random, many times. */
static int corrupt(const char *name, const char *text, int rounds, int (*attempt)(void)) {
    char bytes[4000];
    size_t size = strlen(text);
    itn__rng rng = itn__rng_make(7, size, 0);
    int i, k, taken = 0;
    for (i = 0; i < rounds; i++) {
        memcpy(bytes, text, size);
        for (k = 0; k <= i % 3; k++) {
            uint32_t bits = itn__rng_bits(&rng);
            static const char alphabet[] = "0123456789.-+eE #\n\r\tabc\\\x80\xff\x1b";
            bytes[itn__rng_bits(&rng) % size] =
                bits & 1 ? alphabet[(bits >> 8) % (sizeof alphabet)] : (char)(bits >> 8 & 255);
        }
        write_bytes(name, bytes, size);
        taken += attempt();
    }
    return taken;
}

static void test_damage(void) {
    int taken = cut("scene.itn", full_text, try_scene);
    CHECK(taken > 0 && taken < 200); /* behind the first objects, at ends of lines */
    taken = corrupt("scene.itn", full_text, 2000, try_scene);
    CHECK(taken > 20 && taken < 1000);
    CHECK(cut("damaged.sky", sky_text, try_sky) < 10); /* within the last number */
    taken = corrupt("damaged.sky", sky_text, 2000, try_sky);
    CHECK(taken > 100 && taken < 1900);
}

/* Memory fails at the k-th call, for every k. */
static void test_out_of_memory(void) {
    accountant memory = ITN_ZERO;
    itn_context context = count_context(&memory);
    itn_scene *scene;
    itn_error error;
    long calls, k;
    scene = load_text(full_text, &context, &error);
    CHECK(scene != NULL);
    itn_scene_free(scene);
    calls = memory.calls;
    CHECK(calls > 20 && memory.live == 0);
    for (k = 1; k <= calls; k++) {
        memory.calls = 0, memory.fail_at = k;
        scene = load_text(full_text, &context, &error);
        check_report(!scene && error.code == ITN_ERROR_MEMORY && memory.live == 0, __FILE__,
                     __LINE__, "call %ld: %s", k, error.message);
        itn_scene_free(scene);
    }
}

/* ---- the sky ---- */

/* Radiances that the authors' program prints for turbidity 3, ground albedo .15, elevation 60:
   at the zenith, in the sun's direction (without its disc), and opposite, 60 degrees down. */
static void check_sky(const itn_sky *sky) {
    static const float theta[3] = {0, 30, -60}; /* towards the sun, at 30 */
    static const double expected[3][3] = {{3.631779, 5.522326, 10.403060},
                                          {16.307778, 19.157592, 21.983152},
                                          {3.434738, 6.607357, 13.081977}};
    const double degree = 3.14159265358979 / 180;
    itn__light light = ITN_ZERO;
    float rgb[3];
    int i, c;
    light.kind = ITN__LIGHT_SKY, light.sky = *sky;
    light.to_sun = itn__vec3((float)sin(30 * degree), (float)cos(30 * degree), 0);
    for (i = 0; i < 3; i++) {
        double angle = theta[i] * degree;
        itn_vec3 d = itn__vec3((float)sin(angle), (float)cos(angle), 0);
        itn__light_radiance(&light, NULL, 3, d, rgb);
        for (c = 0; c < 3; c++) CHECK_NEAR(rgb[c], expected[i][c], 2e-6 * expected[i][c]);
    }
}

static void check_swapped_sky(itn_sky sky) {
    int c;
    for (c = 0; c < 3; c++) { /* A..I in alphabetic order: the likely mistake */
        float swap = sky.coefficients[c][7];
        sky.coefficients[c][7] = sky.coefficients[c][8];
        sky.coefficients[c][8] = swap;
    }
    check_sky(&sky);
}

static char *scenes_path(const char *name) {
    static char path[400];
    const char *slash = strrchr(__FILE__, '/');
    FILE *file;
    snprintf(path, sizeof path, "%.*s/" ITN_SCENES "/%s", slash ? (int)(slash - __FILE__) : 1,
             slash ? __FILE__ : ".", name);
    file = fopen(path, "rb");
    if (file) fclose(file);
    if (!file) snprintf(path, sizeof path, ITN_SCENES "/%s", name);
    return path;
}

static void test_sky(void) {
    itn_sky sky, shipped;
    CHECK(load_sky(scenefile_in_directory("a.sky"), &sky, NULL) == ITN_OK);
    check_sky(&sky);
    CHECK_CATCHES(check_swapped_sky(sky));
    CHECK(sky.sun_radiance[0] == 2.3e6f && sky.sun_radiance[2] == 1.3e6f);
    CHECK(load_sky(scenes_path("t3-e60.sky"), &shipped, NULL) == ITN_OK);
    check_sky(&shipped);
    /* the sun's disc is some 10^5 times as bright as the sky around, redder than it, and on level
       ground gives 4 to 8 times the light of this sky (mean about 7 in green) */
    CHECK(shipped.sun_radiance[0] > shipped.sun_radiance[1]);
    CHECK(shipped.sun_radiance[1] > shipped.sun_radiance[2]);
    CHECK_NEAR(shipped.sun_radiance[1] * 6.87e-5 * .866 / (ITN__PI * 7), 6, 2);
}

/* ---- the scenes that come with the library ---- */

static void test_shipped_scenes(void) {
    static const char *const names[] = {"default", "studio", "smooth", "matched", "data",
                                        "rgb",     "still",  "chain",  "hound",   "spectral"};
    size_t i;
    for (i = 0; i < sizeof names / sizeof names[0]; i++) {
        itn_render_options options = ITN_ZERO;
        itn_scene *scene = NULL;
        itn_error error = ITN_ZERO;
        itn_image image = ITN_ZERO;
        char name[40];
        double mean = 0;
        int k, n;
        snprintf(name, sizeof name, "%s.itn", names[i]);
        if (!check_report(!itn_scene_load(scenes_path(name), NULL, &scene, &error), __FILE__,
                          __LINE__, "%s", error.message))
            continue;
        options.spp = 1, options.max_scatter = 16;
        CHECK(itn_render(scene, NULL, &options, NULL, 0, &image, &error) == ITN_OK);
        n = image.width * image.height;
        for (k = 0; k < n; k++) mean += image.pixels[k] / n;
        check_report(mean > .01 && mean < 1000, __FILE__, __LINE__, "%s: mean %g", name, mean);
        itn_image_free(&image);
        itn_scene_free(scene);
    }
}

static void remove_files(void) {
    static const char *const names[] = {"cube.obj", "open.obj",  "a:moved.obj", "a.sky",
                                        "bad.sky",  "image.pfm", "scene.itn", "damaged.sky",
                                        "hot.sky",  "row.pfm", "bright.pfm", "layers.exr",
                                        "negative.pfm", "my 'cube' type.obj"};
    size_t i;
    for (i = 0; i < sizeof names / sizeof names[0]; i++) remove(scenefile_in_directory(names[i]));
    CHECK(rmdir(scenefile_directory) == 0);
}

int main(void) {
    strcpy(scenefile_directory, "/tmp/itn_scenefile_XXXXXX");
    if (!mkdtemp(scenefile_directory)) return 1;
    write_files();
    test_scenefile_full();
    test_quotes(0);
    CHECK_CATCHES(test_quotes(1));
    test_line_ends("\r\n");
    test_line_ends("\r");
    test_line_ends(" \t\n");
    test_defaults_and_transform();
    test_tissue_words(0);
    CHECK_CATCHES(test_tissue_words(1e-4));
    check_bad_lines(3);
    CHECK_CATCHES(check_bad_lines(4));
    test_other_errors();
    test_names_like_keywords(0);
    CHECK_CATCHES(test_names_like_keywords(1));
    test_from_memory(0);
    CHECK_CATCHES(test_from_memory(.5f));
    test_damage();
    test_out_of_memory();
    test_sky();
    test_shipped_scenes();
    remove_files();
    return check_end("scenefile");
}
