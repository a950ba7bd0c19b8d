/* Measures the library. Everything runs on one core; pin it (taskset -c 0) on a machine that others
   use too, and compare figures of one run only.

   make -C tests bench                  builds tests/build/bench; then, from anywhere,
   bench rays MESH.obj                  nearest hits of four sets of rays
   bench cnn [BATCH]                    training and inference of the authors' network; without a
                                        batch: training with 60 images, inference of one
   bench texels                         derivatives by the 100,000 values of a texture and of a
                                        map, beside the image itself
   bench walk [--csv FILE] [--mesh FILE] [--quick]
                                        the sweeps of the path walk, one row per measurement
   bench gradient [--csv FILE] [--mesh FILE] [--quick]
                                        error against time of each estimator of derivatives
   bench limits [--csv FILE] [--quick]  errors and deviations from the truth as parameters go to
                                        the ends of their ranges
   bench bias [--csv FILE] [--mesh FILE] [--quick]
                                        gradients of a loss from one render and from two
   bench invert [--csv FILE] [--mesh FILE] [--quick]
                                        loss and error against time of the ways to refine an
                                        estimate
   bench charts [FOLDER]                remakes the SVGs in FOLDER (tests/charts) from its CSVs

   All figures and charts of the project, in about half an hour:

       for what in walk gradient limits bias invert; do
           tests/build/bench $what --csv tests/charts/$what.csv
       done; tests/build/bench charts

   Columns of the walk's rows: what was rendered and by which variant; seconds to make the scene,
   and to prepare it for the fast walk (nothing where an earlier row's tables serve); the shortest
   render time of a few independent images; from their spread the mean square error of one;
   efficiency = pixels / (mean square error * seconds), by which methods compare that differ in
   noise and in speed. Set-up is in no other column. */
#define _POSIX_C_SOURCE 200809L
#define ITN_THREADS
#define ITN_IMPLEMENTATION
#include "../itn.h"

#include "chart.h"
#include "check.h"
#include "solids.h"
#include "stage.h"

#include "limit_cases.h"
#include "one.h"
#include "reuse.h"

#include <time.h>

#ifndef BENCH_FLAGS
#define BENCH_FLAGS "flags unknown"
#endif

static const char *const usage =
    "usage: bench rays MESH.obj\n"
    "       bench cnn [BATCH]\n"
    "       bench texels\n"
    "       bench walk|gradient|limits|bias|invert [--csv FILE] [--mesh FILE] [--quick]\n"
    "       bench charts [FOLDER]\n";

/* ---- helpers --------------------------------------------------------------------------------- */

static double seconds_now(void) {
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return (double)now.tv_sec + 1e-9 * (double)now.tv_nsec;
}

/* Of this process: a measurement takes a while, in which the machine may have other work. */
static double processor_seconds(void) { return (double)clock() / CLOCKS_PER_SEC; }

static void fail(const char *what, const char *why) {
    fprintf(stderr, "bench: %s%s%s\n", what, *why ? ": " : "", why);
    exit(1);
}

static void need(itn_result result, const itn_error *error) {
    if (result) fail(error->message, "");
}

static void *allocate(size_t count, size_t size) {
    void *block = calloc(count ? count : 1, size);
    if (!block) fail("out of memory", "");
    return block;
}

static itn_context one_core(void) {
    itn_context context = ITN_ZERO;
    context.threads = 1;
    return context;
}

/* Where the project's folder is, seen from the program, which lies in its tests/build. */
static const char *program = "";

static const char *project_path(const char *name, char *path, size_t size) {
    const char *slash = strrchr(program, '/');
    snprintf(path, size, "%.*s../../%s", slash ? (int)(slash - program) + 1 : 0, program, name);
    return path;
}

/* ---- rays ------------------------------------------------------------------------------------ */

/* Sets of rays that any tracer can repeat: Marsaglia's xorshift, drawn in a fixed order. */
enum { RAY_COUNT = 2000000, RAY_SIDE = 1414, RAY_SETS = 4, RAY_CAMERA = 3 };

static float draw(uint64_t *state) {
    *state ^= *state << 13, *state ^= *state >> 7, *state ^= *state << 17;
    return (float)(*state >> 40) * (1.f / 16777216.f);
}

/* Ray i of RAY_SIDE x RAY_SIDE from (.6,.5,2.2) towards the origin. */
static itn_ray camera_ray(int i) {
    itn_ray ray = ITN_ZERO;
    float x = -.6f + ((float)(i % RAY_SIDE) / RAY_SIDE - .5f) * 1.2f;
    float y = -.5f + ((float)(i / RAY_SIDE) / RAY_SIDE - .5f) * 1.2f, z = -2.2f;
    float n = 1 / sqrtf(x * x + y * y + z * z);
    ray.origin.x = .6f, ray.origin.y = .5f, ray.origin.z = 2.2f;
    ray.direction.x = x * n, ray.direction.y = y * n, ray.direction.z = z * n;
    return ray;
}

/* From a point near a random triangle into a uniform direction. */
static itn_ray surface_ray(const itn_mesh *mesh, uint64_t *state, float phi, float z) {
    itn_ray ray = ITN_ZERO;
    float q = sqrtf(1 - z * z), origin[3];
    const int *corner = mesh->triangles +
                        3 * (size_t)(draw(state) * (float)mesh->triangle_count);
    float a = draw(state), b = draw(state);
    int c;
    if (a + b > 1) a = 1 - a, b = 1 - b;
    for (c = 0; c < 3; c++) {
        float p = mesh->positions[3 * corner[0] + c];
        origin[c] = p + a * (mesh->positions[3 * corner[1] + c] - p) +
                    b * (mesh->positions[3 * corner[2] + c] - p) + 1e-3f * (draw(state) - .5f);
    }
    ray.origin.x = origin[0], ray.origin.y = origin[1], ray.origin.z = origin[2];
    ray.direction.x = q * cosf(phi), ray.direction.y = q * sinf(phi), ray.direction.z = z;
    return ray;
}

static void make_rays(const itn_mesh *mesh, int set, itn_ray *rays) {
    static const float tmax[RAY_SETS] = {1e30f, .05f, .01f, 1e30f};
    uint64_t state = 88172645463325252u;
    int i;
    for (i = 0; i < RAY_COUNT; i++) {
        float z = 2 * draw(&state) - 1, phi = 6.2831853f * draw(&state);
        rays[i] = set == RAY_CAMERA ? camera_ray(i) : surface_ray(mesh, &state, phi, z);
        rays[i].tmax = tmax[set];
    }
}

static void trace_rays(const itn_bvh *bvh, const itn_ray *rays, const char *name) {
    double best = HUGE_VAL, sum = 0;
    int repeat, i, hits = 0;
    for (repeat = 0; repeat < 3; repeat++) {
        double start = seconds_now();
        for (i = 0, hits = 0, sum = 0; i < RAY_COUNT; i++) {
            itn_hit hit;
            if (itn_bvh_nearest(bvh, &rays[i], &hit)) hits++, sum += hit.t;
        }
        best = fmin(best, seconds_now() - start);
    }
    printf("%-36s %6.2f Mrays/s, hits %.4f, mean t %.6f\n", name, RAY_COUNT / best * 1e-6,
           hits / (double)RAY_COUNT, sum / hits);
}

static void bench_rays(const char *path) {
    static const char *const names[RAY_SETS] = {"random directions from the surface",
                                                "the same, tmax 0.05", "the same, tmax 0.01",
                                                "camera"};
    itn_context context = one_core();
    itn_ray *rays = (itn_ray *)allocate(RAY_COUNT, sizeof *rays);
    itn_mesh mesh;
    itn_bvh *bvh;
    itn_error error;
    double start;
    int set;
    need(itn_mesh_load(path, &context, &mesh, &error), &error);
    start = seconds_now();
    need(itn_bvh_create(&mesh, &context, &bvh, &error), &error);
    printf("build %.1f ms, %d triangles\n", (seconds_now() - start) * 1e3, mesh.triangle_count);
    for (set = 0; set < RAY_SETS; set++) {
        make_rays(&mesh, set, rays);
        trace_rays(bvh, rays, names[set]);
    }
    itn_bvh_free(bvh);
    itn_mesh_free(&mesh);
    free(rays);
}

/* ---- texels ---------------------------------------------------------------------------------- */

/* A frosted ball on a printed ground, under a map; picture: of both. */
static itn_scene *printed_scene(const itn_image *picture) {
    itn_mesh ball = solids_sphere(1, 5);
    itn_surface_desc *ground;
    itn_scene *scene;
    itn_error error;
    itn_context context = one_core();
    stage s;
    stage_begin(&s, 128, 5, 40), s.desc.camera.eye.y = 3;
    stage_medium(&s, "milk", 50, .9, .3), stage_dielectric(&s, "glass", 1.4, .2);
    ground = stage_diffuse(&s, "ground", .8);
    ground->texture = ITN_TEXTURE_IMAGE, ground->image = picture;
    stage_object(&s, &ball, "milk", "glass");
    stage_object(&s, NULL, NULL, "ground")->plane_y = -1.2f;
    stage_map(&s, "dome", picture);
    need(itn_scene_create(&s.desc, &context, &scene, &error), &error);
    itn_mesh_free(&ball);
    return scene;
}

/* Seconds of the image (item NULL), or of the gradient by an item's values. */
static double texel_seconds(const itn_scene *scene, const char *item, itn_mode mode,
                            const float *weights) {
    itn_render_options options = ITN_ZERO;
    itn_image made;
    itn_error error;
    double seconds = processor_seconds();
    options.spp = 64, options.walks = 1, options.mode = mode;
    if (item)
        need(itn_render_texel_gradient(scene, NULL, &options, weights, item, &made, &error),
             &error);
    else
        need(itn_render(scene, NULL, &options, NULL, 0, &made, &error), &error);
    itn_image_free(&made);
    return processor_seconds() - seconds;
}

static void bench_texels(void) {
    static const char *const items[3] = {NULL, "ground", "dome"};
    static const char *const names[3] = {"image of 128x128, 64 paths a pixel",
                                         "gradient by 400x250 texels",
                                         "gradient by a map of 400x250"};
    itn_image picture;
    itn_scene *scene;
    itn_error error;
    float *weights = (float *)allocate(128 * 128, sizeof *weights);
    int i;
    need(itn_image_create(400, 250, 1, NULL, &picture, &error), &error);
    strcpy(picture.names[0], "Y");
    for (i = 0; i < 400 * 250; i++) picture.pixels[i] = .2f + .03f * (float)(i * 7 % 20);
    for (i = 0; i < 128 * 128; i++) weights[i] = 1;
    scene = printed_scene(&picture);
    texel_seconds(scene, NULL, ITN_MODE_FAST, weights); /* makes the tables */
    for (i = 0; i < 3; i++)
        printf("%-36s %.2f s, by the reference %.2f s\n", names[i],
               texel_seconds(scene, items[i], ITN_MODE_FAST, weights),
               texel_seconds(scene, items[i], ITN_MODE_REFERENCE, weights));
    itn_scene_free(scene), itn_image_free(&picture), free(weights);
}

/* ---- cnn ------------------------------------------------------------------------------------- */

/* The authors' network: 128x128 pixels, 7 layers of 16, 32, ... 1024 channels. */
enum { NET_LAYERS = 7, NET_SIZE = 128, NET_INPUTS = 2, NET_OUTPUTS = 3 };

/* Multiply-adds of one image on its way forward, in the convolutions (the rest is nothing). */
static double net_work(void) {
    double work = 0, from = NET_INPUTS, to = 16;
    int l;
    for (l = 0; l < NET_LAYERS; l++, from = to, to *= 2)
        work += (double)(NET_SIZE >> l) * (NET_SIZE >> l) * 9. * from * to;
    return work;
}

static itn_net *make_net(int batch) {
    itn_context context = one_core();
    itn_net_desc desc = ITN_ZERO;
    itn_error error;
    itn_net *net;
    desc.batch = batch;
    need(itn_net_create(&desc, &context, &net, &error), &error);
    return net;
}

typedef struct net_task {
    itn_net *net;
    int batch, training;
    float *images, *truth, *outputs;
} net_task;

/* One step of training (mean square error, Adam), or the way forward alone. */
static void net_step(net_task *task) {
    itn_error error;
    need(itn_net_forward(task->net, task->batch, task->images, task->outputs, &error), &error);
    if (!task->training) return;
    itn_net_zero_gradients(task->net);
    itn_loss_parameters(task->batch * NET_OUTPUTS, task->outputs, task->truth, task->outputs);
    need(itn_net_backward(task->net, task->batch, task->outputs, &error), &error);
    need(itn_net_step(task->net, 1e-4, &error), &error);
}

/* Images per second: the best of three rounds of at least three steps. */
static double net_rate(net_task *task) {
    int steps = 64 / task->batch < 3 ? 3 : 64 / task->batch, round, k;
    double best = HUGE_VAL;
    net_step(task);
    for (round = 0; round < 3; round++) {
        double start = seconds_now();
        for (k = 0; k < steps; k++) net_step(task);
        best = fmin(best, (seconds_now() - start) / steps);
    }
    return task->batch / best;
}

/* Rates at a batch, in images per second; either may be NULL. */
static void net_rates(int batch, double *training, double *inference) {
    size_t inputs = (size_t)batch * NET_INPUTS * NET_SIZE * NET_SIZE, i;
    size_t outputs = (size_t)batch * NET_OUTPUTS;
    uint64_t state = 88172645463325252u;
    net_task task = ITN_ZERO;
    task.net = make_net(batch), task.batch = batch;
    task.images = (float *)allocate(inputs, sizeof(float));
    task.truth = (float *)allocate(outputs, sizeof(float));
    task.outputs = (float *)allocate(outputs, sizeof(float));
    for (i = 0; i < inputs; i++) task.images[i] = 3.4f * (draw(&state) - .5f);
    for (i = 0; i < outputs; i++) task.truth[i] = 3.4f * (draw(&state) - .5f);
    task.training = 1;
    if (training) *training = net_rate(&task);
    task.training = 0;
    if (inference) *inference = net_rate(&task);
    itn_net_free(task.net);
    free(task.images);
    free(task.truth);
    free(task.outputs);
}

/* GFLOP/s are those of dense sums: what the backward pass saves counts as done. */
static void bench_cnn(int batch) {
    double work = net_work(), training, inference;
    net_rates(batch, &training, &inference);
    printf("batch %d: training %.1f images/s (%.1f GFLOP/s); inference %.1f images/s (%.1f "
           "GFLOP/s)\n", batch, training, 6e-9 * work * training, inference,
           2e-9 * work * inference);
}

static void bench_cnn_released(void) {
    double training, inference;
    net_rates(60, &training, NULL);
    net_rates(1, NULL, &inference);
    printf("released network: training %.1f images/s at batch 60; inference of single images "
           "%.1f images/s\n", training, inference);
}

/* ---- walk ------------------------------------------------------------------------------------ */

/* The walk's ideas, one after the other, each with all before it. */
typedef struct variant {
    const char *name;
    itn_mode mode;
    itn_sampler sampler;
    int walks;
    itn_estimator estimator;
} variant;

enum { REFERENCE, LANES, SPLIT, SOBOL, FORESIGHT, VARIANTS };
static const variant variants[VARIANTS] = {
    {"reference", ITN_MODE_REFERENCE, ITN_SAMPLER_RANDOM, 1, ITN_ESTIMATOR_SCORE},
    {"lanes", ITN_MODE_FAST, ITN_SAMPLER_RANDOM, 1, ITN_ESTIMATOR_SCORE},
    {"+ splitting", ITN_MODE_FAST, ITN_SAMPLER_RANDOM, 4, ITN_ESTIMATOR_SCORE},
    {"+ Sobol", ITN_MODE_FAST, ITN_SAMPLER_SOBOL, 4, ITN_ESTIMATOR_SCORE},
    {"+ control", ITN_MODE_FAST, ITN_SAMPLER_SOBOL, 4, ITN_ESTIMATOR_BASELINE}};

/* What is rendered. */
typedef struct subject {
    const char *scene, *boundary; /* studio or data; rough, smooth or none */
    const itn_mesh *mesh;
    double sigma_t, albedo, g;
    itn_scene *made;
    double build; /* seconds to make the scene */
    int size;     /* of the film, 0: 128 */
} subject;

typedef struct measurement {
    int spp, images;
    double prepare, seconds, mean, error; /* error: mean square */
    itn_render_stats stats;
} measurement;

typedef struct walk_bench {
    FILE *csv;
    const char *sweep;
    itn_mesh mesh; /* bounding box 1, centred */
    itn_sky sky;
    int images;     /* per measurement, at most */
    int spp;        /* of the sweeps of efficiency, */
    int cost_spp;   /* and of those of cost */
    double longest; /* so long takes an image of the sweep of spp at most */
    int stride;     /* 2: every other value of the long sweeps is left out */
    int most_triangles;
} walk_bench;

/* A mesh moved and scaled to bounding box 1, centred. */
static void normalize_mesh(itn_mesh *mesh) {
    double lower[3] = {HUGE_VAL, HUGE_VAL, HUGE_VAL}, upper[3] = {-HUGE_VAL, -HUGE_VAL, -HUGE_VAL};
    double size = 0;
    int i;
    for (i = 0; i < 3 * mesh->vertex_count; i++) {
        lower[i % 3] = fmin(lower[i % 3], mesh->positions[i]);
        upper[i % 3] = fmax(upper[i % 3], mesh->positions[i]);
    }
    for (i = 0; i < 3; i++) size = fmax(size, upper[i] - lower[i]);
    for (i = 0; i < 3 * mesh->vertex_count; i++)
        mesh->positions[i] = (float)((mesh->positions[i] - .5 * (lower[i % 3] + upper[i % 3])) /
                                     size);
}

/* The bumpy sphere's point in the direction of a point on the surface of a cube; equal points of
   two faces give equal bits, which closes the seams. */
static void bumpy_point(const double on_cube[3], float *position) {
    double x = tan(.7853981633974483 * on_cube[0]), y = tan(.7853981633974483 * on_cube[1]);
    double z = tan(.7853981633974483 * on_cube[2]), n = 1 / sqrt(x * x + y * y + z * z), r;
    x *= n, y *= n, z *= n;
    r = 1 + .12 * sin(5 * x + 1) * sin(6 * y + 2) * sin(7 * z + 3) +
        .02 * sin(23 * x) * sin(29 * y + 1) * sin(31 * z + 2);
    position[0] = (float)(r * x), position[1] = (float)(r * y), position[2] = (float)(r * z);
}

/* A closed bumpy sphere of about that many triangles: a cube whose faces are n x n squares. */
static itn_mesh bumpy_sphere(double triangles) {
    int n = (int)(sqrt(triangles / 12) + .5), side = n + 1, face, i, j, k, *t;
    itn_context context = one_core();
    itn_mesh mesh;
    itn_error error;
    float *p;
    need(itn_mesh_create(6 * side * side, 12 * n * n, 0, &context, &mesh, &error), &error);
    p = mesh.positions, t = mesh.triangles;
    for (face = 0; face < 6; face++) {
        int axis = face / 2, sign = face % 2 ? 1 : -1, first = face * side * side;
        for (j = 0; j < side; j++)
            for (i = 0; i < side; i++, p += 3) {
                double at[3];
                at[axis] = sign;
                at[(axis + 1) % 3] = sign * (2. * i - n) / n, at[(axis + 2) % 3] = (2. * j - n) / n;
                bumpy_point(at, p);
            }
        for (j = 0; j < n; j++)
            for (i = 0; i < n; i++, t += 6) {
                int square[6] = {0, 1, side, 1, side + 1, side};
                for (k = 0; k < 6; k++) t[k] = first + j * side + i + square[k];
            }
    }
    normalize_mesh(&mesh);
    return mesh;
}

/* The object in a room of constant light. */
static void set_studio(stage *s) {
    itn_camera_desc *camera = &s->desc.camera;
    camera->eye.x = .6f, camera->eye.y = .5f, camera->eye.z = 2.2f, camera->fov = 30;
    stage_constant(s, "light", 1);
}

/* The paper's data: the object on a plane, under sky and widened sun, seen from far away. */
static void set_data(stage *s, itn_object_desc *object, const itn_sky *sky) {
    static const float turned[12] = {-1, 0, 0, 0, 0, 1, 0, .5f, 0, 0, -1, -1.75f};
    itn_camera_desc *camera = &s->desc.camera;
    itn_object_desc *plane;
    itn_light_desc *light = stage_sky(s, "light");
    memcpy(object->transform, turned, sizeof turned);
    camera->eye.x = 0, camera->eye.y = 8.785f, camera->eye.z = -32.785f, camera->fov = 2.5f;
    camera->target.y = .469f, camera->target.z = -1.75f;
    stage_diffuse(s, "ground", .3);
    plane = stage_object(s, NULL, NULL, "ground");
    plane->plane_y = 0, plane->half_size = 20;
    light->sky = *sky, light->sun_scale = 2, light->sun_radius_scale = 70;
    light->sun_direction.x = .433f, light->sun_direction.y = .866f, light->sun_direction.z = .25f;
}

/* Makes the scene, and takes the shortest time of three. */
static void open_subject(subject *s, const itn_sky *sky) {
    itn_context context = one_core();
    const char *surface = strcmp(s->boundary, "none") ? "glass" : NULL;
    itn_error error;
    itn_object_desc *object;
    double start;
    stage set;
    int k;
    stage_begin(&set, s->size ? s->size : 128, 0, 30);
    stage_medium(&set, "milk", s->sigma_t, s->albedo, s->g);
    if (surface) stage_dielectric(&set, surface, 1.5, strcmp(s->boundary, "rough") ? 0 : .1);
    object = stage_object(&set, s->mesh, "milk", surface);
    if (!strcmp(s->scene, "studio")) set_studio(&set);
    else set_data(&set, object, sky);
    for (s->build = HUGE_VAL, k = 0; k < 3; k++) {
        itn_scene_free(s->made);
        start = seconds_now();
        need(itn_scene_create(&set.desc, &context, &s->made, &error), &error);
        s->build = fmin(s->build, seconds_now() - start);
        if (s->build > 1) break;
    }
}

static void close_subject(subject *s) {
    itn_scene_free(s->made);
    s->made = NULL;
}

static int pixel_count(const subject *s) {
    itn_film_desc film = itn_scene_film(s->made);
    return film.width * film.height;
}

/* Renders the image; returns seconds. */
static double render(const subject *s, const itn_render_options *options, float *pixels) {
    itn_image image;
    itn_error error;
    double start = seconds_now(), seconds;
    need(itn_render(s->made, NULL, options, NULL, 0, &image, &error), &error);
    seconds = seconds_now() - start;
    memcpy(pixels, image.pixels, (size_t)pixel_count(s) * sizeof *pixels);
    itn_image_free(&image);
    return seconds;
}

static int is_available(const variant *v) {
#ifdef ITN_NO_FAST
    return v->mode == ITN_MODE_REFERENCE;
#else
    return v != NULL;
#endif
}

/* Renders independent images: the shortest time, and the mean square error of one of them, which is
   the variance over the images averaged over the pixels. Of what takes long, two images must do. */
static measurement measure(const subject *s, const variant *v, int spp, int most_images) {
    size_t count = (size_t)pixel_count(s), i;
    float *pixels = (float *)allocate(count, sizeof *pixels);
    double *sums = (double *)allocate(count, 2 * sizeof *sums), start = seconds_now();
    itn_render_options options = ITN_ZERO;
    itn_error error;
    measurement m = ITN_ZERO;
    m.spp = options.spp = spp, options.stats = &m.stats;
    options.mode = v->mode, options.sampler = v->sampler, options.walks = v->walks;
    options.estimator = v->estimator;
    need(itn_scene_prepare(s->made, NULL, &options, &error), &error);
    m.prepare = seconds_now() - start, m.seconds = HUGE_VAL;
    for (start = seconds_now();
         m.images < 2 || (m.images < most_images && seconds_now() - start < 1);) {
        options.seed = (uint64_t)++m.images;
        m.seconds = fmin(m.seconds, render(s, &options, pixels));
        for (i = 0; i < count; i++)
            sums[2 * i] += pixels[i], sums[2 * i + 1] += (double)pixels[i] * pixels[i];
    }
    for (i = 0; i < count; i++) {
        double mean = sums[2 * i] / m.images;
        m.mean += mean / (double)count;
        m.error += (sums[2 * i + 1] - m.images * mean * mean) / (m.images - 1) / (double)count;
    }
    free(pixels);
    free(sums);
    return m;
}

static void write_names(walk_bench *bench) {
    fprintf(bench->csv, "sweep,scene,boundary,triangles,sigma_t,albedo,g,thickness,variant,walks,"
                        "spp,images,build_s,prepare_s,seconds,paths_per_s,collisions_per_s,"
                        "us_per_path,ns_per_collision,mean,mse,rmse,efficiency\n");
}

static void write_row(walk_bench *bench, const subject *s, const variant *v,
                      const measurement *m) {
    double thickness = itn_scene_thickness(s->made, NULL, "milk");
    double efficiency = pixel_count(s) / (m->error * m->seconds);
    fprintf(bench->csv, "%s,%s,%s,%d,%g,%g,%g,%.4g,%s,%d,%d,%d,%.4g,%.4g,%.4g,%.4g,%.4g,%.4g,%.4g,"
                        "%.6g,%.4g,%.4g,%.4g\n",
            bench->sweep, s->scene, s->boundary, s->mesh->triangle_count, s->sigma_t, s->albedo,
            s->g, thickness, v->name, v->walks, m->spp, m->images, s->build, m->prepare,
            m->seconds, m->stats.paths / m->seconds, m->stats.collisions / m->seconds,
            1e6 * m->seconds / m->stats.paths, 1e9 * m->seconds / m->stats.collisions, m->mean,
            m->error, sqrt(m->error), efficiency);
    fflush(bench->csv);
    fprintf(stderr, "%-9s %s/%-6s sigma_t %-8.4g albedo %-5g g %-4g %8d triangles  %-11s spp %-4d "
                    "%6.2f s  %8.3f Mpaths/s  %8.2f Mcollisions/s  efficiency %.3g\n",
            bench->sweep, s->scene, s->boundary, s->sigma_t, s->albedo, s->g,
            s->mesh->triangle_count, v->name, m->spp, m->seconds,
            1e-6 * m->stats.paths / m->seconds, 1e-6 * m->stats.collisions / m->seconds,
            efficiency);
}

/* Measures the variants up to `last` on a subject; where only cost is asked for, an eighth of the
   samples is enough for the reference. */
static void run_subject(walk_bench *bench, subject s, int spp, int last, int cost_only) {
    int v;
    open_subject(&s, &bench->sky);
    for (v = 0; v <= last; v++) {
        measurement m;
        int samples = v == REFERENCE && cost_only ? (spp + 7) / 8 : spp;
        if (!is_available(&variants[v])) continue;
        m = measure(&s, &variants[v], samples, bench->images);
        write_row(bench, &s, &variants[v], &m);
    }
    close_subject(&s);
}

/* A subject of the studio with a usual medium. */
static subject studio_subject(const walk_bench *bench) {
    subject s = ITN_ZERO;
    s.scene = "studio", s.boundary = "rough", s.mesh = &bench->mesh;
    s.sigma_t = 100, s.albedo = .9, s.g = .5;
    return s;
}

/* Three media in the studio, the middle one with each boundary, and three in the data's scene. */
static void sweep_scenes(walk_bench *bench) {
    static const double media[6][3] = {{25, .9, .5},   {100, .9, .5},  {300, .95, .9},
                                       {36, .59, .2}, {100, .87, .4}, {276, .95, .8}};
    static const char *const others[2] = {"smooth", "none"};
    int k;
    bench->sweep = "scenes";
    for (k = 0; k < 6; k++) {
        subject s = studio_subject(bench);
        s.sigma_t = media[k][0], s.albedo = media[k][1], s.g = media[k][2];
        if (k >= 3) s.scene = "data", s.boundary = "none";
        run_subject(bench, s, k < 3 ? bench->spp : (bench->spp + 1) / 2, FORESIGHT, 0);
    }
    for (k = 0; k < 2; k++) {
        subject s = studio_subject(bench);
        s.boundary = others[k];
        run_subject(bench, s, bench->spp, FORESIGHT, 0);
    }
}

static void sweep_albedo_and_g(walk_bench *bench) {
    static const double albedos[6] = {.3, .6, .8, .95, .99, .999};
    static const double gs[6] = {-.5, 0, .3, .7, .9, .97};
    int k;
    for (k = 0; k < 6; k += bench->stride) {
        subject s = studio_subject(bench);
        bench->sweep = "albedo", s.albedo = albedos[k];
        run_subject(bench, s, bench->spp, FORESIGHT, 0);
    }
    for (k = 0; k < 6; k += bench->stride) {
        subject s = studio_subject(bench);
        bench->sweep = "g", s.g = gs[k];
        run_subject(bench, s, bench->spp, FORESIGHT, 0);
    }
}

/* Error against time: each variant with more and more samples. */
static void sweep_spp(walk_bench *bench) {
    subject s = studio_subject(bench);
    int v, spp;
    bench->sweep = "spp";
    open_subject(&s, &bench->sky);
    for (v = 0; v < VARIANTS; v++) {
        double seconds = 0;
        for (spp = 1; is_available(&variants[v]) && seconds < .5 * bench->longest; spp *= 2) {
            measurement m = measure(&s, &variants[v], spp, bench->images);
            write_row(bench, &s, &variants[v], &m);
            seconds = m.seconds;
        }
    }
    close_subject(&s);
}

/* Optical thickness 1/100 to 10,000, with little absorption, so that the walk itself shows. */
static void sweep_thickness(walk_bench *bench) {
    subject s = studio_subject(bench);
    double unit;
    int k;
    bench->sweep = "thickness", s.sigma_t = 1, s.albedo = .99;
    open_subject(&s, &bench->sky);
    unit = itn_scene_thickness(s.made, NULL, "milk");
    close_subject(&s);
    for (k = -4; k <= 8; k += bench->stride) {
        s.sigma_t = pow(10, .5 * k) / unit;
        run_subject(bench, s, bench->cost_spp, SPLIT, 1);
    }
}

static void sweep_triangles(walk_bench *bench) {
    int k;
    bench->sweep = "triangles";
    for (k = 4; pow(10, .5 * k) < 1.1 * bench->most_triangles; k += bench->stride) {
        itn_mesh mesh = bumpy_sphere(pow(10, .5 * k));
        subject s = studio_subject(bench);
        s.mesh = &mesh;
        run_subject(bench, s, bench->cost_spp, SPLIT, 1);
        itn_mesh_free(&mesh);
    }
}

/* The processor's name, where the system tells. */
static void processor_name(char *name, size_t size) {
    FILE *file = fopen("/proc/cpuinfo", "r");
    char line[256];
    snprintf(name, size, "unknown processor");
    while (file && fgets(line, sizeof line, file))
        if (!strncmp(line, "model name", 10) && strchr(line, ':')) {
            line[strcspn(line, "\n")] = 0;
            snprintf(name, size, "%s", strchr(line, ':') + 2);
            break;
        }
    if (file) fclose(file);
}

/* The table's note: what was measured, where, by which command. */
static void write_note(walk_bench *bench, const char *what, const char *mesh, int quick) {
    const char *slash = strrchr(mesh, '/');
    char processor[128], compiler[128];
    processor_name(processor, sizeof processor);
#ifdef __clang__
    snprintf(compiler, sizeof compiler, "%s", __VERSION__);
#elif defined(__GNUC__)
    snprintf(compiler, sizeof compiler, "gcc %s", __VERSION__);
#else
    snprintf(compiler, sizeof compiler, "unknown compiler");
#endif
    fprintf(bench->csv, "# itn.h %d.%d.%d; one core of %s, %d lanes; %s, %s; bench %s%s --mesh %s"
                        "\n",
            ITN_VERSION_MAJOR, ITN_VERSION_MINOR, ITN_VERSION_PATCH, processor, (int)ITN__LANES,
            compiler, BENCH_FLAGS, what, quick ? " --quick" : "", slash ? slash + 1 : mesh);
}

/* Opens the table and the mesh. */
static void bench_open(walk_bench *bench, const char *what, const char *csv, const char *mesh,
                       int quick) {
    itn_context context = one_core();
    itn_error error;
    itn__buffer bytes = ITN_ZERO;
    itn_file file;
    char path[1024], sky[1024];
    memset(bench, 0, sizeof *bench);
    if (!mesh) mesh = project_path("scenes/shapes/knot.ply", path, sizeof path);
    need(itn_mesh_load(mesh, &context, &bench->mesh, &error), &error);
    need(itn__read_file(project_path("scenes/t3-e60.sky", sky, sizeof sky), 1 << 20, NULL, &bytes,
                        &error), &error);
    file.name = sky, file.bytes = bytes.bytes, file.size = bytes.size;
    need(itn__sky_from_memory(&context, &file, &bench->sky, &error), &error);
    itn__buffer_free(&bytes);
    normalize_mesh(&bench->mesh);
    bench->csv = csv ? fopen(csv, "w") : stdout;
    if (!bench->csv) fail(csv, "cannot be written");
    write_note(bench, what, mesh, quick);
}
static void bench_close(walk_bench *bench, const char *csv) {
    if (csv && fclose(bench->csv)) fail(csv, "cannot be written");
    itn_mesh_free(&bench->mesh);
}

static void bench_walk(const char *csv, const char *mesh, int quick) {
    walk_bench bench;
    bench_open(&bench, "walk", csv, mesh, quick);
    bench.images = quick ? 2 : 4, bench.stride = quick ? 2 : 1;
    bench.spp = quick ? 2 : 16, bench.cost_spp = quick ? 4 : 64, bench.longest = quick ? .3 : 4;
    bench.most_triangles = quick ? 100000 : 10000000;
    write_names(&bench);
    sweep_scenes(&bench);
    sweep_spp(&bench);
    sweep_thickness(&bench);
    sweep_albedo_and_g(&bench);
    sweep_triangles(&bench);
    bench_close(&bench, csv);
}

/* ---- derivatives ----------------------------------------------------------------------------- */

enum { MATERIAL = 3, ESTIMATORS = 5, DIFFERENCES = 3, REUSE = 4 };
static const char *const material[MATERIAL] = {"milk.sigma_t", "milk.albedo", "milk.g"};
static const char *const estimators[ESTIMATORS] = {"reference score", "score", "baseline",
                                                   "differences", "reuse"};
static const double media[3][MATERIAL] = {{5, .9, .5}, {50, .9, .5}, {300, .95, .9}};
static const char *const media_names[3] = {"thin", "medium", "thick"};

static void material_parameters(const subject *s, int *parameters) {
    int k;
    for (k = 0; k < MATERIAL; k++) parameters[k] = itn_parameter_find(s->made, material[k]);
}

static double plane_mean(const itn_image *image, int plane) {
    size_t count = (size_t)image->width * (size_t)image->height, i;
    double sum = 0;
    for (i = 0; i < count; i++) sum += image->pixels[(size_t)plane * count + i];
    return sum / (double)count;
}

/* Derivatives of the image's mean by all three parameters; returns seconds. */
static double differentiate(const subject *s, int estimator, itn_render_options options,
                            double *derivatives) {
    int parameters[MATERIAL], k;
    itn_image image;
    itn_error error;
    double start;
    material_parameters(s, parameters);
    options.mode = estimator == 0 ? ITN_MODE_REFERENCE : ITN_MODE_FAST;
    options.estimator = estimator == 1 ? ITN_ESTIMATOR_SCORE : ITN_ESTIMATOR_BASELINE;
    start = processor_seconds();
    need(itn_render(s->made, NULL, &options, parameters, MATERIAL, &image, &error), &error);
    start = processor_seconds() - start;
    for (k = 0; k < MATERIAL; k++) derivatives[k] = plane_mean(&image, 2 + 2 * k);
    itn_image_free(&image);
    return start;
}

/* The same by central differences over 4 % with common random numbers. */
static double difference(const subject *s, itn_render_options options, double *derivatives) {
    float theta[64];
    int k, side;
    double start = processor_seconds();
    itn_parameter_values(s->made, theta);
    for (k = 0; k < MATERIAL; k++) {
        int parameter = itn_parameter_find(s->made, material[k]);
        float value = theta[parameter];
        for (derivatives[k] = 0, side = -1; side <= 1; side += 2) {
            itn_image image;
            itn_error error;
            theta[parameter] = value * (1 + .02f * (float)side);
            need(itn_render(s->made, theta, &options, NULL, 0, &image, &error), &error);
            derivatives[k] += side * plane_mean(&image, 0) / (.04 * value);
            itn_image_free(&image);
        }
        theta[parameter] = value;
    }
    return processor_seconds() - start;
}

enum { REUSE_BYTES = 1 << 28 }; /* of the record */

/* The same from the paths of a render at 5 % more sigma_t, .01 less albedo and .02 less g, about
   the last steps of a refinement. Its time is that of using them again; *record_seconds receives
   what it took to record them, *share how many of them the result rests on. */
static double reuse(const subject *s, itn_render_options options, double *derivatives,
                    double *record_seconds, double *share) {
    static float planes[4 * 128 * 128];
    reuse_record record = ITN_ZERO;
    float theta[64];
    int parameters[MATERIAL], k, i;
    double start = processor_seconds(), seconds;
    material_parameters(s, parameters);
    itn_parameter_values(s->made, theta);
    theta[parameters[0]] *= 1.05f, theta[parameters[1]] -= .01f, theta[parameters[2]] -= .02f;
    record.most = REUSE_BYTES / sizeof(reuse_path);
    record.paths = (reuse_path *)allocate(record.most, sizeof(reuse_path));
    reuse_trace(&record, s->made, theta, options.spp, options.seed);
    if (record.full || record.pixels > 128 * 128) fail("reuse", "the record is too small");
    *record_seconds = processor_seconds() - start, start = processor_seconds();
    *share = reuse_image(&record, s->sigma_t, s->albedo, s->g, planes);
    seconds = processor_seconds() - start;
    for (k = 0; k < MATERIAL; k++)
        for (derivatives[k] = 0, i = 0; i < record.pixels; i++)
            derivatives[k] += (double)planes[(1 + k) * record.pixels + i] / record.pixels;
    free(record.paths);
    return seconds;
}

/* Root mean square errors over independent images, against the truth; `truth` is made by the first
   estimator that is measured. */
static void measure_gradient(walk_bench *bench, const subject *s, int medium, int estimator,
                             int spp, int images, const double *truth) {
    double sums[MATERIAL] = {0, 0, 0}, derivatives[MATERIAL], seconds = HUGE_VAL;
    double recorded = 0, record_seconds = HUGE_VAL, share = 1, all_shares = 0;
    itn_render_options options = ITN_ZERO;
    int i, k;
    options.spp = spp;
    for (i = 0; i < images; i++) {
        double now;
        options.seed = (uint64_t)i + 1;
        if (estimator == REUSE) now = reuse(s, options, derivatives, &recorded, &share);
        else if (estimator == DIFFERENCES) now = difference(s, options, derivatives);
        else now = differentiate(s, estimator, options, derivatives);
        seconds = fmin(seconds, now), record_seconds = fmin(record_seconds, recorded);
        all_shares += share / images;
        for (k = 0; k < MATERIAL; k++) sums[k] += pow(derivatives[k] - truth[k], 2);
    }
    for (k = 0; k < MATERIAL; k++)
        fprintf(bench->csv, "%s,%g,%g,%g,%s,%s,%d,%d,%.4g,%.6g,%.4g,%.4g,%.3f\n",
                media_names[medium], s->sigma_t, s->albedo, s->g, material[k],
                estimators[estimator], spp, images, seconds, truth[k],
                sqrt(sums[k] / images) / fabs(truth[k]), record_seconds, all_shares);
    fflush(bench->csv);
    fprintf(stderr, "%-6s %-16s spp %-3d %6.2f s  %.4f %.4f %.4f\n", media_names[medium],
            estimators[estimator], spp, seconds, sqrt(sums[0] / images) / fabs(truth[0]),
            sqrt(sums[1] / images) / fabs(truth[1]), sqrt(sums[2] / images) / fabs(truth[2]));
}

static void bench_gradient(const char *csv, const char *mesh, int quick) {
    walk_bench bench;
    int medium, estimator, spp;
    bench_open(&bench, "gradient", csv, mesh, quick);
    fprintf(bench.csv, "medium,sigma_t,albedo,g,parameter,estimator,spp,images,seconds,derivative,"
                       "relative_error,record_seconds,effective_share\n");
    for (medium = 0; medium < 3; medium++) {
        subject s = studio_subject(&bench);
        itn_render_options options = ITN_ZERO;
        double truth[MATERIAL];
        s.sigma_t = media[medium][0], s.albedo = media[medium][1], s.g = media[medium][2];
        open_subject(&s, &bench.sky);
        options.spp = quick ? 32 : 1024, options.seed = 999;
        differentiate(&s, 2, options, truth);
        for (estimator = 0; estimator < ESTIMATORS; estimator++)
            for (spp = 1; spp <= (quick ? 4 : 16); spp *= 4)
                measure_gradient(&bench, &s, medium, estimator, spp, quick ? 3 : 16, truth);
        close_subject(&s);
    }
    bench_close(&bench, csv);
}

/* A noisy picture whose material is to be found: 0 the data's scene without a surface, 1 rough
   glass in the studio. */
static void open_hidden(const walk_bench *bench, subject *s, int which, int size, int quick,
                        itn_image *target) {
    itn_render_options options = ITN_ZERO;
    itn_error error;
    *s = studio_subject(bench);
    s->size = size, s->sigma_t = which ? 25 : 50, s->albedo = .9, s->g = .5;
    if (!which) s->scene = "data", s->boundary = "none";
    open_subject(s, &bench->sky);
    options.spp = quick ? 16 : 512, options.seed = 77;
    need(itn_render(s->made, NULL, &options, NULL, 0, target, &error), &error);
}

/* ---- limits ---------------------------------------------------------------------------------- */

static const char *const limit_ways[2] = {"reference", "automatic"};

/* Renders as many samples as fit into the seconds, and compares all quantities with the truth. */
static void measure_limit(walk_bench *bench, const limit *l, int value, int way, double seconds,
                          const double *truth) {
    itn_render_options options = ITN_ZERO;
    itn_scene *scene = limit_make(l, value);
    solids_mean means[LIMIT_QUANTITIES];
    double claimed[LIMIT_QUANTITIES], spent;
    int k;
    options.mode = way ? ITN_MODE_AUTO : ITN_MODE_REFERENCE;
    options.spp = 4, options.seed = 1000;
    limit_measure(l, scene, &options, means, NULL); /* which also makes the tables */
    spent = processor_seconds();
    options.spp = 8, options.seed = 1001;
    limit_measure(l, scene, &options, means, NULL);
    spent = processor_seconds() - spent;
    options.spp = (int)fmin(8 * seconds / spent, 4000) + 2;
    options.seed = (uint64_t)(((l - limits) * LIMIT_VALUES + value) * 2 + way);
    spent = processor_seconds();
    limit_measure(l, scene, &options, means, claimed);
    spent = processor_seconds() - spent;
    for (k = 0; k < limit_quantities(l); k++) {
        const char *name = limit_name(l, k);
        double rounding = limit_rounding(truth, k);
        double off = means[k].value - truth[k], noise = hypot(means[k].error, rounding);
        double sigmas = off == 0 ? 0 : off / noise;
        fprintf(bench->csv, "%s,%.9g,%.9g,%s,%s,%d,%.3g,%.7g,%.7g,%.3g,%.3g,%.3g,%.3g\n", l->name,
                l->values[value], limit_distance(l, value), limit_ways[way], name,
                options.spp * LIMIT_BATCHES, spent, truth[k], means[k].value, means[k].error,
                claimed[k], means[k].error * sqrt(spent) / fabs(truth[k]),
                sigmas);
        if (!(fabs(sigmas) < 4.5))
            fprintf(stderr, "%s %g %s: %s %g +- %g, truth %g\n", l->name, l->values[value],
                    limit_ways[way], name, means[k].value, means[k].error, truth[k]);
    }
    fflush(bench->csv);
    itn_scene_free(scene);
}

static void bench_limits(const char *csv, const char *mesh, int quick) {
    walk_bench bench;
    int l, value, way;
    bench_open(&bench, "limits", csv, mesh, quick);
    fprintf(bench.csv, "limit,value,distance,walk,quantity,spp,seconds,truth,mean,error,"
                       "claimed_error,relative_error_of_a_second,sigmas\n");
    for (l = 0; l < LIMIT_COUNT; l++)
        for (value = 0; value < LIMIT_VALUES; value++) {
            double truth[LIMIT_QUANTITIES];
            limit_truth(&limits[l], value, truth);
            for (way = 0; way < 2; way++)
                measure_limit(&bench, &limits[l], value, way, quick ? .05 : .5, truth);
        }
    bench_close(&bench, csv);
}

/* ---- bias ------------------------------------------------------------------------------------ */

enum { FORMS = 2, TOTAL_SPP = 1024 };
static const char *const forms[FORMS] = {"one render", "two renders"};

/* The gradient of the mean of (I - target)^2, multiplied from one render's I and dI, which share
   their samples, or as itn_loss_gradient has it, from two renders. */
static void loss_gradient(const subject *s, const float *theta, const itn_image *target, int form,
                          int spp, uint64_t seed, double *gradient) {
    size_t count = (size_t)pixel_count(s), i;
    itn_render_options options = ITN_ZERO;
    int parameters[MATERIAL], k;
    itn_image image;
    itn_error error;
    double loss;
    material_parameters(s, parameters);
    options.spp = spp, options.seed = seed;
    if (form) {
        need(itn_loss_gradient(s->made, theta, &options, target->pixels, parameters, MATERIAL,
                               &loss, gradient, &error), &error);
        return;
    }
    need(itn_render(s->made, theta, &options, parameters, MATERIAL, &image, &error), &error);
    for (k = 0; k < MATERIAL; k++)
        for (gradient[k] = 0, i = 0; i < count; i++)
            gradient[k] += 2 * ((double)image.pixels[i] - target->pixels[i]) *
                           image.pixels[(size_t)(2 + 2 * k) * count + i] / (double)count;
    itn_image_free(&image);
}

/* Means over independent gradients of `spp` samples, with their standard errors. */
static void mean_gradient(const subject *s, const float *theta, const itn_image *target, int form,
                          int spp, int repeats, uint64_t seed, double *mean, double *error) {
    double one[MATERIAL];
    int r, k;
    for (k = 0; k < MATERIAL; k++) mean[k] = error[k] = 0;
    for (r = 0; r < repeats; r++) {
        loss_gradient(s, theta, target, form, spp, seed + (uint64_t)r, one);
        for (k = 0; k < MATERIAL; k++)
            mean[k] += one[k] / repeats, error[k] += one[k] * one[k] / repeats;
    }
    for (k = 0; k < MATERIAL; k++)
        error[k] = sqrt(fmax(error[k] - mean[k] * mean[k], 0) / (repeats - 1));
}

static void bench_bias(const char *csv, const char *mesh, int quick) {
    static const double at[MATERIAL] = {60, .88, .3};
    int parameters[MATERIAL], k, form, spp, total = quick ? TOTAL_SPP / 8 : TOTAL_SPP;
    double truth[MATERIAL], truth_error[MATERIAL], mean[MATERIAL], error[MATERIAL];
    itn_image target;
    walk_bench bench;
    float theta[64];
    subject s;
    bench_open(&bench, "bias", csv, mesh, quick);
    fprintf(bench.csv, "parameter,form,spp,repeats,gradient,error,truth,truth_error\n");
    open_hidden(&bench, &s, 0, 16, quick, &target);
    itn_parameter_values(s.made, theta);
    material_parameters(&s, parameters);
    for (k = 0; k < MATERIAL; k++) theta[parameters[k]] = (float)at[k];
    mean_gradient(&s, theta, &target, 1, total / 8, 16, 1, truth, truth_error);
    for (form = 0; form < FORMS; form++)
        for (spp = 2; spp <= 64; spp *= 2) {
            mean_gradient(&s, theta, &target, form, spp, total / spp, (uint64_t)(1000000 * spp),
                          mean, error);
            for (k = 0; k < MATERIAL; k++)
                fprintf(bench.csv, "%s,%s,%d,%d,%.6g,%.3g,%.6g,%.3g\n", material[k], forms[form],
                        spp, total / spp, mean[k], error[k], truth[k], truth_error[k]);
            fflush(bench.csv);
        }
    itn_image_free(&target);
    close_subject(&s);
    bench_close(&bench, csv);
}

/* ---- inversion ------------------------------------------------------------------------------- */

/* Every method gets the same seconds, and its samples or its step size by the same rule: of three
   settings, the one whose searches from both starts in both scenes, with a trial seed, leave the
   smallest loss (geometric mean). Rates fall to a tenth over as many steps as fit. */
enum { NEWTON, ADAM, SGD, METHODS };
enum { SETTINGS = 3, STARTS = 2, HIDDEN = 2, SEEDS = 5, TIMES = 10 };
static const char *const method_names[METHODS] = {"LM", "Adam", "SGD"};
static const double settings[METHODS][SETTINGS] = {{16, 32, 64}, {.05, .15, .5}, {1, 10, 100}};
static const char *const start_names[STARTS] = {"near", "far"};

typedef struct descent {
    double began, budget;
    int parameters[MATERIAL];
    int steps;
    double seconds[4096];
    float values[4096][MATERIAL];
} descent;

/* Returns whether time is up. */
static int note_theta(descent *d, const float *theta) {
    double seconds = processor_seconds() - d->began;
    int k;
    if (d->steps == 4096 || (d->steps && seconds > d->budget)) return 1;
    for (k = 0; k < MATERIAL; k++) d->values[d->steps][k] = theta[d->parameters[k]];
    d->seconds[d->steps++] = seconds;
    return 0;
}

static int note_step(void *user, const itn_refine_step *step) {
    return step->fraction == 1 && note_theta((descent *)user, step->theta) ? -1 : 0;
}

/* Adam or plain descent in the coordinates on the loss gradient over the picture's mean square, by a
   rate that falls to a tenth. */
static void follow_gradient(const subject *s, const itn_image *target, float *theta, int method,
                            double rate, int iterations, uint64_t seed, descent *d) {
    double at[MATERIAL], m[MATERIAL] = {0}, v[MATERIAL] = {0}, gradient[MATERIAL], loss, square = 0;
    size_t i;
    int k, n;
    for (i = 0; i < (size_t)pixel_count(s); i++)
        square += pow(target->pixels[i], 2) / pixel_count(s);
    for (k = 0; k < MATERIAL; k++)
        at[k] = itn_parameter_to_coordinate(itn_parameter_get(s->made, d->parameters[k]),
                                            theta[d->parameters[k]]);
    d->steps = 0, d->began = processor_seconds();
    for (n = 0; n < iterations; n++) {
        double now = rate * pow(.1, (double)n / iterations);
        itn_render_options options = ITN_ZERO;
        itn_error error;
        options.spp = 4, options.seed = seed * 1000003 + (uint64_t)n;
        need(itn_loss_gradient(s->made, theta, &options, target->pixels, d->parameters, MATERIAL,
                               &loss, gradient, &error), &error);
        if (note_theta(d, theta)) return;
        for (k = 0; k < MATERIAL; k++) {
            const itn_parameter *p = itn_parameter_get(s->made, d->parameters[k]);
            double g = gradient[k] / square * itn_parameter_slope(p, theta[d->parameters[k]]);
            m[k] = .9 * m[k] + .1 * g, v[k] = .999 * v[k] + .001 * g * g;
            if (method == SGD) at[k] -= fmax(-.5, fmin(.5, now * g));
            else at[k] -= now * m[k] / (1 - pow(.9, n + 1)) /
                          (sqrt(v[k] / (1 - pow(.999, n + 1))) + 1e-8);
            theta[d->parameters[k]] = (float)itn_parameter_from_coordinate(p, at[k]);
        }
    }
    note_theta(d, theta);
}

/* Searches for the material of a picture, until the method stops by itself or time is up. */
static void descend(const subject *s, const itn_image *target, int method, double setting,
                    int start, int iterations, uint64_t seed, descent *d) {
    static const double from[STARTS][MATERIAL] = {{1.2, .85, .4}, {3, .6, .2}};
    itn_refine_options options = ITN_ZERO;
    itn_estimate estimates[MATERIAL];
    itn_result result;
    itn_error error;
    float theta[64];
    int k;
    material_parameters(s, d->parameters);
    itn_parameter_values(s->made, theta);
    for (k = 0; k < MATERIAL; k++)
        theta[d->parameters[k]] = (float)(from[start][k] * (k ? 1 : s->sigma_t));
    if (method != NEWTON) {
        follow_gradient(s, target, theta, method, setting, iterations, seed, d);
        return;
    }
    options.seed = seed, options.iterations = iterations, options.spp = (int)setting;
    options.target_variance = target->pixels + (size_t)pixel_count(s);
    options.progress = note_step, options.progress_user = d;
    d->steps = 0, d->began = processor_seconds();
    result = itn_refine(s->made, theta, target->pixels, d->parameters, MATERIAL, &options,
                        estimates, &error);
    if (result != ITN_ERROR_CANCELLED) need(result, &error);
    if (result || d->steps == 4096) return;
    for (k = 0; k < MATERIAL; k++) d->values[d->steps][k] = theta[d->parameters[k]];
    d->seconds[d->steps++] = processor_seconds() - d->began;
}

/* The loss of values against the picture without noise, over its mean square. */
static double loss_of(const subject *s, const itn_image *clean, const float *values) {
    size_t count = (size_t)pixel_count(s), i;
    itn_render_options options = ITN_ZERO;
    int parameters[MATERIAL], k;
    double loss, square = 0;
    itn_error error;
    float theta[64];
    material_parameters(s, parameters);
    itn_parameter_values(s->made, theta);
    for (k = 0; k < MATERIAL; k++) theta[parameters[k]] = values[k];
    options.spp = 64, options.walks = 1, options.seed = 4242;
    need(itn_loss_gradient(s->made, theta, &options, clean->pixels, NULL, 0, &loss, NULL, &error),
         &error);
    for (i = 0; i < count; i++) square += pow(clean->pixels[i], 2) / (double)count;
    return loss / square;
}

/* Writes where a search stood at times spread evenly in the logarithm; returns the last loss. */
static double write_descent(walk_bench *bench, const subject *s, const itn_image *clean,
                            const char *names, const descent *d) {
    double loss = 0, off[MATERIAL], square;
    int t, k, step = 0, known = -1;
    for (t = 0; t < TIMES; t++) {
        double seconds = d->budget * pow(.02, 1 - t / (TIMES - 1.));
        while (step + 1 < d->steps && d->seconds[step + 1] <= seconds) step++;
        if (step != known) loss = loss_of(s, clean, d->values[step]), known = step;
        off[0] = d->values[step][0] / s->sigma_t - 1, off[1] = d->values[step][1] - s->albedo;
        off[2] = d->values[step][2] - s->g;
        for (square = 0, k = 0; k < MATERIAL; k++) square += off[k] * off[k] / MATERIAL;
        fprintf(bench->csv, "%s,%.4g,%.4g,%.4g,%.4g,%.4g,%.4g\n", names, seconds, loss, off[0],
                off[1], off[2], sqrt(square));
    }
    fflush(bench->csv);
    return loss;
}

typedef struct hidden {
    subject s;
    itn_image target, clean;
} hidden;

/* One search: seed 0 is the trial. Returns the loss at its end. */
static double search(walk_bench *bench, const hidden *h, int method, double setting, int start,
                     int seed, double budget) {
    static descent d;
    char names[128];
    double loss;
    int iterations = 200;
    d.budget = budget;
    if (method != NEWTON) { /* how many steps fit? */
        descend(&h->s, &h->target, method, setting, start, 5, 99, &d);
        iterations = (int)(budget / ((d.seconds[d.steps - 1] - d.seconds[0]) / (d.steps - 1))) + 1;
    }
    descend(&h->s, &h->target, method, setting, start, iterations, (uint64_t)seed, &d);
    snprintf(names, sizeof names, "%s,%s,%s,%g,%d", h->s.scene, start_names[start],
             method_names[method], setting, seed);
    loss = write_descent(bench, &h->s, &h->clean, names, &d);
    fprintf(stderr, "%-32s %4d steps, loss %.3g\n", names, d.steps - 1, loss);
    return loss;
}

/* The setting of a method by the rule above. */
static double choose_setting(walk_bench *bench, const hidden *h, int method, double budget) {
    double least = HUGE_VAL, best = 0;
    int k, i, start;
    for (k = 0; k < SETTINGS; k++) {
        double sum = 0;
        for (i = 0; i < HIDDEN; i++)
            for (start = 0; start < STARTS; start++)
                sum += log(fmax(search(bench, &h[i], method, settings[method][k], start, 0,
                                       budget), 1e-6));
        if (sum < least) least = sum, best = settings[method][k];
    }
    return best;
}

static void bench_invert(const char *csv, const char *mesh, int quick) {
    double budget = quick ? .3 : 4;
    itn_render_options options = ITN_ZERO;
    hidden h[HIDDEN];
    walk_bench bench;
    itn_error error;
    int i, method, start, seed;
    bench_open(&bench, "invert", csv, mesh, quick);
    fprintf(bench.csv, "scene,start,method,setting,seed,seconds,loss,off_sigma_t,off_albedo,off_g,"
                       "off\n");
    options.spp = quick ? 64 : 1024, options.seed = 78;
    for (i = 0; i < HIDDEN; i++) {
        open_hidden(&bench, &h[i].s, i, 32, quick, &h[i].target);
        need(itn_render(h[i].s.made, NULL, &options, NULL, 0, &h[i].clean, &error), &error);
    }
    for (method = 0; method < METHODS; method++) {
        double setting = choose_setting(&bench, h, method, budget);
        for (i = 0; i < HIDDEN; i++)
            for (start = 0; start < STARTS; start++)
                for (seed = 1; seed <= SEEDS; seed++)
                    search(&bench, &h[i], method, setting, start, seed, budget);
    }
    for (i = 0; i < HIDDEN; i++) {
        itn_image_free(&h[i].target);
        itn_image_free(&h[i].clean);
        close_subject(&h[i].s);
    }
    bench_close(&bench, csv);
}

/* ---- charts ---------------------------------------------------------------------------------- */

static int cell_is(const chart_table *table, int row, const char *column, const char *value) {
    return !strcmp(chart_cell(table, row, column), value);
}
static double cell_value(const chart_table *table, int row, const char *column) {
    return atof(chart_cell(table, row, column));
}

/* Adds the rows of a sweep and a variant as a series. */
static void add_rows(chart_panel *panel, const chart_table *table, const char *sweep,
                     const variant *v, const char *x, const char *y) {
    chart_series *series = chart_begin(panel, v->name, (int)(v - variants));
    int row;
    for (row = 0; row < table->rows; row++)
        if (cell_is(table, row, "sweep", sweep) && cell_is(table, row, "variant", v->name))
            chart_add(panel, series, cell_value(table, row, x), cell_value(table, row, y));
}

static void save_chart(chart *c, const char *folder, const char *name) {
    char path[1024];
    int p, points = 0;
    for (p = 0; p < c->panel_count; p++)
        if (c->panels[p].series_count) points += c->panels[p].series[0].count;
    if (snprintf(path, sizeof path, "%s/%s", folder, name) >= (int)sizeof path)
        fail(folder, "too long a name");
    if (!points) fail(path, "the table has no rows for it");
    if (!chart_write(c, path)) fail(path, "cannot be written");
    printf("%s\n", path);
}

enum { MOST_PANELS = 12 };

static chart chart_of(const chart_table *table, chart_panel *panels, int count, const char *title,
                      const char *subtitle) {
    chart c = ITN_ZERO;
    c.title = title, c.subtitle = subtitle, c.footer = table->note;
    c.panels = panels, c.panel_count = count, c.height = 430;
    memset(panels, 0, (size_t)count * sizeof *panels);
    for (; count; count--) panels[count - 1].x.logarithmic = panels[count - 1].y.logarithmic = 1;
    return c;
}

static void chart_error(const chart_table *table, chart_panel *panels, const char *folder) {
    chart c = chart_of(table, panels, 1, "The same picture in less time: what each idea is worth",
                       "Studio scene, rough glass filled with milk: sigma_t 100, albedo 0.9, "
                       "g 0.5; 128\xc3\x97" "128 pixels");
    int v;
    panels->x.title = "render time, seconds on one core";
    panels->y.title = "error of a pixel (root mean square)";
    panels->gain = 1;
    for (v = 0; v < VARIANTS; v++) add_rows(panels, table, "spp", &variants[v], "seconds", "rmse");
    save_chart(&c, folder, "error.svg");
}

static void chart_thickness(const chart_table *table, chart_panel *panels, const char *folder) {
    chart c = chart_of(table, panels, 1, "What a scattering event costs, everything included",
                       "Studio scene, rough glass; albedo 0.99, g 0.5; thin objects scatter "
                       "little, so that all else is paid by few events");
    int v;
    panels->x.title = "optical thickness (sigma_t \xc3\x97 mean chord)";
    panels->y.title = "time per scattering event, nanoseconds";
    panels->unit = "ns";
    for (v = 0; v <= SPLIT; v++)
        add_rows(panels, table, "thickness", &variants[v], "thickness", "ns_per_collision");
    save_chart(&c, folder, "thickness.svg");
}

static void chart_triangles(const chart_table *table, chart_panel *panels, const char *folder) {
    chart c = chart_of(table, panels, 2, "What more triangles cost",
                       "Studio scene, bumpy sphere of rough glass: sigma_t 100, albedo 0.9, g 0.5");
    int v;
    panels[0].x.title = panels[1].x.title = "triangles";
    panels[0].y.title = "time per path, microseconds";
    panels[1].y.title = "set-up, seconds";
    for (v = 0; v <= SPLIT; v++)
        add_rows(&panels[0], table, "triangles", &variants[v], "triangles", "us_per_path");
    add_rows(&panels[1], table, "triangles", &variants[REFERENCE], "triangles", "build_s");
    add_rows(&panels[1], table, "triangles", &variants[LANES], "triangles", "prepare_s");
    strcpy(panels[1].series[0].name, "scene, tree");
    strcpy(panels[1].series[1].name, "fast walk");
    save_chart(&c, folder, "triangles.svg");
}

static void chart_gradient(const chart_table *table, chart_panel *panel, const char *folder) {
    static const char *const subtitles[3] = {
        "Studio scene, rough glass, thin medium: sigma_t 5, albedo 0.9, g 0.5",
        "Studio scene, rough glass, medium: sigma_t 50, albedo 0.9, g 0.5",
        "Studio scene, rough glass, thick medium: sigma_t 300, albedo 0.95, g 0.9"};
    int m, e, row;
    for (m = 0; m < 3; m++) {
        chart c = chart_of(table, panel, 1, "The derivative by sigma_t, by five estimators",
                           subtitles[m]);
        char name[64];
        panel->x.title = "processor seconds, with those of recording paths";
        panel->y.title = "relative error of d mean / d sigma_t (root mean square)";
        for (e = 0; e < ESTIMATORS; e++) {
            chart_series *series = chart_begin(panel, estimators[e], e);
            for (row = 0; row < table->rows; row++)
                if (cell_is(table, row, "medium", media_names[m]) &&
                    cell_is(table, row, "estimator", estimators[e]) &&
                    cell_is(table, row, "parameter", material[0]))
                    chart_add(panel, series,
                              cell_value(table, row, "seconds") +
                                  cell_value(table, row, "record_seconds"),
                              cell_value(table, row, "relative_error"));
        }
        snprintf(name, sizeof name, "gradient_%s.svg", media_names[m]);
        save_chart(&c, folder, name);
    }
}

static int compare_doubles(const void *a, const void *b) {
    double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

/* What is below is noise of the measured loss, which may also be negative. */
#define LEAST_LOSS 1e-4

/* Median and range over the seeds of a method, scene and start at each time. */
static void add_searches(chart_panel *panel, const chart_table *table, int method,
                         const char *scene, const char *start, const char *what) {
    chart_series *series = chart_begin(panel, method_names[method], method);
    double values[TIMES][SEEDS], seconds[TIMES] = {0};
    int found[TIMES] = {0}, row, t = 0;
    for (row = 0; row < table->rows; row++) {
        if (!cell_is(table, row, "method", method_names[method]) ||
            !cell_is(table, row, "scene", scene) || !cell_is(table, row, "start", start) ||
            cell_is(table, row, "seed", "0"))
            continue;
        seconds[t] = cell_value(table, row, "seconds");
        if (found[t] < SEEDS) values[t][found[t]++] = cell_value(table, row, what);
        if (!strcmp(what, "loss"))
            values[t][found[t] - 1] = fmax(values[t][found[t] - 1], LEAST_LOSS);
        t = (t + 1) % TIMES;
    }
    for (t = 0; t < TIMES; t++) {
        qsort(values[t], (size_t)found[t], sizeof values[t][0], compare_doubles);
        if (found[t] == SEEDS)
            chart_add_spread(panel, series, seconds[t], values[t][SEEDS / 2], values[t][0],
                             values[t][SEEDS - 1]);
    }
    series->spread = CHART_BAND;
}

static void chart_invert(const chart_table *table, chart_panel *panels, const char *folder) {
    static const char *const scenes[HIDDEN] = {"data", "studio"};
    static const char *const titles[HIDDEN][STARTS] = {{"sun, near start", "sun, far start"},
                                                       {"glass, near start", "glass, far start"}};
    static const char *const whats[2] = {"loss", "off"};
    static const char *const words[2] = {"loss", "error"};
    static char names[2 * HIDDEN * STARTS][64];
    chart c = chart_of(table, panels, 2 * HIDDEN * STARTS, "In equal time all three methods fit "
                       "the picture; from afar only Levenberg-Marquardt finds the material",
                       "Medians and ranges of five seeds. Loss over the picture's mean square, "
                       "at least 1e-4; error: r.m.s. of sigma_t (relative), albedo and g");
    int what, scene, start, method;
    for (what = 0; what < 2; what++)
        for (scene = 0; scene < HIDDEN; scene++)
            for (start = 0; start < STARTS; start++) {
                int p = (what * HIDDEN + scene) * STARTS + start;
                snprintf(names[p], sizeof names[p], "%s: %s", titles[scene][start], words[what]);
                panels[p].y.title = names[p], panels[p].x.title = "processor seconds";
                for (method = 0; method < METHODS; method++)
                    add_searches(&panels[p], table, method, scenes[scene], start_names[start],
                                 whats[what]);
            }
    c.columns = HIDDEN * STARTS, c.width = 1000, c.height = 600, c.legend = METHODS;
    save_chart(&c, folder, "invert.svg");
}

/* Searches by Mitsuba and by us: rows of one search follow each other, median and range over seeds.
   No command here makes the table: it was measured by programs that need Mitsuba. */
static void chart_mitsuba(const chart_table *table, chart_panel *panels, const char *folder) {
    static const char *const scenes[3] = {"ground", "white", "map"};
    static const char *const titles[3] = {"index-matched, on the ground: error",
                                          "frosted, constant light: error",
                                          "frosted, lit by a map: error"};
    chart c = chart_of(table, panels, 3, "The same material from the same picture",
                       "64\xc3\x97" "64 pixels, from a start off by a factor of 2; error: r.m.s. of "
                       "log sigma_t, albedo and g");
    int p, row;
    for (p = 0; p < 3; p++) {
        chart_series *series = NULL;
        panels[p].y.title = titles[p], panels[p].x.title = "processor seconds";
        for (row = 0; row < table->rows; row++) {
            const char *name = chart_cell(table, row, "search");
            if (!cell_is(table, row, "scene", scenes[p])) continue;
            if (!series || strcmp(series->name, name))
                series = chart_begin(&panels[p], name, panels[p].series_count);
            chart_add_spread(&panels[p], series, cell_value(table, row, "seconds"),
                             cell_value(table, row, "off"), cell_value(table, row, "low"),
                             cell_value(table, row, "high"));
            series->spread = CHART_BAND;
        }
    }
    c.width = 1000, c.height = 400, c.legend = panels[0].series_count;
    save_chart(&c, folder, "mitsuba.svg");
}

/* Mean gradients over the true one, with two standard errors each way. */
static void chart_bias(const chart_table *table, chart_panel *panels, const char *folder) {
    static const char *const titles[MATERIAL] = {"by sigma_t", "by albedo", "by g"};
    chart c = chart_of(table, panels, MATERIAL, "The gradient of a loss is biased from one render, "
                       "by 1 / samples, and not from two",
                       "Mean gradient over the true one, with two standard errors: value and "
                       "derivative from the same samples, or from two renders");
    int k, form, row;
    for (k = 0; k < MATERIAL; k++) {
        panels[k].x.title = "samples per pixel", panels[k].y.title = titles[k];
        panels[k].y.logarithmic = 0;
        for (form = 0; form < FORMS; form++) {
            chart_series *series = chart_begin(&panels[k], forms[form], form ? 3 : 4);
            series->spread = CHART_BARS;
            for (row = 0; row < table->rows; row++) {
                double truth = cell_value(table, row, "truth");
                double mean = cell_value(table, row, "gradient") / truth;
                double error = cell_value(table, row, "error") / fabs(truth);
                if (cell_is(table, row, "parameter", material[k]) &&
                    cell_is(table, row, "form", forms[form]))
                    chart_add_spread(&panels[k], series, cell_value(table, row, "spp"), mean,
                                     mean - 2 * error, mean + 2 * error);
            }
        }
    }
    c.width = 900, c.height = 360, c.legend = FORMS;
    save_chart(&c, folder, "bias.svg");
}

/* Adds the rows of a limit, a walk and a quantity. */
static void add_limit(chart_panel *panel, const chart_table *table, const limit *l, int way,
                      const char *quantity, const char *name, int style) {
    chart_series *series = chart_begin(panel, name, style);
    int row;
    series->dashed = series->plain = !way;
    for (row = 0; row < table->rows; row++)
        if (cell_is(table, row, "limit", l->name) && cell_is(table, row, "walk", limit_ways[way]) &&
            cell_is(table, row, "quantity", quantity))
            chart_add(panel, series, cell_value(table, row, "distance"),
                      cell_value(table, row, "relative_error_of_a_second"));
}

/* Quantile of the normal distribution, by bisection. */
static double normal_quantile(double share) {
    double lower = -9, upper = 9;
    while (upper - lower > 1e-9) {
        double middle = .5 * (lower + upper);
        if (.5 * erfc(-middle / sqrt(2)) < share) lower = middle;
        else upper = middle;
    }
    return lower;
}

/* The deviations of all rows of a walk, in their standard errors, against those of a normal
   distribution; what is exact is left out. */
static void add_deviations(chart_panel *panel, const chart_table *table, int way, int style) {
    chart_series *series = chart_begin(panel, limit_ways[way], style);
    double *sigmas = (double *)allocate((size_t)table->rows, sizeof *sigmas);
    int row, count = 0, k;
    for (row = 0; row < table->rows; row++)
        if (cell_is(table, row, "walk", limit_ways[way]) && cell_value(table, row, "error") > 0)
            sigmas[count++] = cell_value(table, row, "sigmas");
    qsort(sigmas, (size_t)count, sizeof *sigmas, compare_doubles);
    for (k = 0; k < CHART_POINTS && count; k++) { /* more of them at the ends */
        double z = -3 + 6. * k / (CHART_POINTS - 1), share = .5 * erfc(-z / sqrt(2));
        int rank = (int)(share * count);
        if (series->count && chart_place(&panel->x, series->x[series->count - 1]) ==
                                 chart_place(&panel->x, normal_quantile((rank + .5) / count)))
            continue;
        chart_add(panel, series, normal_quantile((rank + .5) / count), sigmas[rank]);
    }
    series->dashed = series->plain = !way;
    free(sigmas);
}

static void chart_limits(const chart_table *table, chart_panel *panels, const char *folder) {
    static const char *const x_titles[LIMIT_COUNT] = {
        "albedo", "1 - albedo", "g", "1 - g", "1 + g", "sigma_t \xc3\x97 thickness",
        "sigma_t \xc3\x97 thickness", "scale of the light", "cosine of the sun's zenith distance",
        "alpha", "alpha", "ior - 1", "ior - 1"};
    static const char *const quantities[6] = {"radiance", "m.sigma_t", "m.albedo", "m.g", "s.alpha",
                                              "s.ior"};
    static const char *const names[6] = {"radiance", "its derivative by sigma_t", "albedo", "g",
                                         "alpha", "ior"};
    chart c = chart_of(table, panels, 12, "To the ends of all ranges: finite and unbiased "
                       "everywhere, but in places lost in noise",
                       "Standard error over true value after a second of one core (above 1 the "
                       "value is lost); limits to the right. Last: deviations in standard errors");
    int l, p, q, way;
    for (l = p = 0; l < LIMIT_COUNT; l++) {
        chart_panel *panel = &panels[p];
        if (limits[l].field == LIMIT_SCALE || (limits[l].field == LIMIT_G && limits[l].end == 0))
            continue; /* nothing happens there; the table has them */
        panel->x.title = x_titles[l], panel->y.title = limits[l].name;
        panel->x.reversed = limits[l].end < HUGE_VAL;
        panel->y.fixed = 1, panel->y.lower = 1e-5, panel->y.upper = 100;
        for (way = 1; way >= 0; way--)
            for (q = 0; q < 6; q++)
                add_limit(panel, table, &limits[l], way, quantities[q],
                          way ? names[q] : "dashed: by the reference walk", q);
        p++;
    }
    panels[p].x.title = "expected of normal noise", panels[p].y.title = "deviations from truth";
    panels[p].x.logarithmic = panels[p].y.logarithmic = 0;
    panels[p].x.fixed = panels[p].y.fixed = 1;
    panels[p].x.lower = panels[p].y.lower = -4, panels[p].x.upper = panels[p].y.upper = 4;
    add_deviations(&panels[p], table, 1, 0);
    add_deviations(&panels[p], table, 0, 0);
    c.columns = 4, c.width = 1000, c.height = 740, c.legend = 7;
    save_chart(&c, folder, "limits.svg");
}

static void chart_walk(const chart_table *table, chart_panel *panels, const char *folder) {
    chart_error(table, panels, folder);
    chart_thickness(table, panels, folder);
    chart_triangles(table, panels, folder);
}

static void bench_charts(const char *folder) {
    static const struct {
        const char *table;
        void (*draw)(const chart_table *table, chart_panel *panels, const char *folder);
    } charts[] = {{"walk", chart_walk}, {"gradient", chart_gradient}, {"limits", chart_limits},
                  {"bias", chart_bias}, {"invert", chart_invert},
                  {"mitsuba", chart_mitsuba}};
    chart_panel *panels = (chart_panel *)allocate(MOST_PANELS, sizeof *panels);
    char path[1024], csv[1100];
    size_t k;
    if (!folder) folder = project_path("tests/charts", path, sizeof path);
    for (k = 0; k < sizeof charts / sizeof charts[0]; k++) {
        chart_table table;
        snprintf(csv, sizeof csv, "%s/%s.csv", folder, charts[k].table);
        if (!chart_table_load(csv, &table)) fail(csv, "cannot be read, or is not a table");
        charts[k].draw(&table, panels, folder);
        chart_table_free(&table);
    }
    free(panels);
}

/* ---- command line ---------------------------------------------------------------------------- */

static void sweep_command(int argc, char **argv,
                          void (*sweep)(const char *csv, const char *mesh, int quick)) {
    const char *csv = NULL, *mesh = NULL;
    int i, quick = 0;
    for (i = 2; i < argc; i++) {
        if (!strcmp(argv[i], "--quick")) quick = 1;
        else if (!strcmp(argv[i], "--csv") && i + 1 < argc) csv = argv[++i];
        else if (!strcmp(argv[i], "--mesh") && i + 1 < argc) mesh = argv[++i];
        else fail(argv[i], "unknown option, or its value is missing");
    }
    sweep(csv, mesh, quick);
}

int main(int argc, char **argv) {
    const char *command = argc > 1 ? argv[1] : "";
    program = argv[0];
    if (!strcmp(command, "rays") && argc == 3) bench_rays(argv[2]);
    else if (!strcmp(command, "cnn") && argc == 3 && atoi(argv[2]) > 0)
        bench_cnn(atoi(argv[2]));
    else if (!strcmp(command, "cnn") && argc == 2) bench_cnn_released();
    else if (!strcmp(command, "texels") && argc == 2) bench_texels();
    else if (!strcmp(command, "walk")) sweep_command(argc, argv, bench_walk);
    else if (!strcmp(command, "gradient")) sweep_command(argc, argv, bench_gradient);
    else if (!strcmp(command, "bias")) sweep_command(argc, argv, bench_bias);
    else if (!strcmp(command, "limits")) sweep_command(argc, argv, bench_limits);
    else if (!strcmp(command, "invert")) sweep_command(argc, argv, bench_invert);
    else if (!strcmp(command, "charts") && argc <= 3) bench_charts(argc == 3 ? argv[2] : NULL);
    else return fprintf(stderr, "%s", usage), 2;
    return 0;
}
