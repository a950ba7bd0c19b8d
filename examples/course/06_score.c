/* 6. Duals and a score.

   How does what comes through a medium answer to its density? A picture is a mean over random
   paths, and how often a path is drawn depends on the density: that must be differentiated, too.
   With p the density of a path and f what it brings,
       d/dsigma  integral of f p  =  integral of f (d ln p / dsigma) p:
   the same paths, each times its score (equation 10 of the paper). A score is a sum over the
   events of a path, and duals make it while the path is drawn: numbers that carry their slope
   with them, so that the product rule is the rule of multiplication.

   Look at: points by walks, with error bars, on the curve of exact slopes.
   Check:   light through a slab 1 thick that only absorbs: e^-sigma, slope -e^-sigma, within
   four standard errors; and scores have the mean 0.
   Exercise: let six of ten collisions go straight on, as if nothing had been met: what comes
   through is then e^(-.4 sigma). (Solution: compile with -DSOLUTION.)

   Compile: cc -O2 -march=native 06_score.c -o 06_score -lm -lpthread */
#define ITN_IMPLEMENTATION
#include "course.h"

typedef struct dual { double value, slope; } dual;
static dual times(dual a, dual b) {
    dual r = {a.value * b.value, a.slope * b.value + a.value * b.slope};
    return r;
}
static dual scaled(dual a, double b) { return times(a, (dual){b, 0}); }
static dual exponential(dual a) {
    dual r = {exp(a.value), exp(a.value) * a.slope};
    return r;
}

#ifdef SOLUTION
static const double ALBEDO = .6;
#else
static const double ALBEDO = 0;
#endif

/* One path through the slab. Returns what it brings; *density: that with which it was drawn. */
static double path(dual sigma, dual *density) {
    double depth = 0;
    *density = (dual){1, 0};
    for (;;) {
        double t = -log(1 - uniform()) / sigma.value;
        if (depth + t >= 1) { /* it reaches the far side: probability e^(-sigma t) */
            *density = times(*density, exponential(scaled(sigma, -(1 - depth))));
            return 1;
        }
        *density = times(*density, times(sigma, exponential(scaled(sigma, -t))));
        depth += t;
        if (uniform() >= ALBEDO) return 0; /* with a probability that sigma does not change */
    }
}

int main(void) {
    enum { POINTS = 8, PATHS = 100000, CURVE = 60 };
    double at[POINTS], slopes[POINTS], bars[POINTS], x[CURVE], y[CURVE];
    for (int k = 0; k < POINTS; k++) {
        dual sigma = {.25 + .5 * k, 1}; /* its slope by itself is 1 */
        double mean = 0, slope = 0, square = 0, score = 0, score2 = 0;
        for (int i = 0; i < PATHS; i++) {
            dual density;
            double f = path(sigma, &density), s = density.slope / density.value;
            mean += f / PATHS, slope += f * s / PATHS, square += f * s * f * s / PATHS;
            score += s / PATHS, score2 += s * s / PATHS;
        }
        double lost = 1 - ALBEDO, exact = exp(-lost * sigma.value);
        at[k] = sigma.value, slopes[k] = slope;
        bars[k] = sqrt((square - slope * slope) / PATHS);
        check("what comes through", mean, exact, 4 * sqrt(exact * (1 - exact) / PATHS));
        check("  its slope", slope, -lost * exact, 4 * bars[k]);
        check("  mean score", score, 0, 4 * sqrt(score2 / PATHS));
    }
    itn_image page = new_page(1);
    sheet_axis sigma = {0, 4, 0}, slope = {-1.2, .2, 0};
    sheet_axes(&page, panel(0), sigma, slope, "slope: paths and exact (red)", "sigma");
    for (int i = 0; i < CURVE; i++)
        x[i] = 4. * i / (CURVE - 1), y[i] = -(1 - ALBEDO) * exp(-(1 - ALBEDO) * x[i]);
    for (int i = 1; i < CURVE; i++) {
        sheet_box b = panel(0);
        sheet_line(&page, b.left + b.width * x[i - 1] / 4, sheet_height(b, slope, y[i - 1]),
                   b.left + b.width * x[i] / 4, sheet_height(b, slope, y[i]), 1.5,
                   SHEET_COLOURS[1]);
    }
    for (int k = 0; k < POINTS; k++) {
        sheet_box b = panel(0);
        double px = b.left + b.width * at[k] / 4;
        sheet_line(&page, px, sheet_height(b, slope, slopes[k]), px,
                   sheet_height(b, slope, slopes[k]), 5, SHEET_INK);
        sheet_line(&page, px, sheet_height(b, slope, slopes[k] - bars[k]), px,
                   sheet_height(b, slope, slopes[k] + bars[k]), 1, SHEET_INK);
    }
    save_page(&page, "06_score.png");
    return wrong;
}
