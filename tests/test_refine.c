/* Refinement on small pictures: it finds what was hidden, its error bars tell the truth, and it says
   so when a picture does not tell. */
#define ITN_IMPLEMENTATION
#include "../itn.h"

#include "check.h"
#include "solids.h"
#include "stage.h"

enum { SIZE = 12, PIXELS = SIZE * SIZE };

/* A cloud (sphere of radius 1, index-matched) in a map with a bright patch at u: what every test here
   refines. */
static itn_scene *cloud_in(int channels, int size, double u, double strength, double sigma_t,
                           double albedo, double g) {
    itn_mesh mesh = solids_sphere(1, 2);
    itn_image map = stage_patch(1, u, .35, 4);
    stage s;
    itn_scene *scene;
    stage_begin(&s, size, 4, 32);
    s.desc.film.channels = channels;
    stage_medium(&s, "m", sigma_t, albedo, g);
    stage_object(&s, &mesh, "m", NULL);
    stage_map(&s, NULL, &map)->scale = (float)strength;
    scene = stage_make(&s);
    itn_image_free(&map);
    itn_mesh_free(&mesh);
    return scene;
}

static itn_scene *lit_cloud(int size, double u, double strength, double sigma_t, double albedo,
                            double g) {
    return cloud_in(1, size, u, strength, sigma_t, albedo, g);
}

static itn_scene *cloud(double sigma_t, double albedo, double g) {
    return lit_cloud(SIZE, .65, 1, sigma_t, albedo, g);
}

/* A picture of a scene and its variances. */
static void photograph(const itn_scene *scene, int spp, uint64_t seed, float *target,
                       float *variance) {
    itn_render_options options = ITN_ZERO;
    itn_image image = ITN_ZERO;
    itn_error error;
    size_t pixels;
    options.spp = spp, options.seed = seed;
    stage_need(itn_render(scene, NULL, &options, NULL, 0, &image, &error), &error);
    pixels = (size_t)image.width * (size_t)image.height * (size_t)(image.plane_count / 2);
    memcpy(target, image.pixels, pixels * sizeof(float));
    memcpy(variance, image.pixels + pixels, pixels * sizeof(float));
    itn_image_free(&image);
}

static void find_parameters(const itn_scene *scene, const char *const *names, int count,
                            int *parameters) {
    int k;
    for (k = 0; k < count; k++) parameters[k] = itn_parameter_find(scene, names[k]);
}

/* A number in [0, 1) of a case. */
static double drawn(int which, int number) {
    return (double)(itn__mix64((uint64_t)(1000 * (which + 1) + number)) >> 11) / 9007199254740992.;
}

/* Nearly normal, of variance 1: a sum of twelve. */
static double drawn_normal(int which, int number) {
    double sum = -6;
    int k;
    for (k = 0; k < 12; k++) sum += drawn(which, 12 * number + k);
    return sum;
}

/* ---- pieces ------------------------------------------------------------------------------------------ */

#ifndef ITN_NO_FAST /* it is of the fast walk */
static void test_elimination(double planted) {
    /* A and A (1, 2, 3) */
    double a[12] = {4, 2, -2, 4 + 4 - 6, 2, 10, 2, 2 + 20 + 6, -2, 2, 5, -2 + 4 + 15};
    double hilbert[42], one[2] = {9, 27};
    double indefinite[4] = {1, 2, 2, 1}, singular[4] = {1, 1, 1, 1}, bad[1] = {NAN}, zero[1] = {0};
    int i, j;
    CHECK(itn__eliminate(a, 3, 4));
    CHECK_NEAR(a[3], 1 + planted, 1e-14), CHECK_NEAR(a[7], 2, 1e-14), CHECK_NEAR(a[11], 3, 1e-14);
    CHECK(itn__eliminate(one, 1, 2) && one[1] == 3);
    CHECK(!itn__eliminate(indefinite, 2, 2));
    CHECK(!itn__eliminate(singular, 2, 2));
    CHECK(!itn__eliminate(zero, 1, 1));
    CHECK(!itn__eliminate(bad, 1, 1));
    for (i = 0; i < 6; i++) {
        hilbert[7 * i + 6] = 0;
        for (j = 0; j < 6; j++) {
            hilbert[7 * i + j] = 1. / (i + j + 1);
            hilbert[7 * i + 6] += hilbert[7 * i + j] * (j + 1);
        }
    }
    CHECK(itn__eliminate(hilbert, 6, 7));
    for (i = 0; i < 6; i++) CHECK_NEAR(hilbert[7 * i + 6], i + 1, 1e-7); /* condition 1.5e7 */
}
#endif

/* Coordinates go there and back, and their slope is the derivative. */
static void test_transforms(void) {
    itn_scene *scene = cloud(1, .5, .2);
    static const char *const names[] = {"m.sigma_t", "m.albedo", "m.g", "light.scale"};
    static const double values[4][5] = {{1e-3, .1, 1, 30, 1e6},
                                        {1e-4, .1, .5, .9, .9999},
                                        {-.99, -.5, 0, .5, .99},
                                        {1e-3, .1, 1, 30, 1e6}};
    int k, i;
    for (k = 0; k < 4; k++) {
        const itn_parameter *p = itn_parameter_get(scene, itn_parameter_find(scene, names[k]));
        for (i = 0; i < 5; i++) {
            double v = values[k][i], c = itn_parameter_to_coordinate(p, v), h = 1e-5;
            double up = itn_parameter_from_coordinate(p, c + h);
            double down = itn_parameter_from_coordinate(p, c - h);
            CHECK_NEAR(itn_parameter_from_coordinate(p, c), v, 1e-12 * fabs(v) + 1e-13);
            CHECK_NEAR((up - down) / (2 * h), itn_parameter_slope(p, v),
                       1e-6 * itn_parameter_slope(p, v));
        }
        /* bounds and beyond: all finite, never outside */
        for (i = -1; i <= 1; i += 2) {
            double bound = i < 0 ? p->lower : p->upper, c = itn_parameter_to_coordinate(p, bound);
            CHECK(itn__finite(c) && itn__finite(itn_parameter_slope(p, bound)));
            CHECK(itn_parameter_slope(p, bound) > 0);
            CHECK(itn_parameter_from_coordinate(p, i * 1e300) >= p->lower);
            CHECK(itn_parameter_from_coordinate(p, i * 1e300) <= p->upper);
            CHECK_NEAR(itn_parameter_from_coordinate(p, c), bound,
                       p->transform == ITN_LOG ? 2e-14 * p->upper
                                               : 2e-7 * (p->upper - p->lower));
        }
    }
    itn_scene_free(scene);
}

/* A search for these unknowns of a scene of one view, in which nothing has been evaluated. */
static void begin_search(itn__refiner *refiner, const itn_view *view, int count,
                         const float *values, int spp) {
    itn_error error;
    memset(refiner, 0, sizeof *refiner);
    refiner->view_count = 1, refiner->count = count;
    refiner->options.spp = refiner->final = spp, refiner->options.seconds = 1e300;
    stage_need(itn__refine_begin(refiner, view, values, &error), &error);
    itn__focus(refiner, 1);
}

static void end_search(itn__refiner *refiner) {
    const itn_context *context = &refiner->views->scene->context;
    itn__free(context, refiner->views->theta);
    itn__free(context, refiner->turn);
    itn__free(context, refiner->views);
}

/* The largest numbers of samples that are taken can be rendered, too, and a search of them ends by
   its time, not with a complaint of its last render. beyond: planted, more of them. */
static void test_most_samples(int beyond) {
    static const char *const albedo[] = {"m.albedo"};
    static float target[PIXELS], variance[PIXELS];
    itn_scene *scene = cloud(2, .8, .4);
    itn_render_options wanted = ITN_ZERO;
    itn_refine_options options = ITN_ZERO;
    itn_refine_outcome outcome;
    itn_estimate estimate;
    itn_error error;
    float theta[8];
    int parameter, way;
    for (way = 0; way < 2; way++) { /* of one search; what patience makes of the most at first */
        wanted.spp = way ? ITN__PATIENCE * ITN__FINAL * ITN__MOST_SPP
                     : beyond ? INT_MAX : ITN__MOST_FINAL;
        CHECK(itn_scene_prepare(scene, NULL, &wanted, &error) == ITN_OK);
    }
    photograph(scene, 64, 3, target, variance);
    find_parameters(scene, albedo, 1, &parameter);
    itn_parameter_values(scene, theta);
    options.spp = 8, options.final_spp = ITN__MOST_FINAL, options.seconds = .3;
    options.target_variance = variance, options.outcome = &outcome;
    stage_need(itn_refine(scene, theta, target, &parameter, 1, &options, &estimate, &error),
               &error);
    CHECK_NEAR(estimate.value, .8, 4.5 * estimate.standard_error);
    if (getenv("SHOW"))
        printf("most samples: %g +- %g, %g s\n", estimate.value, estimate.standard_error,
               outcome.seconds);
    itn_scene_free(scene);
}

/* A step past the bound of sigma_t ends on it, in similarity coordinates, too: a search that took
   itself for further would have to come back all the way. One within bounds keeps its bits.
   past: of ln sigma_t; expected: what stays of that. */
static void test_held(double past, double expected) {
    static const char *const names[] = {"m.sigma_t", "m.albedo", "m.g"};
    static const float values[3] = {2, .8f, .4f};
    static float target[PIXELS];
    itn_scene *scene = cloud(2, .8, .4);
    double start[3], wanted[3], reached[3];
    int parameters[3], k;
    itn_view view = ITN_ZERO;
    itn__refiner refiner;
    find_parameters(scene, names, 3, parameters);
    target[0] = 1;
    view.scene = scene, view.target = target, view.parameters = parameters;
    begin_search(&refiner, &view, 3, values, 4);
    CHECK(refiner.g[0].medium && refiner.g[0].unknown[0] == 2 && refiner.g[1].unknown[0] == 2 &&
          !refiner.g[2].medium);
    for (k = 0; k < 3; k++)
        wanted[k] = itn_parameter_to_coordinate(refiner.parameters[k], (double)values[k]);
    wanted[0] = log((double)refiner.parameters[0]->upper);
    memcpy(start, wanted, sizeof start);
    start[0] += past, wanted[0] += expected;
    itn__along_valley(&refiner, start, 1);
    itn__refine_set(&refiner, start);
    if (past == expected) CHECK(!memcmp(refiner.coordinates, start, sizeof start));
    memcpy(reached, refiner.coordinates, sizeof reached);
    itn__along_valley(&refiner, reached, -1);
    for (k = 0; k < 3; k++) CHECK_NEAR(reached[k], wanted[k], 1e-9);
    CHECK(refiner.values[0] <= refiner.parameters[0]->upper);
    end_search(&refiner);
    itn_scene_free(scene);
}

/* The values at coordinates, which become transformed ones. */
static void values_at(const itn__refiner *refiner, double *coordinates, double *values) {
    int k;
    itn__along_valley(refiner, coordinates, -1);
    for (k = 0; k < refiner->count; k++)
        values[k] = itn_parameter_from_coordinate(refiner->parameters[k], coordinates[k]);
}

/* Similarity coordinates of a medium with three albedos: there and back; what stays along the
   valley; and derivative images are those by the coordinates. planted: a wrong slope. */
static void test_similarity(double planted) {
    enum { N = 5 }; /* sigma_t, albedos, g */
    static const char *const names[] = {"m.sigma_t", "m.albedo_r", "m.albedo_g", "m.albedo_b",
                                        "m.g"};
    static const float values[N] = {3, .7f, .9f, .35f, .6f};
    static float target[3 * PIXELS];
    itn_scene *scene = cloud_in(3, SIZE, .65, 1, 2, .8, .4);
    double turned[N], up[N], down[N], h = 1e-6;
    int parameters[N], k, l, i;
    itn_image image = ITN_ZERO;
    itn_view view = ITN_ZERO;
    itn__refiner refiner;
    itn_error error;
    find_parameters(scene, names, N, parameters);
    target[0] = 1;
    view.scene = scene, view.target = target, view.parameters = parameters;
    begin_search(&refiner, &view, N, values, 4);
    for (k = 0; k < N; k++)
        CHECK(k < 4 ? refiner.g[k].unknown[0] == 4 : !refiner.g[k].medium);
    memcpy(turned, refiner.coordinates, sizeof turned);
    itn__along_valley(&refiner, turned, -1);
    for (k = 0; k < N; k++) {
        double plain = itn_parameter_to_coordinate(refiner.parameters[k], (double)values[k]);
        CHECK_NEAR(turned[k], plain, 1e-12 * (1 + fabs(plain)));
    }
    for (k = 0; k < N; k++) { /* column k of G: what a step in coordinate k changes */
        memcpy(turned, refiner.coordinates, sizeof turned);
        turned[k] += h, values_at(&refiner, turned, up);
        memcpy(turned, refiner.coordinates, sizeof turned);
        turned[k] -= h, values_at(&refiner, turned, down);
        for (l = 0; l < N; l++)
            CHECK_NEAR(refiner.turn[l * N + k], (up[l] - down[l]) / (2 * h) + planted, 1e-6);
    }
    stage_need(itn_render(scene, refiner.views->theta, NULL, parameters, N, &image, &error), &error);
    itn__take_in(&refiner, refiner.views, &image, 0);
    for (k = 0; k < N; k++)
        for (i = 0; i < 3 * PIXELS; i++) {
            double sum = 0, size = 1e-6;
            for (l = 0; l < N; l++) {
                double part = refiner.turn[l * N + k] * image.pixels[(2 + 2 * l) * 3 * PIXELS + i];
                sum += part, size += fabs(part);
            }
            CHECK_NEAR(refiner.views->fresh[0][(2 + k) * 3 * PIXELS + i], sum, 1e-5 * size);
        }
    itn_image_free(&image);
    for (i = -2; i <= 2; i++) {
        double there[N], v[N], start[N];
        memcpy(there, refiner.coordinates, sizeof there);
        memcpy(start, there, sizeof start);
        there[4] += i;
        values_at(&refiner, start, down), values_at(&refiner, there, v);
        CHECK_NEAR(v[0] * (1 - v[4]), down[0] * (1 - down[4]), 1e-6);
        for (k = 1; k < 4; k++)
            CHECK_NEAR(v[k] / (1 - v[k]) * (1 - v[4]), down[k] / (1 - down[k]) * (1 - down[4]),
                       1e-6);
    }
    end_search(&refiner);
    itn_scene_free(scene);
}

/* The same of a mixture, of which one lobe is known: G is that of the coordinates, and along the
   valley sigma_t (1 - g) stays, g being the mean cosine. planted: a wrong slope. */
static void test_similar_lobes(double planted) {
    enum { N = 4 };
    static const char *const names[N] = {"m.sigma_t", "m.albedo", "m.weight1", "m.kappa2"};
    static const float values[N] = {3, .7f, .4f, 5};
    static float target[PIXELS];
    double there[N], v[2][N], h = 1e-6;
    int parameters[N], k, l;
    itn_view view = ITN_ZERO;
    itn__refiner refiner;
    stage s;
    stage_begin(&s, SIZE, 3, 40);
    itn_mesh mesh = solids_sphere(1, 1);
    itn_medium_desc *medium = stage_medium(&s, "m", 3, .7, 0);
    medium->phase = ITN_PHASE_MIX, medium->lobe_count = 2;
    medium->lobes[0].shape = -.4f, medium->lobes[0].weight = medium->lobes[1].weight = .5f;
    medium->lobes[1].phase = ITN_PHASE_VMF, medium->lobes[1].shape = 2;
    stage_object(&s, &mesh, "m", NULL), stage_constant(&s, "light", 1);
    itn_scene *scene = stage_make(&s);
    find_parameters(scene, names, N, parameters);
    target[0] = 1, view.scene = scene, view.target = target, view.parameters = parameters;
    begin_search(&refiner, &view, N, values, 4);
    for (k = 0; k < N; k++) {
        for (int side = 0; side < 2; side++) {
            memcpy(there, refiner.coordinates, sizeof there);
            there[k] += side ? -h : h, values_at(&refiner, there, v[side]);
        }
        for (l = 0; l < N; l++)
            CHECK_NEAR(refiner.turn[l * N + k], (v[0][l] - v[1][l]) / (2 * h) + planted, 1e-6);
    }
    memcpy(there, refiner.coordinates, sizeof there);
    there[2] += .3, there[3] -= .5, values_at(&refiner, there, v[0]);
    double g = -.4 * v[0][2] + (1 - v[0][2]) * (1 / tanh(v[0][3]) - 1 / v[0][3]);
    double was = -.4 * .4 + .6 * (1 / tanh(5.) - .2);
    CHECK_NEAR(v[0][0] * (1 - g), 3 * (1 - was), 1e-6);
    CHECK_NEAR(v[0][1] / (1 - v[0][1]) * (1 - g), 7 / 3. * (1 - was), 1e-6);
    end_search(&refiner);
    itn_scene_free(scene), itn_mesh_free(&mesh);
}

/* ---- recovery ---------------------------------------------------------------------------------------- */

typedef struct watch {
    const itn_scene *scene;
    int calls, outside, last, cancel_at, how;
    int within, within_at; /* calls within evaluations; at which of these it is to end */
} watch;

static int watch_step(void *user, const itn_refine_step *step) {
    watch *w = (watch *)user;
    int k;
    for (k = 0; k < itn_parameter_count(w->scene); k++) {
        const itn_parameter *p = itn_parameter_get(w->scene, k);
        w->outside += !(step->theta[k] >= p->lower && step->theta[k] <= p->upper);
    }
    CHECK(itn__finite(step->misfit) && itn__finite(step->misfit_error));
    CHECK(step->fraction >= 0 && step->fraction <= 1 && step->seconds >= 0);
    w->within += step->fraction < 1;
    if (w->within_at && w->calls >= w->cancel_at && w->within >= w->within_at) return w->how;
    if (step->fraction < 1) return 0;
    w->calls++, w->last = step->iteration;
    return w->cancel_at && w->calls >= w->cancel_at && !w->within_at ? w->how : 0;
}

/* Mean square of the difference between a picture and a render at theta, in standard errors: 1 where
   theta explains the picture. */
static double misfit(const itn_scene *scene, const float *theta, const float *target,
                     const float *variance) {
    itn_render_options options = ITN_ZERO;
    itn_image image = ITN_ZERO;
    itn_error error;
    double sum = 0, noise = 0;
    int i;
    options.spp = 512, options.seed = 999;
    stage_need(itn_render(scene, theta, &options, NULL, 0, &image, &error), &error);
    for (i = 0; i < PIXELS; i++) {
        double difference = (double)target[i] - image.pixels[i];
        sum += difference * difference, noise += variance[i] + image.pixels[PIXELS + i];
    }
    itn_image_free(&image);
    return sum / noise;
}

/* For final_spp, where a search may find that it needs 16 times the usual samples: only long tests
   have the time. */
static int usual_end(int spp) { return check_long() ? 0 : 8 * spp; }

/* From the start values back to the hidden ones. */
static void test_recovery(const char *const *names, int count, const float *hidden,
                          const float *start, int iterations) {
    double left;
    itn_scene *scene = cloud(hidden[0], hidden[1], hidden[2]);
    static float target[PIXELS], variance[PIXELS];
    itn_refine_options options = ITN_ZERO;
    itn_estimate estimates[3];
    itn_error error;
    watch w = ITN_ZERO;
    float theta[8], before[8];
    int parameters[3], all[3], k;
    static const char *const medium[] = {"m.sigma_t", "m.albedo", "m.g"};
    photograph(scene, 512, 78, target, variance);
    find_parameters(scene, names, count, parameters);
    find_parameters(scene, medium, 3, all);
    itn_parameter_values(scene, theta);
    for (k = 0; k < 3; k++) {
        int i, asked = 0;
        for (i = 0; i < count; i++) asked |= parameters[i] == all[k];
        if (asked) theta[all[k]] = start[k];
    }
    memcpy(before, theta, sizeof theta);
    w.scene = scene;
    options.spp = 40, options.seed = 5, options.iterations = iterations;
    if (hidden[0] > 3) options.final_spp = usual_end(options.spp);
    options.target_variance = variance;
    options.progress = watch_step, options.progress_user = &w;
    stage_need(itn_refine(scene, theta, target, parameters, count, &options, estimates, &error),
               &error);
    CHECK(w.outside == 0 && w.calls > 1);
    for (k = 0; k < count; k++) {
        double truth = itn_parameter_get(scene, parameters[k])->value;
        double off = estimates[k].value - truth;
        CHECK_NEAR(theta[parameters[k]], estimates[k].value, 1e-6 * fabs(estimates[k].value));
        check_report(fabs(off) <= 4 * estimates[k].standard_error &&
                         (hidden[0] > 3 || (estimates[k].determined &&
                                            estimates[k].standard_error < .2)),
                     __FILE__, __LINE__, "%s: %g +- %g (determined %d), hidden %g: %.1f sigma",
                     names[k], estimates[k].value, estimates[k].standard_error,
                     estimates[k].determined, truth, off / estimates[k].standard_error);
        if (getenv("SHOW"))
            printf("%d iterations, %s: %g +- %g, hidden %g, start %g: %.1f sigma\n", w.last,
                   names[k], estimates[k].value, estimates[k].standard_error, truth,
                   before[parameters[k]], off / estimates[k].standard_error);
    }
    /* sum over 256 pixels, half of them bright: chi^2 within 1 +- .6 */
    left = misfit(scene, theta, target, variance);
    check_report(left < 1.6, __FILE__, __LINE__, "misfit after refinement of %d: %.2f", count, left);
    if (getenv("SHOW")) printf("misfit %.2f\n", left);
    for (k = 0; k < itn_parameter_count(scene); k++) { /* the others stay */
        int i, asked = 0;
        for (i = 0; i < count; i++) asked |= parameters[i] == k;
        if (!asked) CHECK(theta[k] == before[k]);
    }
    itn_scene_free(scene);
}

static void test_recoveries(void) {
    static const char *const all[] = {"m.sigma_t", "m.albedo", "m.g"};
    static const char *const two[] = {"m.albedo", "m.g"};
    static const char *const sigma[] = {"m.sigma_t"};
    static const float hidden[3] = {2, .8f, .4f}, far1[3] = {8, .4f, -.3f};
    static const float near1[3] = {5, .6f, 0};
    static const float curved[3] = {6, .9f, .6f}, across[3] = {2.2f, .75f, -.3f};
    static const float thin[3] = {.3f, .9f, .5f}, start[3] = {6, .5f, -.5f};
    /* all three: similarity makes one direction of them faint, so the picture counts */
    test_recovery(all, 3, hidden, near1, 30);
    if (check_long()) test_recovery(all, 3, hidden, hidden, 30);
    /* from the same sigma_t albedo (1 - g) and sigma_t (1 - albedo), far along the valley */
    test_recovery(all, 3, curved, across, 15);
    if (check_long()) test_recovery(two, 2, thin, start, 30);
    test_recovery(sigma, 1, hidden, far1, 30);
}

/* Plain descent on the gradient of the loss, as in the paper, with steps that shrink to a tenth, finds
   the albedo within a hundredth. planted: the sign of the gradient. */
static void test_descent(double planted) {
    enum { STEPS = 60 };
    itn_scene *scene = cloud(2, .8, .4);
    static float target[PIXELS], variance[PIXELS];
    int albedo = itn_parameter_find(scene, "m.albedo"), i, k;
    const itn_parameter *p = itn_parameter_get(scene, albedo);
    double at = itn_parameter_to_coordinate(p, .6), square = 0, loss, slope, first = 0;
    float theta[8];
    itn_error error;
    photograph(scene, 512, 78, target, variance);
    for (k = 0; k < PIXELS; k++) square += pow(target[k], 2) / PIXELS;
    itn_parameter_values(scene, theta);
    for (i = 0; i < STEPS; i++) {
        itn_render_options options = ITN_ZERO;
        options.spp = 8, options.seed = (uint64_t)i;
        theta[albedo] = (float)itn_parameter_from_coordinate(p, at);
        stage_need(itn_loss_gradient(scene, theta, &options, target, &albedo, 1, &loss, &slope,
                                     &error), &error);
        if (i == 0) first = loss;
        at -= planted * pow(.1, (double)i / STEPS) * fmax(-.5, fmin(.5, slope / square *
                                            itn_parameter_slope(p, (double)theta[albedo])));
    }
    if (getenv("SHOW")) printf("descent: albedo .8 is %g, loss %g to %g\n", theta[albedo], first, loss);
    CHECK_NEAR(theta[albedo], .8, .01);
    CHECK(loss < .1 * first);
    itn_scene_free(scene);
}

/* ---- samples where they tell ------------------------------------------------------------------------- */

/* The picture and two derivatives, with so many samples by pixel; NULL: spp in each. */
static void render_allotted(const itn_scene *scene, int way, uint64_t seed, const int *samples,
                            int spp, itn_image *image) {
    static const char *const names[] = {"m.sigma_t", "m.g"};
    itn_render_options options = ITN_ZERO;
    itn_error error;
    int parameters[2];
    find_parameters(scene, names, 2, parameters);
    solids_way(&options, way);
    options.spp = spp, options.samples = samples, options.seed = seed;
    stage_need(itn_render(scene, NULL, &options, parameters, 2, image, &error), &error);
}

/* Means over pixels of squared errors, over those that the variances say, of pixels with few
   samples and of those with many; of the picture and its derivatives. planted: sums were divided by
   the mean number of samples. */
static void test_allotment(int way, int planted) {
    enum { PLANES = 3 }; /* sets of 4, of which a last one may be smaller */
    itn_scene *scene = cloud(3, .8, .4);
    static int samples[PIXELS];
    double sum = 0;
    itn_image truth = ITN_ZERO, image = ITN_ZERO;
    int i, p;
    for (i = 0; i < PIXELS; i++) samples[i] = 24 + 27 * i % 256, sum += samples[i];
    render_allotted(scene, way, 1, NULL, 1024, &truth);
    render_allotted(scene, way, 2, samples, 1, &image);
    for (p = 0; p < PLANES; p++) {
        const float *expected = truth.pixels + 2 * p * PIXELS, *unsure = expected + PIXELS;
        const float *found = image.pixels + 2 * p * PIXELS, *variance = found + PIXELS;
        double square[2] = {0, 0}, said[2] = {0, 0};
        for (i = 0; i < PIXELS; i++) {
            double scale = planted ? samples[i] * PIXELS / sum : 1;
            int many = samples[i] * PIXELS > sum;
            square[many] += pow(found[i] * scale - expected[i], 2);
            said[many] += variance[i] + unsure[i];
        }
        for (i = 0; i < 2; i++) /* of some 80 pixels each: 5 standard errors, and tails */
            check_report(fabs(square[i] / said[i] - 1) < .9, __FILE__, __LINE__,
                         "way %d, plane %d, %s samples: squared error %g of that said", way, p,
                         i ? "many" : "few", square[i] / said[i]);
        if (getenv("SHOW"))
            printf("allotment, way %d, plane %d: squared errors %.2f and %.2f of those said\n", way,
                   p, square[0] / said[0], square[1] / said[1]);
    }
    itn_image_free(&image);
    itn_image_free(&truth);
    itn_scene_free(scene);
}

/* Whether renders with these samples have the same bits. */
static int is_same_render(const itn_scene *scene, int way, const int *a, const int *b, int spp_b) {
    itn_image first = ITN_ZERO, second = ITN_ZERO;
    int same;
    render_allotted(scene, way, 1, a, 1, &first);
    render_allotted(scene, way, 1, b, spp_b, &second);
    same = !memcmp(first.pixels, second.pixels,
                   (size_t)(PIXELS * first.plane_count) * sizeof(float));
    itn_image_free(&first);
    itn_image_free(&second);
    return same;
}

/* The loss of a picture and its gradient. */
static void loss_allotted(const itn_scene *scene, int way, const int *samples, int spp,
                          double result[3]) {
    static const char *const names[] = {"m.sigma_t", "m.g"};
    static float target[PIXELS];
    itn_render_options options = ITN_ZERO;
    itn_error error;
    int parameters[2];
    find_parameters(scene, names, 2, parameters);
    solids_way(&options, way);
    options.spp = spp, options.samples = samples, options.seed = 3;
    stage_need(itn_loss_gradient(scene, NULL, &options, target, parameters, 2, result, result + 1,
                                 &error), &error);
}

/* The same for all pixels is what spp does. */
static void test_even_allotment(int way) {
    enum { SPP = 32 };
    itn_scene *scene = cloud(3, .8, .4);
    static int samples[PIXELS];
    double loss[3], even[3];
    int i;
    for (i = 0; i < PIXELS; i++) samples[i] = SPP;
    CHECK(is_same_render(scene, way, samples, NULL, SPP));
    CHECK_CATCHES(CHECK(is_same_render(scene, way, samples, NULL, SPP + 8)));
    loss_allotted(scene, way, NULL, SPP, loss), loss_allotted(scene, way, samples, 1, even);
    CHECK(loss[1] != 0 && !memcmp(loss, even, sizeof loss));
    itn_scene_free(scene);
}

/* The adjoint is the sum of derivative images with weights, however samples are spread. planted: of
   other weights. */
static void test_folded_allotment(int way, int planted) {
    static const char *const names[] = {"m.sigma_t", "m.g"};
    itn_scene *scene = cloud(3, .8, .4);
    static int samples[PIXELS];
    static float weights[PIXELS];
    itn_render_options options = ITN_ZERO;
    itn_image image = ITN_ZERO;
    itn_error error;
    double gradient[2], variance[2];
    int parameters[2], i, k;
    find_parameters(scene, names, 2, parameters);
    solids_way(&options, way);
    for (i = 0; i < PIXELS; i++) samples[i] = 5 + 7 * i % 31, weights[i] = (float)(i % 5) - 1;
    options.samples = samples, options.seed = 4;
    render_allotted(scene, way, 4, samples, 1, &image);
    stage_need(itn_render_gradient(scene, NULL, &options, weights, parameters, 2, gradient,
                                   variance, &error), &error);
    for (k = 0; k < 2; k++) {
        const float *derivative = image.pixels + (2 + 2 * k) * PIXELS, *spread = derivative + PIXELS;
        double sum = 0, square = 0;
        for (i = 0; i < PIXELS; i++) {
            double weight = weights[i] + (planted && i == PIXELS / 2);
            sum += weight * derivative[i], square += weight * weight * spread[i];
        }
        CHECK_NEAR(gradient[k], sum, 1e-3 * sqrt(square));
        CHECK_NEAR(variance[k], square, 1e-4 * square);
    }
    itn_image_free(&image);
    itn_scene_free(scene);
}

/* Wrong numbers. */
static void test_wrong_samples(void) {
    static const int wrong[] = {0, -1, (1 << 24) + 1, INT_MAX, INT_MIN};
    static const int parameters[] = {0};
    static int samples[PIXELS];
    static float target[PIXELS];
    itn_scene *scene = cloud(3, .8, .4);
    itn_render_options options = ITN_ZERO;
    itn_image image = ITN_ZERO;
    itn_error error;
    double value, gradient;
    int i;
    options.samples = samples;
    for (i = 0; i < PIXELS; i++) samples[i] = 4;
    for (i = 0; i < 5; i++) {
        samples[7] = wrong[i];
        CHECK(itn_render(scene, NULL, &options, NULL, 0, &image, &error) == ITN_ERROR_ARGUMENT);
        CHECK(strstr(error.message, "samples[7]") && !image.pixels);
    }
    samples[7] = 4;
    CHECK(itn_render(NULL, NULL, &options, NULL, 0, &image, &error) == ITN_ERROR_ARGUMENT);
    CHECK(itn_render(scene, NULL, &options, NULL, 0, NULL, &error) == ITN_ERROR_ARGUMENT);
    samples[8] = 0;
    CHECK(itn_render_gradient(scene, NULL, &options, target, parameters, 1, &gradient, NULL,
                              &error) == ITN_ERROR_ARGUMENT);
    CHECK(itn_scene_prepare(scene, NULL, &options, &error) == ITN_ERROR_ARGUMENT);
    samples[8] = 1;
    CHECK(itn_loss_gradient(scene, NULL, &options, target, parameters, 1, &value, &gradient,
                            &error) == ITN_ERROR_ARGUMENT);
    CHECK(strstr(error.message, "below 2"));
    itn_scene_free(scene);
}

static void test_allotments(void) {
#if defined(ITN_NO_FAST) || defined(ITN_SANITIZED)
    const int ways = 1; /* the reference, see solids_way */
#else
    const int ways = SOLIDS_WAYS;
#endif
    int way;
    for (way = 0; way < ways; way++) {
        test_allotment(way, 0);
        test_even_allotment(way);
        test_folded_allotment(way, 0);
        CHECK_CATCHES(test_allotment(way, 1));
        CHECK_CATCHES(test_folded_allotment(way, 1));
    }
    test_wrong_samples();
}

/* ---- error bars -------------------------------------------------------------------------------------- */

/* Normalised errors z = (estimate - truth) / standard error of each unknown over noisy pictures, in
   one or three channels: their mean and mean square. */
typedef struct coverage {
    double mean[3], square[3];
} coverage;

static coverage measure_coverage(const itn_scene *scene, const char *const *names, int count,
                                 int seeds, int target_spp, int spp, int known_variance) {
    static float target[3 * PIXELS], variance[3 * PIXELS];
    coverage c = ITN_ZERO;
    int parameters[3], k, seed;
    find_parameters(scene, names, count, parameters);
    for (seed = 0; seed < seeds; seed++) {
        itn_refine_options options = ITN_ZERO;
        itn_estimate estimates[3];
        itn_error error;
        float theta[16];
        photograph(scene, target_spp, (uint64_t)(1000 + seed), target, variance);
        itn_parameter_values(scene, theta);
        options.spp = spp, options.seed = (uint64_t)seed, options.iterations = 3;
        if (known_variance) options.target_variance = variance;
        stage_need(itn_refine(scene, theta, target, parameters, count, &options, estimates,
                              &error), &error);
        for (k = 0; k < count; k++) {
            double z = (estimates[k].value - itn_parameter_get(scene, parameters[k])->value) /
                       estimates[k].standard_error;
            c.mean[k] += z / seeds, c.square[k] += z * z / seeds;
        }
    }
    return c;
}

/* The sum of squares of normalised errors is chi^2 of `SEEDS` degrees of freedom; bounds at a
   two-sided level of 1e-4. Mean within 4 / sqrt(SEEDS). shrink: planted, divides the standard
   errors. A case is measured but once. */
static void test_coverage(int which, double shrink) {
    enum { SEEDS = 20 };
    static const struct {
        const char *names[2];
        int count, target_spp, spp, known_variance;
    } cases[] = {{{"m.albedo"}, 1, 32, 4, 0},
                 {{"m.sigma_t", "m.g"}, 2, 64, 4, 1},
                 {{"m.albedo"}, 1, 4, 4, 1}, /* of few samples: dark ones say they are sure */
                 {{"m.albedo"}, 1, 32, 4, 1}};
    static coverage known[4];
    const char *const *names = cases[which].names;
    int count = cases[which].count, spp = cases[which].spp, k;
    int target_spp = cases[which].target_spp, known_variance = cases[which].known_variance;
    coverage c;
    if (known[which].square[0] == 0) {
        itn_scene *scene = cloud(2, .8, .4);
        known[which] =
            measure_coverage(scene, names, count, SEEDS, target_spp, spp, known_variance);
        itn_scene_free(scene);
    }
    c = known[which];
    for (k = 0; k < count; k++) {
        /* quantiles of chi^2(20)/20 at 5e-5 and 1 - 5e-5: .20 and 2.61; the model behind the error
           bars is linear and their own noise is left out, so .18 to 2.8 */
        double ratio = c.square[k] * shrink * shrink, mean = c.mean[k] * shrink;
        check_report(ratio > .18 && ratio < 2.8, __FILE__, __LINE__,
                     "%s (of %d): mean square of normalised errors %.2f", names[k], count, ratio);
        check_report(fabs(mean) < 4 * sqrt(ratio / SEEDS), __FILE__, __LINE__,
                     "%s (of %d): mean of normalised errors %.2f: biased", names[k], count, mean);
        if (getenv("SHOW"))
            printf("coverage %s of %d, spp %d/%d, variance %d: mean %.2f, mean square %.2f\n",
                   names[k], count, target_spp, spp, known_variance, mean, ratio);
    }
}

/* Where three channels are one picture, their noise is one, too. factor: planted; taking them for
   three pictures makes 3. */
static void test_coverage_in_colours(double factor) {
    static const char *const names[] = {"m.sigma_t", "m.g"};
    static coverage c;
    int k;
    if (c.square[0] == 0) { /* once */
        itn_scene *scene = cloud_in(3, SIZE, .65, 1, 2, .8, .4);
        c = measure_coverage(scene, names, 2, 24, 64, 4, 1);
        itn_scene_free(scene);
    }
    if (getenv("SHOW")) printf("coverage in colours: %.2f, %.2f\n", c.square[0], c.square[1]);
    for (k = 0; k < 2; k++) /* quantiles of chi^2(24)/24 at 1e-3: .34 and 2.13 */
        check_report(c.square[k] * factor > .34 && c.square[k] * factor < 2.13, __FILE__, __LINE__,
                     "unknown %d: mean square of normalised errors in three channels %.2f", k,
                     c.square[k] * factor);
}

/* Noise of which nobody tells, in three albedos: independent between channels it leaves their errors
   so, though that of renders is much the same in all. common: planted, the same noise in all. */
static void test_untold_colours(int common) {
    static const char *const names[] = {"m.albedo_r", "m.albedo_g", "m.albedo_b"};
    static float target[3 * PIXELS], variance[3 * PIXELS];
    itn_scene *scene = cloud_in(3, SIZE, .65, 1, 2, .8, .4);
    itn_refine_options options = ITN_ZERO;
    itn_estimate estimates[3];
    itn_error error;
    double covariance[9];
    int parameters[3], i, k, l;
    float theta[16];
    find_parameters(scene, names, 3, parameters);
    photograph(scene, 1024, 7, target, variance);
    for (i = 0; i < 3 * PIXELS; i++) {
        int at = common ? i % PIXELS : i;
        target[i] += .1f * (float)(drawn(at, 3) + drawn(at, 4) - 1);
    }
    itn_parameter_values(scene, theta);
    options.spp = 16, options.iterations = 4, options.covariance = covariance;
    stage_need(itn_refine(scene, theta, target, parameters, 3, &options, estimates, &error),
               &error);
    for (k = 0; k < 3; k++)
        for (l = 0; l < k; l++) {
            double c = covariance[3 * k + l] / sqrt(covariance[4 * k] * covariance[4 * l]);
            if (getenv("SHOW")) printf("untold colours: correlation %d %d: %.2f\n", k, l, c);
            CHECK(fabs(c) < .8);
        }
    itn_scene_free(scene);
}

static void test_coverages(void) {
    int which;
    for (which = 0; which < (check_long() ? 4 : 3); which++) test_coverage(which, 1);
    test_coverage_in_colours(1);
    test_untold_colours(0);
}

/* A search at the truth in a picture with noise of its own, of so many samples. */
static itn_scene *begin_at_truth(itn__refiner *refiner, int count, double noise, double sigma_t,
                                 int spp, int told, itn_view *view) {
    static const char *const names[3] = {"m.g", "m.sigma_t", "m.albedo"};
    static float target[PIXELS], variance[PIXELS];
    static int parameters[3];
    itn_scene *scene = cloud(sigma_t, .9, .5);
    float values[3];
    int i;
    values[0] = .5f, values[1] = (float)sigma_t, values[2] = .9f;
    find_parameters(scene, names, count, parameters);
    photograph(scene, 256, 7, target, variance);
    for (i = 0; i < PIXELS; i++) target[i] += (float)(noise * (drawn(i, 3) + drawn(i, 4) - 1));
    memset(view, 0, sizeof *view);
    view->scene = scene, view->target = target, view->parameters = parameters;
    if (told) view->target_variance = variance;
    begin_search(refiner, view, count, values, spp);
    return scene;
}

/* Evaluates once more at the same point, as if nothing were known. */
static void evaluate_anew(itn__refiner *refiner) {
    itn_error error;
    refiner->known = 0;
    stage_need(itn__refine_evaluate(refiner, refiner->options.spp, &error), &error);
    itn__refine_learn(refiner);
    CHECK(itn__normal(refiner));
}

/* The variance of A over many evaluations at one point is what itn__direction_noise says, where it is
   the noise of J: of sigma_t and g along the valley. A sample variance of 90 has a standard error
   of 15 %. Their ratios, each in one direction. */
enum { SPREAD_WAYS = 2 };
static void measure_spread(double ratios[SPREAD_WAYS]) {
    enum { TIMES = 90, N = 3, WAYS = SPREAD_WAYS };
    static const double ways[WAYS][N] = {{1, 0, 0}, {0, 1, 0}};
    double sum[WAYS] = {0}, square[WAYS] = {0}, claimed[WAYS] = {0};
    itn__refiner refiner;
    itn_view view;
    itn_scene *scene = begin_at_truth(&refiner, N, 0, 4, 32, 1, &view);
    int t, w, j;
    for (t = 0; t < TIMES; t++) {
        evaluate_anew(&refiner);
        for (w = 0; w < WAYS; w++) {
            double a = 0;
            for (j = 0; j < N; j++) a += refiner.told[j] * pow(refiner.axes[w * N + j], 2);
            sum[w] += a / TIMES, square[w] += a * a / TIMES;
            claimed[w] += itn__direction_noise(&refiner, ways[w], 1) / TIMES;
        }
    }
    for (w = 0; w < WAYS; w++) {
        ratios[w] = (square[w] - sum[w] * sum[w]) * TIMES / (TIMES - 1) / claimed[w];
        if (getenv("SHOW"))
            printf("A, way %d: %.4g, variance %.2f of what is claimed\n", w, sum[w], ratios[w]);
    }
    end_search(&refiner);
    itn_scene_free(scene);
}
/* planted: factor of the claim. */
static void test_spread(double planted) {
    static double ratios[SPREAD_WAYS];
    int w;
    if (ratios[0] == 0) measure_spread(ratios); /* once */
    for (w = 0; w < SPREAD_WAYS; w++)
        check_report(ratios[w] / planted > .5 && ratios[w] / planted < 1.8, __FILE__, __LINE__,
                     "variance of A over what is claimed, way %d: %.2f", w, ratios[w] / planted);
}

/* The variance of b over many evaluations at the truth is the renders' part of N, also where the
   target's noise, which is the same each time, is large and nobody has told, so that the noise of J
   meets it. planted: 1 takes all of N. */
static void test_stray_noise(int planted) {
    enum { TIMES = 90 };
    static double ratios[2];
    double sum = 0, square = 0, claimed[2] = {0, 0};
    itn__refiner refiner;
    itn_view view;
    itn_scene *scene = begin_at_truth(&refiner, 1, .4, 8, 16, 0, &view);
    int t, i;
    for (t = 0; t < 3; t++) evaluate_anew(&refiner); /* to know the noise */
    for (t = 0; t < TIMES && ratios[0] == 0; t++) {
        evaluate_anew(&refiner);
        sum += refiner.right[0] / TIMES, square += pow(refiner.right[0], 2) / TIMES;
        claimed[0] += refiner.drawn * refiner.noise[0] / TIMES;
        claimed[1] += refiner.noise[0] / TIMES;
    }
    for (i = 0; i < 2 && ratios[i] == 0; i++)
        ratios[i] = (square - sum * sum) * TIMES / (TIMES - 1) / claimed[i];
    if (getenv("SHOW")) printf("b: variance %.2f of what is claimed\n", ratios[planted]);
    check_report(ratios[planted] > .5 && ratios[planted] < 1.6, __FILE__, __LINE__,
                 "variance of b over what is claimed: %.2f", ratios[planted]);
    end_search(&refiner);
    itn_scene_free(scene);
}

/* Evaluations at points that are near each other are one of all their samples: that of the first,
   moved, and the second, weighted by their samples. planted: not moved. */
static void test_learn(int planted) {
    itn__refiner refiner;
    itn_view view;
    itn_scene *scene = begin_at_truth(&refiner, 1, 0, 8, 16, 0, &view);
    float before[3 * PIXELS], *known = refiner.views->known[1];
    const float *fresh = refiner.views->fresh[1];
    double there, d = .1;
    itn_error error;
    int i;
    evaluate_anew(&refiner);
    memcpy(before, known, sizeof before);
    refiner.before[0] = refiner.coordinates[0], there = refiner.before[0] + d;
    itn__refine_set(&refiner, &there);
    stage_need(itn__refine_evaluate(&refiner, 48, &error), &error);
    refiner.covariance[0] = pow(4.5 * d * d, 2);
    itn__refine_learn(&refiner);
    CHECK(refiner.known == 48); /* too far away: forgotten */
    CHECK(!memcmp(known, fresh, sizeof before));
    memcpy(known, before, sizeof before);
    refiner.known = 16, refiner.covariance[0] = pow(5.5 * d * d, 2);
    itn__refine_learn(&refiner);
    CHECK(refiner.known == 64);
    for (i = 0; i < PIXELS; i++) {
        int k = i + 2 * PIXELS; /* the slope there */
        double moved = before[i] + (planted ? 0 : d) * before[k];
        CHECK_NEAR(known[i], .25 * moved + .75 * fresh[i], 1e-5);
        CHECK_NEAR(known[k], .25 * before[k] + .75 * fresh[k], 1e-4);
    }
    end_search(&refiner);
    itn_scene_free(scene);
}

/* Searches with neighbouring seeds share no render, nor does one evaluation with another, or render a
   with b. planted: a seed of all searches; 0: their own. */
static void test_seeds(uint64_t planted) {
    enum { SEEDS = 3, EVALUATIONS = 4, RENDERS = 2 * SEEDS * EVALUATIONS };
    static float kept[RENDERS][PIXELS];
    int seed, i, j, same = 0;
    for (seed = 0; seed < SEEDS; seed++) {
        itn__refiner refiner;
        itn_view view;
        itn_scene *scene = begin_at_truth(&refiner, 1, 0, 2, 4, 0, &view);
        refiner.options.seed = planted ? planted : (uint64_t)seed + 1;
        for (i = 0; i < EVALUATIONS; i++) {
            evaluate_anew(&refiner);
            for (j = 0; j < 2; j++)
                memcpy(kept[2 * (EVALUATIONS * seed + i) + j], refiner.views->fresh[j],
                       sizeof kept[0]);
        }
        end_search(&refiner);
        itn_scene_free(scene);
    }
    for (i = 0; i < RENDERS; i++)
        for (j = 0; j < i; j++) same += !memcmp(kept[i], kept[j], sizeof kept[0]);
    CHECK(same == 0);
}

/* A search for two unknowns, u and v, whose normal equations a test fills in along u + v and
   u - v, of which the second may not be told: no picture stands behind it. */
typedef struct numbers {
    itn__refiner refiner;
    double matrix[4], axes[4], noise[4], covariance[4], turn[4];
} numbers;

static void begin_numbers(numbers *p, const itn_scene *scene) {
    const double axes[4] = {sqrt(.5), sqrt(.5), sqrt(.5), -sqrt(.5)};
    itn__refiner *refiner = &p->refiner;
    int k;
    memset(p, 0, sizeof *p);
    refiner->count = 2, refiner->matrix = p->matrix, refiner->axes = p->axes;
    refiner->noise = p->noise, refiner->covariance = p->covariance, refiner->turn = p->turn;
    refiner->known = refiner->arrived = 1, refiner->misfit.value = 1;
    memcpy(p->axes, axes, sizeof axes);
    refiner->told[0] = 1e4, refiner->told[1] = 400;
    p->noise[0] = 1e4, p->noise[3] = 900;
    for (k = 0; k < 2; k++) {
        p->turn[3 * k] = 1, refiner->values[k] = 1;
        refiner->parameters[k] = itn_parameter_get(scene, itn_parameter_find(scene, "light.scale"));
    }
}

/* Along what is told the variance is c^T N c / (lambda^2 - 9 S), by Fieller's definition of what is
   not excluded; along what is not, that of the prior. planted: added to S. */
static void test_doubt(double planted) {
    static itn_scene *scene;
    numbers p;
    int which;
    scene = cloud(1, .5, .2);
    for (which = 0; which < 3; which++) {
        double sum, difference, expected = 901. / (400. * 400), prior = ITN__PRIOR * ITN__PRIOR, d;
        begin_numbers(&p, scene);
        if (which) p.refiner.doubt[1] = 3 * (which == 1 ? 100 + planted : 134);
        itn__normal_covariance(&p.refiner);
        sum = (p.covariance[0] + p.covariance[3]) / 2 + p.covariance[1];
        difference = (p.covariance[0] + p.covariance[3]) / 2 - p.covariance[1];
        if (which == 1) expected = 900 / (400. * 400 - 9 * 100. * 100);
        if (which == 2) expected = prior;
        CHECK_NEAR(difference / expected, 1, 2e-3);
        CHECK_NEAR(sum, 1e-4, 1e-7);
        d = 3 * sqrt(difference); /* on the edge of what is not excluded */
        if (which == 1) CHECK_NEAR(pow(400 * d, 2) / (9 * (900 + 1e4 * d * d)), 1, 2e-3);
    }
    itn_scene_free(scene);
}

/* Steps go all the way along what is told, but no further than the radius; along what is not, not at
   all, unless b is clearly more than noise; and none shortens another. planted: it is told. */
static void test_untold_step(int planted) {
    itn_scene *scene = cloud(1, .5, .2);
    const double r = sqrt(.5);
    numbers p;
    int clear;
    for (clear = 0; clear < 2; clear++) {
        double b = clear ? 200 : 50;
        begin_numbers(&p, scene);
        p.refiner.told[1] = 1, p.refiner.doubt[1] = 3 * (planted ? .1 : 20);
        p.refiner.right[0] = 3e3, p.refiner.right[1] = b;
        itn__refine_solve(&p.refiner, 1);
        CHECK_NEAR((p.refiner.step[0] + p.refiner.step[1]) * r, .3, 1e-5);
        CHECK_NEAR((p.refiner.step[0] - p.refiner.step[1]) * r, clear, 1e-5);
    }
    itn__refine_solve(&p.refiner, .1);
    CHECK_NEAR((p.refiner.step[0] + p.refiner.step[1]) * r, .1, 1e-9);
    CHECK_NEAR((p.refiner.step[0] - p.refiner.step[1]) * r, .1, 1e-9);
    itn_scene_free(scene);
}

/* What is not told is not determined; a step that is left counts as an error; and a bad fit does not
   look precise. planted: its misfit. */
static void test_verdict(double planted) {
    itn_scene *scene = cloud(1, .5, .2);
    int which;
    for (which = 0; which < 4; which++) {
        static const double expected[4] = {.0535, .0535, .3047, .107}; /* by (1e-4 + 900 / 400^2) / 2 */
        itn_refine_outcome outcome = ITN_ZERO;
        itn_estimate estimates[2];
        numbers p;
        begin_numbers(&p, scene);
        if (which == 1) p.refiner.doubt[1] = 3 * 200;
        if (which == 2) p.refiner.step[0] = .3, p.refiner.arrived = 0;
        if (which == 3) p.refiner.misfit.value = planted, p.refiner.misfit.spread = .1;
        itn__normal_covariance(&p.refiner);
        itn__refine_estimate(&p.refiner, estimates, &outcome);
        CHECK(outcome.explained == (which != 3) && outcome.finished == (which != 2));
        CHECK(estimates[0].determined == (which != 1));
        if (which == 1) CHECK(estimates[1].standard_error > 5);
        else CHECK_NEAR(estimates[0].standard_error, expected[which], 1e-3);
        if (which == 2) CHECK_NEAR(estimates[1].standard_error, expected[0], 1e-3);
    }
    itn_scene_free(scene);
}

/* With few samples in the end little is known along the valley, and error bars say so: of
   searches that start from both sides of the truth none is more than four standard errors off. */
static void test_refine_few_samples(void) {
    const int seeds = check_long() ? 8 : 2;
    static const char *const names[] = {"m.sigma_t", "m.albedo", "m.g"};
    static const float hidden[3] = {6, .9f, .6f};
    static const float starts[2][3] = {{3, .818f, .2f}, {12, .947f, .8f}};
    static float target[PIXELS], variance[PIXELS];
    itn_scene *scene = cloud(hidden[0], hidden[1], hidden[2]);
    double furthest = 0;
    int parameters[3], seed, k, determined = 0;
    find_parameters(scene, names, 3, parameters);
    photograph(scene, 1024, 7, target, variance);
    for (seed = 0; seed < seeds; seed++) {
        itn_refine_options options = ITN_ZERO;
        itn_estimate estimates[3];
        itn_error error;
        float theta[8];
        itn_parameter_values(scene, theta);
        for (k = 0; k < 3; k++) theta[parameters[k]] = starts[seed % 2][k];
        options.spp = 8, options.final_spp = 64, options.seed = (uint64_t)seed;
        options.target_variance = variance;
        stage_need(itn_refine(scene, theta, target, parameters, 3, &options, estimates, &error),
                   &error);
        for (k = 0; k < 3; k++) {
            double z = fabs(estimates[k].value - (double)hidden[k]) / estimates[k].standard_error;
            furthest = fmax(furthest, z), determined += estimates[k].determined;
        }
    }
    check_report(furthest < 4, __FILE__, __LINE__, "few samples: %.1f standard errors off",
                 furthest);
    if (getenv("SHOW"))
        printf("few samples: at most %.1f standard errors off, %d of %d determined\n", furthest,
               determined, 3 * seeds);
    itn_scene_free(scene);
}

/* One synthetic case: a cloud of random size of picture, light and material, a picture of random
   noise, a start that is off by up to e^.4 and .4 in logits. Returns in z the errors of sigma_t,
   albedo and g in standard errors. */
static void run_case(int which, double *z) {
    static const char *const names[] = {"m.sigma_t", "m.albedo", "m.g"};
    static float target[24 * 24], variance[24 * 24];
    double truth[3];
    itn_refine_options options = ITN_ZERO;
    itn_estimate estimates[3];
    itn_scene *scene;
    itn_error error;
    float theta[8];
    int parameters[3], k;
    truth[0] = exp(1.8 * drawn(which, 0)), truth[1] = .5 + .45 * drawn(which, 1);
    truth[2] = .9 * drawn(which, 2) - .2;
    scene = lit_cloud(16 + (int)(9 * drawn(which, 3)), drawn(which, 4), 1, truth[0], truth[1],
                      truth[2]);
    photograph(scene, (int)(32 * exp(3 * drawn(which, 5))), 5000 + (uint64_t)which, target,
               variance);
    find_parameters(scene, names, 3, parameters);
    itn_parameter_values(scene, theta);
    for (k = 0; k < 3; k++) {
        const itn_parameter *p = itn_parameter_get(scene, parameters[k]);
        double start = itn_parameter_to_coordinate(p, p->value) + .8 * drawn(which, 6 + k) - .4;
        theta[parameters[k]] = (float)itn_parameter_from_coordinate(p, start);
    }
    options.spp = 8, options.seed = (uint64_t)which, options.target_variance = variance;
    stage_need(itn_refine(scene, theta, target, parameters, 3, &options, estimates, &error),
               &error);
    for (k = 0; k < 3; k++) {
        z[k] = (estimates[k].value - truth[k]) / estimates[k].standard_error;
        if (getenv("SHOW"))
            printf("case %d: %s %g +- %g, hidden %g: %.1f sigma\n", which, names[k],
                   estimates[k].value, estimates[k].standard_error, truth[k], z[k]);
    }
    itn_scene_free(scene);
}

/* Of `cases`, at least `least` and at most `most` of a hundred have the truth within 1.96 standard
   errors, for each parameter. planted: a fifth of the standard errors. A case is run but once. */
static void test_cases(int cases, double least, double most, int planted) {
    static double z[200][3];
    static int known;
    int within[3] = {0, 0, 0}, which, k;
    for (which = 0; which < cases; which++) {
        if (which == known) run_case(known++, z[which]);
        for (k = 0; k < 3; k++) within[k] += fabs(z[which][k]) < (planted ? .39 : 1.96);
    }
    for (k = 0; k < 3; k++) {
        double share = 100. * within[k] / cases;
        if (getenv("SHOW")) printf("parameter %d within 1.96 in %.1f %%\n", k, share);
        check_report(share >= least && share <= most, __FILE__, __LINE__,
                     "parameter %d: the truth is within 1.96 standard errors in %.1f %%", k, share);
    }
}

/* ---- several pictures -------------------------------------------------------------------------------- */

/* One view is itn_refine, bit for bit; the covariance has the error bars on its diagonal. */
static void test_one_view(void) {
    static const char *const names[] = {"m.albedo", "m.g"};
    itn_scene *scene = cloud(2, .8, .4);
    static float target[PIXELS], variance[PIXELS];
    itn_refine_options options = ITN_ZERO;
    itn_estimate one[2], same[2];
    itn_error error;
    double covariance[4];
    itn_refine_outcome outcomes[2];
    int parameters[2], k;
    float theta[8], values[2];
    itn_view view = ITN_ZERO;
    find_parameters(scene, names, 2, parameters);
    photograph(scene, 64, 7, target, variance);
    options.spp = 8, options.iterations = 3;
    options.target_variance = variance, options.outcome = &outcomes[0];
    itn_parameter_values(scene, theta);
    values[0] = theta[parameters[0]] = .7f, values[1] = theta[parameters[1]] = .2f;
    stage_need(itn_refine(scene, theta, target, parameters, 2, &options, one, &error), &error);
    view.scene = scene, view.target = target, view.target_variance = variance;
    view.parameters = parameters;
    options.target_variance = NULL, options.outcome = &outcomes[1];
    options.covariance = covariance;
    stage_need(itn_refine_views(&view, 1, values, 2, &options, same, &error), &error);
    options.covariance = NULL;
    CHECK(outcomes[0].misfit == outcomes[1].misfit);
    CHECK_NEAR(covariance[1], covariance[2], 1e-9 * fabs(covariance[1]));
    for (k = 0; k < 2; k++) {
        CHECK(one[k].value == same[k].value && values[k] == theta[parameters[k]]);
        CHECK(one[k].standard_error == same[k].standard_error);
        CHECK_NEAR(sqrt(covariance[3 * k]), one[k].standard_error,
                   1e-9 * one[k].standard_error);
    }
    itn_scene_free(scene);
}

/* Values of infinite variance do not count, whatever they are: a third of the picture is left out. Where
   no other's noise is known the error bars come from the misfit. planted: they count. */
static void test_left_out(int planted) {
    static const char *const names[] = {"m.albedo", "m.g"};
    static const float truth[] = {.8f, .4f};
    itn_scene *scene = cloud(2, .8, .4);
    static float target[PIXELS], variance[PIXELS];
    itn_refine_options options = ITN_ZERO;
    itn_estimate found[3][2];
    itn_error error;
    itn_refine_outcome outcome;
    int parameters[2], way, k;
    find_parameters(scene, names, 2, parameters);
    options.target_variance = variance, options.spp = 16, options.outcome = &outcome;
    if (planted) options.iterations = 3; /* there is nothing to find */
    for (way = 0; way < 3; way++) { /* NaN, 5, NaN without the others' noise */
        float theta[8];
        photograph(scene, 256, 7, target, variance);
        for (k = 0; k < PIXELS; k++) {
            int out = k % SIZE < SIZE / 3;
            if (out) target[k] = way == 1 || planted ? 5 : NAN;
            if (out) variance[k] = planted ? .01f : INFINITY;
            else if (way == 2) variance[k] = 0;
        }
        itn_parameter_values(scene, theta);
        theta[parameters[0]] = .7f, theta[parameters[1]] = .2f;
        stage_need(itn_refine(scene, theta, target, parameters, 2, &options, found[way], &error),
                   &error);
        CHECK(way == 2 || fabs(outcome.misfit - 1) < .5);
        for (k = 0; k < 2; k++) {
            const itn_estimate *e = &found[way][k];
            CHECK(e->determined);
            CHECK_MEAN(e->value, e->standard_error, truth[k], 4.5, .2);
        }
    }
    CHECK(!memcmp(found[0], found[1], sizeof found[0]));
    itn_scene_free(scene);
}

/* A cloud in two lights, each of its own unknown strength, seen by films of different sizes: all is
   found, with smaller error bars than from one picture. swapped: planted, takes each strength for the
   other. */
static void test_two_lights(int swapped) {
    enum { UNKNOWNS = 5 };
    static const char *const names[2][UNKNOWNS] = {
        {"m.sigma_t", "m.albedo", "m.g", "light.scale", ""},
        {"m.sigma_t", "m.albedo", "m.g", "", "light.scale"}};
    static const int sizes[2] = {SIZE, 20};
    static const double truth[UNKNOWNS] = {2, .8, .4, 1, .6}, at[2] = {.65, .15};
    static float target[2][20 * 20], variance[2][20 * 20];
    float values[UNKNOWNS] = {3, .7f, .2f, 1.5f, .7f};
    itn_estimate estimates[UNKNOWNS], alone[4];
    itn_refine_options options = ITN_ZERO;
    itn_view views[2];
    itn_scene *scenes[2];
    itn_error error;
    int parameters[2][UNKNOWNS], v, k;
    float theta[8];
    itn_refine_outcome outcome;
    memset(views, 0, sizeof views);
    for (v = 0; v < 2; v++) {
        scenes[v] = lit_cloud(sizes[v], at[v], truth[3 + v], truth[0], truth[1], truth[2]);
        find_parameters(scenes[v], names[v], UNKNOWNS, parameters[v]);
        CHECK(parameters[v][4 - v] == -1 && parameters[v][3 + v] >= 0);
        photograph(scenes[v], 512, 50 + (uint64_t)v, target[v], variance[v]);
        views[v].scene = scenes[v], views[v].parameters = parameters[v];
        views[v].target = target[v], views[v].target_variance = variance[v];
    }
    for (v = 0; v < 2 && swapped; v++)
        parameters[v][4 - v] = parameters[v][3 + v], parameters[v][3 + v] = -1;
    options.spp = 8, options.outcome = &outcome;
    stage_need(itn_refine_views(views, 2, values, UNKNOWNS, &options, estimates, &error), &error);
    CHECK(outcome.misfit < 1.5);
    for (k = 0; k < UNKNOWNS; k++) {
        double off = estimates[k].value - truth[k];
        CHECK(values[k] == (float)estimates[k].value);
        check_report(fabs(off) < 4 * estimates[k].standard_error, __FILE__, __LINE__,
                     "two lights: unknown %d is %g +- %g, hidden %g", k, estimates[k].value,
                     estimates[k].standard_error, truth[k]);
        if (getenv("SHOW"))
            printf("two lights: unknown %d %g +- %g, hidden %g\n", k, estimates[k].value,
                   estimates[k].standard_error, truth[k]);
    }
    itn_parameter_values(scenes[0], theta);
    options.target_variance = variance[0], options.iterations = 2;
    stage_need(itn_refine(scenes[0], theta, target[0], parameters[0], 4 - swapped, &options, alone,
                          &error), &error);
    for (k = 0; k < 3; k++) CHECK(estimates[k].standard_error < alone[k].standard_error);
    for (v = 0; v < 2; v++) itn_scene_free(scenes[v]);
}

/* Two pictures of one scene with other noise: error bars shrink by the square root of two, on
   average over a few pairs, as each is known to some 12 %. */
static void test_two_pictures(void) {
    static const char *const albedo[] = {"m.albedo"};
    itn_scene *scene = cloud(2, .8, .4);
    static float target[2][PIXELS], variance[2][PIXELS];
    itn_refine_options options = ITN_ZERO;
    itn_estimate one, two;
    itn_view views[2];
    itn_error error;
    double ratio = 0;
    int parameter, v, pair;
    enum { PAIRS = 4 };
    find_parameters(scene, albedo, 1, &parameter);
    memset(views, 0, sizeof views);
    for (pair = 0; pair < PAIRS; pair++) {
        float value = .75f;
        for (v = 0; v < 2; v++) {
            photograph(scene, 32, 7 + (uint64_t)(2 * pair + v), target[v], variance[v]);
            views[v].scene = scene, views[v].parameters = &parameter;
            views[v].target = target[v], views[v].target_variance = variance[v];
        }
        options.spp = 32;
        stage_need(itn_refine_views(views, 1, &value, 1, &options, &one, &error), &error);
        stage_need(itn_refine_views(views, 2, &value, 1, &options, &two, &error), &error);
        ratio += one.standard_error / two.standard_error / PAIRS;
        CHECK_NEAR(two.value, .8, 4 * two.standard_error);
    }
    CHECK_NEAR(ratio, sqrt(2), .2);
    itn_scene_free(scene);
}

/* The inverse of a symmetric matrix, 1x1 to 4x4, which is positive definite: V D^-1 V^T. */
static void invert_matrix(const double *matrix, int n, double *inverse) {
    double values[16], v[16];
    int i, k, j;
    memcpy(values, matrix, (size_t)(n * n) * sizeof *matrix);
    itn__eigen(values, v, n);
    for (j = 0; j < n; j++) CHECK(values[j * n + j] > 0);
    for (i = 0; i < n; i++)
        for (k = 0; k < n; k++)
            for (inverse[n * i + k] = 0, j = 0; j < n; j++)
                inverse[n * i + k] += v[i * n + j] * v[k * n + j] / values[j * n + j];
}

/* Refines the views, at the truth, of those unknowns that any of them has; covariance: [4][4]. */
static void refine_shared(const itn_view *views, int count, double *covariance) {
    static const float truth[4] = {2, .4f, .8f, .8f};
    itn_view some[2];
    itn_refine_options options = ITN_ZERO;
    itn_estimate estimates[4];
    itn_error error;
    float values[4];
    int parameters[2][4], v, k, n = 0;
    for (k = 0; k < 4; k++) {
        int any = 0;
        for (v = 0; v < count; v++) any |= (parameters[v][n] = views[v].parameters[k]) >= 0;
        if (any) values[n++] = truth[k];
    }
    for (v = 0; v < count; v++) some[v] = views[v], some[v].parameters = parameters[v];
    options.spp = check_long() ? 64 : 32, options.final_spp = usual_end(options.spp);
    options.covariance = covariance;
    stage_need(itn_refine_views(some, count, values, n, &options, estimates, &error), &error);
}

/* Two views that share the unknowns of a medium in part tell together what they tell each for
   itself: informations, the inverses of covariances, add up. Of names in each view, "" is not
   unknown there. forgotten: planted, leaves out the second view's. */
static void test_shared_in_part(const char *const names[2][4], int forgotten) {
    static const double lights[2] = {.65, .15};
    static float target[2][PIXELS], variance[2][PIXELS];
    double sum[16], covariance[16], own[16], own_inverse[16];
    itn_scene *scenes[2];
    itn_view views[2];
    int parameters[2][4], v, i, k, l, n, m;
    memset(views, 0, sizeof views), memset(sum, 0, sizeof sum);
    for (n = 0; n < 4 && (*names[0][n] || *names[1][n]);) n++;
    for (v = 0; v < 2; v++) {
        int at[4];
        scenes[v] = lit_cloud(SIZE, lights[v], 1, 2, .8, .4);
        find_parameters(scenes[v], names[v], 4, parameters[v]);
        photograph(scenes[v], 64, 60 + (uint64_t)v, target[v], variance[v]);
        views[v].scene = scenes[v], views[v].parameters = parameters[v];
        views[v].target = target[v], views[v].target_variance = variance[v];
        refine_shared(&views[v], 1, own);
        for (k = m = 0; k < n; k++)
            if (parameters[v][k] >= 0) at[m++] = k;
        invert_matrix(own, m, own_inverse);
        for (i = 0; i < m * m && !(forgotten && v); i++)
            sum[at[i / m] * n + at[i % m]] += own_inverse[i];
    }
    for (k = 0; k < n; k++) sum[k * n + k] *= 1 + 1e-9;
    refine_shared(views, 2, covariance);
    invert_matrix(sum, n, own_inverse);
    for (k = 0; k < n; k++) {
        double error = sqrt(covariance[k * n + k]), expected = sqrt(own_inverse[k * n + k]);
        check_report(error > .7 * expected && error < 1.4 * expected, __FILE__, __LINE__,
                     "shared in part: error of unknown %d is %g, expected %g", k, error, expected);
        if (getenv("SHOW")) printf("shared in part: %d: %g, %g\n", k, error, expected);
    }
    for (l = 0; l < 2; l++) itn_scene_free(scenes[l]);
}

static void test_shared_in_parts(void) {
    static const char *const one_g[2][4] = {{"m.sigma_t", "m.g", "", ""}, {"m.sigma_t", "", "", ""}};
    static const char *const albedos[2][4] = {{"m.sigma_t", "m.g", "m.albedo", ""},
                                              {"m.sigma_t", "m.g", "", "m.albedo"}};
    test_shared_in_part(one_g, 0);
    test_shared_in_part(albedos, 0);
    CHECK_CATCHES(test_shared_in_part(one_g, 1));
}

/* What itn_refine_views refuses, and that it then leaves all alone. */
static void test_view_options(void) {
    itn_scene *scene = cloud(2, .8, .4);
    static float target[PIXELS], broken[PIXELS], variance[PIXELS], endless[PIXELS];
    int albedo = itn_parameter_find(scene, "m.albedo"), g = itn_parameter_find(scene, "m.g");
    int parameters[2], other[2], k;
    float values[2] = {.7f, .3f}, theta[8];
    itn_refine_options options = ITN_ZERO;
    itn_estimate estimates[2], untouched[2];
    itn_view views[2], good[2];
    itn_error error;
    parameters[0] = albedo, parameters[1] = g;
    itn_parameter_values(scene, theta);
    for (k = 0; k < PIXELS; k++) target[k] = broken[k] = .3f, variance[k] = .01f, endless[k] = INFINITY;
    broken[PIXELS - 1] = NAN;
    memset(good, 0, sizeof good);
    for (k = 0; k < 2; k++)
        good[k].scene = scene, good[k].target = target, good[k].parameters = parameters;
    memset(estimates, 0x5a, sizeof estimates);
    memcpy(untouched, estimates, sizeof untouched);
    options.spp = 4, options.iterations = 1;
#define REFUSED(assignment, count, phrase)                                                         \
    do {                                                                                           \
        memcpy(views, good, sizeof views);                                                         \
        error.message[0] = 0;                                                                      \
        assignment;                                                                                \
        check_report(itn_refine_views(views, count, values, 2, &options, estimates, &error) ==     \
                             ITN_ERROR_ARGUMENT && strstr(error.message, phrase) != NULL &&        \
                         values[0] == .7f && values[1] == .3f &&                                   \
                         !memcmp(estimates, untouched, sizeof untouched),                          \
                     __FILE__, __LINE__, "%s: %s", #assignment, error.message);                    \
    } while (0)
    REFUSED((void)0, 0, "view_count 0");
    REFUSED(views[1].scene = NULL, 2, "view 1");
    REFUSED(views[1].target = NULL, 2, "view 1");
    REFUSED(views[1].parameters = NULL, 2, "view 1");
    REFUSED(views[1].target = broken, 2, "view 1: target is NaN or beyond 1e18 at pixel 143");
    broken[143] = -2e18f;
    REFUSED(views[1].target = broken, 2, "view 1: target is NaN or beyond 1e18 at pixel 143");
    REFUSED(views[1].target_variance = broken, 2, "view 1: target_variance is NaN");
    for (k = 0; k < PIXELS; k++) broken[k] = 1e-16f;
    REFUSED(views[1].target = broken, 2, "view 1: the picture's mean square is 1e-32, too small");
    REFUSED(views[0].target_variance = endless, 2, "view 0: no value counts");
    other[0] = -1, other[1] = -1;
    REFUSED(views[1].parameters = other, 2, "view 1 has none of the unknowns");
    other[0] = albedo;
    REFUSED(views[0].parameters = views[1].parameters = other, 2, "no view has unknown 1");
    other[0] = g, other[1] = albedo;
    REFUSED(views[1].parameters = other, 2, "m.g of view 1 has not the bounds of m.albedo");
    other[0] = 99;
    REFUSED(views[1].parameters = other, 2, "view 1 has no parameter 99");
    other[0] = -2;
    REFUSED(views[1].parameters = other, 2, "view 1 has no parameter -2");
    REFUSED((views[1].theta = theta, theta[itn_parameter_find(scene, "m.sigma_t")] = -1), 2,
            "m.sigma_t");
    REFUSED(options.target_variance = variance, 2, "belongs into the views");
    options.target_variance = NULL;
    memcpy(views, good, sizeof views);
    other[0] = -1, other[1] = g, views[0].parameters = other;
    CHECK(itn_refine_views(views, 2, values, 2, &options, estimates, &error) == ITN_OK);
    itn_scene_free(scene);
}

/* Six times the samples in the end: error bars as 1 / 40 and 1 / 256 make them, and what is left of a
   picture of 1024. */
static void run_final_spp(itn_estimate *few, itn_estimate *many) {
    enum { SEEDS = 6 };
    static const char *const albedo[] = {"m.albedo"};
    itn_scene *scene = cloud(2, .8, .4);
    static float target[PIXELS], variance[PIXELS];
    itn_refine_options options = ITN_ZERO;
    itn_error error;
    float theta[8];
    double errors[2] = {0, 0};
    int parameter, seed;
    find_parameters(scene, albedo, 1, &parameter);
    options.spp = 8, options.target_variance = variance;
    for (seed = 0; seed < SEEDS; seed++) { /* error bars are known to a tenth or two */
        photograph(scene, 1024, 8 + (uint64_t)seed, target, variance);
        options.seed = (uint64_t)seed, options.final_spp = 0;
        itn_parameter_values(scene, theta);
        theta[parameter] = .75f;
        stage_need(itn_refine(scene, theta, target, &parameter, 1, &options, few, &error), &error);
        options.final_spp = 256;
        stage_need(itn_refine(scene, theta, target, &parameter, 1, &options, many, &error), &error);
        errors[0] += few->standard_error / SEEDS, errors[1] += many->standard_error / SEEDS;
    }
    few->standard_error = errors[0], many->standard_error = errors[1];
    if (getenv("SHOW"))
        printf("final_spp: .8 is %g +- %g, then %g +- %g\n", few->value, few->standard_error,
               many->value, many->standard_error);
    itn_scene_free(scene);
}
/* factor: planted, of the second's error bar. */
static void test_final_spp(double factor) {
    static itn_estimate few, many;
    const double expected = sqrt((1 / 40. + 1 / 1024.) / (1 / 256. + 1 / 1024.));
    if (few.standard_error == 0) run_final_spp(&few, &many); /* once */
    CHECK_NEAR(few.standard_error / (many.standard_error * factor), expected, .4);
    CHECK_NEAR(few.value, .8, 4 * few.standard_error);
    CHECK_NEAR(many.value, .8, 4 * many.standard_error);
}

enum { SEARCHES = 5 };

/* Searches for three parameters with three samples a pixel, the end where the caller wants it (way 0)
   and where the searches themselves do (1). g: [2][SEARCHES], what they say. */
static void run_searches(itn_estimate g[2][SEARCHES]) {
    static const char *const names[] = {"m.sigma_t", "m.albedo", "m.g"};
    static const float start[] = {6, .8f, .2f};
    static float target[PIXELS], variance[PIXELS];
    itn_scene *scene = cloud(4, .9, .4);
    itn_refine_options options = ITN_ZERO;
    itn_estimate estimates[3];
    itn_error error;
    float theta[8];
    int parameters[3], seed, way, k;
    find_parameters(scene, names, 3, parameters);
    photograph(scene, 1024, 7, target, variance);
    options.spp = 3, options.target_variance = variance;
    for (way = 0; way < 2; way++)
        for (seed = 0; seed < SEARCHES; seed++) {
            options.final_spp = way ? 0 : 8 * options.spp, options.seed = (uint64_t)seed;
            itn_parameter_values(scene, theta);
            for (k = 0; k < 3; k++) theta[parameters[k]] = start[k];
            stage_need(itn_refine(scene, theta, target, parameters, 3, &options, estimates,
                                  &error), &error);
            g[way][seed] = estimates[2];
            if (getenv("SHOW"))
                printf("more samples %d: .4 is %g +- %g (%d)\n", way, estimates[2].value,
                       estimates[2].standard_error, estimates[2].determined);
        }
    itn_scene_free(scene);
}

/* As behind rough glass, the usual end does not tell all of them: asked for it, searches say so; left
   to themselves they take more samples, and find what was hidden. hidden: .4, or planted. */
static void test_more_samples(double hidden) {
    static itn_estimate g[2][SEARCHES];
    int determined[2] = {0, 0}, way, i;
    if (g[0][0].standard_error == 0) run_searches(g); /* once */
    for (way = 0; way < 2; way++)
        for (i = 0; i < SEARCHES; i++) {
            determined[way] += g[way][i].determined;
            CHECK_NEAR(g[way][i].value, hidden, 4 * g[way][i].standard_error);
        }
    CHECK(determined[0] <= 2 && determined[1] >= 4);
}

/* ---- what a picture does not tell ------------------------------------------------------------------ */

/* Deep inside a very thick black ball nothing depends on sigma_t: flagged. The albedo of the same
   ball is plain to see, always found, and nearly always known to be: sigma_t is let go. Of four
   searches one may end where sigma_t is so low that it shows. */
static void test_undetermined(void) {
    static const char *const names[] = {"m.sigma_t", "m.albedo"};
    itn_scene *scene = cloud(3000, .8, 0);
    static float target[PIXELS], variance[PIXELS];
    itn_refine_options options = ITN_ZERO;
    itn_estimate estimates[2];
    itn_error error;
    float theta[8];
    const int seeds = check_long() ? 12 : 4;
    int parameters[2], seed, flagged = 0, plain = 0;
    find_parameters(scene, names, 2, parameters);
    photograph(scene, 256, 7, target, variance);
    for (seed = 0; seed < seeds; seed++) {
        itn_parameter_values(scene, theta);
        theta[parameters[0]] = 1000, theta[parameters[1]] = .7f;
        options.spp = 4, options.seed = (uint64_t)seed, options.iterations = 6;
        options.target_variance = variance;
        stage_need(itn_refine(scene, theta, target, parameters, 2, &options, estimates, &error),
                   &error);
        flagged += !estimates[0].determined;
        plain += estimates[1].determined;
        CHECK(fabs(estimates[1].value - .8) < fmin(.03, 4 * estimates[1].standard_error));
        CHECK(theta[parameters[0]] > 0 && itn__finite(theta[parameters[0]]));
        if (getenv("SHOW"))
            printf("thick: sigma_t %g +- %g (%d), albedo %g +- %g\n", estimates[0].value,
                   estimates[0].standard_error, estimates[0].determined, estimates[1].value,
                   estimates[1].standard_error);
    }
    CHECK(flagged == seeds && plain >= seeds * 3 / 4);
    itn_scene_free(scene);
}

/* A picture so noisy that it says nothing leaves the start as it was, but not as a result. */
static void test_noisy(void) {
    static const char *const albedo[] = {"m.albedo"};
    static const float noises[] = {1e3f, 1e5f, 1e7f, 1e9f};
    itn_scene *scene = cloud(2, .8, 0);
    static float target[PIXELS], variance[PIXELS];
    int parameter, i, k;
    find_parameters(scene, albedo, 1, &parameter);
    photograph(scene, 64, 7, target, variance);
    for (k = 0; k < 4; k++) {
        itn_refine_options options = ITN_ZERO;
        itn_estimate estimate;
        itn_error error;
        float theta[8];
        for (i = 0; i < PIXELS; i++) variance[i] = noises[k];
        itn_parameter_values(scene, theta);
        theta[parameter] = .3f, options.spp = 8, options.target_variance = variance;
        stage_need(itn_refine(scene, theta, target, &parameter, 1, &options, &estimate, &error),
                   &error);
        CHECK(!estimate.determined && fabs(estimate.value - .8) < 4 * estimate.standard_error);
    }
    itn_scene_free(scene);
}

/* The noise of a misfit is how much it differs from seed to seed, also where the picture does not
   fit. factor: planted. */
static void test_misfit_noise(double factor) {
    enum { SEEDS = 40 };
    static float target[PIXELS];
    const float start = .8f;
    itn_scene *scene = cloud(2, .8, 0);
    double mean = 0, square = 0, claimed = 0;
    int parameter = itn_parameter_find(scene, "m.albedo"), i;
    itn_view view = ITN_ZERO;
    itn__refiner refiner;
    for (i = 0; i < PIXELS; i++) target[i] = (float)(i % SIZE) / SIZE;
    view.scene = scene, view.target = target, view.parameters = &parameter;
    begin_search(&refiner, &view, 1, &start, 4);
    evaluate_anew(&refiner);
    for (i = 0; i < SEEDS; i++) {
        itn__misfit misfit;
        itn_error error;
        stage_need(itn__refine_evaluate(&refiner, 4, &error), &error);
        itn__misfit_of(&refiner, 1, &misfit);
        mean += misfit.excess / SEEDS, square += misfit.excess * misfit.excess / SEEDS;
        claimed += factor * misfit.noise / SEEDS;
    }
    square -= mean * mean; /* within 3 of its standard errors, sqrt(2 / SEEDS) */
    check_report(square > .4 * claimed && square < 1.7 * claimed, __FILE__, __LINE__,
                 "variance of the misfit %g, by its noise %g", square, claimed);
    if (getenv("SHOW")) printf("misfit %g, variance %g, %g\n", mean, square, claimed);
    end_search(&refiner);
    itn_scene_free(scene);
}

/* A parameter that nothing depends on stays where it is, and is flagged. */
static void test_idle(void) {
    itn_scene *scene;
    itn_mesh mesh = solids_sphere(1, 1);
    static float target[PIXELS], variance[PIXELS];
    itn_refine_options options = ITN_ZERO;
    itn_estimate estimates[2];
    itn_error error;
    float theta[16];
    int parameters[2];
    stage s;
    stage_begin(&s, SIZE, 4, 32);
    stage_medium(&s, "m", 2, .8, 0);
    stage_medium(&s, "unused", 2, .8, 0);
    stage_object(&s, &mesh, "m", NULL);
    stage_constant(&s, NULL, 1);
    scene = stage_make(&s);
    photograph(scene, 256, 7, target, variance);
    parameters[0] = itn_parameter_find(scene, "unused.albedo");
    parameters[1] = itn_parameter_find(scene, "m.albedo");
    itn_parameter_values(scene, theta);
    theta[parameters[1]] = .5f;
    options.spp = 32;
    stage_need(itn_refine(scene, theta, target, parameters, 2, &options, estimates, &error),
               &error);
    CHECK(!estimates[0].determined && estimates[1].determined);
    CHECK_NEAR(theta[parameters[0]], .8, 1e-6);
    CHECK_NEAR(theta[parameters[1]], .8, 4 * estimates[1].standard_error);
    itn_scene_free(scene);
    itn_mesh_free(&mesh);
}

/* Nor does it end a search for others early: they are found as if it were not asked for. planted:
   seconds, after which it ends; 0: what is usual. */
static void test_idle_and_others(double planted) {
    static const char *const names[] = {"m.sigma_t", "m.albedo", "m.g", "unused.sigma_t"};
    static const double truth[3] = {3, .9, .5}, start[3] = {1, .6, 0};
    static float target[PIXELS], variance[PIXELS];
    itn_mesh mesh = solids_box(solids_vec3(-.5, -.5, -.5), solids_vec3(.5, .5, .5));
    itn_refine_options options = ITN_ZERO;
    itn_estimate estimates[4];
    itn_scene *scene;
    itn_error error;
    itn_refine_outcome outcome;
    float theta[16];
    int parameters[4], k;
    stage s;
    stage_begin(&s, 8, 4, 25);
    s.desc.camera.eye = solids_vec3(1.5, 1.5, 2.5);
    stage_medium(&s, "m", truth[0], truth[1], truth[2]);
    stage_medium(&s, "unused", 2, .8, 0);
    stage_object(&s, &mesh, "m", NULL);
    stage_constant(&s, NULL, 1);
    scene = stage_make(&s);
    find_parameters(scene, names, 4, parameters);
    photograph(scene, 1024, 7, target, variance);
    itn_parameter_values(scene, theta);
    for (k = 0; k < 3; k++) theta[parameters[k]] = (float)start[k];
    options.spp = 128, options.final_spp = 256, options.seed = 3;
    options.target_variance = variance, options.outcome = &outcome, options.seconds = planted;
    stage_need(itn_refine(scene, theta, target, parameters, 4, &options, estimates, &error),
               &error);
    if (getenv("SHOW"))
        printf("idle: misfit %.2f, sigma_t %g +- %g (%d), albedo %g +- %g (%d)\n", outcome.misfit,
               estimates[0].value, estimates[0].standard_error, estimates[0].determined,
               estimates[1].value, estimates[1].standard_error, estimates[1].determined);
    CHECK(outcome.finished && outcome.explained && outcome.misfit < 2.5);
    for (k = 0; k < 3; k++)
        CHECK(fabs(estimates[k].value - truth[k]) < 4 * estimates[k].standard_error);
    itn_scene_free(scene);
    itn_mesh_free(&mesh);
}

/* The scale of a noisy picture's light, beside a larger clean picture of another light, has the error
   that it has alone, whether the clean one's noise is known or not. planted: what it is times. */
static void test_noisy_view(double planted) {
    enum { LARGE = 2 * SIZE };
    static float target[2][LARGE * LARGE], variance[2][LARGE * LARGE];
    static double error[3];
    itn_scene *scenes[2];
    itn_view views[2];
    int parameters[2][2], v, k, way;
    memset(views, 0, sizeof views);
    for (v = 0; v < 2; v++) {
        scenes[v] = lit_cloud(v ? SIZE : LARGE, .65, 1, 2, .8, .4);
        photograph(scenes[v], 256, 50 + (uint64_t)v, target[v], variance[v]);
        parameters[v][v] = itn_parameter_find(scenes[v], "light.scale");
        parameters[v][1 - v] = -1;
        views[v].scene = scenes[v], views[v].target = target[v];
        views[v].parameters = parameters[v];
    }
    for (k = 0; k < PIXELS; k++) target[1][k] += (float)(.1 * drawn_normal(100, k));
    for (way = 0; way < 3 && !(error[way] > 0); way++) { /* alone, beside one that is known, or not */
        itn_refine_options options = ITN_ZERO;
        itn_estimate estimates[2];
        itn_error why;
        float values[2] = {1.1f, 1.1f};
        int alone = parameters[1][1];
        options.spp = 4, options.final_spp = 16, options.iterations = 3;
        views[0].target_variance = way == 1 ? variance[0] : NULL;
        views[1].parameters = way ? parameters[1] : &alone;
        stage_need(itn_refine_views(way ? views : views + 1, 1 + !!way, way ? values : values + 1,
                                    1 + !!way, &options, way ? estimates : estimates + 1, &why),
                   &why);
        error[way] = estimates[1].standard_error;
        if (getenv("SHOW"))
            printf("noisy view: %g +- %g\n", estimates[1].value, estimates[1].standard_error);
    }
    for (way = 1; way < 3; way++)
        check_report(fabs(log(error[way] / error[0] * planted)) < .25, __FILE__, __LINE__,
                     "noisy view: error %g beside another, %g alone", error[way], error[0]);
    for (v = 0; v < 2; v++) itn_scene_free(scenes[v]);
}

/* Noise that is the same in all pixels, though that of the renders is not: error bars are those of
   known noise when it is not known, of three unknowns that a picture tells well. planted: factor of
   the noise where it is known. */
static void test_even_noise(double planted) {
    static const char *const names[] = {"m.sigma_t", "m.albedo", "m.g"};
    static float target[400], variance[400], noise[400];
    const int fits = check_long() ? 6 : 3;
    double ratios[3] = {0, 0, 0}, mean = 0;
    int parameters[3], i, k, known, fit;
    itn_scene *scene;
    itn_error why;
    FILE *file = fopen("build/even.itn", "w");
    if (!CHECK(file != NULL)) return;
    fputs("film width 20 height 20\ncamera eye 0.5 0.5 4.2 target 0 0 0 fov 26\n"
          "medium m sigma_t 1.5 albedo 0.7 g -0.6\n"
          "object mesh ../../scenes/shapes/cube.ply medium m\n"
          "light sky ../../scenes/t3-e60.sky sun 0.42 0.866 -0.27 sun_scale 2 "
          "sun_radius_scale 20\n", file);
    fclose(file);
    stage_need(itn_scene_load("build/even.itn", NULL, &scene, &why), &why);
    find_parameters(scene, names, 3, parameters);
    photograph(scene, 4096, 7, target, variance);
    for (i = 0; i < 400; i++) mean += target[i] / 400;
    for (fit = 0; fit < fits; fit++) {
        static itn_estimate unknown[6][3]; /* the same whatever is planted */
        itn_estimate estimates[2][3];
        memcpy(estimates[0], unknown[fit], sizeof unknown[fit]);
        for (known = estimates[0][0].standard_error > 0; known < 2; known++) {
            itn_refine_options options = ITN_ZERO;
            float theta[16], picture[400];
            itn_error error;
            for (i = 0; i < 400; i++) {
                picture[i] = target[i] + (float)((known ? planted : 1) * .05 * mean *
                                                 drawn_normal(100 + fit, i));
                noise[i] = (float)pow(.05 * mean, 2);
            }
            itn_parameter_values(scene, theta);
            options.spp = 32, options.final_spp = 400, options.seed = (uint64_t)fit + 1;
            if (known) options.target_variance = noise;
            stage_need(itn_refine(scene, theta, picture, parameters, 3, &options,
                                  estimates[known], &error), &error);
        }
        memcpy(unknown[fit], estimates[0], sizeof unknown[fit]);
        for (k = 0; k < 3; k++)
            ratios[k] += estimates[0][k].standard_error / estimates[1][k].standard_error / fits;
        if (getenv("SHOW"))
            printf("even noise: sigma_t %g +- %g, %g +- %g, g %g +- %g, %g +- %g\n",
                   estimates[0][0].value, estimates[0][0].standard_error, estimates[1][0].value,
                   estimates[1][0].standard_error, estimates[0][2].value,
                   estimates[0][2].standard_error, estimates[1][2].value,
                   estimates[1][2].standard_error);
    }
    for (k = 0; k < 3; k++)
        check_report(fabs(log(ratios[k])) < .2, __FILE__, __LINE__,
                     "%s: unknown noise makes the error %.2f times as large", names[k], ratios[k]);
    itn_scene_free(scene);
    remove("build/even.itn");
}

static int note_values(void *user, const itn_refine_step *step) {
    if (step->fraction == 1) *(float *)user = step->values[0];
    CHECK(step->values[0] == step->theta[1]); /* m.albedo */
    return 0;
}

/* A picture of light that has scattered once, by renders of such light; with more scatterings no
   albedo makes it. scatter: 1, or another as planted error. */
static void test_single_scattering(int scatter) {
    static float target[PIXELS], variance[PIXELS];
    itn_scene *scene = cloud(2, .8f, .4f);
    itn_render_options render = ITN_ZERO;
    itn_refine_options options = ITN_ZERO;
    itn_image image = ITN_ZERO;
    itn_estimate estimate;
    itn_error error;
    float theta[8], last = 0;
    itn_refine_outcome outcome = ITN_ZERO;
    int albedo = itn_parameter_find(scene, "m.albedo"), i;
    render.spp = 512, render.max_scatter = 1, render.seed = 7;
    stage_need(itn_render(scene, NULL, &render, NULL, 0, &image, &error), &error);
    for (i = 0; i < PIXELS; i++) target[i] = image.pixels[i], variance[i] = image.pixels[PIXELS + i];
    itn_image_free(&image);
    itn_parameter_values(scene, theta);
    theta[albedo] = .6f;
    options.spp = 64, options.iterations = 8, options.max_scatter = scatter;
    options.target_variance = variance, options.outcome = &outcome;
    options.progress = note_values, options.progress_user = &last;
    stage_need(itn_refine(scene, theta, target, &albedo, 1, &options, &estimate, &error), &error);
    CHECK(albedo == 1 && outcome.misfit < 2 && last > .6f);
    CHECK_MEAN(estimate.value, estimate.standard_error, .8, 4, .01);
    itn_parameter_values(scene, theta);
    theta[itn_parameter_find(scene, "m.sigma_t")] = 6;
    CHECK_NEAR(itn_scene_thickness(scene, theta, "m"), 3 * itn_scene_thickness(scene, NULL, "m"),
               1e-6);
    itn_scene_free(scene);
}

static int count_steps(void *user, const itn_refine_step *step) {
    int *next = (int *)user;
    CHECK(step->iteration == *next);
    *next += step->fraction == 1;
    return 0;
}

/* A thin cloud that scatters back, from a start that scatters ahead: a search from there ends
   far from the picture, in a valley that goes on to dense clouds; one from the mirror image finds
   the truth, here at least 2 of 3, whether the picture's noise is known or not. side: 1, or, as
   planted error, which sign of g is expected. */
static void test_wrong_valley(int side, int informed) {
    enum { SEEDS = 3 };
    static const char *const names[] = {"m.sigma_t", "m.albedo", "m.g"};
    const double truth[3] = {1.5, .7, -.7 * side}, start[3] = {1.05, .665, .63};
    static float target[PIXELS], variance[PIXELS];
    itn_scene *scene = lit_cloud(SIZE, .25, 1, 1.5, .7, -.7);
    itn_refine_options options = ITN_ZERO;
    itn_estimate estimates[3];
    itn_error error;
    float theta[8];
    itn_refine_outcome outcome;
    int parameters[3], seed, steps, right = 0, k;
    photograph(scene, 1024, 7, target, variance);
    find_parameters(scene, names, 3, parameters);
    options.spp = 32, options.iterations = 12, options.outcome = &outcome;
    options.final_spp = usual_end(options.spp);
    options.target_variance = informed ? variance : NULL;
    options.progress = count_steps, options.progress_user = &steps;
    /* until it is clear */
    for (seed = 0; seed < SEEDS && (check_long() || (right < 2 && seed < right + 2)); seed++) {
        int found = 1;
        itn_parameter_values(scene, theta);
        for (k = 0; k < 3; k++) theta[parameters[k]] = (float)start[k];
        options.seed = (uint64_t)seed, steps = 0;
        stage_need(itn_refine(scene, theta, target, parameters, 3, &options, estimates, &error),
                   &error);
        if (getenv("SHOW")) printf("wrong valley: %d steps, misfit %.2f\n", steps, outcome.misfit);
        for (k = 0; k < 3; k++)
            found &= estimates[k].determined && estimates[k].standard_error < .1 &&
                     fabs(estimates[k].value - truth[k]) < 4 * estimates[k].standard_error;
        right += found && outcome.misfit < 2;
    }
    check_report(right >= 2, __FILE__, __LINE__, "wrong valley: %d of %d", right, seed);
    itn_scene_free(scene);
}

/* Pictures that no parameter can make drive the walk to its bounds, and not beyond. */
static void test_bounds(void) {
#ifdef ITN_SANITIZED
    const int stride = 3; /* sanitizers look at other things */
#else
    const int stride = 1;
#endif
    static const char *const names[] = {"m.sigma_t", "m.albedo", "m.g"};
    itn_scene *scene = cloud(2, .5, 0);
    static float target[PIXELS];
    static const float levels[] = {0, 50, -5, 1e6f};
    int parameters[3], i, k;
    find_parameters(scene, names, 3, parameters);
    for (k = 0; k < 4; k += stride) {
        itn_refine_options options = ITN_ZERO;
        itn_estimate estimates[3];
        itn_error error;
        watch w = ITN_ZERO;
        float theta[8];
        for (i = 0; i < PIXELS; i++) target[i] = levels[k];
        itn_parameter_values(scene, theta);
        w.scene = scene;
        options.iterations = 8, options.spp = 2;
        options.max_scatter = 30;
        options.progress = watch_step, options.progress_user = &w;
        stage_need(itn_refine(scene, theta, target, parameters, 3, &options, estimates,
                              &error), &error);
        CHECK(w.outside == 0);
        for (i = 0; i < 3; i++) {
            const itn_parameter *p = itn_parameter_get(scene, parameters[i]);
            CHECK(theta[parameters[i]] >= p->lower && theta[parameters[i]] <= p->upper);
            CHECK(itn__finite(estimates[i].value) && itn__finite(estimates[i].standard_error));
        }
    }
    itn_scene_free(scene);
}

/* ---- in words ---------------------------------------------------------------------------------------- */

/* A covariance made so that ln sigma_t + .5 ln(1 - g) is known to 1 %, the other direction to 40 %,
   and the albedo by itself: the words say so, in any buffer. planted: exchanges the directions. */
static void test_words(int planted) {
    static const char *const names[] = {"m.sigma_t", "m.albedo", "m.g"};
    itn_scene *scene = cloud(20, .8, .4);
    const itn_parameter *p[3];
    itn_estimate e[3];
    double known = planted ? .4 : .01, rest = planted ? .01 : .4, n = 1.25, covariance[9];
    double one[2] = {1, .5}, other[2] = {-.5, 1}, slopes[2] = {20, -.6};
    char text[1000], cut[1000];
    int i, j, length;
    memset(covariance, 0, sizeof covariance);
    for (i = 0; i < 2; i++)
        for (j = 0; j < 2; j++)
            covariance[6 * i + 2 * j] = slopes[i] * slopes[j] *
                                        (known * known * one[i] * one[j] +
                                         rest * rest * other[i] * other[j]) / (n * n);
    covariance[4] = .0009 * .0009;
    for (i = 0; i < 3; i++) {
        p[i] = itn_parameter_get(scene, itn_parameter_find(scene, names[i]));
        e[i].value = p[i]->value, e[i].standard_error = sqrt(covariance[4 * i]);
        e[i].determined = i != 2;
    }
    length = itn_refine_words(p, 3, e, covariance, NULL, text, sizeof text);
    CHECK(length == (int)strlen(text));
    check_report(!strcmp(text, "m.albedo is determined: to +-0.0009\n"
                               "m.sigma_t and m.g are determined only together: m.sigma_t "
                               "(1-m.g)^0.5 to 1 %, but m.sigma_t alone to 16 %, m.g alone to "
                               "+-0.19\n"), __FILE__, __LINE__, "words: %s", text);
    e[0].value *= 1e-9, e[0].standard_error *= 1e-9; /* in another unit of length: the same words */
    for (i = 0; i < 3; i++) covariance[i] *= 1e-9, covariance[3 * i] *= 1e-9;
    itn_refine_words(p, 3, e, covariance, NULL, cut, sizeof cut);
    check_report(!strcmp(text, cut), __FILE__, __LINE__, "words: %s", cut);
    for (i = 0; i < 3; i++) covariance[i] *= 1e9, covariance[3 * i] *= 1e9;
    e[0].value *= 1e9, e[0].standard_error *= 1e9;
    for (i = 0; i <= length + 1; i++) {
        memset(cut, 'x', sizeof cut);
        CHECK(itn_refine_words(p, 3, e, covariance, NULL, i ? cut : NULL, (size_t)i) == length);
        CHECK(cut[i] == 'x' && (i == 0 || strlen(cut) == (size_t)(i <= length ? i - 1 : length)));
        CHECK(i == 0 || !memcmp(cut, text, strlen(cut)));
    }
    e[2].determined = 1;
    itn_refine_words(p, 3, e, covariance, NULL, cut, sizeof cut);
    CHECK(strstr(cut, "m.sigma_t and m.g are determined, best together: m.sigma_t (1-m.g)^0.5 to "
                      "1 %; m.sigma_t alone to 16 %, m.g alone to +-0.19\n") != NULL);
    covariance[2] = covariance[6] = 0, e[0].determined = 0;
    itn_refine_words(p, 3, e, covariance, NULL, text, sizeof text);
    CHECK(strstr(text, "m.sigma_t is hardly determined: to 16 %\n") == text);
    CHECK(!strstr(text, "together") && strstr(text, "m.g is determined: to +-0.19\n"));
    CHECK(itn_refine_words(p, 1, e, covariance, NULL, text, sizeof text) > 0);
    CHECK(itn_refine_words(NULL, 3, e, covariance, NULL, text, sizeof text) == -1);
    CHECK(itn_refine_words(p, 3, NULL, covariance, NULL, text, sizeof text) == -1);
    CHECK(itn_refine_words(p, 3, e, NULL, NULL, text, sizeof text) == -1);
    CHECK(itn_refine_words(p, 3, e, covariance, NULL, NULL, 1) == -1);
    CHECK(itn_refine_words(p, 0, e, covariance, NULL, text, sizeof text) == -1);
    CHECK(itn_refine_words(p, 33, e, covariance, NULL, text, sizeof text) == -1);
    e[1].standard_error = INFINITY;
    CHECK(itn_refine_words(p, 3, e, covariance, NULL, text, sizeof text) == -1);
    e[1].standard_error = -1;
    CHECK(itn_refine_words(p, 3, e, covariance, NULL, text, sizeof text) == -1);
    e[1].standard_error = .0009, covariance[4] = NAN;
    CHECK(itn_refine_words(p, 3, e, covariance, NULL, text, sizeof text) == -1);
    p[1] = NULL;
    CHECK(itn_refine_words(p, 3, e, covariance, NULL, text, sizeof text) == -1);
    itn_scene_free(scene);
}

/* Two media, each with sigma_t and g that only their product tells, have a line each, as products
   of their own; an albedo between them, told by itself, comes first. tie: correlation between them,
   beyond .4 all four are one group. */
static void test_words_of_two(double tie) {
    static const char *const names[] = {"m.sigma_t", "m.g", "m.albedo", "m.sigma_t", "m.g"};
    itn_scene *scene = cloud(20, .8, .4);
    const itn_parameter *p[5];
    itn_estimate e[5];
    double slopes[5] = {20, -.6, 1, 20, -.6}, covariance[25];
    char text[1000];
    int i, j;
    for (i = 0; i < 25; i++) { /* in logarithms: of variance 1, g's against sigma_t's */
        int row = i / 5, column = i % 5;
        double c = row == column ? 1 : (row < 2) != (column < 2) ? .999 * tie : .999;
        if ((row % 3 == 1) != (column % 3 == 1)) c = -c;
        covariance[i] = .16 * c * slopes[row] * slopes[column];
    }
    for (i = 0; i < 5; i++)
        for (j = 0; j < 5; j++)
            if ((i == 2) != (j == 2)) covariance[5 * i + j] = 0;
    covariance[12] = .0009 * .0009;
    for (i = 0; i < 5; i++) {
        p[i] = itn_parameter_get(scene, itn_parameter_find(scene, names[i]));
        e[i].value = p[i]->value, e[i].standard_error = sqrt(covariance[6 * i]);
        e[i].determined = i == 2;
    }
    CHECK(itn_refine_words(p, 5, e, covariance, NULL, text, sizeof text) > 0);
    check_report(!strcmp(text, "m.albedo is determined: to +-0.0009\n"
                               "m.sigma_t and m.g are determined only together: m.sigma_t (1-m.g) "
                               "to 1.8 %, but m.sigma_t alone to 40 %, m.g alone to +-0.24\n"
                               "m.sigma_t and m.g are determined only together: m.sigma_t (1-m.g) "
                               "to 1.8 %, but m.sigma_t alone to 40 %, m.g alone to +-0.24\n"),
                 __FILE__, __LINE__, "words: %s", text);
    itn_scene_free(scene);
}

/* Eigenvectors of a symmetric matrix: A v = lambda v, v orthonormal. */
static void test_eigen(void) {
    enum { N = 7 };
    double a[N * N], kept[N * N], v[N * N];
    int i, j, k;
    for (i = 0; i < N; i++)
        for (j = 0; j <= i; j++) {
            double x = sin(3. * i + 7 * j * j + 1) * pow(10, -.5 * (i + j));
            a[i * N + j] = a[j * N + i] = i == j ? 1 + x : x;
        }
    memcpy(kept, a, sizeof kept);
    itn__eigen(a, v, N);
    for (i = 0; i < N; i++)
        for (j = 0; j < N; j++) {
            double product = 0, dot = 0;
            for (k = 0; k < N; k++)
                product += kept[i * N + k] * v[k * N + j], dot += v[k * N + i] * v[k * N + j];
            CHECK_NEAR(product, a[j * N + j] * v[i * N + j], 1e-13);
            CHECK_NEAR(dot, i == j, 1e-13);
        }
}

/* ---- options ----------------------------------------------------------------------------------------- */

/* What is refused, and that it leaves theta and the estimates alone. */
static void test_options(void) {
    itn_scene *scene = cloud(2, .8, .4);
    static float target[PIXELS], variance[PIXELS];
    itn_refine_options options;
    itn_error error;
    float theta[8], before[8];
    itn_estimate estimates[2], untouched[2];
    int parameters[2], twice[2], wrong[1], k;
    watch w = ITN_ZERO;
    parameters[0] = itn_parameter_find(scene, "m.albedo");
    parameters[1] = itn_parameter_find(scene, "m.g");
    twice[0] = twice[1] = parameters[0];
    w.scene = scene;
    itn_parameter_values(scene, theta);
    memcpy(before, theta, sizeof theta);
    memset(estimates, 0x5a, sizeof estimates);
    memcpy(untouched, estimates, sizeof estimates);
    for (k = 0; k < PIXELS; k++) target[k] = .3f, variance[k] = .01f;
#define REFUSES(wanted, scene, theta, target, parameters, count, estimates)                        \
    do {                                                                                           \
        itn_result got;                                                                            \
        memset(&error, 0, sizeof error);                                                           \
        memcpy(theta_kept, before, sizeof before);                                                 \
        memcpy(estimates_kept, untouched, sizeof untouched);                                       \
        got = itn_refine(scene, theta, target, parameters, count, &options, estimates, &error);    \
        CHECK(got == (wanted) && error.code == (wanted) && error.message[0]);                      \
        CHECK(!memcmp(before, theta_kept, sizeof before));                                      \
        CHECK(!memcmp(untouched, estimates_kept, sizeof untouched));                            \
    } while (0)
#define REFUSES_OPTION(assignment)                                                                 \
    do {                                                                                           \
        memset(&options, 0, sizeof options);                                                       \
        options.spp = 4, options.iterations = 2;                                                   \
        assignment;                                                                                \
        REFUSES(ITN_ERROR_ARGUMENT, scene, theta, target, parameters, 2, estimates);               \
    } while (0)
    {
        float *theta_kept = theta;
        itn_estimate *estimates_kept = estimates;
        REFUSES_OPTION(options.spp = -1);
        REFUSES_OPTION(options.spp = 1);
        REFUSES_OPTION(options.spp = INT_MAX);
        REFUSES_OPTION(options.spp = 524288); /* more could be too many for the last renders */
        REFUSES_OPTION(options.final_spp = 67108864);
        REFUSES_OPTION(options.final_spp = -1);
        REFUSES_OPTION(options.final_spp = INT_MAX);
        REFUSES_OPTION(options.iterations = -1);
        REFUSES_OPTION(options.max_scatter = -1);
        REFUSES_OPTION(options.seconds = -1);
        REFUSES_OPTION(options.seconds = NAN);
        REFUSES_OPTION((options.target_variance = variance, variance[17] = -1));
        REFUSES_OPTION((options.target_variance = variance, variance[17] = NAN));
        variance[17] = .01f;
        memset(&options, 0, sizeof options);
        options.spp = 4, options.iterations = 2;
        REFUSES(ITN_ERROR_ARGUMENT, NULL, theta, target, parameters, 2, estimates);
        REFUSES(ITN_ERROR_ARGUMENT, scene, NULL, target, parameters, 2, estimates);
        REFUSES(ITN_ERROR_ARGUMENT, scene, theta, NULL, parameters, 2, estimates);
        REFUSES(ITN_ERROR_ARGUMENT, scene, theta, target, NULL, 2, estimates);
        REFUSES(ITN_ERROR_ARGUMENT, scene, theta, target, parameters, 2, NULL);
        REFUSES(ITN_ERROR_ARGUMENT, scene, theta, target, parameters, 0, estimates);
        REFUSES(ITN_ERROR_ARGUMENT, scene, theta, target, parameters, -1, estimates);
        REFUSES(ITN_ERROR_ARGUMENT, scene, theta, target, twice, 2, estimates);
        wrong[0] = -1;
        REFUSES(ITN_ERROR_ARGUMENT, scene, theta, target, wrong, 1, estimates);
        wrong[0] = itn_parameter_count(scene);
        REFUSES(ITN_ERROR_ARGUMENT, scene, theta, target, wrong, 1, estimates);
        target[3] = NAN;
        REFUSES(ITN_ERROR_ARGUMENT, scene, theta, target, parameters, 2, estimates);
        target[3] = INFINITY;
        REFUSES(ITN_ERROR_ARGUMENT, scene, theta, target, parameters, 2, estimates);
        target[3] = .3f;
        options.progress = watch_step, options.progress_user = &w;
        for (k = 1; k <= 3; k++) {
            w.calls = 0, w.cancel_at = k, w.how = -1;
            REFUSES(ITN_ERROR_CANCELLED, scene, theta, target, parameters, 2, estimates);
            CHECK(w.calls == k);
        }
        w.calls = w.cancel_at = w.within = 0, w.within_at = 3; /* in the first render */
        REFUSES(ITN_ERROR_CANCELLED, scene, theta, target, parameters, 2, estimates);
        CHECK(w.calls == 0 && w.within == 3);
        options.progress = NULL;
        { /* start values out of range, refined or not */
            static const char *const names[] = {"m.albedo", "m.g", "m.sigma_t", "light.scale"};
            static const float bad[] = {-1, 2, NAN, INFINITY};
            int i;
            for (k = 0; k < 4; k++)
                for (i = 0; i < 4; i++) {
                    float start[8], kept[8];
                    int own = itn_parameter_find(scene, names[k]), refined;
                    if (k >= 2 && i == 1) continue; /* 2 is a fine sigma_t and scale */
                    for (refined = 0; refined < 2; refined++) {
                        int asked = refined ? own : parameters[k == 0];
                        memcpy(start, before, sizeof start);
                        start[own] = bad[i];
                        memcpy(kept, start, sizeof kept);
                        check_report(itn_refine(scene, start, target, &asked, 1, &options,
                                                estimates, &error) == ITN_ERROR_ARGUMENT &&
                                         !memcmp(kept, start, sizeof kept),
                                     __FILE__, __LINE__, "start at %s = %g (refined: %d) accepted",
                                     names[k], (double)bad[i], refined);
                    }
                }
        }
        itn_scene_free(scene);
        scene = lit_cloud(4, .65, 1, 2, .8, .4); /* small: this one is searched in */
        CHECK(itn_refine(scene, theta, target, parameters, 1, NULL, estimates, NULL) == ITN_OK);
    }
    itn_scene_free(scene);
}

/* A search that the caller or the clock ends gives the answer so far, and says that it is not
   finished; where nothing has been evaluated, nothing is determined. planted: it goes on. */
static void test_ends(int planted) {
    static const char *const names[] = {"m.albedo", "m.g"};
    static float target[PIXELS], variance[PIXELS];
    itn_scene *scene = cloud(2, .8, .4);
    int parameters[2], way, k;
    photograph(scene, 256, 7, target, variance);
    find_parameters(scene, names, 2, parameters);
    for (way = 0; way < 4; way++) { /* by the caller, before anything, by nobody, within a render */
        itn_refine_options options = ITN_ZERO;
        itn_refine_outcome outcome;
        itn_estimate estimates[2];
        itn_error error;
        watch w = ITN_ZERO;
        float theta[8];
        itn_parameter_values(scene, theta);
        theta[parameters[0]] = .7f, theta[parameters[1]] = .2f;
        w.scene = scene, w.cancel_at = way == 0 && !planted ? 2 : 0, w.how = 1;
        options.spp = 16, options.target_variance = variance, options.outcome = &outcome;
        if (way == 3 && !planted) w.cancel_at = 2, w.within_at = 1;
        options.seconds = way == 1 && !planted ? 1e-9 : 0;
        options.progress = watch_step, options.progress_user = &w;
        stage_need(itn_refine(scene, theta, target, parameters, 2, &options, estimates, &error),
                   &error);
        CHECK(outcome.finished == (way == 2));
        CHECK(w.calls == (way == 1 ? 0 : 2) || (way == 2 && w.calls > 2));
        CHECK(way != 2 || w.within > 2 * w.calls);
        for (k = 0; k < 2; k++) {
            double off = estimates[k].value - itn_parameter_get(scene, parameters[k])->value;
            CHECK(fabs(off) < 4 * estimates[k].standard_error);
            CHECK(way != 1 || !estimates[k].determined);
            CHECK(way != 2 || estimates[k].determined);
        }
    }
    itn_scene_free(scene);
}

/* Where a first evaluation takes too long the search goes on from a medium a tenth as dense, else from
   where it was, and has not ended. planted: factor of what is expected. */
static void test_retreat(double planted) {
    static const char *const names[] = {"m.sigma_t", "m.albedo", "m.g"};
    static const float values[3] = {4e4f, .9f, .5f};
    static float target[PIXELS];
    itn_scene *scene = cloud(2, .8, .4);
    itn_view view = ITN_ZERO;
    itn__refiner refiner;
    int parameters[3], known;
    double start[3];
    find_parameters(scene, names, 3, parameters);
    target[0] = 1;
    view.scene = scene, view.target = target, view.parameters = parameters;
    begin_search(&refiner, &view, 3, values, 4);
    memcpy(start, refiner.coordinates, sizeof start);
    for (known = 0; known < 2; known++) {
        memcpy(refiner.before, start, sizeof start);
        refiner.known = known, refiner.ended = ITN__TOO_SLOW;
        itn__retreat(&refiner);
        CHECK_NEAR(refiner.values[0], planted * (known ? 4e4 : 4e3), 1e-3 * 4e4);
        CHECK_NEAR(refiner.values[1], .9, 1e-5);
        CHECK_NEAR(refiner.values[2], .5, 1e-5);
        CHECK(!refiner.ended);
    }
    end_search(&refiner);
    itn_scene_free(scene);
}

/* Of two evaluations of one point neither is the better start, but by chance, of 4.6 % if normal
   (six of thirty come of that once in three hundred); the truth is better than a medium four times
   as dense, each time. planted: a factor of the errors. */
static void test_choice_of_starts(double planted) {
    enum { TIMES = 60 };
    itn__refiner refiner;
    itn_view view;
    itn__misfit misfit[2], far[2];
    itn_scene *scene = begin_at_truth(&refiner, 3, 0, 4, 8, 1, &view);
    double there[3];
    int better = 0, found = 0;
    for (int t = 0; t < TIMES; t++) {
        evaluate_anew(&refiner), misfit[t % 2] = refiner.misfit;
        misfit[t % 2].error *= planted;
        if (t % 2) better += itn__is_less(misfit, misfit + 1) + itn__is_less(misfit + 1, misfit);
    }
    memcpy(there, refiner.coordinates, sizeof there), there[1] += log(4.);
    itn__refine_set(&refiner, there);
    for (int t = 0; t < 4; t++) {
        evaluate_anew(&refiner), far[0] = refiner.misfit;
        found += itn__is_less(misfit, far) && !itn__is_less(far, misfit);
    }
    if (getenv("SHOW")) printf("starts: %d of %d, %d of 4\n", better, TIMES / 2, found);
    CHECK(better < 6);
    CHECK(found == 4);
    end_search(&refiner);
    itn_scene_free(scene);
}

/* A picture that the scene does not explain, as its index-matched ball stands in light that is half as
   strong: the misfit says so, whether its noise is known or not, and so do error bars and words.
   exposure: .5, or planted. */
static void test_bad_fit(double exposure) {
    static const char *const names[] = {"m.albedo", "m.g"};
    static float target[PIXELS], variance[PIXELS];
    itn_scene *scene = lit_cloud(SIZE, .65, exposure, 2, .8, .4), *wrong = cloud(2, .8, .4);
    int parameters[2], known, k;
    photograph(scene, 1024, 7, target, variance);
    find_parameters(wrong, names, 2, parameters);
    for (known = 0; known < 2; known++) {
        itn_refine_options options = ITN_ZERO;
        itn_refine_outcome outcome;
        itn_estimate estimates[2];
        itn_error error;
        const itn_parameter *p[2];
        double covariance[4];
        char text[1000];
        float theta[8];
        itn_parameter_values(wrong, theta);
        options.spp = 16, options.outcome = &outcome, options.covariance = covariance;
        if (known) options.target_variance = variance;
        stage_need(itn_refine(wrong, theta, target, parameters, 2, &options, estimates, &error),
                   &error);
        if (getenv("SHOW"))
            printf("bad fit: misfit %g +- %g, albedo %g +- %g\n", outcome.misfit,
                   outcome.misfit_error, estimates[0].value, estimates[0].standard_error);
        for (k = 0; k < 2; k++) p[k] = itn_parameter_get(wrong, parameters[k]);
        itn_refine_words(p, 2, estimates, covariance, &outcome, text, sizeof text);
        CHECK(!outcome.explained && outcome.misfit > 2);
        CHECK(strstr(text, "Suspect the exposure") != NULL);
        CHECK_NEAR(estimates[0].standard_error, sqrt(covariance[0]), 1e-9);
    }
    itn_scene_free(wrong);
    itn_scene_free(scene);
}

/* Radiances so large that variances overflow: an error or finite numbers, and an end. */
static void test_overflow(void) {
    static const float scales[] = {1e12f, 1e3f, 1}, levels[] = {1, 1e30f, 3e38f};
    static float target[PIXELS];
    itn_mesh mesh = solids_sphere(1, 1);
    int k, i;
    for (i = 0; i < PIXELS; i++) target[i] = 1;
    for (k = 0; k < 3; k++) {
        itn_refine_options options = ITN_ZERO;
        itn_estimate estimates[2];
        itn_error error;
        itn_result result;
        itn_scene *scene;
        stage s;
        float theta[8];
        int parameters[2];
        stage_begin(&s, SIZE, 4, 32);
        stage_medium(&s, "m", 2, .8, .4);
        stage_object(&s, &mesh, "m", NULL);
        stage_constant(&s, NULL, 1e18)->scale = scales[k];
        scene = stage_make(&s);
        parameters[0] = itn_parameter_find(scene, "m.sigma_t");
        parameters[1] = itn_parameter_find(scene, "light.scale");
        for (i = 0; i < PIXELS; i++) target[i] = levels[k];
        itn_parameter_values(scene, theta);
        options.spp = 4, options.iterations = 3;
        error.message[0] = 0;
        result = itn_refine(scene, theta, target, parameters, 2, &options, estimates, &error);
        check_report(result == ITN_OK || !strstr(error.message, "nan"), __FILE__, __LINE__,
                     "the error blames the victim: %s", error.message);
        for (i = 0; i < 2 && result == ITN_OK; i++)
            CHECK(itn__finite(estimates[i].value) && itn__finite(estimates[i].standard_error));
        itn_scene_free(scene);
    }
    itn_mesh_free(&mesh);
}

/* A search finds kappa, or both lobes of a mixture, from a picture by a sun: an eye in the cloud's
   edge sees it scattered by all angles. planted: what was hidden is taken for something else. */
static void test_lobes(int mixture, double planted) {
    static const char *const names[2][3] = {{"m.kappa"}, {"m.g1", "m.weight1", "m.g2"}};
    const int count = mixture ? 3 : 1;
    itn_mesh mesh = solids_sphere(1, 3);
    itn_refine_options options = ITN_ZERO;
    itn_refine_outcome outcome;
    itn_estimate estimates[3];
    itn_image image;
    itn_error error;
    float theta[32], hidden[3];
    int parameters[3], k;
    itn_scene *scene;
    stage s;
    stage_begin(&s, 12, 1.05, 120);
    itn_medium_desc *medium = stage_medium(&s, "m", .7, .9, 0);
    medium->phase = mixture ? ITN_PHASE_MIX : ITN_PHASE_VMF, medium->kappa = 12;
    medium->lobe_count = 2;
    medium->lobes[0].shape = .8f, medium->lobes[0].weight = .7f;
    medium->lobes[1].shape = -.3f, medium->lobes[1].weight = .3f;
    stage_object(&s, &mesh, "m", NULL);
    itn_light_desc *sky = stage_sky(&s, "light");
    sky->sun_direction = solids_vec3(.6, .3, -.7), sky->sun_radius_scale = 20;
    sky->sun_scale = 3, sky->has_scale = 1;
    scene = stage_make(&s);
    find_parameters(scene, names[mixture], count, parameters);
    itn_render_options render = ITN_ZERO;
    render.spp = 512, render.seed = 99;
    stage_need(itn_render(scene, NULL, &render, NULL, 0, &image, &error), &error);
    itn_parameter_values(scene, theta);
    for (k = 0; k < count; k++) hidden[k] = theta[parameters[k]];
    theta[parameters[0]] = mixture ? .5f : 3;
    if (mixture) theta[parameters[1]] = .5f, theta[parameters[2]] = 0;
    options.spp = 32, options.outcome = &outcome;
    options.target_variance = image.pixels + 12 * 12;
    stage_need(itn_refine(scene, theta, image.pixels, parameters, count, &options, estimates,
                          &error), &error);
    CHECK(outcome.explained);
    for (k = 0; k < count; k++) {
        double off = estimates[k].value - hidden[k] * (1 + planted);
        CHECK(estimates[k].determined);
        check_report(fabs(off) <= 4 * estimates[k].standard_error, __FILE__, __LINE__,
                     "%s is %g +- %g, not %g", names[mixture][k], estimates[k].value,
                     estimates[k].standard_error, (double)hidden[k]);
    }
    itn_image_free(&image), itn_scene_free(scene), itn_mesh_free(&mesh);
}

int main(void) {
#ifdef ITN_SANITIZED
    int slow = 1;
#else
    int slow = 0;
#endif
#ifndef ITN_NO_FAST
    test_elimination(0);
    CHECK_CATCHES(test_elimination(1e-6));
#endif
    test_transforms();
    test_most_samples(0);
#ifndef ITN_NO_FAST
    CHECK_CATCHES(test_most_samples(1));
#endif
    test_held(1, 0);
    test_held(-1, -1);
    test_similarity(0);
    test_similar_lobes(0);
    test_doubt(0);
    test_untold_step(0);
    test_learn(0);
    test_seeds(0);
    CHECK_CATCHES(test_seeds(7));
    test_verdict(4);
    if (!slow) { /* statistics take too long under a sanitizer */
        test_recoveries();
        test_descent(1);
        CHECK_CATCHES(test_descent(-1));
        test_coverages();
        if (check_long()) test_cases(200, 90, 98, 0);
        test_cases(10, 70, 100, 0); /* 7 of 10: less by chance in 1 of 970 runs, if it is 95 % */
        test_two_lights(0);
        test_two_pictures();
        test_shared_in_parts();
        test_final_spp(1);
        test_more_samples(.4);
        test_spread(1);
        test_stray_noise(0);
        test_refine_few_samples();
        test_undetermined();
        test_idle_and_others(0);
        test_even_noise(1);
        test_noisy_view(1);
        CHECK_CATCHES(test_noisy_view(1.5));
        test_misfit_noise(1);
        test_wrong_valley(1, 1), test_wrong_valley(1, 0);
        test_single_scattering(1);
        test_choice_of_starts(1);
        test_bad_fit(.5);
        test_noisy();
        test_lobes(0, 0), test_lobes(1, 0);
    }
    test_allotments();
    test_eigen();
    test_words(0);
    test_words_of_two(.3);
    test_idle();
    test_one_view();
    if (!slow) test_left_out(0);
    test_view_options();
    test_bounds();
    test_options();
    test_ends(0), test_retreat(1);
    CHECK_CATCHES(test_ends(1));
    CHECK_CATCHES(test_retreat(1.1));
    CHECK_CATCHES(test_choice_of_starts(0));
    CHECK_CATCHES(test_bad_fit(1));
    CHECK_CATCHES(test_similarity(1e-4));
    CHECK_CATCHES(test_similar_lobes(1e-4));
    CHECK_CATCHES(test_held(1, 1e-3));
    CHECK_CATCHES(test_doubt(10));
    CHECK_CATCHES(test_untold_step(1));
    CHECK_CATCHES(test_learn(1));
    CHECK_CATCHES(test_verdict(5));
    CHECK_CATCHES(test_coverage(0, 3));
    CHECK_CATCHES(test_coverage_in_colours(3));
    if (!slow) {
        CHECK_CATCHES(test_untold_colours(1));
        CHECK_CATCHES(test_idle_and_others(1e-3));
    }
    CHECK_CATCHES(test_cases(10, 70, 100, 1));
    CHECK_CATCHES(test_two_lights(1));
    CHECK_CATCHES(test_left_out(1));
    CHECK_CATCHES(test_final_spp(2));
    CHECK_CATCHES(test_more_samples(.9));
    CHECK_CATCHES(test_spread(.25));
    CHECK_CATCHES(test_stray_noise(1));
    CHECK_CATCHES(test_even_noise(1.5));
    CHECK_CATCHES(test_misfit_noise(6));
    CHECK_CATCHES(test_words(1));
    CHECK_CATCHES(test_lobes(0, .2));
    CHECK_CATCHES(test_wrong_valley(-1, 1));
    CHECK_CATCHES(test_words_of_two(.5));
    CHECK_CATCHES(test_single_scattering(0));
    test_overflow();
    return check_end("refine");
}
