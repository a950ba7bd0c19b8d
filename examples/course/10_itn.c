/* 10. An inverse transport network, in a minute.

   The paper's idea. A network N shall read sigma_t and albedo off a picture I. A regressor
   network (RN) learns by |theta - N(I)|^2: both numbers count alike, wherever they are. But where
   a medium is dense its picture hardly changes with sigma_t, and where it is dark, hardly with
   anything. So ask also that the picture rendered with the answer is the picture shown,
       |theta - N(I)|^2 + lambda |I - T(N(I))|^2                              (equation 3),
   T being the path tracer, whose derivatives (chapter 7) carry the error back into the network: an
   inverse transport network (ITN). Here both learn from the same pictures of a box in the sun,
   8 pixels wide, from the same beginning, with the same steps.

   Look at: points near the diagonal are read right; the RN is blue, the ITN red.
   Check:   both read new pictures at least three times better than a guess, and pictures of the
   ITN's answers are no further from those shown than the RN's are. (In a minute it gains a little;
   ../experiment.sh takes hours for it. Its rate is small, as rendered gradients are noisy.)
   Exercise: let T see single scattering only (max_scatter = 1): an SSN. What does the model's
   error do to the answers? (Solution: compile with -DSOLUTION.)

   Compile: cc -O2 -march=native 10_itn.c -o 10_itn -lm -lpthread */
#define ITN_IMPLEMENTATION
#include "course.h"

enum { SIDE = 8, PIXELS = SIDE * SIDE, TRAIN = 96, TEST = 32, ALL = TRAIN + TEST, BATCH = 16 };
enum { FIRST = 300, STEPS = 360, N = 2 }; /* the image term joins after the first steps */
static const char SCENE[] =
    "film   width 8 height 8\ncamera eye 2 2.7 3 target 0 .6 0 fov 28\n"
    "medium milk sigma_t 4 albedo .9 g .5\nobject mesh box.obj medium milk\n"
    "light  sky ../../scenes/t3-e60.sky sun .5 .7 -.5 sun_radius_scale 20\n";
static itn_scene *scene;
static int asked[N];
static float pictures[ALL][PIXELS], inputs[ALL][PIXELS], truth[ALL][N]; /* truth: coordinates */
static float theta[8];

/* Renders a material of these coordinates. */
static void render(const float *coordinates, int spp, uint64_t seed, float *picture) {
    itn_render_options options = ITN_ZERO;
    itn_image image;
    itn_error error;
    float there[8];
    itn_parameter_values(scene, there);
    for (int k = 0; k < N; k++)
        there[asked[k]] = (float)itn_parameter_from_coordinate(itn_parameter_get(scene, asked[k]),
                                                               coordinates[k]);
    options.spp = spp, options.seed = seed;
    need(itn_render(scene, there, &options, NULL, 0, &image, &error), &error);
    memcpy(picture, image.pixels, PIXELS * sizeof(float));
    itn_image_free(&image);
}

/* Trains a network; answers: coordinates for all pictures. Outputs count from `middle`. */
static void train(double lambda, int max_scatter, const double *middle, float (*answers)[N]) {
    itn_net_desc desc = ITN_ZERO;
    itn_net *net;
    itn_error error;
    float batch[BATCH][PIXELS], out[BATCH][N], gradient[N * BATCH];
    desc.width = desc.height = SIDE, desc.channels = 1, desc.outputs = N, desc.batch = BATCH;
    desc.layer_count = 2, desc.first_channels = 12;
    need(itn_net_create(&desc, NULL, &net, &error), &error);
    for (int step = 0; step < STEPS + ALL / BATCH; step++) {
        int trying = step >= STEPS, first = (step % (TRAIN / BATCH)) * BATCH;
        if (trying) first = (step - STEPS) * BATCH;
        memcpy(batch, inputs[first], sizeof batch);
        need(itn_net_forward(net, BATCH, batch[0], out[0], &error), &error);
        for (int i = 0; i < BATCH; i++) {
            itn_render_options options = ITN_ZERO;
            double loss, slope[N] = {0, 0};
            for (int k = 0; k < N; k++) out[i][k] += (float)middle[k];
            if (trying) memcpy(answers[first + i], out[i], sizeof out[i]);
            options.spp = 16, options.max_scatter = max_scatter;
            options.seed = (uint64_t)(1000 + step * BATCH + i);
            if (lambda > 0 && step >= FIRST && !trying)
                need(itn_loss_image(scene, theta, &options, pictures[first + i], asked, N, out[i],
                                    &loss, slope, &error), &error);
            itn_loss_parameters(N, out[i], truth[first + i], gradient + N * i);
            for (int k = 0; k < N; k++)
                gradient[N * i + k] =
                    (gradient[N * i + k] + (float)(lambda * slope[k])) / BATCH;
        }
        itn_net_zero_gradients(net);
        need(itn_net_backward(net, BATCH, gradient, &error), &error);
        if (!trying) need(itn_net_step(net, step < FIRST ? 3e-3 : 2e-4, &error), &error);
    }
    itn_net_free(net);
}

int main(void) {
    static float answers[2][ALL][N], picture[PIXELS];
    static const char *const titles[N] = {"ln sigma_t", "logit albedo"};
    const double middle[N] = {1.4, 2}, half[N] = {1.2, 1.5};
    double mean = 0, off[2][N + 1] = {{0}}, spread[N] = {0};
    itn_file box = {"box.obj", BOX, sizeof BOX - 1};
    itn_error error;
    need(itn_scene_from_memory(SCENE, sizeof SCENE - 1, NULL, &box, 1, NULL, &scene, &error),
         &error);
    asked[0] = itn_parameter_find(scene, "milk.sigma_t");
    asked[1] = itn_parameter_find(scene, "milk.albedo");
    itn_parameter_values(scene, theta);
    for (int i = 0; i < ALL; i++) {
        for (int k = 0; k < N; k++)
            truth[i][k] = (float)(middle[k] + half[k] * (2 * uniform() - 1));
        render(truth[i], i < TRAIN ? 64 : 256, (uint64_t)i, pictures[i]);
        for (int j = 0; j < PIXELS; j++) mean += pictures[i][j] / (ALL * PIXELS);
    }
    for (int i = 0; i < ALL; i++)
        for (int j = 0; j < PIXELS; j++) inputs[i][j] = pictures[i][j] / (float)mean;
    int max_scatter = 0;
#ifdef SOLUTION
    max_scatter = 1;
#endif
    train(0, 0, middle, answers[0]);
    train(1 / (mean * mean), max_scatter, middle, answers[1]);
    for (int i = TRAIN; i < ALL; i++)
        for (int net = 0; net < 2; net++) {
            for (int k = 0; k < N; k++) {
                off[net][k] += pow(answers[net][i][k] - truth[i][k], 2) / TEST;
                if (!net) spread[k] += pow(truth[i][k] - middle[k], 2) / TEST;
            }
            render(answers[net][i], 256, (uint64_t)(10000 + i), picture);
            for (int j = 0; j < PIXELS; j++)
                off[net][N] += pow((picture[j] - pictures[i][j]) / mean, 2) / (TEST * PIXELS);
        }
    itn_image page = new_page(N);
    for (int k = 0; k < N; k++) {
        sheet_axis a = {middle[k] - 1.3 * half[k], middle[k] + 1.3 * half[k], 0};
        sheet_box b = panel(k);
        sheet_axes(&page, b, a, a, titles[k], "truth");
        sheet_line(&page, b.left, b.top + PANEL, b.left + PANEL, b.top, 1, SHEET_GREY);
        for (int i = 2 * TRAIN; i < 2 * ALL; i++) {
            double x = b.left + PANEL * sheet_place(a, truth[i / 2][k]);
            double y = sheet_height(b, a, answers[i % 2][i / 2][k]);
            sheet_line(&page, x, y, x, y, 4, SHEET_COLOURS[i % 2]);
        }
        printf("%s off by, of a guess: RN %.3f, ITN %.3f\n", titles[k],
               sqrt(off[0][k] / spread[k]), sqrt(off[1][k] / spread[k]));
        for (int net = 0; net < 2 - max_scatter; net++)
            check(titles[k], sqrt(off[net][k] / spread[k]), 0, .34);
    }
    printf("pictures off by: RN %.3f, ITN %.3f\n", sqrt(off[0][N]), sqrt(off[1][N]));
    if (!max_scatter) check("pictures, ITN over RN", sqrt(off[1][N] / off[0][N]), .95, .08);
    save_page(&page, "10_itn.png");
    itn_scene_free(scene);
    return wrong;
}
