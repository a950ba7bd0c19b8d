/* Derivatives by the values of images: of a texture and of a map light.

   The image is linear in a map's values, and of degree n in a texture's for paths that meet it n
   times, so by Euler's theorem the derivatives, times the values, add up to what one parameter
   says, path by path. Single texels are compared with differences of images, and all must be the
   same for any order of the rows. */
#define ITN_IMPLEMENTATION
#include "../itn.h"

#include "check.h"
#include "solids.h"
#include "stage.h"

#ifdef ITN_SANITIZED
enum { LONG = 0 };
#else
enum { LONG = 1 };
#endif
enum {
    TEXELS_SIZE = 12,
    TEXELS_PIXELS = TEXELS_SIZE * TEXELS_SIZE,
    WIDTH = 5,
    HEIGHT = 4,
    SEEDS = 16
};

/* A texture of WIDTH x HEIGHT with one texel black, whose neighbours are black too. */
static itn_image texture_make(int channels) {
    itn_image image;
    itn_error error;
    int i;
    stage_need(itn_image_create(WIDTH, HEIGHT, channels, NULL, &image, &error), &error);
    for (i = 0; i < WIDTH * HEIGHT * channels; i++)
        image.pixels[i] = .2f + .03f * (float)(i * 7 % 20);
    for (i = 0; i < channels; i++) {
        float *plane = image.pixels + i * WIDTH * HEIGHT;
        strcpy(image.names[i], channels == 1 ? "Y" : i == 0 ? "R" : i == 1 ? "G" : "B");
        plane[6] = plane[7] = plane[11] = plane[12] = 0;
    }
    return image;
}

static float weight_of(int i) { return .3f + .1f * (float)(i % 5) - .02f * (float)(i % 3); }

/* A cloudy ball above a textured ground, under a map and (with `constant`) a dim constant light.
   With `spectral`, of three channels, the cloud has another sigma_t in each. */
static itn_scene *ground_scene(int channels, int spectral, const itn_image *texture,
                               const itn_image *map, double constant) {
    itn_mesh ball = solids_sphere(1, 2);
    itn_surface_desc *ground;
    itn_object_desc *plane;
    itn_medium_desc *cloud;
    itn_scene *scene;
    stage s;
    int c;
    stage_begin(&s, TEXELS_SIZE, 5, 40);
    s.desc.film.channels = channels, s.desc.camera.eye.y = 3;
    cloud = stage_medium(&s, "m", 3, .9, .3);
    for (c = 0; c < 3 && spectral; c++) cloud->sigma_t_rgb[c] = 1 + 2 * (float)c;
    ground = stage_diffuse(&s, "ground", .8);
    ground->texture = ITN_TEXTURE_IMAGE, ground->image = texture;
    stage_object(&s, &ball, "m", NULL);
    plane = stage_object(&s, NULL, NULL, "ground");
    plane->plane_y = -1.2f;
    stage_map(&s, "dome", map);
    if (constant > 0) stage_constant(&s, "lamp", constant);
    scene = stage_make(&s);
    itn_mesh_free(&ball);
    return scene;
}

static const int *samples_of; /* each pixel, or NULL: all the same */

static itn_image gradient_of(const itn_scene *scene, const char *item, uint64_t seed, int spp) {
    static float weights[3 * TEXELS_PIXELS];
    itn_render_options options = ITN_ZERO;
    itn_image gradient = ITN_ZERO;
    itn_error error;
    int i;
    for (i = 0; i < 3 * TEXELS_PIXELS; i++) weights[i] = weight_of(i);
    options.spp = spp, options.seed = seed, options.mode = ITN_MODE_REFERENCE;
    options.samples = samples_of;
    stage_need(itn_render_texel_gradient(scene, NULL, &options, weights, item, &gradient, &error),
               &error);
    return gradient;
}

/* Sum of weights times image: of channel `only`, or of all. */
static double weighed(const itn_scene *scene, int channels, int only, uint64_t seed, int spp) {
    itn_render_options options = ITN_ZERO;
    itn_image image = ITN_ZERO;
    itn_error error;
    double sum = 0;
    int i;
    options.spp = spp, options.seed = seed, options.mode = ITN_MODE_REFERENCE;
    options.samples = samples_of;
    stage_need(itn_render(scene, NULL, &options, NULL, 0, &image, &error), &error);
    for (i = 0; i < channels * TEXELS_PIXELS; i++)
        if (only < 0 || i / TEXELS_PIXELS == only) sum += (double)weight_of(i) * image.pixels[i];
    itn_image_free(&image);
    return sum;
}

/* ---- sums ----------------------------------------------------------------------------------------- */

/* error: of what is planted, each value times 1 + error. */
static void test_sums(int channels, int spectral, double error) {
    itn_image texture = texture_make(channels), map = stage_patch(channels, .3, .2, 2), gradient;
    itn_scene *scene;
    int c, i;
    for (c = 0; c < channels; c++) /* no part of it is constant and has estimates of its own */
        map.pixels[c * map.width * map.height] = 0;
    scene = ground_scene(channels, spectral, &texture, &map, 0);
    gradient = gradient_of(scene, "dome", 3, 16);
    CHECK(gradient.width == map.width && gradient.height == map.height);
    for (c = 0; c < channels; c++) {
        double sum = 0, expected = weighed(scene, channels, c, 3, 16);
        int count = map.width * map.height;
        for (i = 0; i < count; i++)
            sum += (double)map.pixels[c * count + i] * gradient.pixels[c * count + i];
        CHECK_NEAR(sum * (1 + error), expected, 2e-5 * expected);
    }
    itn_image_free(&gradient);
    gradient = gradient_of(scene, "ground", 3, 16);
    CHECK(gradient.width == WIDTH && gradient.height == HEIGHT);
    for (c = 0; c < channels; c++) {
        static const char *const names[3] = {"ground.reflectance_r", "ground.reflectance_g",
                                             "ground.reflectance_b"};
        itn_render_options options = ITN_ZERO;
        static float weights[3 * TEXELS_PIXELS];
        double sum = 0, expected;
        int parameter = itn_parameter_find(scene, channels == 1 ? "ground.reflectance" : names[c]);
        for (i = 0; i < channels * TEXELS_PIXELS; i++) weights[i] = weight_of(i);
        options.spp = 16, options.seed = 3, options.mode = ITN_MODE_REFERENCE;
        options.samples = samples_of;
        stage_need(itn_render_gradient(scene, NULL, &options, weights, &parameter, 1, &expected,
                                       NULL, NULL), NULL);
        expected *= .8; /* the reflectance: what all texels are multiplied with */
        for (i = 0; i < WIDTH * HEIGHT; i++)
            sum += (double)texture.pixels[c * WIDTH * HEIGHT + i] *
                   gradient.pixels[c * WIDTH * HEIGHT + i];
        CHECK_NEAR(sum * (1 + error), expected, 2e-5 * expected);
    }
    itn_image_free(&gradient);
    itn_scene_free(scene);
    itn_image_free(&map), itn_image_free(&texture);
}

/* ---- single texels -------------------------------------------------------------------------------- */

/* Image and gradient with texel `at` of a texture or map set to `value`. */
static double with_texel(int of_map, int at, double value, uint64_t seed, int spp) {
    itn_image texture = texture_make(1), map = stage_patch(1, .3, .2, 2);
    itn_scene *scene;
    double result;
    (of_map ? &map : &texture)->pixels[at] = (float)value;
    scene = ground_scene(1, 0, &texture, &map, .5);
    result = weighed(scene, 1, -1, seed, spp);
    itn_scene_free(scene);
    itn_image_free(&map), itn_image_free(&texture);
    return result;
}

/* Mean over the seeds of derivative less difference in texel `at`; planted: a relative error of the
   derivative. A difference of the texture's is of paths at the same random numbers, and
   forward where the texel is black; one of the map's is large, as the image is linear in it. */
static void test_texel(int of_map, int at, double planted) {
    itn_image texture = texture_make(1), map = stage_patch(1, .3, .2, 2);
    itn_scene *scene = ground_scene(1, 0, &texture, &map, .5);
    double value = (of_map ? &map : &texture)->pixels[at], mean = 0, square = 0, size = 0, spread;
    double stated = 0;
    int seed, spp = of_map ? 96 : 32;
    for (seed = 0; seed < SEEDS; seed++) {
        itn_image gradient = gradient_of(scene, of_map ? "dome" : "ground", (uint64_t)seed, spp);
        double difference, up = of_map ? 20 : .05, down = of_map || value < .05 ? 0 : .05, error;
        difference = with_texel(of_map, at, value + up, (uint64_t)(seed + of_map * 50), spp) -
                     with_texel(of_map, at, value - down, (uint64_t)(seed + of_map * 100), spp);
        difference /= up + down;
        error = gradient.pixels[at] * (1 + planted) - difference;
        mean += error / SEEDS, square += error * error / SEEDS, size += difference / SEEDS;
        stated += itn_image_plane(&gradient, "Variance.Y")[at] / SEEDS;
        itn_image_free(&gradient);
    }
    spread = sqrt((square - mean * mean) / (SEEDS - 1));
    if (getenv("SHOW"))
        printf("%s %d: %.4g, difference + %.2g +- %.2g (%.1f sigma), stated %.2g\n",
               of_map ? "map" : "texture", at, size, mean, spread, mean / spread,
               sqrt(stated / SEEDS));
    CHECK_MEAN(mean, spread, 0, 4.5, .1 * fabs(size) + (of_map ? 0 : 2e-3));
    itn_scene_free(scene);
    itn_image_free(&map), itn_image_free(&texture);
}

/* The stated variance is that of repetitions, or a little more. */
static void test_texels_variance(void) {
    enum { REPEATS = 64 };
    itn_image texture = texture_make(1), map = stage_patch(1, .3, .2, 2);
    itn_scene *scene = ground_scene(1, 0, &texture, &map, .5);
    double mean[WIDTH * HEIGHT] = {0}, square[WIDTH * HEIGHT] = {0}, stated[WIDTH * HEIGHT] = {0};
    double ratio = 0;
    int seed, i;
    for (seed = 0; seed < REPEATS; seed++) {
        itn_image gradient = gradient_of(scene, "ground", (uint64_t)(seed + 1000), 4);
        for (i = 0; i < WIDTH * HEIGHT; i++) {
            double value = gradient.pixels[i];
            mean[i] += value / REPEATS, square[i] += value * value / REPEATS;
            stated[i] += gradient.pixels[WIDTH * HEIGHT + i] / REPEATS;
        }
        itn_image_free(&gradient);
    }
    for (i = 0; i < WIDTH * HEIGHT; i++)
        ratio += stated[i] / ((square[i] - mean[i] * mean[i]) * REPEATS / (REPEATS - 1)) /
                 (WIDTH * HEIGHT);
    if (getenv("SHOW")) printf("stated variance over measured %.3f\n", ratio);
    CHECK(ratio > .85 && ratio < 1.6); /* 64 repeats of 20 texels: a standard error of .04 */
    itn_scene_free(scene);
    itn_image_free(&map), itn_image_free(&texture);
}

/* ---- long paths ----------------------------------------------------------------------------------- */

/* A deep white well whose walls are met hundreds of times: places are forgotten by chance, and the
   sum over texels must stay. */
static void test_well(double error) {
    static float corners[24];
    static int faces[30] = {0, 1, 3, 0, 3, 2, 0, 4, 5, 0, 5, 1, 2, 3, 7,
                            2, 7, 6, 0, 2, 6, 0, 6, 4, 1, 5, 7, 1, 7, 3};
    itn_mesh well = ITN_ZERO;
    itn_image white;
    itn_error problem;
    itn_surface_desc *wall;
    itn_scene *scene;
    double mean = 0, square = 0, spread;
    int i, seed, parameter;
    stage s;
    for (i = 0; i < 24; i++) { /* bits of a corner's number: x, y, and z in the open */
        int bit = (i / 3 >> i % 3) & 1;
        corners[i] = i % 3 == 2 ? (bit ? 0.f : -12.f) : bit ? .5f : -.5f;
    }
    well.positions = corners, well.triangles = faces;
    well.vertex_count = 8, well.triangle_count = 10;
    stage_need(itn_image_create(3, 2, 1, NULL, &white, &problem), &problem);
    strcpy(white.names[0], "Y");
    for (i = 0; i < 6; i++) white.pixels[i] = .995f;
    stage_begin(&s, TEXELS_SIZE, 8, 8);
    wall = stage_diffuse(&s, "wall", 1);
    wall->texture = ITN_TEXTURE_IMAGE, wall->image = &white;
    stage_object(&s, &well, NULL, "wall");
    stage_constant(&s, NULL, 1);
    scene = stage_make(&s);
    parameter = itn_parameter_find(scene, "wall.reflectance");
    for (seed = 0; seed < SEEDS; seed++) {
        itn_image gradient = gradient_of(scene, "wall", (uint64_t)seed, 16);
        static float weights[TEXELS_PIXELS];
        itn_render_options options = ITN_ZERO;
        double sum = 0, expected;
        for (i = 0; i < TEXELS_PIXELS; i++) weights[i] = weight_of(i);
        options.spp = 16, options.seed = (uint64_t)seed, options.mode = ITN_MODE_REFERENCE;
        stage_need(itn_render_gradient(scene, NULL, &options, weights, &parameter, 1, &expected,
                                       NULL, NULL), NULL);
        for (i = 0; i < 6; i++) sum += .995 * (double)gradient.pixels[i];
        sum = sum / expected * (1 + error) - 1;
        mean += sum / SEEDS, square += sum * sum / SEEDS;
        itn_image_free(&gradient);
    }
    spread = sqrt((square - mean * mean) / (SEEDS - 1));
    if (getenv("SHOW")) printf("well: %.4f +- %.4f\n", mean, spread);
    CHECK_MEAN(mean, spread, 0, 4.5, .02);
    itn_scene_free(scene);
    itn_image_free(&white);
}

/* The same with other numbers of samples in each pixel. */
static void test_uneven_sums(void) {
    static int samples[TEXELS_PIXELS];
    int i;
    for (i = 0; i < TEXELS_PIXELS; i++) samples[i] = 1 + 7 * i % 31;
    samples_of = samples, test_sums(1, 0, 0), samples_of = NULL;
}

/* ---- order, errors ---------------------------------------------------------------------------------- */

static void texels_backwards(int count, void (*run)(void *task, int index), void *task,
                             void *user) {
    (void)user;
    while (count-- > 0) run(task, count);
}

static void test_order(void) {
    itn_image texture = texture_make(1), map = stage_patch(1, .3, .2, 2), gradients[2];
    int k;
    for (k = 0; k < 2; k++) {
        itn_scene *scene = ground_scene(1, 0, &texture, &map, .5);
        if (k) scene->context.parallel_for = texels_backwards;
        gradients[k] = gradient_of(scene, "dome", 8, 3);
        itn_scene_free(scene);
    }
    CHECK(memcmp(gradients[0].pixels, gradients[1].pixels,
                 2 * (size_t)(map.width * map.height) * sizeof(float)) == 0);
    itn_image_free(&gradients[0]), itn_image_free(&gradients[1]);
    itn_image_free(&map), itn_image_free(&texture);
}

static itn_result refused(const itn_scene *scene, const itn_render_options *options,
                          const float *weights, const char *item, const char *word) {
    itn_image gradient = ITN_ZERO;
    itn_error error;
    itn_result result = itn_render_texel_gradient(scene, NULL, options, weights, item, &gradient,
                                                  &error);
    CHECK(gradient.pixels == NULL && (!result || strstr(error.message, word)));
    itn_image_free(&gradient);
    return result;
}

static int cancel(void *user, double fraction) { return (void)user, fraction > .3; }

static void test_errors(void) {
    static float weights[TEXELS_PIXELS];
    itn_image texture = texture_make(1), map = stage_patch(1, .3, .2, 2);
    itn_scene *scene = ground_scene(1, 0, &texture, &map, .5);
    itn_render_options options = ITN_ZERO;
    options.spp = 1;
    CHECK(refused(scene, &options, weights, "lamp", "lamp") == ITN_ERROR_ARGUMENT);
    CHECK(refused(scene, &options, weights, "dom", "dom") == ITN_ERROR_ARGUMENT);
    CHECK(refused(scene, &options, weights, "m", "m") == ITN_ERROR_ARGUMENT);
    CHECK(refused(scene, &options, NULL, "dome", "NULL") == ITN_ERROR_ARGUMENT);
    CHECK(refused(scene, &options, weights, NULL, "NULL") == ITN_ERROR_ARGUMENT);
    weights[5] = NAN;
    CHECK(refused(scene, &options, weights, "dome", "5") == ITN_ERROR_ARGUMENT);
    weights[5] = 0, options.mode = ITN_MODE_FAST;
    CHECK(refused(scene, &options, weights, "ground", "fast walk") == ITN_ERROR_UNSUPPORTED);
    options.mode = ITN_MODE_AUTO, options.progress = cancel;
    CHECK(refused(scene, &options, weights, "dome", "cancelled") == ITN_ERROR_CANCELLED);
    itn_scene_free(scene);
    itn_image_free(&map), itn_image_free(&texture);
}

int main(void) {
    test_sums(1, 0, 0), test_sums(3, 0, 0), test_sums(3, 1, 0);
    if (LONG) {
        test_texel(0, 13, 0), test_texel(0, 6, 0);
        test_texel(1, 36, 0), test_texel(1, 5, 0);
        test_texels_variance();
        test_well(0);
        CHECK_CATCHES(test_texel(0, 8, .3));
        CHECK_CATCHES(test_texel(1, 36, .1));
        CHECK_CATCHES(test_well(.2));
    }
    test_uneven_sums();
    test_order();
    test_errors();
    CHECK_CATCHES(test_sums(1, 0, 1e-4));
    return check_end("texels");
}
