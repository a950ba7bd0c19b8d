/* Scrambled Sobol points: direction numbers from their polynomials, stratification in one and two
   dimensions, Owen's scrambling against one that really draws a bit per node of the tree, and what
   the points are for: unbiased estimates of small variance. Every property is also asked of points
   with a planted error, which must fail. And the counters that the reference draws from. */
#define ITN_IMPLEMENTATION
#include "../itn.h"
#include "check.h"

enum { SOBOL_N = ITN__LANES, DIMENSIONS = ITN__SOBOL_DIMENSIONS, BITS = ITN__SOBOL_BITS };

static uint32_t sobol_random_state = 1;
static uint32_t sobol_random_bits(void) { return itn__mix32(sobol_random_state++, 0x2545f491u); }

/* ---- the same points, slowly ----------------------------------------------------------------- */

/* Joe & Kuo 2008: degree, inner coefficients, initial numbers. Dimension 0 has no polynomial. */
static const struct {
    int s;
    uint32_t a, m[5];
} joe_kuo[DIMENSIONS] = {{0, 0, {0}},          {1, 0, {1}},          {2, 1, {1, 3}},
                         {3, 1, {1, 3, 1}},    {3, 2, {1, 1, 1}},    {4, 1, {1, 1, 3, 3}},
                         {4, 4, {1, 3, 5, 13}}, {5, 2, {1, 1, 5, 5, 17}}};

/* Direction numbers as 32-bit fractions. */
static uint32_t directions[DIMENSIONS][BITS];

static void make_directions(void) {
    int d, i, k;
    for (d = 0; d < DIMENSIONS; d++) {
        uint32_t m[BITS];
        int s = joe_kuo[d].s;
        for (k = 0; k < BITS; k++) {
            m[k] = d == 0 ? 1 : k < s ? joe_kuo[d].m[k] : m[k - s] ^ (m[k - s] << s);
            for (i = 1; d > 0 && k >= s && i < s; i++)
                if ((joe_kuo[d].a >> (s - 1 - i)) & 1) m[k] ^= m[k - i] << i;
            directions[d][k] = m[k] << (31 - k);
        }
    }
}

static uint32_t reversed(uint32_t x) {
    uint32_t y = 0;
    int k;
    for (k = 0; k < 32; k++) y |= ((x >> k) & 1) << (31 - k);
    return y;
}

/* The unscrambled point as a 32-bit fraction. */
static uint32_t plain(uint32_t index, int dimension) {
    uint32_t x = 0;
    int k;
    for (k = 0; k < BITS; k++)
        if ((index >> k) & 1) x ^= directions[dimension][k];
    return x;
}

/* What the points are made by: the library, the same slowly, a true Owen scrambling with a random
   bit for every node, no scrambling but random numbers; and planted errors. */
typedef enum maker {
    LIBRARY, SLOW, TRUE_OWEN, RANDOM,
    DIGIT_FLIPS,       /* all nodes of a level share one bit */
    WRONG_DIRECTION,   /* one digit of one direction number: each dimension stays even */
    EVEN_DIRECTION,    /* its last digit: points coincide */
    LEAKY,             /* a full hash: lower digits reach the higher ones */
    SHARED_KEY,        /* all dimensions scrambled alike */
    RAW_SEED,          /* seeds used as they come */
    CENTRED            /* first digit never flipped */
} maker;

static uint32_t scramble_truly(uint32_t x, uint64_t key) {
    uint32_t y = 0;
    int k;
    for (k = 0; k < 23; k++) {
        uint64_t node = ((uint64_t)k << 32) | (k ? x >> (32 - k) : 0);
        y |= (((x >> (31 - k)) ^ (uint32_t)(itn__mix64(itn__mix64(node) ^ key) >> 63)) & 1)
             << (31 - k);
    }
    return y;
}

static uint32_t scramble_slowly(uint32_t x, uint32_t key) {
    uint32_t factor = key * 0x9e3779b1u;
    factor ^= factor >> 16;
    x = reversed(x);
    x ^= x * 0x3d20adeau;
    x = (x + key) * (factor | 1);
    x ^= x * 0x05526c56u;
    x ^= x * 0x53a22864u;
    return reversed(x);
}

static float slow_point(maker how, uint32_t index, int dimension, uint32_t seed) {
    uint32_t x = plain(index, dimension), own = seed + (uint32_t)dimension * 0xb5297a4du;
    uint32_t key = itn__mix32(own, 0);
    switch (how) {
    case TRUE_OWEN:
        x = scramble_truly(x, itn__mix64(((uint64_t)seed << 8) + (uint64_t)dimension + 1));
        break;
    case RANDOM:
        x = itn__mix32(index * 0x9e3779b9u + 77, key);
        break;
    case DIGIT_FLIPS: x ^= key; break;
    case WRONG_DIRECTION:
        if (index & 4) x ^= 1u << 30;
        x = scramble_slowly(x, key);
        break;
    case EVEN_DIRECTION:
        if (index & 4) x ^= 1u << 29;
        x = scramble_slowly(x, key);
        break;
    case LEAKY: x = itn__mix32(x, key); break;
    case SHARED_KEY: x = scramble_slowly(x, itn__mix32(seed, 0)); break;
    case RAW_SEED: x = scramble_slowly(x, own); break;
    case CENTRED: x = (scramble_slowly(x, key) & 0x7fffffffu) | (x & 0x80000000u); break;
    default: x = scramble_slowly(x, key); break;
    }
    return itn__unit_float(x);
}

/* out[i] = point index[i] with seed[i]. */
static void make_points(maker how, const uint32_t *index, int dimension, const uint32_t *seed,
                        int count, float *out) {
    int i, k;
    for (i = 0; i < count; i += SOBOL_N) {
        uint32_t in[SOBOL_N], seeds[SOBOL_N];
        float u[SOBOL_N];
        for (k = 0; k < SOBOL_N; k++) {
            int j = i + k < count ? i + k : count - 1;
            in[k] = index[j], seeds[k] = seed[j];
        }
        if (how == LIBRARY)
            itn__store(u, itn__sobol(itn__int_words(itn__load_ints((const int32_t *)in)), dimension,
                                     itn__int_words(itn__load_ints((const int32_t *)seeds))));
        else
            for (k = 0; k < SOBOL_N; k++) u[k] = slow_point(how, in[k], dimension, seeds[k]);
        for (k = 0; k < SOBOL_N && i + k < count; k++) out[i + k] = u[k];
    }
}
/* Points first ... first + count - 1 with one seed. */
static void make_sequence(maker how, uint32_t first, int count, int dimension, uint32_t seed,
                          float *out) {
    uint32_t index[1024], seeds[1024];
    int i;
    for (i = 0; i < count; i++) index[i] = first + (uint32_t)i, seeds[i] = seed;
    make_points(how, index, dimension, seeds, count, out);
}
/* Whether u is not an odd multiple of 2^-24, or of 2^-33 if it is below 2^-9. */
static int sobol_even(float u) { return !((uint32_t)ldexpf(u, u < ldexpf(1, -9) ? 33 : 24) & 1); }
/* The 23 digits of a point, first digit highest. */
static uint32_t digits(float u) { return (uint32_t)(u * 8388608.f); }

static void test_directions(void) {
    int d, k, wrong = 0;
    for (d = 0; d < DIMENSIONS; d++)
        for (k = 0; k < BITS; k++) {
            wrong += reversed(directions[d][k]) != itn__sobol_directions[d][k];
            wrong += itn__sobol_directions[d][k] >> k != 1; /* m_k is odd, v_k has k + 1 digits */
        }
    CHECK(wrong == 0);
    for (k = 0; k < 1000; k++) {
        uint32_t x = sobol_random_bits();
        itn__words y = itn__reverse_words(itn__splat_word(x));
        wrong += ITN__LANE(y, k % SOBOL_N) != reversed(x);
    }
    CHECK(wrong == 0);
}

/* Lanes with indices of any size mixed, against the slow points; all strictly inside (0, 1). */
static void test_sobol_equal(maker how) {
    int turn, k, wrong = 0, outside = 0, even = 0;
    for (turn = 0; turn < 20000; turn++) {
        uint32_t index[SOBOL_N], seed[SOBOL_N];
        float u[SOBOL_N];
        int d = turn % DIMENSIONS;
        for (k = 0; k < SOBOL_N; k++) {
            index[k] = sobol_random_bits() >> (12 + sobol_random_bits() % 20);
            seed[k] = sobol_random_bits() >> (sobol_random_bits() % 32);
            if (turn < 8) index[k] = turn < 4 ? 0 : (1u << BITS) - 1;
        }
        make_points(how, index, d, seed, SOBOL_N, u);
        for (k = 0; k < SOBOL_N; k++) {
            wrong += !(u[k] == slow_point(SLOW, index[k], d, seed[k]));
            outside += !(u[k] > 0 && u[k] < 1), even += sobol_even(u[k]);
        }
    }
    CHECK(wrong == 0);
    CHECK(outside == 0);
    CHECK(even == 0);
}

/* ---- stratification -------------------------------------------------------------------------- */

enum { MOST_BITS = 10 };

/* One of the first 2^m points, and of a later run of as many, in each of 2^m equal intervals. */
static void test_strata(maker how, int seeds) {
    int m, d, s, i, wrong = 0;
    for (s = 0; s < seeds; s++)
        for (d = 0; d < DIMENSIONS; d++)
            for (m = 0; m <= MOST_BITS; m++) {
                float u[1 << MOST_BITS];
                char full[1 << MOST_BITS] = {0};
                uint32_t seed = s & 1 ? sobol_random_bits() : (uint32_t)s;
                make_sequence(how, s % 3 ? 0 : (uint32_t)s << m, 1 << m, d, seed, u);
                for (i = 0; i < 1 << m; i++) full[digits(u[i]) >> (23 - m)]++;
                for (i = 0; i < 1 << m; i++) wrong += full[i] != 1;
            }
    CHECK(wrong == 0);
}

/* The least t for which every box of 2^-a by 2^-(m-t-a) holds 2^t of the 2^m points. */
static int net_quality(const uint32_t *x, const uint32_t *y, int m) {
    int t, a, i;
    for (t = 0; t < m; t++) {
        int even = 1;
        for (a = 0; a <= m - t && even; a++) {
            int b = m - t - a, count[1 << MOST_BITS] = {0};
            for (i = 0; i < 1 << m; i++)
                count[((a ? x[i] >> (32 - a) : 0) << b) | (b ? y[i] >> (32 - b) : 0)]++;
            for (i = 0; i < 1 << (m - t); i++) even = even && count[i] == 1 << t;
        }
        if (even) return t;
    }
    return m;
}

/* Scrambled pairs of dimensions are nets of the same quality as the plain ones; dimensions 0 and 1
   are perfect at every length. */
static void test_nets(maker how, int seeds) {
    int m, a, b, s, i, wrong = 0, imperfect = 0;
    for (a = 0; a < DIMENSIONS; a++)
        for (b = a + 1; b < DIMENSIONS; b++)
            for (m = 2; m <= 8; m++) {
                uint32_t x[256], y[256];
                int quality;
                for (i = 0; i < 1 << m; i++)
                    x[i] = plain((uint32_t)i, a), y[i] = plain((uint32_t)i, b);
                quality = net_quality(x, y, m);
                imperfect += a == 0 && b == 1 && quality != 0;
                for (s = 0; s < (b == a + 1 ? seeds : 1 + seeds / 8); s++) {
                    float u[256], v[256];
                    uint32_t seed = s & 1 ? sobol_random_bits() : (uint32_t)s;
                    make_sequence(how, 0, 1 << m, a, seed, u);
                    make_sequence(how, 0, 1 << m, b, seed, v);
                    for (i = 0; i < 1 << m; i++) x[i] = digits(u[i]) << 9, y[i] = digits(v[i]) << 9;
                    wrong += net_quality(x, y, m) != quality;
                }
            }
    CHECK(wrong == 0);
    CHECK(imperfect == 0);
}

/* ---- independence of the flips --------------------------------------------------------------- */

enum { LEVELS = 6, NODES = (1 << LEVELS) - 1, WORDS = 256, SOBOL_SEEDS = 64 * WORDS };

static int set_bits(uint64_t x) {
    int count = 0;
    for (; x; x &= x - 1) count++;
    return count;
}
/* Standard deviations by which the flips a and b agree too often or too rarely. */
static double agreement(const uint64_t *a, const uint64_t *b) {
    long same = 0;
    int w;
    for (w = 0; w < WORDS; w++) same += set_bits(~(a[w] ^ b[w]));
    return (2. * (double)same - SOBOL_SEEDS) / sqrt(SOBOL_SEEDS);
}

/* flips[node] has a bit per seed: whether the digit after this prefix is flipped. Point i < 2^k is
   alone with its prefix of k digits. */
static void make_flips(maker how, int dimension, uint64_t flips[NODES][WORDS]) {
    static uint32_t index[SOBOL_SEEDS], seed[SOBOL_SEEDS];
    static float u[SOBOL_SEEDS];
    int k, s, node = 0;
    uint32_t i;
    memset(flips, 0, sizeof(uint64_t) * NODES * WORDS);
    for (k = 0; k < LEVELS; k++)
        for (i = 0; i < 1u << k; i++, node++) {
            uint32_t digit = plain(i, dimension) >> (31 - k);
            for (s = 0; s < SOBOL_SEEDS; s++) index[s] = i, seed[s] = (uint32_t)s;
            make_points(how, index, dimension, seed, SOBOL_SEEDS, u);
            for (s = 0; s < SOBOL_SEEDS; s++)
                flips[node][s / 64] |= (uint64_t)(((digits(u[s]) >> (22 - k)) ^ digit) & 1)
                                       << (s % 64);
        }
}

/* A sum of squares of `count` normal numbers, and the largest, are what chance gives. */
static void check_chance(double squares, double largest, int count, const char *what) {
    check_report(fabs(squares / count - 1) <= 5 * sqrt(2. / count) && largest <= 5.3, __FILE__,
                 __LINE__, "%s: mean square %.3f of %d, largest %.2f sigma", what, squares / count,
                 count, largest);
}

/* All flips of the first levels of one dimension over consecutive seeds: fair, and independent in
   pairs, which is all that variances depend on. */
static void test_flips(maker how, int dimension) {
    static uint64_t flips[NODES][WORDS];
    static const uint64_t none[WORDS];
    double z, squares = 0, largest = 0, fair_squares = 0, fair_largest = 0;
    int a, b;
    make_flips(how, dimension, flips);
    for (a = 0; a < NODES; a++) {
        z = agreement(flips[a], none);
        fair_squares += z * z, fair_largest = fmax(fair_largest, fabs(z));
        for (b = 0; b < a; b++) {
            z = agreement(flips[a], flips[b]);
            squares += z * z, largest = fmax(largest, fabs(z));
        }
    }
    check_chance(fair_squares, fair_largest, NODES, "flips");
    check_chance(squares, largest, NODES * (NODES - 1) / 2, "pairs of flips");
}

/* Flips of two dimensions with the same seed are independent. */
static void test_dimensions_apart(maker how) {
    static uint64_t flips[DIMENSIONS][NODES][WORDS];
    double squares = 0, largest = 0;
    int d, e, a, b, count = 0;
    for (d = 0; d < DIMENSIONS; d++) make_flips(how, d, flips[d]);
    for (d = 0; d < DIMENSIONS; d++)
        for (e = 0; e < d; e++)
            for (a = 0; a < 15; a++)
                for (b = 0; b < 15; b++) {
                    double z = agreement(flips[d][a], flips[e][b]);
                    squares += z * z, largest = fmax(largest, fabs(z)), count++;
                }
    check_chance(squares, largest, count, "dimensions");
}

/* All 23 digits of some points: fair, and independent of those of the seeds that follow. */
static void test_seeds_apart(maker how) {
    enum { COUNT = SOBOL_SEEDS, APART = 8 };
    static uint32_t index[COUNT + APART], seed[COUNT + APART];
    static float u[COUNT + APART];
    static const uint32_t points[] = {0, 1, 2, 5, 21, 63, 100, 255, 1000, 65535};
    double squares = 0, largest = 0, fair_squares = 0, fair_largest = 0;
    int p, d, apart, bit, s, count = 0, fair_count = 0;
    for (p = 0; p < 10; p++) {
        d = p % DIMENSIONS;
        for (s = 0; s < COUNT + APART; s++) index[s] = points[p], seed[s] = (uint32_t)s;
        make_points(how, index, d, seed, COUNT + APART, u);
        for (apart = 0; apart <= APART; apart++) {
            int same[23] = {0};
            for (s = 0; s < COUNT; s++) {
                uint32_t x = digits(u[s]) ^ (apart ? digits(u[s + apart]) : 0);
                for (bit = 0; bit < 23; bit++) same[bit] += (x >> bit) & 1;
            }
            for (bit = 0; bit < 23; bit++) {
                double z = (2. * same[bit] - COUNT) / sqrt(COUNT);
                if (apart)
                    squares += z * z, largest = fmax(largest, fabs(z)), count++;
                else
                    fair_squares += z * z, fair_largest = fmax(fair_largest, fabs(z)), fair_count++;
            }
        }
    }
    check_chance(fair_squares, fair_largest, fair_count, "digits");
    check_chance(squares, largest, count, "seeds");
}

/* ---- integrals ------------------------------------------------------------------------------- */

/* Functions of the first `dimensions` coordinates whose integral is 1. */
typedef struct integrand {
    const char *name;
    int dimensions;
    double (*value)(const float *u, int dimensions);
} integrand;

static double linear(const float *u, int dimensions) {
    (void)dimensions;
    return 2 * (double)u[0];
}
static double bell(const float *u, int dimensions) {
    double product = 1;
    int d;
    for (d = 0; d < dimensions; d++) product *= 6 * (double)u[d] * (1 - (double)u[d]);
    return product;
}
static double growth(const float *u, int dimensions) {
    double sum = 0;
    int d;
    for (d = 0; d < dimensions; d++) sum += (double)u[d] / dimensions;
    return exp(sum) / pow(dimensions * (exp(1. / dimensions) - 1), dimensions);
}
static double sobol_corner(const float *u, int dimensions) {
    (void)dimensions;
    return u[0] + u[1] < 1 ? 2 : 0;
}
static const integrand integrands[] = {
    {"linear", 1, linear}, {"bell", 2, bell}, {"corner", 2, sobol_corner}, {"growth", 2, growth},
    {"growth", 4, growth}, {"bell", 4, bell}, {"growth", 8, growth}, {"bell", 8, bell}};
enum { INTEGRANDS = 8 };

/* Mean and variance over `seeds` consecutive seeds of the mean of the first `count` points. */
static void estimate(maker how, const integrand *f, int count, int seeds, double *mean,
                     double *variance) {
    double sum = 0, squares = 0;
    int s, d, i;
    for (s = 0; s < seeds; s++) {
        float u[DIMENSIONS][256];
        double result = 0;
        for (d = 0; d < f->dimensions; d++)
            make_sequence(how, 0, count, d, (uint32_t)s, u[d]);
        for (i = 0; i < count; i++) {
            float point[DIMENSIONS];
            for (d = 0; d < f->dimensions; d++) point[d] = u[d][i];
            result += f->value(point, f->dimensions) / count;
        }
        sum += result, squares += (result - 1) * (result - 1);
    }
    *mean = sum / seeds;
    *variance = squares / seeds - (*mean - 1) * (*mean - 1);
}

/* Estimates are unbiased for any number of points: within 4 standard errors over 10^4 seeds. */
static void test_unbiased(maker how, int seeds) {
    static const int counts[] = {1, 3, 8, 16};
    int f, c;
    for (f = 0; f < INTEGRANDS; f++)
        for (c = 0; c < 4; c++) {
            double mean, variance;
            estimate(how, &integrands[f], counts[c], seeds, &mean, &variance);
            CHECK_MEAN(mean, sqrt(variance / seeds), 1, 4, 2 / sqrt((double)seeds * counts[c]));
        }
}

/* The variance is that of a true Owen scrambling, which for a linear function is known: 1/(3 n^3);
   and it is smaller than that of random points by at least the stated factors. */
static void test_variance(maker how, int seeds) {
    /* random over scrambled, 64 and 256 points: two thirds of what a true scrambling gives */
    static const double least[INTEGRANDS][2] = {
        {2700, 45000},  {55, 580}, {5, 10.5},   {1900, 30000},
        {1700, 19000}, {9, 30},   {540, 9000}, {2.1, 3}};
    int f, m;
    for (f = 0; f < INTEGRANDS; f++)
        for (m = 6; m <= 8; m += 2) {
            double mean, variance, owen, random;
            int count = 1 << m;
            estimate(how, &integrands[f], count, seeds, &mean, &variance);
            estimate(TRUE_OWEN, &integrands[f], count, seeds, &mean, &owen);
            estimate(RANDOM, &integrands[f], count, seeds / 4, &mean, &random);
            if (!check_quiet)
                printf("%-7s %d dimensions, %3d points: variance %.3g, Owen's %.3g, random %.3g\n",
                       integrands[f].name, integrands[f].dimensions, count, variance, owen, random);
            check_report(fabs(variance / owen - 1) <= .15 * sqrt(4000. / seeds), __FILE__, __LINE__,
                         "%s: variance %g, Owen's is %g", integrands[f].name, variance, owen);
            check_report(random / variance >= least[f][m == 8], __FILE__, __LINE__,
                         "%s: only %g times better than random", integrands[f].name,
                         random / variance);
            if (f == 0) CHECK_NEAR(variance * 3 * pow(count, 3), 1, .12 * sqrt(4000. / seeds));
        }
}

/* ---- counters -------------------------------------------------------------------------------- */

/* Numbers of a path depend on each of seed, pixel, sample and dimension, and are not repeated where
   the three are exchanged or large. */
static void test_counters(void) {
    enum { PATHS = 4096 };
    static uint32_t bits[PATHS];
    int i, j, repeated = 0;
    for (i = 0; i < PATHS; i++) {
        itn__rng rng = itn__rng_make((uint64_t)(i % 16), (uint64_t)(i / 16 % 16),
                                     (uint64_t)(i / 256) * 0x10000000ull);
        bits[i] = itn__rng_bits(&rng);
        for (j = 0; j < i; j++) repeated += bits[i] == bits[j];
    }
    CHECK(repeated < 20); /* 2 are expected among 2^23 pairs of 2^32 values */
}

int main(void) {
    int d, cut = 1;
#ifdef ITN_SANITIZED
    cut = 8;
#endif
    make_directions();
    test_directions();
    test_sobol_equal(LIBRARY);
    CHECK_CATCHES(test_sobol_equal(WRONG_DIRECTION));
    test_strata(LIBRARY, 64 / cut);
    CHECK_CATCHES(test_strata(EVEN_DIRECTION, 8));
    CHECK_CATCHES(test_strata(LEAKY, 8));
    CHECK_CATCHES(test_strata(RANDOM, 8));
    test_nets(LIBRARY, 64 / cut);
    CHECK_CATCHES(test_nets(LEAKY, 8));
    CHECK_CATCHES(test_nets(WRONG_DIRECTION, 8));
    for (d = 0; d < DIMENSIONS; d += cut) test_flips(LIBRARY, d);
    CHECK_CATCHES(test_flips(DIGIT_FLIPS, 0));
    CHECK_CATCHES(test_flips(DIGIT_FLIPS, 3));
    CHECK_CATCHES(test_flips(RAW_SEED, 0));
    CHECK_CATCHES(test_flips(CENTRED, 0));
    test_dimensions_apart(LIBRARY);
    CHECK_CATCHES(test_dimensions_apart(SHARED_KEY));
    test_seeds_apart(LIBRARY);
    CHECK_CATCHES(test_seeds_apart(RAW_SEED));
    test_unbiased(LIBRARY, 10000 / cut);
    CHECK_CATCHES(test_unbiased(SHARED_KEY, 2000));
    CHECK_CATCHES(test_unbiased(CENTRED, 2000));
    test_variance(LIBRARY, 4000 / cut);
    CHECK_CATCHES(test_variance(DIGIT_FLIPS, 500));
    CHECK_CATCHES(test_variance(WRONG_DIRECTION, 500));
    CHECK_CATCHES(test_variance(RANDOM, 500));
    test_counters();
    return check_end("sobol");
}
