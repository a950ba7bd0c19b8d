/* Recovers the parameters of a translucent object from one image of it, or from several: the main
   job.

   You learn: how to hand images and photos to itn_refine_views, what comes back (values with error
   bars, and word of those that the images do not determine), and how to look at it.

   Compile: cc -O2 -march=native invert.c -o invert -lm -lpthread
   Run:     ./invert ../scenes/default.itn -o out
            ./invert front.itn side.itn --target front.exr --target side.exr -o out
   --help lists the options. Several scenes show one object from several sides or in several lights,
   each with its own image; parameters of one name are one unknown. Without --target and --hidden
   the values in the (first) scene file are the hidden ones: images are made with them, and the
   search starts from a neutral guess (thickness 10, albedo .7, g .3). Otherwise it starts from the
   values in the scene file. What is not of a medium has no neutral guess and starts from the scene
   file's value: say with --hidden what is to be hidden instead.
   An image may have any size that has the film's shape. Where it is masked, transparent (A below 1)
   or clipped it does not count. The units of a PNG are not the light's: its exposure is one of the
   unknowns, and starts where the means are equal. photo.md beside this tells how photos are taken.
   Where sigma_t, albedo and g of a scene's only medium are sought, in a film of one channel, it
   starts from what a network of known.c reads off the first picture, by what is known of the
   scene, and says how sure that is; known.net is looked for beside the scene and in the folders
   scenes and ../scenes.
   --net takes another network, of known.c or of train.c; --net none takes none. Prints a row per
   iteration and at the end a line per parameter,
            milk.sigma_t 31.2 +- 0.4 hidden 31
   and what follows from them in the words of tissue optics; says in words what the images
   determine, and fails if a hidden value that they determine lies more than four standard errors
   away, or if the scene does not explain the images: see the misfit, in units of noise, 1 where it
   does. Ctrl-C ends it with the answer so far. To the folder after -o, or beside the scene, go
   SCENE_sheet.png, one page of target, estimate, their difference over its noise, derivatives and
   how the search went, and SCENE_estimate.exr with the numbers. */
#define _POSIX_C_SOURCE 200809L
#define _DARWIN_C_SOURCE /* else macOS hides sysconf's number of processors */
#define ITN_THREADS
#define ITN_IMPLEMENTATION
#include "../itn.h"
#define PROGRAM "invert"
#include "tool.h"
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
static const char usage[] =
    "invert SCENE... [--target IMAGE]... [options]\n"
    "Finds what an object is made of, from images of it (see the top of invert.c).\n";
enum { TARGET, MASK, CROP, GAMMA, READ_NOISE, GAIN, SATURATION, EXPOSURE, BACKGROUND, PARAMS,
       HIDDEN, NET, ITERATIONS, SECONDS, SPP, FINAL_SPP, SEED, THREADS, FOLDER };
static const tool_option choices[] = {
    {"--target", "IMAGE", "EXR, PFM or PNG; one for each scene, in the same order"},
    {"--mask", "IMAGE", "below .5 the target does not count; one for each target"},
    {"--crop", "X,Y,W,H", "the pixels of the targets that the film shows; default all"},
    {"--gamma", "G|srgb|linear", "of PNGs, light = code^G; default: as the file says, or srgb"},
    {"--read-noise", "S", "standard deviation of a target's values; default half a code of 8 bits"},
    {"--gain", "G", "its variance per value, 1 / electrons at value 1; default 0"},
    {"--saturation", "V", "values from V on do not count; default: the largest code of a PNG"},
    {"--exposure", "known|unknown", "of targets; default: unknown for PNG, known for EXR and PFM"},
    {"--background", "known|unknown", "of the film, if it has one; default: known"},
    {"--params", "name,...", "the unknowns; default: sigma_t, albedo and g of the media"},
    {"--hidden", "name=value,...", "without --target: what is sought, and its values"},
    {"--net", "WEIGHTS|none", "start from what this network reads; default: scenes/known.net"},
    {"--iterations", "N", "at most so many; default 20"},
    {"--seconds", "S", "at most so long; default 60"},
    {"--spp", "N", "samples per pixel of a render; default 48"},
    {"--final-spp", "N", "of those that are averaged in the end; default by need, 6 to 192 spp"},
    {"--seed", "N", "of random numbers; default 0"},
    {"-t", "THREADS", "default: all processors"},
    {"-o", "DIR", "where results go; default: beside the scene"},
    {NULL, NULL, NULL}};

/* A scene and the image of it. */
typedef struct picture {
    const char *path, *target, *mask;
    itn_scene *scene;
    int parameters[MOST_PARAMETERS]; /* what the unknowns are in it, or -1 */
    float *theta, *light, *variance; /* light and variance (NULL: unknown) are of the photo */
    itn_image photo;
    int noise_known; /* whether variance says more than which pixels count */
    int own_units;   /* whether the target is a PNG */
    char stem[STEM_SIZE]; /* where its results go, up to _estimate.exr and the like */
} picture;

/* What is sought, and what the progress callback collects for the chart. */
typedef struct history {
    const itn_parameter *unknowns[MOST_PARAMETERS];
    int count, rows;
    int blocks[MOST_ROWS]; /* pixels a side that are one in the pictures that a step compares */
    double misfit[MOST_ROWS], misfit_error[MOST_ROWS];
    double values[MOST_PARAMETERS][MOST_ROWS], errors[MOST_PARAMETERS][MOST_ROWS];
} history;

/* Ctrl-C ends the search with the answer so far. */
static volatile sig_atomic_t interrupted;
static void interrupt(int number) { interrupted = number > 0; }

static int show_step(void *user, const itn_refine_step *step) {
    history *h = (history *)user;
    int k, row;
    if (step->fraction < 1) { /* what is under way */
        if (isatty(2))
            fprintf(stderr, "%3.0f %%, %.0f of some %.0f s  \r", 100 * step->fraction,
                    step->seconds, step->expected);
        return interrupted;
    }
    row = h->rows < MOST_ROWS ? h->rows++ : MOST_ROWS - 1;
    printf("%3d  misfit %.4g +- %.2g ", step->iteration, step->misfit, step->misfit_error);
    h->misfit[row] = fmax(step->misfit, .1), h->misfit_error[row] = step->misfit_error;
    h->blocks[row] = step->block;
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
        if (!unknowns[count]) tool_fail_parameter(pictures[0].scene, name);
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

/* Says what a target is, and what could be wrong with it. */
static void show_target(const picture *p, const itn_image *image, const itn_photo_desc *desc,
                        const itn_photo_report *report) {
    itn_film_desc film = itn_scene_film(p->scene);
    int width = desc->crop_width ? desc->crop_width : image->width - desc->crop_x;
    int height = desc->crop_height ? desc->crop_height : image->height - desc->crop_y;
    int values = width * height * film.channels;
    if (width != film.width || p->own_units)
        printf("%s: means of %.3gx%.3g pixels\n", p->target, (double)width / film.width,
               (double)height / film.height);
    if (report->masked)
        printf("%s: %d pixels of the film do not count, %d of them because the target is clipped\n",
               p->target, report->masked, report->saturated);
    if (!image->codes && report->clipped > 2 && report->clipped > values / 1000 &&
        report->clipped < values / 2)
        printf("note: %s: %d values are the largest, %.4g: if it is clipped there, say so with "
               "--saturation %.4g\n", p->target, report->clipped, (double)report->largest,
               (double)report->largest);
}

/* Reads a picture's image, or renders it with the hidden values, which theta holds; then makes it
   as large as the film. */
static void make_target(picture *p, itn_photo_desc desc, const itn_context *context,
                        const itn_render_options *render) {
    itn_film_desc film = itn_scene_film(p->scene);
    size_t pixels = (size_t)film.width * (size_t)film.height * (size_t)film.channels, i;
    itn_photo_report report;
    itn_image image, mask;
    itn_error error;
    if (p->target ? itn_image_load(p->target, context, &image, &error)
                  : itn_render(p->scene, p->theta, render, NULL, 0, &image, &error))
        fail(error.message, "");
    if (p->mask && itn_image_load(p->mask, context, &mask, &error)) fail(error.message, "");
    if (p->mask) desc.mask = &mask;
    if (itn_photo_make(&image, &desc, film, &p->photo, &report, &error))
        fail(p->target ? p->target : p->path, error.message);
    p->light = p->photo.pixels;
    if (p->photo.plane_count > film.channels) p->variance = p->light + pixels;
    for (i = 0; i < pixels && p->variance; i++)
        p->noise_known |= p->variance[i] > 0 && p->variance[i] < INFINITY;
    p->own_units = image.codes > 0;
    if (p->target) show_target(p, &image, &desc, &report);
    if (p->mask) itn_image_free(&mask);
    itn_image_free(&image);
}

static int is_of_medium(const itn_parameter *p) {
    return tool_is_field(p, "sigma_t") || tool_is_field(p, "albedo") || tool_is_field(p, "g");
}

/* The mean chord of the medium's objects: their thickness where sigma_t is 1. */
static double mean_chord(const itn_scene *scene, const char *medium) {
    int i, count = itn_parameter_count(scene);
    float *theta = (float *)calloc((size_t)count, sizeof *theta);
    double chord;
    if (!theta) fail("out of memory", "");
    itn_parameter_values(scene, theta);
    for (i = 0; i < count; i++)
        if (tool_is_field(itn_parameter_get(scene, i), "sigma_t")) theta[i] = 1;
    chord = itn_scene_thickness(scene, theta, medium);
    free(theta);
    return chord;
}

/* A neutral value for a parameter of a medium, which depends on the objects' size alone; its own
   for any other. */
static float neutral_guess(const itn_scene *scene, const itn_parameter *p) {
    char medium[ITN_NAME_SIZE] = "";
    double chord;
    if (tool_is_field(p, "albedo")) return .7f;
    if (tool_is_field(p, "g")) return .3f;
    if (!tool_is_field(p, "sigma_t")) return p->value;
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

/* Takes what a network reads off the picture for values of sigma_t, albedo and g of the medium that
   the first unknown is of, and prints it. The network has seen pictures of the scene's exposure;
   where that is sought, what it takes for the mean is as much brighter as the start. */
static void start_from_network(itn_net *net, const char *path, const history *h, const picture *p,
                               float *values) {
    static const char *const fields[3] = {"sigma_t", "albedo", "g"};
    itn_film_desc film = itn_scene_film(p->scene);
    itn_net_desc shape = itn_net_shape(net);
    itn_error error;
    float answer[3]; /* coordinates */
    double mean;
    char text[200];
    int i, k, length = (int)strcspn(h->unknowns[0]->name, ".");
    if (film.channels != 1) fail(path, "reads grey pictures; the film of the scene has colours");
    snprintf(text, sizeof text, "answers pictures of %dx%d pixels in %d planes with %d values; it "
             "should be %dx%d in 2 planes, and 3 values", shape.width, shape.height,
             shape.channels, shape.outputs, film.width, film.height);
    if (shape.width != film.width || shape.height != film.height || shape.channels != 2 ||
        shape.outputs != 3)
        fail(path, text);
    mean = network_mean(path);
    for (k = 0; k < h->count; k++)
        if (!strcmp(h->unknowns[k]->name, "film.exposure"))
            mean *= (double)(values[k] / h->unknowns[k]->value);
    if (itn_net_read(net, p->light, mean, answer, &error)) fail(error.message, "");
    printf("net");
    for (k = 0; k < 3; k++) {
        char name[2 * ITN_NAME_SIZE];
        snprintf(name, sizeof name, "%.*s.%s", length, h->unknowns[0]->name, fields[k]);
        for (i = 0; i < h->count && strcmp(h->unknowns[i]->name, name) != 0;) i++;
        if (i == h->count)
            fail(path, "gives sigma_t, albedo and g of one medium: recover just these");
        values[i] = (float)itn_parameter_from_coordinate(h->unknowns[i], (double)answer[k]);
        printf("  %s %.5g", name, (double)values[i]);
    }
    printf("\n");
}

/* Opens known.net, from beside the scene or where it is shipped; NULL if it is in neither. */
static itn_net *find_network(const char *scene, const itn_context *context) {
    const char *slash = strrchr(scene, '/'), *folders[3] = {scene, "scenes/", "../scenes/"};
    int k, lengths[3] = {0, 7, 10};
    char path[STEM_SIZE + 16];
    itn_net *net = NULL;
    itn_error error;
    if (slash && slash - scene < STEM_SIZE) lengths[0] = (int)(slash + 1 - scene);
    for (k = 0; k < 3 && !net; k++) {
        snprintf(path, sizeof path, "%.*sknown.net", lengths[k], folders[k]);
        if (itn_net_open(path, 1, context, &net, &error) != ITN_ERROR_FILE) break;
    }
    return net;
}

/* Takes what a network reads off the picture, by what is known of the scene, for values of sigma_t,
   albedo and g, and prints it; or says why it does not. */
static void start_from_known(itn_net *net, const history *h, const picture *p, uint64_t seed,
                             float *values) {
    static const char *const fields[3] = {"sigma_t", "albedo", "g"};
    const char *why = net ? NULL : "there is no known.net, or it is damaged";
    int i, k, at[3] = {-1, -1, -1}, scale_known = 1;
    itn_estimate read[3];
    itn_probes *probes = NULL;
    itn_error error;
    for (i = 0; i < h->count; i++) {
        const char *name = h->unknowns[i]->name;
        for (k = 0; k < 3; k++)
            if (p->parameters[i] >= 0 && !strcmp(strchr(name, '.') + 1, fields[k])) at[k] = i;
        if (!strncmp(name, "film.e", 6) || strstr(name, "scale")) scale_known = 0;
    }
    if (!why && (at[0] < 0 || at[1] < 0 || at[2] < 0))
        why = "not all of sigma_t, albedo and g are sought";
    if (!why && (itn_probes_make(p->scene, p->theta, seed, &probes, &error) ||
                 itn_probes_read(probes, net, p->light, p->variance, scale_known, read, &error)))
        why = error.message;
    if (why) printf("nothing is read off the picture: %s\n", why);
    else printf("read");
    for (k = 0; k < 3 && !why; k++) {
        values[at[k]] = (float)read[k].value;
        printf("  %s %.3g +- %.2g", h->unknowns[at[k]]->name, read[k].value,
               read[k].standard_error);
    }
    if (!why) printf("\n");
    itn_probes_free(probes);
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

/* Adds parameters of the film, all that begin with a name, to the unknowns. Returns whether there
   are any. */
static int add_unknowns(const picture *pictures, int views, const char *name, history *h) {
    int v, i, k, found = 0;
    for (v = 0; v < views; v++)
        for (i = 0; i < itn_parameter_count(pictures[v].scene); i++) {
            const itn_parameter *p = itn_parameter_get(pictures[v].scene, i);
            if (strncmp(p->name, name, strlen(name))) continue;
            for (k = 0; k < h->count && strcmp(h->unknowns[k]->name, p->name);) k++;
            if (k == MOST_PARAMETERS) fail("more than 16 parameters", p->name);
            found = 1, h->unknowns[k] = p, h->count += k == h->count;
        }
    return found;
}

/* Whether exposure is unknown: asked for or, of a PNG, when no scale of light is asked for. */
static int seeks_exposure(const picture *pictures, int views, const history *h, const char *asked) {
    int v, k, seek = 0;
    for (v = 0; v < views; v++) seek |= pictures[v].own_units;
    for (k = 0; k < h->count; k++)
        seek &= strncmp(h->unknowns[k]->name, "film.e", 6) &&
                !strstr(h->unknowns[k]->name, "scale");
    return asked ? !strcmp(asked, "unknown") : seek;
}

/* Starts exposures where a render at the other starting values is as bright as the target, in the
   channel that they are of; theta holds them. */
static void start_exposures(const picture *p, itn_render_options render, const history *h,
                            float *values) {
    itn_film_desc film = itn_scene_film(p->scene);
    int plane = film.width * film.height, k, i, channel;
    itn_image image;
    itn_error error;
    render.spp = 16;
    if (itn_render(p->scene, p->theta, &render, NULL, 0, &image, &error)) fail(error.message, "");
    for (k = 0; k < h->count; k++) {
        const char *name = h->unknowns[k]->name;
        double target = 0, rendered = 0;
        if (strncmp(name, "film.exposure", 13) || p->parameters[k] < 0) continue;
        channel = name[13] ? (int)(strchr("rgb", name[14]) - "rgb") : -1;
        for (i = 0; i < film.channels * plane; i++) {
            if (channel >= 0 && i / plane != channel) continue;
            if (p->variance && !(p->variance[i] < INFINITY)) continue;
            target += (double)p->light[i], rendered += (double)image.pixels[i];
        }
        if (target > 0 && rendered > 0) values[k] *= (float)(target / rendered);
    }
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
    int i, end;
    b.left = GAP + 54 + place % 4 * (COLUMN + GAP), b.top = top + place / 4 * (CHART + 70);
    if (h->rows > 1) x.to = h->rows - 1;
    y.logarithmic = is_misfit;
    for (i = 0; i < h->rows; i++) {
        steps[i] = i;
        y.from = fmin(y.from, values[i]), y.to = fmax(y.to, values[i]);
    }
    if (is_misfit) {
        y.from = fmin(y.from, 1) / 1.6;
        y.to = fmax(y.to * 1.6, 4 * y.from);
    } else {
        double range = y.to - y.from, most = .5 * (fabs(y.to) + range);
        double room = fmax(.15 * range, fmin(3 * errors[h->rows - 1], most));
        if (!(room > 0)) room = fmax(.1 * fabs(y.to), 1e-6);
        y.from -= room, y.to += room;
    }
    sheet_axes(page, b, x, y, title, "step");
    if (is_misfit) {
        double floor = sheet_height(b, y, 1);
        sheet_line(page, b.left, floor, b.left + b.width, floor, 1.5, SHEET_GREY);
        sheet_text(page, b.left + b.width, floor + 11, 1, 7, SHEET_GREY, "noise");
    }
    for (i = 0; i < h->rows; i = end) { /* one for each size of pictures, reduced: grey */
        for (end = i; end < h->rows && h->blocks[end] == h->blocks[i];) end++;
        sheet_curve(page, b, x, y, end - i, steps + i, values + i, errors + i,
                    end < h->rows ? SHEET_GREY : SHEET_COLOURS[colour % 6]);
        if (is_misfit && end < h->rows && end > 1)
            sheet_text(page, b.left + b.width * sheet_place(x, end - 1), b.top + 10, 1, 8,
                       SHEET_GREY, "reduced");
    }
}

/* One page that tells the story: target, estimate, difference, derivatives and, of the first
   picture, what was found and how the search went. */
static void save_sheet(const picture *p, const itn_image *image, int count, const history *h,
                       const itn_estimate *estimates, const itn_refine_outcome *outcome) {
    int channels = itn_scene_film(p->scene).channels, k, n = image->width * image->height;
    int height = (COLUMN * image->height + image->width / 2) / image->width;
    int rows = (count + 3) / 4, row = height + 66, charts = TOP + (1 + rows) * row + 20;
    size_t plane = (size_t)n, pixels = plane * (size_t)channels, i;
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
    if (h) {
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
        for (i = 0; i < pixels; i++) /* what does not count is no number, which is grey */
            difference[i] = p->variance && !(p->variance[i] < INFINITY) ? NAN : p->light[i];
        if (k < 2)
            sheet_picture(&page, b, k ? image->pixels : difference, channels, image->width,
                          image->height, 1, full);
    }
    for (i = 0; i < pixels; i++) difference[i] = image->pixels[i] - p->light[i];
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
                      "misfit over noise", 1, 5);
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
    itn_render_stats stats;
    itn_image image;
    itn_error error;
    for (k = 0; k < unknowns; k++)
        if (p->parameters[k] >= 0) parameters[count++] = p->parameters[k];
    options.spp *= 2, options.stats = &stats;
    if (itn_render(p->scene, p->theta, &options, parameters, count, &image, &error))
        fail(error.message, "");
    if (stats.blur != 0)
        printf("note: sharp light behind smooth glass is blurred where it is reflected before it "
               "scatters; the picture's mean may be off by %.2g, which the errors do not "
               "know\n", fabs(stats.blur));
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

/* Prints what the estimates say in the words of tissue optics. */
static void print_tissue(const picture *p, const history *h, const double *covariance) {
    static const char *const words[] = {"", "_r", "_g", "_b"};
    char medium[ITN_NAME_SIZE];
    int channels = itn_scene_film(p->scene).channels, i = 0, c;
    itn_tissue t;
    while (tool_next_medium(p->scene, &i, medium))
        for (c = 0; c < channels; c++)
            if (itn_scene_tissue(p->scene, p->theta, medium, c, p->parameters, h->count, covariance,
                                 &t) && t.mu_a_error + t.mu_s_error + t.mu_s_prime_error > 0)
                printf("%s%s mu_a %.4g +- %.2g, mu_s %.4g +- %.2g, mu_s' %.4g +- %.2g per unit of "
                       "length\n", medium, words[channels == 3 ? c + 1 : 0], t.mu_a, t.mu_a_error,
                       t.mu_s, t.mu_s_error, t.mu_s_prime, t.mu_s_prime_error);
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

/* Reads "X,Y,W,H". */
static void read_crop(const char *text, itn_photo_desc *desc) {
    char rest;
    if (sscanf(text, "%d,%d,%d,%d%c", &desc->crop_x, &desc->crop_y, &desc->crop_width,
               &desc->crop_height, &rest) != 4 || desc->crop_width < 1 || desc->crop_height < 1)
        fail("--crop", "needs X,Y,W,H: the upper left pixel, width and height");
}

static float gamma_of(const char *text) {
    if (!strcmp(text, "srgb")) return -1;
    if (!strcmp(text, "linear")) return 1;
    return (float)tool_number("--gamma", text, .05, 20);
}

int main(int argc, char **argv) {
    const char *hidden_list = NULL, *names = NULL, *dir = NULL, *network = NULL, *value;
    const char *exposure = NULL, *background = "known";
    int views = 0, targets = 0, masks = 0, unknown, by_picture, i, k, v, missed;
    itn_net *net = NULL;
    itn_context context = ITN_ZERO;
    itn_refine_options refine = ITN_ZERO;
    itn_render_options render = ITN_ZERO;
    itn_photo_desc desc = ITN_ZERO;
    itn_estimate estimates[MOST_PARAMETERS];
    float values[MOST_PARAMETERS], hidden[MOST_PARAMETERS];
    double covariance[MOST_PARAMETERS * MOST_PARAMETERS];
    itn_view look[MOST_VIEWS];
    itn_error error;
    static picture pictures[MOST_VIEWS];
    static history h;
    char words[4096];
    itn_refine_outcome outcome;
    refine.spp = 48, refine.outcome = &outcome, refine.covariance = covariance;
    for (i = 1; i < argc;) {
        k = tool_next(usage, choices, argc, argv, &i, &value);
        if ((k == -1 && views == MOST_VIEWS) || (k == TARGET && targets == MOST_VIEWS) ||
            (k == MASK && masks == MOST_VIEWS))
            fail(value, "too many scenes, targets or masks");
        switch (k) {
        case -1: pictures[views++].path = value; break;
        case TARGET: pictures[targets++].target = value; break;
        case MASK: pictures[masks++].mask = value; break;
        case CROP: read_crop(value, &desc); break;
        case GAMMA: desc.gamma = gamma_of(value); break;
        case READ_NOISE: desc.read_noise = (float)tool_number("--read-noise", value, 0, 1e9); break;
        case GAIN: desc.gain = (float)tool_number("--gain", value, 0, 1e9); break;
        case SATURATION: desc.saturation = (float)tool_number("--saturation", value, 0, 9e9); break;
        case EXPOSURE: tool_choice("--exposure", "known|unknown", exposure = value); break;
        case BACKGROUND: tool_choice("--background", "known|unknown", background = value); break;
        case PARAMS: names = value; break;
        case HIDDEN: hidden_list = value; break;
        case NET: network = value; break;
        case ITERATIONS: refine.iterations = tool_whole("--iterations", value, 0); break;
        case SECONDS: refine.seconds = tool_number("--seconds", value, 0, 1e9); break;
        case SPP: refine.spp = tool_whole("--spp", value, 2); break;
        case FINAL_SPP: refine.final_spp = tool_whole("--final-spp", value, 0); break;
        case SEED: refine.seed = (uint64_t)tool_whole("--seed", value, 0); break;
        case THREADS: context.threads = tool_whole("-t", value, 0); break;
        default: dir = value;
        }
    }
    if (!views) return fprintf(stderr, "usage: %sinvert --help lists the options.\n", usage), 1;
    if (masks && masks != targets) fail("--mask", "needed for each of the targets, or for none");
    if (targets && hidden_list) fail("--hidden", "has no meaning with --target");
    if (targets && targets != views) fail("--target", "needed for each of the scenes, or for none");
    if (refine.spp < 2 || refine.spp > 524287) fail("--spp", "must be in 2..524287");
    if (dir && mkdir(dir, 0777) && errno != EEXIST) fail(dir, "this folder cannot be made");
    make_stems(pictures, views, dir);
    for (v = 0; v < views; v++) open_scene(&pictures[v], &context);

    /* what is hidden, and what is sought */
    if (hidden_list) {
        h.count = read_list(pictures, views, hidden_list, h.unknowns, hidden);
        set_values(pictures, views, &h, hidden);
    } else if (!names) {
        h.count = medium_parameters(pictures[0].scene, h.unknowns);
    }
    if (names) h.count = read_list(pictures, views, names, h.unknowns, NULL);
    if (!h.count) fail("nothing to recover: name parameters with --params", "");

    /* the targets: from files, or rendered with the hidden values and other random numbers */
    render.spp = 8 * refine.spp;
    for (v = 0; v < views; v++) {
        render.seed = refine.seed + 1000003 + (uint64_t)v;
        make_target(&pictures[v], desc, &context, &render);
        look[v].scene = pictures[v].scene, look[v].theta = pictures[v].theta;
        look[v].target = pictures[v].light, look[v].target_variance = pictures[v].variance;
        look[v].parameters = pictures[v].parameters;
    }
    unknown = seeks_exposure(pictures, views, &h, exposure);
    if (unknown) add_unknowns(pictures, views, "film.exposure", &h);
    if (targets)
        printf("%s\n", unknown ? "film.exposure is sought: targets have units of their own, but "
                                 "with --exposure known" :
                                 "targets are in units of the lights, but for scales sought");
    if (!strcmp(background, "unknown") && !add_unknowns(pictures, views, "film.background", &h))
        fail("--background", "the scene has none: add 'background .1' to its line 'film'");

    /* where the search starts */
    for (i = 0; i < h.count; i++) {
        const itn_parameter *p = h.unknowns[i];
        for (v = 0; (k = itn_parameter_find(pictures[v].scene, p->name)) < 0;) v++;
        hidden[i] = pictures[v].theta[k];
        values[i] = targets || hidden_list ? p->value : neutral_guess(pictures[v].scene, p);
    }
    set_values(pictures, views, &h, values);
    tool_show_thickness(pictures[0].scene, stdout);
    if (!network) net = find_network(pictures[0].path, &context);
    else if (strcmp(network, "none") && itn_net_open(network, 1, &context, &net, &error))
        fail(error.message, "");
    by_picture = net && itn_net_shape(net).width > 2;
    if (!by_picture && (!network || net))
        start_from_known(net, &h, &pictures[0], refine.seed + 3000017, values);
    set_values(pictures, views, &h, values);
    if (unknown) start_exposures(&pictures[0], render, &h, values);
    if (by_picture) start_from_network(net, network, &h, &pictures[0], values);
    itn_net_free(net);
    refine.progress = show_step, refine.progress_user = &h;
    signal(SIGINT, interrupt);
    if (itn_refine_views(look, views, values, h.count, &refine, estimates, &error))
        fail(error.message, "");
    signal(SIGINT, SIG_DFL);
    printf("misfit %.3g +- %.2g: the scene %s the picture\n", outcome.misfit, outcome.misfit_error,
           outcome.explained ? "explains" : "does not explain");
    missed = print_estimates(&h, estimates, targets ? NULL : hidden, &outcome);
    set_values(pictures, views, &h, values);
    print_tissue(&pictures[0], &h, covariance);
    if (itn_refine_words(h.unknowns, h.count, estimates, covariance, &outcome, words,
                         sizeof words) >= 0)
        printf("%s", words);

    render.spp = refine.spp, render.seed = refine.seed + 2000003; /* not the targets' numbers */
    for (v = 0; v < views; v++) {
        const char *stem = pictures[v].stem;
        save_pictures(&pictures[v], render, h.count, v ? NULL : &h, estimates, &outcome);
        printf("pictures: %s_sheet.png, %s_estimate.exr\n", stem, stem);
        itn_scene_free(pictures[v].scene);
        itn_image_free(&pictures[v].photo);
        free(pictures[v].theta);
    }
    return missed || !outcome.explained;
}
