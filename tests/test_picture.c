/* What pixels show: the camera, textures, checkers and light maps, as wide as they are high or not,
   against quadratures in double of the conventions that the header states. */
#ifndef ITN_APART
#define ITN_IMPLEMENTATION
#endif
#include "../itn.h"
#include "check.h"
#include "solids.h"
#include "stage.h"

enum { WIDTH = 24, HEIGHT = 15, PIXELS = WIDTH * HEIGHT, PARTS = 10 };

/* Errors that can be planted in what is expected. */
typedef enum plant {
    NONE,
    MIRRORED,  /* left for right */
    UPRIGHT,   /* the field of view is that of the height */
    TURNED,    /* texture coordinates z, x */
    LOWERED,   /* the texture's first row below */
    SHIFTED,   /* its pixels lie at the corners of squares */
    EXCHANGED, /* the checker's reflectances */
    BEHIND     /* the map seen in the opposite direction */
} plant;

static const itn_vec3 eye = {1.1f, 2.3f, .9f}, target = {.3f, -1.2f, -.2f}, up = {.3f, 1, .2f};
static const double fov = 50;

typedef struct real3 {
    double x, y, z;
} real3;

static real3 across(real3 a, real3 b) {
    real3 c;
    c.x = a.y * b.z - a.z * b.y, c.y = a.z * b.x - a.x * b.z, c.z = a.x * b.y - a.y * b.x;
    return c;
}

static real3 unit(real3 a) {
    double length = sqrt(a.x * a.x + a.y * a.y + a.z * a.z);
    a.x /= length, a.y /= length, a.z /= length;
    return a;
}

/* The direction of a point of the film, from its upper left corner in pixels. */
static real3 direction_of(double column, double row, plant planted) {
    double half = tan(fov / 360 * 3.14159265358979323846);
    double x = 2 * column / WIDTH - 1, y = (1 - 2 * row / HEIGHT) * HEIGHT / WIDTH;
    real3 forward, right, above, d;
    if (planted == UPRIGHT) half *= (double)WIDTH / HEIGHT;
    if (planted == MIRRORED) x = -x;
    forward.x = (double)target.x - (double)eye.x, forward.y = (double)target.y - (double)eye.y;
    forward.z = (double)target.z - (double)eye.z;
    above.x = (double)up.x, above.y = (double)up.y, above.z = (double)up.z;
    forward = unit(forward), right = unit(across(forward, above)), above = across(right, forward);
    d.x = forward.x + half * (x * right.x + y * above.x);
    d.y = forward.y + half * (x * right.y + y * above.y);
    d.z = forward.z + half * (x * right.z + y * above.z);
    return unit(d);
}

/* An image of which no turn, mirror image or part is another. */
static itn_image made_image(int width, int height) {
    itn_image image;
    itn_error error;
    int i;
    stage_need(itn_image_create(width, height, 1, NULL, &image, &error), &error);
    strcpy(image.names[0], "Y");
    for (i = 0; i < width * height; i++) image.pixels[i] = (float)(i * i * 29 % 41 + 2) / 44;
    return image;
}

/* The value at (x, y) in pixels, whose middles are at halves, between the four around; repeated
   across, and down as well or held at the first and last row. */
static double between(const itn_image *image, double x, double y, int held) {
    double value = 0;
    int i, column = (int)floor(x - .5), row = (int)floor(y - .5);
    for (i = 0; i < 4; i++) {
        int c = column + i % 2, r = row + i / 2;
        double share = (1 - fabs(x - .5 - c)) * (1 - fabs(y - .5 - r));
        c = (c % image->width + image->width) % image->width;
        if (held) r = r < 0 ? 0 : r >= image->height ? image->height - 1 : r;
        else r = (r % image->height + image->height) % image->height;
        value += share * (double)image->pixels[r * image->width + c];
    }
    return value;
}

/* What is seen in a direction: the square y = -1.2 of half size 3 with an image (its rows from t = 1
   down) or a checker on it, in light 1 from everywhere. */
static double ground(real3 d, const itn_image *image, plant planted) {
    double way = (-1.2 - (double)eye.y) / d.y, s = (double)eye.x + way * d.x;
    double t = (double)eye.z + way * d.z, x = s, shift = planted == SHIFTED ? .5 : 0;
    if (!(way > 0) || fabs(s) > 3 || fabs(t) > 3) return 1;
    if (planted == TURNED) s = t, t = x;
    if (!image) {
        int odd = ((int)floor(s / .7) + (int)floor(t / .7)) & 1;
        return odd == (planted == EXCHANGED) ? .8 : .3;
    }
    if (planted == LOWERED) t = 1 - t;
    return .9 * between(image, (s - floor(s)) * image->width + shift,
                        (1 - (t - floor(t))) * image->height + shift, 0);
}

/* The map in a direction: rows from the zenith to the nadir; the middle of the picture is -z. */
static double sky(real3 d, const itn_image *image, plant planted) {
    double sign = planted == BEHIND ? -1 : 1, u, v;
    u = atan2(sign * d.x, -sign * d.z) / 6.28318530717958648;
    v = acos(d.y) / 3.14159265358979323846;
    return between(image, (u - floor(u)) * image->width, v * (image->height - 1) + .5, 1);
}

/* Each pixel of a scene against the mean over its square of what is to be seen. */
static void compare(const char *what, const stage *s, const itn_image *image, int ground_seen,
                    plant planted) {
    itn_scene *scene = stage_make(s);
    int mode, i, k;
    for (mode = ITN_MODE_REFERENCE; mode <= ITN_MODE_FAST; mode++) {
        itn_render_options options = ITN_ZERO;
        itn_image seen = ITN_ZERO;
        itn_error error;
        double chi = 0, spread = 0;
        options.spp = 256, options.mode = (itn_mode)mode;
        stage_need(itn_render(scene, NULL, &options, NULL, 0, &seen, &error), &error);
        for (i = 0; i < PIXELS; i++) {
            double expected = 0, deviation = sqrt((double)seen.pixels[PIXELS + i]);
            for (k = 0; k < PARTS * PARTS; k++) {
                real3 d = direction_of(i % WIDTH + (k % PARTS + .5) / PARTS,
                                       i / WIDTH + (k / PARTS + .5) / PARTS, planted);
                expected += (ground_seen ? ground(d, image, planted) : sky(d, image, planted)) /
                            (PARTS * PARTS);
            }
            /* of a pixel with edges the quadrature is off by up to half a part of their length */
            chi += pow(((double)seen.pixels[i] - expected) / (deviation + .01), 2) / PIXELS;
            spread += deviation / PIXELS;
        }
        check_report(chi < 1.2 && spread < .02, __FILE__, __LINE__,
                     "%s, mode %d: mean square %.2f, error %.4f", what, mode, chi, spread);
        if (getenv("SHOW"))
            printf("%s, mode %d, planted %d: mean square %.2f, error %.4f\n", what, mode, planted,
                   chi, spread);
        itn_image_free(&seen);
    }
    itn_scene_free(scene);
}

static void begin(stage *s) {
    stage_begin(s, WIDTH, 0, fov);
    s->desc.film.height = HEIGHT;
    s->desc.camera.eye = eye, s->desc.camera.target = target, s->desc.camera.up = up;
}

static void test_texture(plant planted) {
    itn_image image = made_image(5, 4);
    itn_surface_desc *surface;
    stage s;
    begin(&s);
    surface = stage_diffuse(&s, "floor", .9);
    surface->texture = ITN_TEXTURE_IMAGE, surface->image = &image;
    stage_object(&s, NULL, NULL, "floor");
    stage_constant(&s, NULL, 1);
    compare("texture", &s, &image, 1, planted);
    itn_image_free(&image);
}

static void test_checker(plant planted) {
    itn_surface_desc *surface;
    stage s;
    begin(&s);
    surface = stage_diffuse(&s, "floor", .8);
    surface->texture = ITN_TEXTURE_CHECKER, surface->checker_size = .7f;
    surface->reflectance2[0] = .3f;
    stage_object(&s, NULL, NULL, "floor");
    stage_constant(&s, NULL, 1);
    compare("checker", &s, NULL, 1, planted);
}

/* The map itself, past a small black square out of sight. */
static void test_map(plant planted) {
    itn_image image = made_image(7, 5);
    stage s;
    begin(&s);
    stage_diffuse(&s, "black", 0);
    stage_object(&s, NULL, NULL, "black")->plane_y = 40;
    stage_map(&s, NULL, &image);
    compare("map", &s, &image, 0, planted);
    itn_image_free(&image);
}

/* The variance of a sample is the same in small jobs and large ones, of which the fast walk knows
   the scene's surroundings in other detail: from differences of two renders, without the variances
   that these tell. Pixels are drawn by plain random numbers. planted: a factor. */
static void test_variance_of_jobs(double planted) {
    enum { SIDE = 80, ALL = SIDE * SIDE, JOBS = 3 };
    static const int spp[JOBS] = {8, 16, 48}; /* .2, .4 and 1.2 million paths */
    static double found[JOBS], errors[JOBS];     /* once */
    int job, i, half;
    for (job = 0; job < JOBS && errors[JOBS - 1] == 0; job++) {
        itn_mesh mesh = solids_sphere(1, 3);
        itn_render_options options = ITN_ZERO;
        itn_image images[2];
        itn_scene *scene;
        itn_error error;
        stage s;
        stage_begin(&s, SIDE, 4, 32);
        stage_medium(&s, "m", 5, .95, .5); /* of coarse cells in small jobs */
        stage_object(&s, &mesh, "m", NULL);
        stage_constant(&s, NULL, 1);
        scene = stage_make(&s);
        options.spp = spp[job], options.mode = ITN_MODE_FAST;
        options.sampler = ITN_SAMPLER_RANDOM;
        for (half = 0; half < 2; half++) {
            options.seed = (uint64_t)(2 * job + half);
            stage_need(itn_render(scene, NULL, &options, NULL, 0, &images[half], &error), &error);
        }
        for (i = 0; i < ALL; i++) {
            double apart = (double)images[0].pixels[i] - (double)images[1].pixels[i];
            double variance = spp[job] * apart * apart / 2;
            found[job] += variance / ALL, errors[job] += variance * variance / ALL;
        }
        errors[job] = sqrt((errors[job] - found[job] * found[job]) / ALL);
        if (getenv("SHOW"))
            printf("variance of a sample at %d: %.5f +- %.5f\n", spp[job], found[job], errors[job]);
        itn_image_free(&images[0]), itn_image_free(&images[1]);
        itn_scene_free(scene);
        itn_mesh_free(&mesh);
    }
    for (job = 1; job < JOBS; job++)
        CHECK_NEAR(found[job] * planted, found[0], 4 * hypot(errors[job], errors[0]));
}

int main(void) {
    int planted;
    test_texture(NONE);
    test_checker(NONE);
    test_map(NONE);
    test_variance_of_jobs(1);
    CHECK_CATCHES(test_variance_of_jobs(1.5));
    for (planted = MIRRORED; planted <= SHIFTED; planted++) {
        CHECK_CATCHES(test_texture((plant)planted));
    }
    CHECK_CATCHES(test_checker(EXCHANGED));
    CHECK_CATCHES(test_map(MIRRORED));
    CHECK_CATCHES(test_map(UPRIGHT));
    CHECK_CATCHES(test_map(BEHIND));
    return check_end("picture");
}
