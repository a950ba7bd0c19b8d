/* 7. A derivative image, checked by differences.

   The library differentiates every pixel by every parameter, in the same walk that makes the
   picture. Ask for parameters by name and find, behind the picture and its variance, two planes
   for each: the derivative and its variance. Check what you differentiate: the derivative of the
   mean of all pixels is a difference of two means, rendered a little up and a little down with
   the same random numbers.

   Look at: red is brighter and blue darker as the parameter grows. More albedo brightens
   everything; more sigma_t, what is thin; a larger g (light goes straight on) darkens what
   scattered it back.
   Check:   derivatives against differences, within four standard errors and 5 % (of long steps).
   Exercise: which of two pictures tells more about g, this or one lit from behind? Put the sun
   behind it and compare sum of (d/dg)^2 / variance, the information of a picture in units of its
   noise. (Solution: compile with -DSOLUTION.)

   Compile: cc -O2 -march=native 07_derivative.c -o 07_derivative -lm -lpthread */
#define ITN_IMPLEMENTATION
#include "course.h"

enum { SIDE = 64, PIXELS = SIDE * SIDE, UNKNOWNS = 3 };
static const char *const names[UNKNOWNS] = {"jade.sigma_t", "jade.albedo", "jade.g"};

static itn_scene *make(const char *sun) {
    char text[600];
    itn_scene *scene;
    itn_error error;
    int size = snprintf(text, sizeof text,
                        "film   width 64 height 64\n"
                        "camera eye 0.3 0.5 2.2  target 0 0 0  fov 25\n"
                        "medium jade  sigma_t 30 albedo .9 g .5\n"
                        "object mesh ../../scenes/shapes/figurine.ply medium jade\n"
                        "light  sky ../../scenes/t3-e60.sky sun %s sun_radius_scale 20\n", sun);
    need(itn_scene_from_memory(text, (size_t)size, NULL, NULL, 0, NULL, &scene, &error), &error);
    return scene;
}

static itn_image render(const itn_scene *scene, const float *theta, const int *asked, int count) {
    itn_render_options options = ITN_ZERO;
    itn_image image;
    itn_error error;
    options.spp = 64;
    need(itn_render(scene, theta, &options, asked, count, &image, &error), &error);
    return image;
}

/* The mean of a plane, and its standard error by the plane of variances behind it. */
static double mean_of(const itn_image *image, int plane, double *error) {
    const float *value = image->pixels + plane * PIXELS, *variance = value + PIXELS;
    double sum = 0, square = 0;
    for (int i = 0; i < PIXELS; i++) sum += value[i], square += variance[i];
    *error = sqrt(square) / PIXELS;
    return sum / PIXELS;
}

int main(void) {
    itn_scene *scene = make(".5 .7 .5");
    float theta[16];
    int asked[UNKNOWNS];
    for (int k = 0; k < UNKNOWNS; k++) asked[k] = itn_parameter_find(scene, names[k]);
    itn_parameter_values(scene, theta);
    itn_image image = render(scene, theta, asked, UNKNOWNS);
    itn_image page = new_page(1 + UNKNOWNS);
    show(&page, 0, image.pixels, SIDE, SIDE, 1, 15, "jade");
    for (int k = 0; k < UNKNOWNS; k++) {
        const itn_parameter *p = itn_parameter_get(scene, asked[k]);
        float value = p->value, h = .25f * fminf(value, p->upper - value);
        double error, e, most = 0, slope = mean_of(&image, 2 + 2 * k, &error), difference = 0;
        const float *plane = image.pixels + (2 + 2 * k) * PIXELS;
        for (int i = 0; i < PIXELS; i++) most += plane[i] * plane[i] / PIXELS;
        show(&page, 1 + k, plane, SIDE, SIDE, 1, -4 * sqrt(most), names[k]);
        for (int side = -1; side <= 1; side += 2) {
            theta[asked[k]] = value + (float)side * h;
            itn_image moved = render(scene, theta, NULL, 0);
            difference += side * mean_of(&moved, 0, &e) / (2 * h);
            error = hypot(error, e / (2 * h));
            itn_image_free(&moved);
        }
        theta[asked[k]] = value;
        check(names[k], slope, difference, 4 * error + .05 * fabs(slope));
    }
    save_page(&page, "07_derivative.png");
#ifdef SOLUTION
    for (int behind = 0; behind < 2; behind++) {
        itn_scene *lit = make(behind ? ".1 .3 -.95" : ".5 .7 .5");
        itn_image more = render(lit, NULL, asked, UNKNOWNS);
        double information = 0;
        for (int i = 0; i < PIXELS; i++) {
            double d = more.pixels[6 * PIXELS + i], noise = more.pixels[7 * PIXELS + i];
            double v = more.pixels[PIXELS + i];
            if (v > 0) information += (d * d - noise) / v; /* its own noise is no information */
        }
        printf("sun %s: g to +- %.3g\n", behind ? "behind" : "in front", 1 / sqrt(information));
        itn_image_free(&more), itn_scene_free(lit);
    }
#endif
    itn_image_free(&image), itn_scene_free(scene);
    return wrong;
}
