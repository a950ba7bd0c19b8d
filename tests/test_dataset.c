/* Pictures of the learning experiment that share a walk, as the colours of a medium with three
   albedos, against pictures of each material on its own: under which material the file keeps each
   of them. Runs in the folder tests; its files go into build/families. */
#define main dataset_main
#include "../examples/dataset.c"
#undef main

#include "check.h"

enum { COUNT = 5 };

/* Mean of the object's pixels in a picture of a shard. */
static double stored_mean(const work *w, int index) {
    const unsigned char *at = w->bytes + pixels_place(&w->shard, index);
    double sum = 0;
    int i, count = 0;
    for (i = 0; i < PIXELS; i++)
        if (w->mask[i]) sum += (double)float_from_half((uint16_t)get_bytes(at + 2 * i, 2)), count++;
    return sum / count;
}

/* The same of a material in the scene of one channel; *error: the noise of a picture's mean. */
static double own_mean(const work *w, const itn_scene *scene, const int parameters[3],
                       const float material[3], double *error) {
    float *theta = theta_with(scene, 3, parameters, material);
    itn_render_options options = ITN_ZERO;
    itn_image image = ITN_ZERO;
    itn_error problem;
    double sum = 0, variance = 0;
    int i, count = 0;
    options.spp = w->settings->spp, options.seed = 77;
    if (itn_render(scene, theta, &options, NULL, 0, &image, &problem)) fail(problem.message, "");
    for (i = 0; i < PIXELS; i++)
        if (w->mask[i]) sum += image.pixels[i], variance += image.pixels[PIXELS + i], count++;
    itn_image_free(&image);
    free(theta);
    *error = sqrt(variance) / count;
    return sum / count;
}

/* planted: a material's picture is looked for under its neighbour. */
static void test_families(int planted) {
    static float thetas[COUNT][3] = {
        {54, .95f, .4f}, {54, .39f, .4f}, {82, .74f, .4f}, {54, .74f, .4f}, {82, .95f, .4f}};
    static work w;
    settings s;
    itn_scene *scene, *own;
    int parameters[3], i, families;
    memset(&s, 0, sizeof s), memset(&w, 0, sizeof w);
    s.dir = "build/families", s.scenes = "../scenes", s.noise = 1, s.spp = 2, s.threads = 1;
    make_folder(s.dir);
    write_scenes(&s);
    w.settings = &s, w.thetas = thetas, w.total = COUNT, w.start = seconds();
    w.shard.in = SPLIT_TRAIN, w.shard.shape = 1, w.shard.azimuth = 30, w.shard.count = COUNT;
    pthread_mutex_init(&w.lock, NULL);
    scene = load_scene(&w.shard, FILM_THREE, s.dir, family_names, 5, w.parameters), w.scene = scene;
    own = load_theta_scene(&w.shard, FILM_ONE, s.dir, parameters);
    w.bytes = (unsigned char *)need(shard_size(&w.shard), 1);
    object_mask(s.dir, w.shard.shape, w.mask);
    families = list_families(&w);
    CHECK(families == 2 && w.families[0].count == 3 && w.families[1].count == 2);
    for (i = 0; i < families; i++) make_family(&w, i);
    fputc('\n', stderr);
    for (i = 0; i < COUNT; i++) {
        const unsigned char *record = w.bytes + record_place(i);
        double error, expected = own_mean(&w, own, parameters, thetas[i], &error);
        CHECK(get_float(record) == thetas[i][0] && get_float(record + 4) == thetas[i][1] &&
              get_float(record + 8) == thetas[i][2]);
        CHECK_MEAN(stored_mean(&w, (i + planted) % COUNT), error * sqrt(2), expected, 4.5,
                   .02 * expected);
    }
    pthread_mutex_destroy(&w.lock);
    free(w.bytes);
    itn_scene_free(own), itn_scene_free(scene);
}

int main(void) {
    test_families(0);
    CHECK_CATCHES(test_families(1));
    return check_end("dataset");
}
