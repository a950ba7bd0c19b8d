/* Media with a sigma_t and g for each channel. Whatever the channels share in a walk, each of them
   must come out as if it were alone: its image and derivatives are compared, region by region, with
   those of a scene of one channel that has its values, within 4.5 standard errors of the
   difference, which themselves must be small. */
#define ITN_IMPLEMENTATION
#include "../itn.h"

#include "check.h"
#include "solids.h"
#include "stage.h"

enum { SIZE = 8, MOST_PARAMETERS = 24 };

/* What differs between channels. */
typedef struct spectrum {
    double sigma_t[3], albedo[3], g[3];
} spectrum;

typedef enum kind { MATCHED, ROUGH, SKY, NESTED } kind;

typedef struct subject {
    const char *name;
    kind what;
    spectrum medium;
    double shade; /* a radiance that makes light bluer would hide mistakes, so all light is grey */
    double largest[2]; /* standard errors of the image and of a derivative, relative to the largest
                          value of its kind in the scene */
    int spp;
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

/* The scene with all channels (channel -1), or that of one of them. */
static itn_scene *make_scene(const subject *in, int channel) {
    static const spectrum plain = {{1.5, 1.5, 1.5}, {.9, .8, .7}, {.2, .2, .2}};
    itn_mesh ball = solids_sphere(1, 2), core = solids_sphere(.6, 1);
    itn_image map = stage_patch(1, .1, .4, 6);
    itn_scene *scene;
    stage s;
    stage_begin(&s, SIZE, 4, 30);
    s.desc.film.channels = channel < 0 ? 3 : 1;
    s.desc.camera.eye.y = 1;
    add_medium(&s, "m", &in->medium, channel);
    if (in->what == MATCHED) {
        stage_object(&s, &ball, "m", NULL);
        stage_map(&s, "light", &map);
    } else if (in->what == ROUGH) {
        stage_dielectric(&s, "glass", 1.4, .3);
        stage_object(&s, &ball, "m", "glass");
        stage_map(&s, "light", &map);
        stage_constant(&s, "room", .3);
    } else if (in->what == SKY) {
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
    for (k = 0; k < itn_parameter_count(scene); k++)
        if (!strstr(itn_parameter_get(scene, k)->name, ".ior")) parameters[count++] = k;
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
    for (y = 0; y < SIZE; y++)
        for (x = 0; x < SIZE; x++) {
            int quarter = 1 + 2 * (y >= SIZE / 2) + (x >= SIZE / 2);
            if (region && quarter != region) continue;
            *mean += value[y * SIZE + x], *spread += variance[y * SIZE + x], count++;
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

/* Sum of (difference / standard error)^2 over comparisons, and how many. */
static double chi_square, comparisons;

/* Compares one plane (-1: the image, else a derivative) of a channel with that of the channel
   alone. `k` and `alone_k` count the planes; -1 in alone_k: must be 0. */
static void compare_plane(const subject *in, const char *name, const itn_image *image, int k,
                          const itn_image *alone, int alone_k, int channel) {
    const int pixels = SIZE * SIZE;
    const float *value = image->pixels + (6 * (k + 1) + channel) * pixels;
    const float *other = alone->pixels + 2 * (alone_k + 1) * pixels;
    double mean, spread, expected, error, largest = 0;
    int region;
    for (region = 0; region < pixels && alone_k == -2; region++) largest += fabs(value[region]);
    if (alone_k == -2) {
        check_report(largest == 0, __FILE__, __LINE__, "%s %s: channel %d feels it", in->name, name,
                     channel);
        return;
    }
    for (region = 0; region < 5; region++) {
        region_mean(value, value + 3 * pixels, region, &mean, &spread);
        region_mean(other, other + pixels, region, &expected, &error);
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
            check_report(error <= in->largest[0] * largest, __FILE__, __LINE__,
                         "%s %s, channel %d is blunt: %.3g of %.3g", in->name, name, channel,
                         error, largest);
    }
}

/* `planted`: an error in sigma_t of all channels but the last, relative. no_draw: the hero is not
   drawn but always channel 0. */
static void test_channels(const subject *in, double planted, int no_draw) {
    subject off = *in;
    int parameters[MOST_PARAMETERS], alone_parameters[MOST_PARAMETERS], count, alone_count, c, k, j;
    itn_scene *scene;
    itn_image image = ITN_ZERO;
    for (c = 0; c < 2; c++) off.medium.sigma_t[c] *= 1 + planted;
    scene = make_scene(&off, -1);
    CHECK(scene->spectral);
    if (no_draw) scene->spectral = 0;
    count = parameters_of(scene, parameters);
    render(scene, in->spp, 1, parameters, count, &image);
    for (c = 0; c < 3; c++) {
        itn_scene *alone = make_scene(in, c);
        itn_image picture = ITN_ZERO;
        CHECK(!alone->spectral);
        alone_count = parameters_of(alone, alone_parameters);
        render(alone, in->spp, (uint64_t)c + 2, alone_parameters, alone_count, &picture);
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
    {"matched", MATCHED, {{2, 4, 7}, {.95, .9, .8}, {.6, .2, -.3}}, 0, {.02, .1}, 512},
    {"rough", ROUGH, {{1, 3, 5}, {.95, .9, .7}, {.5, .3, .2}}, 0, {.02, .1}, 512},
    {"sky", SKY, {{1, 2, 4}, {.9, .8, .7}, {.4, .4, .4}}, 0, {.02, .1}, 512},
    {"thick", MATCHED, {{.2, 6, 40}, {.9, .95, .9}, {0, .5, .9}}, 0, {.03, .1}, 512},
    {"clear", ROUGH, {{0, 2, 6}, {.8, .9, .95}, {.3, .3, .3}}, 0, {.03, .1}, 512},
    {"turns", MATCHED, {{4, 4, 4}, {.9, .9, .9}, {.9, 0, -.7}}, 0, {.02, .1}, 512},
    {"nested", NESTED, {{1, 4, 9}, {.95, .8, .9}, {.5, 0, -.2}}, 0, {.03, .1}, 512}};

int main(void) {
    size_t i;
    for (i = 0; i < sizeof subjects / sizeof subjects[0]; i++) test_channels(&subjects[i], 0, 0);
    if (getenv("SHOW")) printf("chi^2 %.3f of %.0f\n", chi_square / comparisons, comparisons);
    CHECK_CATCHES(test_channels(&subjects[0], .1, 0));
    CHECK_CATCHES(test_channels(&subjects[0], 0, 1));
    return check_end("spectral");
}
