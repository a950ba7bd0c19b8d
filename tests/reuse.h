/* One set of paths for neighbouring parameters. In a homogeneous medium the density of a path
   depends on its parameters through the number n of collisions, the length l in the medium and the
   phase functions of its turns alone, so that what it brought counts at (sigma_t', albedo', g')

       w = (sigma_t' albedo' / (sigma_t albedo))^n exp(-(sigma_t' - sigma_t) l)
           prod of p(cosine; g') / p(cosine; g)

   times, and its score is d ln w. A record keeps n, l and the sum of ln p at REUSE_NODES values of
   g around the one of the walk: the polynomial through them and it is the sum at any g' between.
   Where the sum of weights rests on few paths, (sum w v)^2 / (count sum (w v)^2) over that at w = 1
   falls, and it is time for new paths. For scenes of one medium, all of it behind boundaries that
   refract, in light of one channel. Include after itn.h and check.h's or another's `need`. */
#ifndef REUSE_H
#define REUSE_H

enum { REUSE_NODES = 4, REUSE_PARAMETERS = 3 };
static const float reuse_nodes[REUSE_NODES] = {-1, -.5f, .5f, 1}; /* times the reach, from g */

/* What a path brought to a pixel: 32 bytes. */
typedef struct reuse_path {
    int pixel, collisions;
    float value, length, turns[REUSE_NODES]; /* turns: sum of ln p(cosine; node) / p(cosine; g) */
} reuse_path;

typedef struct reuse_record {
    reuse_path *paths;
    size_t count, most; /* most: the limit, in paths; beyond it `full` is set, the rest is lost */
    int full, pixels, spp;
    double sigma_t, albedo, g, reach; /* of the walk; g' may be g +- reach */
} reuse_record;

/* The largest reach up to `wanted` whose nodes are phase functions. */
static double reuse_reach(double g, double wanted) { return fmin(wanted, .5 * (1 - fabs(g))); }

/* Adds the turn with 1 - cosine = x and 1 + cosine = y. */
static void reuse_turn(const reuse_record *record, float x, float y, float *turns) {
    double here = (double)one_phase((float)record->g, x, y).v;
    int k;
    for (k = 0; k < REUSE_NODES; k++) {
        double g = record->g + (double)reuse_nodes[k] * record->reach;
        turns[k] += (float)log((double)one_phase((float)g, x, y).v / here);
    }
}

/* ln of the phase functions' part of w, and its slope by g. */
static double reuse_phase(const reuse_record *record, const float *turns, double g, double *slope) {
    double x = (g - record->g) / record->reach, sum = 0;
    int k, j, i;
    for (*slope = 0, k = 0; k < REUSE_NODES; k++) { /* Lagrange, through 0 at x = 0 */
        double at = (double)reuse_nodes[k], basis = x / at, change = 1 / at;
        for (j = 0; j < REUSE_NODES; j++)
            if (j != k) basis *= (x - (double)reuse_nodes[j]) / (at - (double)reuse_nodes[j]);
        for (j = 0; j < REUSE_NODES; j++) { /* product rule */
            double part = x / at / (at - (double)reuse_nodes[j]);
            if (j == k) continue;
            change *= (x - (double)reuse_nodes[j]) / (at - (double)reuse_nodes[j]);
            for (i = 0; i < REUSE_NODES; i++)
                if (i != k && i != j)
                    part *= (x - (double)reuse_nodes[i]) / (at - (double)reuse_nodes[i]);
            *slope += (double)turns[k] * part / record->reach;
        }
        *slope += (double)turns[k] * change / record->reach;
        sum += (double)turns[k] * basis;
    }
    return sum;
}

/* Keeps what a walk's radiance has grown by. */
static void reuse_keep(reuse_record *record, itn__walk *walk, reuse_path *path) {
    path->value = walk->radiance[0], walk->radiance[0] = 0;
    if (path->value == 0) return;
    if (record->count < record->most) record->paths[record->count++] = *path;
    else record->full = 1;
}

/* The reference walk without links from collisions, which boundaries that refract would stop. */
static void reuse_walk(reuse_record *record, itn__walk *walk, itn_ray ray, reuse_path *path) {
    while (itn__roulette(walk)) {
        const itn__medium *medium = itn__medium_of(walk->scene, walk->place.inside);
        itn_hit hit;
        int met, goes_on = 1;
        float x, y, u, v;
        ray.tmax = medium ? one_flight((float)record->sigma_t, itn__uniform(&walk->rng))
                          : INFINITY;
        met = itn__next_hit(walk->scene, &walk->place, &ray, &hit);
        if (medium) path->length += met ? itn__max(hit.t, 0) : ray.tmax;
        if (met) {
            goes_on = itn__meet_surface(walk, &ray, &hit);
        } else if (medium) {
            goes_on = ray.tmax <= itn__way_out(walk->scene, ray.origin, ray.direction);
            ray.origin = itn__along(ray.origin, ray.tmax, ray.direction);
            u = itn__uniform(&walk->rng), v = itn__uniform(&walk->rng);
            ray.direction = one_sample_phase(ray.direction, (float)record->g, u, v, &x, &y);
            walk->weight.beta[0] *= (float)record->albedo, path->collisions++;
            reuse_turn(record, x, y, path->turns);
        } else {
            itn__escape(walk, ray.direction), goes_on = 0;
        }
        reuse_keep(record, walk, path);
        if (!goes_on) return;
    }
}

/* Records spp paths for each pixel at theta; record->paths and most are the caller's. */
static void reuse_trace(reuse_record *record, const itn_scene *scene, const float *theta, int spp,
                        uint64_t seed) {
    const itn__medium *medium = &scene->media[0];
    itn_film_desc film = scene->film;
    float none[4];
    itn__walk walk;
    int x, y, s;
    memset(&walk, 0, sizeof walk);
    walk.scene = scene, walk.theta = theta, walk.channels = 1;
    walk.weight.score = walk.connection.score = walk.derivative = none;
    record->sigma_t = (double)theta[medium->sigma_t[0]], record->g = (double)theta[medium->g[0]];
    record->albedo = (double)theta[medium->albedo], record->reach = reuse_reach(record->g, .1);
    record->pixels = film.width * film.height, record->spp = spp;
    record->count = 0, record->full = 0;
    for (y = 0; y < film.height; y++)
        for (x = 0; x < film.width; x++)
            for (s = 0; s < spp; s++) {
                reuse_path path;
                memset(&path, 0, sizeof path);
                path.pixel = y * film.width + x;
                reuse_walk(record, &walk, itn__begin_path(&walk, seed, x, y, s), &path);
            }
}

/* The image at other parameters and its derivatives by sigma_t, albedo and g: planes
   [4][pixels]. Returns the effective share of the paths. */
static double reuse_image(const reuse_record *record, double sigma_t, double albedo, double g,
                          float *planes) {
    double rate = log(sigma_t * albedo / (record->sigma_t * record->albedo));
    double sums[4] = {0, 0, 0, 0};
    size_t i, pixels = (size_t)record->pixels;
    memset(planes, 0, 4 * pixels * sizeof *planes);
    for (i = 0; i < record->count; i++) {
        const reuse_path *p = &record->paths[i];
        double slope, phase = reuse_phase(record, p->turns, g, &slope), n = p->collisions;
        double w = exp(n * rate - (sigma_t - record->sigma_t) * (double)p->length + phase);
        double before = (double)p->value, now = w * before, share = now / record->spp;
        float *pixel = planes + p->pixel;
        pixel[0] += (float)share;
        pixel[pixels] += (float)(share * (n / sigma_t - (double)p->length));
        pixel[2 * pixels] += (float)(share * n / albedo);
        pixel[3 * pixels] += (float)(share * slope);
        sums[0] += now, sums[1] += now * now, sums[2] += before, sums[3] += before * before;
    }
    return sums[1] > 0 && sums[2] > 0 ? sums[0] * sums[0] / sums[1] * sums[3] / (sums[2] * sums[2])
                                      : 0;
}
#endif
