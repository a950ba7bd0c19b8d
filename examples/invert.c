/* Recovers the parameters of a translucent object from one image of it, or from several: the main
   job.

   You learn: how to hand images to itn_refine_views, what comes back (values with error bars, and
   word of those that the images do not determine), and how to look at it.

   Compile: cc -O2 -march=native invert.c -o invert -lm -lpthread
   Run:     ./invert ../scenes/default.itn -o out
            ./invert front.itn side.itn --target front.exr --target side.exr -o out
   Several scenes show one object from several sides or in several lights, each with its own image;
   parameters of one name are one unknown. Without --target and --hidden the values in the (first)
   scene file are the hidden ones: images are made with them, and the search starts from a neutral
   guess (thickness 10, albedo .7, g .3). Otherwise it starts from the values in the scene file.
   --params names the unknowns (glass.alpha,milk.g), which else are sigma_t, albedo and g of all
   media of the first scene. What is not of a medium has no neutral guess and starts from the scene
   file's value: say with --hidden what is to be hidden instead. --method adam|sgd does without
   Levenberg-Marquardt, --iterations is the most of a search.
   An image has the size of the film, or is a whole number of times as large; where its plane A is
   below 1 it does not count.
   --final-spp gives the last evaluations more samples than five times --spp: smaller error bars.
   Without it they take up to 32 times as many by themselves where something else stays undetermined.
   With --net it starts from what a network of train.c reads off the first picture, which is
   printed as a row of its own. Prints a row per iteration and at the end a line per parameter,
            milk.sigma_t 31.2 +- 0.4 hidden 31
   says in words what the images determine, and fails if a hidden value that they determine lies
   more than four standard errors away, or if the scene does not explain the images: see the misfit,
   in units of noise, 1 where it does. --seconds is the most that the search takes (60); Ctrl-C, too,
   ends it with the answer so far. To the folder after -o, or beside the scene, go SCENE_sheet.png,
   one page of target, estimate, their difference over its noise, derivatives and how the search
   went, and SCENE_estimate.exr with the numbers. */
#define _POSIX_C_SOURCE 200809L
#define _DARWIN_C_SOURCE /* else macOS hides sysconf's number of processors */
#define ITN_THREADS
#define ITN_IMPLEMENTATION
#include "../itn.h"
#include "sheet.h"

#include <errno.h>
#include <float.h>
#include <signal.h>
#include <sys/stat.h>
#include <unistd.h>
#ifdef _WIN32
#include <direct.h>
#define mkdir(path, mode) _mkdir(path)
#endif

enum { MOST_PARAMETERS = 16, MOST_ROWS = 1024, MOST_VIEWS = 16, STEM_SIZE = 1024 };
static const char *const usage =
    "usage: invert SCENE... [--target IMAGE]... [--hidden name=value,...] [--params name,...]\n"
    "       [--net WEIGHTS] [--method lm|adam|sgd] [--iterations N] [--spp N] [--final-spp N]\n"
    "       [--seconds N] [--seed N] [-t THREADS] [-o DIR]\n"
    "       (IMAGE: EXR or PFM; a --target for each of the scenes, in the same order, or for none;\n"
    "       --hidden for none)\n";

/* A scene and the image of it. */
typedef struct picture {
    const char *path, *target;
    itn_scene *scene;
    int parameters[MOST_PARAMETERS]; /* what the unknowns are in it, or -1 */
    float *theta, *light, *variance;
    int noise_known; /* whether variance says more than which pixels count */
    char stem[STEM_SIZE]; /* where its results go, up to _estimate.exr and the like */
} picture;

/* What is sought, and what the progress callback collects for the chart. */
typedef struct history {
    const itn_parameter *unknowns[MOST_PARAMETERS];
    int count, rows;
    int noise; /* whether misfit is in units of noise; else it is the loss, with adam and sgd */
    double misfit[MOST_ROWS], misfit_error[MOST_ROWS];
    double values[MOST_PARAMETERS][MOST_ROWS], errors[MOST_PARAMETERS][MOST_ROWS];
} history;

static void fail(const char *what, const char *why) {
    fprintf(stderr, "invert: %s%s%s\n", what, *why ? ": " : "", why);
    exit(1);
}

static int whole(const char *option, const char *text) {
    char *end;
    long value = strtol(text, &end, 10);
    if (end == text || *end || value < 0 || value > 2147483647)
        fail(option, "needs a whole number from 0 to 2147483647");
    return (int)value;
}

/* Says how thick each medium's objects are, in mean free paths: what a picture can tell of sigma_t
   depends on it. */
static void show_thickness(const itn_scene *scene, FILE *file) {
    int i;
    for (i = 0; i < itn_parameter_count(scene); i++) {
        char medium[ITN_NAME_SIZE], *field;
        snprintf(medium, sizeof medium, "%s", itn_parameter_get(scene, i)->name);
        field = strchr(medium, '.');
        if (!field || (strcmp(field, ".sigma_t") && strcmp(field, ".sigma_t_r"))) continue;
        *field = 0;
        fprintf(file, "%s: optical thickness %.3g (sigma_t times the mean chord)\n", medium,
                itn_scene_thickness(scene, NULL, medium));
    }
}

/* Ctrl-C ends the search with the answer so far. */
static volatile sig_atomic_t interrupted;
static void interrupt(int number) { interrupted = number > 0; }

static int show_step(void *user, const itn_refine_step *step) {
    history *h = (history *)user;
    int k, row = h->rows < MOST_ROWS ? h->rows++ : MOST_ROWS - 1;
    if (step->misfit > 0)
        printf("%3d  misfit %.4g +- %.2g ", step->iteration, step->misfit, step->misfit_error);
    else printf("%3d  loss %.4e ", step->iteration, step->loss);
    h->noise = step->misfit > 0;
    h->misfit[row] = h->noise ? step->misfit : fabs(step->loss);
    h->misfit_error[row] = h->noise ? step->misfit_error : 0;
    for (k = 0; k < h->count; k++) {
        h->values[k][row] = (double)step->values[k];
        h->errors[k][row] = step->errors ? step->errors[k] : 0;
        printf("  %s %.5g", h->unknowns[k]->name, (double)step->values[k]);
        if (step->errors) printf(" +- %.2g", step->errors[k]);
    }
    printf("  (%.1f of some %.1f s)\n", step->seconds, step->expected);
    fflush(stdout);
    return interrupted;
}

/* The parameter of that name in the first scene that has it, or NULL. */
static const itn_parameter *find_parameter(const picture *pictures, int views, const char *name) {
    const itn_parameter *found = NULL;
    int v;
    for (v = 0; v < views && !found; v++)
        found = itn_parameter_get(pictures[v].scene, itn_parameter_find(pictures[v].scene, name));
    return found;
}

/* Fails because of a text that does not begin with a parameter's name, and says which there are. */
static void fail_parameter(const itn_scene *scene, const char *text) {
    int i;
    fprintf(stderr, "invert: no parameter of the scene: %s\nthere are", text);
    for (i = 0; i < itn_parameter_count(scene); i++)
        fprintf(stderr, " %s", itn_parameter_get(scene, i)->name);
    fprintf(stderr, "\n");
    exit(1);
}

/* Reads "name,name" or, if values are wanted, "name=value,name=value". */
static int read_list(const picture *pictures, int views, const char *text,
                     const itn_parameter **unknowns, float *values) {
    int count = 0;
    while (*text) {
        char name[ITN_NAME_SIZE] = "", *end;
        size_t length = strcspn(text, "=,");
        if (length < sizeof name) memcpy(name, text, length);
        if (count == MOST_PARAMETERS) fail("more than 16 parameters", text);
        unknowns[count] = find_parameter(pictures, views, name);
        if (!unknowns[count]) fail_parameter(pictures[0].scene, text);
        text += length;
        if (values) {
            if (*text != '=') fail("name=value expected", text);
            values[count] = strtof(text + 1, &end);
            if (end == text + 1) fail("not a number", text);
            text = end;
        }
        if (*text && *text != ',') fail("a list is separated by commas", text);
        text += *text == ',';
        count++;
    }
    return count;
}

/* Fails at the first value of a target, or of its variance, that is no number. */
static void check_target(const char *path, itn_film_desc film, const float *light, int variance) {
    char why[160];
    int i, count = film.width * film.height * film.channels;
    for (i = 0; i < count && fabsf(light[i]) <= (variance ? FLT_MAX : 1e18f) &&
                !(variance && light[i] < 0); i++) {}
    if (i == count) return;
    snprintf(why, sizeof why, "the %s of pixel %d, %d (column, row) is %s",
             variance ? "variance" : "value", i % film.width, i / film.width % film.height,
             !variance ? "NaN, or beyond 1e18" :
             "negative, NaN or, as of one sample, infinite: leave out its layer");
    fail(path, why);
}

/* Says if a target's variance tells of more noise than there is light. */
static void note_noise(const char *path, const picture *p, itn_film_desc film) {
    double light = 0, noise = 0;
    int i, count = film.width * film.height * film.channels;
    for (i = 0; i < count; i++) {
        light += pow((double)p->light[i], 2) / count;
        noise += (double)p->variance[i] / count;
    }
    if (noise > light)
        printf("note: %s: its variance tells of more noise, %.2g, than light, %.2g (root mean "
               "squares)\n", path, sqrt(noise), sqrt(light));
}

/* Makes an image as large as the film, where it is a whole number of times as large: by the means
   of blocks of pixels, and the variances of these. */
static void fit_image(const char *path, itn_image *image, itn_film_desc film) {
    int width = image->width, height = image->height, times = width / film.width, p, x, y, i;
    char why[200];
    if (width == film.width && height == film.height) return;
    snprintf(why, sizeof why, "has %dx%d pixels, not the film's %dx%d or a multiple of both: give "
             "the film its proportions, or scale the image (some 128 pixels will do)", width,
             height, film.width, film.height);
    if (times * film.width != width || times * film.height != height) fail(path, why);
    for (p = 0; p < image->plane_count; p++) {
        const float *from = image->pixels + (size_t)p * (size_t)width * (size_t)height;
        float *to = image->pixels + (size_t)p * (size_t)film.width * (size_t)film.height;
        double blocks = !strncmp(image->names[p], "Variance.", 9) ? pow(times, 4) : pow(times, 2);
        for (y = 0; y < film.height; y++)
            for (x = 0; x < film.width; x++) { /* writes no further than has been read */
                double sum = 0;
                for (i = 0; i < times * times; i++)
                    sum += (double)from[(size_t)(y * times + i / times) * (size_t)width +
                                        (size_t)(x * times + i % times)];
                *to++ = (float)(sum / blocks);
            }
    }
    image->width = film.width, image->height = film.height;
    printf("%s: means of %dx%d pixels\n", path, times, times);
}

/* The planes of an image that show the scene's channels: R, G and B, or for a grey film also Y or
   the only plane there is (then colour[0] and no other); or those of the variances. Returns 0 if
   there are none. */
static int find_planes(const itn_image *image, int grey, int variance, const float *colour[3]) {
    static const char *const names[2][4] = {
        {"R", "G", "B", "Y"}, {"Variance.R", "Variance.G", "Variance.B", "Variance.Y"}};
    int c, coloured = 1;
    for (c = 0; c < 3; c++) coloured &= !!itn_image_plane(image, names[0][c]);
    for (c = 0; c < 3; c++)
        colour[c] = coloured ? itn_image_plane(image, names[variance][c]) : NULL;
    if (coloured) return colour[0] && colour[1] && colour[2];
    if (grey) colour[0] = itn_image_plane(image, names[variance][3]);
    if (grey && !variance && !colour[0] && image->plane_count == 1) colour[0] = image->pixels;
    return colour[0] != NULL;
}

/* Copies a plane for each channel of the scene; a grey one takes the luminance of a coloured image,
   whose variance is that of channels that all have one noise. */
static float *copy_planes(const float *const colour[3], size_t plane, int channels, int variance) {
    static const float luminance[3] = {.2126f, .7152f, .0722f};
    float *out = (float *)calloc(plane * (size_t)channels, sizeof(float));
    size_t i;
    int c;
    if (!out) fail("out of memory", "");
    for (c = 0; c < channels && (channels == 3 || !colour[1]); c++)
        memcpy(out + (size_t)c * plane, colour[c], plane * sizeof(float));
    for (i = 0; i < plane && channels == 1 && colour[1]; i++) {
        for (c = 0; c < 3; c++)
            out[i] += luminance[c] * (variance ? sqrtf(colour[c][i]) : colour[c][i]);
        if (variance) out[i] *= out[i];
    }
    return out;
}

/* Fails because an image has no planes that the film could show, and says which it has. */
static void fail_planes(const char *path, const itn_image *image, int grey) {
    char why[300];
    size_t at;
    int p;
    at = (size_t)snprintf(why, sizeof why, "%s; its planes are",
                          grey ? "has neither Y nor R, G and B"
                               : "has not R, G and B, which the film of the scene has");
    for (p = 0; p < image->plane_count && at < sizeof why - 80; p++)
        at += (size_t)snprintf(why + at, sizeof why - at, " %s", image->names[p]);
    fail(path, why);
}

/* Gives values a value where the image is transparent (A below 1): something else than the scene is
   behind the object there. Returns in how many pixels. */
static int set_transparent(float *values, const itn_image *image, itn_film_desc film, float value) {
    const float *alpha = itn_image_plane(image, "A");
    size_t plane = (size_t)film.width * (size_t)film.height, i;
    int c, count = 0;
    for (i = 0; alpha && i < plane; i++) {
        if (alpha[i] >= 1) continue;
        for (c = 0; c < film.channels; c++) values[(size_t)c * plane + i] = value;
        count++;
    }
    return count;
}

/* Copies the light of an image, and its variance if it has that layer, in the scene's channels. */
static void read_target(picture *p, const char *path, itn_image *image) {
    itn_film_desc film = itn_scene_film(p->scene);
    size_t plane = (size_t)film.width * (size_t)film.height;
    const float *colour[3];
    int left_out;
    fit_image(path, image, film);
    if (!find_planes(image, film.channels == 1, 0, colour))
        fail_planes(path, image, film.channels == 1);
    p->light = copy_planes(colour, plane, film.channels, 0);
    p->noise_known = find_planes(image, film.channels == 1, 1, colour);
    if (p->noise_known) p->variance = copy_planes(colour, plane, film.channels, 1);
    if (!p->target) return;
    /* what transparent pixels hold may be NaN, and does not count: all others are checked */
    left_out = set_transparent(p->light, image, film, 0);
    if (p->variance) set_transparent(p->variance, image, film, 0);
    check_target(path, film, p->light, 0);
    if (p->variance) check_target(path, film, p->variance, 1), note_noise(path, p, film);
    if (!left_out) return;
    if (!p->variance) p->variance = (float *)calloc(plane * (size_t)film.channels, sizeof(float));
    if (!p->variance) fail("out of memory", "");
    set_transparent(p->variance, image, film, INFINITY);
    printf("%s: %d pixels, where A is below 1, do not count\n", path, left_out);
}

/* Whether the parameter is FIELD of a medium, in one of its channels or in all. */
static int is_field(const itn_parameter *p, const char *field) {
    const char *name = strchr(p->name, '.') + 1;
    size_t size = strlen(field);
    return !strncmp(name, field, size) && (!name[size] || name[size] == '_');
}

static int is_of_medium(const itn_parameter *p) {
    return is_field(p, "sigma_t") || is_field(p, "albedo") || is_field(p, "g");
}

/* The mean chord of the medium's objects: their thickness where sigma_t is 1. */
static double mean_chord(const itn_scene *scene, const char *medium) {
    int i, count = itn_parameter_count(scene);
    float *theta = (float *)calloc((size_t)count, sizeof *theta);
    double chord;
    if (!theta) fail("out of memory", "");
    itn_parameter_values(scene, theta);
    for (i = 0; i < count; i++)
        if (is_field(itn_parameter_get(scene, i), "sigma_t")) theta[i] = 1;
    chord = itn_scene_thickness(scene, theta, medium);
    free(theta);
    return chord;
}

/* A neutral value for a parameter of a medium, which depends on the objects' size alone; its own
   for any other. */
static float neutral_guess(const itn_scene *scene, const itn_parameter *p) {
    char medium[ITN_NAME_SIZE] = "";
    double chord;
    if (is_field(p, "albedo")) return .7f;
    if (is_field(p, "g")) return .3f;
    if (!is_field(p, "sigma_t")) return p->value;
    memcpy(medium, p->name, (size_t)(strchr(p->name, '.') - p->name));
    chord = mean_chord(scene, medium);
    return chord > 0 ? (float)(10 / chord) : 1;
}

/* The parameters of the scene's media. */
static int medium_parameters(const itn_scene *scene, const itn_parameter **unknowns) {
    int i, count = 0;
    for (i = 0; i < itn_parameter_count(scene); i++) {
        const itn_parameter *p = itn_parameter_get(scene, i);
        if (!is_of_medium(p)) continue;
        if (count == MOST_PARAMETERS) fail("too many parameters", "name some of them by --params");
        unknowns[count++] = p;
    }
    return count;
}

/* The mean brightness that a network is used to, from WEIGHTS.txt, which train writes. */
static double network_mean(const char *path) {
    char text[1200];
    double mean = 0;
    int input = 0;
    FILE *file;
    snprintf(text, sizeof text, "%s.txt", path);
    file = fopen(text, "r");
    if (!file) fail(text, "cannot be read; train writes it beside the network");
    if (fscanf(file, "model %*s input %d mean %lf", &input, &mean) != 2 || input != 1)
        fail(text, "is of a network for another input: train it anew");
    fclose(file);
    return mean;
}

/* Opens a network that reads pictures of the scene; then finds which of the unknowns are sigma_t,
   albedo and g of one medium, which is what it answers. */
static itn_net *open_network(const char *path, const itn_context *context, const itn_scene *scene,
                             const history *h, int places[3]) {
    static const char *const fields[3] = {"sigma_t", "albedo", "g"};
    itn_film_desc film = itn_scene_film(scene);
    itn_net_desc shape;
    itn_net *net;
    itn_error error;
    char text[200];
    int i, k, length = (int)strcspn(h->unknowns[0]->name, ".");
    if (itn_net_open(path, 1, context, &net, &error)) fail(error.message, "");
    shape = itn_net_shape(net);
    if (film.channels != 1) fail(path, "reads grey pictures; the film of the scene has colours");
    snprintf(text, sizeof text, "answers pictures of %dx%d pixels in %d planes with %d values; it "
             "should be %dx%d in 2 planes, and 3 values", shape.width, shape.height,
             shape.channels, shape.outputs, film.width, film.height);
    if (shape.width != film.width || shape.height != film.height || shape.channels != 2 ||
        shape.outputs != 3)
        fail(path, text);
    for (k = 0; k < 3; k++) {
        char name[2 * ITN_NAME_SIZE];
        snprintf(name, sizeof name, "%.*s.%s", length, h->unknowns[0]->name, fields[k]);
        for (i = 0; i < h->count && strcmp(h->unknowns[i]->name, name) != 0;) i++;
        if (i == h->count || h->count != 3)
            fail(path, "gives sigma_t, albedo and g of one medium: recover just these");
        places[k] = i;
    }
    return net;
}

/* Takes what a network reads off the picture for values and prints it. */
static void start_from_network(itn_net *net, double mean, const int places[3], const history *h,
                               const picture *p, float *values) {
    float answer[3]; /* coordinates */
    itn_error error;
    int k;
    if (itn_net_read(net, p->light, mean, answer, &error)) fail(error.message, "");
    printf("net");
    for (k = 0; k < 3; k++) {
        const itn_parameter *unknown = h->unknowns[places[k]];
        values[places[k]] = (float)itn_parameter_from_coordinate(unknown, (double)answer[k]);
        printf("  %s %.5g", unknown->name, (double)values[places[k]]);
    }
    printf("\n");
}

/* Opens the scene of a picture. */
static void open_scene(picture *p, const itn_context *context) {
    itn_error error;
    if (itn_scene_load(p->path, context, &p->scene, &error)) fail(error.message, "");
    p->theta = (float *)calloc((size_t)itn_parameter_count(p->scene) + 1, sizeof(float));
    if (!p->theta) fail("out of memory", "");
    itn_parameter_values(p->scene, p->theta);
}

/* Sets parameters in all scenes that have them. */
static void set_values(picture *pictures, int views, const history *h, const float *values) {
    int v, k, index;
    for (v = 0; v < views; v++)
        for (k = 0; k < h->count; k++) {
            index = itn_parameter_find(pictures[v].scene, h->unknowns[k]->name);
            pictures[v].parameters[k] = index;
            if (index >= 0) pictures[v].theta[index] = values[k];
        }
}

/* Reads a picture's image, or renders it with the hidden values, which theta holds. */
static void make_target(picture *p, const itn_context *context, const itn_render_options *options) {
    itn_image image;
    itn_error error;
    if (p->target ? itn_image_load(p->target, context, &image, &error)
                  : itn_render(p->scene, p->theta, options, NULL, 0, &image, &error))
        fail(error.message, "");
    read_target(p, p->target ? p->target : p->path, &image);
    itn_image_free(&image);
}

static int compare(const void *a, const void *b) {
    float x = *(const float *)a, y = *(const float *)b;
    return (x > y) - (x < y);
}

/* The value that `part` of the numbers' sizes lie below; those that are not finite do not count. */
static double quantile(const float *values, size_t count, double part) {
    float *sizes = (float *)malloc(count * sizeof *sizes), found;
    size_t i, n = 0;
    if (!sizes) fail("out of memory", "");
    for (i = 0; i < count; i++)
        if (isfinite(values[i])) sizes[n++] = fabsf(values[i]);
    qsort(sizes, n, sizeof *sizes, compare);
    found = n ? sizes[(size_t)(part * (double)(n - 1))] : 0;
    free(sizes);
    return found > 0 ? (double)found : 1;
}

/* Divides the difference by its noise, that of the picture and of the render. Where the picture's
   is not known, it is what neighbours in a row do not share. What does not count becomes NaN. */
static void divide_by_noise(const picture *p, float *difference, const float *variance,
                            size_t count) {
    double own = 0;
    size_t i, n = 0;
    for (i = 1; i < count && !p->noise_known; i++) {
        double step = (double)difference[i] - (double)difference[i - 1];
        if (p->variance && !(isfinite(p->variance[i]) && isfinite(p->variance[i - 1]))) continue;
        own += .5 * step * step - (double)variance[i], n++;
    }
    own = own > 0 ? own / (double)n : 0;
    for (i = 0; i < count; i++) {
        double noise = (double)variance[i] + own;
        if (p->variance) noise += (double)p->variance[i];
        difference[i] = isfinite(noise) && noise > 0 ? difference[i] / (float)sqrt(noise) : NAN;
    }
}

enum { COLUMN = 240, GAP = 20, TOP = 70, CHART = 130 };
/* How a quantity went with the steps, with error bands. */
static void draw_chart(itn_image *page, const history *h, int place, int top, const double *values,
                       const double *errors, const char *title, int is_misfit, int colour) {
    sheet_box b = {0, 0, COLUMN - 54, CHART};
    sheet_axis x = {0, 1, 0}, y = {1e300, -1e300, 0};
    double steps[MOST_ROWS];
    int i;
    b.left = GAP + 54 + place % 4 * (COLUMN + GAP), b.top = top + place / 4 * (CHART + 70);
    if (h->rows > 1) x.to = h->rows - 1;
    y.logarithmic = is_misfit;
    for (i = 0; i < h->rows; i++) {
        steps[i] = i;
        y.from = fmin(y.from, values[i]), y.to = fmax(y.to, values[i]);
    }
    if (is_misfit) {
        y.from = fmax(fmin(y.from, h->noise ? 1 : INFINITY), 1e-30) / 1.6;
        y.to = fmax(y.to * 1.6, 4 * y.from);
    } else {
        double range = y.to - y.from, most = .5 * (fabs(y.to) + range);
        double room = fmax(.15 * range, fmin(3 * errors[h->rows - 1], most));
        if (!(room > 0)) room = fmax(.1 * fabs(y.to), 1e-6);
        y.from -= room, y.to += room;
    }
    sheet_axes(page, b, x, y, title, "step");
    if (is_misfit && h->noise) {
        double floor = sheet_height(b, y, 1);
        sheet_line(page, b.left, floor, b.left + b.width, floor, 1.5, SHEET_GREY);
        sheet_text(page, b.left + b.width - 4, floor - 4, 1, 8, SHEET_GREY, "noise");
    }
    sheet_curve(page, b, x, y, h->rows, steps, values, errors, SHEET_COLOURS[colour % 6]);
}

/* One page that tells the story: target, estimate, difference, derivatives and, of the first
   picture, what was found and how the search went. */
static void save_sheet(const picture *p, const itn_image *image, int count, const history *h,
                       const itn_estimate *estimates, const itn_refine_outcome *outcome) {
    int channels = itn_scene_film(p->scene).channels, k, n = image->width * image->height;
    int height = (COLUMN * image->height + image->width / 2) / image->width;
    int rows = (count + 3) / 4, row = height + 66, charts = TOP + (1 + rows) * row + 20;
    size_t plane = (size_t)n, pixels = plane * (size_t)channels;
    float *difference = (float *)malloc(pixels * sizeof *difference);
    double full = quantile(p->light, pixels, .99);
    sheet_box b = {GAP, TOP, COLUMN, 0};
    char text[1200];
    itn_error error;
    itn_image page;
    if (h) k = charts + (h->count + 4) / 4 * (CHART + 70);
    else k = charts;
    if (!difference || !sheet_make(&page, 4 * COLUMN + 5 * GAP, k)) fail("out of memory", "");
    b.height = height;
    snprintf(text, sizeof text, "%s", strrchr(p->stem, '/') ? strrchr(p->stem, '/') + 1 : p->stem);
    sheet_text(&page, GAP, 32, -1, 14, SHEET_INK, text);
    if (h && h->noise) {
        snprintf(text, sizeof text,
                 "misfit %.3g " SHEET_PLUS_MINUS " %.1g: the scene %s the picture", outcome->misfit,
                 outcome->misfit_error,
                 outcome->explained ? "explains" : "DOES NOT EXPLAIN");
        sheet_text(&page, page.width - GAP, 32, 1, 11,
                   outcome->explained ? SHEET_INK : SHEET_COLOURS[1], text);
    }
    for (k = 0; k < 3; k++) {
        static const char *const titles[] = {"target", "estimate", "difference over noise"};
        b.left = GAP + k * (COLUMN + GAP);
        sheet_text(&page, b.left, b.top - 8, -1, 10, SHEET_INK, titles[k]);
        if (k < 2)
            sheet_picture(&page, b, k ? image->pixels : p->light, channels, image->width,
                          image->height, 1, full);
    }
    for (k = 0; k < (int)pixels; k++) difference[k] = image->pixels[k] - p->light[k];
    divide_by_noise(p, difference, image->pixels + pixels, pixels);
    sheet_picture(&page, b, difference, channels, image->width, image->height, 0, 3);
    free(difference);
    b.top += height + 8, b.height = 8;
    sheet_bar(&page, b, 3, "sigma");
    for (k = 0; h && k < h->count; k++) {
        const itn_estimate *e = &estimates[k];
        double left = GAP + 3 * (COLUMN + GAP), top = TOP + 14 + 34 * k;
        sheet_text(&page, left, top, -1, 9, SHEET_COLOURS[k % 6], h->unknowns[k]->name);
        snprintf(text, sizeof text, "%.5g " SHEET_PLUS_MINUS " %.2g%s", e->value,
                 e->standard_error, e->determined ? "" : " ?");
        sheet_text(&page, left + 12, top + 15, -1, 9, SHEET_INK, text);
    }
    for (k = 0; k < count; k++) {
        const float *slope = image->pixels + (size_t)(2 * (k + 1)) * pixels;
        const char *name = image->names[2 * (k + 1) * channels];
        double most = quantile(slope, pixels, .99);
        b.left = GAP + k % 4 * (COLUMN + GAP), b.top = TOP + (1 + k / 4) * row, b.height = height;
        snprintf(text, sizeof text, "%.*s", (int)strcspn(name, "."), name);
        sheet_text(&page, b.left, b.top - 8, -1, 10, SHEET_INK, text);
        sheet_picture(&page, b, slope, channels, image->width, image->height, 0, most);
        b.top += height + 8, b.height = 8;
        sheet_bar(&page, b, most, "");
    }
    if (h) draw_chart(&page, h, 0, charts, h->misfit, h->misfit_error,
                      h->noise ? "misfit over noise" : "loss", 1, 5);
    for (k = 0; h && k < h->count; k++)
        draw_chart(&page, h, k + 1, charts, h->values[k], h->errors[k], h->unknowns[k]->name, 0, k);
    snprintf(text, sizeof text, "%s_sheet.png", p->stem);
    if (itn_image_save_png(&page, 0, 3, ITN_PNG_TONE, 1, text, &error)) fail(error.message, "");
    itn_image_free(&page);
}

/* Renders image and derivatives at the estimate and saves them with the sheet. */
static void save_pictures(const picture *p, itn_render_options options, int unknowns,
                          const history *h, const itn_estimate *estimates,
                          const itn_refine_outcome *outcome) {
    int parameters[MOST_PARAMETERS], count = 0, k;
    char path[1200];
    itn_image image;
    itn_error error;
    for (k = 0; k < unknowns; k++)
        if (p->parameters[k] >= 0) parameters[count++] = p->parameters[k];
    options.spp *= 2;
    if (itn_render(p->scene, p->theta, &options, parameters, count, &image, &error))
        fail(error.message, "");
    snprintf(path, sizeof path, "%s_estimate.exr", p->stem);
    if (itn_image_save_exr(&image, path, &error)) fail(error.message, "");
    save_sheet(p, &image, count, h, estimates, outcome);
    itn_image_free(&image);
}

/* Prints the table. Returns how many hidden values lie beyond four standard errors. */
static int print_estimates(const history *h, const itn_estimate *estimates, const float *hidden,
                           const itn_refine_outcome *outcome) {
    int poor = !outcome->explained; /* then no samples help */
    int k, missed = 0;
    for (k = 0; k < h->count; k++) {
        const itn_estimate *e = &estimates[k];
        const char *name = h->unknowns[k]->name;
        printf("%s %.5g +- %.2g", name, e->value, e->standard_error);
        if (hidden) printf(" hidden %.5g", (double)hidden[k]);
        printf("\n");
        if (!e->determined)
            printf("warning: with so %s the image hardly determines %s: do not rely on its value; "
                   "%s may help\n", poor ? "poor a fit" : "few samples and iterations", name,
                   poor ? "a scene like the picture's or another start"
                        : "a larger --final-spp or --iterations");
        else if (hidden)
            missed += !(fabs(e->value - (double)hidden[k]) <= 4 * e->standard_error);
    }
    return missed;
}

/* DIR/name or, without a folder, the path, both without the ending; numbered from the second on. */
static void make_stem(const char *path, const char *dir, int number, char stem[STEM_SIZE]) {
    char digits[16] = "";
    const char *base = strrchr(path, '/') && dir ? strrchr(path, '/') + 1 : path;
    const char *file = strrchr(base, '/') ? strrchr(base, '/') + 1 : base;
    const char *ending = strrchr(file, '.') ? strrchr(file, '.') : file + strlen(file);
    if (number > 1) snprintf(digits, sizeof digits, "_%d", number);
    if (snprintf(stem, STEM_SIZE, "%s%s%.*s%s", dir ? dir : "", dir ? "/" : "",
                 (int)(ending - base), base, digits) >= STEM_SIZE)
        fail(path, "this path, or that of -o, is too long");
}

/* Fails if the estimate of a stem would be written over the target. */
static void keep_target(const char *target, const char *stem) {
    char path[1200];
    struct stat from, to;
    snprintf(path, sizeof path, "%s_estimate.exr", stem);
    if (!stat(target, &from) && !stat(path, &to) && from.st_dev == to.st_dev &&
        from.st_ino == to.st_ino)
        fail(target, "the estimate would be written over it: name another folder with -o");
}

/* Makes the stems of all pictures' results; fails, before there is work that could be lost, where
   they cannot be written or would replace a target or each other. */
static void make_stems(picture *pictures, int views, const char *dir) {
    int v, w;
    for (v = 0; v < views; v++) {
        char folder[STEM_SIZE + 2], *slash;
        make_stem(pictures[v].path, dir, v + 1, pictures[v].stem);
        strcpy(folder, pictures[v].stem);
        slash = strrchr(folder, '/');
        strcpy(slash ? slash + 1 : folder, ".");
        if (access(folder, W_OK)) fail(folder, "this is no folder, or must not be written to");
        for (w = 0; w < v; w++)
            if (!strcmp(pictures[v].stem, pictures[w].stem))
                fail(pictures[v].path, "its results would have the names of another scene's");
    }
    for (v = 0; v < views; v++)
        for (w = 0; w < views && pictures[v].target; w++)
            keep_target(pictures[v].target, pictures[w].stem);
}

int main(int argc, char **argv) {
    const char *hidden_list = NULL, *names = NULL, *dir = NULL, *network = NULL;
    int views = 0, targets = 0, i, k, v, missed;
    itn_context context = ITN_ZERO;
    itn_refine_options refine = ITN_ZERO;
    itn_render_options render = ITN_ZERO;
    itn_estimate estimates[MOST_PARAMETERS];
    float values[MOST_PARAMETERS], hidden[MOST_PARAMETERS];
    double covariance[MOST_PARAMETERS * MOST_PARAMETERS];
    itn_view look[MOST_VIEWS];
    itn_error error;
    static picture pictures[MOST_VIEWS];
    static history h;
    char words[4096];
    itn_net *net = NULL;
    itn_refine_outcome outcome;
    double mean = 0; /* of the pictures that the network is used to */
    int places[3] = {0, 0, 0};
    refine.spp = 48, refine.outcome = &outcome, refine.covariance = covariance;
    for (i = 1; i < argc; i++) {
        const char *option = argv[i], *value = i + 1 < argc ? argv[i + 1] : NULL;
        if (!strcmp(option, "--help")) return printf("%s", usage) < 0;
        int target = !strcmp(option, "--target");
        if ((option[0] != '-' && views == MOST_VIEWS) || (target && targets == MOST_VIEWS))
            fail(option, "too many scenes or targets");
        if (option[0] != '-') { pictures[views++].path = option; continue; }
        if (!value) fail(option, "unknown option, or its value is missing");
        i++;
        if (target) pictures[targets++].target = value;
        else if (!strcmp(option, "--hidden")) hidden_list = value;
        else if (!strcmp(option, "--params")) names = value;
        else if (!strcmp(option, "--net")) network = value;
        else if (!strcmp(option, "-o")) dir = value;
        else if (!strcmp(option, "--iterations")) refine.iterations = whole(option, value);
        else if (!strcmp(option, "--spp")) refine.spp = whole(option, value);
        else if (!strcmp(option, "--final-spp")) refine.final_spp = whole(option, value);
        else if (!strcmp(option, "--seconds")) refine.seconds = whole(option, value);
        else if (!strcmp(option, "--seed")) refine.seed = (uint64_t)whole(option, value);
        else if (!strcmp(option, "-t")) context.threads = whole(option, value);
        else if (!strcmp(option, "--method") && !strcmp(value, "lm")) refine.method = ITN_METHOD_LM;
        else if (!strcmp(option, "--method") && !strcmp(value, "adam"))
            refine.method = ITN_METHOD_ADAM;
        else if (!strcmp(option, "--method") && !strcmp(value, "sgd"))
            refine.method = ITN_METHOD_SGD;
        else fail(option, "unknown option or value");
    }
    if (!views) return fprintf(stderr, "%s", usage), 1;
    if (targets && hidden_list) fail("--hidden", "has no meaning with --target");
    if (targets && targets != views) fail("--target", "needed for each of the scenes, or for none");
    if (refine.spp < 2 || refine.spp > 524287) fail("--spp", "must be in 2..524287");
    if (dir && mkdir(dir, 0777) && errno != EEXIST) fail(dir, "this folder cannot be made");
    make_stems(pictures, views, dir);
    for (v = 0; v < views; v++) open_scene(&pictures[v], &context);

    /* what is hidden, what is sought, where the search starts */
    if (hidden_list) {
        h.count = read_list(pictures, views, hidden_list, h.unknowns, hidden);
        set_values(pictures, views, &h, hidden);
    } else if (!names) {
        h.count = medium_parameters(pictures[0].scene, h.unknowns);
    }
    if (names) h.count = read_list(pictures, views, names, h.unknowns, NULL);
    if (!h.count) fail("nothing to recover: name parameters with --params", "");
    for (i = 0; i < h.count; i++) {
        const itn_parameter *p = h.unknowns[i];
        for (v = 0; (k = itn_parameter_find(pictures[v].scene, p->name)) < 0;) v++;
        hidden[i] = pictures[v].theta[k];
        values[i] = targets || hidden_list ? p->value : neutral_guess(pictures[v].scene, p);
    }
    set_values(pictures, views, &h, hidden);
    if (network) {
        net = open_network(network, &context, pictures[0].scene, &h, places);
        mean = network_mean(network);
    }

    /* the targets: from files, or rendered with the hidden values and other random numbers */
    render.spp = 8 * refine.spp;
    for (v = 0; v < views; v++) {
        render.seed = refine.seed + 1000003 + (uint64_t)v;
        make_target(&pictures[v], &context, &render);
        look[v].scene = pictures[v].scene, look[v].theta = pictures[v].theta;
        look[v].target = pictures[v].light, look[v].target_variance = pictures[v].variance;
        look[v].parameters = pictures[v].parameters;
    }
    show_thickness(pictures[0].scene, stdout);
    refine.progress = show_step, refine.progress_user = &h;
    signal(SIGINT, interrupt);
    if (net) start_from_network(net, mean, places, &h, &pictures[0], values);
    itn_net_free(net);
    if (itn_refine_views(look, views, values, h.count, &refine, estimates, &error))
        fail(error.message, "");
    signal(SIGINT, SIG_DFL);
    printf("misfit %.3g +- %.2g: the scene %s the picture\n", outcome.misfit, outcome.misfit_error,
           outcome.explained ? "explains" : "does not explain");
    missed = print_estimates(&h, estimates, targets ? NULL : hidden, &outcome);
    if (itn_refine_words(h.unknowns, h.count, estimates, covariance, &outcome, words,
                         sizeof words) >= 0)
        printf("%s", words);

    render.spp = refine.spp, render.seed = refine.seed + 2000003; /* not the targets' numbers */
    set_values(pictures, views, &h, values);
    for (v = 0; v < views; v++) {
        const char *stem = pictures[v].stem;
        save_pictures(&pictures[v], render, h.count, v ? NULL : &h, estimates, &outcome);
        printf("pictures: %s_sheet.png, %s_estimate.exr\n", stem, stem);
        itn_scene_free(pictures[v].scene);
        free(pictures[v].variance);
        free(pictures[v].light);
        free(pictures[v].theta);
    }
    return missed || !outcome.explained;
}
