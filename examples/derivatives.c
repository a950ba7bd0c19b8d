/* Derivative images: how every pixel answers to every parameter.

   You learn: asking itn_render for derivatives by name, finding the planes of each, their standard
   errors, the red and blue pictures, and how to check a derivative against differences.

   Compile: cc -O3 -march=native derivatives.c -o derivatives -lm -lpthread
   Run:     ./derivatives ../scenes/studio.itn studio
   Prints a line per parameter, the derivative of the image's mean (of all channels) and the same by
   differences,
            milk.sigma_t    -0.000265 +- 5e-06   by differences -0.00027 +- 3.2e-06
   writes studio.png and studio_d_milk_sigma_t.png and so on (red: brighter, blue: darker), and
   fails if the two disagree by more than four standard errors and 2 %. */
#define ITN_THREADS
#define ITN_IMPLEMENTATION
#include "../itn.h"

static int fail(const char *why) {
    fprintf(stderr, "derivatives: %s\n", why);
    return 1;
}

/* Mean of the planes of all channels, the first of which is `plane`, and its standard error, from
   the planes of variances behind them. A pixel's channels are of the same paths: their errors add
   up. */
static void planes_mean(const itn_image *image, int plane, int channels, double *mean,
                        double *error) {
    size_t i, pixels = (size_t)image->width * (size_t)image->height;
    const float *value = image->pixels + (size_t)plane * pixels;
    const float *variance = value + (size_t)channels * pixels;
    int c;
    for (*mean = *error = 0, i = 0; i < pixels; i++) {
        double deviation = 0;
        for (c = 0; c < channels; c++) {
            size_t at = (size_t)c * pixels + i;
            *mean += value[at], deviation += sqrt(variance[at]);
        }
        *error += deviation * deviation;
    }
    *mean /= (double)pixels * channels, *error = sqrt(*error) / ((double)pixels * channels);
}

/* (mean at value + h - mean at value - h) / 2h with common random numbers, which make the error
   smaller than stated; h is a tenth of the way to zero or a bound. */
static int difference(const itn_scene *scene, float *theta, int index, itn_render_options options,
                      double *slope, double *error) {
    const itn_parameter *p = itn_parameter_get(scene, index);
    float value = theta[index];
    float h = .1f * fminf(fabsf(value), fminf(value - p->lower, p->upper - value));
    double mean[2] = {0, 0}, spread[2] = {0, 0};
    int side, failed = !(h > 0);
    for (side = 0; side < 2 && !failed; side++) {
        itn_image image;
        theta[index] = side ? value + h : value - h;
        failed = itn_render(scene, theta, &options, NULL, 0, &image, NULL) != ITN_OK;
        if (failed) continue;
        planes_mean(&image, 0, itn_scene_film(scene).channels, &mean[side], &spread[side]);
        itn_image_free(&image);
    }
    theta[index] = value;
    if (failed) return 0;
    *slope = (mean[1] - mean[0]) / (2 * (double)h);
    *error = hypot(spread[0], spread[1]) / (2 * (double)h);
    return 1;
}

int main(int argc, char **argv) {
    enum { MOST = 32 };
    const char *path = argc > 1 ? argv[1] : "../scenes/studio.itn";
    const char *stem = argc > 2 ? argv[2] : NULL;
    itn_render_options options = ITN_ZERO;
    int parameters[MOST] = {0}, count = 0, i, k, channels, bad = 0;
    itn_scene *scene;
    itn_image image;
    itn_error error;
    float *theta;
    char name[512];
    options.spp = 64;
    if (itn_scene_load(path, NULL, &scene, &error)) return fail(error.message);
    theta = (float *)malloc(((size_t)itn_parameter_count(scene) + 1) * sizeof *theta);
    if (!theta) return fail("out of memory");
    itn_parameter_values(scene, theta);
    channels = itn_scene_film(scene).channels;

    /* the index of a smooth surface cannot be differentiated: the library says so, it is left out */
    for (i = 0; i < itn_parameter_count(scene) && count < MOST; i++) {
        itn_render_options probe = ITN_ZERO;
        probe.spp = 1;
        if (itn_render(scene, theta, &probe, &i, 1, &image, &error)) {
            printf("%s\n", error.message);
            continue;
        }
        itn_image_free(&image);
        parameters[count++] = i;
    }
    if (itn_render(scene, theta, &options, parameters, count, &image, &error))
        return fail(error.message);

    /* planes: C of the image, C of its variance, then the same for each derivative */
    for (k = 0; k < count; k++) {
        const itn_parameter *p = itn_parameter_get(scene, parameters[k]);
        double slope, slope_error, other = 0, other_error = 0;
        planes_mean(&image, 2 * (k + 1) * channels, channels, &slope, &slope_error);
        printf("%-22s %10.5g +- %-8.2g", p ? p->name : "", slope, slope_error);
        if (difference(scene, theta, parameters[k], options, &other, &other_error)) {
            printf(" by differences %10.5g +- %-8.2g", other, other_error);
            bad += !(fabs(slope - other) <=
                     4 * hypot(slope_error, other_error) + .02 * fabs(slope));
        }
        printf("\n");
    }
    for (k = -1; k < count && stem; k++) {
        int plane = 2 * (k + 1) * channels;
        snprintf(name, sizeof name, "%s%s%.*s.png", stem, k < 0 ? "" : "_",
                 k < 0 ? 0 : (int)strcspn(image.names[plane], "."), image.names[plane]);
        if (itn_image_save_png(&image, plane, channels, k < 0 ? ITN_PNG_TONE : ITN_PNG_SIGNED, 0,
                               name, &error))
            return fail(error.message);
    }
    itn_image_free(&image);
    itn_scene_free(scene);
    free(theta);
    return bad ? fail("derivatives and differences disagree") : 0;
}
