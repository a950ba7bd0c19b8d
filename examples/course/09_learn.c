/* 9. A network that learns to measure.

   A network is a function with many numbers in it: convolutions that look at small windows, the
   largest of four neighbours again and again, and in the end a weighted sum. Show it a picture,
   tell it by how far its answer is off, and each number learns in which direction it should have
   been different (backward pass); Adam takes a small step there. Here it is shown pictures of one
   disc with a soft edge and must tell the disc's radius and place. No step repeats a picture, so
   it cannot learn by heart.

   Look at: the loss, falling by a factor of a hundred; a disc, and circles where the truth (blue)
   and the answer (red) are.
   Check:   on discs it has never seen it is five times better than guessing the average.
   Exercise: let it tell the brightness as well, which is random, too: a fourth output.
   (Solution: compile with -DSOLUTION.)

   Compile: cc -O2 -march=native 09_learn.c -o 09_learn -lm -lpthread */
#define ITN_IMPLEMENTATION
#include "course.h"

#ifdef SOLUTION
enum { OUTPUTS = 4 };
#else
enum { OUTPUTS = 3 };
#endif
enum { SIDE = 32, PIXELS = SIDE * SIDE, BATCH = 16, STEPS = 400 };

/* A disc of radius r at (x, y), in units of the picture's half width, and what the network should
   answer: numbers of a like size. */
static void draw_disc(float *picture, float *truth) {
    double r = .2 + .4 * uniform(), x = uniform() - .5, y = uniform() - .5, bright = uniform();
    double answers[4] = {4 * (r - .4), x, y, bright - .5};
    for (int i = 0; i < PIXELS; i++) {
        double dx = (i % SIDE + .5) / (SIDE / 2.) - 1 - x;
        double dy = (i / SIDE + .5) / (SIDE / 2.) - 1 - y;
        double inside = (r - hypot(dx, dy)) * (SIDE / 2.); /* pixels from the edge inwards */
        picture[i] = (float)(fmin(fmax(inside + .5, 0), 1) * (.5 + .5 * bright));
    }
    for (int k = 0; k < OUTPUTS; k++) truth[k] = (float)answers[k];
}

static void draw_circle(itn_image *page, sheet_box b, const float *answer, sheet_colour colour) {
    double half = b.width / 2, r = (.4 + answer[0] / 4.) * half;
    for (int i = 0; i < 90; i++) {
        double x = b.left + (1 + answer[1]) * half, y = b.top + (1 + answer[2]) * half;
        sheet_line(page, x + r * cos(i * .0698), y + r * sin(i * .0698),
                   x + r * cos((i + 1) * .0698), y + r * sin((i + 1) * .0698), 2, colour);
    }
}

int main(void) {
    static float pictures[BATCH][PIXELS];
    float truth[BATCH * OUTPUTS], answers[BATCH * OUTPUTS], gradient[BATCH * OUTPUTS];
    double steps[STEPS / 10], losses[STEPS / 10], none[STEPS / 10] = {0}, off = 0, guess = 0;
    itn_net_desc desc = ITN_ZERO;
    itn_net *net;
    itn_error error;
    desc.width = desc.height = SIDE, desc.channels = 1, desc.outputs = OUTPUTS;
    desc.layer_count = 3, desc.first_channels = 8, desc.batch = BATCH;
    need(itn_net_create(&desc, NULL, &net, &error), &error);
    for (int step = 0; step < STEPS; step++) {
        for (int k = 0; k < BATCH; k++) draw_disc(pictures[k], truth + k * OUTPUTS);
        need(itn_net_forward(net, BATCH, pictures[0], answers, &error), &error);
        double loss = itn_loss_parameters(BATCH * OUTPUTS, answers, truth, gradient) / BATCH;
        for (int k = 0; k < BATCH * OUTPUTS; k++) gradient[k] /= BATCH; /* the mean of a batch */
        itn_net_zero_gradients(net);
        need(itn_net_backward(net, BATCH, gradient, &error), &error);
        need(itn_net_step(net, .006 * (1 - (double)step / STEPS) + 1e-6, &error), &error);
        if (step % 10 == 0) steps[step / 10] = step, losses[step / 10] = loss;
    }
    for (int i = 0; i < 200; i++) { /* the trial */
        draw_disc(pictures[0], truth);
        need(itn_net_forward(net, 1, pictures[0], answers, &error), &error);
        off += sqrt(itn_loss_parameters(OUTPUTS, answers, truth, gradient)) / 200;
        for (int k = 0; k < OUTPUTS; k++) gradient[k] = 0;
        guess += sqrt(itn_loss_parameters(OUTPUTS, gradient, truth, gradient)) / 200;
    }
    check("mean error, over that of guessing", off / guess, .1, .1);
    itn_image page = new_page(2);
    sheet_axis x = {0, STEPS, 0}, y = {1e-3, 2, 1};
    sheet_axes(&page, panel(0), x, y, "loss", "step");
    sheet_curve(&page, panel(0), x, y, STEPS / 10, steps, losses, none, SHEET_COLOURS[0]);
    show(&page, 1, pictures[0], SIDE, SIDE, 1, 1, "blue: truth, red: answer");
    draw_circle(&page, panel(1), truth, SHEET_COLOURS[0]);
    draw_circle(&page, panel(1), answers, SHEET_COLOURS[1]);
    save_page(&page, "09_learn.png");
    itn_net_free(net);
    return wrong;
}
