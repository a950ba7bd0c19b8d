/* Makes a sky file for scenes from the published table of the Hosek-Wilkie sky (RGB data set).

   You learn: how the sky of one sun elevation, turbidity and ground albedo is found in the table of
   L. Hosek and A. Wilkie, "An Analytic Model for Full Spectral Sky-Dome Radiance" (2012), and what
   radiance its sun should have.

   Compile: cc -O2 sky.c -o sky -lm
   Run:     ./sky TABLE.txt --turbidity 3 --albedo 0.15 --elevation 60 -o t3-e60.sky
   Prints:  the radiance at the zenith, which for these three numbers is 3.631779 5.522326 10.403060
   --sun R G B gives the radiance of the sun instead.
   --grey makes all three channels the same, near to the luminance of the colours (t3-e60-grey.sky).
   The table is the authors' data as text: lines that begin with `#`, then for each channel R, G, B
   a line `channel R coefficients` and 2 (ground albedo 0, 1) x 10 (turbidity 1 to 10) x
   6 (elevation knots) x 9 numbers, and a line `channel R radiances` and 2 x 10 x 6 numbers. Its
   comments, which hold its licence, are copied to the sky file, as the licence asks. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define PI 3.14159265358979323846

typedef struct table {
    double coefficients[3][2][10][6][9];
    double radiances[3][2][10][6];
    char comments[8192];
} table;

typedef struct sky {
    double turbidity, albedo, elevation; /* degrees */
    double coefficients[3][9], radiance[3], sun[3];
} sky;

static void fail(const char *what, const char *why) {
    fprintf(stderr, "sky: %s: %s\n", what, why);
    exit(1);
}

/* ---- the table ---- */

/* Reads `count` numbers after a line `channel C KIND`. */
static void read_block(FILE *file, const char *path, char channel, const char *kind,
                       double *numbers, int count) {
    char name = 0, word[20] = "";
    int i;
    if (fscanf(file, " channel %c %19s", &name, word) != 2 || name != channel || strcmp(word, kind))
        fail(path, "a line `channel R|G|B coefficients|radiances` is missing or out of order");
    for (i = 0; i < count; i++)
        if (fscanf(file, "%lf", &numbers[i]) != 1 || !(fabs(numbers[i]) < 1e30))
            fail(path, "a number is missing or bad");
}

static void read_table(const char *path, table *t) {
    FILE *file = fopen(path, "r");
    char line[400], end;
    size_t used = 0;
    long data = 0;
    int c;
    if (!file) fail(path, "cannot open");
    while (fgets(line, sizeof line, file) && (line[0] == '#' || line[0] == '\n')) {
        size_t length = strlen(line);
        if (used + length >= sizeof t->comments) fail(path, "comments are too long");
        memcpy(t->comments + used, line, length);
        used += length;
        data = ftell(file);
    }
    t->comments[used] = 0;
    fseek(file, data, SEEK_SET);
    for (c = 0; c < 3; c++) {
        read_block(file, path, "RGB"[c], "coefficients", &t->coefficients[c][0][0][0][0], 1080);
        read_block(file, path, "RGB"[c], "radiances", &t->radiances[c][0][0][0], 120);
    }
    if (fscanf(file, " %c", &end) == 1) fail(path, "there is more than the table");
    fclose(file);
}

/* ---- the sky ---- */

/* Quintic Bezier curve through the six knots of an elevation; they are `stride` numbers apart. */
static double bezier(const double *knots, int stride, double x) {
    static const double binomial[6] = {1, 5, 10, 10, 5, 1};
    double sum = 0;
    int k;
    for (k = 0; k < 6; k++)
        sum += binomial[k] * pow(x, k) * pow(1 - x, 5 - k) * knots[k * stride];
    return sum;
}

/* The curve is in the cube root of the elevation; turbidity and albedo are linear between. */
static void find_sky(const table *t, sky *s) {
    double x = pow(s->elevation / 90, 1. / 3);
    int lower = s->turbidity < 9 ? (int)s->turbidity : 9, c, a, i, k;
    for (c = 0; c < 3; c++)
        for (a = 0; a < 2; a++)
            for (i = 0; i < 2; i++) {
                int turbidity = lower - 1 + i;
                double weight = (a ? s->albedo : 1 - s->albedo) *
                                (i ? s->turbidity - lower : lower + 1 - s->turbidity);
                for (k = 0; k < 9; k++)
                    s->coefficients[c][k] +=
                        weight * bezier(&t->coefficients[c][a][turbidity][0][k], 9, x);
                s->radiance[c] += weight * bezier(t->radiances[c][a][turbidity], 1, x);
            }
}

/* Radiance at angles theta from the zenith and gamma from the sun (equation 8). The data's order is
   A B C D E F G I H: number 7 multiplies the root of the cosine, number 8 is in chi. */
static double sky_radiance(const sky *s, int channel, double theta, double gamma) {
    const double *a = s->coefficients[channel];
    double cosine = cos(gamma), square = cosine * cosine;
    double chi = (1 + square) / pow(1 + a[8] * a[8] - 2 * a[8] * cosine, 1.5);
    return s->radiance[channel] * (1 + a[0] * exp(a[1] / (cos(theta) + .01))) *
           (a[2] + a[3] * exp(a[4] * gamma) + a[5] * square + a[6] * chi + a[7] * sqrt(cos(theta)));
}

/* ---- the sun ---- */

/* The RGB data set has no solar disc. Its unit is W / (m^2 sr) after weighting a spectrum with the
   CIE colour matching functions (without the factor 683) and turning XYZ into linear sRGB. The
   sun is put in the same unit from public numbers: a black body of the sun's effective temperature
   5772 K (IAU 2015), whose radiance is the mean of the disc, seen through
   - molecules: optical depth 0.008735 l^-4.08 (l in um; Leckner 1978),
   - aerosol: b l^-1.3 with b = 0.04608 T - 0.04586 for turbidity T (Angstrom; Preetham 1999),
   - ozone: left out, three per cent,
   times the relative air mass 1 / (sin e + 0.50572 (e + 6.07995)^-1.6364), e in degrees (Kasten and
   Young 1989). For T = 3, e = 60 and 560 nm this gives 18278; the authors' spectral data set has
   21491 in the disc's middle, or 17620 in its mean with the usual limb darkening (0.82). */
static double sun_spectrum(double um, double turbidity, double elevation) {
    double planck = 1.191042972e5 / pow(um, 5) / (exp(14387.769 / (um * 5772)) - 1);
    double mass = 1 / (sin(elevation * PI / 180) + .50572 * pow(elevation + 6.07995, -1.6364));
    double aerosol = .04608 * turbidity - .04586;
    return planck * exp(-mass * (.008735 * pow(um, -4.08) + aerosol * pow(um, -1.3)));
}

/* Half a bell of width a below the middle, b above. */
static double bell(double nm, double middle, double a, double b) {
    double t = (nm - middle) / (nm < middle ? a : b);
    return exp(-.5 * t * t);
}

/* Colour matching functions by their fits of Wyman, Sloan and Shirley (2013), in steps of 1 nm. */
static void find_sun(sky *s) {
    double x = 0, y = 0, z = 0, nm;
    int c;
    for (nm = 360; nm <= 830; nm++) {
        double light = sun_spectrum(nm * 1e-3, s->turbidity, s->elevation);
        x += light * (1.056 * bell(nm, 599.8, 37.9, 31) + .362 * bell(nm, 442, 16, 26.7) -
                      .065 * bell(nm, 501.1, 20.4, 26.2));
        y += light * (.821 * bell(nm, 568.8, 46.9, 40.5) + .286 * bell(nm, 530.9, 16.3, 31.1));
        z += light * (1.217 * bell(nm, 437, 11.8, 36) + .681 * bell(nm, 459, 26, 13.8));
    }
    s->sun[0] = 3.2404542 * x - 1.5371385 * y - .4985314 * z;
    s->sun[1] = -.9692660 * x + 1.8760108 * y + .0415560 * z;
    s->sun[2] = .0556434 * x - .2040259 * y + 1.0572252 * z;
    for (c = 0; c < 3; c++) /* a low sun is too red for sRGB */
        if (s->sun[c] < 0) s->sun[c] = 0;
}

/* All channels as green is, whose light is spread most like luminance (for turbidity 3, elevation
   60 within 2 % of it, .9 % in the root of the mean square), as bright as the luminance of all. */
static void make_grey(sky *s) {
    static const double weights[3] = {.2126, .7152, .0722};
    double radiance = 0, sun = 0;
    int c;
    for (c = 0; c < 3; c++) radiance += weights[c] * s->radiance[c], sun += weights[c] * s->sun[c];
    for (c = 0; c < 3; c++) {
        memmove(s->coefficients[c], s->coefficients[1], sizeof s->coefficients[1]);
        s->radiance[c] = radiance, s->sun[c] = sun;
    }
}

/* ---- the file ---- */

static void write_sky(const char *path, const sky *s, const char *comments) {
    char temporary[1200];
    FILE *file;
    int c, k, bad;
    if (snprintf(temporary, sizeof temporary, "%s.tmp", path) >= (int)sizeof temporary)
        fail(path, "is too long a name");
    file = fopen(temporary, "w");
    if (!file) fail(temporary, "cannot write");
    fprintf(file,
            "# Sky for turbidity %g, ground albedo %g, sun elevation %g degrees.\n"
            "# Per channel the coefficients A B C D E F G I H of\n"
            "#   (1 + A exp(B / (cos theta + .01))) (C + D exp(E gamma) + F cos^2 gamma\n"
            "#   + G (1 + cos^2 gamma) / (1 + H^2 - 2 H cos gamma)^1.5 + I sqrt(cos theta)),\n"
            "# theta from the zenith, gamma from the sun; then what this is multiplied by.\n",
            s->turbidity, s->albedo, s->elevation);
    for (c = 0; c < 3; c++) {
        fprintf(file, "coefficients_%c", "rgb"[c]);
        for (k = 0; k < 9; k++) fprintf(file, " %.9g", s->coefficients[c][k]);
        fprintf(file, "\n");
    }
    fprintf(file, "radiance %.9g %.9g %.9g\n", s->radiance[0], s->radiance[1], s->radiance[2]);
    fprintf(file, "sun_radiance %.6g %.6g %.6g\n", s->sun[0], s->sun[1], s->sun[2]);
    fprintf(file, "#\n# The numbers (but the sun's) were computed from this table:\n%s", comments);
    bad = ferror(file);
    bad |= fclose(file) != 0;
#ifdef _WIN32
    if (!bad) remove(path); /* there rename does not replace */
#endif
    if (bad || rename(temporary, path))
        remove(temporary), fail(path, "cannot write");
}

/* The number after an option, in [lower, upper]. The model ends there: nothing is extrapolated. */
static double number(const char *option, const char *text, double lower, double upper) {
    char *end, why[80];
    double value = text ? strtod(text, &end) : 0;
    if (text && end != text && !*end && value >= lower && value <= upper) return value;
    snprintf(why, sizeof why, "needs a number in [%g, %g]", lower, upper);
    fail(option, why);
    return 0;
}

int main(int argc, char **argv) {
    static table t;
    sky s = {-1, -1, -1, {{0}}, {0}, {0}};
    const char *in = NULL, *out = NULL;
    int i, k, own_sun = 0, grey = 0;
    for (i = 1; i < argc; i++) {
        if (!strcmp(argv[i], "--turbidity"))
            s.turbidity = number("--turbidity", argv[++i], 1, 10);
        else if (!strcmp(argv[i], "--albedo"))
            s.albedo = number("--albedo", argv[++i], 0, 1);
        else if (!strcmp(argv[i], "--elevation"))
            s.elevation = number("--elevation", argv[++i], 0, 90);
        else if (!strcmp(argv[i], "--sun") && i + 3 < argc)
            for (own_sun = 1, k = 0; k < 3; k++) s.sun[k] = number("--sun", argv[++i], 0, 1e12);
        else if (!strcmp(argv[i], "--grey"))
            grey = 1;
        else if (!strcmp(argv[i], "-o") && i + 1 < argc)
            out = argv[++i];
        else if (argv[i][0] != '-' && !in)
            in = argv[i];
        else
            fail(argv[i], "unknown, or its value is missing");
    }
    if (!in || !out || s.turbidity < 0 || s.albedo < 0 || s.elevation < 0)
        fail("usage", "sky TABLE.txt --turbidity T --albedo A --elevation DEGREES [--sun R G B] "
                      "[--grey] -o OUT.sky");
    read_table(in, &t);
    find_sky(&t, &s);
    if (!own_sun) find_sun(&s);
    if (grey) make_grey(&s);
    write_sky(out, &s, t.comments);
    printf("zenith"); /* to compare with the authors' program */
    for (k = 0; k < 3; k++) printf(" %.6f", sky_radiance(&s, k, 0, (90 - s.elevation) * PI / 180));
    printf(", sun %.6g %.6g %.6g\n", s.sun[0], s.sun[1], s.sun[2]);
    return 0;
}
