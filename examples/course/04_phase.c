/* 4. A phase function.

   Where light is scattered it goes on at an angle theta to its way with a density, the phase
   function. Henyey and Greenstein's (1941) has one parameter, the mean cosine g:
       p(cos theta) = (1 - g^2) / (4 pi (1 + g^2 - 2 g cos theta)^(3/2)).
   It is drawn by inversion: the share of light within an angle, as a function of its cosine, is
   made equal to a uniform number and solved for the cosine.

   Look at: bars of 200,000 cosines on the curve of 2 pi p; the lobe of g = .6 seen from the
   side.
   Check:   its mean cosine is g; p adds up to 1 over the sphere; the score d ln p / dg, by which
   the library makes derivatives, has the mean 0, as the derivative of that 1 must be.
   Exercise: do the same for the von Mises-Fisher lobe p = kappa e^(kappa cos) / (4 pi sinh
   kappa): the cosine is 1 + ln(u + (1 - u) e^(-2 kappa)) / kappa, its mean 1 / tanh(kappa) - 1 /
   kappa. (Solution: compile with -DSOLUTION.)

   Compile: cc -O2 -march=native 04_phase.c -o 04_phase -lm -lpthread */
#define ITN_IMPLEMENTATION
#include "course.h"

#define PI 3.14159265358979323846
enum { DRAWS = 200000, BINS = 40 };

static double hg(double g, double cosine) {
    double square = 1 + g * g - 2 * g * cosine;
    return (1 - g * g) / (4 * PI * square * sqrt(square));
}
static double draw_hg(double g) {
    double u = uniform(), s = (1 - g * g) / (1 - g + 2 * g * u);
    return fabs(g) < 1e-3 ? 2 * u - 1 : (1 + g * g - s * s) / (2 * g);
}
static double score_hg(double g, double cosine) { /* d ln p / dg */
    return -2 * g / (1 - g * g) - 3 * (g - cosine) / (1 + g * g - 2 * g * cosine);
}

int main(void) {
    const double g = .6;
    static float lobe[PANEL * PANEL];
    double bars[BINS] = {0}, x[BINS + 1], density[BINS + 1], none[BINS + 1] = {0};
    double mean = 0, score = 0, square = 0, total = 0;
    for (int i = 0; i < DRAWS; i++) {
        double cosine = draw_hg(g), s = score_hg(g, cosine);
        mean += cosine / DRAWS, score += s / DRAWS, square += s * s / DRAWS;
        bars[(int)fmin((cosine + 1) * BINS / 2, BINS - 1)] += BINS / 2. / DRAWS;
    }
    for (int i = 0; i < 2000; i++) total += 2 * PI * hg(g, (i + .5) / 1000 - 1) / 1000;
    check("mean cosine", mean, g, 4 / sqrt(DRAWS)); /* a cosine's deviation is below 1 */
    check("all of it", total, 1, 1e-4);
    check("mean score", score, 0, 4 * sqrt(square / DRAWS));
#ifdef SOLUTION
    for (double kappa = .1; kappa < 200; kappa *= 10) {
        double sum = 0;
        for (int i = 0; i < DRAWS; i++) {
            double u = uniform();
            sum += (1 + log(u + (1 - u) * exp(-2 * kappa)) / kappa) / DRAWS;
        }
        check("mean cosine of a von Mises-Fisher lobe", sum, 1 / tanh(kappa) - 1 / kappa,
              4 / sqrt(DRAWS));
    }
#endif
    /* light comes from the left and is scattered in the middle; brightness is the share of p */
    for (int i = 0; i < PANEL * PANEL; i++) {
        double right = i % PANEL + .5 - PANEL / 2, up = PANEL / 2 - i / PANEL - .5;
        double r = hypot(right, up), reach = PANEL / 2 * hg(g, right / r) / hg(g, 1);
        lobe[i] = r < reach ? 1 : .02f;
    }
    itn_image page = new_page(2);
    sheet_axis cosines = {-1, 1, 0}, p = {0, 5, 0};
    sheet_axes(&page, panel(0), cosines, p, "density of cosines, g = .6", "cosine");
    show_bars(&page, 0, p, bars, BINS);
    for (int i = 0; i <= BINS; i++) x[i] = 2. * i / BINS - 1, density[i] = 2 * PI * hg(g, x[i]);
    sheet_curve(&page, panel(0), cosines, p, BINS + 1, x, density, none, SHEET_COLOURS[0]);
    show(&page, 1, lobe, PANEL, PANEL, 1, 1, "its lobe, light from the left");
    save_page(&page, "04_phase.png");
    return wrong;
}
