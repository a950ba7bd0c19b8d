/* Pictures of the learning experiment that share a walk, as the colours of a medium with three
   albedos, against pictures of each material on its own: under which material the file keeps each
   of them, and which variant of the shape it shows; and that their noise is what was asked for. And
   what variants are: closed meshes that do not cross themselves. Runs in the folder tests; its
   files go into build/families. */
#define main dataset_main
#include "../examples/dataset.c"
#undef main

#include "check.h"

enum { COUNT = 5 };

static double stored_pixel(const work *w, int index, int pixel) {
    const unsigned char *at = w->bytes + pixels_place(&w->shard, index) + 2 * pixel;
    return (double)float_from_half((uint16_t)get_bytes(at, 2));
}

/* The pixels that show the object in the picture of a material. */
static void shown_mask(const work *w, const float material[3], unsigned char *mask) {
    object_mask(w->settings->dir, &w->shard, variant_of(&w->shard, material), mask);
}

/* Mean of the object's pixels in a picture of a shard. */
static double stored_mean(const work *w, int index) {
    double sum = 0;
    unsigned char mask[PIXELS];
    int i, count = 0;
    shown_mask(w, w->thetas[index], mask);
    for (i = 0; i < PIXELS; i++)
        if (mask[i]) sum += stored_pixel(w, index, i), count++;
    return sum / count;
}

/* The same of a material in the scene of one channel; *error: the noise of a picture's mean. */
static double own_mean(const work *w, const itn_scene *scene, const int parameters[3],
                       const unsigned char *mask, const float material[3], double *error) {
    float *theta = theta_with(scene, 3, parameters, material);
    itn_render_options options = ITN_ZERO;
    itn_image image = ITN_ZERO;
    itn_error problem;
    double sum = 0, variance = 0;
    int i, count = 0;
    options.spp = w->settings->spp, options.seed = 77;
    if (itn_render(scene, theta, &options, NULL, 0, &image, &problem)) fail(problem.message, "");
    for (i = 0; i < PIXELS; i++)
        if (mask[i]) sum += image.pixels[i], variance += image.pixels[PIXELS + i], count++;
    itn_image_free(&image);
    free(theta);
    *error = sqrt(variance) / count;
    return sum / count;
}

static void begin_settings(settings *s) {
    memset(s, 0, sizeof *s);
    s->dir = "build/families", s->scenes = "../scenes", s->threads = 1;
}

static float materials[COUNT][3] = {
    {54, .95f, .4f}, {54, .39f, .4f}, {82, .74f, .4f}, {54, .74f, .4f}, {82, .95f, .4f}};

/* Makes the pictures of a small shard, which are two families. */
static void begin_work(work *w, settings *s, double noise, int spp, int seed) {
    int i, families;
    memset(w, 0, sizeof *w);
    begin_settings(s);
    s->noise = noise, s->spp = spp, s->seed = seed;
    w->settings = s, w->thetas = materials, w->total = COUNT, w->start = seconds();
    w->shard.in = SPLIT_TRAIN, w->shard.shape = 1, w->shard.azimuth = 30, w->shard.count = COUNT;
    pthread_mutex_init(&w->lock, NULL);
    make_filter(&w->filter);
    CHECK(list_variants(&w->shard, (const float(*)[3])materials, w->variants) == 2);
    for (i = 0; i < 2; i++) {
        if (w->variants[i]) write_variant(s->dir, w->shard.shape, w->shard.azimuth, w->variants[i]);
        prepare_variant(w, i);
    }
    w->bytes = (unsigned char *)need(shard_size(&w->shard), 1);
    families = list_families(w);
    CHECK(families == 2 && w->families[0].count == 3 && w->families[1].count == 2);
    for (i = 0; i < families; i++) make_family(w, i);
    fputc('\n', stderr);
}

static void end_work(work *w) {
    int i;
    pthread_mutex_destroy(&w->lock);
    free(w->bytes);
    for (i = 0; i < PAIRS; i++) itn_scene_free(w->scenes[i]), free(w->views[i]);
}

/* planted: 1: a material's picture is looked for under its neighbour; 2: in another variant. */
static void test_families(const work *w, int planted) {
    static stages own;
    int shards[COUNT] = {0}, first = planted == 2 ? 3 : 0, end = planted ? first + 1 : COUNT, i;
    pictures p;
    memset(&p, 0, sizeof p);
    p.count = COUNT, p.shard_count = 1, p.shards[0] = w->shard, p.shard_of = shards;
    p.thetas = materials;
    load_stages(&p, 0, COUNT, COUNT, FILM_ONE, w->settings->dir, 2, &own);
    for (i = first; i < end; i++) {
        const unsigned char *record = w->bytes + record_place(i);
        int shown = planted == 2 ? (i + 1) % COUNT : i;
        unsigned char mask[PIXELS];
        double error, expected;
        shown_mask(w, materials[shown], mask);
        expected = own_mean(w, scene_of(&own, &p, shown), own.parameters, mask, materials[i],
                            &error);
        CHECK(get_float(record) == materials[i][0] && get_float(record + 4) == materials[i][1] &&
              get_float(record + 8) == materials[i][2]);
        CHECK_MEAN(stored_mean(w, planted == 1 ? (i + 1) % COUNT : i), error * sqrt(2), expected,
                   4.5, .02 * expected);
    }
    free_stages(&own);
}

/* Pictures have the noise that was asked for, as they say themselves, and as two of them differ.
   planted: factor to what they say. */
static void test_noise(const work w[2], double noise, double planted) {
    int i, k, j;
    for (i = 0; i < COUNT; i++) {
        unsigned char mask[PIXELS];
        double said = 0, square = 0, light = 0, found;
        int count = 0;
        shown_mask(&w[0], materials[i], mask);
        for (k = 0; k < 2; k++) {
            double one = (double)get_float(w[k].bytes + record_place(i) + 12);
            CHECK(one > 0 && one < noise);
            said += one * one;
        }
        for (j = 0; j < PIXELS; j++) {
            double a = stored_pixel(&w[0], i, j), b = stored_pixel(&w[1], i, j);
            if (mask[j]) square += (a - b) * (a - b), light += (a + b) / 2, count++;
        }
        found = sqrt(square * count) / light;
        check_report(fabs(found / (planted * sqrt(said)) - 1) < .15, __FILE__, __LINE__,
                     "noise %g: two pictures differ by %.3f, should by %.3f", noise, found,
                     planted * sqrt(said));
        if (getenv("SHOW"))
            printf("noise %g: picture %d says %.4f, found %.4f\n", noise, i, sqrt(said / 2),
                   found / sqrt(2));
    }
}

/* A picture is as seen through the Gaussian: of a wave, the means over fine pixels become the wave,
   e^(-k^2 DEVIATION^2 / 2) of it, at any length to be seen. planted: factor to the deviation. */
static void test_filter(double planted) {
    static filter f;
    int length, i, k;
    make_filter(&f);
    for (length = 2; length < 40; length += 3) {
        double number = 6.283185307 / length, worst = 0; /* by pixels of the picture */
        double left = exp(-pow(number * DEVIATION * planted, 2) / 2);
        for (i = 0; i < FILM; i++) {
            double sum = 0;
            for (k = 0; k < FINE; k++) {
                double from = (double)(k - MARGIN) / PARTS, to = from + 1. / PARTS;
                sum += (double)f.weights[i * FINE + k] * PARTS *
                       (sin(number * to) - sin(number * from)) / number;
            }
            worst = fmax(worst, fabs(sum - left * cos(number * (i + .5))));
        }
        check_report(worst < .001, __FILE__, __LINE__, "wave of %d pixels: %g off", length, worst);
    }
}

/* Samples are at most as many as allowed, but for rounding, and hardly fewer if they are wanted. */
static void test_limit(int spp) {
    static work w;
    settings s;
    double mean;
    begin_work(&w, &s, .01, spp, 0);
    mean = w.samples / w.done;
    check_report(mean > .9 * spp && mean < 1.05 * spp, __FILE__, __LINE__, "%g samples, %d allowed",
                 mean, spp);
    end_work(&w);
}

/* Every other pair of sigma_t and g has a variant of its own, whatever the albedo; tests have
   none. */
static void test_order(void) {
    shard s = {SPLIT_TRAIN, 3, 60, MATERIALS};
    float thetas[MATERIALS][3];
    int seen[PAIRS][PAIRS] = {{0}}, pairs[PAIRS] = {0}, variants[PAIRS], i, k, own = 0;
    shard_materials(&s, thetas);
    for (i = 0; i < MATERIALS; i++) seen[variant_of(&s, thetas[i])][pair_of(thetas[i])]++;
    for (i = 0; i < PAIRS; i++)
        for (k = 0; k < PAIRS; k++) pairs[i] += seen[i][k] == 5;
    for (i = 1; i < PAIRS; i++) own += pairs[i] == 1;
    CHECK(pairs[0] == 31 && own == 29);
    CHECK(list_variants(&s, (const float(*)[3])thetas, variants) == 30);
    s.in = SPLIT_LIGHT;
    CHECK(list_variants(&s, (const float(*)[3])thetas, variants) == 1 && variants[0] == 0);
}

/* Whether a ray through a mesh meets its outside and its inside in turn, as it does if the mesh is
   closed and does not cross itself. */
static int alternates(const itn_bvh *bvh, itn_ray ray) {
    itn_hit hit;
    int inside = 0;
    for (; itn_bvh_nearest(bvh, &ray, &hit); ray.tmin = hit.t, inside = !inside)
        if (hit.front == inside) return 0;
    return !inside;
}

/* The variants of a shape under a light differ from each other, and under another light. */
static void test_difference(void) {
    itn_mesh meshes[3];
    int i, k;
    for (i = 0; i < 3; i++) {
        write_variant("build/families", 2, i == 2 ? 60 : 0, i == 1 ? 4 : 2);
        meshes[i] = load_mesh("build/families", 2, i == 2 ? 60 : 0, i == 1 ? 4 : 2);
    }
    for (i = 1; i < 3; i++) {
        double apart = 0;
        for (k = 0; k < 3 * meshes[0].vertex_count; k++)
            apart += fabs((double)(meshes[i].positions[k] - meshes[0].positions[k]));
        CHECK(apart > .1 * meshes[0].vertex_count);
    }
    for (i = 0; i < 3; i++) itn_mesh_free(&meshes[i]);
}

/* How many of 1000 rays show that a mesh crosses itself. */
static int count_crossed(const itn_mesh *mesh, uint64_t random) {
    itn_bvh *bvh;
    int i, crossed = 0;
    CHECK(!itn_bvh_create(mesh, NULL, &bvh, NULL));
    for (i = 0; i < 1000; i++) {
        itn_ray ray = ITN_ZERO;
        double d[3];
        draw_direction(&random, d);
        ray.direction.x = (float)d[0], ray.direction.y = (float)d[1];
        ray.direction.z = (float)d[2], ray.tmax = INFINITY;
        ray.origin.x = (float)(.5 * draw(&random) - 2 * d[0]);
        ray.origin.y = (float)(.5 * draw(&random) - 2 * d[1]);
        ray.origin.z = (float)(.5 * draw(&random) - 2 * d[2]);
        crossed += !alternates(bvh, ray);
    }
    itn_bvh_free(bvh);
    return crossed;
}

/* planted: they are bent too much to be sure. */
static void test_variants(int planted) {
    const int step = check_long() ? 3 : 12;
    int shape, variant, i, tried = 0, crossed = 0;
    for (shape = 0; shape < TRAINING_SHAPES; shape++)
        for (variant = 2; variant < PAIRS; variant += step) {
            itn_mesh mesh = load_mesh("build/families", shape, 0, 0);
            itn_mesh_report report;
            float side = 0;
            vary_mesh(&mesh, shape, planted ? 2.5 : .8,
                      mix((uint64_t)shape, (uint64_t)(variant % 4 * 30), (uint64_t)variant));
            for (i = 0; i < 3 * mesh.vertex_count; i++)
                side = fmaxf(side, fabsf(mesh.positions[i]));
            CHECK_NEAR(side, .5, 1e-6);
            CHECK(!itn_mesh_check(&mesh, NULL, &report, NULL));
            CHECK(!report.bad_vertices && !report.open_edges && !report.flipped_edges &&
                  !report.degenerate_triangles && report.volume > 0);
            crossed += count_crossed(&mesh, (uint64_t)variant), tried++;
            itn_mesh_free(&mesh);
        }
    CHECK(crossed == 0);
    if (getenv("SHOW")) printf("%d of %d rays\n", crossed, 1000 * tried);
}

static void test_pictures(void) {
    static const double few = .2, many = .038; /* noise; the latter takes more than 8 samples */
    static work w[2];
    settings s[2];
    int k;
    for (k = 0; k < 2; k++) begin_work(&w[k], &s[k], few, 8, k);
    test_families(&w[0], 0);
    CHECK_CATCHES(test_families(&w[0], 1));
    CHECK_CATCHES(test_families(&w[0], 2));
    test_noise(w, few, 1);
    CHECK_CATCHES(test_noise(w, few, 1.4));
    for (k = 0; k < 2; k++) end_work(&w[k]);
    for (k = 0; k < 2; k++) begin_work(&w[k], &s[k], many, 4096, k);
    CHECK(w[0].samples / w[0].done > 8);
    test_noise(w, many, 1);
    CHECK_CATCHES(test_noise(w, many, 1.4));
    for (k = 0; k < 2; k++) end_work(&w[k]);
}

int main(void) {
    settings s;
    begin_settings(&s);
    make_folder(s.dir);
    write_scenes(&s);
    test_pictures();
    test_limit(8);
    test_limit(16);
    test_filter(1);
    CHECK_CATCHES(test_filter(1.04));
    test_order();
    test_difference();
    test_variants(0);
    CHECK_CATCHES(test_variants(1));
    return check_end("dataset");
}
