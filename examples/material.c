/* A material of your own: a BSDF in thirty lines, differentiated, found again from a picture.

   You learn: what a surface is to the library. eval gives f cos theta_o with its slopes (itn__num)
   and the density of sample, which draws a direction; lanes (itn__floats) hold several paths. How
   it becomes a row of the header's table, with fields of its own: there, "The surfaces there are".

   Here: Phong's gloss, a lobe c^m around the mirrored direction, m = 2 / alpha^2 - 2,
       f cos theta_o = reflectance (m + 1) / (2 pi) c^m,     pdf = (m + 1) / (2 pi) c^m.

   Compile: cc -O3 -march=native material.c -o material -lm -lpthread
   Run:     ./material  (leaves material.png; checks its derivative, and the roughness it finds)
   Exercise: a retroreflector, as traffic signs are: the lobe is around i itself. Change what `lobe`
   returns, and find its roughness, too. (Solution: compile with -DSOLUTION.) */
#define ITN_OWN_SURFACE
#define ITN_IMPLEMENTATION
#include "course/course.h"
/* The middle of the lobe. */
static itn__vectors lobe(itn__vectors i) {
#ifdef SOLUTION
    return i;
#else
    return itn__vectors_of(-i.x, -i.y, i.z);
#endif
}
/* m, with its slope if alpha is what is asked for. */
static itn__num exponent(const itn__site *site) {
    itn__floats one = itn__splat(1);
    itn__num alpha = itn__site_value(site, site->surface->alpha);
    return itn__naffine(itn__ndiv(itn__constant(2 * one), itn__nsquare(alpha)), one, -2 * one);
}
static void itn__own_eval(const itn__site *site, const itn__nvectors *i, const itn__nvectors *o,
                          itn__num f[3], itn__floats *pdf) {
    itn__floats one = itn__splat(1), least = itn__splat(1e-30f);
    itn__floats c = itn__vdot(lobe(itn__nvalues(i)), itn__nvalues(o));
    itn__num m = exponent(site);
    itn__num power = itn__nexp(itn__nscale(m, itn__vlog(itn__most(c, least)))); /* c^m */
    power = itn__nmul(power, itn__nscale(itn__naffine(m, one, one), one / (2 * ITN__PI)));
    *pdf = power.v;
    for (int k = 0; k < site->channels; k++) f[k] = itn__nmul(itn__reflectance(site, k), power);
}
static itn__ints itn__own_sample(itn__site *site, const itn__floats u[3], itn__vectors *o) {
    itn__vectors middle = lobe(site->i), s, t;
    itn__floats sine, cosine, c = itn__vexp(itn__vlog(u[0]) / (exponent(site).v + 1));
    itn__floats r = itn__safe_root(1 - c * c);
    itn__vsincos_turns(u[1], &sine, &cosine);
    itn__vframe(middle, &s, &t);
    *o = itn__vto_world(itn__vectors_of(r * cosine, r * sine, c), s, t, middle);
    return itn__less(itn__splat(0), o->z);
}
static const char SCENE[] = "film    width 64 height 64\n"
                            "camera  eye 0.4 0.5 2.2  target 0 0 0  fov 25\n"
                            "surface skin type own reflectance .7 alpha .35\n"
                            "object  mesh ../scenes/shapes/figurine.ply surface skin\n"
                            "light   sky ../scenes/t3-e60.sky sun .5 .6 .62 sun_radius_scale 20\n";
enum { SIDE = 64, PIXELS = SIDE * SIDE };
static itn_error error;
/* Renders the mean, and by alpha if asked; *e: the standard error of its mean. */
static itn_image render(const itn_scene *scene, const float *theta, const int *alpha, double *mean,
                        double *e) {
    itn_render_options options = ITN_ZERO;
    itn_image image;
    options.spp = 256;
    need(itn_render(scene, theta, &options, alpha, alpha != NULL, &image, &error), &error);
    const float *plane = image.pixels + (alpha ? 2 : 0) * PIXELS;
    *mean = *e = 0;
    for (int i = 0; i < PIXELS; i++) *mean += plane[i] / (double)PIXELS, *e += plane[PIXELS + i];
    *e = sqrt(*e) / PIXELS;
    return image;
}
int main(void) {
    itn_refine_options how = ITN_ZERO;
    itn_scene *scene;
    itn_estimate found;
    float theta[16];
    double slope, e, means[2], errors[2];
    need(itn_scene_from_memory(SCENE, sizeof SCENE - 1, NULL, NULL, 0, NULL, &scene, &error),
         &error);
    int alpha = itn_parameter_find(scene, "skin.alpha");
    itn_parameter_values(scene, theta);
    itn_image image = render(scene, theta, &alpha, &slope, &e);
    for (int up = 0; up < 2; up++) {
        theta[alpha] = .35f + (up ? .02f : -.02f);
        itn_image moved = render(scene, theta, NULL, means + up, errors + up);
        itn_image_free(&moved);
    }
    e = hypot(e, hypot(errors[0], errors[1]) / .04);
    check("d mean / d alpha", slope, (means[1] - means[0]) / .04, 4 * e + .05 * fabs(slope));
    theta[alpha] = .15f; /* a guess, far from the truth */
    how.spp = 32, how.target_variance = image.pixels + PIXELS;
    need(itn_refine(scene, theta, image.pixels, &alpha, 1, &how, &found, &error), &error);
    check("alpha, from the picture", found.value, .35, 4 * found.standard_error);
    itn_image page = new_page(2);
    show(&page, 0, image.pixels, SIDE, SIDE, 1, 12, "a surface of one's own");
    show(&page, 1, image.pixels + 2 * PIXELS, SIDE, SIDE, 1, -30, "derivative by alpha");
    save_page(&page, "material.png");
    itn_image_free(&image), itn_scene_free(scene);
    return wrong;
}
