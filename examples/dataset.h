/* The data set of the learning experiment: what is in it, its files, and how they are read.

   Che et al., "Inverse Transport Networks" (2018), train on pictures of six shapes under four suns
   and test on what the network has not seen. Here: ten shapes, suns at ten azimuths (0: from the
   side, 90: behind the object), and a grid of 12 x 5 x 5 materials. Four splits:
       train  6 shapes x 4 azimuths x 300 materials                             7,200 images
       shape  4 other shapes, the same azimuths                                 1,000
       light  the same shapes, 6 other azimuths                                 1,000
       both   4 other shapes x 6 other azimuths x 300 materials                 7,200
   Both sides have shapes that are bulky, flat, thin and finely detailed: shading tells a material
   apart only where it is known what thickness does to it, and no network learns that from blocks
   for chains, or from smooth shapes for teeth.
   For the same reason half of the training pictures show a variant of their shape, which is
   smoothed, bent, roughened, stretched and turned (vary_mesh in dataset.c): of a shape and light,
   29 of the 60 pairs of sigma_t and g have one of their own. So networks see 696 shapes of six
   families beside the six, and read new ones better. In the tests all are as they are. Variants
   have even numbers from 2 to 58.
   The images of one split, shape and azimuth are a shard, which is a file:
       a line of text that says what it is, padded with blanks to 256 bytes;
       per image four floats: sigma_t, albedo, g, and the noise (see image_noise in dataset.c);
       per image 128 x 128 pixels as 16-bit floats, row 0 on top;
       a checksum of all that (64 bits, FNV-1a).
   Numbers are little-endian. DIR/data.txt says which fraction of them DIR holds, and
   DIR/scenes has a scene file per shape and azimuth (and variant: cube-30-08.itn) with all that it
   needs, for render and invert, and three of other films (see film), for dataset and train; the
   checksums of meshes, ground and sky are in sums.txt.

   dataset.c writes all this; train.c and starts.c read it; known.c shares what is not of the data.
   Each compiles alone, with itn.h in it, or with -DITN_APART against one object of itn.h for all,
   as experiment.sh does. */
#ifndef DATASET_H
#define DATASET_H

#ifndef ITN_APART
#define ITN_IMPLEMENTATION
#endif
#include "../itn.h"

#include <errno.h>
#include <math.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <time.h>
#include <unistd.h>
#ifdef _WIN32
#include <direct.h>
#define mkdir(path, mode) _mkdir(path)
#endif

enum {
    SHAPES = 10,
    TRAINING_SHAPES = 6,
    AZIMUTHS = 10,
    MATERIALS = 300,
    PAIRS = 60, /* of sigma_t and g; numbers of variants are below it */
    FILM = 128, /* pixels each way */
    PIXELS = FILM * FILM,
    SMALL = 32, /* pixels each way of what training renders */
    SMALL_PIXELS = SMALL * SMALL,
    PARTS = 2,  /* pixels each way, of the film from which pictures are made, per pixel of theirs */
    MARGIN = 8, /* more of them on each side, as far as the filter reaches */
    FINE = PARTS * FILM + 2 * MARGIN,
    FINE_PIXELS = FINE * FINE,
    VERSION = 9, /* of the data */
    MOST_SHARDS = 64, /* of a split */
    PATH_SIZE = 1024,
    HEADER_SIZE = 256,
    RECORD = 4 /* floats per image before the pixels */
};

/* A picture's filter is a Gaussian of this deviation in pixels, about that of a lens. */
#define DEVIATION 1.

/* The films on which a shape under a light is rendered: a picture; a fine one, from which a picture
   is made that has less noise; the same in three channels, for three pictures whose albedos differ,
   as colours; and a small one, for training. */
typedef enum film { FILM_ONE = 0, FILM_FINE, FILM_FAMILY, FILM_SMALL, FILMS } film;

typedef enum split { SPLIT_TRAIN = 0, SPLIT_SHAPE, SPLIT_LIGHT, SPLIT_BOTH, SPLITS } split;

static const char *const split_names[SPLITS] = {"train", "shape", "light", "both"};
static const int split_totals[SPLITS] = {7200, 1000, 1000, 7200};
static const char *const shape_names[SHAPES] = {"cube", "star",   "leaf", "hound", "bolt", "chain",
                                                "blob", "relief", "gear", "figurine"};
/* ascending, in tens of degrees; the first of each list is the training lights */
static const int azimuth_lists[2][6] = {{0, 30, 60, 90, -1, -1}, {10, 20, 40, 50, 70, 80}};
static const int azimuth_counts[2] = {4, 6};
static const float sigma_t_values[12] = {30, 36, 44, 54, 67, 82, 100, 122, 150, 184, 225, 276};
static const float albedo_values[5] = {.39f, .59f, .74f, .87f, .95f};
static const float g_values[5] = {0, .2f, .4f, .6f, .8f};
static const char *const theta_names[3] = {"milk.sigma_t", "milk.albedo", "milk.g"};

/* What the pictures of a shard have in common. */
typedef struct shard {
    split in;
    int shape, azimuth, count; /* azimuth in degrees */
} shard;

/* ---- small helpers of all programs ---- */

static inline void fail(const char *what, const char *why) {
    fprintf(stderr, "%s%s%s\n", what, *why ? ": " : "", why);
    exit(1);
}

static inline void *need(size_t count, size_t size) {
    void *block = calloc(count ? count : 1, size);
    if (!block) fail("out of memory", "");
    return block;
}

static inline double seconds(void) {
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return (double)now.tv_sec + 1e-9 * (double)now.tv_nsec;
}

/* The number that follows an option, in [lowest, highest], or the end of the program. */
static inline double number(const char *option, const char *text, double lowest, double highest) {
    char *end = NULL;
    double value = text ? strtod(text, &end) : 0;
    char why[80];
    const char *slash = text ? strchr(text, '/') : NULL;
    if (slash && slash != text && end == slash) value /= strtod(slash + 1, &end); /* 1/50 */
    snprintf(why, sizeof why, "needs a number from %.10g to %.10g", lowest, highest);
    if (!text || end == text || *end || !(value >= lowest && value <= highest)) fail(option, why);
    return value;
}

static inline int whole(const char *option, const char *text, int lowest) {
    double value = number(option, text, lowest, 2147483647);
    if (value != floor(value)) fail(option, "needs a whole number");
    return (int)value;
}

/* A path that leaves room for the names and endings that are added to it, or the end. */
static inline const char *short_path(const char *path) {
    if (strlen(path) > PATH_SIZE - 64) fail(path, "is too long a path");
    return path;
}

static inline void make_folder(const char *path) {
    if (mkdir(path, 0777) && errno != EEXIST) fail(path, "cannot be made");
}

/* A hash of up to three numbers with no visible order: whoever needs something random but
   repeatable asks for it by name. */
static inline uint64_t mix(uint64_t a, uint64_t b, uint64_t c) {
    uint64_t part[3], x = 0x9e3779b97f4a7c15u;
    int i;
    part[0] = a, part[1] = b, part[2] = c;
    for (i = 0; i < 3; i++) { /* the finaliser of splitmix64 */
        x += part[i] + 0x9e3779b97f4a7c15u;
        x = (x ^ (x >> 30)) * 0xbf58476d1ce4e5b9u;
        x = (x ^ (x >> 27)) * 0x94d049bb133111ebu;
        x ^= x >> 31;
    }
    return x;
}

/* Puts 0 .. count-1 into `order` in the random order that `seed` names (Fisher and Yates). */
static inline void shuffle(int *order, int count, uint64_t seed) {
    int i;
    for (i = 0; i < count; i++) order[i] = i;
    for (i = count - 1; i > 0; i--) {
        int j = (int)(mix(seed, (uint64_t)i, 0) % (uint64_t)(i + 1)), swap = order[i];
        order[i] = order[j], order[j] = swap;
    }
}

/* For qsort, of doubles. */
static inline int ascending(const void *a, const void *b) {
    double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

/* A random number in [-1,1); moves `random` on. */
static inline double draw(uint64_t *random) {
    *random = mix(*random, 1, 0);
    return (double)(*random >> 11) / 4503599627370496.0 - 1; /* 2^52 */
}

/* ---- a loop on several threads, also as itn_context.parallel_for ---- */

typedef struct loop {
    pthread_mutex_t lock;
    int next, count;
    void (*body)(void *task, int index);
    void *task;
} loop;

static inline void *loop_worker(void *argument) {
    loop *l = (loop *)argument;
    for (;;) {
        int index;
        pthread_mutex_lock(&l->lock);
        index = l->next++;
        pthread_mutex_unlock(&l->lock);
        if (index >= l->count) return NULL;
        l->body(l->task, index);
    }
}

/* As many threads as there are processors. */
static inline int default_threads(void) {
#ifdef _WIN32
    const char *counted = getenv("NUMBER_OF_PROCESSORS");
    long processors = counted ? strtol(counted, NULL, 10) : 1;
#else
    long processors = sysconf(_SC_NPROCESSORS_ONLN);
#endif
    return processors > 1 ? (int)processors : 1;
}

/* Calls body(task, i) for every i in [0, count), on as many threads as *threads says. */
static inline void parallel_for(int count, void (*body)(void *task, int index), void *task,
                         void *threads) {
    pthread_t others[256];
    int started = 0, wanted = *(int *)threads;
    loop l;
    l.next = 0, l.count = count, l.body = body, l.task = task;
    pthread_mutex_init(&l.lock, NULL);
    while (started + 1 < wanted && started + 1 < count && started < 256)
        if (pthread_create(&others[started], NULL, loop_worker, &l)) break;
        else started++;
    loop_worker(&l);
    while (started) pthread_join(others[--started], NULL);
    pthread_mutex_destroy(&l.lock);
}

/* ---- which pictures there are ---- */

/* Lists the shards of a split that have pictures; returns how many. */
static inline int list_shards(split in, double fraction, shard *shards) {
    int new_shape = in == SPLIT_SHAPE || in == SPLIT_BOTH;
    int new_light = in == SPLIT_LIGHT || in == SPLIT_BOTH;
    int first = new_shape ? TRAINING_SHAPES : 0, last = new_shape ? SHAPES : TRAINING_SHAPES;
    int azimuths = azimuth_counts[new_light], parts = (last - first) * azimuths, i, count = 0;
    int64_t total = (int64_t)(split_totals[in] * fraction + .5);
    for (i = 0; i < parts; i++) { /* shares that differ by one at most */
        shard *s = &shards[count];
        s->in = in;
        s->shape = first + i / azimuths;
        s->azimuth = azimuth_lists[new_light][i % azimuths];
        s->count = (int)(total * (i + 1) / parts - total * i / parts);
        count += s->count > 0;
    }
    return count;
}

/* sigma_t, albedo and g of a shard's pictures. Pairs of sigma_t and g in an order of the shard's
   own, so that a part of the data has others in each shard; each with its albedos one after the
   other, as these can share a walk. thetas: [count][3]. */
static inline void shard_materials(const shard *s, float (*thetas)[3]) {
    int order[PAIRS], i;
    shuffle(order, PAIRS, mix((uint64_t)s->in, (uint64_t)s->shape, (uint64_t)s->azimuth));
    for (i = 0; i < s->count; i++) {
        int pair = order[i / 5];
        thetas[i][0] = sigma_t_values[pair / 5];
        thetas[i][1] = albedo_values[(i + pair) % 5];
        thetas[i][2] = g_values[pair % 5];
    }
}

/* Which pair of sigma_t and g a material of the grid has. */
static inline int pair_of(const float theta[3]) {
    int i = 0, k = 0;
    while (i < 12 && sigma_t_values[i] != theta[0]) i++;
    while (k < 5 && g_values[k] != theta[2]) k++;
    if (i == 12 || k == 5) fail("a material", "is not of the grid");
    return 5 * i + k;
}

/* Which variant of its shape a shard's picture of a material shows; 0 is the shape itself. */
static inline int variant_of(const shard *s, const float theta[3]) {
    int order[PAIRS], number;
    if (s->in != SPLIT_TRAIN) return 0;
    shuffle(order, PAIRS, mix(77, (uint64_t)s->shape, (uint64_t)s->azimuth));
    number = order[pair_of(theta)];
    return number % 2 ? 0 : number;
}

static inline void shard_path(const shard *s, const char *dir, char *path) {
    snprintf(path, PATH_SIZE, "%s/%s-%s-%02d.itnd", dir, split_names[s->in], shape_names[s->shape],
             s->azimuth);
}

static inline void scene_path(int shape, int azimuth, int variant, film on, const char *dir,
                              char *path) {
    static const char *const endings[FILMS] = {"", "-fine", "-family", "-small"};
    char number[16] = "";
    if (variant) snprintf(number, sizeof number, "-%02d", variant);
    snprintf(path, PATH_SIZE, "%s/scenes/%s-%02d%s%s.itn", dir, shape_names[shape], azimuth, number,
             endings[on]);
}

/* The line at the head of a shard; anything else in a file of its name is a mistake. */
static inline void shard_header(const shard *s, char header[HEADER_SIZE]) {
    int length = snprintf(header, HEADER_SIZE, "itn data %d: split %s shape %s azimuth %d images "
                          "%d width %d height %d half", VERSION, split_names[s->in],
                          shape_names[s->shape], s->azimuth, s->count, FILM, FILM);
    memset(header + length, ' ', (size_t)(HEADER_SIZE - length));
    header[HEADER_SIZE - 1] = '\n';
}

/* Where in a shard's bytes a picture has its four floats, and where its pixels. */
static inline size_t record_place(int index) { return HEADER_SIZE + (size_t)index * RECORD * 4; }
static inline size_t pixels_place(const shard *s, int index) {
    return record_place(s->count) + (size_t)index * PIXELS * 2;
}

static inline size_t shard_size(const shard *s) { return pixels_place(s, s->count) + 8; }

/* ---- pictures of other sizes ---- */

/* Weights of the pixels of one line in those of another, [to][from], by a Gaussian of `deviation`
   about each of these: the first of them begins at pixel `before` of the one line and is `size` of
   its pixels long. */
static inline void line_weights(int from, int to, double before, double size, double deviation,
                                float *weights) {
    int i, k;
    for (i = 0; i < to; i++, weights += from) {
        double middle = before + (i + .5) * size - .5, sum = 0;
        for (k = 0; k < from; k++) {
            double off = (k - middle) / deviation;
            weights[k] = fabs(off) > 4 ? 0 : (float)exp(-off * off / 2);
            sum += (double)weights[k];
        }
        for (k = 0; k < from; k++) weights[k] = (float)((double)weights[k] / sum);
    }
}

/* The weights [FILM][FINE] of a line of the fine film in one of a picture, whose filter together
   with the fine pixels' squares (of variance 1/12) has the deviation DEVIATION. */
static inline void fine_weights(float *weights) {
    line_weights(FINE, FILM, MARGIN, PARTS, sqrt(pow(PARTS * DEVIATION, 2) - 1 / 12.), weights);
}

/* other[to][to]: sums over picture[from][from] with weights across and down. The weight of pixel k of
   a line for pixel i of another is at weights[row i + column k]. */
static inline void weigh_picture(const float *picture, int from, const float *weights, int row,
                                 int column, int to, float *other) {
    float *lines = (float *)need((size_t)from, (size_t)to * sizeof *lines);
    int i, k, x;
    memset(other, 0, (size_t)(to * to) * sizeof *other);
    for (i = 0; i < to; i++)
        for (k = 0; k < from; k++) {
            float weight = weights[row * i + column * k];
            for (x = 0; x < from && weight > 0; x++)
                lines[i * from + x] += weight * picture[k * from + x];
        }
    for (i = 0; i < to; i++)
        for (k = 0; k < from; k++) {
            float weight = weights[row * i + column * k];
            for (x = 0; x < to && weight > 0; x++)
                other[x * to + i] += weight * lines[x * from + k];
        }
    free(lines);
}

/* ---- numbers as bytes ---- */

/* The 16-bit float (IEEE 754 binary16) nearest to x >= 0; what is too large or NaN becomes
   infinite. */
static inline uint16_t half_from_float(float x) {
    int exponent;
    double scaled = frexp((double)x, &exponent); /* x = scaled 2^exponent, scaled in [.5,1) */
    if (!(x < 65520)) return 0x7c00;
    if (!(x > 0)) return 0;
    if (exponent < -13) return (uint16_t)floor(ldexp((double)x, 24) + .5); /* subnormal */
    scaled = floor(ldexp(scaled, 11) + .5);                                /* 1024 .. 2048 */
    if (scaled >= 2048) scaled = 1024, exponent++;
    return (uint16_t)((exponent + 14) * 1024 + (int)scaled - 1024);
}

static inline float float_from_half(uint16_t half) {
    int exponent = half >> 10 & 31, mantissa = half & 1023;
    if (exponent == 31) return INFINITY; /* or NaN: wrong in a picture either way */
    if (exponent == 0) return (float)ldexp(mantissa, -24);
    return (float)ldexp(1024 + mantissa, exponent - 25) * (half >> 15 ? -1.f : 1.f);
}

static inline void put_bytes(unsigned char *at, uint64_t value, int bytes) {
    int i;
    for (i = 0; i < bytes; i++) at[i] = (unsigned char)(value >> 8 * i);
}

static inline uint64_t get_bytes(const unsigned char *at, int bytes) {
    uint64_t value = 0;
    int i;
    for (i = 0; i < bytes; i++) value |= (uint64_t)at[i] << 8 * i;
    return value;
}

static inline void put_float(unsigned char *at, float value) {
    uint32_t bits;
    memcpy(&bits, &value, 4);
    put_bytes(at, bits, 4);
}

static inline float get_float(const unsigned char *at) {
    uint32_t bits = (uint32_t)get_bytes(at, 4);
    float value;
    memcpy(&value, &bits, 4);
    return value;
}

static inline uint64_t checksum(const unsigned char *bytes, size_t count) {
    uint64_t hash = 0xcbf29ce484222325u;
    size_t i;
    for (i = 0; i < count; i++) hash = (hash ^ bytes[i]) * 0x100000001b3u;
    return hash;
}

/* Begins a file, as path.tmp, which end_file renames: it appears whole or not at all, and what was
   there before stays until then. */
static inline FILE *begin_file(const char *path) {
    char temporary[PATH_SIZE + 8];
    FILE *file;
    snprintf(temporary, sizeof temporary, "%s.tmp", path);
    file = fopen(temporary, "wb");
    if (!file) fail(temporary, "cannot be written");
    return file;
}

static inline void end_file(FILE *file, const char *path) {
    char temporary[PATH_SIZE + 8];
    int bad = ferror(file);
    snprintf(temporary, sizeof temporary, "%s.tmp", path);
    bad |= fclose(file) != 0;
#ifdef _WIN32
    if (!bad) remove(path); /* there rename does not replace */
#endif
    if (bad || rename(temporary, path)) {
        remove(temporary);
        fail(path, "cannot be written");
    }
}

/* Ends the program, before any work is done, if a file cannot be written. */
static inline void try_file(const char *path) {
    char temporary[PATH_SIZE + 8];
    fclose(begin_file(path));
    snprintf(temporary, sizeof temporary, "%s.tmp", path);
    remove(temporary);
}

static inline void save_file(const char *path, const void *bytes, size_t size) {
    FILE *file = begin_file(path);
    fwrite(bytes, 1, size, file);
    end_file(file, path);
}

/* ---- reading ---- */

/* The fraction of a split that a folder holds, from its data.txt. */
static inline double read_fraction(const char *dir, split in) {
    char path[PATH_SIZE];
    double train = 0, tests = 0, fraction;
    FILE *file;
    snprintf(path, sizeof path, "%s/data.txt", dir);
    file = fopen(path, "r");
    if (!file) fail(path, "cannot be read: make the data with `dataset make` first");
    if (fscanf(file, "fraction %lf tests %lf", &train, &tests) != 2)
        fail(path, "its first lines should be `fraction F` and `tests F`");
    fclose(file);
    fraction = in == SPLIT_TRAIN ? train : tests;
    if (!(fraction > 0 && fraction <= 1)) fail(path, "fractions should be in (0,1]");
    return fraction;
}

/* What is wrong with the bytes of a shard; NULL: nothing. */
static inline const char *shard_fault(const shard *s, const unsigned char *bytes, size_t size) {
    char header[HEADER_SIZE];
    static const char *const fault[] = {
        "is cut, or has a surplus", "is another shard, or of another fraction of the data",
        "is damaged: its checksum does not match", "has a material that it should not have",
        "has a pixel that is not finite or is negative"};
    float(*thetas)[3] = (float(*)[3])need((size_t)s->count, sizeof *thetas);
    const unsigned char *record = bytes + record_place(0), *pixels = bytes + pixels_place(s, 0);
    size_t i;
    int result = -1;
    shard_header(s, header);
    shard_materials(s, thetas);
    if (size >= HEADER_SIZE && memcmp(bytes, header, HEADER_SIZE)) result = 1;
    else if (size != shard_size(s)) result = 0;
    else if (checksum(bytes, size - 8) != get_bytes(bytes + size - 8, 8)) result = 2;
    for (i = 0; i < 3 * (size_t)s->count && result < 0; i++)
        if (get_float(record + i / 3 * RECORD * 4 + i % 3 * 4) != thetas[i / 3][i % 3]) result = 3;
    for (i = 0; i < (size_t)s->count * PIXELS && result < 0; i++)
        if (get_bytes(pixels + 2 * i, 2) >= 0x7c00) result = 4;
    free(thetas);
    return result < 0 ? NULL : fault[result];
}

/* Reads a shard, which may be NULL if there is none. Returns its bytes (to be freed) or NULL, and
   then *fault says why. */
static inline unsigned char *read_shard(const shard *s, const char *dir, const char **fault) {
    char path[PATH_SIZE];
    size_t capacity = shard_size(s) + 1, size;
    unsigned char *bytes;
    FILE *file;
    shard_path(s, dir, path);
    file = fopen(path, "rb");
    *fault = "is missing";
    if (!file) return NULL;
    bytes = (unsigned char *)need(capacity, 1);
    size = fread(bytes, 1, capacity, file);
    fclose(file);
    *fault = shard_fault(s, bytes, size);
    if (!*fault) return bytes;
    free(bytes);
    return NULL;
}

/* The pictures of a split in memory. */
typedef struct pictures {
    int count, shard_count;
    shard shards[MOST_SHARDS];
    int *shard_of;      /* [count] */
    float (*thetas)[3]; /* [count] sigma_t, albedo, g */
    float *noise;       /* [count] */
    uint16_t *pixels;   /* [count][PIXELS], or of those from `first` on that were kept */
    int first;
} pictures;

/* Reads all shards of a split, or says which are wrong and ends the program. */
static inline void load_pictures(const char *dir, split in, pictures *p) {
    int i, k, faults = 0, next = 0;
    memset(p, 0, sizeof *p);
    p->shard_count = list_shards(in, read_fraction(dir, in), p->shards);
    for (i = 0; i < p->shard_count; i++) p->count += p->shards[i].count;
    p->shard_of = (int *)need((size_t)p->count, sizeof *p->shard_of);
    p->thetas = (float(*)[3])need((size_t)p->count, sizeof *p->thetas);
    p->noise = (float *)need((size_t)p->count, sizeof *p->noise);
    p->pixels = (uint16_t *)need((size_t)p->count, PIXELS * sizeof *p->pixels);
    for (i = 0; i < p->shard_count; i++) {
        const shard *s = &p->shards[i];
        const char *fault;
        char path[PATH_SIZE];
        unsigned char *bytes = read_shard(s, dir, &fault), *pixels;
        shard_path(s, dir, path);
        if (!bytes) fprintf(stderr, "%s %s\n", path, fault), faults++;
        if (!bytes) continue;
        pixels = bytes + pixels_place(s, 0);
        for (k = 0; k < s->count * PIXELS; k++)
            p->pixels[(size_t)next * PIXELS + (size_t)k] = (uint16_t)get_bytes(pixels + 2 * k, 2);
        for (k = 0; k < s->count; k++, next++) {
            const unsigned char *record = bytes + record_place(k);
            p->shard_of[next] = i;
            p->thetas[next][0] = get_float(record), p->thetas[next][1] = get_float(record + 4);
            p->thetas[next][2] = get_float(record + 8), p->noise[next] = get_float(record + 12);
        }
        free(bytes);
    }
    if (faults) fail(dir, "`dataset make` makes what is missing or damaged");
}

/* Whether a name is in a list of names with commas. */
static inline int is_listed(const char *name, const char *list) {
    size_t length = strlen(name);
    for (; list; list = strchr(list, ','), list += list != NULL)
        if (!strncmp(list, name, length) && (list[length] == ',' || !list[length])) return 1;
    return 0;
}

/* Drops all pictures but those whose shapes are in the list and are shown as they are (listed: 1),
   or whose shapes are not in the list (0) and, if `plain`, are shown as they are. */
static inline void keep_shapes(pictures *p, const char *list, int listed, int plain) {
    int i, kept = 0;
    for (i = 0; i < p->count; i++) {
        const shard *s = &p->shards[p->shard_of[i]];
        if (is_listed(shape_names[s->shape], list) != listed) continue;
        if ((listed || plain) && variant_of(s, p->thetas[i])) continue;
        p->shard_of[kept] = p->shard_of[i], p->noise[kept] = p->noise[i];
        memmove(p->thetas[kept], p->thetas[i], sizeof p->thetas[i]);
        memmove(p->pixels + (size_t)kept * PIXELS, p->pixels + (size_t)i * PIXELS,
                PIXELS * sizeof *p->pixels);
        kept++;
    }
    p->count = kept;
}

/* Forgets the pixels of all pictures but those from `first` to before `end`. */
static inline void keep_pixels(pictures *p, int first, int end) {
    size_t count = (size_t)(end - first) * PIXELS;
    uint16_t *kept = (uint16_t *)need(count, sizeof *kept);
    memcpy(kept, p->pixels + (size_t)(first - p->first) * PIXELS, count * sizeof *kept);
    free(p->pixels);
    p->pixels = kept, p->first = first;
}

static inline void free_pictures(pictures *p) {
    free(p->pixels);
    free(p->noise);
    free(p->thetas);
    free(p->shard_of);
    memset(p, 0, sizeof *p);
}

static inline void get_picture(const pictures *p, int index, float *pixels) {
    int i;
    for (i = 0; i < PIXELS; i++)
        pixels[i] = float_from_half(p->pixels[(size_t)(index - p->first) * PIXELS + (size_t)i]);
}

/* Loads a scene of a shard for a single thread; the caller's threads share it.
   parameters[count] receives where the parameters of these names are. */
static inline itn_scene *load_scene(const shard *s, int variant, film on, const char *dir,
                                    const char *const *names, int count, int *parameters) {
    char path[PATH_SIZE];
    itn_context context = ITN_ZERO;
    itn_scene *scene = NULL;
    itn_error error;
    int k;
    context.threads = 1;
    scene_path(s->shape, s->azimuth, variant, on, dir, path);
    if (itn_scene_load(path, &context, &scene, &error)) fail(error.message, "");
    for (k = 0; k < count; k++)
        if ((parameters[k] = itn_parameter_find(scene, names[k])) < 0) fail(path, names[k]);
    return scene;
}

/* The scene that the networks answer about, whose parameters are theta_names. */
static inline itn_scene *load_theta_scene(const shard *s, int variant, film on, const char *dir,
                                          int parameters[3]) {
    return load_scene(s, variant, on, dir, theta_names, 3, parameters);
}

/* The scenes of pictures, by shard and variant. */
typedef struct stages {
    itn_scene *scenes[MOST_SHARDS][PAIRS]; /* NULL: not used */
    const itn_scene *any; /* one of them, where only what they have in common is asked for */
    int parameters[3];    /* theta_names: in the same places in all */
} stages;

typedef struct stage_loader {
    stages *stages;
    const pictures *pictures;
    film on;
    const char *dir;
    unsigned char used[MOST_SHARDS][PAIRS];
} stage_loader;

static inline void load_stage(void *task, int index) {
    stage_loader *l = (stage_loader *)task;
    int shard_number = index / PAIRS, variant = index % PAIRS, parameters[3];
    if (l->used[shard_number][variant])
        l->stages->scenes[shard_number][variant] = load_theta_scene(
            &l->pictures->shards[shard_number], variant, l->on, l->dir, parameters);
}

/* The scene of a picture; NULL if it was not loaded. */
static inline const itn_scene *scene_of(const stages *s, const pictures *p, int index) {
    const shard *of = &p->shards[p->shard_of[index]];
    return s->scenes[p->shard_of[index]][variant_of(of, p->thetas[index])];
}

/* The index of one of `count` pictures among `total`: one of each of as many equal parts, drawn, as
   materials repeat at even steps; the first is 0. */
static inline int evenly(int index, int count, int total) {
    int first = (int)((int64_t)index * total / count);
    int next = (int)((int64_t)(index + 1) * total / count);
    if (!index || next <= first) return first;
    return first + (int)(mix(5, (uint64_t)index, (uint64_t)count) % (uint64_t)(next - first));
}

/* Loads the scenes of `count` pictures, evenly out of those from `first` to before `end`. */
static inline void load_stages(const pictures *p, int first, int end, int count, film on,
                               const char *dir, int threads, stages *s) {
    stage_loader l;
    int i, k;
    memset(s, 0, sizeof *s), memset(&l, 0, sizeof l);
    if (first >= end) fail(dir, "has no pictures for this");
    l.stages = s, l.pictures = p, l.on = on, l.dir = dir;
    for (i = 0; i < count; i++) {
        int picture = first + evenly(i, count, end - first);
        int shard_number = p->shard_of[picture];
        l.used[shard_number][variant_of(&p->shards[shard_number], p->thetas[picture])] = 1;
    }
    parallel_for(p->shard_count * PAIRS, load_stage, &l, &threads);
    s->any = scene_of(s, p, first);
    for (k = 0; k < 3; k++) s->parameters[k] = itn_parameter_find(s->any, theta_names[k]);
}

static inline void free_stages(stages *s) {
    int i;
    for (i = 0; i < MOST_SHARDS * PAIRS; i++) itn_scene_free(s->scenes[i / PAIRS][i % PAIRS]);
}

/* All parameters of a scene, with these values of `count` of them. The caller frees them. */
static inline float *theta_with(const itn_scene *scene, int count, const int *parameters,
                                const float *values) {
    float *theta = (float *)need((size_t)itn_parameter_count(scene), sizeof *theta);
    int k;
    itn_parameter_values(scene, theta);
    for (k = 0; k < count; k++) theta[parameters[k]] = values[k];
    return theta;
}

/* A picture of a scene of FILM_FINE with these values of its three parameters, from `spp` samples
   of each pixel of that film; weights as of fine_weights. */
static inline void render_picture(const itn_scene *scene, const int parameters[3],
                                  const float values[3], const float *weights, int spp,
                                  uint64_t seed, float picture[PIXELS]) {
    float *theta = theta_with(scene, 3, parameters, values);
    itn_render_options options = ITN_ZERO;
    itn_image image;
    itn_error error;
    options.spp = spp, options.seed = seed;
    if (itn_render(scene, theta, &options, NULL, 0, &image, &error)) fail(error.message, "");
    weigh_picture(image.pixels, FINE, weights, FINE, 1, FILM, picture);
    itn_image_free(&image);
    free(theta);
}

/* ---- what the network sees and what it answers ---- */

/* Answers are cut to these, a little more than the materials of the data. */
static const float lowest_answer[3] = {20, .35f, -.1f}, highest_answer[3] = {300, .97f, .9f};

/* What a network is shown of a picture, [2][PIXELS]: itn_net_input with the mean brightness of all
   training pictures. */
static inline void network_input(const float *pixels, double mean, float *input) {
    itn_error error;
    if (itn_net_input(FILM, FILM, pixels, mean, input, &error)) fail(error.message, "");
}

/* The mean brightness of pictures. */
static inline double mean_brightness(const pictures *p) {
    double sum = 0;
    size_t i, count = (size_t)p->count * PIXELS;
    for (i = 0; i < count; i++) sum += float_from_half(p->pixels[i]);
    return count ? sum / (double)count : 1;
}

/* Cuts the coordinates of an answer to the allowed values. */
static inline void cut_answer(const itn_scene *scene, const int parameters[3], const float *answer,
                              float *cut) {
    int k;
    for (k = 0; k < 3; k++) {
        const itn_parameter *p = itn_parameter_get(scene, parameters[k]);
        float low = (float)itn_parameter_to_coordinate(p, lowest_answer[k]);
        float high = (float)itn_parameter_to_coordinate(p, highest_answer[k]);
        cut[k] = answer[k] < low ? low : answer[k] > high ? high : answer[k];
    }
}

/* The coordinates of sigma_t, albedo and g that a network reads off a picture, cut. */
static inline void read_picture(itn_net *net, double mean, const itn_scene *scene,
                                const int parameters[3], const float *picture, float answer[3]) {
    itn_error error;
    if (itn_net_read(net, picture, mean, answer, &error)) fail(error.message, "");
    cut_answer(scene, parameters, answer, answer);
}

/* What a network needs beside its weights, kept in NETWORK.txt. */
typedef struct model {
    char name[8]; /* rn, ssn, itn */
    double mean, lambda, rate;
    int batch, spp, seed;
    int bend; /* see vary_picture; -1: pictures and shapes are shown as they are */
    int own_units; /* whether it was trained in the parameters' own units or in coordinates */
    char leave[64]; /* names of training shapes that it was not shown, with commas; or "none" */
} model;

enum { INPUT = 1 }; /* which itn_net_input it is for: the blurred one */

static inline void save_model(const char *network, const model *m) {
    char path[PATH_SIZE], text[512];
    int length = snprintf(text, sizeof text, "model %s\ninput %d\nmean %.17g\nlambda %.17g\n"
                          "rate %.17g\nbatch %d\nspp %d\nseed %d\nbend %d\nunits %s\nleave %s\n",
                          m->name, INPUT, m->mean, m->lambda, m->rate, m->batch, m->spp,
                          m->seed, m->bend, m->own_units ? "own" : "coordinates", m->leave);
    snprintf(path, sizeof path, "%s.txt", network);
    save_file(path, text, (size_t)length);
}

static inline void load_model(const char *network, model *m) {
    char path[PATH_SIZE], units[12];
    int input = 0;
    FILE *file;
    snprintf(path, sizeof path, "%s.txt", network);
    file = fopen(path, "r");
    if (!file) fail(path, "cannot be read: train this network first");
    if (fscanf(file, "model %7s input %d", m->name, &input) != 2 || input != INPUT)
        fail(path, "is of a network for another input: train it anew");
    if (fscanf(file, " mean %lf lambda %lf rate %lf batch %d spp %d seed %d bend %d "
               "units %11s leave %63s", &m->mean, &m->lambda, &m->rate, &m->batch, &m->spp,
               &m->seed, &m->bend, units, m->leave) != 9 || !(m->mean > 0) ||
        !(m->lambda >= 0 && m->lambda < 1e9) || !(m->rate > 0 && m->rate <= 1) || m->batch < 1 ||
        m->spp < 2 || m->seed < 0 || m->bend < -1 || m->bend > FILM ||
        (strcmp(units, "own") && strcmp(units, "coordinates")))
        fail(path, "is not what train writes");
    m->own_units = !strcmp(units, "own");
    fclose(file);
}

/* Opens a network that reads sigma_t, albedo and g off the data's pictures. */
static inline itn_net *open_network(const char *path, int batch, const itn_context *context) {
    itn_net *net;
    itn_net_desc shape;
    itn_error error;
    if (itn_net_open(path, batch, context, &net, &error)) fail(error.message, "");
    shape = itn_net_shape(net);
    if (shape.width != FILM || shape.height != FILM || shape.channels != 2 || shape.outputs != 3)
        fail(path, "is a network for other pictures or answers");
    return net;
}

/* The same for one thread, to read pictures with. */
static inline itn_net *open_reader(const char *path) {
    itn_context context = ITN_ZERO;
    context.threads = 1;
    return open_network(path, 1, &context);
}

#endif
