/* A network that learns to measure.

   You learn: the whole life of a network: create, forward pass, loss, backward pass, Adam step, and
   the trial on what it has never seen. It is shown pictures of one bright disc with a soft edge and
   must tell the disc's radius and place. No step repeats a picture, so it cannot learn by heart.

   Compile: cc -std=c99 -O2 learn.c -o learn -lm
   Run:     ./learn        (about a second)
   Prints:  step   0  loss 0.9170
            ...
            step 350  loss 0.0071
            mean error of an unseen disc, in pixels: 0.71 (guessing the average: 6.46)
   The exit status is 0 if the answers are five times better than guessing. */
#define ITN_IMPLEMENTATION
#include "../itn.h"

enum { SIZE = 32, BATCH = 16, STEPS = 400, OUTPUTS = 3 };

/* Picture number `number` of an endless series: a disc with radius r at (x, y), in units of the
   picture's half width, and what the network should answer: (4 (r - 0.4), x, y). */
static void draw_disc(unsigned number, float *picture, float *truth) {
    double random[4], r, x, y;
    int k, row, column;
    for (k = 0; k < 4; k++) { /* numbers in [0,1) that have no visible order */
        unsigned bits = number * 4u + (unsigned)k + 1u;
        bits = (bits ^ (bits >> 16)) * 0x7feb352du;
        bits = (bits ^ (bits >> 15)) * 0x846ca68bu;
        random[k] = (double)((bits ^ (bits >> 16)) & 0xffffffu) / 16777216.;
    }
    r = .2 + .4 * random[0], x = random[1] - .5, y = random[2] - .5;
    for (row = 0; row < SIZE; row++)
        for (column = 0; column < SIZE; column++) {
            double dx = (column + .5) / (SIZE / 2.) - 1 - x, dy = (row + .5) / (SIZE / 2.) - 1 - y;
            double edge = (r - sqrt(dx * dx + dy * dy)) * (SIZE / 2.); /* pixels inside the edge */
            double cover = edge < -.5 ? 0 : edge > .5 ? 1 : edge + .5;
            picture[row * SIZE + column] = (float)(cover * (.5 + .5 * random[3])); /* brightness */
        }
    truth[0] = (float)(4 * (r - .4)), truth[1] = (float)x, truth[2] = (float)y;
}

/* The mean distance, in pixels, of the network's answers from the truth, and of zeros, which are
   the average of all truths. Returns 0 if the network fails. */
static int try_unseen(itn_net *net, int count, double *error_pixels, double *guess_pixels) {
    float picture[SIZE * SIZE], truth[OUTPUTS], answer[OUTPUTS];
    double scale[OUTPUTS] = {SIZE / 2. / 4, SIZE / 2., SIZE / 2.};
    int i, k;
    *error_pixels = *guess_pixels = 0;
    for (i = 0; i < count; i++) {
        double error = 0, guess = 0;
        draw_disc(1000000u + (unsigned)i, picture, truth);
        if (itn_net_forward(net, 1, picture, answer, NULL)) return 0;
        for (k = 0; k < OUTPUTS; k++) {
            error += pow(scale[k] * (double)(answer[k] - truth[k]), 2);
            guess += pow(scale[k] * (double)truth[k], 2);
        }
        *error_pixels += sqrt(error) / count;
        *guess_pixels += sqrt(guess) / count;
    }
    return 1;
}

int main(void) {
    static float pictures[BATCH][SIZE * SIZE];
    float truth[BATCH * OUTPUTS], answers[BATCH * OUTPUTS], gradient[BATCH * OUTPUTS];
    itn_net_desc desc = ITN_ZERO;
    itn_net *net;
    itn_error error;
    double loss, error_pixels = 0, guess_pixels = 0;
    int step, k, learned;

    desc.width = desc.height = SIZE, desc.channels = 1, desc.outputs = OUTPUTS;
    desc.layer_count = 3, desc.first_channels = 8, desc.batch = BATCH;
    if (itn_net_create(&desc, NULL, &net, &error)) return puts(error.message), 1;

    for (step = 0; step < STEPS; step++) {
        for (k = 0; k < BATCH; k++)
            draw_disc((unsigned)(step * BATCH + k), pictures[k], truth + k * OUTPUTS);

        if (itn_net_forward(net, BATCH, pictures[0], answers, &error))
            return puts(error.message), 1;
        loss = itn_loss_parameters(BATCH * OUTPUTS, answers, truth, gradient) / BATCH;
        for (k = 0; k < BATCH * OUTPUTS; k++) gradient[k] /= BATCH; /* the mean over the batch */
        itn_net_zero_gradients(net);
        if (itn_net_backward(net, BATCH, gradient, &error)) return puts(error.message), 1;
        if (itn_net_step(net, .006 * (1 - (double)step / STEPS) + 1e-6, &error))
            return puts(error.message), 1;
        if (step % 50 == 0) printf("step %3d  loss %.4f\n", step, loss);
    }

    learned = try_unseen(net, 200, &error_pixels, &guess_pixels);
    learned = learned && error_pixels < guess_pixels / 5;
    printf("mean error of an unseen disc, in pixels: %.2f (guessing the average: %.2f)\n",
           error_pixels, guess_pixels);
    itn_net_free(net);
    return learned ? 0 : 1;
}
