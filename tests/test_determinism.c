/* The same bits for any number of threads, any parallel_for, with or without somebody watching; and
   other bits for another seed, pixel or sample. */
#define ITN_THREADS
#ifndef ITN_APART
#define ITN_IMPLEMENTATION
#endif
#include "../itn.h"

#include <pthread.h>

#include "accountant.h"
#include "check.h"
#include "solids.h"
#include "stage.h"

enum { SIZE = 13, PIXELS = SIZE * SIZE, COUNT = 5 };

/* ---- ways to run a loop --------------------------------------------------------------------------- */

static void run_reversed(int count, void (*body)(void *, int), void *task, void *user) {
    (void)user;
    while (count-- > 0) body(task, count);
}

/* In the order of multiples of a number that has no factor in common with the count. */
static void run_shuffled(int count, void (*body)(void *, int), void *task, void *user) {
    int stride = 7, i, calls = *(int *)user;
    while (count % stride == 0) stride += 4;
    for (i = 0; i < count; i++) body(task, (int)(((long long)i * stride + 3) % count));
    *(int *)user = calls + 1;
}

/* A wrong hook: leaves out the loop, as what one index leaves out others may do. */
static void run_short(int count, void (*body)(void *, int), void *task, void *user) {
    (void)count, (void)body, (void)task, (void)user;
}

/* ---- scenes ------------------------------------------------------------------------------------------ */

static const char *const parameter_names[3][COUNT] = {
    {"m.sigma_t", "m.g", "m.albedo_g", "floor.reflectance_r", "map.scale"},
    {"m.sigma_t", "glass.ior", "glass.alpha", "sky.scale", "sky.sun_scale"},
    {"m.sigma_t", "m.albedo", "m.g", "floor.reflectance", "light.scale"}};

/* 0: a cloud over a floor in a map, RGB; 1: milk in rough glass under a sky; 2: milk in smooth
   glass, Gaussian film. */
static itn_scene *make_scene(int which, const itn_context *context) {
    itn_mesh mesh = solids_sphere(1, 1);
    itn_image map = stage_patch(3, .6, .3, 8);
    stage s;
    itn_scene *scene = NULL;
    itn_error error;
    stage_begin(&s, SIZE, 4, 35);
    s.desc.film.channels = which == 0 ? 3 : 1;
    s.desc.film.filter = which == 2 ? ITN_FILTER_GAUSSIAN : ITN_FILTER_BOX;
    stage_medium(&s, "m", 3, .9, .5);
    stage_diffuse(&s, "floor", .6);
    stage_dielectric(&s, "glass", 1.4, which == 1 ? .2 : 0);
    stage_object(&s, NULL, NULL, "floor");
    stage_object(&s, &mesh, "m", which ? "glass" : NULL);
    if (which == 0) stage_map(&s, "map", &map);
    if (which == 1) stage_sky(&s, "sky");
    if (which == 2) stage_constant(&s, NULL, 1);
    stage_need(itn_scene_create(&s.desc, context, &scene, &error), &error);
    itn_image_free(&map);
    itn_mesh_free(&mesh);
    return scene;
}

/* ---- results --------------------------------------------------------------------------------------- */

typedef struct outcome {
    itn_image image, plain; /* with and without derivatives */
    double gradient[COUNT], variance[COUNT], loss, loss_gradient[COUNT];
    float theta[64];
    itn_estimate estimates[2];
    itn_render_stats stats;
} outcome;

static int count_progress(void *user, double fraction) {
    int *calls = (int *)user;
    CHECK(fraction >= 0 && fraction <= 1); /* 0: before pixels, while V is learnt */
    ++*calls;
    return 0;
}

static int watch_refine(void *user, const itn_refine_step *step) {
    CHECK(step->theta != NULL && step->iteration >= 0);
    *(int *)user += step->fraction == 1;
    return 0;
}

/* Everything the library can compute from a scene, in one bag. */
static void compute(int which, const itn_context *context, uint64_t seed, int watched,
                    outcome *out) {
    itn_scene *scene = make_scene(which, context);
    itn_render_options options = ITN_ZERO;
    itn_refine_options refine = ITN_ZERO;
    static float target[3 * PIXELS];
    itn_error error;
    int parameters[COUNT], k, i, calls = 0, channels = itn_scene_film(scene).channels;
    memset(out, 0, sizeof *out);
    for (i = 0; i < channels * PIXELS; i++) target[i] = .3f + .1f * (float)(i % 5);
    for (k = 0; k < COUNT; k++)
        parameters[k] = itn_parameter_find(scene, parameter_names[which][k]);
    options.spp = 8, options.seed = seed;
    options.stats = &out->stats;
    if (watched) options.progress = count_progress, options.progress_user = &calls;
    stage_need(itn_render(scene, NULL, &options, NULL, 0, &out->plain, &error), &error);
    stage_need(itn_render(scene, NULL, &options, parameters, COUNT, &out->image, &error), &error);
    stage_need(itn_render_gradient(scene, NULL, &options, target, parameters, COUNT, out->gradient,
                                   out->variance, &error), &error);
    stage_need(itn_loss_gradient(scene, NULL, &options, target, parameters, COUNT, &out->loss,
                                 out->loss_gradient, &error), &error);
    if (watched) CHECK(calls >= 4);
    itn_parameter_values(scene, out->theta);
    refine.spp = 4, refine.iterations = 3, refine.seed = seed;
    calls = 0;
    if (watched) refine.progress = watch_refine, refine.progress_user = &calls;
    stage_need(itn_refine(scene, out->theta, target, parameters, 2, &refine, out->estimates,
                          &error), &error);
    if (watched) CHECK(calls >= 1);
    itn_scene_free(scene);
}

static void release(outcome *out) { itn_image_free(&out->image), itn_image_free(&out->plain); }

static int same_image(const itn_image *a, const itn_image *b) {
    size_t pixels = (size_t)a->width * (size_t)a->height * (size_t)a->plane_count;
    return a->width == b->width && a->height == b->height && a->plane_count == b->plane_count &&
           !memcmp(a->pixels, b->pixels, pixels * sizeof(float)) &&
           !memcmp(a->names, b->names, (size_t)a->plane_count * ITN_NAME_SIZE);
}

static void check_same(const outcome *a, const outcome *b) {
    CHECK(same_image(&a->plain, &b->plain));
    CHECK(same_image(&a->image, &b->image));
    CHECK(!memcmp(a->gradient, b->gradient, sizeof a->gradient));
    CHECK(!memcmp(a->variance, b->variance, sizeof a->variance));
    CHECK(!memcmp(&a->loss, &b->loss, sizeof a->loss));
    CHECK(!memcmp(a->loss_gradient, b->loss_gradient, sizeof a->loss_gradient));
    CHECK(!memcmp(a->theta, b->theta, sizeof a->theta));
    CHECK(a->estimates[0].value == b->estimates[0].value &&
          a->estimates[0].standard_error == b->estimates[0].standard_error &&
          a->estimates[1].standard_error == b->estimates[1].standard_error &&
          a->estimates[1].determined == b->estimates[1].determined);
    CHECK(a->stats.paths == b->stats.paths && a->stats.collisions == b->stats.collisions);
}

/* The loop in all ways against one thread. */
static void test_threads(int which) {
    outcome one, other;
    itn_context context = ITN_ZERO;
    int calls = 0;
    context.threads = 1;
    compute(which, &context, 3, 0, &one);
    context.threads = 2;
    compute(which, &context, 3, 0, &other);
    check_same(&one, &other), release(&other);
    context.threads = 7;
    compute(which, &context, 3, 1, &other); /* watched as well */
    check_same(&one, &other), release(&other);
    context.threads = 1, context.parallel_for = run_reversed;
    compute(which, &context, 3, 1, &other);
    check_same(&one, &other), release(&other);
    context.parallel_for = run_shuffled, context.parallel_user = &calls;
    compute(which, &context, 3, 0, &other);
    check_same(&one, &other), release(&other);
    CHECK(calls > 4); /* the hook was really used */
    compute(which, NULL, 3, 1, &other); /* all processors */
    check_same(&one, &other), release(&other);
    release(&one);
}

/* Planted: a hook that leaves work undone. */
static void plant_short_loop(void) {
    outcome one, other;
    itn_context context = ITN_ZERO;
    context.threads = 1;
    compute(2, &context, 3, 0, &one);
    context.parallel_for = run_short;
    compute(2, &context, 3, 0, &other);
    check_same(&one, &other);
    release(&one), release(&other);
}

/* Planted: another seed. */
static void plant_seed(void) {
    outcome one, other;
    compute(2, NULL, 3, 0, &one);
    compute(2, NULL, 4, 0, &other);
    check_same(&one, &other);
    release(&one), release(&other);
}

/* ---- seeds ------------------------------------------------------------------------------------------ */

/* Renders of different seeds are different and uncorrelated, also when the seeds differ in one bit
   high or low, and so are the pixels of a flat picture. */
static void test_seeds(void) {
    static const uint64_t seeds[] = {0, 1, 2, 3, 1ull << 31, 1ull << 32, 1ull << 63, ~0ull};
    enum { SEEDS = 8 };
    itn_scene *scene = make_scene(2, NULL);
    itn_image image[SEEDS];
    itn_render_options options = ITN_ZERO;
    itn_error error;
    int a, b, i;
    options.spp = 4;
    for (a = 0; a < SEEDS; a++) {
        options.seed = seeds[a];
        stage_need(itn_render(scene, NULL, &options, NULL, 0, &image[a], &error), &error);
    }
    for (a = 0; a < SEEDS; a++)
        for (b = 0; b < a; b++) {
            double xy = 0, xx = 0, yy = 0;
            int equal = 0;
            for (i = 0; i < PIXELS; i++) { /* residuals against the mean of the other seeds */
                double mean = 0, x, y;
                int s;
                for (s = 0; s < SEEDS; s++)
                    if (s != a && s != b) mean += image[s].pixels[i] / (SEEDS - 2.);
                x = image[a].pixels[i] - mean, y = image[b].pixels[i] - mean;
                xy += x * y, xx += x * x, yy += y * y;
                equal += image[a].pixels[i] == image[b].pixels[i];
            }
            /* the shared mean correlates x and y by 1/(SEEDS - 1); 5 sigma of PIXELS samples */
            CHECK_NEAR(xy / sqrt(xx * yy), 1. / (SEEDS - 1), 5 / sqrt(PIXELS));
            CHECK(equal < PIXELS / 2);
        }
    for (a = 0; a < SEEDS; a++) itn_image_free(&image[a]);
    itn_scene_free(scene);
}

/* ---- derivatives on and off ------------------------------------------------------------------------- */

/* Derivatives ride along with the reference: its image has the same bits without them, for all parameters but
   two kinds. For sigma_t the value is multiplied by f / p, which rounds, where the medium is thick
   enough that collisions need not be drawn more often than they happen (sigma_t > .25 / radius of
   the solids); where it is not, and for the ior of a rough surface, other paths are drawn, and the
   image is the same within its noise. */
static void test_with_and_without(void) {
    int which, i, k;
    for (which = 0; which < 3; which++) {
        itn_scene *scene = make_scene(which, NULL);
        int channels = itn_scene_film(scene).channels, parameters[COUNT], count = 0;
        int pixels = channels * PIXELS, sigma_t = itn_parameter_find(scene, "m.sigma_t"), ior;
        itn_render_options options = ITN_ZERO;
        itn_image plain = ITN_ZERO, with = ITN_ZERO;
        itn_error error;
        size_t bytes = (size_t)(2 * pixels) * sizeof(float);
        ior = which == 1 ? itn_parameter_find(scene, "glass.ior") : -1;
        options.spp = 16, options.seed = 11, options.mode = ITN_MODE_REFERENCE;
        for (k = 0; k < COUNT; k++) {
            int index = itn_parameter_find(scene, parameter_names[which][k]);
            if (index != sigma_t && index != ior) parameters[count++] = index;
        }
        stage_need(itn_render(scene, NULL, &options, NULL, 0, &plain, &error), &error);
        stage_need(itn_render(scene, NULL, &options, parameters, count, &with, &error), &error);
        CHECK(count >= 3 && !memcmp(plain.pixels, with.pixels, bytes)); /* mean and variance */
        itn_image_free(&with);
        parameters[count++] = sigma_t;
        stage_need(itn_render(scene, NULL, &options, parameters, count, &with, &error), &error);
        for (i = 0; i < pixels; i++)
            if (!CHECK_NEAR(with.pixels[i], plain.pixels[i], 1e-5 * fabs(plain.pixels[i]))) break;
        itn_image_free(&with);
        if (ior >= 0) {
            solids_mean a, b;
            stage_need(itn_render(scene, NULL, &options, &ior, 1, &with, &error), &error);
            a = solids_plane_mean(&plain, "Y", "Variance.Y");
            b = solids_plane_mean(&with, "Y", "Variance.Y");
            CHECK_MEAN(a.value - b.value, hypot(a.error, b.error), 0, 4.5, .1 * a.value);
            itn_image_free(&with);
        }
        itn_image_free(&plain);
        itn_scene_free(scene);
    }
}

/* A parameter's derivative is the same alone and in company, in any order. */
static void test_company(void) {
    itn_scene *scene = make_scene(1, NULL);
    itn_render_options options = ITN_ZERO;
    itn_image all = ITN_ZERO, one = ITN_ZERO;
    itn_error error;
    int parameters[COUNT], reversed[COUNT], k;
    options.spp = 8;
    for (k = 0; k < COUNT; k++)
        reversed[COUNT - 1 - k] = parameters[k] = itn_parameter_find(scene, parameter_names[1][k]);
    stage_need(itn_render(scene, NULL, &options, parameters, COUNT, &all, &error), &error);
    stage_need(itn_render(scene, NULL, &options, reversed, COUNT, &one, &error), &error);
    for (k = 0; k < all.plane_count; k++) {
        const float *plane = itn_image_plane(&one, all.names[k]);
        CHECK(plane && !memcmp(plane, all.pixels + (size_t)k * PIXELS, PIXELS * sizeof(float)));
    }
    itn_image_free(&one), itn_image_free(&all);
    itn_scene_free(scene);
}

/* Two scenes of the same desc, and a render after other renders, are the same. */
static void test_history(void) {
    itn_scene *first = make_scene(0, NULL), *second = make_scene(0, NULL);
    itn_render_options options = ITN_ZERO;
    itn_image a = ITN_ZERO, b = ITN_ZERO, c = ITN_ZERO;
    itn_error error;
    options.spp = 4;
    stage_need(itn_render(first, NULL, &options, NULL, 0, &a, &error), &error);
    options.seed = 9;
    stage_need(itn_render(second, NULL, &options, NULL, 0, &c, &error), &error);
    options.seed = 0;
    stage_need(itn_render(second, NULL, &options, NULL, 0, &b, &error), &error);
    CHECK(same_image(&a, &b));
    CHECK(!same_image(&a, &c));
    itn_image_free(&a), itn_image_free(&b), itn_image_free(&c);
    itn_scene_free(first), itn_scene_free(second);
}

/* ---- memory between renders -------------------------------------------------------------------- */

typedef struct small_loss {
    const itn_scene *scene;
    int parameters[COUNT], fails; /* fails: results that were not the first one's */
    float target[3 * PIXELS];
    double loss, gradient[COUNT];
} small_loss;

static void small_loss_once(const small_loss *s, int spp, double *loss, double *gradient) {
    itn_render_options options = ITN_ZERO;
    itn_error error;
    options.spp = spp;
    stage_need(itn_loss_gradient(s->scene, NULL, &options, s->target, s->parameters, COUNT, loss,
                                 gradient, &error), &error);
}
static void *small_losses(void *of) {
    small_loss *s = (small_loss *)of;
    double loss, gradient[COUNT];
    int k;
    for (k = 0; k < 24; k++) {
        small_loss_once(s, k % 3 ? 4 : 4 + k, &loss, gradient); /* now and then a larger one */
        if (k % 3) s->fails += loss != s->loss || memcmp(gradient, s->gradient, sizeof gradient);
    }
    return NULL;
}
static small_loss small_loss_make(const itn_scene *scene) {
    small_loss s = ITN_ZERO;
    int k;
    s.scene = scene;
    for (k = 0; k < COUNT; k++) s.parameters[k] = itn_parameter_find(scene, parameter_names[2][k]);
    for (k = 0; k < PIXELS; k++) s.target[k] = .3f;
    small_loss_once(&s, 4, &s.loss, s.gradient);
    return s;
}

/* A scene's memory goes from render to render: the second asks for none, nor do renders of two kinds
   in turn, once each has been there. What is large is given back, and so is what a render had that
   failed. */
static void test_kept_memory(void) {
    accountant a = ITN_ZERO;
    itn_context context = count_context(&a);
    itn_scene *scene = make_scene(2, &context);
    itn_render_options options = ITN_ZERO;
    itn_image image = ITN_ZERO;
    itn_error error;
    small_loss s = small_loss_make(scene);
    double loss, gradient[COUNT];
    long live = a.live;
    int k;
    a.calls = 0;
    small_loss_once(&s, 4, &loss, gradient);
    CHECK(a.calls == 0 && a.live == live && loss == s.loss);
    options.spp = 2;
    for (k = 0; k < 2; k++) {
        a.largest = 0;
        stage_need(itn_render(scene, NULL, &options, NULL, 0, &image, &error), &error);
        CHECK(k == 0 || a.largest <= image.plane_count * PIXELS * 4);
        itn_image_free(&image);
        a.calls = 0;
        small_loss_once(&s, 4, &loss, gradient);
        if (k == 0) live = a.live;
        CHECK((k == 0 || (a.calls == 0 && a.live == live)) && loss == s.loss);
    }
    itn_scene_free(scene);
    CHECK(a.live == 0);
}

/* A render too large for its memory to be kept: 16 bytes for each pixel and plane. */
static void test_large_memory(int size) {
    accountant a = ITN_ZERO;
    itn_context context = count_context(&a);
    itn_render_options options = ITN_ZERO;
    itn_image image = ITN_ZERO;
    itn_scene *scene = NULL;
    itn_error error;
    stage s;
    long live;
    context.threads = 1;
    stage_begin(&s, size, 4, 35);
    stage_diffuse(&s, "floor", .6);
    stage_object(&s, NULL, NULL, "floor");
    stage_constant(&s, NULL, 1);
    stage_need(itn_scene_create(&s.desc, &context, &scene, &error), &error);
    stage_need(itn_scene_prepare(scene, NULL, NULL, &error), &error);
    options.spp = 1;
    stage_give_back(scene), live = a.live; /* of which no render has any */
    stage_need(itn_render(scene, NULL, &options, NULL, 0, &image, &error), &error);
    itn_image_free(&image);
    CHECK(a.live == live);
    itn_scene_free(scene);
    CHECK(a.live == 0);
}

/* Renders of one scene at once, each with memory of its own. */
static void test_renders_at_once(void) {
    itn_context context = ITN_ZERO;
    itn_scene *scene;
    small_loss s[4];
    pthread_t threads[4];
    int k;
    context.threads = 2;
    scene = make_scene(2, &context);
    s[0] = small_loss_make(scene);
    for (k = 1; k < 4; k++) s[k] = s[0];
    for (k = 0; k < 4; k++) CHECK(!pthread_create(&threads[k], NULL, small_losses, &s[k]));
    for (k = 0; k < 4; k++) {
        CHECK(!pthread_join(threads[k], NULL));
        CHECK(s[k].fails == 0);
    }
    itn_scene_free(scene);
}

int main(void) {
    test_kept_memory();
    test_large_memory(600);
    CHECK_CATCHES(test_large_memory(60));
    test_renders_at_once();
    test_threads(0);
    test_threads(1);
    test_threads(2);
    test_seeds();
    test_with_and_without();
    test_company();
    test_history();
    CHECK_CATCHES(plant_short_loop());
    CHECK_CATCHES(plant_seed());
    return check_end("determinism");
}
