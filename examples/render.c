/* Renders a scene, and its derivative images, from the command line.

   You learn: how to load a scene, change its parameters, render it with derivatives in one walk, and
   write the result for other programs (EXR layers), for simple ones (PFM) and for the eye (PNG).

   Compile: cc -O3 -march=native render.c -o render -lm -lpthread
   Run:     ./render ../scenes/studio.itn -o studio.exr --spp 64 --derivatives all
   Prints:  render 1.234 s, build 0.045 s, 5.678 Mpaths/s, 90.1 Mcollisions/s, mean 0.712 +- 0.001
   EXR (all of it) and PFM (the light) are read back and compared; the exit status tells. */
#define _POSIX_C_SOURCE 200809L
#define _DARWIN_C_SOURCE /* else macOS hides sysconf's number of processors */
#define ITN_THREADS
#define ITN_IMPLEMENTATION
#include "../itn.h"
#define PROGRAM "render"
#include "tool.h"

#include <sys/stat.h>
#include <time.h>
#include <unistd.h>

static const char usage[] = "render SCENE -o FILE [options]\n";
enum { SAVE, SPP, SEED, THREADS, CHANGE, DERIVATIVES, MAX_SCATTER, MODE, SAMPLER, WALKS, ESTIMATOR,
       QUIET };
static const tool_option choices[] = {
    {"-o", "FILE", "EXR: all planes; PFM, PNG: a file for the light and for each derivative"},
    {"--spp", "N", "samples per pixel; default 64"},
    {"--seed", "N", "of random numbers; default 0"},
    {"-t", "THREADS", "default: all processors"},
    {"-D", "name=value", "changes a parameter; any number of times"},
    {"--derivatives", "name,...|all", "derivative images in the same walk"},
    {"--max-scatter", "N", "longest paths; default: any number of scatterings"},
    {"--mode", "auto|reference|fast", "the estimator; default auto"},
    {"--sampler", "sobol|random", "of the fast walk; default sobol"},
    {"--walks", "N", "walks behind one first flight, of the fast walk; default by itself"},
    {"--estimator", "baseline|score", "of derivatives; default baseline"},
    {"-q", NULL, "does not tell how far it is"},
    {NULL, NULL, NULL}};

static double seconds(void) {
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return (double)now.tv_sec + 1e-9 * (double)now.tv_nsec;
}

static int show_progress(void *user, double fraction) {
    (void)user;
    fprintf(stderr, "\r%3.0f %%%s", 100 * fraction, fraction < 1 ? "" : "\n");
    return 0;
}

/* Applies "name=value" to theta. */
static void set_parameter(const itn_scene *scene, float *theta, const char *text) {
    char name[ITN_NAME_SIZE] = "", *end = NULL;
    const char *equals = strchr(text, '=');
    int index = -1;
    if (!equals) fail("-D wants name=value", text);
    if (equals - text < ITN_NAME_SIZE) {
        memcpy(name, text, (size_t)(equals - text));
        index = itn_parameter_find(scene, name);
    }
    if (index < 0) tool_fail_parameter(scene, name);
    theta[index] = strtof(equals + 1, &end);
    if (end == equals + 1 || *end) fail("-D: not a number", text);
}

/* Turns "name,name,..." or "all" into indices; all means all that the scene can answer. */
static int find_parameters(const itn_scene *scene, const float *theta, itn_mode mode,
                           const char *text, int *parameters) {
    int count = 0, index;
    itn_render_options probe = ITN_ZERO;
    itn_image image;
    itn_error error;
    probe.spp = 1, probe.max_scatter = 1, probe.mode = mode;
    if (strcmp(text, "all") == 0) {
        for (index = 0; index < itn_parameter_count(scene); index++) {
            itn_result result = itn_render(scene, theta, &probe, &index, 1, &image, &error);
            if (result == ITN_ERROR_UNSUPPORTED) continue;
            if (result) fail(error.message, "");
            itn_image_free(&image);
            parameters[count++] = index;
        }
        return count;
    }
    while (*text) {
        char name[ITN_NAME_SIZE] = "";
        size_t length = strcspn(text, ",");
        if (length < sizeof name) memcpy(name, text, length);
        index = itn_parameter_find(scene, name);
        if (index < 0) tool_fail_parameter(scene, name);
        if (count == itn_parameter_count(scene)) fail("--derivatives", "some are there twice");
        parameters[count++] = index;
        text += length + (text[length] == ',');
    }
    return count;
}

/* Fails where nothing can be saved at a path, before any work is done. */
static void check_path(const char *path) {
    const char *ending = strrchr(path, '.'), *slash = strrchr(path, '/');
    char folder[1024];
    struct stat there;
    if (!ending || (strcmp(ending, ".exr") && strcmp(ending, ".pfm") && strcmp(ending, ".png")))
        fail(path, "must end in .exr, .pfm or .png");
    if (strlen(path) > 800) fail(path, "this path is too long");
    snprintf(folder, sizeof folder, "%.*s", slash ? (int)(slash - path) + 1 : 1,
             slash ? path : ".");
    if (access(folder, W_OK)) fail(path, "its folder is not there or must not be written to");
    if (!stat(path, &there) && S_ISDIR(there.st_mode)) fail(path, "is a folder");
}

/* Writes `image` in the format that the path's ending names: EXR holds all planes, PFM and PNG
   have one file for the image and one for each derivative. */
static itn_result save(const itn_image *image, int channels, const char *path, itn_error *error) {
    const char *ending = strrchr(path, '.');
    char name[1024];
    int first, pfm = !strcmp(ending, ".pfm");
    itn_result result = ITN_OK;
    if (!strcmp(ending, ".exr")) return itn_image_save_exr(image, path, error);
    for (first = 0; first < image->plane_count && !result; first += 2 * channels) {
        int layer = (int)strcspn(image->names[first], "."); /* "d_milk_g" of "d_milk_g.Y" */
        snprintf(name, sizeof name, "%.*s%s%.*s%s", (int)(ending - path), path, first ? "." : "",
                 first ? layer : 0, image->names[first], ending);
        result = pfm ? itn_image_save_pfm(image, first, channels, name, error)
                     : itn_image_save_png(image, first, channels,
                                          first ? ITN_PNG_SIGNED : ITN_PNG_TONE, 0, name, error);
    }
    return result;
}

/* Whether the file at `path` holds exactly what `image` does: an EXR all planes, a PFM the light. */
static int reads_back(const itn_image *image, int channels, const char *path) {
    itn_image loaded;
    size_t bytes = (size_t)image->width * (size_t)image->height * sizeof(float);
    int k, same = 1;
    if (!strcmp(strrchr(path, '.'), ".png")) return 1;
    if (itn_image_load(path, NULL, &loaded, NULL)) return 0;
    if (!strcmp(strrchr(path, '.'), ".exr")) channels = image->plane_count;
    for (k = 0; k < channels; k++) {
        const float *plane = itn_image_plane(&loaded, image->names[k]);
        same = same && plane && !memcmp(plane, itn_image_plane(image, image->names[k]), bytes);
    }
    itn_image_free(&loaded);
    return same;
}

static void report(const itn_image *image, int channels, const itn_render_stats *stats,
                   double render, double build) {
    size_t i, plane = (size_t)image->width * (size_t)image->height;
    size_t pixels = plane * (size_t)channels;
    double mean = 0, variance = 0;
    for (i = 0; i < pixels; i++) mean += image->pixels[i];
    for (i = 0; i < plane; i++) { /* the colours of a pixel are of the same paths */
        double error = 0;
        int c;
        for (c = 0; c < channels; c++)
            error += sqrt(image->pixels[pixels + (size_t)c * plane + i]);
        variance += error * error;
    }
    variance += pow(stats->blur * (double)pixels, 2);
    if (fabs(stats->blur) > .1 * sqrt(variance) / (double)pixels)
        fprintf(stderr, "note: sharp light behind smooth glass is blurred where it is reflected "
                        "before it scatters; blurred twice as far it would change the mean by "
                        "%.6f, which is in the error\n", stats->blur);
    printf("render %.3f s, build %.3f s, %.3f Mpaths/s, %.1f Mcollisions/s, mean %.6f +- %.6f\n",
           render, build, 1e-6 * stats->paths / render, 1e-6 * stats->collisions / render,
           mean / (double)pixels, sqrt(variance) / (double)pixels);
}

int main(int argc, char **argv) {
    const char *path = NULL, *out = NULL, *derivatives = "", *changes[256], *value;
    int i, change_count = 0, quiet = 0, count, *parameters, channels;
    itn_context context = ITN_ZERO;
    itn_render_options options = ITN_ZERO;
    itn_render_stats stats;
    itn_scene *scene;
    itn_image image;
    itn_error error;
    double start, build;
    float *theta;
    for (i = 1; i < argc;) {
        switch (tool_next(usage, choices, argc, argv, &i, &value)) {
        case -1:
            if (path) fail(value, "is a second scene");
            path = value;
            break;
        case SAVE: out = value; break;
        case SPP: options.spp = tool_whole("--spp", value, 1); break;
        case SEED: options.seed = (uint64_t)tool_whole("--seed", value, 0); break;
        case THREADS: context.threads = tool_whole("-t", value, 1); break;
        case CHANGE:
            if (change_count == 256) fail("-D", "is there more than 256 times");
            changes[change_count++] = value;
            break;
        case DERIVATIVES: derivatives = value; break;
        case MAX_SCATTER: options.max_scatter = tool_whole("--max-scatter", value, 1); break;
        case MODE:
            options.mode = (itn_mode)tool_choice("--mode", "auto|reference|fast", value);
            break;
        case SAMPLER:
            options.sampler = (itn_sampler)tool_choice("--sampler", "sobol|random", value);
            break;
        case WALKS: options.walks = tool_whole("--walks", value, 1); break;
        case ESTIMATOR:
            options.estimator =
                (itn_estimator)tool_choice("--estimator", "baseline|score", value);
            break;
        default: quiet = 1;
        }
    }
    if (!path || !out) return fprintf(stderr, "usage: %srender --help lists them.\n", usage), 1;
    check_path(out);

    start = seconds();
    if (itn_scene_load(path, &context, &scene, &error)) fail(error.message, "");
    build = seconds() - start;
    theta = (float *)calloc((size_t)itn_parameter_count(scene) + 1, sizeof *theta);
    parameters = (int *)calloc((size_t)itn_parameter_count(scene) + 1, sizeof *parameters);
    if (!theta || !parameters) fail("out of memory", "");
    itn_parameter_values(scene, theta);
    for (i = 0; i < change_count; i++) set_parameter(scene, theta, changes[i]);
    count = find_parameters(scene, theta, options.mode, derivatives, parameters);
    start = seconds();
    if (!count && itn_scene_prepare(scene, theta, &options, &error)) fail(error.message, "");
    build += seconds() - start;
    channels = itn_scene_film(scene).channels;

    options.stats = &stats;
    if (!quiet) options.progress = show_progress, tool_show_thickness(scene, stderr);
    start = seconds();
    if (itn_render(scene, theta, &options, parameters, count, &image, &error))
        fail(error.message, "");
    report(&image, channels, &stats, seconds() - start, build);
    if (save(&image, channels, out, &error)) fail(error.message, "");
    if (!reads_back(&image, channels, out)) fail(out, "does not read back as written");
    itn_image_free(&image);
    itn_scene_free(scene);
    free(parameters);
    free(theta);
    return 0;
}
