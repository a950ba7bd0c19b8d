/* A short program for every kind of machine, compiler and language (see matrix.sh): small pictures
   by both walks, derivatives, a network, a search, files. C99 and C++11; uses what is public alone.

     portable OUT FOLDER SCENES   checks what it can by itself; writes what it rendered to OUT, as
                                  text, and its files to FOLDER; loads what is in SCENES
     portable OUT OTHER compare   whether the pictures of two builds agree

   What must agree: files, byte for byte. Pictures of two builds, made by the same seeds, differ by
   rounding, which leads a few paths elsewhere: as multiples of their standard errors (those of the
   difference of two independent renders), values by less than 4, 9 of 10 by less than .1, and the
   mean over a plane by less than 1. Where lanes are as many and arithmetic is the same, they are
   the same bits. */
#ifndef PORTABLE_APART /* the code is in another file */
#define ITN_IMPLEMENTATION
#endif
#include "../itn.h"
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static int passed, failed;
static void check(int holds, const char *what) {
    if (holds) passed++;
    else failed++, printf("FAILED %s\n", what);
}

/* ---- pictures -------------------------------------------------------------------------------- */

static int cube_faces[36] = {0, 2, 1, 1, 2, 3, 4, 5, 6, 5, 7, 6, 0, 1, 4, 1, 5, 4,
                             2, 6, 3, 3, 6, 7, 0, 4, 2, 2, 4, 6, 1, 3, 5, 3, 7, 5};

/* A cube of milk, in a skin or without, on a checkered ground, under a sky or in light that is
   everywhere the same. */
static itn_result make_scene(int channels, float alpha, int sky, itn_scene **scene) {
    float corners[24];
    itn_mesh mesh = ITN_ZERO;
    itn_medium_desc milk = ITN_ZERO;
    itn_surface_desc surfaces[2] = {ITN_ZERO, ITN_ZERO};
    itn_object_desc objects[2] = {ITN_ZERO, ITN_ZERO};
    itn_light_desc light = ITN_ZERO;
    itn_scene_desc desc = ITN_ZERO;
    for (int i = 0; i < 24; i++) corners[i] = ((i / 3) >> (i % 3)) & 1 ? .5f : -.5f;
    mesh.positions = corners, mesh.vertex_count = 8;
    mesh.triangles = cube_faces, mesh.triangle_count = 12;
    milk.name = "milk", milk.sigma_t = 4, milk.g = .5f;
    surfaces[0].name = "skin", surfaces[0].ior = 1.4f, surfaces[0].alpha = alpha > 0 ? alpha : 0;
    surfaces[1].name = "ground", surfaces[1].type = ITN_SURFACE_DIFFUSE;
    surfaces[1].texture = ITN_TEXTURE_CHECKER, surfaces[1].checker_size = .5f;
    for (int k = 0; k < 3; k++) {
        milk.albedo[k] = .9f - .2f * (float)k, light.radiance[k] = 1;
        surfaces[1].reflectance[k] = .5f, surfaces[1].reflectance2[k] = .25f;
        for (int m = 0; m < 9; m++) {
            static const float coefficients[9] = {-.6f, -.4f, 1, .5f, -2, .2f, .1f, 1, .5f};
            light.sky.coefficients[k][m] = coefficients[m];
        }
        light.sky.radiance[k] = .5f + .25f * (float)k, light.sky.sun_radiance[k] = 300;
    }
    objects[0].mesh = &mesh, objects[0].medium = "milk";
    objects[1].surface = "ground", objects[1].plane_y = -.75f, objects[1].half_size = 4;
    if (alpha >= 0) objects[0].surface = "skin";
    if (sky) {
        light.type = ITN_LIGHT_SKY, light.sun_radius_scale = 30;
        light.sun_direction.x = .5f, light.sun_direction.y = .7f, light.sun_direction.z = .6f;
    }
    desc.film.width = desc.film.height = 16, desc.film.channels = channels;
    desc.camera.eye.x = 1, desc.camera.eye.y = 1, desc.camera.eye.z = 3;
    desc.media = &milk, desc.surfaces = surfaces, desc.objects = objects, desc.lights = &light;
    desc.medium_count = desc.light_count = 1;
    desc.surface_count = 2, desc.object_count = sky ? 2 : 1;
    return itn_scene_create(&desc, NULL, scene, NULL);
}

static void write_plane(FILE *out, const char *picture, const char *plane, const float *values,
                        int count) {
    fprintf(out, "%s:%s %d", picture, plane, count);
    for (int k = 0; k < count; k++) fprintf(out, " %.9g", (double)values[k]);
    fprintf(out, "\n");
}

static void render(FILE *out, const char *name, int channels, float alpha, int sky, itn_mode mode) {
    itn_scene *scene = NULL;
    itn_image image = ITN_ZERO;
    itn_render_options options = ITN_ZERO;
    int asked[3], bad = 0, pixels;
    check(make_scene(channels, alpha, sky, &scene) == ITN_OK, name);
    if (!scene) return;
    asked[0] = itn_parameter_find(scene, "milk.sigma_t");
    asked[1] = itn_parameter_find(scene, channels == 1 ? "milk.albedo" : "milk.albedo_g");
    asked[2] = itn_parameter_find(scene, "milk.g");
    options.spp = 16, options.seed = 7, options.mode = mode;
    check(itn_render(scene, NULL, &options, asked, 3, &image, NULL) == ITN_OK, name);
    pixels = image.width * image.height;
    check(pixels == 256 && image.plane_count == 8 * channels, name);
    for (int k = 0; k < pixels * image.plane_count; k++)
        bad += !(image.pixels[k] > -1e30f && image.pixels[k] < 1e30f);
    for (int k = 0; k < image.plane_count; k++) /* values and their variances in turn */
        for (int m = k; m < k + 2 * channels && k / channels % 2 == 0; m += channels)
            write_plane(out, name, image.names[m], image.pixels + m * pixels, pixels);
    check(!bad, name);
    itn_image_free(&image);
    itn_scene_free(scene);
}

/* In light that is everywhere 1, and without loss, all is 1. */
static void furnace(itn_mode mode) {
    itn_scene *scene = NULL;
    itn_image image = ITN_ZERO;
    itn_render_options options = ITN_ZERO;
    float theta[64], worst = 0;
    check(make_scene(1, -1, 0, &scene) == ITN_OK && itn_parameter_count(scene) < 64, "furnace");
    if (!scene) return;
    itn_parameter_values(scene, theta);
    theta[itn_parameter_find(scene, "milk.albedo")] = 1;
    options.spp = 4, options.mode = mode;
    check(itn_render(scene, theta, &options, NULL, 0, &image, NULL) == ITN_OK, "furnace");
    for (int k = 0; image.pixels && k < 256; k++)
        if (fabsf(image.pixels[k] - 1) > worst) worst = fabsf(image.pixels[k] - 1);
    check(image.pixels && worst < 1e-4f, "a lossless cube is as bright as the light");
    itn_image_free(&image);
    itn_scene_free(scene);
}

/* Finds sigma_t of a picture of its own. */
static void search(void) {
    itn_scene *scene = NULL;
    itn_image image = ITN_ZERO;
    itn_render_options options = ITN_ZERO;
    itn_refine_options how = ITN_ZERO;
    itn_estimate found = ITN_ZERO;
    float theta[64];
    int sought = 0;
    check(make_scene(1, -1, 1, &scene) == ITN_OK && itn_parameter_count(scene) < 64, "search");
    if (!scene) return;
    sought = itn_parameter_find(scene, "milk.sigma_t");
    options.spp = 64, options.seed = 11;
    check(itn_render(scene, NULL, &options, NULL, 0, &image, NULL) == ITN_OK, "its picture");
    itn_parameter_values(scene, theta);
    theta[sought] = 2, how.spp = 16, how.iterations = 6, how.final_spp = 64;
    how.seconds = 1000; /* emulators are slow */
    check(itn_refine(scene, theta, image.pixels, &sought, 1, &how, &found, NULL) == ITN_OK,
          "search runs");
    check(fabs(found.value - 4) <= 5 * found.standard_error && found.standard_error < .4,
          "search finds sigma_t");
    printf("  sigma_t 4 found as %.3f +- %.3f\n", found.value, found.standard_error);
    itn_image_free(&image);
    itn_scene_free(scene);
}

/* Threads that render one scene at once, which then makes its tables for all of them. */
#if defined(ITN_THREADS) && !defined(_WIN32)
#include <pthread.h>
static void *render_again(void *user) {
    itn_image *image = (itn_image *)user;
    itn_render_options options = ITN_ZERO;
    const itn_scene *scene = (const itn_scene *)(const void *)image->pixels;
    options.spp = 4, image->pixels = NULL;
    itn_render(scene, NULL, &options, NULL, 0, image, NULL);
    return NULL;
}
static void at_once(void) {
    enum { COUNT = 4 };
    itn_scene *scene = NULL;
    itn_image images[COUNT];
    pthread_t threads[COUNT];
    int k;
    check(make_scene(1, .2f, 1, &scene) == ITN_OK, "at once");
    memset(images, 0, sizeof images);
    for (k = 0; k < COUNT; k++) {
        images[k].pixels = (float *)(void *)scene; /* the way in */
        check(!pthread_create(&threads[k], NULL, render_again, &images[k]), "a thread");
    }
    for (k = 0; k < COUNT; k++) {
        check(!pthread_join(threads[k], NULL) && images[k].pixels &&
                  !memcmp(images[k].pixels, images[0].pixels, 256 * sizeof(float)),
              "pictures made at once are the same");
    }
    for (k = 0; k < COUNT; k++) itn_image_free(&images[k]);
    itn_scene_free(scene);
}
#else
static void at_once(void) {}
#endif

#ifndef ITN_NO_NET
/* A network of weights that are known exactly learns two pictures. */
static void network(FILE *out, const char *folder) {
    itn_net_desc desc = ITN_ZERO;
    itn_net *net = NULL;
    static const float targets[4] = {.25f, -.5f, -.25f, .5f};
    float images[2 * 2 * 64], outputs[4], slopes[4], *weights;
    double first = 0, loss = 0;
    size_t count = 0;
    desc.width = desc.height = 8, desc.layer_count = 2, desc.first_channels = 4;
    desc.outputs = 2, desc.batch = 2, desc.seed = 1;
    check(itn_net_create(&desc, NULL, &net, NULL) == ITN_OK, "network");
    if (!net) return;
    weights = itn_net_parameters(net, &count);
    for (size_t k = 0; k < count; k++) weights[k] = (float)((k * 40503 >> 4) % 256) / 512 - .1875f;
    for (int k = 0; k < 256; k++) images[k] = (float)(k * 29 % 67) / 64;
#ifndef ITN_NO_STDIO
    char path[1000];
    snprintf(path, sizeof path, "%s/weights.net", folder);
    check(itn_net_save(net, path, 1, NULL) == ITN_OK, "weights are saved");
    itn_net *other = NULL;
    check(itn_net_open(path, 2, NULL, &other, NULL) == ITN_OK, "weights are read");
    check(other && !memcmp(itn_net_parameters(other, NULL), weights, count * sizeof *weights),
          "weights come back");
    itn_net_free(other);
#else
    (void)folder;
#endif
    check(itn_net_forward(net, 2, images, outputs, NULL) == ITN_OK, "network sees");
    write_plane(out, "network", "outputs", outputs, 4);
    for (int k = 0; k < 200; k++) {
        loss = itn_loss_parameters(4, outputs, targets, slopes);
        first = k ? first : loss;
        itn_net_zero_gradients(net);
        check(itn_net_backward(net, 2, slopes, NULL) == ITN_OK &&
                  itn_net_step(net, .01, NULL) == ITN_OK &&
                  itn_net_forward(net, 2, images, outputs, NULL) == ITN_OK,
              "network learns");
    }
    check(loss < .01 * first, "network has learnt");
    printf("  loss %.3g, then %.3g\n", first, loss);
    itn_net_free(net);
}
#endif

/* ---- files: made of numbers that are exact, so that the bytes are the same everywhere -------- */

#ifndef ITN_NO_STDIO
static void files(const char *folder) {
    static const char *const names[4] = {"B", "G", "R", "depth of it"};
    char path[1000];
    float corners[24], uvs[72];
    itn_mesh mesh = ITN_ZERO, back = ITN_ZERO;
    itn_image image = ITN_ZERO, seen = ITN_ZERO;
    check(itn_image_create(19, 7, 4, NULL, &image, NULL) == ITN_OK, "an image");
    if (!image.pixels) return;
    for (int k = 0; k < 4; k++) strcpy(image.names[k], names[k]);
    for (int k = 0; k < 19 * 7 * 4; k++) image.pixels[k] = (float)(k * 37 % 257) / 256;
    snprintf(path, sizeof path, "%s/image.exr", folder);
    check(itn_image_save_exr(&image, path, NULL) == ITN_OK, "EXR is saved");
    check(itn_image_load(path, NULL, &seen, NULL) == ITN_OK, "EXR is read");
    check(seen.pixels && !memcmp(seen.pixels, image.pixels, 19 * 7 * 4 * 4), "EXR comes back");
    itn_image_free(&seen);
    snprintf(path, sizeof path, "%s/image.pfm", folder);
    check(itn_image_save_pfm(&image, 0, 3, path, NULL) == ITN_OK, "PFM is saved");
    check(itn_image_load(path, NULL, &seen, NULL) == ITN_OK, "PFM is read");
    check(seen.pixels && !memcmp(seen.pixels, image.pixels, 19 * 7 * 3 * 4), "PFM comes back");
    itn_image_free(&seen);
    snprintf(path, sizeof path, "%s/image.png", folder);
    check(itn_image_save_png(&image, 0, 3, ITN_PNG_TONE, 1, path, NULL) == ITN_OK, "PNG is saved");
    check(itn_image_load(path, NULL, &seen, NULL) == ITN_OK, "PNG is read");
    check(seen.pixels && fabsf(seen.pixels[1] - image.pixels[1]) < .01f, "PNG comes back");
    itn_image_free(&seen);
    itn_image_free(&image);
    for (int k = 0; k < 24; k++) corners[k] = (float)(((k / 3) >> (k % 3)) & 1) - .5f;
    for (int k = 0; k < 72; k++) uvs[k] = (float)(k % 9) / 8;
    mesh.positions = corners, mesh.vertex_count = 8, mesh.uvs = uvs;
    mesh.triangles = cube_faces, mesh.triangle_count = 12;
    snprintf(path, sizeof path, "%s/mesh.ply", folder);
    check(itn_mesh_save_ply(&mesh, path, NULL) == ITN_OK, "PLY is saved");
    check(itn_mesh_load(path, NULL, &back, NULL) == ITN_OK, "PLY is read");
    check(back.positions && !memcmp(back.positions, corners, sizeof corners) &&
              !memcmp(back.triangles, cube_faces, sizeof cube_faces) && back.uvs &&
              !memcmp(back.uvs, uvs, sizeof uvs),
          "PLY comes back");
    itn_mesh_free(&back);
    check(itn_mesh_save_ply(&mesh, path, NULL) == ITN_OK, "PLY replaces PLY");
    snprintf(path, sizeof path, "%s/none/mesh.ply", folder);
    check(itn_mesh_save_ply(&mesh, path, NULL) == ITN_ERROR_FILE, "there is no such folder");
}

/* Scenes that ship, with meshes, sky and maps, load; so does the network. */
static void shipped(const char *scenes) {
    static const char *const names[] = {"default", "data", "still", "rgb", "spectral"};
    char path[1000];
    itn_error error = ITN_ZERO;
    for (size_t k = 0; k < sizeof names / sizeof *names; k++) {
        itn_scene *scene = NULL;
        snprintf(path, sizeof path, "%s/%s.itn", scenes, names[k]);
        check(itn_scene_load(path, NULL, &scene, &error) == ITN_OK, path);
        if (!scene) printf("  %s\n", error.message);
        itn_scene_free(scene);
    }
#ifndef ITN_NO_NET
    itn_net *net = NULL;
    snprintf(path, sizeof path, "%s/data.net", scenes);
    check(itn_net_open(path, 1, NULL, &net, &error) == ITN_OK, path);
    itn_net_free(net);
#endif
}
#endif

/* ---- comparing ------------------------------------------------------------------------------- */

enum { MOST = 4096 };
typedef struct picture {
    char name[200];
    int count;
    float values[MOST];
} picture;
static int read_plane(FILE *in, picture *p) {
    if (fscanf(in, "%199[^ ] %d", p->name, &p->count) != 2 || p->count > MOST) return 0;
    for (int k = 0; k < p->count; k++)
        if (fscanf(in, "%f", &p->values[k]) != 1) return 0;
    return fscanf(in, "%*[\r\n]") >= 0 || 1;
}
static int by_size(const void *a, const void *b) {
    float x = *(const float *)a, y = *(const float *)b;
    return x < y ? -1 : x > y;
}

/* Planes come in pairs: values and their variances; those of a network have none, and are the same
   but for rounding. */
static int compare(const char *first, const char *second) {
    static picture a[2], b[2];
    FILE *in = fopen(first, "r"), *other = fopen(second, "r");
    double worst[3] = {0, 0, 0};
    int planes = 0, bad = 0;
    check(in && other, "both were written");
    while (in && other && read_plane(in, &a[0])) {
        int single = !strncmp(a[0].name, "network", 7), found = 0;
        float off[MOST];
        if (!single && !read_plane(in, &a[1])) break;
        rewind(other);
        while (!found && read_plane(other, &b[0])) found = !strcmp(a[0].name, b[0].name);
        if (!found) continue; /* not of this build */
        check(a[0].count == b[0].count && (single || read_plane(other, &b[1])), a[0].name);
        double sum = 0, variance = 0;
        for (int k = 0; k < a[0].count; k++) {
            double d = (double)b[0].values[k] - (double)a[0].values[k];
            double v = single ? 1e-10 : (double)a[1].values[k] + (double)b[1].values[k] + 1e-12;
            sum += d, variance += v, off[k] = (float)(fabs(d) / sqrt(v));
        }
        qsort(off, (size_t)a[0].count, sizeof *off, by_size);
        double found_off[3] = {fabs(sum) / sqrt(variance), (double)off[a[0].count - 1],
                               (double)off[a[0].count * 9 / 10]};
        static const double most[3] = {1, 4, .1};
        for (int k = 0; k < 3; k++) {
            if (!(found_off[k] <= most[k])) bad++;
            if (found_off[k] > worst[k]) worst[k] = found_off[k];
        }
        check(!bad, a[0].name);
        planes++;
    }
    check(planes >= 9, "both have pictures");
    if (in) fclose(in);
    if (other) fclose(other);
    printf("means within %.2g, values %.2g, 9 of 10 of them %.1g errors; %d planes\n", worst[0],
           worst[1], worst[2], planes);
    return failed != 0;
}

#ifdef PORTABLE_OTHER /* the second of two files that both have the code: main of another name */
#define main portable_other
#endif
#ifdef __cplusplus
extern "C"
#endif
int portable_other(int count, char **words);
int main(int count, char **words) {
    if (count == 4 && !strcmp(words[3], "compare")) return compare(words[1], words[2]);
#ifdef PORTABLE_TWO
    check(count == 4 && !portable_other(count, words), "the other file's code");
#endif
    FILE *out = count == 4 ? fopen(words[1], "w") : NULL;
    if (!out)
        return printf("usage: portable OUT FOLDER SCENES, or portable OUT OTHER compare\n"), 2;
    furnace(ITN_MODE_REFERENCE);
    furnace(ITN_MODE_AUTO);
    render(out, "reference_matched", 1, -1, 0, ITN_MODE_REFERENCE);
    render(out, "reference_rough", 3, .2f, 1, ITN_MODE_REFERENCE);
#ifndef ITN_NO_FAST
    render(out, "fast_matched", 1, -1, 0, ITN_MODE_FAST);
    render(out, "fast_smooth", 1, 0, 0, ITN_MODE_FAST);
    render(out, "fast_rough", 3, .2f, 1, ITN_MODE_FAST);
#endif
    search();
    at_once();
#ifndef ITN_NO_NET
    network(out, words[2]);
#endif
#ifndef ITN_NO_STDIO
    files(words[2]);
    shipped(words[3]);
#endif
    fclose(out);
    printf("portable: %d passed, %d failed\n", passed, failed);
    return failed != 0;
}
