/* Trains the network with which searches begin: it reads sigma_t, albedo and g of one medium off a
   picture, by what is known of the scene, whatever that is (itn_probes_read).

   You learn: how to draw scenes of all kinds; how a network learns to say how sure it is; and how
   to find out whether that is true of shapes that it has never seen, by leaving out some in turn.

   Compile: cc -O3 -march=native -DITN_THREADS known.c -o known -lm -lpthread
   Run:     ./known ../scenes/known.net --shapes ../scenes/shapes
            ./known ../scenes/known.net --shapes other/shapes --try 60
   Scenes are drawn at random: a shape (one of the folder's .ply and .obj files), stretched and
   turned, of any size, with no surface, a smooth or a rough one, on a ground or not, in constant
   light, light of a map or of a sky, seen from anywhere. Media have an optical thickness of .7 to 60
   (evenly in its logarithm), albedos of .35 to .985 (evenly in their coordinate) and a g of -.1 to
   .9. What a network sees of their pictures (itn_probes_features) goes to NET.features, where a run
   that was stopped goes on; the same NET.features gives the same network.
   240 scenes of 16 pictures take ten minutes of processor time. The network is trained five times:
   four times without a fourth of the shapes, with which it is tried, and once with all. By as much
   as the four were farther off than they expected, the error bars of the last one are made wider.
   Writes NET, and NET.txt, which says what it is of, and what the four read of shapes left out, of
   pictures in units of the lights (known) and in their own:
            known 3840 pictures: sigma_t x1.398 (90 % x2.44)  albedo 0.035 (0.148)  g 0.169 (0.411)
            within 1 error 0.68 0.68 0.68, 2 errors 0.94 0.95 0.95
   --try N does the same for N pictures of scenes that it has not seen, and trains nothing. */
#define _POSIX_C_SOURCE 200809L
#define _DARWIN_C_SOURCE /* else macOS hides sysconf's number of processors */
#include "dataset.h"

#include <dirent.h>

enum { FEATURES = ITN_PROBE_FEATURES, SIDE = 32, PHOTOS = 16, BATCH = 64, UNITS = 32, FOLDS = 4,
       MOST_SHAPES = 64, MAP = 32 };

static const char usage[] =
    "usage: known NET --shapes DIR [--scenes N] [--epochs N] [--seed N] [--sky FILE] [--try N]\n"
    "             [-t THREADS]\n";

/* What is learnt from: a picture as a network sees it, in known and in own units, and the truth:
   the coordinates of optical thickness, albedo and g, and the values. */
typedef struct photo {
    float features[2][FEATURES], coordinates[3], values[3];
} photo;

/* All pictures of a scene. */
typedef struct record {
    int32_t shape, count;
    photo photos[PHOTOS];
} record;

typedef struct settings {
    const char *net, *shapes, *sky;
    int scenes, epochs, tries, threads;
    uint64_t seed;
    char *meshes[MOST_SHAPES];
    int mesh_count, first; /* number of the first scene of `records` */
    record *records;
} settings;

/* ---- scenes ---- */

static double between(uint64_t *random, double a, double b) {
    return a + (b - a) * .5 * (draw(random) + 1);
}
static int below(uint64_t *random, int count) {
    return (int)(.5 * (draw(random) + 1) * count);
}
/* Evenly in the logarithm. */
static double factor(uint64_t *random, double a, double b) {
    return exp(between(random, log(a), log(b)));
}

/* A latitude-longitude map of a few soft lamps before a light that is brighter above or below, as
   the bytes of a PFM file. Returns their number. */
static size_t draw_map(uint64_t *random, char *bytes) {
    int lamps = 1 + below(random, 4), i, j, l, length;
    double base = factor(random, .05, 1), up = .8 * draw(random), lamp[4][5];
    length = sprintf(bytes, "Pf\n%d %d\n-1\n", MAP, MAP / 2);
    for (l = 0; l < lamps; l++) {
        double size = 1e-6;
        for (j = 0; j < 3; j++) lamp[l][j] = j == 1 ? between(random, -.4, 1) : draw(random);
        for (j = 0; j < 3; j++) size += lamp[l][j] * lamp[l][j];
        for (j = 0; j < 3; j++) lamp[l][j] /= sqrt(size);
        lamp[l][3] = factor(random, 2.7, 90);
        lamp[l][4] = factor(random, 1, 4.5) * sqrt(lamp[l][3]);
    }
    for (i = 0; i < MAP * MAP / 2; i++) {
        double u = 2 * 3.14159265 * (i % MAP + .5) / MAP, light;
        double v = 3.14159265 * (1 - i / MAP / (MAP / 2 - 1.)), value[3]; /* the last row first */
        float pixel;
        value[0] = sin(u) * sin(v), value[1] = cos(v), value[2] = -cos(u) * sin(v);
        light = base * (1 + up * value[1]);
        for (l = 0; l < lamps; l++) {
            double cosine = -1;
            for (j = 0; j < 3; j++) cosine += lamp[l][j] * value[j];
            light += lamp[l][4] * exp(lamp[l][3] * cosine);
        }
        pixel = (float)light;
        memcpy(bytes + length + 4 * (size_t)i, &pixel, 4);
    }
    return (size_t)length + 4 * MAP * MAP / 2;
}

/* Adds a line of a scene file. */
#define SAY(...) (at += snprintf(text + at, sizeof text - (size_t)at, __VA_ARGS__))

/* A scene of that number with a shape; NULL if that can not be used. */
static itn_scene *draw_scene(const settings *s, uint64_t random, int shape) {
    char text[4096], map[64 + 2 * MAP * MAP];
    double low[3], high[3], size = 0, scale = factor(&random, .2, 5), stretch[3], reach = 0, fov;
    double angle = between(&random, 0, 6.2832), height, distance, turn = between(&random, 0, 360);
    int ground = below(&random, 5) < 2, kind = below(&random, 4), skin = below(&random, 9), at = 0;
    int i, j;
    itn_file file = ITN_ZERO;
    itn_context context = ITN_ZERO;
    itn_scene *scene;
    itn_mesh mesh;
    itn_error error;
    if (itn_mesh_load(s->meshes[shape], NULL, &mesh, &error)) fail(error.message, "");
    for (j = 0; j < 3; j++) low[j] = 1e30, high[j] = -1e30;
    for (i = 0; i < 3 * mesh.vertex_count; i++) {
        low[i % 3] = fmin(low[i % 3], (double)mesh.positions[i]);
        high[i % 3] = fmax(high[i % 3], (double)mesh.positions[i]);
    }
    itn_mesh_free(&mesh);
    for (j = 0; j < 3; j++) size = fmax(size, (high[j] - low[j]) / 2);
    for (j = 0; j < 3; j++) stretch[j] = scale * factor(&random, .67, 1.5) / size;
    for (j = 0; j < 3; j++) reach = fmax(reach, stretch[j] * (high[j] - low[j]) / 2);
    height = ground ? between(&random, .15, 1) : between(&random, -.7, 1.2);
    distance = between(&random, 3, 10) * reach;
    fov = 115 * atan(between(&random, .9, 1.8) * reach / distance);
    SAY("film width %d height %d\nmedium milk sigma_t 1 albedo .5 g .1\n", SIDE, SIDE);
    SAY("camera eye %g %g %g target 0 0 0 fov %g\n", distance * cos(angle) * cos(height),
        distance * sin(height), distance * sin(angle) * cos(height), fov);
    if (skin > 3) SAY("surface skin type dielectric ior %g", between(&random, 1.2, 1.6));
    if (skin > 5) SAY(" alpha %g", factor(&random, .05, .5));
    SAY("\nobject mesh %s medium milk %s translate %g %g %g scale %g %g %g ", s->meshes[shape],
        skin > 3 ? "surface skin" : "", -(low[0] + high[0]) / 2, -(low[1] + high[1]) / 2,
        -(low[2] + high[2]) / 2, stretch[0], stretch[1], stretch[2]);
    if (ground)
        SAY("rotate 0 1 0 %g\nsurface floor type diffuse reflectance %g\nobject plane y %g half %g "
            "surface floor\n", turn, between(&random, .05, .8),
            -stretch[1] * (high[1] - low[1]) / 2 - 1e-4 * scale, 30 * reach);
    else
        SAY("rotate %g %g %g %g\n", draw(&random), 1.1 + draw(&random), draw(&random), turn);
    if (kind == 0) SAY("light constant radiance %g\n", factor(&random, .1, 50));
    if (kind == 1 || kind == 2) {
        file.name = "map.pfm", file.bytes = map, file.size = draw_map(&random, map);
        SAY("light map map.pfm scale %g\n", factor(&random, .1, 20));
    }
    if (kind == 3) {
        double sun = between(&random, 0, 6.2832), up = between(&random, .3, 1.4);
        SAY("light sky %s sun %g %g %g sun_scale %g sun_radius_scale %g\n", s->sky,
            cos(sun) * cos(up), sin(up), sin(sun) * cos(up), factor(&random, .14, 2.7),
            factor(&random, 12, 90));
    }
    context.threads = 1;
    if (!itn_scene_from_memory(text, (size_t)at, NULL, &file, file.name != NULL, &context, &scene,
                               &error))
        return scene;
    fprintf(stderr, "%s: %s\n", s->meshes[shape], error.message);
    return NULL;
}

/* ---- pictures ---- */

/* Draws a medium, and what the network is to answer. */
static void draw_medium(const itn_scene *scene, uint64_t *random, const int at[3], double chord,
                        photo *p, float *theta) {
    int k;
    p->values[0] = (float)factor(random, .7, 60);
    p->values[1] = (float)(1 / (1 + exp(-between(random, -.6, 4.2))));
    p->values[2] = (float)between(random, -.1, .9);
    for (k = 0; k < 3; k++) {
        theta[at[k]] = k ? p->values[k] : (float)(p->values[k] / chord);
        p->coordinates[k] = (float)itn_parameter_to_coordinate(itn_parameter_get(scene, at[k]),
                                                               (double)theta[at[k]]);
    }
    p->coordinates[0] += (float)log(chord);
}

/* Adds noise of .7 to 8 % to a picture, and its variance to what is behind. */
static void add_noise(uint64_t *random, float *pixels, float *variance) {
    double noise = factor(random, .007, .08);
    int i;
    for (i = 0; i < SIDE * SIDE; i++) {
        double own = noise * (double)pixels[i];
        variance[i] += (float)(own * own);
        pixels[i] += (float)(own * (draw(random) + draw(random) + draw(random)));
    }
}

/* Makes the pictures of a scene; none of one that cannot be read. */
static void make_record(void *task, int index) {
    settings *s = (settings *)task;
    record *r = &s->records[index];
    uint64_t random = mix(s->seed, (uint64_t)(s->first + index), 7);
    itn_render_options options = ITN_ZERO;
    itn_scene *scene;
    itn_probes *probes;
    itn_error error;
    float theta[32];
    double chord;
    int at[3], k;
    memset(r, 0, sizeof *r);
    r->shape = below(&random, s->mesh_count);
    scene = draw_scene(s, random, r->shape);
    if (!scene) return;
    for (k = 0; k < 3; k++) at[k] = itn_parameter_find(scene, theta_names[k]);
    chord = itn_scene_thickness(scene, NULL, "milk"); /* sigma_t is 1 */
    itn_parameter_values(scene, theta);
    if (itn_probes_make(scene, NULL, mix(random, 1, 0), &probes, &error)) {
        fprintf(stderr, "%s: %s\n", s->meshes[r->shape], error.message);
        itn_scene_free(scene);
        return;
    }
    for (k = 0; k < PHOTOS; k++) {
        photo *p = &r->photos[r->count];
        itn_image image;
        int tells = below(&random, 3) > 0, own, bad = 0;
        draw_medium(scene, &random, at, chord, p, theta);
        options.spp = 96, options.walks = 1, options.seed = mix(random, 2, (uint64_t)k);
        if (itn_render(scene, theta, &options, NULL, 0, &image, &error)) fail(error.message, "");
        add_noise(&random, image.pixels, image.pixels + SIDE * SIDE);
        for (own = 0; own < 2; own++)
            bad |= itn_probes_features(probes, image.pixels,
                                       tells ? image.pixels + SIDE * SIDE : NULL, !own,
                                       p->features[own], &error) != ITN_OK;
        r->count += !bad;
        itn_image_free(&image);
    }
    itn_probes_free(probes);
    itn_scene_free(scene);
}

/* Reads what there is of records, makes the rest, and adds it to the file as it comes. */
static void make_records(settings *s, const char *path) {
    FILE *file = fopen(path, "ab+");
    record *all = (record *)need((size_t)s->scenes, sizeof *all);
    int have, more;
    double begun = seconds();
    if (!file) fail(path, "cannot be written");
    rewind(file);
    have = s->first = (int)fread(all, sizeof *all, (size_t)s->scenes, file);
    while (s->first < s->scenes) {
        more = s->scenes - s->first < 8 ? s->scenes - s->first : 8;
        s->records = all + s->first;
        parallel_for(more, make_record, s, &s->threads);
        if (fseek(file, (long)(sizeof *all * (size_t)s->first), SEEK_SET) ||
            fwrite(s->records, sizeof *all, (size_t)more, file) != (size_t)more || fflush(file))
            fail(path, "cannot be written");
        s->first += more;
        fprintf(stderr, "\r%d of %d scenes, %.0f s left  ", s->first, s->scenes,
                (seconds() - begun) / (s->first - have) * (s->scenes - s->first));
    }
    fclose(file);
    s->records = all;
}

/* ---- networks ---- */

/* What a network is trained with, or tried: of each picture, which is shown in known units and in
   its own. */
typedef struct sample {
    const photo *of;
    int own;
} sample;

static int list_samples(const settings *s, int fold, int inside, sample *samples) {
    int i, k, count = 0;
    for (i = 0; i < s->scenes; i++)
        for (k = 0; k < 2 * s->records[i].count; k++) {
            if ((s->records[i].shape % FOLDS == fold) != inside) continue;
            if (samples) samples[count].of = &s->records[i].photos[k / 2];
            if (samples) samples[count].own = k % 2;
            count++;
        }
    return count;
}

/* Means and deviations of the features; the last one, 1, stays. */
static void measure(const sample *samples, int count, float *mean, float *deviation) {
    int i, j;
    for (j = 0; j < FEATURES; j++) {
        double sum = 0, squares = 0;
        for (i = 0; i < count; i++) {
            double x = (double)samples[i].of->features[samples[i].own][j];
            sum += x / count, squares += x * x / count;
        }
        mean[j] = j < FEATURES - 1 ? (float)sum : 0;
        deviation[j] = j < FEATURES - 1 ? (float)sqrt(fmax(squares - sum * sum, 1e-6)) : 1;
    }
}

/* Lets a network that was trained on features less their mean, over their deviation, take them as
   they are: of a sum of weights times these, what the means make goes to the weight of the 1. */
static void take_features(itn_net *net, const float *mean, const float *deviation) {
    float *weights = itn_net_parameters(net, NULL);
    int tap, j, o;
    for (tap = 0; tap < 9; tap++, weights += FEATURES * UNITS)
        for (j = 0; j < FEATURES - 1; j++)
            for (o = 0; o < UNITS; o++) {
                float *w = weights + j * UNITS + o;
                *w /= deviation[j];
                weights[(FEATURES - 1) * UNITS + o] -= *w * mean[j];
            }
}

/* Half of the negative logarithm of a normal density, and its gradient: predicted are means and
   logarithms of variances. */
static double normal_loss(const float predicted[6], const float truth[3], float gradient[6]) {
    double loss = 0;
    int k;
    for (k = 0; k < 3; k++) {
        double off = (double)predicted[k] - (double)truth[k];
        double log_variance = fmax(-6, fmin((double)predicted[3 + k], 4));
        double precision = exp(-log_variance);
        gradient[k] = (float)(off * precision);
        gradient[3 + k] = (float)(.5 * (1 - off * off * precision) +
                                  .1 * ((double)predicted[3 + k] - log_variance));
        loss += .5 * (off * off * precision + log_variance);
    }
    return loss;
}

/* Trains a network with the samples. The rate falls as a cosine does. As there are more weights than
   pictures, they decay, and features are shown with noise of a fifth of their deviations. */
static itn_net *train(const settings *s, const sample *samples, int count) {
    itn_net_desc desc = ITN_ZERO;
    itn_net *net;
    itn_error error;
    float mean[FEATURES], deviation[FEATURES], *inputs, *weights, *slopes;
    float answers[6 * BATCH], gradients[6 * BATCH];
    int *order = (int *)need((size_t)count, sizeof *order), epoch, first, i, j, k;
    uint64_t random = s->seed;
    size_t size, w;
    desc.width = desc.height = 2, desc.channels = FEATURES, desc.layer_count = 1;
    desc.first_channels = UNITS, desc.outputs = 6, desc.batch = BATCH, desc.seed = s->seed;
    if (itn_net_create(&desc, NULL, &net, &error)) fail(error.message, "");
    inputs = (float *)need((size_t)BATCH * FEATURES * 4, sizeof *inputs);
    weights = itn_net_parameters(net, &size), slopes = itn_net_gradients(net, NULL);
    for (w = 0; w < 9 * FEATURES * UNITS; w++) weights[w] *= .5f; /* four pixels have one feature */
    measure(samples, count, mean, deviation);
    for (i = 0; i < count; i++)
        for (k = 0; k < 3; k++)
            weights[size - 6 + (size_t)k] += samples[i].of->coordinates[k] / (float)count;
    for (epoch = 0; epoch < s->epochs; epoch++) {
        double rate = 1e-3 * (1 + cos(3.14159265 * epoch / s->epochs)) + 1e-6, loss = 0;
        shuffle(order, count, mix(s->seed, (uint64_t)epoch, 9));
        for (first = 0; first + BATCH <= count; first += BATCH) {
            for (i = 0; i < BATCH * FEATURES; i++) {
                const sample *one = &samples[order[first + i / FEATURES]];
                double noise = draw(&random) + draw(&random) + draw(&random); /* of variance 1 */
                j = i % FEATURES;
                inputs[4 * i] = (one->of->features[one->own][j] - mean[j]) / deviation[j] +
                                (j < FEATURES - 2 ? .2f * (float)noise : 0);
                for (k = 1; k < 4; k++) inputs[4 * i + k] = inputs[4 * i];
            }
            if (itn_net_forward(net, BATCH, inputs, answers, &error)) fail(error.message, "");
            for (i = 0; i < BATCH; i++)
                loss += normal_loss(answers + 6 * i, samples[order[first + i]].of->coordinates,
                                    gradients + 6 * i) / count;
            for (i = 0; i < 6 * BATCH; i++) gradients[i] /= BATCH;
            itn_net_zero_gradients(net);
            if (itn_net_backward(net, BATCH, gradients, &error)) fail(error.message, "");
            for (w = 0; w < size - 6; w++) slopes[w] += 3e-3f * weights[w];
            if (itn_net_step(net, rate, &error)) fail(error.message, "");
        }
        if (epoch % 10 == 9) fprintf(stderr, "\repoch %d, loss %.3f  ", epoch + 1, loss);
    }
    take_features(net, mean, deviation);
    free(inputs), free(order);
    return net;
}

/* ---- trials ---- */

/* What was read of a picture: errors of the logarithm of sigma_t, of albedo and g; and how many of
   the deviations expected they are, in coordinates. */
typedef struct reading {
    int own;
    double errors[3], sigmas[3];
} reading;

static void try_samples(itn_net *net, const sample *samples, int count, reading *readings) {
    int i, k;
    for (i = 0; i < count; i++) {
        const photo *p = samples[i].of;
        float inputs[4 * FEATURES], answer[6];
        itn_error error;
        for (k = 0; k < 4 * FEATURES; k++) inputs[k] = p->features[samples[i].own][k / 4];
        if (itn_net_forward(net, 1, inputs, answer, &error)) fail(error.message, "");
        readings[i].own = samples[i].own;
        for (k = 0; k < 3; k++) {
            double off = (double)answer[k] - (double)p->coordinates[k], value = (double)answer[k];
            readings[i].sigmas[k] = off * exp(-.5 * (double)answer[3 + k]);
            if (k == 1) off = 1 / (1 + exp(-value)) - (double)p->values[1];
            if (k == 2) off = -.999 + 1.998 / (1 + exp(-value)) - (double)p->values[2];
            readings[i].errors[k] = off;
        }
    }
}

/* The size that a part of the errors, or of the sigmas, of readings in known or own units lie
   below. */
static double quantile(const reading *readings, int count, int own, int k, int sigmas,
                       double part) {
    double *sizes = (double *)need((size_t)count, sizeof *sizes), found;
    int i, n = 0;
    for (i = 0; i < count; i++)
        if (readings[i].own == own || own < 0)
            sizes[n++] = fabs((sigmas ? readings[i].sigmas : readings[i].errors)[k]);
    qsort(sizes, (size_t)n, sizeof *sizes, ascending);
    found = n ? sizes[(int)(part * (n - 1))] : 0;
    free(sizes);
    return found;
}

/* Prints how well pictures were read; the errors expected are to be `wider` times what they are. */
static void print_readings(const reading *readings, int count, const double wider[3], FILE *file) {
    int own, i, k;
    for (own = 0; own < 2; own++) {
        int n = 0, within[2][3] = {{0, 0, 0}, {0, 0, 0}};
        for (i = 0; i < count; i++) {
            if (readings[i].own != own) continue;
            for (k = 0; k < 3; k++) {
                within[0][k] += fabs(readings[i].sigmas[k]) < wider[k];
                within[1][k] += fabs(readings[i].sigmas[k]) < 2 * wider[k];
            }
            n++;
        }
        fprintf(file, "%s %d pictures: sigma_t x%.3f (90 %% x%.2f)  albedo %.3f (%.3f)  "
                "g %.3f (%.3f)  within 1 error", own ? "own units" : "known", n,
                exp(quantile(readings, count, own, 0, 0, .5)),
                exp(quantile(readings, count, own, 0, 0, .9)),
                quantile(readings, count, own, 1, 0, .5), quantile(readings, count, own, 1, 0, .9),
                quantile(readings, count, own, 2, 0, .5), quantile(readings, count, own, 2, 0, .9));
        for (i = 0; i < 6; i++)
            fprintf(file, "%s %.2f", i == 3 ? ", 2 errors" : "",
                    (double)within[i / 3][i % 3] / (n ? n : 1));
        fprintf(file, "\n");
    }
}

/* Trains with all shapes but those of a fold in turn, tries it with these, then trains with all. */
static itn_net *train_all(const settings *s, FILE *report) {
    int all = list_samples(s, -1, 0, NULL), tried = 0, fold, k;
    sample *samples = (sample *)need((size_t)all, sizeof *samples);
    reading *readings = (reading *)need((size_t)all, sizeof *readings);
    double wider[3];
    size_t size;
    itn_net *net;
    if (all < 4 * BATCH) fail("--scenes", "are too few");
    for (fold = 0; fold < FOLDS; fold++) {
        net = train(s, samples, list_samples(s, fold, 0, samples));
        k = list_samples(s, fold, 1, samples);
        try_samples(net, samples, k, readings + tried);
        itn_net_free(net), tried += k;
    }
    net = train(s, samples, list_samples(s, -1, 0, samples));
    for (k = 0; k < 3; k++) {
        wider[k] = quantile(readings, all, -1, k, 1, .6827);
        itn_net_parameters(net, &size);
        itn_net_parameters(net, NULL)[size - 3 + (size_t)k] += (float)(2 * log(wider[k]));
    }
    fprintf(report, "left out: errors expected made wider x%.3g x%.3g x%.3g\n", wider[0], wider[1],
            wider[2]);
    print_readings(readings, all, wider, report);
    free(samples), free(readings);
    return net;
}

static void list_meshes(settings *s) {
    DIR *folder = opendir(s->shapes);
    struct dirent *entry;
    int i, k;
    if (!folder) fail(s->shapes, "is no folder");
    while ((entry = readdir(folder)) != NULL) {
        const char *end = strrchr(entry->d_name, '.');
        char path[PATH_SIZE + 256];
        if (!end || (strcmp(end, ".ply") && strcmp(end, ".obj")) || s->mesh_count == MOST_SHAPES)
            continue;
        snprintf(path, sizeof path, "%s/%s", short_path(s->shapes), entry->d_name);
        s->meshes[s->mesh_count] = (char *)need(strlen(path) + 1, 1);
        strcpy(s->meshes[s->mesh_count++], path);
    }
    closedir(folder);
    if (!s->mesh_count) fail(s->shapes, "has no meshes");
    for (i = 1; i < s->mesh_count; i++) /* by name */
        for (k = i; k > 0 && strcmp(s->meshes[k - 1], s->meshes[k]) > 0; k--) {
            char *swap = s->meshes[k];
            s->meshes[k] = s->meshes[k - 1], s->meshes[k - 1] = swap;
        }
}

int main(int argc, char **argv) {
    static const double as_they_are[3] = {1, 1, 1};
    settings s = {NULL, NULL, "../scenes/t3-e60-grey.sky", 240, 40, 0, 0, 1, {NULL}, 0, 0, NULL};
    char path[PATH_SIZE];
    itn_net *net;
    itn_error error;
    FILE *file;
    int i;
    s.threads = default_threads();
    for (i = 1; i < argc; i++) {
        const char *o = argv[i], *value = i + 1 < argc ? argv[i + 1] : NULL;
        if (o[0] != '-' && !s.net) s.net = short_path(o);
        else if (!value) fail(o, "needs a value, or is none of the options");
        else if (!strcmp(o, "--shapes")) s.shapes = value, i++;
        else if (!strcmp(o, "--sky")) s.sky = value, i++;
        else if (!strcmp(o, "--scenes")) s.scenes = whole(o, value, 1), i++;
        else if (!strcmp(o, "--epochs")) s.epochs = whole(o, value, 1), i++;
        else if (!strcmp(o, "--seed")) s.seed = (uint64_t)whole(o, value, 0), i++;
        else if (!strcmp(o, "--try")) s.tries = whole(o, value, 1), i++;
        else if (!strcmp(o, "-t")) s.threads = whole(o, value, 1), i++;
        else fail(o, "is no option");
    }
    if (!s.net || !s.shapes) return fprintf(stderr, "%s", usage), 1;
    list_meshes(&s);
    if (s.tries) {
        reading *readings;
        sample *samples;
        s.scenes = s.tries;
        s.records = (record *)need((size_t)s.scenes, sizeof *s.records);
        parallel_for(s.scenes, make_record, &s, &s.threads);
        i = list_samples(&s, -1, 0, NULL);
        samples = (sample *)need((size_t)i, sizeof *samples);
        readings = (reading *)need((size_t)i, sizeof *readings);
        list_samples(&s, -1, 0, samples);
        if (itn_net_open(s.net, 1, NULL, &net, &error)) fail(error.message, "");
        try_samples(net, samples, i, readings);
        print_readings(readings, i, as_they_are, stdout);
        return 0;
    }
    snprintf(path, sizeof path, "%s.features", s.net);
    make_records(&s, path);
    snprintf(path, sizeof path, "%s.txt", s.net);
    file = begin_file(path);
    fprintf(file, "itn known: scenes %d epochs %d seed %d shapes %d\n", s.scenes, s.epochs,
            (int)s.seed, s.mesh_count);
    net = train_all(&s, file);
    end_file(file, path);
    if (itn_net_save(net, s.net, 1, &error)) fail(error.message, "");
    return 0;
}
