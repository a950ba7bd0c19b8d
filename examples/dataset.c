/* Makes the data set of the learning experiment: pictures whose materials are known.

   You learn: how to render many pictures of one scene with other parameters, on all processors,
   with as many samples as each of them needs; and how to keep them so that no more than a file of
   them is lost when the program is stopped.

   Compile: cc -O3 -march=native dataset.c -o dataset -lm -lpthread
   Run:     ./dataset make data --fraction 1/50 --noise 0.1 --spp 8 --scenes ../scenes
            ./dataset check data
            ./dataset sheet data sheet.png
   Prints:  328 images made in 76 s, noise at most 22.49 %, 8.0 samples per pixel in the mean
   A picture is seen through a Gaussian filter of deviation 1 pixel, and every sample counts for
   all pixels in whose filter it lies, which takes an eighth of the samples or less: the walk's film
   has half of the pixel size, and pictures are weighted sums of its pixels. So neighbours in a
   picture have noise in common.
   A picture gets as many samples as bring its noise under --noise, but at most --spp per pixel in
   the mean, at least 8: a few first, which tell the deviation of each pixel's samples, then in
   proportion to it (Neyman 1934).
   One walk serves up to three materials that differ in albedo alone, as the colours of a medium:
   the sky is grey (sky.c), so that its channels are one picture in three albedos. The five albedos
   of a sigma_t and g, which follow each other in a shard, take two walks instead of five, and half
   the time. The noise of such pictures is alike: errors of one tell something of errors of the
   others, and a mean over all three is noisier than over three on their own.
   --tests is the part of the three test splits to make, as large as --fraction unless given.
   `check` reads every file: pictures, meshes, scenes, ground and sky, and compares them with what
   was written. `make` goes on where it was stopped and mends what `check` finds missing or damaged.
   `sheet` shows one picture of every shape, or of a variant (rows), and azimuth (columns).
   dataset.h says what is in a file.
   The pictures are the same bits for any number of threads. */
#define _POSIX_C_SOURCE 200809L
#define _DARWIN_C_SOURCE /* else macOS hides sysconf's number of processors */
#include "dataset.h"

static const char *const usage =
    "usage: dataset make DIR [--fraction F] [--tests F] [--noise N] [--spp MOST] [--seed N]\n"
    "               [-t THREADS] [--scenes DIR]\n"
    "       dataset check DIR\n"
    "       dataset sheet DIR OUT.png\n";

/* Samples that every pixel of the fine film has where most have more. */
enum { LEAST = 8 };

enum { SCENE_SIZE = 2048 }; /* more than the text of a scene has */

/* How many more are taken than a few samples say: where these fall short by chance, more go. */
#define CARE 1.12

#define RADIANS (3.14159265358979323846 / 180) /* a degree */
#define FOV 2.5 /* degrees, of pictures */

typedef struct settings {
    const char *dir, *scenes; /* the data; where shapes, maps and skies are */
    double fraction, tests, noise; /* parts of the training split and of the others to make */
    int spp, seed, threads; /* spp: at most */
} settings;

/* ---- scenes ---- */

/* Files of DIR/scenes that all scenes share. */
#define GROUND "concrete.pfm"
#define SKY "t3-e60-grey.sky"

/* A file's bytes, to be freed, with a 0 behind them; NULL if it cannot be read. */
static char *read_file(const char *path, size_t *size) {
    struct stat status;
    FILE *file = fopen(path, "rb");
    char *bytes;
    if (!file) return NULL;
    if (fstat(fileno(file), &status)) fail(path, "cannot be read");
    bytes = (char *)need((size_t)status.st_size + 1, 1);
    *size = fread(bytes, 1, (size_t)status.st_size, file);
    fclose(file);
    return bytes;
}

static void copy_file(const char *from_dir, const char *name, const char *to_dir) {
    char path[PATH_SIZE], *bytes;
    const char *base = strrchr(name, '/') ? strrchr(name, '/') + 1 : name;
    size_t size;
    snprintf(path, sizeof path, "%s/%s", from_dir, name);
    bytes = read_file(path, &size);
    if (!bytes) fail(path, "cannot be read; --scenes names the folder of the shipped scenes");
    if (size == 0 || size >= 1 << 20) fail(path, "has not the size of a shipped file");
    snprintf(path, sizeof path, "%s/%s", to_dir, base);
    save_file(path, bytes, size);
    free(bytes);
}

/* The file of a shape, or of a variant of it, in DIR/scenes. */
static void mesh_name(int shape, int azimuth, int variant, char name[64]) {
    if (variant) snprintf(name, 64, "%s-%02d-%02d.ply", shape_names[shape], azimuth, variant);
    else snprintf(name, 64, "%s.ply", shape_names[shape]);
}

static void mesh_path(const char *dir, int shape, int azimuth, int variant, char *path) {
    char name[64];
    mesh_name(shape, azimuth, variant, name);
    snprintf(path, PATH_SIZE, "%s/scenes/%s", dir, name);
}

static itn_mesh load_mesh(const char *dir, int shape, int azimuth, int variant) {
    char path[PATH_SIZE];
    itn_mesh mesh;
    itn_error error;
    mesh_path(dir, shape, azimuth, variant, path);
    if (itn_mesh_load(path, NULL, &mesh, &error)) fail(error.message, "");
    return mesh;
}

/* How far a mesh has to be lifted to stand on the ground. */
static double mesh_lift(const itn_mesh *mesh) {
    float lowest = 0;
    int i;
    for (i = 0; i < mesh->vertex_count; i++)
        lowest = fminf(lowest, mesh->positions[3 * i + 1]);
    return .001 - (double)lowest;
}

/* The text of a scene file, and its length: the scene of scenes/data.itn with another shape and sun,
   and a grey sky, for one of the films. A sky's numbers hold for the height of the sun and are
   measured from the zenith and from the sun, so all azimuths share them. */
static int scene_text(const itn_mesh *mesh, int shape, int azimuth, int variant, film on,
                      char text[SCENE_SIZE]) {
    char name[64], films[FILMS][96];
    double angle = azimuth * RADIANS, fovs[FILMS] = {FOV, 0, 0, FOV};
    mesh_name(shape, azimuth, variant, name);
    fovs[FILM_FINE] = 2 / RADIANS * atan(tan(FOV / 2 * RADIANS) * FINE / (PARTS * FILM));
    fovs[FILM_FAMILY] = fovs[FILM_FINE];
    snprintf(films[FILM_ONE], 96, "width %d height %d  filter gaussian  deviation %g", FILM, FILM,
             DEVIATION);
    snprintf(films[FILM_FINE], 96, "width %d height %d", FINE, FINE);
    snprintf(films[FILM_FAMILY], 96, "width %d height %d  channels 3", FINE, FINE);
    snprintf(films[FILM_SMALL], 96, "width %d height %d  filter gaussian", SMALL, SMALL);
    return snprintf(text, SCENE_SIZE,
        "film    %s\n"
        "camera  eye 0 8.785 -32.785  target 0 0.469 -1.75  fov %.8g\n"
        "medium  milk   sigma_t 54  albedo 0.87  g 0.4\n"
        "surface ground type diffuse  reflectance texture " GROUND "\n"
        "object  plane  y 0 half 20  surface ground\n"
        "object  mesh %s  medium milk  rotate 0 1 0 180  translate 0 %.4f -1.75\n"
        "light   sky " SKY "  sun %.6f 0.866025 %.6f  sun_scale 2"
        "  sun_radius_scale 70\n",
        films[on], fovs[on], name, mesh_lift(mesh), .5 * cos(angle), .5 * sin(angle));
}

/* Writes the files of a scene, one for each film. */
static void write_scene(const char *dir, int shape, int azimuth, int variant) {
    char path[PATH_SIZE], text[SCENE_SIZE];
    itn_mesh mesh = load_mesh(dir, shape, azimuth, variant);
    int on;
    for (on = 0; on < FILMS; on++) {
        int length = scene_text(&mesh, shape, azimuth, variant, (film)on, text);
        scene_path(shape, azimuth, variant, (film)on, dir, path);
        save_file(path, text, (size_t)length);
    }
    itn_mesh_free(&mesh);
}

static void write_scenes(const settings *s) {
    char folder[PATH_SIZE], name[64];
    int shape, azimuth;
    snprintf(folder, sizeof folder, "%s/scenes", s->dir);
    make_folder(folder);
    copy_file(s->scenes, "maps/" GROUND, folder);
    copy_file(s->scenes, SKY, folder);
    for (shape = 0; shape < SHAPES; shape++) {
        snprintf(name, sizeof name, "shapes/%s.ply", shape_names[shape]);
        copy_file(s->scenes, name, folder);
        for (azimuth = 0; azimuth < 100; azimuth += 10) write_scene(s->dir, shape, azimuth, 0);
    }
}

/* ---- shapes shown otherwise ---- */

static void draw_direction(uint64_t *random, double d[3]) {
    double n;
    do {
        d[0] = draw(random), d[1] = draw(random), d[2] = draw(random);
        n = d[0] * d[0] + d[1] * d[1] + d[2] * d[2];
    } while (n > 1 || n < .01);
    n = sqrt(n), d[0] /= n, d[1] /= n, d[2] /= n;
}

/* Centres a mesh and makes its longest side 1, as that of the shapes. */
static void fit_mesh(itn_mesh *mesh) {
    float low[3] = {INFINITY, INFINITY, INFINITY}, high[3] = {-INFINITY, -INFINITY, -INFINITY};
    float side = 0, *p = mesh->positions;
    int i;
    for (i = 0; i < 3 * mesh->vertex_count; i++)
        low[i % 3] = fminf(low[i % 3], p[i]), high[i % 3] = fmaxf(high[i % 3], p[i]);
    for (i = 0; i < 3; i++) side = fmaxf(side, high[i] - low[i]);
    for (i = 0; i < 3 * mesh->vertex_count; i++)
        p[i] = (p[i] - (low[i % 3] + high[i % 3]) / 2) / side;
}

/* The corner after another one of its triangle. */
static int next_corner(int corner) { return corner / 3 * 3 + (corner + 1) % 3; }

/* Rounds edges off: each time, every corner goes half of the way to the mean of its neighbours (of
   which each stands before it in one triangle and after it in another). */
static void smooth_mesh(itn_mesh *mesh, int times) {
    double(*sums)[4] = (double(*)[4])need((size_t)mesh->vertex_count, sizeof *sums);
    int i, j, k;
    for (; times > 0; times--) {
        memset(sums, 0, (size_t)mesh->vertex_count * sizeof *sums);
        for (i = 0; i < 3 * mesh->triangle_count; i++) {
            double *sum = sums[mesh->triangles[i]];
            for (j = 0; j < 3; j++)
                sum[j] += (double)mesh->positions[3 * mesh->triangles[next_corner(i)] + j];
            sum[3]++;
        }
        for (i = 0; i < mesh->vertex_count; i++)
            for (j = 0; j < 3; j++) {
                k = 3 * i + j;
                mesh->positions[k] =
                    (float)(.5 * (double)mesh->positions[k] + .5 * sums[i][j] / sums[i][3]);
            }
    }
    free(sums);
}

/* Numbers the edges of a closed mesh: edges[i] is that from corner i to the next, of two triangles,
   which run through it in opposite directions. Returns how many there are. */
static int number_edges(const itn_mesh *mesh, int *edges) {
    int *last = (int *)need((size_t)mesh->vertex_count, sizeof *last); /* corner there, or -1 */
    int *before = (int *)need(3 * (size_t)mesh->triangle_count, sizeof *before);
    int i, k, count = 0;
    for (i = 0; i < mesh->vertex_count; i++) last[i] = -1;
    for (i = 0; i < 3 * mesh->triangle_count; i++) {
        int from = mesh->triangles[i], to = mesh->triangles[next_corner(i)];
        for (k = last[to]; k >= 0 && mesh->triangles[next_corner(k)] != from;) k = before[k];
        edges[i] = k >= 0 ? edges[k] : count++;
        before[i] = last[from], last[from] = i;
    }
    free(before);
    free(last);
    return count;
}

/* Cuts every triangle into four, at the middles of its edges. */
static void divide_mesh(itn_mesh *mesh) {
    int corners = 3 * mesh->triangle_count, points = mesh->vertex_count, i, j;
    int *edges = (int *)need((size_t)corners, sizeof *edges);
    int all = points + number_edges(mesh, edges);
    itn_mesh finer;
    itn_error error;
    if (itn_mesh_create(all, 4 * mesh->triangle_count, 0, NULL, &finer, &error))
        fail(error.message, "");
    memcpy(finer.positions, mesh->positions, 3 * (size_t)points * sizeof *finer.positions);
    for (i = 0; i < corners; i++) {
        int *inner = finer.triangles + 12 * (i / 3), *outer = inner + 3 * (1 + i % 3);
        int from = mesh->triangles[i], to = mesh->triangles[next_corner(i)];
        int middle = points + edges[i];
        for (j = 0; j < 3; j++)
            finer.positions[3 * middle + j] =
                (mesh->positions[3 * from + j] + mesh->positions[3 * to + j]) / 2;
        inner[i % 3] = middle;
        outer[0] = from, outer[1] = middle;
        outer[2] = points + edges[next_corner(next_corner(i))];
    }
    free(edges);
    itn_mesh_free(mesh);
    *mesh = finer;
}

/* Moves every point p by the sum over WAVES random waves of a sin(k.p + phase), of lengths from
   `shortest` to `longest`; `gradient` is the sum of |a| |k|. Below 1, points that are apart stay
   so: the map is one to one, and what does not cross itself will not (that flat triangles between
   its points do not either, test_dataset.c tries). */
static void bend_mesh(itn_mesh *mesh, double shortest, double longest, double gradient,
                      uint64_t *random) {
    enum { WAVES = 5 };
    double k[WAVES][3], a[WAVES][3], phase[WAVES];
    int i, j, w;
    for (w = 0; w < WAVES; w++) {
        double number = 6.2831853 / (longest * pow(shortest / longest, (1 + draw(random)) / 2));
        draw_direction(random, k[w]), draw_direction(random, a[w]);
        for (j = 0; j < 3; j++) k[w][j] *= number, a[w][j] *= gradient / WAVES / number;
        phase[w] = 3.14159265 * draw(random);
    }
    for (i = 0; i < mesh->vertex_count; i++) {
        float *p = mesh->positions + 3 * i;
        double moved[3] = {0, 0, 0};
        for (w = 0; w < WAVES; w++) {
            double wave = sin(k[w][0] * p[0] + k[w][1] * p[1] + k[w][2] * p[2] + phase[w]);
            for (j = 0; j < 3; j++) moved[j] += a[w][j] * wave;
        }
        for (j = 0; j < 3; j++) p[j] += (float)moved[j];
    }
}

/* A rotation, all of them alike likely: that of a random unit quaternion (w, x, y, z). */
static void draw_rotation(uint64_t *random, double r[3][3]) {
    double q[4], n, w, x, y, z;
    int j;
    do {
        for (n = j = 0; j < 4; j++) q[j] = draw(random), n += q[j] * q[j];
    } while (n > 1 || n < .01);
    n = sqrt(n);
    w = q[0] / n, x = q[1] / n, y = q[2] / n, z = q[3] / n;
    r[0][0] = 1 - 2 * (y * y + z * z), r[0][1] = 2 * (x * y - w * z), r[0][2] = 2 * (x * z + w * y);
    r[1][0] = 2 * (x * y + w * z), r[1][1] = 1 - 2 * (x * x + z * z), r[1][2] = 2 * (y * z - w * x);
    r[2][0] = 2 * (x * z - w * y), r[2][1] = 2 * (y * z + w * x), r[2][2] = 1 - 2 * (x * x + y * y);
}

/* Stretches a mesh along its axes, by up to 1.5 times, and turns it. */
static void stretch_and_turn(itn_mesh *mesh, uint64_t *random) {
    double s[3], r[3][3];
    int i, j;
    for (j = 0; j < 3; j++) s[j] = exp(.4 * draw(random));
    draw_rotation(random, r);
    for (i = 0; i < mesh->vertex_count; i++) {
        float *p = mesh->positions + 3 * i;
        double x = p[0] * s[0], y = p[1] * s[1], z = p[2] * s[2];
        for (j = 0; j < 3; j++) p[j] = (float)(r[j][0] * x + r[j][1] * y + r[j][2] * z);
    }
}

/* Makes another shape of the same family: how thick its parts are changes, how sharp its edges are,
   how rough it is, and how it lies. The bolt's thread is not to be smoothed away. */
static void vary_mesh(itn_mesh *mesh, int shape, double gradient, uint64_t random) {
    static const int most[TRAINING_SHAPES] = {60, 60, 60, 60, 8, 60}; /* roundings */
    double smoothness = .5 * draw(&random) + .5, roughness = .5 * draw(&random) + .5;
    int bend;
    smooth_mesh(mesh, (int)(most[shape] * smoothness * smoothness));
    fit_mesh(mesh);
    divide_mesh(mesh);
    for (bend = 0; bend < 5; bend++) bend_mesh(mesh, .18, 2, gradient, &random);
    for (bend = 0; bend < 4; bend++) bend_mesh(mesh, .06, .35, gradient * roughness, &random);
    stretch_and_turn(mesh, &random);
    fit_mesh(mesh);
}

/* Which variants of its shape the pictures of a shard show. Returns how many. */
static int list_variants(const shard *s, const float (*thetas)[3], int variants[PAIRS]) {
    unsigned char used[PAIRS] = {0};
    int i, count = 0;
    for (i = 0; i < s->count; i++) used[variant_of(s, thetas[i])] = 1;
    for (i = 0; i < PAIRS; i++)
        if (used[i]) variants[count++] = i;
    return count;
}

static void write_variant(const char *dir, int shape, int azimuth, int variant) {
    char path[PATH_SIZE];
    itn_mesh mesh = load_mesh(dir, shape, azimuth, 0);
    itn_error error;
    vary_mesh(&mesh, shape, .8, mix((uint64_t)shape, (uint64_t)azimuth, (uint64_t)variant));
    mesh_path(dir, shape, azimuth, variant, path);
    if (itn_mesh_save_ply(&mesh, path, &error)) fail(error.message, "");
    itn_mesh_free(&mesh);
    write_scene(dir, shape, azimuth, variant);
}

/* The same of all the shard's pictures. */
static int list_shown(const shard *s, int variants[PAIRS]) {
    float(*thetas)[3] = (float(*)[3])need((size_t)s->count, sizeof *thetas);
    int count;
    shard_materials(s, thetas);
    count = list_variants(s, (const float(*)[3])thetas, variants);
    free(thetas);
    return count;
}

/* Writes what the pictures of a shard show beside the shapes themselves. */
static void write_variants(const char *dir, const shard *s) {
    int variants[PAIRS], count = list_shown(s, variants), i;
    for (i = 0; i < count; i++)
        if (variants[i]) write_variant(dir, s->shape, s->azimuth, variants[i]);
}

/* ---- checksums of what scenes are made of ---- */

enum { SUM_SIZE = 96 }; /* of a line of scenes/sums.txt, at most */

/* The line of a file of DIR/scenes: its name and checksum. */
static void sum_line(const char *dir, const char *name, char line[SUM_SIZE]) {
    char path[PATH_SIZE], *bytes;
    size_t size;
    snprintf(path, sizeof path, "%s/scenes/%s", dir, name);
    bytes = read_file(path, &size);
    if (!bytes) fail(path, "cannot be read");
    snprintf(line, SUM_SIZE, "%s %016llx\n", name,
             (unsigned long long)checksum((const unsigned char *)bytes, size));
    free(bytes);
}

static void put_sum(const char *dir, const char *name, FILE *sums) {
    char line[SUM_SIZE];
    sum_line(dir, name, line);
    fputs(line, sums);
}

/* Those of what write_scenes has written. */
static void put_scene_sums(const char *dir, FILE *sums) {
    char name[64];
    int shape;
    put_sum(dir, GROUND, sums), put_sum(dir, SKY, sums);
    for (shape = 0; shape < SHAPES; shape++)
        mesh_name(shape, 0, 0, name), put_sum(dir, name, sums);
}

/* Those of what write_variants has written. */
static void put_variant_sums(const char *dir, const shard *s, FILE *sums) {
    int variants[PAIRS], count = list_shown(s, variants), i;
    char name[64];
    for (i = 0; i < count; i++) {
        if (!variants[i]) continue;
        mesh_name(s->shape, s->azimuth, variants[i], name);
        put_sum(dir, name, sums);
    }
}

/* ---- noise ---- */

/* Marks the pixels whose middle shows the object: rays from the camera of write_scene. */
static void object_mask(const char *dir, const shard *s, int variant, unsigned char *mask) {
    itn_mesh mesh = load_mesh(dir, s->shape, s->azimuth, variant);
    itn_bvh *bvh;
    itn_error error;
    double lift = mesh_lift(&mesh), half = tan(FOV / 2 * RADIANS);
    double cosine = -1.75 + 32.785, sine = 8.785 - .469, length = hypot(sine, cosine);
    int i;
    for (i = 0; i < mesh.vertex_count; i++) { /* half a turn about y, then up and towards the eye */
        float *p = mesh.positions + 3 * i;
        p[0] = -p[0], p[1] += (float)lift, p[2] = -p[2] - 1.75f;
    }
    if (itn_bvh_create(&mesh, NULL, &bvh, &error)) fail(error.message, "");
    cosine /= length, sine /= length; /* of the angle at which the camera looks down */
    for (i = 0; i < PIXELS; i++) {
        double x = half * (1 - (i % FILM + .5) * 2 / FILM);
        double y = half * (1 - (i / FILM + .5) * 2 / FILM);
        itn_ray ray = ITN_ZERO;
        ray.origin.y = 8.785f, ray.origin.z = -32.785f, ray.tmax = INFINITY;
        ray.direction.x = (float)x;
        ray.direction.y = (float)(cosine * y - sine);
        ray.direction.z = (float)(sine * y + cosine);
        mask[i] = (unsigned char)itn_bvh_occluded(bvh, &ray);
    }
    itn_bvh_free(bvh);
    itn_mesh_free(&mesh);
}

/* What a variant's fine film tells of its object: how much a pixel counts for pixels of the picture
   that show it, the sums of weights and of their squares, and how many of these there are. */
typedef struct view {
    float shares[FINE_PIXELS], squares[FINE_PIXELS];
    int count;
} view;

/* What fine_weights gives, and its squares. */
typedef struct filter {
    float weights[FILM * FINE], squares[FILM * FINE];
} filter;

static void make_filter(filter *f) {
    int i;
    fine_weights(f->weights);
    for (i = 0; i < FILM * FINE; i++) f->squares[i] = f->weights[i] * f->weights[i];
}

static view *make_view(const char *dir, const shard *s, int variant, const filter *f) {
    view *v = (view *)need(1, sizeof *v);
    unsigned char mask[PIXELS];
    float shown[PIXELS];
    int i;
    object_mask(dir, s, variant, mask);
    for (i = 0; i < PIXELS; i++) shown[i] = mask[i], v->count += mask[i];
    weigh_picture(shown, FILM, f->weights, 1, FINE, FINE, v->shares);
    weigh_picture(shown, FILM, f->squares, 1, FINE, FINE, v->squares);
    return v;
}

/* The sum of the object's pixels in a picture made of one channel of a fine render. */
static double object_light(const itn_image *image, int channel, const view *v) {
    const float *pixels = image->pixels + channel * FINE_PIXELS;
    double light = 0;
    int i;
    for (i = 0; i < FINE_PIXELS; i++) light += (double)v->shares[i] * (double)pixels[i];
    return light;
}

/* The noise of a picture, made of one channel of a fine render with `spp` samples of each pixel:
   over the object's pixels, the root of the mean variance of a pixel, relative to their mean.
   samples not NULL: what it would be with these numbers of samples instead. */
static double image_noise(const itn_image *image, int channel, const view *v, int spp,
                          const int *samples) {
    const float *variances = image->pixels + (3 + channel) * FINE_PIXELS;
    double variance = 0;
    int i;
    for (i = 0; i < FINE_PIXELS; i++) {
        double one = (double)v->squares[i] * (double)variances[i];
        variance += samples ? one * spp / samples[i] : one;
    }
    return v->count ? sqrt(variance * v->count) / object_light(image, channel, v) : 0;
}

/* ---- pictures ---- */

/* Pictures of a shard that one walk makes: of the same sigma_t and g, and so of one variant. */
typedef struct family {
    int members[3], count;
} family;

static const char *const family_names[5] = {"milk.sigma_t", "milk.g", "milk.albedo_r",
                                            "milk.albedo_g", "milk.albedo_b"};

/* The pictures of a shard, and how far all of them are. */
typedef struct work {
    const settings *settings;
    shard shard;
    itn_scene *scenes[PAIRS]; /* of three channels, by variant */
    int variants[PAIRS];      /* those that are used */
    float (*thetas)[3];
    family families[MATERIALS];
    int parameters[5]; /* family_names */
    view *views[PAIRS];
    filter filter;
    unsigned char *bytes;
    pthread_mutex_t lock; /* of what follows */
    int done, total;
    double start, worst, samples;
} work;

static void show_progress(work *w, int count, double noise, double spp) {
    double rate;
    pthread_mutex_lock(&w->lock);
    w->done += count, w->samples += count * spp, w->worst = fmax(w->worst, noise);
    rate = w->done / (seconds() - w->start);
    fprintf(stderr, "\r%d of %d images, %.2f a second, %.0f s left   ", w->done, w->total, rate,
            (w->total - w->done) / rate);
    pthread_mutex_unlock(&w->lock);
}

/* The picture of a material, or -1. */
static int find_picture(const work *w, float sigma_t, float albedo, float g) {
    int i;
    for (i = 0; i < w->shard.count; i++)
        if (w->thetas[i][0] == sigma_t && w->thetas[i][1] == albedo && w->thetas[i][2] == g)
            return i;
    return -1;
}

/* Neighbours in albedo go together, as dark ones need more and shorter paths. Returns how many. */
static int list_families(work *w) {
    int i, k, picture, count = 0;
    memset(w->families, 0, sizeof w->families);
    for (i = 0; i < PAIRS; i++) {
        for (k = 0; k < 5; k++) {
            family *f = &w->families[count];
            picture = find_picture(w, sigma_t_values[i / 5], albedo_values[k], g_values[i % 5]);
            if (picture < 0) continue;
            f->members[f->count++] = picture;
            count += f->count == 3;
        }
        count += w->families[count].count > 0;
    }
    return count;
}

/* All parameters of a scene, with the materials of a family; if it has less than three members,
   the last stands for the rest. The caller frees them. */
static float *family_theta(const work *w, const itn_scene *scene, const family *f) {
    float values[5];
    int k;
    values[0] = w->thetas[f->members[0]][0], values[1] = w->thetas[f->members[0]][2];
    for (k = 0; k < 3; k++)
        values[2 + k] = w->thetas[f->members[k < f->count ? k : f->count - 1]][1];
    return theta_with(scene, 5, w->parameters, values);
}

/* Stores the picture that a channel of a fine render makes as picture `index` of the shard. */
static void put_picture(const work *w, int index, const itn_image *image, int channel) {
    unsigned char *record = w->bytes + record_place(index);
    unsigned char *at = w->bytes + pixels_place(&w->shard, index);
    const view *v = w->views[variant_of(&w->shard, w->thetas[index])];
    float pixels[PIXELS];
    int k;
    weigh_picture(image->pixels + channel * FINE_PIXELS, FINE, w->filter.weights, FINE, 1, FILM,
                  pixels);
    for (k = 0; k < 3; k++) put_float(record + 4 * k, w->thetas[index][k]);
    put_float(record + 12, (float)image_noise(image, channel, v, 0, NULL));
    for (k = 0; k < PIXELS; k++) put_bytes(at + 2 * k, half_from_float(pixels[k]), 2);
}

/* The noise of the noisiest picture of a family; see image_noise. */
static double family_noise(const itn_image *image, const family *f, const view *v, int spp,
                           const int *samples) {
    double noise = 0;
    int k;
    for (k = 0; k < f->count; k++) noise = fmax(noise, image_noise(image, k, v, spp, samples));
    return noise;
}

static itn_image render_family(const work *w, const family *f, int spp, const int *samples,
                               int round) {
    const settings *s = w->settings;
    const float *first = w->thetas[f->members[0]];
    const itn_scene *scene = w->scenes[variant_of(&w->shard, first)];
    float *theta = family_theta(w, scene, f);
    itn_render_options options = ITN_ZERO;
    itn_image image;
    itn_error error;
    options.spp = spp, options.samples = samples;
    options.seed = mix(mix((uint64_t)s->seed, (uint64_t)round, 0),
                       (uint64_t)((int)w->shard.in * 100 + w->shard.azimuth),
                       (uint64_t)(w->shard.shape * MATERIALS + f->members[0]));
    if (itn_render(scene, theta, &options, NULL, 0, &image, &error)) fail(error.message, "");
    free(theta);
    return image;
}

/* The mean of two independent images, the second of which has `ratio` times the samples of the
   first, takes the first one's place. */
static void merge_images(itn_image *first, const itn_image *second, double ratio) {
    double sum = 1 + ratio;
    int i, k;
    for (k = 0; k < first->plane_count; k++) /* means, then variances */
        for (i = k * FINE_PIXELS; i < (k + 1) * FINE_PIXELS; i++) {
            double a = (double)first->pixels[i], b = (double)second->pixels[i];
            first->pixels[i] = (float)(k < first->plane_count / 2
                                           ? (a + ratio * b) / sum
                                           : (a + ratio * ratio * b) / (sum * sum));
        }
}

/* The sum over a family of a pixel's variances, each relative to how bright the object is. */
static double relative_variance(const itn_image *image, const family *f, const double light[3],
                                int pixel) {
    double sum = 0;
    int k;
    for (k = 0; k < f->count; k++)
        sum += (double)image->pixels[(3 + k) * FINE_PIXELS + pixel] / (light[k] * light[k]);
    return sum;
}

/* How much the deviation of each pixel's samples makes noise of the object's pixels. A few samples
   say little of their variance, so that most of it is taken from the pixels around. */
static void list_deviations(const itn_image *image, const family *f, const view *v,
                            double *deviations) {
    enum { AROUND = 2 };
    double light[3] = {0, 0, 0};
    int i, k, x, y;
    for (k = 0; k < f->count; k++) light[k] = object_light(image, k, v);
    for (i = 0; i < FINE_PIXELS; i++) {
        double around = 0;
        int left = i % FINE - AROUND, top = i / FINE - AROUND, count = 0;
        deviations[i] = 0;
        if (!(v->squares[i] > 0)) continue;
        for (y = top; y <= top + 2 * AROUND; y++)
            for (x = left; x <= left + 2 * AROUND; x++) {
                if (x < 0 || y < 0 || x >= FINE || y >= FINE) continue;
                around += relative_variance(image, f, light, y * FINE + x), count++;
            }
        around = .95 * around / count + .05 * relative_variance(image, f, light, i);
        deviations[i] = sqrt((double)v->squares[i] * around);
    }
}

/* Numbers of samples in proportion to deviations, `mean` of them in the mean of pixels that have
   some, at least `least` each. Returns how many there are per pixel. */
static double spread_samples(const double *deviations, double mean, int least, int *samples) {
    double sum = 0, all = 0;
    int i, count = 0;
    for (i = 0; i < FINE_PIXELS; i++) sum += deviations[i], count += deviations[i] > 0;
    for (i = 0; i < FINE_PIXELS; i++) {
        double wanted = count ? mean * deviations[i] * count / sum : 0;
        samples[i] = (int)ceil(fmin(fmax(wanted, least), 1 << 24));
        all += samples[i];
    }
    return all / FINE_PIXELS;
}

/* Decides from a first image, with `spp` samples of each pixel and of this noise, how many bring the
   noise of a family to what is asked for. Returns how many there are per pixel in the mean. */
static double choose_samples(const settings *s, const itn_image *image, int spp, double noise,
                             const family *f, const view *v, int *samples) {
    double *deviations = (double *)need(FINE_PIXELS, sizeof *deviations), mean, all;
    double most = s->spp / (double)(PARTS * PARTS);
    int least, i;
    mean = fmin(spp * pow(noise / s->noise, 2), most);
    least = (int)fmin(LEAST, fmax(mean, spp));
    list_deviations(image, f, v, deviations);
    for (i = 0; i < 3; i++) { /* noise falls with the root of the samples, but for the least ones */
        spread_samples(deviations, mean, least, samples);
        noise = family_noise(image, f, v, spp, samples);
        mean *= CARE * pow(noise / s->noise, 2);
    }
    all = spread_samples(deviations, mean, least, samples);
    for (i = 0; i < 20 && all > most; i++) /* what goes to the least ones stays */
        all = spread_samples(deviations, mean *= most / all, least, samples);
    free(deviations);
    return all;
}

/* Renders a family until the noise of all of it is small enough. A few samples of each pixel tell
   how many there are to be, and do not count themselves: what depends on their values must not be
   averaged with them. */
static void make_family(void *task, int index) {
    work *w = (work *)task;
    const settings *s = w->settings;
    const family *f = &w->families[index];
    const view *v = w->views[variant_of(&w->shard, w->thetas[f->members[0]])];
    int *samples = (int *)need(2 * FINE_PIXELS, sizeof *samples), *extra = samples + FINE_PIXELS;
    int most = s->spp / (PARTS * PARTS), round = 0, i;
    int spp = (int)fmin(fmin(LEAST, most), fmax(2, .0025 / (s->noise * s->noise)));
    itn_image image = render_family(w, f, spp, NULL, round), more;
    double all = spp, noise = family_noise(&image, f, v, 0, NULL), ratio;
    if (noise >= s->noise && spp < most) {
        all = choose_samples(s, &image, spp, noise, f, v, samples);
        itn_image_free(&image);
        image = render_family(w, f, 0, samples, ++round);
        noise = family_noise(&image, f, v, 0, NULL);
    }
    while (noise >= s->noise && all < .99 * most && round < 9) {
        ratio = fmin(fmax(1.02 * pow(noise / s->noise, 2), 1.1), most / all) - 1;
        for (i = 0; i < FINE_PIXELS; i++) extra[i] = (int)fmax(ceil(samples[i] * ratio), 2);
        more = render_family(w, f, 0, extra, ++round);
        merge_images(&image, &more, ratio);
        itn_image_free(&more);
        for (i = 0, all = 0; i < FINE_PIXELS; i++)
            samples[i] += extra[i], all += (double)samples[i] / FINE_PIXELS;
        noise = family_noise(&image, f, v, 0, NULL);
    }
    for (i = 0; i < f->count; i++) put_picture(w, f->members[i], &image, i);
    itn_image_free(&image);
    free(samples);
    show_progress(w, f->count, noise, all * PARTS * PARTS);
}

/* Loads the scene of one of the used variants; the parameters are in the same places in all. */
static void prepare_variant(void *task, int index) {
    work *w = (work *)task;
    int variant = w->variants[index], parameters[5];
    w->scenes[variant] = load_scene(&w->shard, variant, FILM_FAMILY, w->settings->dir,
                                    family_names, 5, index ? parameters : w->parameters);
    w->views[variant] = make_view(w->settings->dir, &w->shard, variant, &w->filter);
}

static void make_shard(work *w, const shard *s) {
    char path[PATH_SIZE];
    size_t size = shard_size(s);
    int threads = w->settings->threads, i, variants;
    w->shard = *s;
    w->thetas = (float(*)[3])need((size_t)s->count, sizeof *w->thetas);
    w->bytes = (unsigned char *)need(size, 1);
    shard_header(s, (char *)w->bytes);
    shard_materials(s, w->thetas);
    variants = list_variants(s, (const float(*)[3])w->thetas, w->variants);
    parallel_for(variants, prepare_variant, w, &threads);
    parallel_for(list_families(w), make_family, w, &threads);
    put_bytes(w->bytes + size - 8, checksum(w->bytes, size - 8), 8);
    shard_path(s, w->settings->dir, path);
    save_file(path, w->bytes, size);
    free(w->bytes);
    free(w->thetas);
    for (i = 0; i < PAIRS; i++) {
        itn_scene_free(w->scenes[i]), w->scenes[i] = NULL;
        free(w->views[i]), w->views[i] = NULL;
    }
}

/* Writes data.txt, or checks that what is there was made with the same settings. */
static void write_settings(const settings *s) {
    char path[PATH_SIZE], text[256], there[256] = "";
    int length = snprintf(text, sizeof text, "fraction %.9g\ntests %.9g\nnoise %.9g\nspp %d\n"
                          "seed %d\nversion %d\n", s->fraction, s->tests, s->noise, s->spp,
                          s->seed, VERSION);
    FILE *file;
    snprintf(path, sizeof path, "%s/data.txt", s->dir);
    file = fopen(path, "r");
    if (file) {
        there[fread(there, 1, sizeof there - 1, file)] = 0;
        fclose(file);
        if (strcmp(there, text)) fail(path, "was written with other settings; take another folder");
    }
    save_file(path, text, (size_t)length);
}

static int make_data(const settings *s) {
    static work w;
    shard shards[SPLITS][MOST_SHARDS];
    char *made = (char *)need(SPLITS * MOST_SHARDS, 1), sums_path[PATH_SIZE];
    int counts[SPLITS], in, i, found = 0;
    FILE *sums;
    make_folder(s->dir);
    write_settings(s);
    write_scenes(s);
    snprintf(sums_path, sizeof sums_path, "%s/scenes/sums.txt", s->dir);
    sums = begin_file(sums_path);
    put_scene_sums(s->dir, sums);
    w.settings = s;
    make_filter(&w.filter);
    for (in = 0; in < SPLITS; in++) {
        counts[in] = list_shards((split)in, read_fraction(s->dir, (split)in), shards[in]);
        for (i = 0; i < counts[in]; i++) {
            const char *fault;
            unsigned char *bytes = read_shard(&shards[in][i], s->dir, &fault);
            made[in * MOST_SHARDS + i] = bytes != NULL;
            if (bytes) found += shards[in][i].count;
            else w.total += shards[in][i].count;
            free(bytes);
            write_variants(s->dir, &shards[in][i]);
            put_variant_sums(s->dir, &shards[in][i], sums);
        }
    }
    end_file(sums, sums_path);
    if (found) fprintf(stderr, "%d images are there already\n", found);
    pthread_mutex_init(&w.lock, NULL);
    w.start = seconds();
    for (in = 0; in < SPLITS; in++)
        for (i = 0; i < counts[in]; i++)
            if (!made[in * MOST_SHARDS + i]) make_shard(&w, &shards[in][i]);
    pthread_mutex_destroy(&w.lock);
    free(made);
    if (w.done) fputc('\n', stderr);
    printf("%d images made in %.0f s, noise at most %.2f %%, %.1f samples per pixel in the mean\n",
           w.done, seconds() - w.start, 100 * w.worst,
           w.done ? w.samples / w.done : 0);
    return 0;
}

/* ---- check and look ---- */

/* Whether scenes/sums.txt, whose text is `sums`, has the checksum of a sound file. */
static int is_as_written(const char *dir, const char *name, const char *sums) {
    char line[SUM_SIZE];
    sum_line(dir, name, line);
    if (strstr(sums, line)) return 1;
    printf("%s/scenes/%s is not as `dataset make` wrote it\n", dir, name);
    return 0;
}

/* Whether a file holds this text; says what is wrong with it if not. */
static int is_text(const char *path, const char *text) {
    size_t size;
    char *there = read_file(path, &size);
    int same = there && !strcmp(there, text);
    if (!same)
        printf("%s %s\n", path, there ? "is not as `dataset make` writes it" : "is missing");
    free(there);
    return same;
}

/* How many files of a scene are missing or damaged: those of all films, and its mesh, which is read
   and should be closed. */
static int scene_faults(const char *dir, int shape, int azimuth, int variant, const char *sums) {
    char path[PATH_SIZE], text[SCENE_SIZE], name[64];
    itn_mesh mesh;
    itn_mesh_report report;
    itn_error error;
    int on, faults = 0;
    mesh_path(dir, shape, azimuth, variant, path);
    if (itn_mesh_load(path, NULL, &mesh, &error)) return printf("%s\n", error.message), 1;
    if (itn_mesh_check(&mesh, NULL, &report, &error)) fail(path, error.message);
    if (report.bad_vertices || report.bad_indices || report.open_edges || report.flipped_edges ||
        !(report.volume > 0))
        printf("%s is damaged: not closed\n", path), faults++;
    mesh_name(shape, azimuth, variant, name);
    if (!faults) faults += !is_as_written(dir, name, sums);
    for (on = 0; on < FILMS; on++) {
        scene_text(&mesh, shape, azimuth, variant, (film)on, text);
        scene_path(shape, azimuth, variant, (film)on, dir, path);
        faults += !is_text(path, text);
    }
    itn_mesh_free(&mesh);
    return faults;
}

/* The same of the scenes of a shard's pictures. */
static int shard_scene_faults(const char *dir, const shard *s, const char *sums) {
    int variants[PAIRS], count = list_shown(s, variants), i, faults = 0;
    for (i = 0; i < count; i++)
        faults += scene_faults(dir, s->shape, s->azimuth, variants[i], sums);
    return faults;
}

/* How many of ground and sky are missing or damaged, which all scenes read from the same files. */
static int shared_faults(const char *dir, const char *sums) {
    char path[PATH_SIZE];
    itn_scene *scene;
    itn_error error;
    scene_path(0, 0, 0, FILM_SMALL, dir, path);
    if (itn_scene_load(path, NULL, &scene, &error)) return printf("%s\n", error.message), 1;
    itn_scene_free(scene);
    return !is_as_written(dir, GROUND, sums) + !is_as_written(dir, SKY, sums);
}

static int check_data(const char *dir) {
    char sums_path[PATH_SIZE], *sums;
    size_t size;
    int in, i, k, faults;
    snprintf(sums_path, sizeof sums_path, "%s/scenes/sums.txt", dir);
    sums = read_file(sums_path, &size);
    if (!sums) return printf("%s is missing\n", sums_path), 1;
    faults = shared_faults(dir, sums);
    for (in = 0; in < SPLITS; in++) {
        shard shards[MOST_SHARDS];
        double noise = 0, worst = 0;
        int count = list_shards((split)in, read_fraction(dir, (split)in), shards), images = 0;
        for (i = 0; i < count; i++) {
            const char *fault;
            char path[PATH_SIZE];
            unsigned char *bytes = read_shard(&shards[i], dir, &fault);
            shard_path(&shards[i], dir, path);
            if (!bytes) printf("%s %s\n", path, fault), faults++;
            faults += shard_scene_faults(dir, &shards[i], sums);
            for (k = 0; bytes && k < shards[i].count; k++, images++) {
                double one = get_float(bytes + record_place(k) + 12);
                noise += one, worst = fmax(worst, one);
            }
            free(bytes);
        }
        printf("%-5s %4d images in %2d files, noise %.2f %% in the mean, at most %.2f %%\n",
               split_names[in], images, count, images ? 100 * noise / images : 0, 100 * worst);
    }
    free(sums);
    return faults != 0;
}

/* One picture of every shape (rows) and azimuth (columns); which of its materials, and in training
   which variant, by chance. */
static int save_sheet(const char *dir, const char *path) {
    itn_image sheet;
    itn_error error;
    int in, i, x, y, width = FILM * AZIMUTHS;
    if (itn_image_create(width, FILM * SHAPES, 1, NULL, &sheet, &error)) fail(error.message, "");
    for (in = 0; in < SPLITS; in++) {
        pictures p;
        load_pictures(dir, (split)in, &p);
        for (i = 0; i < p.count; i++) {
            const shard *s = &p.shards[p.shard_of[i]];
            float pixels[PIXELS];
            if (i > 0 && p.shard_of[i] == p.shard_of[i - 1]) continue;
            get_picture(&p, i, pixels);
            for (y = 0; y < FILM; y++)
                for (x = 0; x < FILM; x++)
                    sheet.pixels[(s->shape * FILM + y) * width + s->azimuth / 10 * FILM + x] =
                        pixels[y * FILM + x];
        }
        free_pictures(&p);
    }
    if (itn_image_save_png(&sheet, 0, 1, ITN_PNG_TONE, 0, path, &error)) fail(error.message, "");
    itn_image_free(&sheet);
    return 0;
}

int main(int argc, char **argv) {
    settings s;
    int i;
    memset(&s, 0, sizeof s);
    s.scenes = "scenes", s.fraction = 1, s.noise = .03, s.spp = 4096, s.seed = 1;
    s.threads = default_threads();
    if (argc == 3 && !strcmp(argv[1], "check")) return check_data(short_path(argv[2]));
    if (argc == 4 && !strcmp(argv[1], "sheet")) return save_sheet(short_path(argv[2]), argv[3]);
    if (argc < 3 || strcmp(argv[1], "make")) return fprintf(stderr, "%s", usage), 1;
    s.dir = short_path(argv[2]);
    for (i = 3; i < argc; i += 2) {
        const char *option = argv[i], *value = i + 1 < argc ? argv[i + 1] : NULL;
        if (!value) fail(option, "unknown option, or its value is missing");
        else if (!strcmp(option, "--fraction")) s.fraction = number(option, value, 1e-4, 1);
        else if (!strcmp(option, "--tests")) s.tests = number(option, value, 1e-4, 1);
        else if (!strcmp(option, "--noise")) s.noise = number(option, value, 1e-3, 1);
        else if (!strcmp(option, "--spp")) s.spp = whole(option, value, 2 * PARTS * PARTS);
        else if (!strcmp(option, "--seed")) s.seed = whole(option, value, 0);
        else if (!strcmp(option, "-t")) s.threads = whole(option, value, 1);
        else if (!strcmp(option, "--scenes")) s.scenes = short_path(value);
        else fail(option, "unknown option");
    }
    if (!(s.tests > 0)) s.tests = s.fraction;
    return make_data(&s);
}
