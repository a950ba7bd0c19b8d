/* 3. Free paths and the half-space.

   In a medium that absorbs and scatters, light flies freely for a random distance t with the
   density sigma_t exp(-sigma_t t). Such distances are made of uniform numbers u: t = -ln(u) /
   sigma_t. At its end a share `albedo` goes on, here in any direction alike. That is all there
   is to a random walk; below, one through everything under z = 0, which light enters straight
   down.

   Look at: bars of 200,000 flights on the curve of their density; how much comes back, by
   albedo.
   Check:   the mean flight, and what comes back, against Chandrasekhar's exact solution (1950),
   R(mu) = 1 - H(mu) sqrt(1 - albedo), where mu is the cosine of the light's direction and
   1 / H(mu) = sqrt(1 - albedo) + albedo/2 integral of m H(m) / (mu + m).
   Exercise: let light come from everywhere above, as from an overcast sky (mu is then the root
   of a uniform number). The exact share is the mean of R(mu), 2 mu dmu. (Solution: -DSOLUTION.)

   Compile: cc -O2 -march=native 03_flight.c -o 03_flight -lm -lpthread */
#define ITN_IMPLEMENTATION
#include "course.h"

enum { WALKS = 40000, BINS = 30, NODES = 64, ALBEDOS = 5 };

static double flight(double sigma_t) { return -log(1 - uniform()) / sigma_t; }

/* Follows light into the half-space at cosine mu; returns the weight that comes back out. */
static double walk(double albedo, double mu) {
    double depth = 0, weight = 1, down = mu; /* down: how much deeper a unit of flight leads */
    for (;;) {
        depth += down * flight(1);
        if (depth < 0) return weight;
        if (uniform() >= albedo) return 0; /* absorbed */
        down = 2 * uniform() - 1;          /* isotropic: all cosines alike */
    }
}

/* H at the nodes (n + .5) / NODES, by iteration of its equation. */
static void solve_h(double albedo, double *h) {
    for (int n = 0; n < NODES; n++) h[n] = 1;
    for (int round = 0; round < 300; round++)
        for (int n = 0; n < NODES; n++) {
            double sum = 0, mu = (n + .5) / NODES;
            for (int m = 0; m < NODES; m++) {
                double other = (m + .5) / NODES;
                sum += other * h[m] / (mu + other) / NODES;
            }
            h[n] = .5 * h[n] + .5 / (sqrt(1 - albedo) + .5 * albedo * sum);
        }
}

int main(void) {
    static const double albedos[ALBEDOS] = {.2, .5, .8, .95, .99};
    double h[NODES], at[ALBEDOS], back[ALBEDOS], exact[ALBEDOS], none[BINS + 1] = {0};
    double bars[BINS] = {0}, x[BINS + 1], density[BINS + 1], mean = 0, total = 200000;
    for (int i = 0; i < total; i++) {
        double t = flight(1);
        mean += t / total;
        if (t < 6) bars[(int)(t * BINS / 6)] += BINS / (6 * total);
    }
    check("mean free path", mean, 1, 4 / sqrt(total));
    for (int a = 0; a < ALBEDOS; a++) {
        double sum = 0, square = 0;
        solve_h(at[a] = albedos[a], h);
        double r = 1 - h[NODES - 1] * sqrt(1 - at[a]); /* straight down, nearly mu = 1 */
        for (int i = 0; i < WALKS; i++) {
            double mu = 1;
#ifdef SOLUTION
            mu = sqrt(uniform());
#endif
            double w = walk(at[a], mu);
            sum += w / WALKS, square += w * w / WALKS;
        }
#ifdef SOLUTION
        r = 0;
        for (int n = 0; n < NODES; n++)
            r += (1 - h[n] * sqrt(1 - at[a])) * 2 * (n + .5) / NODES / NODES;
#endif
        exact[a] = r, back[a] = sum;
        check("what comes back", sum, r, 4 * sqrt((square - sum * sum) / WALKS) + .002);
    }
    itn_image page = new_page(2);
    sheet_axis t = {0, 6, 0}, p = {0, 1, 0};
    sheet_axes(&page, panel(0), t, p, "density of free paths", "mean free paths");
    show_bars(&page, 0, p, bars, BINS);
    for (int i = 0; i <= BINS; i++) x[i] = i * 6. / BINS, density[i] = exp(-x[i]);
    sheet_curve(&page, panel(0), t, p, BINS + 1, x, density, none, SHEET_COLOURS[0]);
    sheet_axis share = {0, 1, 0};
    sheet_axes(&page, panel(1), share, share, "what comes back (red: exact)", "albedo");
    sheet_curve(&page, panel(1), share, share, ALBEDOS, at, exact, none, SHEET_COLOURS[1]);
    for (int a = 0; a < ALBEDOS; a++) /* single points */
        sheet_curve(&page, panel(1), share, share, 1, at + a, back + a, none, SHEET_INK);
    save_page(&page, "03_flight.png");
    return wrong;
}
