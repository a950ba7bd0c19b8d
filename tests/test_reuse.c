/* Paths of the reference walk, taken one by one: kept and used again for neighbouring parameters, and
   numbered up to the end of all numbers. */
#define ITN_IMPLEMENTATION
#include "../itn.h"

#include "check.h"
#include "one.h"
#include "solids.h"
#include "stage.h"

#include "reuse.h"

enum { REUSE_SIZE = 16 };

/* ---- paths used again -------------------------------------------------------------------------------- */

/* Turns of a recorded path, their polynomial and its slope against the phase functions themselves,
   over 60 collisions. planted: of g. */
static void test_reuse_turns(double planted) {
    static const double inside[] = {-1, -.7, -.25, 0, .1, .8, 1};
    reuse_record record = ITN_ZERO;
    float turns[REUSE_NODES] = {0, 0, 0, 0}, cosines[60];
    itn__rng rng = itn__rng_make(1, 2, 3);
    double slope;
    size_t i, k;
    record.g = .6, record.reach = reuse_reach(record.g, .1);
    CHECK_NEAR(record.reach, .1, 0), CHECK_NEAR(reuse_reach(-.9, .1), .05, 1e-12);
    for (i = 0; i < 60; i++) {
        cosines[i] = 2 * itn__uniform(&rng) - 1;
        reuse_turn(&record, 1 - cosines[i], 1 + cosines[i], turns);
    }
    for (k = 0; k < sizeof inside / sizeof *inside; k++) {
        double g = record.g + inside[k] * record.reach, sum = 0, by_g = 0;
        for (i = 0; i < 60; i++) {
            one_dual p = one_phase((float)(g + planted), 1 - cosines[i], 1 + cosines[i]);
            float before = one_phase((float)record.g, 1 - cosines[i], 1 + cosines[i]).v;
            sum += log((double)p.v / (double)before), by_g += (double)p.d[0] / (double)p.v;
        }
        CHECK_NEAR(reuse_phase(&record, turns, g, &slope), sum, 2e-3);
        CHECK_NEAR(slope, by_g, .01 * fabs(by_g) + .2);
    }
}

/* Images and derivatives from the paths of neighbouring parameters against fresh renders; the
   effective share of paths falls with the distance. planted: of the walk's sigma_t. */
static void test_reuse_image(double planted) {
    enum { PIXELS = REUSE_SIZE * REUSE_SIZE, PATHS = 1 << 18, RECORDS = 8, PLANES = 4 };
    static const char *const names[] = {"m.sigma_t", "m.albedo", "m.g"};
    static float planes[PLANES * PIXELS];
    static itn_image fresh; /* the same whatever is planted */
    itn_mesh mesh = solids_sphere(1, 2);
    itn_image map = stage_patch(1, .65, .35, 4);
    itn_render_options options = ITN_ZERO;
    double sum[PLANES] = {0}, square[PLANES] = {0}, share = 1;
    int parameters[3], k, i, r;
    reuse_record record = ITN_ZERO;
    itn_scene *scene;
    itn_error error;
    stage s;
    float theta[16];
    stage_begin(&s, REUSE_SIZE, 4, 32);
    stage_medium(&s, "m", 3, .9, .5);
    stage_dielectric(&s, "glass", 1.4, .2);
    stage_object(&s, &mesh, "m", "glass");
    stage_map(&s, NULL, &map);
    scene = stage_make(&s);
    for (k = 0; k < 3; k++) parameters[k] = itn_parameter_find(scene, names[k]);
    options.spp = check_long() ? 4096 : 2048;
    if (!fresh.pixels)
        stage_need(itn_render(scene, NULL, &options, parameters, 3, &fresh, &error), &error);
    itn_parameter_values(scene, theta);
    theta[parameters[0]] = 3.3f, theta[parameters[1]] = .88f, theta[parameters[2]] = .46f;
    record.most = PATHS, record.paths = (reuse_path *)malloc(PATHS * sizeof(reuse_path));
    for (r = 0; r < RECORDS; r++) {
        reuse_trace(&record, scene, theta, 64, 100 + (uint64_t)r);
        CHECK(!record.full && record.count > 0);
        record.sigma_t *= 1 + planted;
        reuse_image(&record, 3, .9, .5, planes);
        for (k = 0; k < PLANES; k++) {
            double mean = 0;
            for (i = 0; i < PIXELS; i++) mean += (double)planes[k * PIXELS + i] / PIXELS;
            sum[k] += mean / RECORDS, square[k] += mean * mean / RECORDS;
        }
    }
    for (k = 0; k < PLANES; k++) {
        double truth = 0, variance = 0, noise, sigmas;
        for (i = 0; i < PIXELS; i++) {
            truth += (double)fresh.pixels[2 * k * PIXELS + i] / PIXELS;
            variance += (double)fresh.pixels[(2 * k + 1) * PIXELS + i] / PIXELS / PIXELS;
        }
        noise = sqrt((square[k] - sum[k] * sum[k]) / (RECORDS - 1) + variance);
        sigmas = (sum[k] - truth) / noise;
        check_report(fabs(sigmas) < 4.5, __FILE__, __LINE__, "reuse, plane %d: %g, fresh %g: %.1f",
                     k, sum[k], truth, sigmas);
        if (getenv("SHOW"))
            printf("reuse, plane %d: %g, fresh %g +- %g: %.1f sigma\n", k, sum[k], truth, noise,
                   sigmas);
    }
    for (k = 0; k < 6; k++) { /* 0, 5, 10, ... % away */
        double now = reuse_image(&record, record.sigma_t * (1 + .05 * k), record.albedo, record.g,
                                 planes);
        CHECK(k ? now < share : fabs(now - 1) < 1e-9);
        share = now;
        if (getenv("SHOW")) printf("reuse, %d %% away: effective share %.3f\n", 5 * k, share);
    }
    record.most = 100;
    reuse_trace(&record, scene, theta, 1, 1);
    CHECK(record.full && record.count == 100);
    free(record.paths);
    itn_image_free(&map);
    itn_mesh_free(&mesh);
    itn_scene_free(scene);
}

/* ---- the last samples ------------------------------------------------------------------------------ */

/* Sample numbers near the largest give other paths, and the sums do not overflow. */
static void test_many_samples(void) {
    itn_mesh mesh = solids_sphere(1, 1);
    itn__render render;
    itn_render_options options = ITN_ZERO;
    itn_error error;
    itn__walk walk;
    itn_scene *scene;
    stage s;
    double sum = 0, square = 0;
    int k;
    stage_begin(&s, 2, 4, 30);
    stage_medium(&s, "m", 1, .5, 0);
    stage_object(&s, &mesh, "m", NULL);
    stage_constant(&s, NULL, 1);
    scene = stage_make(&s);
    stage_need(itn__render_begin(&render, scene, NULL, &options, NULL, 0, NULL, &error),
               &error);
    CHECK(itn__walk_make(&walk, &render, NULL));
    for (k = 0; k < 20000; k++) {
        itn__sample_pixel(&walk, ~0ull, 1, 1, INT_MAX - k);
        sum += walk.radiance[0], square += (double)walk.radiance[0] * walk.radiance[0];
    }
    itn__render_end(&render, ITN_OK);
    {
        itn_image image = ITN_ZERO;
        solids_mean mean;
        options.spp = 20000;
        stage_need(itn_render(scene, NULL, &options, NULL, 0, &image, &error), &error);
        mean.value = image.pixels[3], mean.error = sqrt(image.pixels[4 + 3]);
        sum /= 20000, square = (square / 20000 - sum * sum) / 20000;
        CHECK_MEAN(sum, sqrt(square + mean.error * mean.error), mean.value, 4.5, .01);
        itn_image_free(&image);
    }
    itn_scene_free(scene);
    itn_mesh_free(&mesh);
}

/* ---- light that is trapped --------------------------------------------------------------------- */

/* Late roulette is so gentle that the variance tells of what it leaves: of paths that have drawn n_0
   numbers 2^-1.5 draw twice as many, and those that do count 2^1.5 times. `draws`: numbers drawn
   at each step; with half of them it comes too often. */
static void test_late_roulette(int draws) {
    enum { PATHS = 2000 };
    itn_mesh mesh = solids_sphere(1, 1);
    itn__render render;
    itn_render_options options = ITN_ZERO;
    itn_error error;
    itn__walk walk;
    itn_scene *scene;
    stage s;
    int k, living = 0;
    double weights = 0, share = pow(.5, 1.5);
    stage_begin(&s, 2, 4, 30);
    stage_medium(&s, "m", 1e-6, .5, 0);
    stage_object(&s, &mesh, "m", NULL);
    stage_constant(&s, NULL, 1);
    scene = stage_make(&s);
    stage_need(itn__render_begin(&render, scene, NULL, &options, NULL, 0, NULL, &error),
               &error);
    CHECK(itn__walk_make(&walk, &render, NULL));
    for (k = 0; k < PATHS; k++) {
        itn__begin_path(&walk, 1, 0, 0, k);
        walk.rng.dimension = ITN__MANY_DRAWS_CLEAR + 1;
        while (walk.rng.dimension < 2 * ITN__MANY_DRAWS_CLEAR) {
            if (!itn__roulette(&walk)) break;
            walk.rng.dimension += (uint32_t)draws - 1;
        }
        if (walk.rng.dimension < 2 * ITN__MANY_DRAWS_CLEAR) continue;
        living++, weights += walk.weight.beta[0];
        CHECK_NEAR(walk.weight.beta[0] * share, 1, .005);
    }
    CHECK_NEAR(living, share * PATHS, 4 * sqrt(share * (1 - share) * PATHS));
    CHECK_NEAR(weights * share, share * PATHS, 4 * sqrt(share * (1 - share) * PATHS));
    itn__render_end(&render, ITN_OK);
    itn_scene_free(scene);
    itn_mesh_free(&mesh);
}

#ifndef ITN_NO_FAST
/* Lossless and thick, in light 1: exactly 1 is what a pixel shows. The fast walk's paths here begin
   as if they had drawn the many numbers from which on roulette ends them. The error is that of the paths' own variance. planted: of the right value. */
static void test_late_furnace(double planted) {
    enum { PATHS = 500, ROUNDS = 8 };
    itn_mesh mesh = solids_box(solids_vec3(-.5, -.5, -.5), solids_vec3(.5, .5, .5));
    itn__render render;
    itn_render_options options = ITN_ZERO;
    itn_error error;
    itn_scene *scene;
    stage s;
    double sum = 0, square = 0, n = PATHS * ROUNDS;
    int round, k;
    stage_begin(&s, 1, 4, .01);
    stage_medium(&s, "m", 1e4, 1, .5);
    stage_object(&s, &mesh, "m", NULL);
    stage_constant(&s, NULL, 1);
    scene = stage_make(&s);
    options.spp = PATHS, options.walks = 1, options.mode = ITN_MODE_FAST;
    options.estimator = ITN_ESTIMATOR_SCORE;
    for (round = 0; round < ROUNDS; round++) {
        itn__crowd *crowd;
        options.seed = (uint64_t)round;
        stage_need(itn__render_begin(&render, scene, NULL, &options, NULL, 0, NULL, &error),
                   &error);
        stage_need(itn__tables_get(&render, &error), &error);
        CHECK(itn__fast_know(&render));
        stage_need(itn__divide(&render, &error), &error);
        crowd = render.workers[0].crowd;
        memset(crowd->radiance, 0, PATHS * sizeof(float));
        memset(&crowd->unit, 0, sizeof crowd->unit);
        crowd->unit.side = 1, crowd->unit.count = PATHS;
        for (k = 0; k < PATHS; k++) itn__start_sample(crowd);
        CHECK(crowd->unused_count == ITN__CROWD - PATHS);
        for (k = 0; k < ITN__CROWD; k++) crowd->paths[k].dimension = ITN__MANY_DRAWS;
        itn__run_unit(crowd);
        for (k = 0; k < PATHS; k++) {
            double value = (double)crowd->radiance[k];
            sum += value / n, square += value * value / n;
        }
        itn__render_end(&render, ITN_OK);
    }
    square = sqrt((square - sum * sum) / n);
    if (getenv("SHOW")) printf("late furnace: %.5f +- %.5f\n", sum, square);
    CHECK_MEAN(sum, square, 1 + planted, 4.5, .005);
    itn_scene_free(scene);
    itn_mesh_free(&mesh);
}
#endif

int main(void) {
    test_reuse_turns(0);
    test_reuse_image(0);
    test_many_samples();
    test_late_roulette(4);
    CHECK_CATCHES(test_late_roulette(2));
#ifndef ITN_NO_FAST
    test_late_furnace(0);
    CHECK_CATCHES(test_late_furnace(.03));
#endif
    CHECK_CATCHES(test_reuse_turns(.002));
    CHECK_CATCHES(test_reuse_image(.02));
    return check_end("reuse");
}
