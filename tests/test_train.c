/* What the training program adds to the library: the loss in the parameters' own units against
   differences, pictures shown otherwise against how much larger they are said to be, MS-SSIM where
   it has a closed form, and which pictures of a batch are for which process. */
#define main train_main
#include "../examples/train.c"
#undef main

#include "check.h"

/* A trainer with nothing but a scene of the three parameters, and spreads. */
static void make_bare_trainer(trainer *t) {
    static const char *const names[3] = {"milk.sigma_t", "milk.albedo", "milk.g"};
    static const double spreads[3] = {76, .2, .29};
    itn_scene *scene;
    int k;
    CHECK(!itn_scene_load("../scenes/data.itn", NULL, &scene, NULL));
    memset(t, 0, sizeof *t);
    t->stages.any = scene;
    for (k = 0; k < 3; k++) {
        t->stages.parameters[k] = itn_parameter_find(scene, names[k]);
        t->spreads[k] = spreads[k];
    }
}

/* scale: of the spread by which sigma_t's error is judged; other than 1, the error is planted. */
static void test_own_loss(double scale) {
    static trainer t;
    uint64_t random = 7;
    int times, k;
    make_bare_trainer(&t);
    for (times = 0; times < 100; times++) {
        float theta[3], answer[3], moved[3], gradient[3], unused[3];
        double by_hand = 0;
        theta[0] = (float)(165 + 135 * draw(&random)), theta[1] = (float)(.66 + .3 * draw(&random));
        theta[2] = (float)(.4 + .4 * draw(&random));
        truth_coordinates(t.stages.any, t.stages.parameters, theta, answer);
        CHECK_NEAR(own_loss(&t, answer, theta, gradient), 0, 1e-9);
        for (k = 0; k < 3; k++) answer[k] += (float)draw(&random);
        for (k = 0; k < 3; k++) {
            const itn_parameter *p = itn_parameter_get(t.stages.any, t.stages.parameters[k]);
            double value = itn_parameter_from_coordinate(p, (double)answer[k]);
            by_hand += pow((value - (double)theta[k]) / t.spreads[k], 2);
        }
        t.spreads[0] *= scale;
        CHECK_NEAR(own_loss(&t, answer, theta, gradient) / by_hand, 1, 1e-6);
        for (k = 0; k < 3; k++) {
            double up, down;
            memcpy(moved, answer, sizeof moved);
            moved[k] = answer[k] + .005f, up = own_loss(&t, moved, theta, unused);
            moved[k] = answer[k] - .005f, down = own_loss(&t, moved, theta, unused);
            CHECK_NEAR((double)gradient[k], (up - down) / .01, 2e-3 + 1e-3 * by_hand);
        }
        t.spreads[0] /= scale;
    }
    itn_scene_free((itn_scene *)t.stages.any);
}

/* A disc's area grows by the square of what vary_picture returns the logarithm of: shearing and
   turning change it by up to 1.5 %, pixels by as much, bending by more, but not in the mean of many.
   sign: -1 plants a wrong one. */
static void test_vary_picture(int bend, double sign) {
    static float picture[PIXELS], varied[PIXELS];
    double most = 0, off = 0;
    int times, i;
    for (i = 0; i < PIXELS; i++)
        picture[i] = hypot(i % FILM - 63.5, i / FILM - 63.5) < 25 ? 1.f : 0.f;
    for (times = 0; times < 50; times++) {
        double area = 0, larger = (double)vary_picture(picture, bend, (uint64_t)times, varied);
        for (i = 0; i < PIXELS; i++) area += varied[i] > .1f;
        area /= 3.14159265 * 25 * 25;
        most = fmax(most, fabs(larger));
        if (!bend) CHECK_NEAR(log(area), 2 * sign * larger, .04);
        off += (log(area) - 2 * sign * larger) / 50;
    }
    CHECK_NEAR(off, 0, .05);
    CHECK(most > .5 && most < .6);
}

/* Even pictures differ in luminance alone, which counts on the last level only. */
static void test_ms_ssim(double range) {
    static float picture[PIXELS], other[PIXELS];
    double c1 = pow(.01 * range, 2), luminance = (2 * 3 * 2 + c1) / (3 * 3 + 2 * 2 + c1);
    int i;
    for (i = 0; i < PIXELS; i++) picture[i] = 3, other[i] = 2;
    CHECK_NEAR(ms_ssim(picture, other), pow(luminance, .2363 / .8668), 1e-6);
    for (i = 0; i < PIXELS; i++) other[i] = picture[i] = (float)(i % 7 + i / FILM % 5);
    CHECK_NEAR(ms_ssim(picture, other), 1, 1e-9);
}

/* However many processes there are, an epoch shows every picture once, in the same batches, and each
   process only its own. planted: the order is one of all pictures together. */
static void test_order(int count, int batch, int planted) {
    static trainer t;
    static settings o;
    int order[200], processes, seen[200], i;
    memset(&t, 0, sizeof t);
    t.options = &o, t.order = order, t.pictures.count = count, o.model.batch = batch;
    draw_order(&t, 5);
    if (planted) shuffle(order, count, 5);
    for (processes = 1; processes <= 9; processes++) {
        memset(seen, 0, sizeof seen);
        for (i = 0; i < (count + batch - 1) / batch; i++) {
            int from = i * batch, next = from, rank;
            for (rank = 0; rank < processes; rank++) {
                int first, end;
                share s;
                o.process.rank = rank, o.process.count = processes;
                find_pictures(&t, &first, &end);
                s = share_of(&t, i);
                CHECK(s.count == (count - from < batch ? count - from : batch));
                CHECK(s.first == next && first >= 0 && first < end && end <= count);
                for (; next < s.first + s.mine; next++) {
                    CHECK(order[next] >= first && order[next] < end);
                    if (order[next] >= 0 && order[next] < count) seen[order[next]]++;
                }
            }
            CHECK(next == (from + batch < count ? from + batch : count));
        }
        for (i = 0; i < count; i++) CHECK(seen[i] == 1);
    }
}

int main(void) {
    test_own_loss(1);
    CHECK_CATCHES(test_own_loss(1.01));
    test_vary_picture(0, 1);
    test_vary_picture(12, 1);
    CHECK_CATCHES(test_vary_picture(0, -1));
    test_ms_ssim(3);
    CHECK_CATCHES(test_ms_ssim(30));
    test_order(96, 8, 0), test_order(101, 16, 0), test_order(3, 7, 0);
    CHECK_CATCHES(test_order(96, 8, 1));
    return check_end("train");
}
