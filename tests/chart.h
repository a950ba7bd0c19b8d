/* Line charts as SVG, and the tables (CSV) they are drawn from. An SVG is text without scripts or
   fonts of its own: titles and numbers stay text, the background is light, and series differ in
   marker as well as in colour (Okabe and Ito's colours, which colour-blind readers tell apart).

   Fill chart_panels with zeroed memory: titles, axes, series; then chart_write. Ranges and ticks
   follow from the data. Functions that can fail return 0. */
#ifndef CHART_H
#define CHART_H
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* ---- tables ---------------------------------------------------------------------------------- */

/* A CSV file without quoting: lines that begin with # are notes, the first other line names the
   columns. */
typedef struct chart_table {
    char *text; /* the file, cut into cells */
    char **cells;
    int columns, rows; /* without the names, which are row -1 */
    char note[400];    /* the first one, without # */
} chart_table;

static void chart_table_free(chart_table *table) {
    free(table->text);
    free(table->cells);
    memset(table, 0, sizeof *table);
}

static char *chart_read_file(const char *path) {
    FILE *file = fopen(path, "rb");
    char *text = NULL;
    long size;
    if (!file) return NULL;
    if (!fseek(file, 0, SEEK_END) && (size = ftell(file)) >= 0 && !fseek(file, 0, SEEK_SET)) {
        text = (char *)calloc((size_t)size + 1, 1);
        if (text && fread(text, 1, (size_t)size, file) != (size_t)size) {
            free(text);
            text = NULL;
        }
    }
    fclose(file);
    return text;
}

/* Cuts a line at its commas into at most `limit` cells (NULL: only counts). */
static int chart_cut(char *line, char **cells, int limit) {
    int count = 0;
    for (;;) {
        char *comma = strchr(line, ',');
        if (cells && count < limit) cells[count] = line;
        count++;
        if (!comma) return count;
        if (cells) *comma = 0;
        line = comma + 1;
    }
}

/* Reads a table. Every row must have as many cells as there are names. */
static int chart_table_load(const char *path, chart_table *table) {
    char *line, *next;
    size_t lines = 1;
    int row = -1, good;
    memset(table, 0, sizeof *table);
    table->text = chart_read_file(path);
    if (!table->text) return 0;
    for (line = table->text; (line = strchr(line, '\n')) != NULL; line++) lines++;
    for (line = table->text, good = 1; good && *line; line = next) {
        next = line + strcspn(line, "\n");
        if (*next) *next++ = 0;
        line[strcspn(line, "\r")] = 0;
        if (*line == '#' && !*table->note)
            snprintf(table->note, sizeof table->note, "%s", line + 1 + strspn(line + 1, " "));
        if (*line == '#' || !*line) continue;
        if (row < 0) {
            table->columns = chart_cut(line, NULL, 0);
            table->cells = (char **)calloc(lines * (size_t)table->columns, sizeof(char *));
        }
        good = table->cells && chart_cut(line, table->cells + (row + 1) * table->columns,
                                         table->columns) == table->columns;
        row++;
    }
    table->rows = row;
    if (row >= 0 && good) return 1;
    chart_table_free(table);
    return 0;
}

/* The cell of a row in a named column; "" where there is no such column. */
static const char *chart_cell(const chart_table *table, int row, const char *name) {
    int k;
    for (k = 0; k < table->columns; k++)
        if (!strcmp(table->cells[k], name)) return table->cells[(row + 1) * table->columns + k];
    return "";
}

/* ---- charts ---------------------------------------------------------------------------------- */

enum { CHART_SERIES = 12, CHART_POINTS = 64, CHART_TICKS = 128, CHART_STYLES = 6 };
enum { CHART_WIDTH = 720, CHART_GAP = 14, CHART_TEXT = 12 }; /* pixels */

typedef struct chart_axis {
    const char *title; /* with its unit */
    int logarithmic, reversed;
    int narrow;          /* room for few labels */
    int fixed;           /* 1: lower and upper are given, and what lies beyond is cut off */
    double lower, upper; /* of the data, then of the axis */
} chart_axis;

typedef struct chart_series {
    char name[48];
    int style; /* number of its colour and marker */
    int dashed, plain; /* plain: without markers */
    int spread; /* how low to high is drawn, 0: not at all, CHART_BARS, CHART_BAND */
    int count;
    double x[CHART_POINTS], y[CHART_POINTS], low[CHART_POINTS], high[CHART_POINTS];
} chart_series;
enum { CHART_BARS = 1, CHART_BAND };

typedef struct chart_panel {
    chart_axis x, y;
    chart_series series[CHART_SERIES];
    int series_count;
    int gain;         /* 1: an arrow from the first series to the last tells how much less x it
                         takes to the same y */
    const char *unit; /* NULL, or that of the last values, which the names then carry */
    double left, top, width, height; /* of the plot */
    double label_width;              /* to the right of it */
} chart_panel;

typedef struct chart {
    const char *title, *subtitle, *footer;
    chart_panel *panels; /* row by row */
    int panel_count;
    int columns;  /* 0: all panels side by side */
    double width; /* 0: CHART_WIDTH */
    double height;
    int legend; /* how many names of the first panel stand below the subtitle; 0: names stand at the
                   ends of the curves */
} chart;

typedef struct chart_tick {
    double value;
    int labelled;
} chart_tick;

static const char *const chart_colours[CHART_STYLES] = {"#4d4d4d", "#e69f00", "#56b4e9",
                                                        "#009e73", "#d55e00", "#cc79a7"};

/* Adds a point; a chart shows what is finite, and positive on logarithmic axes. */
static void chart_add(chart_panel *panel, chart_series *series, double x, double y) {
    int good = isfinite(x) && isfinite(y) && (x > 0 || !panel->x.logarithmic) &&
               (y > 0 || !panel->y.logarithmic);
    if (!good || series->count == CHART_POINTS) return;
    series->low[series->count] = series->high[series->count] = y;
    series->x[series->count] = x, series->y[series->count++] = y;
}

/* The same with a spread; on a logarithmic axis what is not positive ends at a hundredth of y. */
static void chart_add_spread(chart_panel *panel, chart_series *series, double x, double y,
                             double low, double high) {
    int before = series->count;
    chart_add(panel, series, x, y);
    if (series->count == before) return;
    series->low[before] = panel->y.logarithmic ? fmax(low, .01 * y) : low;
    series->high[before] = high;
}

/* The series to fill next. */
static chart_series *chart_begin(chart_panel *panel, const char *name, int style) {
    chart_series *series = &panel->series[panel->series_count++];
    snprintf(series->name, sizeof series->name, "%s", name);
    series->style = style;
    return series;
}

/* The largest of ..., .5, 1, 2, 5, 10, ... that is not above v; `up`: the smallest not below. */
static double chart_round(double v, int up) {
    static const double steps[4] = {1, 2, 5, 10};
    double decade = pow(10, floor(log10(v) + 1e-9));
    int k = 0;
    if (up) {
        while (steps[k] * decade < v * (1 - 1e-9)) k++;
    } else {
        while (k < 2 && steps[k + 1] * decade <= v * (1 + 1e-9)) k++;
    }
    return steps[k] * decade;
}

/* Distance of the labels of a linear axis. */
static double chart_step(const chart_axis *axis) {
    return chart_round((axis->upper - axis->lower) / 6, 1);
}

/* Widens the range of the data to round numbers; linear axes that begin near 0 begin at 0. */
static void chart_fit(chart_axis *axis) {
    double step;
    if (axis->fixed) return;
    if (!(axis->lower <= axis->upper)) axis->lower = axis->upper = 1; /* no data */
    if (axis->logarithmic) {
        axis->lower = chart_round(axis->lower, 0), axis->upper = chart_round(axis->upper, 1);
        if (axis->lower == axis->upper) axis->upper *= 10;
        return;
    }
    if (axis->lower > 0 && axis->lower < .5 * axis->upper) axis->lower = 0;
    if (axis->lower == axis->upper) axis->upper += fabs(axis->lower) + 1;
    step = chart_step(axis);
    axis->lower = step * floor(axis->lower / step + 1e-9);
    axis->upper = step * ceil(axis->upper / step - 1e-9);
}

/* Appends the last values, to two digits, to the names. */
static void chart_name_values(chart_panel *panel) {
    int s;
    for (s = 0; s < panel->series_count && panel->unit; s++) {
        chart_series *series = &panel->series[s];
        size_t length = strlen(series->name);
        char digits[32];
        if (!series->count) continue;
        snprintf(digits, sizeof digits, "%.1e", series->y[series->count - 1]);
        snprintf(series->name + length, sizeof series->name - length, ", %.6g %s", atof(digits),
                 panel->unit);
    }
}

static void chart_include(chart_axis *axis, double value) {
    if (axis->fixed) return;
    axis->lower = fmin(axis->lower, value), axis->upper = fmax(axis->upper, value);
}

static void chart_ranges(chart_panel *panel) {
    int s, i;
    if (!panel->x.fixed) panel->x.lower = HUGE_VAL, panel->x.upper = -HUGE_VAL;
    if (!panel->y.fixed) panel->y.lower = HUGE_VAL, panel->y.upper = -HUGE_VAL;
    for (s = 0; s < panel->series_count; s++)
        for (i = 0; i < panel->series[s].count; i++) {
            chart_include(&panel->x, panel->series[s].x[i]);
            chart_include(&panel->y, panel->series[s].low[i]);
            chart_include(&panel->y, panel->series[s].high[i]);
        }
    chart_fit(&panel->x);
    chart_fit(&panel->y);
}

/* Places of the grid lines. Logarithmic: all multiples of the powers of ten; these have labels, and
   on a short axis 2 and 5 times them; on a narrow one that is long, only some powers. Linear:
   labels, and four lines between two of them. */
static int chart_ticks(const chart_axis *axis, chart_tick *ticks) {
    int count = 0, k, exponent;
    if (axis->logarithmic) {
        int decades = (int)floor(log10(axis->upper) + 1e-9) - (int)ceil(log10(axis->lower) - 1e-9);
        int stride = axis->narrow ? 1 + decades / 6 : 1;
        for (exponent = (int)floor(log10(axis->lower) + 1e-9); exponent < 300; exponent++)
            for (k = 1; k < 10; k++) {
                double value = k * pow(10, exponent);
                if (value > axis->upper * (1 + 1e-9) || count == CHART_TICKS) return count;
                if (value < axis->lower * (1 - 1e-9)) continue;
                if (k > 1 && stride > 1) continue;
                ticks[count].value = value;
                ticks[count++].labelled = (k == 1 && exponent % stride == 0) ||
                                          (decades < (axis->narrow ? 1 : 2) &&
                                           (k == 2 || k == 5));
            }
    } else {
        double step = chart_step(axis) / 5;
        int last = (int)floor((axis->upper - axis->lower) / step + .5);
        for (k = 0; k <= last && count < CHART_TICKS; k++) {
            ticks[count].value = step * floor(axis->lower / step + k + .5); /* 0 is 0 */
            ticks[count++].labelled = k % 5 == 0;
        }
    }
    return count;
}

/* Where a value lies on its axis, 0 to 1. */
static double chart_place(const chart_axis *axis, double v) {
    double place = (v - axis->lower) / (axis->upper - axis->lower);
    if (axis->logarithmic) place = log(v / axis->lower) / log(axis->upper / axis->lower);
    return axis->reversed ? 1 - place : place;
}
static int chart_within(const chart_axis *axis, double v) {
    double place = chart_place(axis, v);
    return place > -1e-6 && place < 1 + 1e-6;
}
static double chart_x(const chart_panel *panel, double v) {
    return panel->left + panel->width * chart_place(&panel->x, v);
}
static double chart_y(const chart_panel *panel, double v) {
    return panel->top + panel->height * (1 - chart_place(&panel->y, v));
}

/* Text with the characters escaped that mean something in XML. */
static void chart_text(FILE *file, const char *text) {
    for (; *text; text++) {
        if (*text == '&') fputs("&amp;", file);
        else if (*text == '<') fputs("&lt;", file);
        else if (*text == '>') fputs("&gt;", file);
        else fputc(*text, file);
    }
}

static void chart_line(FILE *file, double x0, double y0, double x1, double y1, const char *style) {
    fprintf(file, "<line x1=\"%.1f\" y1=\"%.1f\" x2=\"%.1f\" y2=\"%.1f\" %s/>\n", x0, y0, x1, y1,
            style);
}

/* anchor: start, middle or end. */
static void chart_write_text(FILE *file, double x, double y, const char *anchor, const char *style,
                             const char *text) {
    fprintf(file, "<text x=\"%.1f\" y=\"%.1f\" text-anchor=\"%s\" %s>", x, y, anchor, style);
    chart_text(file, text);
    fputs("</text>\n", file);
}

/* The number at a tick: plain from .001 to 1000, else with a power of ten. */
static void chart_number(FILE *file, double x, double y, const char *anchor, double value) {
    static const char *const raised[10] = {"\xe2\x81\xb0", "\xc2\xb9",     "\xc2\xb2",
                                           "\xc2\xb3",     "\xe2\x81\xb4", "\xe2\x81\xb5",
                                           "\xe2\x81\xb6", "\xe2\x81\xb7", "\xe2\x81\xb8",
                                           "\xe2\x81\xb9"};
    int exponent = fabs(value) > 1e-300 ? (int)floor(log10(fabs(value)) + 1e-9) : 0;
    double mantissa = value / pow(10, exponent);
    int size = abs(exponent);
    char text[64], factor[24] = "";
    if (exponent >= -3 && exponent <= 3) {
        snprintf(text, sizeof text, "%.10g", value);
    } else {
        if (fabs(mantissa - 1) > 1e-6) snprintf(factor, sizeof factor, "%.10g\xc3\x97", mantissa);
        snprintf(text, sizeof text, "%s10%s%s%s", factor, exponent < 0 ? "\xe2\x81\xbb" : "",
                 size > 9 ? raised[size / 10 % 10] : "", raised[size % 10]);
    }
    chart_write_text(file, x, y, anchor, "class=\"t\"", text);
}

static void chart_grid(FILE *file, const chart_panel *panel) {
    static const char *const styles[2] = {"stroke=\"#efefef\"", "stroke=\"#cfcfcf\""};
    chart_tick ticks[CHART_TICKS];
    double right = panel->left + panel->width, bottom = panel->top + panel->height;
    int labelled, count, i;
    for (labelled = 0; labelled < 2; labelled++) { /* fine lines below coarse ones */
        count = chart_ticks(&panel->x, ticks);
        for (i = 0; i < count; i++) {
            double x = chart_x(panel, ticks[i].value);
            if (ticks[i].labelled != labelled) continue;
            chart_line(file, x, panel->top, x, bottom, styles[labelled]);
            if (labelled) chart_number(file, x, bottom + 17, "middle", ticks[i].value);
        }
        count = chart_ticks(&panel->y, ticks);
        for (i = 0; i < count; i++) {
            double y = chart_y(panel, ticks[i].value);
            if (ticks[i].labelled != labelled) continue;
            chart_line(file, panel->left, y, right, y, styles[labelled]);
            if (labelled) chart_number(file, panel->left - 7, y + 4, "end", ticks[i].value);
        }
    }
    chart_line(file, panel->left, bottom, right, bottom, "stroke=\"#444\"");
    chart_write_text(file, panel->left + panel->width / 2, bottom + 37, "middle", "class=\"t\"",
                     panel->x.title);
    chart_write_text(file, panel->left, panel->top - 10, "start", "class=\"t\"", panel->y.title);
}

static void chart_marker(FILE *file, double x, double y, int style) {
    static const char *const shapes[CHART_STYLES] = {
        "m-3.5 0a3.5 3.5 0 1 0 7 0a3.5 3.5 0 1 0 -7 0z", /* circle */
        "m-3.2 -3.2h6.4v6.4h-6.4z",                      /* square */
        "m0 -4.4l4.4 4.4l-4.4 4.4l-4.4 -4.4z",           /* diamond */
        "m0 -4.4l4.2 7.4h-8.4z",                         /* triangle */
        "m0 4.4l4.2 -7.4h-8.4z",                         /* the same on its tip */
        "m-4 -1.6h8v3.2h-8z"};                           /* bar */
    fprintf(file, "<path fill=\"%s\" stroke=\"#fff\" stroke-width=\".8\" d=\"M%.1f %.1f%s\"/>\n",
            chart_colours[style], x, y, shapes[style]);
}

/* From low to high at every point: a bar each, or the band between the two curves. */
static void chart_spread_write(FILE *file, const chart_panel *panel, const chart_series *series) {
    int i;
    if (series->spread == CHART_BARS) {
        fprintf(file, "<g stroke=\"%s\">\n", chart_colours[series->style]);
        for (i = 0; i < series->count; i++) {
            double x = chart_x(panel, series->x[i]);
            chart_line(file, x, chart_y(panel, series->low[i]), x, chart_y(panel, series->high[i]),
                       "stroke-width=\"1.5\"");
        }
        fputs("</g>\n", file);
    } else if (series->spread == CHART_BAND) {
        fprintf(file, "<polygon fill=\"%s\" fill-opacity=\".18\" points=\"",
                chart_colours[series->style]);
        for (i = 0; i < 2 * series->count; i++) {
            int back = i < series->count ? i : 2 * series->count - 1 - i;
            fprintf(file, "%.1f,%.1f ", chart_x(panel, series->x[back]),
                    chart_y(panel, i < series->count ? series->low[back] : series->high[back]));
        }
        fputs("\"/>\n", file);
    }
}

static void chart_stroke(FILE *file, const chart_series *series) {
    fprintf(file, "<polyline fill=\"none\" stroke=\"%s\" stroke-width=\"%s\" points=\"",
            chart_colours[series->style], series->dashed ? "1.4\" stroke-dasharray=\"5 3" : "2");
}

static void chart_curve(FILE *file, const chart_panel *panel, const chart_series *series) {
    int i;
    if (!series->count) return;
    chart_spread_write(file, panel, series);
    chart_stroke(file, series);
    for (i = 0; i < series->count; i++)
        fprintf(file, "%.1f,%.1f ", chart_x(panel, series->x[i]), chart_y(panel, series->y[i]));
    fputs("\"/>\n", file);
    for (i = 0; i < series->count && !series->plain; i++)
        if (chart_within(&panel->x, series->x[i]) && chart_within(&panel->y, series->y[i]))
            chart_marker(file, chart_x(panel, series->x[i]), chart_y(panel, series->y[i]),
                         series->style);
}

/* Heights for the labels at the ends of the curves: in the curves' order, far enough apart, as near
   to their ends as that admits. */
static void chart_spread(const chart_panel *panel, double *heights) {
    int order[CHART_SERIES], count = panel->series_count, i, k, round;
    for (i = 0; i < count; i++) {
        const chart_series *s = &panel->series[i];
        heights[i] = s->count ? chart_y(panel, s->y[s->count - 1]) : panel->top;
        for (k = i; k > 0 && heights[order[k - 1]] > heights[i]; k--) order[k] = order[k - 1];
        order[k] = i;
    }
    for (round = 0; round < 100; round++)
        for (i = 0; i + 1 < count; i++) {
            double *upper = &heights[order[i]], *lower = &heights[order[i + 1]];
            double lack = 1.5 * CHART_TEXT - (*lower - *upper);
            if (lack > 0) *upper -= .5 * lack, *lower += .5 * lack;
        }
}

static void chart_labels(FILE *file, const chart_panel *panel) {
    double heights[CHART_SERIES], x = panel->left + panel->width + CHART_GAP;
    int i;
    chart_spread(panel, heights);
    for (i = 0; i < panel->series_count; i++) {
        const chart_series *s = &panel->series[i];
        if (!s->count) continue;
        fprintf(file, "<g stroke-width=\"1\" stroke-dasharray=\"2 2\" stroke=\"%s\">",
                chart_colours[s->style]);
        chart_line(file, chart_x(panel, s->x[s->count - 1]) + 5,
                   chart_y(panel, s->y[s->count - 1]), x - 2, heights[i], "");
        fputs("</g>", file);
        chart_marker(file, x + 4, heights[i], s->style);
        chart_write_text(file, x + 13, heights[i] + 4, "start", "class=\"l\"", s->name);
    }
}

/* x of a falling or rising curve at y, both axes logarithmic; 0 where the curve does not reach. */
static double chart_reach(const chart_series *s, double y) {
    int i;
    for (i = 0; i + 1 < s->count; i++) {
        double t = log(y / s->y[i]) / log(s->y[i + 1] / s->y[i]);
        if (t >= 0 && t <= 1) return s->x[i] * pow(s->x[i + 1] / s->x[i], t);
    }
    return 0;
}

/* An arrow from the first curve to the last where both get to least: what is gained. */
static void chart_gain(FILE *file, const chart_panel *panel) {
    const chart_series *a = &panel->series[0], *b = &panel->series[panel->series_count - 1];
    double upper, lower, level, from, to, y, x0, x1;
    char text[64];
    if (!panel->gain || panel->series_count < 2 || !a->count || !b->count) return;
    upper = fmin(a->y[0], b->y[0]), lower = fmax(a->y[a->count - 1], b->y[b->count - 1]);
    level = 1.01 * lower, from = chart_reach(a, level), to = chart_reach(b, level);
    if (!(upper > lower) || !(from > 0) || !(to > 0)) return;
    y = chart_y(panel, level), x0 = chart_x(panel, from) - 5, x1 = chart_x(panel, to) + 6;
    chart_line(file, x0, y, x1 + 6, y, "stroke=\"#222\" stroke-width=\"1.3\"");
    fprintf(file, "<path fill=\"#222\" d=\"M%.1f %.1fl9 -4v8z\"/>\n", x1, y);
    snprintf(text, sizeof text, "%.*f\xc3\x97 faster", from / to < 10, from / to);
    chart_write_text(file, (x0 + x1) / 2, y - 7, "middle", "class=\"g\" stroke=\"#fff\" "
                     "stroke-width=\"5\" stroke-linejoin=\"round\"", text); /* clears the ground */
    chart_write_text(file, (x0 + x1) / 2, y - 7, "middle", "class=\"g\"", text);
}

/* The names in a row below the subtitle. */
static void chart_legend(FILE *file, const chart_panel *panel, int names) {
    double x = 20, y = 66;
    int i;
    for (i = 0; i < names && i < panel->series_count; i++) {
        const chart_series *s = &panel->series[i];
        chart_stroke(file, s);
        fprintf(file, "%.1f,%.1f %.1f,%.1f\"/>\n", x, y, x + 24, y);
        if (!s->plain) chart_marker(file, x + 12, y, s->style);
        chart_write_text(file, x + 30, y + 4, "start", "class=\"l\"", s->name);
        x += 50 + .53 * CHART_TEXT * (double)strlen(s->name);
    }
}

static void chart_panel_write(FILE *file, const chart_panel *panel, int number, int legend) {
    int i;
    chart_grid(file, panel);
    fprintf(file, "<clipPath id=\"p%d\"><rect x=\"%.1f\" y=\"%.1f\" width=\"%.1f\" "
                  "height=\"%.1f\"/></clipPath>\n<g clip-path=\"url(#p%d)\">\n",
            number, panel->left - 5, panel->top - 5, panel->width + 10, panel->height + 10, number);
    for (i = 0; i < panel->series_count; i++) chart_curve(file, panel, &panel->series[i]);
    fputs("</g>\n", file);
    if (!legend) chart_labels(file, panel);
    chart_gain(file, panel);
}

/* Room for each panel: numbers to the left, names to the right. */
static void chart_layout(chart *c) {
    int columns = c->columns ? c->columns : c->panel_count, p, i;
    int rows = (c->panel_count + columns - 1) / columns;
    double top = c->legend ? 106 : 82, width, height = (c->height - top) / rows;
    if (c->width == 0) c->width = CHART_WIDTH;
    width = c->width / columns;
    for (p = 0; p < c->panel_count; p++) {
        chart_panel *panel = &c->panels[p];
        size_t longest = 0;
        chart_name_values(panel);
        for (i = 0; i < panel->series_count; i++)
            if (strlen(panel->series[i].name) > longest) longest = strlen(panel->series[i].name);
        panel->label_width = CHART_GAP + 8;
        if (!c->legend) panel->label_width += 14 + .53 * CHART_TEXT * (double)longest;
        panel->left = p % columns * width + 56, panel->top = top + p / columns * height;
        panel->width = width - 56 - panel->label_width;
        panel->height = height - 74;
        panel->x.narrow = panel->width < 220, panel->y.narrow = panel->height < 220;
        chart_ranges(panel);
    }
}

/* Writes the chart. Returns 0 if the file cannot be written. */
static int chart_write(chart *c, const char *path) {
    FILE *file = fopen(path, "wb");
    int p, good;
    if (!file) return 0;
    chart_layout(c);
    fprintf(file, "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"%.0f\" height=\"%.0f\" "
                  "viewBox=\"0 0 %.0f %.0f\" font-family=\"Helvetica, Arial, sans-serif\" "
                  "font-size=\"%d\">\n<style>.t{fill:#444}.l{fill:#222}.g{fill:#222;"
                  "font-weight:bold}.f{fill:#777;font-size:10px}.h{fill:#111;font-size:16px;"
                  "font-weight:bold}</style>\n<rect width=\"100%%\" height=\"100%%\" "
                  "fill=\"#ffffff\"/>\n",
            c->width, c->height, c->width, c->height, CHART_TEXT);
    chart_write_text(file, 14, 25, "start", "class=\"h\"", c->title);
    chart_write_text(file, 14, 44, "start", "class=\"t\"", c->subtitle);
    if (c->legend) chart_legend(file, &c->panels[0], c->legend);
    for (p = 0; p < c->panel_count; p++) chart_panel_write(file, &c->panels[p], p, c->legend);
    chart_write_text(file, 14, c->height - 10, "start", "class=\"f\"", c->footer);
    fputs("</svg>\n", file);
    good = !ferror(file);
    return !fclose(file) && good;
}
#endif
