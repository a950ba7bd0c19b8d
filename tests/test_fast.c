/* The fast walk against the reference, path by path and image by image; its safe flights against
   the tree; and that its results do not depend on what shares the work.

   ITN_LONG_TESTS=1 in the environment asks for many more flights and samples; ITN_VERBOSE=1 prints
   every measurement. */
#define ITN_THREADS
#define ITN_IMPLEMENTATION
#include "../itn.h"

#include "check.h"
#include "one.h"

#include "solids.h"
#include "stage.h"

static int verbose;

/* Every scene is looked at; with sanitizers, every sixth, with fewer samples, and what is much like
   another test is left out. */
#ifdef ITN_SANITIZED
enum { STRIDE = 6 };
#else
enum { STRIDE = 1 };
#endif

/* ---- scenes ---------------------------------------------------------------------------------- */

enum { FAST_SIZE = 8, FAST_PIXELS = FAST_SIZE * FAST_SIZE };
enum {
    ROUGH,   /* milk in rough glass, in light from everywhere */
    SMOOTH,  /* milk in smooth glass, in a map */
    MATCHED, /* a cloud without surface, under sky and sun */
    GROUP,   /* media next to each other, touching, one within another, on a checkered floor */
    COLOUR,  /* a coloured cloud on a coloured floor, under a coloured sky and a room */
    INSIDE,  /* the camera in a medium, with a pebble of glass in view */
    SHEETS,  /* a floor that cuts through a cloud, and an open sheet in it */
    BLACK,   /* albedo 0 in rough glass */
    WHITE,   /* albedo 1 */
    LEAF,    /* a plate, 1000 times as wide as it is thick */
    FAST_NEEDLES, /* a ball drawn out to 500 times its thickness */
    DENSE,   /* optical thickness 1e4 */
    FAST_SLAB,    /* half a space, seen from close by */
    TINY,    /* the scale 1e-4, */
    VAST,    /* and 1e4 */
    TEXTURE, /* a picture on a mesh with coordinates, seen through rough glass and milk */
    SPECTRA, /* media with values for each channel, in rough glass, in each other, on a floor */
    MADE,    /* from here on: the scenes of the project, in small films */
    SPECTRAL = MADE + 7,
    KINDS = MADE + 10
};
static const char *const kind_names[KINDS] = {
    "rough", "smooth", "matched", "group", "colour", "inside", "sheets", "black", "white", "leaf",
    "needles", "dense", "slab", "tiny", "vast", "texture", "spectra", "../scenes/chain.itn",
    "../scenes/data.itn", "../scenes/default.itn", "../scenes/hound.itn", "../scenes/matched.itn",
    "../scenes/rgb.itn", "../scenes/smooth.itn", "../scenes/spectral.itn", "../scenes/still.itn",
    "../scenes/studio.itn"};

static void stretch(itn_object_desc *object, double x, double y, double z, double dx, double dy,
                    double dz) {
    object->transform[0] = (float)x, object->transform[5] = (float)y;
    object->transform[10] = (float)z;
    object->transform[3] = (float)dx, object->transform[7] = (float)dy;
    object->transform[11] = (float)dz;
}

/* A square in the plane z = 0, half size 1, with texture coordinates. */
static itn_mesh fast_square(void) {
    static const int triangles[2][3] = {{0, 1, 2}, {1, 3, 2}};
    itn_mesh mesh;
    itn_error error;
    int i;
    stage_need(itn_mesh_create(4, 2, 1, NULL, &mesh, &error), &error);
    for (i = 0; i < 4; i++) {
        mesh.uvs[2 * i] = (float)(i & 1), mesh.uvs[2 * i + 1] = (float)(i >> 1);
        mesh.positions[3 * i] = 2 * mesh.uvs[2 * i] - 1;
        mesh.positions[3 * i + 1] = 2 * mesh.uvs[2 * i + 1] - 1;
    }
    memcpy(mesh.triangles, triangles, sizeof triangles);
    return mesh;
}

/* What is in a scene: `ball`, `box` and `sheet` have half size 1. */
static void fill_stage(stage *s, int which, const itn_mesh *ball, const itn_mesh *box,
                       const itn_mesh *sheet, const itn_image *map, const itn_image *picture) {
    double scale = which == TINY ? 1e-4 : which == VAST ? 1e4 : 1;
    itn_object_desc *object;
    stage_begin(s, FAST_SIZE, 4 * scale, 35);
    if (which == ROUGH || which == TINY || which == VAST || which == BLACK) {
        stage_medium(s, "m", 4 / scale, which == BLACK ? 0 : .9, .5);
        stage_dielectric(s, "glass", 1.4, .2);
        object = stage_object(s, ball, "m", "glass");
        stretch(object, scale, scale, scale, 0, 0, 0);
        if (which == BLACK) stage_map(s, "map", map);
        if (which != BLACK) stage_constant(s, "room", 1);
    } else if (which == SMOOTH) {
        stage_medium(s, "m", 3, .95, .6);
        stage_dielectric(s, "glass", 1.5, 0);
        stage_object(s, ball, "m", "glass");
        stage_map(s, "map", map);
    } else if (which == MATCHED || which == WHITE) {
        stage_medium(s, "m", 10, which == WHITE ? 1 : .9, which == WHITE ? -.3 : .5);
        stage_object(s, ball, "m", NULL);
        stage_sky(s, "sky");
    } else if (which == GROUP) {
        stage_medium(s, "m", 8, .9, .5), stage_medium(s, "n", 20, .8, 0);
        stage_dielectric(s, "glass", 1.5, .3), stage_dielectric(s, "water", 1.33, 0);
        stage_diffuse(s, "floor", .5)->texture = ITN_TEXTURE_CHECKER;
        s->surfaces[2].reflectance2[0] = .2f, s->surfaces[2].checker_size = .3f;
        stage_object(s, NULL, NULL, "floor")->plane_y = -.65f;
        stretch(stage_object(s, box, "m", "glass"), .3, .6, .5, -.3, 0, 0);
        stretch(stage_object(s, box, "n", NULL), .3, .6, .4, .3, 0, 0);   /* touches it */
        stretch(stage_object(s, ball, "m", "water"), .5, .5, .5, 0, .3, .3); /* reaches into both */
        stretch(stage_object(s, ball, "n", NULL), .2, .2, .2, 0, .3, .3); /* within that */
        stage_map(s, "map", map);
        stage_constant(s, "room", .3);
    } else if (which == COLOUR) {
        itn_medium_desc *medium = stage_medium(s, "m", 6, .9, .3);
        medium->albedo[1] = .7f, medium->albedo[2] = .99f;
        s->desc.film.channels = 3, s->desc.film.filter = ITN_FILTER_GAUSSIAN;
        stage_diffuse(s, "floor", .5)->reflectance[1] = .1f;
        stage_object(s, NULL, NULL, "floor");
        stage_object(s, ball, "m", NULL);
        stage_sky(s, "sky");
        stage_constant(s, "room", .4)->radiance[2] = .8f;
    } else if (which == INSIDE) {
        stage_medium(s, "m", 1, .9, .2);
        stage_dielectric(s, "glass", 1.5, 0);
        stage_object(s, ball, "m", NULL);
        stretch(stage_object(s, ball, NULL, "glass"), .2, .2, .2, 0, 0, 0);
        s->desc.camera.eye.z = .7f, s->desc.camera.fov = 60;
        stage_map(s, "map", map);
    } else if (which == SHEETS) {
        stage_medium(s, "m", 5, .9, .2);
        stage_diffuse(s, "floor", .6), stage_diffuse(s, "leaf", .3);
        stage_object(s, ball, "m", NULL);
        stage_object(s, NULL, NULL, "floor")->plane_y = -.3f;
        stretch(stage_object(s, sheet, NULL, "leaf"), .5, .5, 1, .1, .2, 0);
        stage_map(s, "map", map);
        stage_constant(s, "room", .3);
    } else if (which == LEAF) {
        stage_medium(s, "m", 2000, .9, .3), stage_medium(s, "n", 500, .9, .3);
        stage_dielectric(s, "glass", 1.4, .3);
        stretch(stage_object(s, box, "m", NULL), 1, .001, 1, 0, 0, 0);
        stretch(stage_object(s, box, "n", "glass"), .5, .5, .001, 0, .502, 0);
        s->desc.camera.eye.y = 2;
        stage_sky(s, "sky");
    } else if (which == FAST_NEEDLES) {
        stage_medium(s, "m", 500, .9, .3);
        stretch(stage_object(s, ball, "m", NULL), 1, .002, .002, 0, 0, 0);
        s->desc.camera.fov = 3, s->desc.camera.eye.y = 1;
        stage_map(s, "map", map);
    } else if (which == DENSE) {
        stage_medium(s, "m", 1e4, .98, .2);
        stage_object(s, ball, "m", NULL);
        stage_map(s, "map", map);
    } else if (which == FAST_SLAB) {
        stage_medium(s, "m", 1, .8, .3);
        stretch(stage_object(s, box, "m", NULL), 600, 300, 600, 0, -300, 0);
        s->desc.camera.eye.z = 0, s->desc.camera.eye.y = 1, s->desc.camera.up.z = 1;
        s->desc.camera.fov = .1f;
        stage_constant(s, "room", 1);
    } else if (which == TEXTURE) {
        stage_medium(s, "m", 1, .9, .3);
        stage_dielectric(s, "glass", 1.3, .4);
        stage_diffuse(s, "print", .9)->texture = ITN_TEXTURE_IMAGE;
        s->surfaces[1].image = picture;
        stage_object(s, ball, "m", "glass");
        stage_object(s, sheet, NULL, "print");
        stage_map(s, "map", map);
    } else if (which == SPECTRA) {
        static const float sigma_t[2][3] = {{2, 5, 9}, {20, 3, 1}}, g[3] = {.6f, .1f, -.4f};
        itn_medium_desc *medium;
        s->desc.film.channels = 3;
        medium = stage_medium(s, "m", 1, .9, 0);
        memcpy(medium->sigma_t_rgb, sigma_t[0], sizeof g), memcpy(medium->g_rgb, g, sizeof g);
        medium->albedo[1] = .7f;
        memcpy(stage_medium(s, "n", 1, .8, .3)->sigma_t_rgb, sigma_t[1], sizeof g);
        memcpy(stage_medium(s, "o", 4, .95, 0)->g_rgb, g, sizeof g);
        stage_medium(s, "p", 6, .9, .2);
        stage_dielectric(s, "glass", 1.4, .3);
        stage_diffuse(s, "floor", .7)->texture = ITN_TEXTURE_IMAGE;
        s->surfaces[1].image = picture;
        stage_object(s, NULL, NULL, "floor");
        stretch(stage_object(s, ball, "m", "glass"), .8, .8, .8, -.5, 0, 0);
        stretch(stage_object(s, ball, "n", NULL), .4, .4, .4, -.6, .1, 0);
        stretch(stage_object(s, box, "o", NULL), .4, .7, .4, .8, 0, 0);
        stretch(stage_object(s, box, "p", NULL), .2, .3, .2, .8, .1, .4);
        stage_map(s, "map", map);
        stage_constant(s, "room", .2);
    }
}

static void set_film(itn_scene *scene, int side) {
    scene->film.width = scene->film.height = side;
}

static itn_scene *load_scene(const char *path, const itn_context *context) {
    itn_scene *scene = NULL;
    itn_error error;
    int width, height;
    stage_need(itn_scene_load(path, context, &scene, &error), &error);
    width = scene->film.width, height = scene->film.height;
    scene->film.width = FAST_SIZE;
    scene->film.height = FAST_SIZE * height / width;
    return scene;
}

static itn_scene *make_scene(int which, const itn_context *context) {
    itn_mesh ball, box, sheet;
    itn_image map, picture;
    stage s;
    itn_scene *scene = NULL;
    itn_error error;
    if (which >= MADE) return load_scene(kind_names[which], context);
    ball = solids_sphere(1, 2), sheet = fast_square();
    box = solids_box(solids_vec3(-1, -1, -1), solids_vec3(1, 1, 1));
    map = stage_patch(3, .6, .3, 8), picture = stage_patch(1, .3, .6, .7);
    fill_stage(&s, which, &ball, &box, &sheet, &map, &picture);
    stage_need(itn_scene_create(&s.desc, context, &scene, &error), &error);
    itn_image_free(&map), itn_image_free(&picture);
    itn_mesh_free(&ball), itn_mesh_free(&box), itn_mesh_free(&sheet);
    return scene;
}

/* ---- looking inside -------------------------------------------------------------------------- */

/* A render laid open. */
typedef struct inside {
    const itn_scene *scene;
    itn__render render;
    int parameters[64], count; /* all that the fast walk can differentiate in */
} inside;

static void open_render(inside *in, const itn_scene *scene, const itn_render_options *options) {
    itn__render *render = &in->render;
    itn_error error;
    float theta[64];
    int k;
    memset(in, 0, sizeof *in);
    in->scene = scene;
    itn_parameter_values(scene, theta);
    for (k = 0; k < scene->parameter_count; k++)
        if (itn__fast_derivative(scene, k, theta[k])) in->parameters[in->count++] = k;
        else
            check_report(strstr(scene->parameters[k].name, ".ior") || theta[k] == 0, __FILE__,
                         __LINE__, "%s is left to the reference", scene->parameters[k].name);
    stage_need(itn__render_begin(render, scene, NULL, options, in->parameters, in->count, NULL,
                                 &error), &error);
    stage_need(itn__tables_get(render, &error), &error);
    CHECK(itn__fast_know(render));
    stage_need(itn__divide(render, &error), &error);
}

/* Leaves out what the reference has not, and what takes planes from the tables. */
static void no_guide(inside *in) {
    int m;
    for (m = 0; m <= in->scene->medium_count; m++) in->render.substances[m].guided = 0;
}

static void close_render(inside *in) { itn__render_end(&in->render, ITN_OK); }

/* What the paths of a unit leave. */
static size_t unit_bytes(const inside *in, const itn__unit *unit) {
    return (size_t)(unit->side * unit->side * unit->count * in->render.planes) * sizeof(float);
}

/* Runs paths of a unit in the picture's first crowd and leaves their radiance there. */
static itn__crowd *run_unit(inside *in, const itn__unit *unit) {
    itn__crowd *crowd = in->render.workers[0].crowd;
    memset(crowd->radiance, 0, unit_bytes(in, unit));
    crowd->unit = *unit;
    itn__run_unit(crowd);
    return crowd;
}

/* A unit of the whole picture, and a crowd that has room for it. */
static itn__unit whole_unit(inside *in) {
    itn__worker *worker = &in->render.workers[0];
    itn__unit unit = ITN_ZERO;
    unit.side = in->scene->film.width > in->scene->film.height ? in->scene->film.width
                                                               : in->scene->film.height;
    unit.count = in->render.options.spp;
    CHECK(itn__worker_make(&in->render, worker, unit.side * unit.side * unit.count));
    return unit;
}

/* ---- path by path ---------------------------------------------------------------------------- */

typedef struct tally {
    double paths, equal, near_by, brief, brief_apart; /* numbers of paths */
    double bright, derivatives_apart; /* of those near by that are not black */
    double sum, difference, square; /* of the reference; of the difference */
    double collisions[2];           /* of both */
} tally;

/* The larger of two, NaN if one is. */
static double worse(double a, double b) { return b <= a || isnan(a) ? a : b; }

/* How far two paths' radiances are from each other, relative to the larger one. */
static double distance_of(const float *a, const float *b, int channels) {
    double apart = 0, size = 0;
    int c;
    for (c = 0; c < channels; c++) {
        apart = worse(apart, fabs((double)a[c] - b[c]));
        size = fmax(size, fmax(fabs((double)a[c]), fabs((double)b[c])));
    }
    return apart == 0 ? 0 : apart / size;
}

/* The same for the derivatives of a path; those of parameters that matter little count as their
   share in the largest. */
static double derivatives_apart(const itn__crowd *crowd, const itn__walk *walk, int number) {
    double apart = 0, size = 0;
    int k, c;
    for (k = 0; k < walk->count; k++)
        for (c = 0; c < walk->channels; c++) {
            double reference = walk->derivative[k * walk->channels + c];
            double fast = crowd->radiance[number * crowd->render->planes +
                                          walk->channels * (1 + k) + c];
            apart = worse(apart, fabs(fast - reference)), size = fmax(size, fabs(reference));
        }
    return apart == 0 ? 0 : apart / size;
}

static void tally_unit(inside *in, itn__walk *walk, uint64_t seed, const itn__unit *unit,
                       tally *t) {
    const itn__crowd *crowd = run_unit(in, unit);
    int pixel, ray, c, channels = walk->channels, number = 0;
    for (pixel = 0; pixel < unit->side * unit->side; pixel++)
        for (ray = 0; ray < unit->count; ray++, number++) {
            double before = walk->collisions, apart;
            float fast[3] = {0, 0, 0};
            int x = unit->x + pixel % unit->side, y = unit->y + pixel / unit->side;
            if (x >= in->scene->film.width || y >= in->scene->film.height) continue;
            itn__sample_pixel(walk, seed, x, y, unit->first + ray);
            for (c = 0; c < channels; c++) {
                fast[c] = crowd->radiance[number * crowd->render->planes + c];
                t->sum += walk->radiance[c], t->difference += (double)fast[c] - walk->radiance[c];
                t->square += pow((double)fast[c] - walk->radiance[c], 2);
            }
            apart = distance_of(fast, walk->radiance, channels);
            t->paths++, t->equal += apart <= 1e-5, t->near_by += apart <= 1e-3;
            if (apart <= 1e-5 && walk->radiance[0] > 0)
                t->bright++, t->derivatives_apart += !(derivatives_apart(crowd, walk, number) <= 2e-3);
            if (walk->collisions - before < 10) t->brief++, t->brief_apart += !(apart <= 1e-3);
        }
    t->collisions[0] = walk->collisions, t->collisions[1] = crowd->collisions;
}

/* Makes the fast walk take a parameter for another. */
static void take_for(inside *in, int parameter, int other) {
    in->render.slots[parameter] = in->render.slots[other];
}

/* The fast walk's paths are those of the reference, but for rounding, which sends a path another
   way where it comes close to a choice: at most 3 in 1000 of those with fewer than 10 collisions,
   and 10 where solids touch in a face, since rounding tells which of two equal faces comes first.
   What becomes of them is not better or worse: the means agree. `planted` changes the seed of one of
   the two, the phase function, the light, or what a parameter is. */
static void check_paths(int which, int planted) {
    itn_scene *scene = make_scene(which, NULL);
    itn_render_options options = ITN_ZERO;
    itn__walk walk;
    int slots[64]; /* of the reference */
    tally t = ITN_ZERO;
    double error;
    inside in;
    int number;
    options.spp = which == DENSE || which == WHITE ? 8 : 64, options.seed = 5 + (uint64_t)which;
    if (STRIDE > 1) options.spp /= 8;
    options.walks = 1, options.sampler = ITN_SAMPLER_RANDOM;
    open_render(&in, scene, &options);
    in.render.shadow_cut = 0, in.render.roulette = ITN__ROULETTE;
    no_guide(&in);
    CHECK(itn__walk_make(&walk, &in.render, NULL));
    if (planted == 2) in.render.substances[1].phase.shape[0] += .001;
    if (planted == 3) in.render.constant[0] *= 1.0001f;
    memcpy(slots, in.render.slots, (size_t)scene->parameter_count * sizeof *slots);
    walk.slots = slots;
    if (planted == 4) take_for(&in, scene->media[0].g[0], scene->media[0].sigma_t[0]);
    for (number = 0; number < in.render.tiles * in.render.chunks; number++) {
        itn__unit unit = itn__unit_make(&in.render, number / in.render.chunks,
                                         number % in.render.chunks);
        tally_unit(&in, &walk, options.seed + (planted == 1), &unit, &t);
    }
    error = sqrt(t.square) + 1e-6 * t.sum;
    if (verbose && !check_quiet)
        printf("%-24s: %6.0f paths, %.4f equal, %.4f near; %6.0f brief, %.5f apart; %.1f "
               "collisions (%.4f); mean off by %.2g = %.1f sigma\n", kind_names[which],
               t.paths, t.equal / t.paths, t.near_by / t.paths, t.brief,
               t.brief_apart / (t.brief + 1e-9), t.collisions[0] / t.paths,
               t.collisions[1] / t.collisions[0] - 1, t.difference / t.sum, t.difference / error);
    check_report(t.brief_apart <= (which == GROUP ? .01 : .003) * t.brief + 1, __FILE__, __LINE__,
                 "%s: of %g paths with few collisions %g are apart", kind_names[which], t.brief,
                 t.brief_apart);
    check_report(t.near_by >= .6 * t.paths, __FILE__, __LINE__, "%s: of %g paths only %g are near",
                 kind_names[which], t.paths, t.near_by);
    check_report(t.derivatives_apart <= .002 * t.bright + 1, __FILE__, __LINE__,
                 "%s: of %g paths that are equal %g have other derivatives", kind_names[which],
                 t.bright, t.derivatives_apart);
    check_report(which == DENSE || which == WHITE ||
                     fabs(t.collisions[1] - t.collisions[0]) <= .02 * t.collisions[0],
                 __FILE__, __LINE__, "%s: %g and %g collisions", kind_names[which],
                 t.collisions[0], t.collisions[1]);
    check_report(fabs(t.difference) <= 4 * error, __FILE__, __LINE__,
                 "%s: the difference of means is %.1f sigma", kind_names[which],
                 t.difference / error);
    close_render(&in);
    itn_scene_free(scene);
}

/* A V that is wrong everywhere. planted: what it expects of a new direction does not follow from it
   (1); V used after the choice of a direction: the derivative's base s V is not known before it, and
   its mean stays in (2); V of the direction before the choice in the place of its mean after (3). */
static void mislead(inside *in, int planted) {
    itn__render *render = &in->render;
    double terms[ITN__TERMS];
    int m, c, i;
    render->controls = 1, render->rows = ITN__ROWS + 4 * render->substances[1].turns;
    for (m = 0; m <= in->scene->medium_count; m++)
        for (c = 0; c < 3; c++) {
            itn__substance *substance = &render->substances[m];
            itn__value *value = &substance->value;
            for (i = 0; i < ITN__ORDERS && c == 0 && planted == 1; i++)
                substance->moment[i] = pow(substance->phase.shape[0] + .3, i);
            for (i = 0; i < ITN__TERMS; i++) terms[i] = .4 / (1 + (i * 7 + m + c) % 5);
            itn__value_set(substance, c, terms);
            if (planted == 2) memset(value->slope, 0, sizeof value->slope);
            if (planted == 3) memcpy(value->scattered[c], value->flying[c], sizeof *value->flying);
        }
}

/* Means of all paths of a render, by planes, and their variances. */
static int mean_of_paths(const itn_scene *scene, int spp, int misled, int planted, uint64_t seed,
                         double *mean, double *variance) {
    itn_render_options options = ITN_ZERO;
    double count = 0;
    inside in;
    int number, i, k, planes;
    options.spp = spp, options.seed = seed;
    options.walks = 1, options.sampler = ITN_SAMPLER_RANDOM;
    open_render(&in, scene, &options);
    if (misled == 1) mislead(&in, planted);
    for (k = 0; k <= scene->medium_count && misled == 2; k++)
        for (i = 0; i < 3; i++)
            in.render.substances[k].value.mean[i] = .3f + .1f * (float)i + .2f * (float)k;
    if (misled == 2 && planted)
        take_for(&in, scene->media[0].albedo, scene->media[0].sigma_t[0]);
    planes = in.render.planes;
    for (k = 0; k < planes; k++) mean[k] = variance[k] = 0;
    for (number = 0; number < in.render.tiles * in.render.chunks; number++) {
        itn__unit unit = itn__unit_make(&in.render, number / in.render.chunks,
                                         number % in.render.chunks);
        const itn__crowd *crowd = run_unit(&in, &unit);
        int paths = unit.side * unit.side * unit.count;
        for (k = 0; k < planes; k++)
            for (i = 0; i < paths; i++) {
                double x = crowd->radiance[i * planes + k];
                mean[k] += x, variance[k] += x * x;
            }
        count += paths;
    }
    close_render(&in);
    for (k = 0; k < planes; k++) {
        mean[k] /= count;
        variance[k] = (variance[k] / count - mean[k] * mean[k]) / count;
    }
    return planes;
}

/* Whatever V is, the control variate (misled 1) and what paths were expected to bring (2) leave the
   means of images and of derivatives alone. planted: with 1 an error of the variate, with 2 one
   parameter taken for another. */
static void check_misled(int which, int misled, int planted) {
    enum { MOST = 128 };
    double plain[MOST], plain_variance[MOST], mean[MOST], variance[MOST];
    itn_scene *scene = make_scene(which, NULL);
    int spp = STRIDE > 1 && !planted ? 64 : 512, k;
    int planes = mean_of_paths(scene, spp, 0, 0, 1, plain, plain_variance);
    mean_of_paths(scene, spp, misled, planted, 2, mean, variance);
    for (k = 0; k < planes; k++) {
        double error = sqrt(variance[k] + plain_variance[k]);
        check_report(fabs(mean[k] - plain[k]) <= 4.5 * error, __FILE__, __LINE__,
                     "%s, plane %d: %.5g with %s, %.5g +- %.2g without", kind_names[which], k,
                     mean[k], misled == 1 ? "it" : "bases", plain[k], error);
    }
    itn_scene_free(scene);
}

static void test_control(void) {
    static const int kinds[] = {ROUGH, SMOOTH, MATCHED, GROUP, COLOUR, INSIDE, SHEETS, FAST_SLAB};
    int i;
    for (i = 0; i < (int)(sizeof kinds / sizeof *kinds); i += STRIDE)
        check_misled(kinds[i], 1, 0);
    for (i = 1; i <= 3; i++) CHECK_CATCHES(check_misled(ROUGH, 1, i));
    CHECK_CATCHES(check_misled(ROUGH, 2, 1));
    for (i = 0; i < (int)(sizeof kinds / sizeof *kinds); i += STRIDE) check_misled(kinds[i], 2, 0);
}

/* Media that differ between channels are left to the reference. */
static int only_reference(int which) { return which == SPECTRA || which == SPECTRAL; }

static void test_paths(void) {
    int which;
    for (which = 0; which < KINDS; which += STRIDE)
        if (!only_reference(which)) check_paths(which, 0);
    CHECK_CATCHES(check_paths(MATCHED, 1));
    CHECK_CATCHES(check_paths(MATCHED, 2));
    CHECK_CATCHES(check_paths(ROUGH, 3));
    CHECK_CATCHES(check_paths(ROUGH, 4));
}

/* ---- whatever shares the work ---------------------------------------------------------------- */

/* Runs a unit in parts of side x side pixels and `count` rays, last parts first, and compares each
   part's radiance with that of the whole. A few paths alone fly in other company, are moved between
   queues at other times and lie in other slots; only the order of their sums may differ. */
static void compare_parts(inside *in, const itn__unit *whole, const float *radiance, int side,
                          int count) {
    int x, y, first, pixel, c, i, different = 0;
    for (first = (whole->count - 1) / count * count; first >= 0; first -= count)
        for (y = (whole->side - 1) / side * side; y >= 0; y -= side)
            for (x = (whole->side - 1) / side * side; x >= 0; x -= side) {
                const itn__crowd *crowd;
                int planes = in->render.planes;
                itn__unit part = *whole;
                part.x = whole->x + x, part.y = whole->y + y, part.first = whole->first + first;
                part.side = side;
                part.count = whole->count - first < count ? whole->count - first : count;
                crowd = run_unit(in, &part);
                for (c = 0; c < in->render.channels; c++)
                    for (pixel = 0; pixel < side * side; pixel++) {
                        int column = x + pixel % side, row = y + pixel / side;
                        int at = (row * whole->side + column) * whole->count + first;
                        if (column >= whole->side || row >= whole->side) continue;
                        for (i = 0; i < part.count; i++) {
                            float a = radiance[(at + i) * planes + c];
                            float b = crowd->radiance[(pixel * part.count + i) * planes + c];
                            different += !(fabsf(a - b) <= 1e-5f * fabsf(a));
                        }
                    }
            }
    check_report(!different, __FILE__, __LINE__, "parts of %d x %d pixels, %d rays", side, side,
                 count);
}

/* A camera ray's radiance is the same in whatever crowd it is. planted: but not of another seed. */
static void check_parts(int which, itn_sampler sampler, int walks, int planted) {
    itn_scene *scene = make_scene(which, NULL);
    itn_render_options options = ITN_ZERO;
    itn__unit whole;
    float *radiance;
    size_t bytes;
    inside in;
    options.spp = 32 / walks, options.seed = 3;
    options.walks = walks, options.sampler = sampler;
    open_render(&in, scene, &options);
    whole = whole_unit(&in);
    bytes = unit_bytes(&in, &whole);
    radiance = (float *)malloc(bytes);
    memcpy(radiance, run_unit(&in, &whole)->radiance, bytes);
    in.render.options.seed += (uint64_t)planted;
    compare_parts(&in, &whole, radiance, 8, whole.count);
    compare_parts(&in, &whole, radiance, 1, whole.count);
    compare_parts(&in, &whole, radiance, 3, 3);
    compare_parts(&in, &whole, radiance, 2, 1);
    free(radiance);
    close_render(&in);
    itn_scene_free(scene);
}

static void test_parts(void) {
    int which;
    for (which = 0; which < KINDS; which += STRIDE) {
        if (which == WHITE || only_reference(which)) continue; /* WHITE takes long */
        check_parts(which, which % 2 ? ITN_SAMPLER_RANDOM : ITN_SAMPLER_SOBOL, 1, 0);
        check_parts(which, which % 2 ? ITN_SAMPLER_SOBOL : ITN_SAMPLER_RANDOM, 4, 0);
    }
    CHECK_CATCHES(check_parts(GROUP, ITN_SAMPLER_SOBOL, 4, 1));
}

/* Makes tables know nothing: all cells may hold triangles, on no side of any plane. */
static void forget(itn__voxels *voxels) {
    size_t i;
    for (i = 0; i < itn__cell_count(voxels); i++)
        voxels->cells[i] = 0, voxels->planes[i] = -0x1000000 | 0x8000;
}

/* Nor does it matter what the tables know: they prove flights free, and never make one. planted: a
   table that lies elsewhere. */
static void check_tables(int which, int planted) {
    itn_scene *scene = make_scene(which, NULL);
    itn_render_options options = ITN_ZERO;
    itn__unit whole;
    float *radiance[3];
    int k, c, number, apart[3] = {0, 0, 0}, paths;
    inside in;
    options.spp = 64, options.walks = 1, options.seed = 8;
    open_render(&in, scene, &options);
    no_guide(&in);
    whole = whole_unit(&in);
    paths = whole.side * whole.side * whole.count;
    for (k = 0; k < 3; k++) { /* one that knows nothing; coarse; fine */
        const size_t bytes = unit_bytes(&in, &whole);
        itn__voxels *voxels = NULL;
        itn_error error;
        stage_need(itn__tables_make(scene, k < 2 ? 16 : 96, &voxels, &error), &error);
        if (k && planted) voxels->lower.x += .3f * voxels->cell;
        if (!k) forget(voxels);
        in.render.voxels = voxels;
        radiance[k] = (float *)malloc(bytes);
        memcpy(radiance[k], run_unit(&in, &whole)->radiance, bytes);
        itn__free_blocks(&scene->context, voxels);
        for (number = 0; number < paths; number++)
            for (c = 0; c < in.render.channels; c++) {
                int at = number * in.render.planes + c;
                apart[k] += fabsf(radiance[k][at] - radiance[0][at]) > 1e-3f * radiance[0][at];
            }
        check_report(apart[k] <= .002 * paths, __FILE__, __LINE__,
                     "%s: of %d paths %d change with table %d", kind_names[which], paths, apart[k],
                     k);
    }
    if (verbose && !check_quiet)
        printf("%-24s of %d paths %d and %d change with the table\n", kind_names[which], paths,
               apart[1], apart[2]);
    for (k = 0; k < 3; k++) free(radiance[k]);
    close_render(&in);
    itn_scene_free(scene);
}

static void test_tables(void) {
    int which;
    for (which = 0; which < KINDS; which += STRIDE)
        if (which != WHITE && !only_reference(which)) check_tables(which, 0);
    CHECK_CATCHES(check_tables(ROUGH, 1));
}

static void run_reversed(int count, void (*body)(void *, int), void *task, void *user) {
    (void)user;
    while (count-- > 0) body(task, count);
}

static void fast_render(const itn_scene *scene, const itn_render_options *options,
                        itn_image *image) {
    itn_error error;
    stage_need(itn_render(scene, NULL, options, NULL, 0, image, &error), &error);
}

static int watch_render(void *user, double fraction) {
    *(double *)user = fraction;
    return 0;
}

/* The same image of side x side pixels for any number of threads, watched or not. */
static void check_threads(int which, int side, int spp, int seed_of_second) {
    static const int threads[5] = {2, 3, 7, 0, 1};
    itn_context context = ITN_ZERO;
    itn_image first, other;
    itn_scene *scene;
    itn_render_options options = ITN_ZERO;
    itn_render_stats stats[2];
    double seen = 0;
    int k;
    options.spp = spp, options.stats = &stats[0];
    context.threads = 1;
    scene = make_scene(which, &context);
    set_film(scene, side);
    fast_render(scene, &options, &first);
    itn_scene_free(scene);
    options.seed = (uint64_t)seed_of_second, options.stats = &stats[1];
    for (k = STRIDE > 1 ? 1 : 0; k < 5; k += STRIDE > 1 ? 3 : 1) {
        context.threads = threads[k];
        if (k == 4) context.parallel_for = run_reversed;
        options.progress = k % 2 ? watch_render : NULL, options.progress_user = &seen;
        scene = make_scene(which, &context);
        set_film(scene, side);
        fast_render(scene, &options, &other);
        itn_scene_free(scene);
        CHECK(!memcmp(first.pixels, other.pixels, (size_t)(first.width * first.height) *
                                                      (size_t)first.plane_count * sizeof(float)));
        CHECK(stats[0].paths == stats[1].paths && stats[0].collisions == stats[1].collisions);
        itn_image_free(&other);
    }
    CHECK(seen == 1 && stats[0].paths == 4. * spp * side * side);
    itn_image_free(&first);
}

static void test_threads(void) {
    enum { CHUNKS = ITN__UNIT_PATHS / 4 + 900 }; /* two units a tile, the second one shorter */
    check_threads(GROUP, FAST_SIZE, 150, 0);
    if (STRIDE == 1) check_threads(COLOUR, 2, CHUNKS, 0);
    CHECK_CATCHES(check_threads(MATCHED, FAST_SIZE, 150, 1));
}

/* ---- safe flights ---------------------------------------------------------------------------- */

/* Walks in lanes that look around as the fast walk does; each flight that they take for free is
   traced through the tree. */
typedef struct herd {
    const itn_scene *scene;
    const itn__voxels *voxels;
    float *theta;
    itn__rng rng;
    itn__vectors p, d;
    itn__floats distance;
    itn__free_space space;
    itn__place places[ITN__LANES];
    double free, cached, wrong, unproven; /* flights */
} herd;

static void set_lane(itn__vectors *v, int k, itn_vec3 value) {
    ITN__LANE(v->x, k) = value.x, ITN__LANE(v->y, k) = value.y, ITN__LANE(v->z, k) = value.z;
}

/* Extinction where a walk is; 0 outside of media. */
static float extinction(const herd *f, int k) {
    const itn__medium *medium = itn__medium_of(f->scene, f->places[k].inside);
    return medium ? f->theta[medium->sigma_t[0]] : 0;
}

/* Sends a lane's walk straight on from the camera until it is in a medium. Returns 0 if it comes
   to none. */
static int enter(herd *f, int k) {
    const itn_scene *scene = f->scene;
    itn__place *place = &f->places[k];
    int x = (int)(itn__uniform(&f->rng) * (float)scene->film.width), crossing;
    int y = (int)(itn__uniform(&f->rng) * (float)scene->film.height);
    float u = itn__uniform(&f->rng), v = itn__uniform(&f->rng);
    itn_ray ray = itn__camera_ray(scene, x, y, u, v);
    place->sides = scene->sides, place->crossed_count = 0;
    itn__settle(scene, place);
    for (crossing = 0; crossing < 8 && !(extinction(f, k) > 0 && itn__uniform(&f->rng) < .7f);
         crossing++) {
        itn_hit hit;
        itn__event event;
        ray.tmax = INFINITY;
        if (!itn__next_hit(scene, place, &ray, &hit)) return 0;
        event = itn__meet_faces(scene, f->theta, place, &ray, &hit);
        ray.origin = itn__hit_point(scene->bvh, &hit);
        if (!scene->objects[scene->bvh->triangles[hit.triangle].object].closed) return 0;
        itn__leave_faces(scene, place, &event, ray.origin, 1);
    }
    set_lane(&f->p, k, ray.origin), set_lane(&f->d, k, ray.direction);
    ITN__LANE(f->space.half, k) = -1;
    return extinction(f, k) > 0;
}

/* Draws flights: of all lengths around the mean free path, now and then without a turn. */
static void aim(herd *f) {
    int k;
    for (k = 0; k < ITN__LANES; k++) {
        float u = itn__uniform(&f->rng), v = itn__uniform(&f->rng), w = itn__uniform(&f->rng), x, y;
        itn_vec3 d = itn__lane_vector(&f->d, k);
        if (w > .1f)
            set_lane(&f->d, k, one_sample_phase(d, w > .5f ? .8f : -.2f, u, v, &x, &y));
        w = itn__uniform(&f->rng);
        ITN__LANE(f->distance, k) = one_flight(extinction(f, k), itn__uniform(&f->rng)) *
                                    (w < .3f ? .1f : w < .7f ? 1 : 4);
    }
}

/* A flight that was not proven free goes on or through, as the tree says. */
static void fly(herd *f, int k) {
    itn_ray ray;
    itn_hit hit;
    ray.origin = itn__lane_vector(&f->p, k), ray.direction = itn__lane_vector(&f->d, k);
    ray.tmax = ITN__LANE(f->distance, k);
    f->unproven++;
    ITN__LANE(f->space.half, k) = -1;
    if (!itn__next_hit(f->scene, &f->places[k], &ray, &hit)) {
        set_lane(&f->p, k, itn__along(ray.origin, ray.tmax, ray.direction));
    } else { /* in, out, or back where it came from */
        int object = f->scene->bvh->triangles[hit.triangle].object;
        itn__event event = itn__meet_faces(f->scene, f->theta, &f->places[k], &ray, &hit);
        itn_vec3 point = itn__hit_point(f->scene->bvh, &hit);
        set_lane(&f->p, k, point);
        if (itn__uniform(&f->rng) < .5f) {
            itn__begin_at(&f->places[k].sides, itn__face_triangle(f->scene, event.faces[0]), point,
                          1);
            set_lane(&f->d, k, itn__scale(ray.direction, -1));
        } else if (f->scene->objects[object].closed) {
            itn__leave_faces(f->scene, &f->places[k], &event, point, 1);
        }
    }
    while (!(extinction(f, k) > 0) || !itn__within(f->scene, itn__lane_vector(&f->p, k)))
        while (!enter(f, k)) {}
}

/* Traces a flight that was taken for free. */
static void retrace(herd *f, int k, const itn__vectors *to) {
    itn_ray ray;
    itn_hit hit;
    ray.origin = itn__lane_vector(&f->p, k), ray.direction = itn__lane_vector(&f->d, k);
    ray.tmin = -itn__slack(f->scene, ray.origin), ray.tmax = ITN__LANE(f->distance, k);
    f->free++;
    f->wrong += itn__bvh_trace(f->scene->bvh, &ray, &f->places[k].sides, 0, &hit);
    f->places[k].crossed_count = 0;
    set_lane(&f->p, k, itn__lane_vector(to, k));
}

static void take_step(herd *f) {
    itn__ints all = itn__splat_int(-1), safe;
    itn__vectors q;
    itn__floats nq;
    unsigned bits;
    int k;
    aim(f);
    q = itn__valong(f->p, f->distance, f->d);
    safe = itn__free_flight(&f->space, q, f->d, &nq);
    f->cached += itn__count_bits(itn__mask_bits(safe));
    itn__look_around(f->voxels, f->p, all & ~safe, &f->space, NULL, NULL);
    safe = itn__free_flight(&f->space, q, f->d, &nq);
    f->space.np = itn__select(safe, nq, f->space.np);
    bits = itn__mask_bits(safe);
    for (k = 0; k < ITN__LANES; k++)
        if (bits >> k & 1)
            retrace(f, k, &q);
        else
            fly(f, k);
}

/* The tables of a scene with so many cells; moved: as if its solids lay elsewhere. Returns the
   number of free flights. */
static double check_flights(int which, int resolution, double flights, double moved) {
    itn_scene *scene = make_scene(which, NULL);
    itn__voxels *voxels = NULL;
    itn_error error;
    float theta[64];
    herd f;
    int k;
    memset(&f, 0, sizeof f);
    stage_need(itn__tables_make(scene, resolution, &voxels, &error), &error);
    itn_parameter_values(scene, theta);
    voxels->lower.x += (float)moved * voxels->cell;
    f.scene = scene, f.voxels = voxels, f.theta = theta;
    f.rng = itn__rng_make(99, (uint64_t)which, (uint64_t)(3 * resolution));
    for (k = 0; k < ITN__LANES; k++)
        while (!enter(&f, k)) {}
    while (f.free + f.unproven < flights) take_step(&f);
    if (verbose && !check_quiet)
        printf("%-24s %3d cells: %.3f of flights are free (%.3f known before)\n",
               kind_names[which], resolution, f.free / (f.free + f.unproven),
               f.cached / (f.free + f.unproven));
    check_report(f.wrong == 0, __FILE__, __LINE__,
                 "%s, %d cells: of %g flights taken for free %g are not", kind_names[which],
                 resolution, f.free, f.wrong);
    itn__free_blocks(&scene->context, voxels);
    itn_scene_free(scene);
    return f.free;
}

static void test_flights(void) {
    static const int resolutions[3] = {16, 32, 128};
    double flights = check_long() ? 6e6 : 1e4, all = 0;
    int which, k;
    if (STRIDE > 1) flights = 2e3;
    for (which = 0; which < KINDS; which += STRIDE)
        for (k = 0; k < 3; k++) all += check_flights(which, resolutions[k], flights, 0);
    if (verbose) printf("%g flights are free\n", all);
    CHECK(all > (check_long() ? 1e8 : .25 * 3 * KINDS / STRIDE * flights));
    CHECK_CATCHES(check_flights(MATCHED, 32, 3e4, .3));
    CHECK_CATCHES(check_flights(GROUP, 32, 3e4, -.3));
}

/* ---- images ---------------------------------------------------------------------------------- */

enum { BLOCK = 4, MOST_BLOCKS = 3 * FAST_PIXELS / (BLOCK * BLOCK) };

/* Means over blocks of pixels and their variances, channel by channel; returns their number. */
static int block_means(const itn_image *image, double *means, double *variances) {
    int pixels = image->width * image->height, count = 0, c, x, y;
    for (c = 0; c < image->plane_count / 2; c++) {
        const float *plane = image->pixels + c * pixels;
        const float *variance = plane + image->plane_count / 2 * pixels;
        int first = count;
        for (y = 0; y < image->height; y++)
            for (x = 0; x < image->width; x++) {
                int block = first + y / BLOCK * ((image->width + BLOCK - 1) / BLOCK) + x / BLOCK;
                for (; count <= block; count++) means[count] = variances[count] = 0;
                means[block] += plane[y * image->width + x];
                variances[block] += variance[y * image->width + x];
            }
    }
    return count;
}

/* Chi^2 of the blocks' differences, and the difference of all, in standard errors; each channel by
   itself, since one path gives all of them. */
static void compare_images(const char *name, const itn_image *a, const itn_image *b) {
    double means[2][MOST_BLOCKS], variances[2][MOST_BLOCKS];
    int channels = a->plane_count / 2, blocks = block_means(a, means[0], variances[0]) / channels;
    int c, k;
    block_means(b, means[1], variances[1]);
    for (c = 0; c < channels; c++) {
        double chi2 = 0, sum = 0, square = 0;
        int felt = 0;
        for (k = c * blocks; k < (c + 1) * blocks; k++) {
            double difference = means[1][k] - means[0][k];
            double variance = variances[0][k] + variances[1][k];
            sum += difference, square += variance;
            if (!(variance > 1e-10 * means[0][k] * means[0][k])) { /* nothing is random there */
                CHECK_NEAR(means[1][k], means[0][k], 2e-5 * means[0][k]);
                continue;
            }
            chi2 += difference * difference / variance, felt++;
        }
        if (verbose && !check_quiet)
            printf("%-30s %2d blocks: chi^2 %5.1f, mean %4.1f sigma\n", name, felt, chi2,
                   sum / sqrt(square));
        check_report(chi2 <= felt + 4 * sqrt(2. * felt) + 4, __FILE__, __LINE__,
                     "%s: chi^2 of %d blocks is %.1f", name, felt, chi2);
        check_report(fabs(sum) <= 4 * sqrt(square) + 1e-6, __FILE__, __LINE__,
                     "%s: the mean is off by %.1f sigma", name, sum / sqrt(square));
    }
}

/* The fast walk with both samplers, 1 and 4 walks a ray, against the reference. planted: another
   scene of the same size. */
static void check_images(int which, int planted) {
    itn_scene *scene = make_scene(which, NULL), *other = planted < 0 ? scene : make_scene(planted, NULL);
    itn_render_options options = ITN_ZERO;
    itn_image expected, image;
    int k;
    options.spp = check_long() ? 3000 : which == WHITE || which == DENSE ? 30
                : which == SPECTRA || which >= MADE ? 240 : 60; /* rare bright paths */
    if (STRIDE > 1) options.spp /= 4;
    options.mode = ITN_MODE_REFERENCE, options.seed = 1;
    fast_render(scene, &options, &expected);
    options.mode = ITN_MODE_FAST;
    for (k = 0; k < 4; k++) {
        char name[64];
        options.walks = k % 2 ? 4 : 1, options.seed++;
        options.sampler = k < 2 ? ITN_SAMPLER_RANDOM : ITN_SAMPLER_SOBOL;
        sprintf(name, "%.40s %s %d", kind_names[which], k < 2 ? "random" : "Sobol", options.walks);
        fast_render(other, &options, &image);
        compare_images(name, &expected, &image);
        itn_image_free(&image);
    }
    itn_image_free(&expected);
    if (other != scene) itn_scene_free(other);
    itn_scene_free(scene);
}

static void test_images(void) {
    int which;
    for (which = 0; which < KINDS; which += STRIDE)
        if (!only_reference(which)) check_images(which, -1);
    CHECK_CATCHES(check_images(ROUGH, SMOOTH));
    CHECK_CATCHES(check_images(MATCHED, WHITE));
}

/* ---- guided directions ----------------------------------------------------------------------- */

static itn_vec3 any_direction(itn__rng *rng) {
    float x = itn__uniform(rng) - .5f, y = itn__uniform(rng) - .5f, z = itn__uniform(rng) - .5f;
    return itn__direction(itn__vec3(x, y, z));
}

/* With their weights, guided directions have the moments of the phase function: its integral, the
   mean cosine g, and what goes out of the plane steeply, which is also found by the phase function
   alone. planted: the density of the guide is twice what is drawn by. */
static void check_guide(int which, int planted) {
    enum { ROUNDS = 160000 / ITN__LANES };
    itn_scene *scene = make_scene(which, NULL);
    itn_render_options options = ITN_ZERO;
    itn__rng rng = itn__rng_make(11, (uint64_t)which, 0);
    double sums[3] = {0}, squares[3] = {0}, expected[3] = {1, 0, 0}, turned = 0;
    double n = ROUNDS * ITN__LANES;
    inside in;
    int round, k, c;
    options.spp = 4, options.walks = 1;
    open_render(&in, scene, &options);
    itn__substance *medium = &in.render.substances[1];
    CHECK(medium->guided > .05f && medium->index > 1 && !medium->lit);
    for (k = 0; planted && k < scene->guide.width * scene->guide.height; k++)
        scene->guide.grid.density[k] *= 2;
    for (round = 0; round < ROUNDS; round++) {
        itn__state s = ITN_ZERO;
        itn__vectors old, up;
        itn__floats x, y, u, v, phase_only, cosine;
        for (k = 0; k < ITN__LANES; k++) { /* just below a plane through the middle, up any way */
            set_lane(&up, k, any_direction(&rng)), set_lane(&old, k, any_direction(&rng));
            ITN__LANE(s.level, k) = itn__uniform(&rng) * medium->mean_free_path;
            ITN__LANE(u, k) = itn__uniform(&rng), ITN__LANE(v, k) = itn__uniform(&rng);
            ITN__LANE(s.key0, k) = (int32_t)itn__rng_bits(&rng);
            ITN__LANE(s.beta[0], k) = 1;
        }
        s.p = itn__splat_vector(itn__vec3(0, 0, 0)), s.up = up;
        s.d = itn__phase_turn(&medium->phase, old, u, v, &x, &y);
        phase_only = itn__vdot(s.d, up);
        itn__floats weight = itn__guide_lanes(in.render.workers[0].crowd, medium, &s, &old,
                                              itn__splat_int(-1), &x, &y);
        cosine = itn__vdot(s.d, up);
        for (k = 0; k < ITN__LANES; k++) {
            double w = ITN__LANE(weight, k), f[3];
            f[0] = w, f[1] = w * (1 - (double)ITN__LANE(x, k));
            f[2] = w * (ITN__LANE(cosine, k) > .9f) - (ITN__LANE(phase_only, k) > .9f);
            turned += ITN__LANE(cosine, k) != ITN__LANE(phase_only, k);
            for (c = 0; c < 3; c++) sums[c] += f[c] / n, squares[c] += f[c] * f[c] / n;
        }
    }
    expected[1] = medium->moment[1];
    CHECK(turned > .02 * n);
    for (c = 0; c < 3; c++) {
        double sigma = sqrt((squares[c] - sums[c] * sums[c]) / n);
        check_report(fabs(sums[c] - expected[c]) <= 4 * sigma + 1e-5, __FILE__, __LINE__,
                     "%s: moment %d is %.5f +- %.5f, not %.5f", kind_names[which], c, sums[c], sigma,
                     expected[c]);
    }
    close_render(&in);
    itn_scene_free(scene);
}

/* The guide is that of the light's shape: a light of any strength has the same. */
static void test_guide_of_any_light(void) {
    static const double strengths[3] = {1e-20, 1, 1e17};
    double guided[3];
    int k, i;
    for (k = 0; k < 3; k++) {
        itn_mesh ball = solids_sphere(1, 2);
        itn_image map = stage_patch(3, .6, .3, 8);
        itn_scene *scene = NULL;
        itn_error error;
        stage s;
        for (i = 0; i < map.plane_count * map.width * map.height; i++)
            map.pixels[i] = (float)(map.pixels[i] * strengths[k] / 8);
        fill_stage(&s, SMOOTH, &ball, NULL, NULL, &map, NULL);
        s.lights[0].scale = k == 2 ? 1e6f : 1;
        stage_need(itn_scene_create(&s.desc, NULL, &scene, &error), &error);
        guided[k] = scene->guided;
        itn_scene_free(scene), itn_image_free(&map), itn_mesh_free(&ball);
    }
    CHECK(guided[1] > 0 && fabs(guided[0] - guided[1]) < 1e-4 && fabs(guided[2] - guided[1]) < 1e-4);
}

/* ---- stated errors --------------------------------------------------------------------------- */

/* The stated variance of blocks is that found between seeds. Returns the mean stated one. */
static double check_variance(int which, itn_sampler sampler, int walks, int spp, double planted) {
    enum { SEEDS = 32 };
    itn_context context = ITN_ZERO;
    itn_scene *scene;
    itn_render_options options = ITN_ZERO;
    double sums[MOST_BLOCKS] = {0}, squares[MOST_BLOCKS] = {0}, means[MOST_BLOCKS];
    double variances[MOST_BLOCKS], told[MOST_BLOCKS] = {0}, stated = 0, found = 0, spread = 0;
    int blocks = 0, seed, k;
    context.threads = 1; /* each render is small */
    scene = make_scene(which, &context);
    options.spp = spp, options.sampler = sampler, options.walks = walks;
    for (seed = 0; seed < SEEDS; seed++) {
        itn_image image;
        options.seed = 1000 + (uint64_t)seed;
        fast_render(scene, &options, &image);
        blocks = block_means(&image, means, variances);
        for (k = 0; k < blocks; k++) {
            sums[k] += means[k], squares[k] += means[k] * means[k];
            told[k] += planted * variances[k] / SEEDS;
        }
        itn_image_free(&image);
    }
    for (k = 0; k < blocks; k++) {
        double variance = (squares[k] - sums[k] * sums[k] / SEEDS) / (SEEDS - 1);
        found += variance, stated += told[k];
        spread += 2 * told[k] * told[k] / (SEEDS - 1); /* of a variance, if the told one is true */
    }
    if (verbose && !check_quiet)
        printf("%-24s %s %d walks: stated %.4g, found %.4g +- %.2g\n", kind_names[which],
               sampler == ITN_SAMPLER_SOBOL ? "Sobol " : "random", walks, stated, found,
               sqrt(spread));
    check_report(fabs(stated - found) <= 4 * sqrt(spread), __FILE__, __LINE__,
                 "%s, %d walks: variance %.4g, found %.4g +- %.2g", kind_names[which], walks,
                 stated, found, sqrt(spread));
    itn_scene_free(scene);
    return stated;
}

static void test_variances(void) {
    static const int kinds[3] = {ROUGH, MATCHED, BLACK};
    static const int spps[2] = {16, 25};
    int k, w;
    for (k = 0; k < 3 && STRIDE == 1; k++)
        for (w = 1; w <= 4; w += 3) {
            double random = check_variance(kinds[k], ITN_SAMPLER_RANDOM, w, spps[k % 2], 1);
            double sobol = check_variance(kinds[k], ITN_SAMPLER_SOBOL, w, spps[k % 2], 1);
            CHECK(sobol < random);
        }
    CHECK_CATCHES(check_variance(ROUGH, ITN_SAMPLER_SOBOL, 4, 16, .4));
}

/* ---- edges ----------------------------------------------------------------------------------- */

/* A black box before a white sky, in 16x16 pixels; its sides are at +-BOX_EDGE of half of the film. */
#define BOX_EDGE (.31 / (1.5 * tan(20 * 3.14159265358979 / 180)))
static itn_scene *black_box(itn_mesh *box, itn_filter filter, float deviation) {
    stage s;
    *box = solids_box(solids_vec3(-.31, -.31, -.5), solids_vec3(.31, .31, .5));
    stage_begin(&s, 16, 2, 40);
    s.desc.film.filter = filter, s.desc.film.deviation = deviation;
    stage_diffuse(&s, "black", 0), stage_object(&s, box, NULL, "black");
    stage_constant(&s, "sky", 1);
    return stage_make(&s);
}

/* The share of the film that is black is known. */
static void check_edges(itn_filter filter, itn_sampler sampler, double wide) {
    itn_mesh box;
    itn_render_options options = ITN_ZERO;
    itn_image image;
    itn_scene *scene = black_box(&box, filter, 0);
    double share = wide * BOX_EDGE, sum = 0, variance = 0;
    int between = 0, k;
    options.sampler = sampler, options.seed = 7;
    options.spp = 64, fast_render(scene, &options, &image);
    for (k = 0; k < 16 * 16; k++) {
        between += image.pixels[k] > 0 && image.pixels[k] < 1;
        sum += image.pixels[k] / 256, variance += image.pixels[256 + k] / (256. * 256);
    }
    CHECK(between >= 20);
    CHECK_MEAN(sum, sqrt(variance), 1 - share * share, 4, .003);
    itn_image_free(&image), itn_scene_free(scene), itn_mesh_free(&box);
}

/* The share of a Gaussian about x, of this deviation, that lies between -edge and edge. */
static double share_between(double x, double edge, double deviation) {
    double root = deviation * sqrt(2);
    return (erf((edge - x) / root) + erf((edge + x) / root)) / 2;
}

/* The same box through a Gaussian filter: every pixel sees as much of it as the filter around its
   middle covers. planted: factor to the deviation. */
static void check_blur(float deviation, double planted) {
    itn_mesh box;
    itn_render_options options = ITN_ZERO;
    itn_image image;
    itn_scene *scene = black_box(&box, ITN_FILTER_GAUSSIAN, deviation);
    double edge = 8 * BOX_EDGE, width = planted * (deviation > 0 ? deviation : .5), chi = 0;
    int between = 0, x, y;
    options.spp = 1024, options.walks = 1, options.sampler = ITN_SAMPLER_RANDOM, options.seed = 7;
    fast_render(scene, &options, &image);
    for (y = 0; y < 16; y++)
        for (x = 0; x < 16; x++) {
            double share = share_between(x - 7.5, edge, width) * share_between(y - 7.5, edge, width);
            double off = image.pixels[16 * y + x] - (1 - share);
            if (share < .01 || share > .99) continue;
            chi += off * off / (share * (1 - share) / 1024), between++;
        }
    check_report(between > 20 && fabs(chi / between - 1) < 4.5 * sqrt(2. / between), __FILE__,
                 __LINE__, "deviation %g: mean square %g of %d", (double)deviation, chi / between,
                 between);
    itn_image_free(&image), itn_scene_free(scene), itn_mesh_free(&box);
}

static void test_edges(void) {
    check_edges(ITN_FILTER_BOX, ITN_SAMPLER_SOBOL, 1);
    check_edges(ITN_FILTER_BOX, ITN_SAMPLER_RANDOM, 1);
    check_edges(ITN_FILTER_GAUSSIAN, ITN_SAMPLER_SOBOL, 1);
    CHECK_CATCHES(check_edges(ITN_FILTER_BOX, ITN_SAMPLER_SOBOL, 1.01));
    check_blur(0, 1);
    check_blur(.75f, 1);
    check_blur(2, 1);
    CHECK_CATCHES(check_blur(.75f, 1.1));
}

/* What the fast walk cannot differentiate in, it refuses, and AUTO leaves to the reference; all else
   it takes. planted: values that it takes are expected to be refused. */
static void test_refusals(int planted) {
    static const struct {
        const char *name;
        float value;
        int taken;
    } cases[] = {{"glass.ior", 1.4f, 0},     {"glass.alpha", .3f, 1}, {"m.sigma_t", 3, 1},
                 {"m.sigma_t", 1e-3f, 0},    {"m.albedo", .5f, 1},    {"m.albedo", 0, 0},
                 {"m.g", 0, 1},              {"floor.reflectance", .5f, 1},
                 {"floor.reflectance", 0, 0}, {"room.scale", 1, 1},   {"room.scale", 0, 0}};
    itn_mesh ball = solids_sphere(1, 1);
    itn_scene *scene;
    float theta[16];
    stage s;
    size_t k;
    stage_begin(&s, 4, 4, 35);
    stage_medium(&s, "m", 3, .8, .3);
    stage_dielectric(&s, "glass", 1.4, .3);
    stage_diffuse(&s, "floor", .5);
    stage_object(&s, NULL, NULL, "floor");
    stage_object(&s, &ball, "m", "glass");
    stage_constant(&s, "room", 1);
    scene = stage_make(&s);
    for (k = 0; k < sizeof cases / sizeof cases[0]; k++) {
        itn_render_options options = ITN_ZERO;
        itn_image image = ITN_ZERO;
        itn_error error = ITN_ZERO;
        int parameter = itn_parameter_find(scene, cases[k].name);
        itn_result expected = cases[k].taken && !planted ? ITN_OK : ITN_ERROR_UNSUPPORTED;
        itn_parameter_values(scene, theta);
        theta[parameter] = cases[k].value;
        options.spp = 1, options.mode = ITN_MODE_FAST;
        check_report(itn_render(scene, theta, &options, &parameter, 1, &image, &error) == expected,
                     __FILE__, __LINE__, "%s at %g, fast: '%s'", cases[k].name,
                     (double)cases[k].value, error.message);
        CHECK(expected == ITN_OK || (!image.pixels && strstr(error.message, cases[k].name)));
        itn_image_free(&image);
        options.mode = ITN_MODE_AUTO;
        CHECK(itn_render(scene, theta, &options, &parameter, 1, &image, &error) == ITN_OK);
        itn_image_free(&image);
    }
    itn_scene_free(scene);
    itn_mesh_free(&ball);
}

/* So are limits of scatterings and derivatives by the values of an image. */
static void test_limits(void) {
    itn_scene *scene = make_scene(TEXTURE, NULL);
    itn_render_options options = ITN_ZERO;
    itn_image image = ITN_ZERO;
    itn_error error = ITN_ZERO;
    float weights[FAST_PIXELS] = {1};
    int k;
    options.spp = 1;
    for (k = 0; k < 2; k++) {
        itn_result expected = k ? ITN_OK : ITN_ERROR_UNSUPPORTED;
        options.mode = k ? ITN_MODE_AUTO : ITN_MODE_FAST, options.max_scatter = 1;
        CHECK(itn_render(scene, NULL, &options, NULL, 0, &image, &error) == expected);
        CHECK(k || (!image.pixels && strstr(error.message, "limit")));
        itn_image_free(&image);
        options.max_scatter = 0;
        CHECK(itn_render_texel_gradient(scene, NULL, &options, weights, "map", &image, &error) ==
              expected);
        CHECK(k || (!image.pixels && strstr(error.message, "values of an image")));
        itn_image_free(&image);
    }
    itn_scene_free(scene);
}

/* Two faces of an edge, one .32 of a millionth ahead, the other .30 behind, between which lies the
   slack: rays that go on from where rounding puts their hits go to and fro for ever. planted: such
   ones. */
static void test_no_way_back(int planted) {
    static const float points[15] = {0.466697663f, 0.264951319f, 0.0059862202f, 0.467285037f,
                                     0.278485775f, 0.00191733637f, 0.486884177f, 0.254965693f,
                                     -0.0255570672f, 0.452105671f, 0.255567253f, -0.0102369376f,
                                     0.497f, 0.244f, 0.008f};
    static const int faces[18] = {0, 1, 2, 0, 2, 3, 2, 1, 4, 1, 0, 4, 0, 3, 4, 3, 2, 4};
    itn_mesh mesh, box = solids_box(solids_vec3(-1, -1, -1), solids_vec3(1, 1, 1));
    itn_scene *scene;
    itn__place place = ITN_ZERO;
    itn_ray ray;
    itn_hit hit;
    stage s;
    int met;
    CHECK(!itn_mesh_create(5, 6, 0, NULL, &mesh, NULL));
    memcpy(mesh.positions, points, sizeof points), memcpy(mesh.triangles, faces, sizeof faces);
    stage_begin(&s, 4, 4, 35);
    stage_medium(&s, "m", 5, .9, .2);
    stage_object(&s, &mesh, "m", NULL);
    stretch(stage_object(&s, &box, "m", NULL), .1, .1, .1, .8, .8, .8); /* the origin stays */
    stretch(stage_object(&s, &box, "m", NULL), .1, .1, .1, -.8, -.8, -.8);
    stage_constant(&s, NULL, 1);
    scene = stage_make(&s);
    scene->radius = 0.648690403f;
    place.sides = scene->sides, place.inside = place.refracting = -1;
    ray.origin = itn__vec3(0.476488948f, 0.260107726f, -0.0093138963f);
    ray.direction = itn__vec3(0.511182249f, 0.852113903f, 0.112225585f);
    for (ray.tmax = INFINITY, met = 0; met < 9; met++) {
        itn__event event;
        if (!itn__next_hit(scene, &place, &ray, &hit)) break;
        event = itn__meet_faces(scene, NULL, &place, &ray, &hit);
        ray.origin = planted ? itn__hit_point(scene->bvh, &hit)
                             : itn__passed_point(scene->bvh, ray.origin, ray.direction, &hit);
        itn__leave_faces(scene, &place, &event, ray.origin, 1);
    }
    CHECK(met == 2 && place.inside < 0);
    itn_scene_free(scene);
    itn_mesh_free(&mesh), itn_mesh_free(&box);
}

int main(void) {
    verbose = getenv("ITN_VERBOSE") != NULL;
    test_paths();
    test_control();
    test_parts();
    test_tables();
    test_threads();
    test_flights();
    test_images();
    test_variances();
    check_guide(SMOOTH, 0);
    CHECK_CATCHES(check_guide(SMOOTH, 1));
    test_guide_of_any_light();
    test_edges();
    test_no_way_back(0);
    CHECK_CATCHES(test_no_way_back(1));
    test_limits();
    test_refusals(0);
    CHECK_CATCHES(test_refusals(1));
    return check_end("fast");
}
