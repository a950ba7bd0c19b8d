/* A page of pictures, charts and words, drawn into an itn_image and saved as one PNG, so that one
   file tells the story.

   You learn: what it takes to look at results: a canvas, a pen, a font, axes, colours with a scale.

   Lengths are pixels, x goes right and y down; colours are linear RGB in [0,1]; sizes of text are
   heights of capitals. Include it after itn.h. */
#ifndef SHEET_H
#define SHEET_H

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#if defined(__GNUC__)
#define SHEET_API static __attribute__((unused))
#else
#define SHEET_API static
#endif

typedef struct sheet_colour { float r, g, b; } sheet_colour;
typedef struct sheet_box { double left, top, width, height; } sheet_box;
typedef struct sheet_axis { double from, to; int logarithmic; } sheet_axis;

static const sheet_colour SHEET_INK = {.02f, .02f, .02f}, SHEET_GREY = {.35f, .35f, .35f},
                          SHEET_PALE = {.8f, .8f, .8f};
static const sheet_colour SHEET_COLOURS[] = {{.013f, .19f, .46f}, {.67f, .02f, .02f},
                                             {.03f, .35f, .03f}, {.3f, .14f, .51f},
                                             {.8f, .21f, .003f}, {.26f, .09f, .07f}};
#define SHEET_PLUS_MINUS "\x7f"

/* The font: for each character from ' ' to '~', and plus-minus, the corners of its strokes, two
   digits x y each, on a grid 4 wide and 6 high (8 with what hangs below the line). */
static const char *const SHEET_FONT[96] = {
    "", "2024 2626", "1012 3032", "1016 3036 0242 0444", "413010010213334445361605 2026",
    "4006 0010110100 3545463635", "4612112031320405162644", "2022", "30212536", "10212516",
    "2125 1234 1432", "2125 0343", "252617", "0343", "2626", "4006",
    "103041453616050110", "112026 1636", "01103041420646", "0110304142334445361605 1333",
    "36300444", "400002324345361605", "413010010516364544331304", "004016",
    "13020110304142331304051636454433", "051636454130100102133342", "2323 2626", "2323 252617",
    "410345", "0242 0444", "014305", "01103041422324 2626",
    "343212144441301001051646", "062046 1333", "06003041423303 3344453606", "4130100105163645",
    "06002042442606", "40000646 0333", "400006 0333", "41301001051636454323", "0006 4046 0343",
    "1030 1636 2026", "4045361605", "0006 4004 1346", "000646", "0600234046", "06004640",
    "103041453616050110", "06003041423303", "103041453616050110 2446", "06003041423303 2346",
    "413010010213334445361605", "0040 2026", "000516364540", "002640", "0016233640", "0046 4006",
    "002340 2326", "00400646", "30101636", "0046", "10303616", "022042", "0747",
    "1021", "12324346 441405163645", "0006 0312324345361605", "4332120305163645",
    "4046 4332120305163645", "04444332120305163645", "40302126 1232",
    "4247381807 4332120305163645", "0006 0312324346", "2226 2020", "22271808 2020",
    "0006 4205 1446", "2026", "0206 03122326 23324346", "0206 0312324346", "123243453616050312",
    "0208 0312324345361605", "4248 4332120305163645", "0206 042242", "43321203143445361605",
    "20253646 0242", "0205163645 4246", "022642", "0216243642", "0246 4206", "0226 4218",
    "02420646", "30202213242636", "2027", "10202233242616", "03123443", "2024 0242 0646"};

/* Makes an empty white page. Returns 0 if there is no memory. */
SHEET_API int sheet_make(itn_image *page, int width, int height) {
    itn_error error;
    size_t i, count = 3 * (size_t)width * (size_t)height;
    if (itn_image_create(width, height, 3, NULL, page, &error)) return 0;
    for (i = 0; i < count; i++) page->pixels[i] = 1;
    return 1;
}

/* Mixes a colour into a pixel, if there is one. */
SHEET_API void sheet_dot(itn_image *page, int x, int y, sheet_colour colour, double cover) {
    size_t plane = (size_t)page->width * (size_t)page->height;
    float *p, c = (float)cover;
    if (x < 0 || y < 0 || x >= page->width || y >= page->height || !(cover > 0)) return;
    p = page->pixels + (size_t)y * (size_t)page->width + (size_t)x;
    p[0] += c * (colour.r - p[0]);
    p[plane] += c * (colour.g - p[plane]);
    p[2 * plane] += c * (colour.b - p[2 * plane]);
}

SHEET_API void sheet_fill(itn_image *page, sheet_box b, sheet_colour colour, double cover) {
    int x, y, right = (int)floor(b.left + b.width + .5), bottom = (int)floor(b.top + b.height + .5);
    for (y = (int)floor(b.top + .5); y < bottom; y++)
        for (x = (int)floor(b.left + .5); x < right; x++) sheet_dot(page, x, y, colour, cover);
}

/* A straight stroke with round ends: pixels are covered by their distance to it. */
SHEET_API void sheet_line(itn_image *page, double x0, double y0, double x1, double y1, double width,
                       sheet_colour colour) {
    double dx = x1 - x0, dy = y1 - y0, length = dx * dx + dy * dy, pad = .5 * width + 1;
    int x, y;
    for (y = (int)floor(fmin(y0, y1) - pad); y <= (int)ceil(fmax(y0, y1) + pad); y++)
        for (x = (int)floor(fmin(x0, x1) - pad); x <= (int)ceil(fmax(x0, x1) + pad); x++) {
            double px = x + .5 - x0, py = y + .5 - y0;
            double t = length > 0 ? fmin(fmax((px * dx + py * dy) / length, 0), 1) : 0;
            double distance = hypot(px - t * dx, py - t * dy);
            sheet_dot(page, x, y, colour, fmin(fmax(.5 * width + .5 - distance, 0), 1));
        }
}

SHEET_API double sheet_width(const char *text, double size) { return (double)strlen(text) * size; }

/* Writes a line of text; y is its base line, and x its left (-1), middle (0) or right (1) end. */
SHEET_API void sheet_text(itn_image *page, double x, double y, int align, double size,
                       sheet_colour colour, const char *text) {
    double unit = size / 6, pen = fmax(1.25, size / 6);
    x -= .5 * (align + 1) * (sheet_width(text, size) - 2 * unit);
    for (; *text; text++, x += size) {
        const char *s = *text >= ' ' ? SHEET_FONT[*text - ' '] : "";
        for (; s[0] && s[1] && s[2]; s += s[2] == ' ' ? 3 : 2)
            if (s[2] != ' ' && s[3])
                sheet_line(page, x + unit * (s[0] - '0'), y + unit * (s[1] - '6'),
                           x + unit * (s[2] - '0'), y + unit * (s[3] - '6'), pen, colour);
    }
}

/* Blue below 0, white, red above; t in [-1,1], cut. Not a number is grey. */
SHEET_API sheet_colour sheet_signed(double t) {
    sheet_colour c = {1, 1, 1};
    double a = fmin(fabs(t), 1);
    float little = (float)pow(1 - .85 * a, 2.2), much = (float)pow(1 - .2 * a * a, 2.2);
    if (t != t) return SHEET_PALE;
    c.g = little;
    c.r = t > 0 ? much : little;
    c.b = t > 0 ? little : much;
    return c;
}

/* A picture of 1 or 3 planes, each pixel a square (or a part of one where there are too many).
   Tones: the value over `full`; else by sheet_signed, the mean of the planes. */
SHEET_API void sheet_picture(itn_image *page, sheet_box b, const float *planes, int channels,
                          int width, int height, int tones, double full) {
    size_t plane = (size_t)width * (size_t)height;
    int x, y, k;
    for (y = 0; y < (int)b.height; y++)
        for (x = 0; x < (int)b.width; x++) {
            const float *p = planes + (size_t)(y * height / (int)b.height) * (size_t)width +
                             (size_t)(x * width / (int)b.width);
            double v[3], mean = 0;
            sheet_colour c;
            for (k = 0; k < 3; k++)
                v[k] = p[channels == 3 ? (size_t)k * plane : 0] / full, mean += v[k] / 3;
            c = sheet_signed(mean);
            if (tones && mean == mean) {
                c.r = (float)fmin(fmax(v[0], 0), 1);
                c.g = (float)fmin(fmax(v[1], 0), 1);
                c.b = (float)fmin(fmax(v[2], 0), 1);
            }
            sheet_dot(page, (int)b.left + x, (int)b.top + y, c, 1);
        }
}

/* The scale of signed colours, from -full to full, below a picture. */
SHEET_API void sheet_bar(itn_image *page, sheet_box b, double full, const char *unit) {
    char text[64];
    int x, i;
    for (x = 0; x < (int)b.width; x++) {
        sheet_box column = {b.left + x, b.top, 1, b.height};
        sheet_fill(page, column, sheet_signed(2 * (x + .5) / b.width - 1), 1);
    }
    for (i = -1; i <= 1; i++) {
        snprintf(text, sizeof text, i > 0 ? "%+.3g%s%s" : i ? "%+.3g" : "0", i * full,
                 *unit ? " " : "", unit);
        sheet_text(page, b.left + .5 * (i + 1) * b.width, b.top + b.height + 13, i, 8, SHEET_GREY,
                   text);
    }
}

/* Where a value lies along a length. */
SHEET_API double sheet_place(sheet_axis a, double value) {
    if (a.logarithmic)
        return log(fmax(value, 1e-300) / a.from) / log(a.to / a.from);
    return (value - a.from) / (a.to - a.from);
}

/* The frame of a chart with round numbers along the axes, and a title. */
SHEET_API void sheet_axes(itn_image *page, sheet_box b, sheet_axis x, sheet_axis y,
                          const char *title, const char *below) {
    int vertical;
    sheet_text(page, b.left, b.top - 8, -1, 10, SHEET_INK, title);
    sheet_text(page, b.left + .5 * b.width, b.top + b.height + 29, 0, 9, SHEET_GREY, below);
    for (vertical = 0; vertical < 2; vertical++) {
        sheet_axis a = vertical ? y : x;
        double span = a.to - a.from, step = pow(10, floor(log10(span / 2.5))), value;
        if (span / step > 5) step *= span / step > 12 ? 5 : 2;
        if (!vertical) step = fmax(step, 1);
        value = a.logarithmic ? pow(10, floor(log10(a.from))) : step * ceil(a.from / step - 1e-9);
        for (; value <= a.to * (1 + 1e-9); value = a.logarithmic ? value * 10 : value + step) {
            double t = sheet_place(a, value);
            char text[32];
            if (t < -1e-9) continue;
            snprintf(text, sizeof text, "%.3g", fabs(value) < 1e-9 * span ? 0 : value);
            if (vertical) {
                double h = b.top + (1 - t) * b.height;
                sheet_line(page, b.left, h, b.left + b.width, h, .6, SHEET_PALE);
                sheet_text(page, b.left - 6, h + 4, 1, 8, SHEET_GREY, text);
            } else {
                double v = b.left + t * b.width;
                sheet_line(page, v, b.top + b.height, v, b.top + b.height + 4, 1, SHEET_GREY);
                sheet_text(page, v, b.top + b.height + 15, 0, 8, SHEET_GREY, text);
            }
        }
    }
    sheet_line(page, b.left, b.top, b.left, b.top + b.height, 1, SHEET_GREY);
    sheet_line(page, b.left, b.top + b.height, b.left + b.width, b.top + b.height, 1, SHEET_GREY);
}

/* A value's y in a chart, cut at the frame. */
SHEET_API double sheet_height(sheet_box b, sheet_axis y, double value) {
    return b.top + b.height * (1 - fmin(fmax(sheet_place(y, value), 0), 1));
}

/* A curve through points with a band of +- errors. What is outside is cut. */
SHEET_API void sheet_curve(itn_image *page, sheet_box b, sheet_axis x, sheet_axis y, int count,
                        const double *xs, const double *ys, const double *errors,
                        sheet_colour colour) {
    double x0 = 0, y0 = 0;
    int i, column;
    for (i = 0; i < count; i++) {
        double x1 = b.left + b.width * sheet_place(x, xs[i]), y1 = sheet_height(b, y, ys[i]);
        sheet_line(page, x1, y1, x1, y1, 4, colour);
        if (i) sheet_line(page, x0, y0, x1, y1, 1.5, colour);
        for (column = (int)x0; i && column < (int)x1; column++) {
            double s = (column - x0) / (x1 - x0);
            double value = ys[i - 1] + s * (ys[i] - ys[i - 1]);
            double error = errors[i - 1] + s * (errors[i] - errors[i - 1]);
            sheet_box band = {(double)column, 0, 1, 0};
            band.top = sheet_height(b, y, value + error);
            band.height = sheet_height(b, y, value - error) - band.top;
            sheet_fill(page, band, colour, .2);
        }
        x0 = x1, y0 = y1;
    }
}

#endif
