/* Plane layers without chance: adding-doubling (van de Hulst, Multiple Light Scattering, 1980) in
   double precision. The answers serve as the truth of Monte Carlo measurements.

   A layer of optical thickness b, index-matched, turns the radiance that enters through its two
   faces, as much in every azimuth, into the radiance that leaves; on a set of directions this is a
   matrix R for what comes back and a matrix T for what goes through. A thin layer has them from the
   equation of transfer by the diamond scheme, two equal layers together make one of twice the
   thickness,

       T' = T (1 - R R)^-1 T,    R' = R + T R (1 - R R)^-1 T,

   and so on up to b. Directions are Gauss's for fluxes through a face (ADDING_NODES each way), and
   straight down and one of the caller's with next to no weight. What Henyey and Greenstein's lobe
   has beyond 2 ADDING_NODES Legendre terms counts as not turned at all, or for negative g as thrown
   straight back (Wiscombe's delta-M method, 1977). */
#ifndef ADDING_H
#define ADDING_H
#include <math.h>
#include <string.h>

enum { ADDING_NODES = 48, ADDING_SIZE = ADDING_NODES + 2 };
enum { ADDING_DOWN = ADDING_NODES, ADDING_OTHER }; /* the two directions without weight */

typedef struct adding_matrix {
    double at[ADDING_SIZE][ADDING_SIZE];
} adding_matrix;

typedef struct adding_layer {
    double mu[ADDING_SIZE], weight[ADDING_SIZE]; /* cosines, and their shares of the integral */
    adding_matrix reflected, transmitted; /* [out][in]; the weight of `in` is multiplied in */
} adding_layer;

/* Gauss's nodes and weights on (0,1), by Newton's method on the Legendre polynomial. */
static void adding_directions(adding_layer *layer, double other) {
    int i, k, round;
    for (i = 0; i < ADDING_NODES; i++) {
        double x = cos(3.14159265358979324 * (i + .75) / (ADDING_NODES + .5)), slope = 0;
        for (round = 0; round < 20; round++) {
            double p = 1, before = 0;
            for (k = 0; k < ADDING_NODES; k++) {
                double next = ((2 * k + 1) * x * p - k * before) / (k + 1);
                before = p, p = next;
            }
            slope = ADDING_NODES * (x * p - before) / (x * x - 1);
            x -= p / slope;
        }
        layer->mu[i] = .5 * (1 + x), layer->weight[i] = 1 / ((1 - x * x) * slope * slope);
    }
    layer->mu[ADDING_DOWN] = 1, layer->mu[ADDING_OTHER] = other;
    layer->weight[ADDING_DOWN] = layer->weight[ADDING_OTHER] = 1e-9;
}

static adding_matrix adding_times(const adding_matrix *a, const adding_matrix *b) {
    adding_matrix c;
    int i, j, k;
    memset(&c, 0, sizeof c);
    for (i = 0; i < ADDING_SIZE; i++)
        for (k = 0; k < ADDING_SIZE; k++)
            for (j = 0; j < ADDING_SIZE; j++) c.at[i][j] += a->at[i][k] * b->at[k][j];
    return c;
}

/* share a + other b. */
static adding_matrix adding_mix(double share, const adding_matrix *a, double other,
                                const adding_matrix *b) {
    adding_matrix c;
    int i, j;
    for (i = 0; i < ADDING_SIZE; i++)
        for (j = 0; j < ADDING_SIZE; j++)
            c.at[i][j] = share * a->at[i][j] + other * b->at[i][j];
    return c;
}

/* a^-1 b, by Gauss's elimination with the largest pivot. */
static adding_matrix adding_solve(adding_matrix a, adding_matrix b) {
    int i, j, k;
    for (k = 0; k < ADDING_SIZE; k++) {
        int best = k;
        double swap;
        for (i = k + 1; i < ADDING_SIZE; i++)
            if (fabs(a.at[i][k]) > fabs(a.at[best][k])) best = i;
        for (j = 0; j < ADDING_SIZE; j++) {
            swap = a.at[k][j], a.at[k][j] = a.at[best][j], a.at[best][j] = swap;
            swap = b.at[k][j], b.at[k][j] = b.at[best][j], b.at[best][j] = swap;
        }
        for (i = 0; i < ADDING_SIZE; i++) {
            double factor = a.at[i][k] / a.at[k][k];
            if (i == k) continue;
            for (j = k; j < ADDING_SIZE; j++) a.at[i][j] -= factor * a.at[k][j];
            for (j = 0; j < ADDING_SIZE; j++) b.at[i][j] -= factor * b.at[k][j];
        }
    }
    for (i = 0; i < ADDING_SIZE; i++)
        for (j = 0; j < ADDING_SIZE; j++) b.at[i][j] /= a.at[i][i];
    return b;
}

/* A layer so thin that radiance changes along a straight line in it: what leaves when the same
   (sign 1) or the opposite (-1) enters from below, over what enters from above. */
static adding_matrix adding_diamond(const adding_matrix *lost, const adding_matrix *turned,
                                    const adding_matrix *one, double sign) {
    adding_matrix slope = adding_mix(1, lost, -sign, turned);
    return adding_solve(adding_mix(1, one, 1, &slope), adding_mix(1, one, -1, &slope));
}

/* A layer; albedo may lie somewhat outside of [0,1], for differences there. `other` is the cosine
   of the second direction without weight, in (0,1]. */
static void adding_make(double b, double albedo, double g, double other, adding_layer *layer) {
    adding_matrix one, lost, turned, even, odd;
    double peak = pow(g, 2 * ADDING_NODES), step;
    int i, j, l, doublings = 0;
    adding_directions(layer, other);
    for (step = b; step > 1e-6; step /= 2) doublings++;
    for (i = 0; i < ADDING_SIZE; i++)
        for (j = 0; j < ADDING_SIZE; j++) {
            double pi = 1, pj = 1, pi_before = 0, pj_before = 0, power = 1, near = 0, far = 0;
            for (l = 0; l < 2 * ADDING_NODES; l++, power *= fabs(g)) { /* about the lobe's axis */
                double term = .5 * (2 * l + 1) * (power - peak) * pi * pj * layer->weight[j], next;
                near += term, far += l % 2 ? -term : term;
                next = ((2 * l + 1) * layer->mu[i] * pi - l * pi_before) / (l + 1);
                pi_before = pi, pi = next;
                next = ((2 * l + 1) * layer->mu[j] * pj - l * pj_before) / (l + 1);
                pj_before = pj, pj = next;
            }
            near += (i == j) * peak, one.at[i][j] = i == j;
            lost.at[i][j] = .5 * step / layer->mu[i] * ((i == j) - albedo * (g < 0 ? far : near));
            turned.at[i][j] = .5 * step / layer->mu[i] * albedo * (g < 0 ? near : far);
        }
    even = adding_diamond(&lost, &turned, &one, 1), odd = adding_diamond(&lost, &turned, &one, -1);
    layer->transmitted = adding_mix(.5, &even, .5, &odd);
    layer->reflected = adding_mix(.5, &even, -.5, &odd);
    for (; doublings; doublings--) {
        adding_matrix *r = &layer->reflected, *t = &layer->transmitted, between, through;
        between = adding_times(r, r);
        through = adding_solve(adding_mix(1, &one, -1, &between), *t);
        between = adding_times(r, &through);
        between = adding_times(t, &between);
        *t = adding_times(t, &through);
        *r = adding_mix(1, r, 1, &between);
    }
}

/* Radiance that a layer sends straight up in light that is 1 all around. */
static double adding_uniform(double b, double albedo, double g) {
    adding_layer layer;
    double sum = 0;
    int j;
    adding_make(b, albedo, g, .5, &layer);
    for (j = 0; j < ADDING_SIZE; j++)
        sum += layer.reflected.at[ADDING_DOWN][j] + layer.transmitted.at[ADDING_DOWN][j];
    return sum;
}

/* Radiance that it sends straight up in a beam from above of cosine mu and flux 1 through a plane
   across the beam. */
static double adding_beam(double b, double albedo, double g, double mu) {
    adding_layer layer;
    adding_make(b, albedo, g, mu, &layer);
    return layer.reflected.at[ADDING_DOWN][ADDING_OTHER] /
           (2 * 3.14159265358979324 * layer.weight[ADDING_OTHER]);
}
#endif
