/* The tests' vocabulary: CHECK counts and reports, statistics are compared in standard errors. */
#ifndef CHECK_H
#define CHECK_H
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static int check_passed, check_failed;
static int check_quiet; /* 1 while a planted error is on trial: failures are wanted */
#if defined(__GNUC__) && !defined(__clang__)
#pragma GCC diagnostic ignored "-Wclobbered" /* nothing is changed between setjmp and longjmp */
#endif
static jmp_buf check_caught; /* where a planted error's first failure leads: that one is enough */

/* Whether ITN_LONG_TESTS=1 in the environment asks for the longer statistical runs. */
static inline int check_long(void) {
    const char *set = getenv("ITN_LONG_TESTS");
    return set && strcmp(set, "0") != 0;
}

/* A random number in [0, 1), of what `state` holds, which moves on (splitmix64). */
static inline double check_uniform(uint64_t *state) {
    uint64_t x = *state += 0x9e3779b97f4a7c15u;
    x = (x ^ (x >> 30)) * 0xbf58476d1ce4e5b9u;
    x = (x ^ (x >> 27)) * 0x94d049bb133111ebu;
    return (double)((x ^ (x >> 31)) >> 11) / 9007199254740992.; /* 2^53 */
}

/* Counts one check; prints it when it fails. Returns whether it holds. */
static int check_report(int holds, const char *file, int line, const char *format, ...) {
    if (holds) {
        check_passed++;
    } else {
        va_list arguments;
        if (check_quiet) longjmp(check_caught, 1);
        check_failed++;
        va_start(arguments, format);
        printf("FAILED %s:%d: ", file, line);
        vprintf(format, arguments);
        printf("\n");
        va_end(arguments);
    }
    return holds;
}

#define CHECK(condition) check_report(!!(condition), __FILE__, __LINE__, "%s", #condition)
/* |value - expected| <= tolerance; NaN fails. */
#define CHECK_NEAR(value, expected, tolerance)                                                     \
    check_report(fabs((double)(value) - (double)(expected)) <= (double)(tolerance), __FILE__,      \
                 __LINE__, "%s = %.9g, expected %.9g +- %.3g", #value, (double)(value),            \
                 (double)(expected), (double)(tolerance))
/* A Monte Carlo mean against an exact value: within `sigmas` standard errors, and the standard
   error itself at most `largest` (so that a blunt measurement cannot pass). */
#define CHECK_MEAN(value, error, expected, sigmas, largest)                                        \
    check_report(fabs((double)(value) - (double)(expected)) <= (sigmas) * (double)(error) &&       \
                     (double)(error) <= (double)(largest),                                         \
                 __FILE__, __LINE__, "%s = %.8g +- %.2g (at most %.2g), expected %.8g: %.1f sigma", \
                 #value, (double)(value), (double)(error), (double)(largest), (double)(expected),  \
                 ((double)(value) - (double)(expected)) / (double)(error))

/* Runs a test function with a planted error until one of its checks fails, and passes when one does.
   What the function then holds, it keeps; its checks are made by this thread alone. With sanitizers,
   which are slow and look at other things, it does nothing. */
#ifdef ITN_SANITIZED
#define CHECK_CATCHES(call)                                                                        \
    do {                                                                                           \
        if (0) call;                                                                               \
    } while (0)
#else
#define CHECK_CATCHES(call)                                                                        \
    do {                                                                                           \
        int passed_before = check_passed, missed = 0;                                              \
        check_quiet = 1;                                                                           \
        if (!setjmp(check_caught)) {                                                               \
            call;                                                                                  \
            missed = 1;                                                                            \
        }                                                                                          \
        check_quiet = 0, check_passed = passed_before;                                             \
        check_report(!missed, __FILE__, __LINE__, "planted error not caught: %s", #call);          \
    } while (0)
#endif

/* Ends a suite: prints its count, returns the exit status. */
static int check_end(const char *suite) {
    printf("%s: %d passed, %d failed\n", suite, check_passed, check_failed);
    return check_failed != 0;
}
#endif
