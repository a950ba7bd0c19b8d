/* What the programs of the course share: random numbers, a check, a page to draw on. Each program
   defines ITN_IMPLEMENTATION and includes this. */
#ifndef COURSE_H
#define COURSE_H
#define ITN_THREADS
#include "../../itn.h"
#include "../sheet.h"
#define COURSE_API SHEET_API

/* A box from (-.5, 0, -.5) to (.5, 1, .5), as an OBJ file. */
#define BOX                                                                                        \
    "v -.5 0 -.5\nv .5 0 -.5\nv .5 0 .5\nv -.5 0 .5\nv -.5 1 -.5\nv .5 1 -.5\nv .5 1 .5\n"             \
    "v -.5 1 .5\nf 1 2 3 4\nf 8 7 6 5\nf 1 5 6 2\nf 2 6 7 3\nf 3 7 8 4\nf 4 8 5 1\n"

enum { PANEL = 300, ROOM = 60 }; /* pixels: sides of a panel, and between panels */
static int wrong; /* checks that failed: the exit status of a program */

/* A number in [0, 1), each time another one (splitmix64, Steele et al. 2014). */
COURSE_API double uniform(void) {
    static uint64_t state;
    uint64_t z = state += 0x9e3779b97f4a7c15u;
    z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9u;
    z = (z ^ (z >> 27)) * 0x94d049bb133111ebu;
    return (double)((z ^ (z >> 31)) >> 11) / 9007199254740992.;
}

/* Prints a value beside what it should be, and notes it if it is further off than `most`. */
static void check(const char *what, double value, double expected, double most) {
    int good = fabs(value - expected) <= most;
    printf("%-44s %9.5g  expected %.5g +- %.2g%s\n", what, value, expected, most,
           good ? "" : "   WRONG");
    wrong += !good;
}

/* Ends the program if the library says no. */
static void need(itn_result result, const itn_error *error) {
    if (!result) return;
    fprintf(stderr, "%s\n", error->message);
    exit(1);
}

/* An empty page with room for so many panels side by side, and the place of each. */
COURSE_API itn_image new_page(int panels) {
    itn_image page;
    if (!sheet_make(&page, panels * (PANEL + ROOM) + 20, PANEL + 2 * ROOM)) exit(1);
    return page;
}
COURSE_API sheet_box panel(int which) {
    sheet_box b = {ROOM + which * (PANEL + ROOM), 40, PANEL, PANEL};
    return b;
}
/* A picture in a panel, in tones from 0 to `full`, or, full < 0, blue and red with their scale. */
COURSE_API void show(itn_image *page, int which, const float *pixels, int width, int height,
                             int channels, double full, const char *title) {
    sheet_box b = panel(which), bar = {b.left, b.top + b.height + 6, b.width, 8};
    sheet_text(page, b.left, b.top - 8, -1, 10, SHEET_INK, title);
    sheet_picture(page, b, pixels, channels, width, height, full > 0, fabs(full));
    if (full < 0) sheet_bar(page, bar, -full, "");
}
/* Bars over a panel's width, by the y axis of its chart. */
COURSE_API void show_bars(itn_image *page, int which, sheet_axis y, const double *bars, int count) {
    for (int i = 0; i < count; i++) {
        sheet_box b = panel(which);
        double bottom = b.top + b.height;
        b.top = sheet_height(b, y, bars[i]), b.height = bottom - b.top;
        b.left += i * b.width / count, b.width = b.width / count - 1;
        sheet_fill(page, b, SHEET_PALE, 1);
    }
}
COURSE_API void save_page(itn_image *page, const char *path) {
    itn_error error;
    need(itn_image_save_png(page, 0, 3, ITN_PNG_TONE, 1, path, &error), &error);
    itn_image_free(page);
    printf("picture: %s\n", path);
}
#endif
