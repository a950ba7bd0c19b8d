/* 8. Gauss-Newton on one pixel.

   Now backwards: from a picture to the material. The picture is one pixel of light through a
   slab of milk, of which all is known but the albedo. Render it at a guess, with the derivative;
   the picture differs by r, a step of d changes it by J d, so take d = r / J. Near the answer
   each step leaves a square of the error that was. Far from it a step may lead anywhere: it is
   taken in a coordinate without bounds (the library's: ln x, or ln(x / (1 - x)) between 0 and
   1), and not longer than 1. Noise stays: the error bar is the noise of r over J.

   Look at: how few steps it takes, and the bar that is left.
   Check:   the answer is within four of its errors of the albedo that made the picture.
   Exercise: sigma_t is unknown as well. One number cannot tell two; take a second pixel, of a
   slab twenty times as thick, and solve the two equations J d = r. (Solution: compile with
   -DSOLUTION.)

   Compile: cc -O2 -march=native 08_gauss_newton.c -o 08_gauss_newton -lm -lpthread */
#define ITN_IMPLEMENTATION
#include "course.h"

enum { STEPS = 8 };
#ifdef SOLUTION
enum { N = 2 };
#else
enum { N = 1 };
#endif
static const char *const names[2] = {"milk.albedo", "milk.sigma_t"};
static const double truth[2] = {.9, 2}, guess[2] = {.6, 1};

static itn_scene *slab(double thickness) {
    char text[400];
    itn_file box = {"box.obj", BOX, sizeof BOX - 1};
    itn_scene *scene;
    itn_error error;
    int size = snprintf(text, sizeof text,
                "film width 1 height 1\ncamera eye 0 0 40 target 0 0 0 fov .01\n"
                "medium milk sigma_t %g albedo %g g .7\n"
                "object mesh box.obj medium milk translate 0 -.5 0 scale 198 198 %g\n"
                "light constant radiance 1\n", truth[1], truth[0], thickness);
    need(itn_scene_from_memory(text, (size_t)size, NULL, &box, 1, NULL, &scene, &error), &error);
    return scene;
}

static const itn_parameter *sought(const itn_scene *scene, int k) {
    return itn_parameter_get(scene, itn_parameter_find(scene, names[k]));
}

/* The pixel at x: its value, variance, and the derivatives by the coordinates of what is sought. */
static void look(const itn_scene *scene, const double *x, uint64_t seed, double *value,
                 double *variance, double *slope) {
    itn_render_options options = ITN_ZERO;
    itn_image image;
    itn_error error;
    int asked[2];
    float theta[8];
    itn_parameter_values(scene, theta);
    for (int k = 0; k < N; k++) {
        asked[k] = itn_parameter_find(scene, names[k]);
        theta[asked[k]] = (float)x[k];
    }
    options.spp = 40000, options.seed = seed;
    need(itn_render(scene, theta, &options, asked, N, &image, &error), &error);
    *value = image.pixels[0], *variance = image.pixels[1];
    for (int k = 0; k < N; k++)
        slope[k] = image.pixels[2 + 2 * k] * itn_parameter_slope(sought(scene, k), x[k]);
    itn_image_free(&image);
}

int main(void) {
    itn_scene *scenes[2] = {slab(1), slab(20)};
    double picture[2], noise[2], x[2] = {guess[0], guess[1]}, bar[2] = {0, 0}, none[2];
    double at[STEPS], track[2][STEPS], bars[2][STEPS];
    for (int i = 0; i < N; i++) look(scenes[i], truth, 1, picture + i, noise + i, none);
    for (int step = 0; step < STEPS; step++) {
        double value, variance, j[2][2] = {{1, 0}, {0, 1}}; /* of one pixel its second row stays */
        double r[2] = {0, 0}, v[2] = {0, 0}, d[2];
        for (int i = 0; i < N; i++) {
            look(scenes[i], x, 2 + (uint64_t)step, &value, &variance, j[i]);
            r[i] = picture[i] - value, v[i] = variance + noise[i];
        }
        double determinant = j[0][0] * j[1][1] - j[0][1] * j[1][0];
        d[0] = (j[1][1] * r[0] - j[0][1] * r[1]) / determinant;
        d[1] = (j[0][0] * r[1] - j[1][0] * r[0]) / determinant;
        bar[0] = sqrt(pow(j[1][1], 2) * v[0] + pow(j[0][1], 2) * v[1]) / fabs(determinant);
        bar[1] = sqrt(pow(j[0][0], 2) * v[1] + pow(j[1][0], 2) * v[0]) / fabs(determinant);
        for (int k = 0; k < N; k++) {
            const itn_parameter *p = sought(scenes[0], k);
            double coordinate = itn_parameter_to_coordinate(p, x[k]);
            x[k] = itn_parameter_from_coordinate(p, coordinate + fmax(-1, fmin(d[k], 1)));
            bar[k] *= itn_parameter_slope(p, x[k]);
            track[k][step] = x[k], bars[k][step] = bar[k];
        }
        at[step] = step + 1;
    }
    itn_image page = new_page(N);
    for (int k = 0; k < N; k++) {
        sheet_axis steps = {0, STEPS, 0}, values = {.4 * truth[k], 1.3 * truth[k], 0};
        sheet_box b = panel(k);
        double y = sheet_height(b, values, truth[k]);
        sheet_axes(&page, b, steps, values, names[k], "step (grey: the truth)");
        sheet_line(&page, b.left, y, b.left + b.width, y, 1.5, SHEET_GREY);
        sheet_curve(&page, b, steps, values, STEPS, at, track[k], bars[k], SHEET_COLOURS[k]);
        check(names[k], x[k], truth[k], 4 * bar[k]);
    }
    save_page(&page, "08_gauss_newton.png");
    itn_scene_free(scenes[0]), itn_scene_free(scenes[1]);
    return wrong;
}
