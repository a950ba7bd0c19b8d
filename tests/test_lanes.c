/* Lanes: every word of the vocabulary against its meaning for one number, under all masks, and the
   elementary functions against double over the floats of their domains: all 2^23 uniform numbers
   for log, sine and cosine, elsewhere every STEP-th float, or with ITN_LONG_TESTS=1 in the
   environment every single one. The suite prints the largest error of each in units in the last
   place. */
#define ITN_IMPLEMENTATION
#include "../itn.h"
#include "check.h"
#include "frame.h"

enum { N = ITN__LANES };
static const double lanes_pi = 3.14159265358979323846;

static uint32_t lanes_random_state = 1;
static uint32_t lanes_random_bits(void) { return itn__mix32(lanes_random_state++, 0x2545f491u); }
static float random_float(void) { return (float)(lanes_random_bits() >> 8) / 8388608.f - 1; }

static float from_bits(uint32_t bits) {
    float x;
    memcpy(&x, &bits, sizeof x);
    return x;
}
static uint32_t to_bits(float x) {
    uint32_t bits;
    memcpy(&bits, &x, sizeof bits);
    return bits;
}
/* The same bits, or both NaN. */
static int same(float a, float b) { return to_bits(a) == to_bits(b) || (a != a && b != b); }

/* Numbers that try every branch a comparison could have. */
static const float special[] = {0,      -0.f,    1,      -1,     .5f,   2.5f,   -2.5f,
                                1e-40f, -1e-40f, 3.4e38f, 1e9f,  -1e9f, 3,      -3,
                                .75f,   1e30f,   -1e30f, 1e-30f, INFINITY, -INFINITY, NAN};
enum { SPECIALS = sizeof special / sizeof *special };

/* ---- memory and constants -------------------------------------------------------------------- */

static void test_lanes_memory(void) {
    float floats[3 * N + 1], copy[3 * N + 1];
    int32_t ints[3 * N + 1], ints_copy[3 * N + 1];
    uint8_t bytes_copy[3 * N + 1];
    int start, k;
    for (k = 0; k < 3 * N + 1; k++) {
        floats[k] = random_float(), ints[k] = (int32_t)lanes_random_bits();
        copy[k] = 7, ints_copy[k] = 7, bytes_copy[k] = 7;
    }
    for (start = 0; start <= N; start++) { /* every offset, most of them odd addresses */
        int wrong = 0;
        itn__ints loaded;
        itn__store(copy + start, itn__load(floats + start + N));
        loaded = itn__load_ints(ints + start + N);
        memcpy(ints_copy + start, &loaded, sizeof loaded);
        itn__store_bytes(bytes_copy + start, loaded & 255);
        for (k = 0; k < N; k++)
            wrong += !same(copy[start + k], floats[start + N + k]) ||
                     ints_copy[start + k] != ints[start + N + k] ||
                     bytes_copy[start + k] != (uint8_t)ints[start + N + k];
        CHECK(wrong == 0);
        CHECK(same(copy[start + N], 7) && ints_copy[start + N] == 7 && bytes_copy[start + N] == 7);
    }
}

static void test_constants(void) {
    itn__ints numbers = itn__lane_numbers(), i = itn__splat_int(INT32_MIN);
    itn__words w = itn__splat_word(0xfedcba98u);
    int s, k, wrong = 0;
    for (s = 0; s < SPECIALS; s++) {
        itn__floats v = itn__splat(special[s]);
        for (k = 0; k < N; k++) wrong += !same(ITN__LANE(v, k), special[s]);
    }
    for (k = 0; k < N; k++)
        wrong += ITN__LANE(numbers, k) != k || ITN__LANE(i, k) != INT32_MIN ||
                 ITN__LANE(w, k) != 0xfedcba98u;
    CHECK(wrong == 0);
}

/* ---- conversions, comparisons, selections ---------------------------------------------------- */

/* Whether one lane is not what it should be. */
ITN__INLINE int mask_off(itn__ints mask, int lane, int expected) {
    return ITN__LANE(mask, lane) != (expected ? -1 : 0);
}
ITN__INLINE int float_off(itn__floats v, int lane, float expected) {
    return !same(ITN__LANE(v, lane), expected);
}
ITN__INLINE int int_off(itn__ints v, int lane, double expected) {
    return ITN__LANE(v, lane) != (int32_t)expected;
}

/* One lane of every function of two numbers a, b. */
static int pair_wrong(float a, float b, int lane) {
    itn__floats x = itn__splat(.25f), y = itn__splat(.125f);
    uint32_t sign = to_bits(b) & 0x80000000u;
    int wrong = 0;
    ITN__LANE(x, lane) = a, ITN__LANE(y, lane) = b;
    wrong += mask_off(itn__less(x, y), lane, a < b);
    wrong += mask_off(itn__less_equal(x, y), lane, a <= b);
    wrong += float_off(itn__least(x, y), lane, a < b ? a : b);
    wrong += float_off(itn__most(x, y), lane, b < a ? a : b);
    wrong += float_off(itn__absolute(x), lane, fabsf(a));
    wrong += float_off(itn__with_sign(x, y), lane, from_bits((to_bits(a) & 0x7fffffffu) | sign));
    wrong += float_off(itn__root(itn__absolute(x)), lane, sqrtf(fabsf(a)));
    wrong += float_off(itn__safe_root(x), lane, a > 0 ? sqrtf(a) : 0);
    wrong += float_off(itn__bits_float(itn__float_bits(x)), lane, a);
    if (fabs((double)a) < 2e9) {
        wrong += int_off(itn__floor_ints(x), lane, floor((double)a));
        wrong += int_off(itn__to_ints(x), lane, (double)a);
    }
    if (fabs((double)a) < 4e6) wrong += int_off(itn__nearest_ints(x), lane, rint((double)a));
    return wrong;
}

static void test_pairs(void) {
    int a, b, k, wrong = 0;
    for (a = 0; a < SPECIALS; a++)
        for (b = 0; b < SPECIALS; b++)
            for (k = 0; k < N; k++) wrong += pair_wrong(special[a], special[b], k);
    for (a = 0; a < 20000; a++) {
        float x = random_float() * ldexpf(1, (int)(lanes_random_bits() % 50) - 25);
        wrong += pair_wrong(x, a & 1 ? x : random_float(), a % N);
    }
    CHECK(wrong == 0);
}

static void test_ints(void) {
    static const int32_t value[] = {0, 1, -1, 2, -2, 1000, INT32_MAX, INT32_MIN, INT32_MIN + 1};
    int a, b, k, wrong = 0;
    for (a = 0; a < 9; a++)
        for (b = 0; b < 9; b++)
            for (k = 0; k < N; k++) {
                itn__ints x = itn__splat_int(5), y = itn__splat_int(6), less, equal;
                itn__words bits;
                itn__floats f;
                ITN__LANE(x, k) = value[a], ITN__LANE(y, k) = value[b];
                less = itn__int_less(x, y), equal = itn__int_equal(x, y);
                bits = itn__int_words(x), f = itn__to_floats(x);
                wrong += ITN__LANE(less, k) != -(value[a] < value[b]);
                wrong += ITN__LANE(equal, k) != -(value[a] == value[b]);
                wrong += ITN__LANE(bits, k) != (uint32_t)value[a];
                wrong += !same(ITN__LANE(f, k), (float)value[a]);
                x = itn__word_ints(bits);
                wrong += ITN__LANE(x, k) != value[a];
            }
    CHECK(wrong == 0);
}

/* ---- masks ----------------------------------------------------------------------------------- */

/* Everything that takes a mask, under one mask. `shift` plants an error: another lane's bit. */
static int mask_wrong(unsigned bits, int shift) {
    float a[N], b[N], base[4 * N];
    int32_t ia[N], ib[N], index[N], base_ints[4 * N];
    itn__ints mask = itn__bits_mask(bits), selected, gathered_ints;
    itn__floats chosen, gathered;
    itn__vectors va, vb, vs;
    int k, count = 0, wrong = itn__mask_bits(mask) != bits;
    for (k = 0; k < 4 * N; k++)
        base[k] = random_float(), base_ints[k] = (int32_t)lanes_random_bits();
    for (k = 0; k < N; k++) {
        a[k] = random_float(), b[k] = random_float();
        ia[k] = (int32_t)lanes_random_bits(), ib[k] = (int32_t)lanes_random_bits();
        /* where the mask is false nothing may be read: these addresses would crash */
        index[k] = (bits >> k) & 1 ? (int32_t)(lanes_random_bits() % (4 * N)) : INT32_MAX - k;
    }
    selected = itn__select_int(mask, itn__load_ints(ia), itn__load_ints(ib));
    chosen = itn__select(mask, itn__load(a), itn__load(b));
    gathered = itn__gather(base, itn__load_ints(index), mask, itn__load(b));
    gathered_ints = itn__gather_ints(base_ints, itn__load_ints(index), mask, itn__load_ints(ib));
    va = itn__vectors_of(itn__load(a), itn__load(b), itn__load(base));
    vb = itn__vectors_of(itn__load(b), itn__load(base), itn__load(a));
    vs = itn__vselect(mask, va, vb);
    for (k = 0; k < N; k++) {
        int on = (int)(bits >> ((k + shift) % N)) & 1;
        wrong += ITN__LANE(mask, k) != -on;
        wrong += ITN__LANE(selected, k) != (on ? ia[k] : ib[k]);
        wrong += !same(ITN__LANE(chosen, k), on ? a[k] : b[k]);
        wrong += !same(ITN__LANE(vs.x, k), on ? a[k] : b[k]) ||
                 !same(ITN__LANE(vs.y, k), on ? b[k] : base[k]) ||
                 !same(ITN__LANE(vs.z, k), on ? base[k] : a[k]);
        if (shift) continue;
        wrong += !same(ITN__LANE(gathered, k), on ? base[index[k]] : b[k]);
        wrong += ITN__LANE(gathered_ints, k) != (on ? base_ints[index[k]] : ib[k]);
        if (!on) continue;
        if (count == 0) wrong += itn__lowest_bit(bits) != k;
        count++;
    }
    wrong += !shift && itn__count_bits(bits) != count;
    return wrong;
}

static void test_masks(int shift) {
    unsigned bits;
    int wrong = 0;
    for (bits = 0; bits <= ITN__ALL_LANES; bits++) wrong += mask_wrong(bits, shift);
    CHECK(wrong == 0);
}

/* ---- vectors and random numbers -------------------------------------------------------------- */

static itn_vec3 lane_of(itn__vectors v, int k) {
    return itn__vec3(ITN__LANE(v.x, k), ITN__LANE(v.y, k), ITN__LANE(v.z, k));
}
static int close3(itn_vec3 a, itn_vec3 b, float tolerance) {
    return itn__max_abs(itn__sub(a, b)) <= tolerance;
}
static itn__vectors vectors_from(const itn_vec3 *v) {
    itn__vectors r = itn__vectors_of(itn__splat(0), itn__splat(0), itn__splat(0));
    int k;
    for (k = 0; k < N; k++)
        ITN__LANE(r.x, k) = v[k].x, ITN__LANE(r.y, k) = v[k].y, ITN__LANE(r.z, k) = v[k].z;
    return r;
}

/* Vectors of lanes do what the scalar functions do, but for contraction. */
static void test_vectors(void) {
    int turn, k, wrong = 0;
    for (turn = 0; turn < 2000; turn++) {
        itn_vec3 a[N], b[N], s, t;
        itn__vectors va, vb, n, vs, vt, out, world, along;
        itn__floats length, dot;
        for (k = 0; k < N; k++) {
            a[k] = itn__vec3(random_float(), random_float(), random_float());
            b[k] = itn__vec3(random_float(), random_float(), random_float());
            if (turn % 10 == 0) a[k] = itn__vec3(0, 0, k & 1 ? -1.f : 1.f);
            if (turn % 10 == 1) a[k].z = k & 1 ? -0.f : 0.f;
        }
        va = vectors_from(a), vb = vectors_from(b), n = itn__vnormalize(va);
        itn__vframe(n, &vs, &vt);
        out = itn__vto_local(vb, vs, vt, n), world = itn__vto_world(out, vs, vt, n);
        length = itn__splat(random_float()), dot = itn__vdot(va, vb);
        along = itn__valong(va, length, vb);
        va = itn__vscale(va, length);
        for (k = 0; k < N; k++) {
            itn_vec3 unit = itn__normalize(a[k]), local;
            float r = ITN__LANE(length, k);
            scalar_frame(unit, &s, &t);
            local = scalar_to_local(b[k], s, t, unit);
            wrong += !close3(lane_of(n, k), unit, 3e-7f) || !close3(lane_of(vs, k), s, 3e-6f) ||
                     !close3(lane_of(vt, k), t, 3e-6f) || !close3(lane_of(out, k), local, 5e-6f) ||
                     !close3(lane_of(world, k), b[k], 5e-6f) ||
                     !close3(lane_of(along, k), itn__along(a[k], r, b[k]), 3e-7f) ||
                     !close3(lane_of(va, k), itn__scale(a[k], r), 1e-7f);
            wrong += !(fabsf(ITN__LANE(dot, k) - itn__dot(a[k], b[k])) <= 4e-7f);
        }
    }
    CHECK(wrong == 0);
}

/* The lanes draw exactly what each path alone would; masked paths wait. `skip` plants an error. */
static void test_uniforms(uint32_t skip) {
    itn__rng rng[N];
    itn__words key0 = itn__splat_word(0), key1 = itn__splat_word(0);
    itn__ints dimension = itn__splat_int(0);
    int turn, k, wrong = 0;
    for (k = 0; k < N; k++) {
        rng[k] = itn__rng_make(5, (uint64_t)k, 3);
        ITN__LANE(key0, k) = rng[k].key0, ITN__LANE(key1, k) = rng[k].key1;
    }
    for (turn = 0; turn < 5000; turn++) {
        unsigned bits = lanes_random_bits() & ITN__ALL_LANES;
        itn__floats u = itn__uniforms(key0, key1, &dimension, itn__bits_mask(bits));
        for (k = 0; k < N; k++) {
            if ((bits >> k) & 1) wrong += !same(ITN__LANE(u, k), itn__uniform(&rng[k]));
            if (turn == 1000) rng[k].dimension += skip;
            wrong += (uint32_t)ITN__LANE(dimension, k) != rng[k].dimension;
        }
    }
    CHECK(wrong == 0);
    for (turn = 0; turn < 5000; turn++) {
        uint32_t a = lanes_random_bits(), b = lanes_random_bits();
        float scaled;
        itn__words mixed = itn__mix_words(itn__splat_word(a), itn__splat_word(b));
        itn__floats u = itn__unit_floats(mixed);
        wrong += ITN__LANE(mixed, turn % N) != itn__mix32(a, b);
        scaled = ITN__LANE(u, turn % N);
        scaled = ldexpf(scaled, scaled < ldexpf(1, -9) ? 33 : 24); /* an odd number of those */
        wrong += scaled != floorf(scaled) || fmodf(scaled, 2) != 1;
    }
    CHECK(wrong == 0);
    {
        itn__floats ends = itn__unit_floats(itn__splat_word(0));
        CHECK(same(ITN__LANE(ends, 0), ldexpf(1, -33)));
        ends = itn__unit_floats(itn__splat_word(0xffffffffu));
        CHECK(same(ITN__LANE(ends, 0), 1 - ldexpf(1, -24)));
    }
}

/* ---- elementary functions -------------------------------------------------------------------- */

typedef enum function {
    LOG, EXP, SINE, COSINE, ATAN_STEEP, ATAN_FLAT, ATAN_BACK
} function;
static const char *const names[] = {"log", "exp", "sine", "cosine", "atan2 (x, 1)",
                                    "atan2 (1, x)", "atan2 (x, -1)"};
/* The bounds that the comments of the chapter state, in units in the last place. */
static const double bound[] = {1.9, 1.1, 1.7, 1.7, 2, 2, 2};

static void evaluate(function which, const float *x, float *out) {
    itn__floats v = itn__load(x), s, c, one = itn__splat(1);
    switch (which) {
    case LOG: v = itn__vlog(v); break;
    case EXP: v = itn__vexp(v); break;
    case SINE:
    case COSINE:
        itn__vsincos_turns(v, &s, &c);
        v = which == SINE ? s : c;
        break;
    case ATAN_STEEP: v = itn__vatan2(v, one); break;
    case ATAN_FLAT: v = itn__vatan2(one, v); break;
    case ATAN_BACK: v = itn__vatan2(v, -one); break;
    }
    itn__store(out, v);
}

/* Sine of 2 pi u, reduced exactly. */
static double sine_turns(double u) {
    u -= rint(u);
    if (u > .25) u = .5 - u;
    if (u < -.25) u = -.5 - u;
    return sin(2 * lanes_pi * u);
}
static double cosine_turns(double u) { return sine_turns(.25 - fabs(u - rint(u))); }

/* The function in double; `error` is added to one coefficient of its series: to 1/4 in the log, 1/6
   in e^x, 2 pi^2 in the cosine, (2 pi)^3/6 in the sine, 1/3 in the arctangent. */
static double exact(function which, double x, double error) {
    double f, u = x - rint(4 * x) / 4;
    int exponent;
    switch (which) {
    case LOG:
        f = frexp(x, &exponent);
        f = (f < 2 / 3. ? 2 * f : f) - 1;
        return log(x) - error * f * f * f * f;
    case EXP:
        f = x - rint(x * 1.4426950408889634) * .69314718055994531;
        return exp(x) * (1 + error * f * f * f);
    case SINE: return sine_turns(x) - error * u * u * u;
    case COSINE: return cosine_turns(x) - error * u * u;
    case ATAN_STEEP: return atan2(x, 1) - (fabs(x) < 1 ? error * x * x * x : 0);
    case ATAN_FLAT: return atan2(1, x) - (fabs(x) > 1 ? error / (x * x * x) : 0);
    default: return atan2(x, -1) - (fabs(x) < 1 ? error * x * x * x : 0);
    }
}

/* |got - want| in units of the last place of want. */
static double ulps(float got, double want) {
    int exponent;
    if (!(fabs(want) < 3.4028235677973366e38)) return got == (float)want ? 0 : HUGE_VAL;
    frexp(want, &exponent);
    if (exponent < -125) exponent = -125;
    return fabs(got - want) / ldexp(1, exponent - 24);
}

/* The largest error over every step-th float from `first` to `last` (of one sign, as bits). */
static double worst(function which, uint32_t first, uint32_t last, uint32_t step, double error,
                    float *at) {
    double largest = 0;
    uint64_t bits = first;
    while (bits <= last) {
        float x[N], out[N];
        int k;
        for (k = 0; k < N; k++, bits += step)
            x[k] = from_bits(bits <= last ? (uint32_t)bits : last);
        evaluate(which, x, out);
        for (k = 0; k < N; k++) {
            double e = ulps(out[k], exact(which, x[k], error));
            if (!(e <= largest)) largest = e, *at = x[k];
        }
    }
    return largest;
}

static uint32_t step = 1031; /* 1 with ITN_LONG_TESTS */

/* Floats in [low, high], both >= 0, and with `both` also their negatives. */
static void check_function(function which, double low, double high, int both, double error) {
    uint32_t first = to_bits((float)low), last = to_bits((float)high);
    float at = 0, other = 0;
    double e = worst(which, first, last, step, error, &at);
    if (both) {
        double minus = worst(which, first | 0x80000000u, last | 0x80000000u, step, error, &other);
        if (minus > e) e = minus, at = other;
    }
    if (!check_quiet) printf("%-14s %.3f ulp at %.9g\n", names[which], e, (double)at);
    check_report(e <= bound[which], __FILE__, __LINE__, "%s: %g ulp at %.9g", names[which], e,
                 (double)at);
}

static void test_full_range(double error) {
    check_function(LOG, 1.17549435e-38, 3.40282347e38, 0, error / 4);
    check_function(EXP, 0, 88.72283, 0, error / 6);
    check_function(EXP, 0, 87, 1, error / 6);
    check_function(SINE, 0, 1e4, 1, error * 41);
    check_function(COSINE, 0, 1e4, 1, error * 20);
    check_function(ATAN_STEEP, 0, 3.40282347e38, 1, error / 3);
    check_function(ATAN_FLAT, 0, 3.40282347e38, 1, error / 3);
    check_function(ATAN_BACK, 0, 3.40282347e38, 1, error / 3);
}

/* Below -87.3 e^x has fewer digits, down to none; beyond the range it is 0 and infinity. */
static void test_exp_ends(void) {
    static const float x[] = {-103.9f, -104, -105, -1000, -3.4e38f, 88.72284f, 89, 1e30f};
    float at = 0, in[N], out[N];
    double e = worst(EXP, to_bits(-87), to_bits(-110), step / 4 + 1, 0, &at);
    int i, k;
    CHECK(e <= 1.1);
    for (i = 0; i < 8; i++) {
        for (k = 0; k < N; k++) in[k] = x[i];
        evaluate(EXP, in, out);
        CHECK(same(out[N - 1], expf(x[i])));
    }
}

/* Every number that itn__uniform can return. */
static void check_all_uniforms(double error) {
    static const function which[] = {LOG, SINE, COSINE};
    static const double planted[] = {.25, 41, 20};
    int f, k;
#ifdef ITN_SANITIZED
    const uint32_t skip = 37;
#else
    const uint32_t skip = 1;
#endif
    uint32_t i;
    for (f = 0; f < 3; f++) {
        double largest = 0;
        float at = 0;
        for (i = 0; i < 1u << 24; i += N * skip) { /* the ordinary ones, then the low ones */
            float x[N], out[N];
            for (k = 0; k < N; k++)
                x[k] = ldexpf((float)((i + (uint32_t)k) & 0x7fffff) + .5f, i >> 23 ? -32 : -23);
            evaluate(which[f], x, out);
            for (k = 0; k < N && i + (uint32_t)k < 1u << 24; k++) {
                double e = ulps(out[k], exact(which[f], x[k], error * planted[f]));
                if (!(e <= largest)) largest = e, at = x[k];
            }
        }
        if (!check_quiet)
            printf("%-14s %.3f ulp at %.9g over uniforms\n", names[which[f]], largest, (double)at);
        check_report(largest <= bound[which[f]], __FILE__, __LINE__, "%s: %g ulp at %.9g",
                     names[which[f]], largest, (double)at);
    }
}

/* Pairs of arbitrary finite floats, and of floats of like size. */
static void test_atan2_pairs(void) {
    double largest = 0;
    int turn, k, turns = 2000000 / N;
    float worst_y = 0, worst_x = 0;
#ifdef ITN_SANITIZED
    turns /= 10;
#endif
    for (turn = 0; turn < turns; turn++) {
        float y[N], x[N], out[N];
        for (k = 0; k < N; k++) {
            y[k] = from_bits(lanes_random_bits()), x[k] = from_bits(lanes_random_bits());
            if (turn & 1) x[k] = fabsf(y[k]) * 4 * random_float();
            if (!itn__finite(x[k])) x[k] = 1;
            if (!itn__finite(y[k])) y[k] = -1;
        }
        itn__store(out, itn__vatan2(itn__load(y), itn__load(x)));
        for (k = 0; k < N; k++) {
            double e = ulps(out[k], atan2((double)y[k], (double)x[k]));
            if (!(e <= largest)) largest = e, worst_y = y[k], worst_x = x[k];
        }
    }
    printf("atan2          %.3f ulp at (%.9g, %.9g)\n", largest, (double)worst_y, (double)worst_x);
    CHECK(largest <= bound[ATAN_STEEP]);
}

/* Exact values, zeros and their signs, infinities, NaN. */
static float one(function which, float x) {
    float in[N], out[N];
    int k;
    for (k = 0; k < N; k++) in[k] = x;
    evaluate(which, in, out);
    return out[N / 2];
}
static float angle(float y, float x) {
    itn__floats v = itn__vatan2(itn__splat(y), itn__splat(x));
    return ITN__LANE(v, N - 1);
}
static void test_special(void) {
    int a, b, k;
    CHECK(one(LOG, 1) == 0);
    CHECK_NEAR(one(LOG, 0), -127 * log(2.), 1e-5);
    CHECK(one(EXP, 0) == 1 && one(EXP, -0.f) == 1);
    CHECK(one(EXP, INFINITY) == INFINITY && one(EXP, -INFINITY) == 0);
    CHECK(one(EXP, NAN) != one(EXP, NAN));
    for (k = -8; k <= 8; k++) { /* quarters of a turn */
        static const float quarter[4] = {0, 1, 0, -1};
        CHECK(one(SINE, (float)k / 4) == quarter[k & 3]);
        CHECK(one(COSINE, (float)k / 4) == quarter[(k + 1) & 3]);
    }
    CHECK_NEAR(one(SINE, .125f), sqrt(.5), 6e-8);
    for (a = 0; a < SPECIALS; a++)
        for (b = 0; b < SPECIALS; b++) {
            float y = special[a], x = special[b], got = angle(y, x), want = atan2f(y, x);
            int near;
            if (fabsf(y) == INFINITY && fabsf(x) == INFINITY) continue; /* not promised */
            near = ulps(got, want) <= 3 && signbit(got) == signbit(want);
            check_report(same(got, want) || near, __FILE__, __LINE__,
                         "angle of (%g, %g): %.9g, not %.9g", (double)x, (double)y, (double)got,
                         (double)want);
        }
}

/* No lane looks at another: turned inputs give turned outputs. */
static void test_lanes_alone(void) {
    int which, turn, k, wrong = 0;
    for (which = 0; which <= ATAN_BACK; which++)
        for (turn = 0; turn < 1000; turn++) {
            float x[N], turned[N], out[N], out_turned[N];
            for (k = 0; k < N; k++) x[k] = fabsf(random_float()) + 1e-6f;
            for (k = 0; k < N; k++) turned[k] = x[(k + 1) % N];
            evaluate((function)which, x, out);
            evaluate((function)which, turned, out_turned);
            for (k = 0; k < N; k++) wrong += !same(out_turned[k], out[(k + 1) % N]);
        }
    CHECK(wrong == 0);
}

int main(void) {
#if defined(ITN_SANITIZED) || defined(BRIEF)
    step = 1031 * 17;
#else
    if (check_long()) step = 1;
#endif
    test_lanes_memory();
    test_constants();
    test_pairs();
    test_ints();
    test_masks(0);
#if ITN__LANES > 1
    CHECK_CATCHES(test_masks(1)); /* the neighbour's bit */
#endif
    test_vectors();
    test_uniforms(0);
    CHECK_CATCHES(test_uniforms(1)); /* a number left out */
    check_all_uniforms(0);
    test_full_range(0);
    test_exp_ends();
    test_atan2_pairs();
    test_special();
    test_lanes_alone();
    step = 1031 * 17;
    /* a coefficient that is wrong in its fourth digit: every function must notice */
    CHECK_CATCHES(check_function(LOG, .1, 10, 0, 1e-4 / 4));
    CHECK_CATCHES(check_function(EXP, 0, 80, 1, 1e-4 / 6));
    CHECK_CATCHES(check_function(SINE, 0, 1, 1, 1e-4 * 41));
    CHECK_CATCHES(check_function(COSINE, 0, 1, 1, 1e-4 * 20));
    CHECK_CATCHES(check_function(ATAN_STEEP, 0, 1, 1, 1e-4 / 3));
    CHECK_CATCHES(check_function(ATAN_FLAT, 1, 100, 1, 1e-4 / 3));
    CHECK_CATCHES(check_function(ATAN_BACK, 0, 1, 1, 1e-4 / 3));
    return check_end("lanes");
}
