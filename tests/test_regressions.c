/* Faults that once were there, or nearly: one short function each, named by what must hold. */
#ifndef ITN_APART
#define ITN_IMPLEMENTATION
#endif
#include "../itn.h"

#include <float.h>
#include <limits.h>
#include <pthread.h>
#include <time.h>

#include "check.h"
#include "solids.h"
#include "stage.h"

/* ---- helpers --------------------------------------------------------------------------------- */

/* Expects a scene to be refused with `wanted`, the output left alone. */
static void check_refused(const stage *s, const itn_context *context, itn_result wanted,
                          int line) {
    itn_scene *scene = (itn_scene *)(void *)&wanted, *before = scene;
    itn_error error;
    itn_result result;
    memset(&error, 0, sizeof error);
    result = itn_scene_create(&s->desc, context, &scene, &error);
    check_report(result == wanted && (!wanted || (error.code == wanted && error.message[0])),
                 __FILE__, line, "expected '%s', got '%s': %s", itn_result_text(wanted),
                 itn_result_text(result), error.message);
    check_report(result == ITN_OK || scene == before, __FILE__, line, "scene touched");
    if (result == ITN_OK) itn_scene_free(scene);
}
#define REFUSED(s) check_refused(s, NULL, ITN_ERROR_ARGUMENT, __LINE__)

/* Renders a stage in a mode, with the derivative in `name` unless that is NULL. */
static itn_image picture_as(const stage *s, int spp, const char *name, itn_mode mode) {
    itn_scene *scene = stage_make(s);
    itn_render_options options = ITN_ZERO;
    itn_image image = ITN_ZERO;
    itn_error error;
    int parameter = name ? itn_parameter_find(scene, name) : 0;
    options.spp = spp, options.seed = 1, options.mode = mode;
    stage_need(itn_render(scene, NULL, &options, &parameter, name ? 1 : 0, &image, &error),
               &error);
    itn_scene_free(scene);
    return image;
}

static itn_image picture(const stage *s, int spp, const char *name) {
    return picture_as(s, spp, name, ITN_MODE_AUTO);
}

/* Mean over the film by the fast walk, which has to be that of the reference. */
static solids_mean brightness(const stage *s, int spp) {
    itn_image image = picture_as(s, spp, NULL, ITN_MODE_REFERENCE);
    solids_mean reference = solids_plane_mean(&image, "Y", "Variance.Y"), mean;
    itn_image_free(&image);
    image = picture(s, spp, NULL);
    mean = solids_plane_mean(&image, "Y", "Variance.Y");
    itn_image_free(&image);
    CHECK(fabs(mean.value - reference.value) <= 5 * hypot(mean.error, reference.error) +
                                                    1e-5 * mean.value);
    return mean;
}

/* Values of an image's first plane that are not in [0, most]. */
static int values_out_of(const itn_image *image, double most) {
    int i, bad = 0;
    for (i = 0; i < image->width * image->height; i++)
        bad += !(image->pixels[i] >= 0 && image->pixels[i] <= most);
    return bad;
}

/* Largest difference of two images' values in the planes from..to. */
static double difference(const itn_image *a, const itn_image *b, int from, int to) {
    size_t plane = (size_t)a->width * (size_t)a->height, i;
    double worst = 0;
    for (i = plane * (size_t)from; i < plane * (size_t)(to + 1); i++) {
        double off = fabs((double)a->pixels[i] - (double)b->pixels[i]);
        if (!(off <= worst)) worst = off;
    }
    return worst;
}

/* An absorbing or scattering box of half side 1 around the origin, in a constant light of 1. */
static void begin_box(stage *s, const itn_mesh *mesh, double sigma_t, double albedo) {
    stage_begin(s, 4, 4, 20);
    stage_medium(s, "m", sigma_t, albedo, 0);
    stage_object(s, mesh, "m", NULL);
    stage_constant(s, NULL, 1);
}

static itn_mesh unit_box(void) {
    return solids_box(solids_vec3(-1, -1, -1), solids_vec3(1, 1, 1));
}

/* The same without its side z = 1. */
static itn_mesh open_box(void) {
    itn_mesh box = unit_box();
    int i;
    for (i = 0; i < 6; i++) box.triangles[6 + i] = box.triangles[30 + i];
    box.triangle_count -= 2;
    return box;
}

/* Turns a mesh inside out. */
static void turn_over(itn_mesh *mesh) {
    int i;
    for (i = 0; i < mesh->triangle_count; i++) {
        int swap = mesh->triangles[3 * i + 1];
        mesh->triangles[3 * i + 1] = mesh->triangles[3 * i + 2];
        mesh->triangles[3 * i + 2] = swap;
    }
}

/* A diffuse floor below an eye that looks straight down. */
static void begin_floor(stage *s, int size, double reflectance) {
    stage_begin(s, size, 0, 10);
    s->desc.camera.eye.y = 3, s->desc.camera.up.z = 1;
    stage_diffuse(s, "floor", reflectance);
    stage_object(s, NULL, NULL, "floor");
}

/* ---- meshes and places ----------------------------------------------------------------------- */

/* Two boxes as one mesh. */
static itn_mesh both_of(const itn_mesh *a, const itn_mesh *b) {
    itn_mesh both;
    itn_error error;
    int i;
    stage_need(itn_mesh_create(16, 24, 0, NULL, &both, &error), &error);
    memcpy(both.positions, a->positions, 24 * sizeof(float));
    memcpy(both.positions + 24, b->positions, 24 * sizeof(float));
    for (i = 0; i < 36; i++)
        both.triangles[i] = a->triangles[i], both.triangles[36 + i] = 8 + b->triangles[i];
    return both;
}

/* Parts of one mesh that overlap, lie in each other or are inside out are refused, with `force` taken;
   those that stand apart, touch or are cavities are parts of a solid: of light that passes both, the
   medium takes what its length in them takes. planted: moves the second part. */
static void test_parts_of_a_mesh(double planted) {
    static const struct {
        double lower[3], upper[3];
        int turned, refused;
        double way; /* along x */
    } parts[] = {{{2, -1, -1}, {4, 1, 1}, 0, 0, 4},       {{1, -1, -1}, {3, 1, 1}, 0, 0, 4},
                 {{.5, -1, -1}, {2.5, 1, 1}, 0, 1, 0},    {{-.5, -.5, -.5}, {.5, .5, .5}, 0, 1, 0},
                 {{-.5, -.5, -.5}, {.5, .5, .5}, 1, 0, 1}, {{2, -.5, -.5}, {3, .5, .5}, 1, 1, 0}};
    int k;
    for (k = 0; k < 6; k++) {
        const double *a = parts[k].lower, *b = parts[k].upper;
        itn_mesh first = unit_box(), both, second;
        stage s;
        second = solids_box(solids_vec3(a[0] + planted, a[1], a[2]),
                            solids_vec3(b[0] + planted, b[1], b[2]));
        if (parts[k].turned) turn_over(&second);
        both = both_of(&first, &second);
        begin_box(&s, &both, 1, 0);
        s.desc.camera.eye = solids_vec3(9, 0, 0), s.desc.camera.fov = .01f;
        check_refused(&s, NULL, parts[k].refused ? ITN_ERROR_MESH : ITN_OK, __LINE__);
        if (parts[k].refused) {
            s.objects[0].force = 1;
            check_refused(&s, NULL, ITN_OK, __LINE__);
        } else if (planted == 0) {
            solids_mean mean = brightness(&s, 8192);
            CHECK_MEAN(mean.value, mean.error, exp(-parts[k].way), 4.5, .002);
        }
        itn_mesh_free(&first), itn_mesh_free(&second), itn_mesh_free(&both);
    }
}

/* Thin parts that overlap are refused too: two rods in a line, at a slant, so that hardly a line
   through the box of both meets them. planted: how far the second stands from its place. */
static void test_thin_parts(double planted) {
    int k;
    for (k = 0; k < 2; k++) {
        double from = (k ? 0 : -1.5) + planted;
        itn_mesh rods[2], both;
        stage s;
        int i;
        rods[0] = solids_box(solids_vec3(-3, -.004, -.004), solids_vec3(0, .004, .004));
        rods[1] = solids_box(solids_vec3(from, -.004, -.004), solids_vec3(from + 3, .004, .004));
        both = both_of(&rods[0], &rods[1]);
        for (i = 0; i < 16; i++) { /* turned to the cube's diagonal, but for a slant of the sides */
            float *p = both.positions + 3 * i, x = p[0];
            p[0] = .6f * x, p[1] += .6f * x, p[2] += .5f * x;
        }
        begin_box(&s, &both, 1, 0);
        check_refused(&s, NULL, k ? ITN_OK : ITN_ERROR_MESH, __LINE__);
        itn_mesh_free(&rods[0]), itn_mesh_free(&rods[1]), itn_mesh_free(&both);
    }
}

/* Two cubes of one mesh share a face; the eye in one looks away from, or through, the other. */
static void test_eye_in_touching_cubes(double planted) {
    itn_mesh cubes[2], both;
    int order, across;
    cubes[0] = solids_box(solids_vec3(-1, -1, -2), solids_vec3(1, 1, 0));
    cubes[1] = solids_box(solids_vec3(-1, -1, 0), solids_vec3(1, 1, 2));
    for (order = 0; order < 2; order++)
        for (across = 0; across < 2; across++) {
            const itn_mesh *a = &cubes[order], *b = &cubes[1 - order];
            solids_mean mean;
            stage s;
            both = both_of(a, b);
            begin_box(&s, &both, 1, 0);
            s.desc.camera.eye.z = -1, s.desc.camera.target.z = across ? 10 : -10;
            s.desc.camera.fov = .01f;
            mean = brightness(&s, 4096);
            CHECK_MEAN(mean.value, mean.error, exp(across ? -3 : -1) + planted, 4.5, .003);
            itn_mesh_free(&both);
        }
    itn_mesh_free(&cubes[0]), itn_mesh_free(&cubes[1]);
}

/* In the plane where two cubes of one mesh touch another object begins: it is seen. */
static void test_object_between_touching_cubes(double planted) {
    itn_mesh cubes[2], both, plate = solids_box(solids_vec3(-1, -1, -.5), solids_vec3(1, 1, 0));
    solids_mean mean;
    stage s;
    cubes[0] = solids_box(solids_vec3(-1, -1, -1), solids_vec3(1, 1, 0));
    cubes[1] = solids_box(solids_vec3(-1, -1, 0), solids_vec3(1, 1, 1));
    both = both_of(&cubes[0], &cubes[1]);
    begin_box(&s, &both, .01, 0);
    stage_medium(&s, "n", 4, 0, 0), stage_object(&s, &plate, "n", NULL);
    s.desc.camera.fov = .01f;
    mean = brightness(&s, 4096);
    CHECK_MEAN(mean.value, mean.error, exp(-.015 - 2) + planted, 4.5, .003);
    itn_mesh_free(&both), itn_mesh_free(&plate);
    itn_mesh_free(&cubes[0]), itn_mesh_free(&cubes[1]);
}

/* A map of nothing but ones. */
static itn_image white_map(void) {
    itn_image map;
    itn_error error;
    int i;
    stage_need(itn_image_create(4, 3, 1, NULL, &map, &error), &error);
    strcpy(map.names[0], "Y");
    for (i = 0; i < 12; i++) map.pixels[i] = 1;
    return map;
}

/* After the last scattering light still comes from the ground: a map of ones is a light that is 1
   everywhere. planted: added to the latter. */
static void test_ground_after_last_scattering(double planted) {
    itn_mesh box = unit_box();
    itn_image map = white_map();
    solids_mean means[2][2];
    int light, way;
    for (light = 0; light < 2; light++)
        for (way = 0; way < 2; way++) {
            itn_render_options options = ITN_ZERO;
            itn_scene *scene;
            stage s;
            begin_box(&s, &box, 1, .9);
            stage_diffuse(&s, "floor", .9), stage_object(&s, NULL, NULL, "floor");
            if (light) s.desc.light_count = 0, stage_map(&s, NULL, &map);
            s.desc.camera.eye.y = 3;
            scene = stage_make(&s);
            options.spp = 1024, options.max_scatter = 1;
            solids_way(&options, 2 * way);
            solids_measure(scene, NULL, &options, NULL, 0, &means[light][way]);
            itn_scene_free(scene);
        }
    for (way = 0; way < 2; way++) {
        double error = hypot(means[0][way].error, means[1][way].error);
        CHECK_MEAN(means[1][way].value, error, means[0][way].value + planted, 4.5, .01);
    }
    itn_image_free(&map);
    itn_mesh_free(&box);
}

/* Where the phase function is narrow a last scattering is not left to the light's directions: a map
   that is white everywhere is as good as a constant light. planted: of the mean. */
static void test_narrow_last_scattering(double planted) {
    itn_mesh box = unit_box();
    itn_image map = white_map();
    solids_mean means[2];
    int light;
    for (light = 0; light < 2; light++) {
        itn_render_options options = ITN_ZERO;
        itn_scene *scene;
        stage s;
        begin_box(&s, &box, 1, .9);
        s.media[0].g = .95f, s.desc.camera.eye.y = 3;
        if (light) s.desc.light_count = 0, stage_map(&s, NULL, &map);
        scene = stage_make(&s);
        options.spp = 2048, options.max_scatter = 1;
        solids_measure(scene, NULL, &options, NULL, 0, &means[light]);
        itn_scene_free(scene);
    }
    CHECK(means[1].error < .02 * means[1].value);
    CHECK_MEAN(means[1].value, hypot(means[0].error, means[1].error),
               means[0].value * (1 + planted), 4.5, .01);
    itn_image_free(&map);
    itn_mesh_free(&box);
}

/* A medium that no object has does no harm, however many paths there are to learn from. */
static void test_unused_medium(void) {
    itn_image image;
    stage s;
    begin_floor(&s, 16, .5);
    stage_medium(&s, "m", 1, .9, 0), stage_constant(&s, NULL, 1);
    image = picture(&s, 640, NULL);
    CHECK_NEAR(image.pixels[0], .5, 1e-5);
    itn_image_free(&image);
}

/* What stands beyond the box of the solids is seen through a hole, and the medium ends before it:
   from within a forced box of a black medium, a wall of reflectance r a box's width behind its open
   side has r e^(-sigma_t way). planted: how much brighter the wall is. */
static void test_wall_behind_a_hole(double planted) {
    static const float up[12] = {1, 0, 0, 0, 0, 0, -1, 0, 0, 1, 0, 3}; /* y = 0 becomes z = 3 */
    itn_mesh box = open_box();
    int i;
    for (i = 0; i < 8; i++) { /* walk, reflectance, limit */
        double way = 1.5, sigma_t = 1, r = i & 2 ? .5 : 0, expected = r * exp(-sigma_t * way);
        itn_render_options options = ITN_ZERO;
        static const char *const names[1] = {"m.sigma_t"};
        itn_scene *scene;
        itn_object_desc *wall;
        solids_mean means[2];
        stage s;
        begin_box(&s, &box, sigma_t, 0);
        s.objects[0].force = 1;
        stage_diffuse(&s, "wall", r + planted), wall = stage_object(&s, NULL, NULL, "wall");
        wall->half_size = 1e4f, memcpy(wall->transform, up, sizeof up);
        s.desc.camera.eye = solids_vec3(0, 0, -.5), s.desc.camera.target = solids_vec3(0, 0, 1);
        s.desc.camera.fov = .01f;
        scene = stage_make(&s);
        options.spp = 4096, options.max_scatter = i & 4 ? 2 : 0;
        options.mode = ITN_MODE_AUTO; /* that is, the reference */
        solids_measure(scene, NULL, &options, names, 1, means);
        itn_scene_free(scene);
        CHECK_MEAN(means[0].value, means[0].error, expected, 4.5, .005);
        CHECK_MEAN(means[1].value, means[1].error, -way * expected, 4.5, .005);
    }
    itn_mesh_free(&box);
}

/* From within a forced box of a thin black medium out by its open side: what is left of the light is
   e^(-sigma_t way), though the floor goes on beyond the box, also where the derivative by the
   extinction draws more collisions than there are, and in a channel that is clear while the others
   are not. planted: factor of the light. */
static void test_thin_medium_with_a_hole(double planted) {
    itn_mesh box = open_box();
    int colours, i;
    for (colours = 0; colours < 2; colours++) {
        const char *planes[4] = {"Y", "Variance.Y", "d_m_sigma_t.Y", "d_m_sigma_t_variance.Y"};
        const char *reds[4] = {"R", "Variance.R", "d_m_sigma_t_r.R", "d_m_sigma_t_r_variance.R"};
        const char **names = colours ? reds : planes;
        double sigma_t = colours ? .4 : 1e-3, way = 1.5;
        itn_image image;
        solids_mean value, slope;
        stage s;
        begin_box(&s, &box, sigma_t, 0);
        s.objects[0].force = 1;
        stage_diffuse(&s, "floor", .5), stage_object(&s, NULL, NULL, "floor")->half_size = 50;
        s.desc.camera.eye = solids_vec3(0, 0, -.5), s.desc.camera.target = solids_vec3(0, 0, 1);
        s.desc.camera.fov = .01f;
        if (colours) {
            s.desc.film.channels = 3;
            for (i = 0; i < 3; i++)
                s.media[0].albedo[i] = 0, s.media[0].sigma_t_rgb[i] = i < 2 ? .4f : 0;
        }
        image = picture_as(&s, 1024, colours ? "m.sigma_t_r" : "m.sigma_t", ITN_MODE_AUTO);
        value = solids_plane_mean(&image, names[0], names[1]);
        slope = solids_plane_mean(&image, names[2], names[3]);
        CHECK_MEAN(value.value, value.error + 1e-6, planted * exp(-sigma_t * way), 4.5, .01);
        CHECK_MEAN(slope.value, slope.error + 1e-6, -way * exp(-sigma_t * way), 4.5, .03);
        if (colours) {
            value = solids_plane_mean(&image, "B", "Variance.B");
            CHECK_MEAN(value.value, value.error + 1e-6, planted, 4.5, .01);
        }
        itn_image_free(&image);
    }
    itn_mesh_free(&box);
}

/* Behind a hole a forced mesh's medium ends with the box of the solids, for paths, their last flights and
   links alike: a box without its top is as bright under a map that is 1 everywhere as in light 1,
   and so are its derivatives by the extinction, in both walks. planted: factor under the map. */
static void test_lights_through_a_hole(double planted) {
    static const char *const names[1] = {"m.sigma_t"};
    itn_mesh box = open_box();
    itn_image map = white_map();
    solids_mean means[4][2]; /* in light 1 and under the map, in each walk */
    int scatter, k, i;       /* 2: many times, from within a thick medium */
    for (scatter = 0; scatter < 3; scatter++) {
        for (k = 0; k < 4; k++) {
            itn_render_options options = ITN_ZERO;
            itn_scene *scene;
            stage s;
            begin_box(&s, &box, scatter == 2 ? 5 : 1, .9);
            s.objects[0].force = 1, s.desc.camera.eye.y = s.desc.camera.eye.x = 2;
            if (scatter == 2)
                s.desc.camera.eye = solids_vec3(0, 0, -.3), s.desc.camera.target.z = 1;
            if (k % 2) s.desc.light_count = 0, stage_map(&s, NULL, &map);
            scene = stage_make(&s);
            options.spp = scatter == 2 ? 6144 : 1024, options.seed = (uint64_t)k;
            options.max_scatter = scatter % 2;
            options.mode = ITN_MODE_AUTO; /* that is, the reference */
            solids_measure(scene, NULL, &options, names, 1, means[k]);
            itn_scene_free(scene);
        }
        for (k = 1; k < 4; k++)
            for (i = 0; i < 2; i++) {
                double factor = k % 2 ? planted : 1;
                double error = hypot(means[0][i].error, means[k][i].error);
                check_report(fabs(factor * means[k][i].value - means[0][i].value) <
                                 4.5 * error + .005 * fabs(means[0][i].value),
                             __FILE__, __LINE__, "max_scatter %d, %d: %g instead of %g +- %g",
                             scatter, k, means[k][i].value, means[0][i].value, error);
                if (getenv("SHOW"))
                    printf("hole, max_scatter %d, %d: %g, %g +- %g\n", scatter, k,
                           means[k][i].value, means[0][i].value, error);
            }
    }
    itn_image_free(&map);
    itn_mesh_free(&box);
}

/* Sheets of a size whose square no float holds are refused. */
static void test_huge_sheets(void) {
    itn_mesh box = unit_box();
    stage s;
    begin_box(&s, &box, 1, .5);
    stage_diffuse(&s, "floor", .9), stage_object(&s, NULL, NULL, "floor")->half_size = 2e38f;
    check_refused(&s, NULL, ITN_ERROR_MESH, __LINE__);
    s.objects[1].half_size = 9e17f;
    check_refused(&s, NULL, ITN_OK, __LINE__);
    itn_mesh_free(&box);
}

/* A vertex that no triangle uses changes nothing, however far it is. */
static void test_far_unused_vertex(void) {
    static const double places[] = {1e4, 1e7, 1e15, 1e20};
    itn_mesh sphere = solids_sphere(1, 3);
    itn_image image, other;
    int k, i;
    stage s;
    begin_box(&s, &sphere, 20, .9);
    image = picture(&s, 64, NULL);
    for (k = 0; k < 4; k++) {
        itn_mesh more;
        itn_error error;
        int count = sphere.vertex_count;
        stage_need(itn_mesh_create(count + 1, sphere.triangle_count, 0, NULL, &more, &error),
                   &error);
        memcpy(more.positions, sphere.positions, 3 * sizeof(float) * (size_t)count);
        memcpy(more.triangles, sphere.triangles,
               3 * sizeof(int) * (size_t)sphere.triangle_count);
        for (i = 0; i < 3; i++) more.positions[3 * count + i] = (float)places[k];
        s.objects[0].mesh = &more;
        other = picture(&s, 64, NULL);
        CHECK_NEAR(difference(&image, &other, 0, 1), 0, 0);
        itn_image_free(&other);
        itn_mesh_free(&more);
    }
    itn_image_free(&image);
    itn_mesh_free(&sphere);
}

/* A slab a thousandth thick above a black ground: the same on a square as on a huge closed box. */
static void test_thin_slab_over_large_ground(void) {
    itn_mesh slab = solids_slab(.001, 1);
    itn_mesh ground = solids_box(solids_vec3(-1e4, -20002, -1e4), solids_vec3(1e4, -2, 1e4));
    solids_mean mean[2];
    int k;
    for (k = 0; k < 2; k++) {
        stage s;
        begin_floor(&s, 8, 0);
        stage_medium(&s, "m", 2000, .8, 0);
        stage_object(&s, &slab, "m", NULL);
        s.objects[0].plane_y = -2, s.objects[0].half_size = 1e4f;
        if (k) s.objects[0].mesh = &ground;
        stage_constant(&s, NULL, 1);
        mean[k] = brightness(&s, 2000);
    }
    CHECK(mean[0].value > .2 && mean[0].value < .3);
    CHECK_MEAN(mean[1].value - mean[0].value, hypot(mean[0].error, mean[1].error), 0, 4.5, .004);
    itn_mesh_free(&slab), itn_mesh_free(&ground);
}

/* (x, y, z), turned by `angle` about an axis in no particular direction. */
static itn_vec3 turned(double x, double y, double z, double angle) {
    static const double a[3] = {.48, .6, .64};
    double c = cos(angle), s = sin(angle), along = (1 - c) * (a[0] * x + a[1] * y + a[2] * z);
    return solids_vec3(c * x + along * a[0] + s * (a[1] * z - a[2] * y),
                       c * y + along * a[1] + s * (a[2] * x - a[0] * z),
                       c * z + along * a[2] + s * (a[0] * y - a[1] * x));
}

static void turn_mesh(itn_mesh *mesh, double angle) {
    int i;
    for (i = 0; i < mesh->vertex_count; i++) {
        float *p = mesh->positions + 3 * i;
        itn_vec3 moved = turned((double)p[0], (double)p[1], (double)p[2], angle);
        memcpy(p, &moved, sizeof moved);
    }
}

/* A square of two triangles around the origin that faces up. */
static itn_mesh square(double half) {
    static const int corners[6] = {0, 2, 1, 0, 3, 2};
    itn_mesh mesh;
    itn_error error;
    int i;
    stage_need(itn_mesh_create(4, 2, 0, NULL, &mesh, &error), &error);
    for (i = 0; i < 4; i++) {
        mesh.positions[3 * i] = (float)(i == 0 || i == 3 ? -half : half);
        mesh.positions[3 * i + 2] = (float)(i < 2 ? -half : half);
    }
    memcpy(mesh.triangles, corners, sizeof corners);
    return mesh;
}

/* A look through a box that stands `gap` above a square, all of it turned. */
static solids_mean brightness_above(double half, double gap, double angle, double sigma_t,
                                    double reflectance, int square_first, int spp) {
    itn_mesh ground = square(half);
    itn_mesh box = solids_box(solids_vec3(-1, gap, -1), solids_vec3(1, 1 + gap, 1));
    solids_mean mean;
    stage s;
    turn_mesh(&ground, angle), turn_mesh(&box, angle);
    stage_begin(&s, 8, 0, 6);
    s.desc.camera.eye = turned(1, 5, 4, angle), s.desc.camera.target = turned(0, .3, 0, angle);
    stage_medium(&s, "m", sigma_t, .98, 0);
    stage_diffuse(&s, "ground", reflectance);
    if (square_first) stage_object(&s, &ground, NULL, "ground");
    stage_object(&s, &box, "m", NULL);
    if (!square_first) stage_object(&s, &ground, NULL, "ground");
    stage_constant(&s, NULL, 1);
    mean = brightness(&s, spp);
    itn_mesh_free(&ground), itn_mesh_free(&box);
    return mean;
}

/* An object may stand exactly on an open ground, or just above it, however large the ground is and
   whichever is first: no light comes through a black one, and a white one gives back what it gives
   a little lower. */
static void test_standing_on_the_ground(double planted) {
    static const double halves[] = {20, 1e4, 1e6}, gaps[] = {0, 1e-4};
    int k;
    for (k = 0; k < (planted == 0 ? 24 : 1); k++) {
        double half = halves[k % 3], gap = gaps[k / 3 % 2], angle = k / 6 % 2 ? .7 : 0;
        int first = k / 12;
        double through = brightness_above(half, gap, angle, 0, 0, first, 64).value;
        solids_mean milk = brightness_above(half, gap + planted, angle, 5, .8, first, 100), other;
        other = brightness_above(half, .01, angle, 5, .8, first, 100);
        CHECK(through == 0);
        CHECK_MEAN(milk.value - other.value, hypot(milk.error, other.error), 0, 4.5, .003);
    }
}

/* The same of a box of glass (ior 1.4, rough if alpha is not 0; with ior 0 index-matched) above a
   white plane, in light from everywhere or from straight below alone. */
static solids_mean glass_above(double gap, double ior, double alpha, int below, itn_mode mode) {
    itn_mesh box = solids_box(solids_vec3(-.5, 0, -.5), solids_vec3(.5, 1, .5));
    itn_image map, image;
    itn_object_desc *object;
    itn_error error;
    solids_mean mean;
    stage s;
    int i;
    stage_need(itn_image_create(8, 5, 1, NULL, &map, &error), &error);
    strcpy(map.names[0], "Y");
    for (i = 32; i < 40; i++) map.pixels[i] = 1;
    stage_begin(&s, 4, 0, 16);
    s.desc.camera.eye = solids_vec3(2, 1.7, 2), s.desc.camera.target = solids_vec3(0, .4, 0);
    stage_medium(&s, "m", 1.5, .95, .5);
    stage_diffuse(&s, "ground", .5);
    if (ior > 0) stage_dielectric(&s, "glass", ior, alpha);
    object = stage_object(&s, &box, "m", ior > 0 ? "glass" : NULL);
    object->transform[0] = object->transform[5] = object->transform[10] = 1;
    object->transform[7] = (float)gap;
    object = stage_object(&s, NULL, NULL, "ground");
    object->plane_y = 0, object->half_size = 20;
    if (below) stage_map(&s, NULL, &map);
    else stage_constant(&s, NULL, 1);
    image = picture_as(&s, below ? 500 : 1000, NULL, mode);
    mean = solids_plane_mean(&image, "Y", "Variance.Y");
    itn_mesh_free(&box);
    itn_image_free(&map), itn_image_free(&image);
    return mean;
}

/* Glass that stands exactly on the ground, or a rounding above it, is as bright as a little higher,
   and no light from below comes past the ground. planted: how high it is instead. */
static void test_glass_on_the_ground(double planted) {
    static const double gaps[] = {0, 6e-8, 4e-7};
    static const double kinds[3][2] = {{1.4, 0}, {1.4, .2}, {0, 0}}; /* ior, alpha */
    int way, k;
    for (way = 0; way < 6; way++) {
        itn_mode mode = way % 2 ? ITN_MODE_FAST : ITN_MODE_REFERENCE;
        double ior = kinds[way / 2][0], alpha = kinds[way / 2][1];
        solids_mean above = glass_above(1e-4, ior, alpha, 0, mode);
        for (k = 0; k < (planted > 0 ? 1 : 3); k++) {
            double gap = gaps[k] + planted, below = glass_above(gap, ior, alpha, 1, mode).value;
            solids_mean at = glass_above(gap, ior, alpha, 0, mode);
            check_report(below == 0, __FILE__, __LINE__, "light from below at a gap of %g: %g", gap,
                         below);
            check_report(fabs(at.value - above.value) < .0015, __FILE__, __LINE__, /* same paths */
                         "ior %g, alpha %g, mode %d, gap %g: %.5f, a little higher %.5f", ior,
                         alpha, (int)mode, gap, at.value, above.value);
        }
    }
}

/* `force` with a closed mesh that is inside out: its inside is what it encloses. */
static void test_forced_inside_out(void) {
    itn_mesh box = unit_box();
    solids_mean mean;
    stage s;
    turn_over(&box);
    begin_box(&s, &box, 1, 0);
    s.desc.camera.fov = .01f;
    check_refused(&s, NULL, ITN_ERROR_MESH, __LINE__);
    s.objects[0].force = 1;
    mean = brightness(&s, 8192);
    CHECK_MEAN(mean.value, mean.error, exp(-2), 4.5, .002);
    itn_mesh_free(&box);
}

/* A diffuse mesh shows, whichever way out its parts are: of two boxes in even light, that of the
   second that looks away from the first is as bright as it reflects. planted: of the radiance. */
static void test_inside_out_part(double planted) {
    int turned;
    for (turned = 0; turned < 2; turned++) {
        itn_mesh first = unit_box(), second, both;
        solids_mean mean;
        stage s;
        second = solids_box(solids_vec3(2, -.5, -.5), solids_vec3(3, .5, .5));
        if (turned) turn_over(&second);
        both = both_of(&first, &second);
        stage_begin(&s, 4, 0, .01f);
        s.desc.camera.eye = solids_vec3(9, .1, .2), s.desc.camera.target = solids_vec3(0, .1, .2);
        stage_diffuse(&s, "w", .5);
        stage_object(&s, &both, NULL, "w");
        stage_constant(&s, NULL, 1);
        mean = brightness(&s, 1024);
        CHECK_NEAR(mean.value, .5 + planted, 4.5 * mean.error + 1e-3);
        itn_mesh_free(&first), itn_mesh_free(&second), itn_mesh_free(&both);
    }
}

/* Seen from so far away that directions, which are floats, miss by a pixel or so, a ball has the same
   outline in both walks. planted: of the ball's radius, relative. */
static void test_far_eye(double planted) {
    enum { PIXELS = 128 * 128 };
    itn_mesh ball = solids_sphere(1, 3), other = solids_sphere(1 + planted, 3);
    itn_image reference, fast;
    int i, apart = 0;
    stage s;
    stage_begin(&s, 128, 0, (float)(2 * atan(1.2 / 9e5) * 180 / 3.14159265358979));
    s.desc.camera.eye = solids_vec3(9e5 * .536, 9e5 * .429, 9e5 * .727); /* as far as that */
    stage_diffuse(&s, "black", 0);
    stage_object(&s, &ball, NULL, "black");
    stage_constant(&s, NULL, 1);
    reference = picture_as(&s, 16, NULL, ITN_MODE_REFERENCE);
    s.objects[0].mesh = &other;
    fast = picture_as(&s, 16, NULL, ITN_MODE_FAST);
    for (i = 0; i < PIXELS; i++)
        apart += fabs((double)fast.pixels[i] - (double)reference.pixels[i]) > .9;
    if (getenv("SHOW")) printf("far eye: %d pixels apart\n", apart);
    CHECK(apart == 0);
    itn_image_free(&reference), itn_image_free(&fast);
    itn_mesh_free(&ball), itn_mesh_free(&other);
}

static double seconds_of_rays(const itn_bvh *bvh, float tilt, float shift, int count, int *hits) {
    clock_t start = clock();
    uint64_t random = 3;
    int k;
    *hits = 0;
    for (k = 0; k < count; k++) {
        itn_ray ray;
        itn_hit hit;
        ray.origin.x = shift + 2 * (float)check_uniform(&random) - 1;
        ray.origin.y = 2 * (float)check_uniform(&random) - 1, ray.origin.z = 3;
        ray.direction.x = ray.direction.y = tilt, ray.direction.z = -1;
        ray.tmin = 0, ray.tmax = INFINITY;
        *hits += itn_bvh_nearest(bvh, &ray, &hit);
    }
    return (double)(clock() - start) / CLOCKS_PER_SEC;
}

/* Rays along an axis cost what slightly tilted ones cost (fifty times is a failure), those that
   pass by included. */
static void test_speed_of_axis_parallel_rays(void) {
    itn_mesh sphere = solids_sphere(1, 5); /* 20480 triangles */
    itn_bvh *bvh;
    itn_error error;
    int pass, hits[2];
    stage_need(itn_bvh_create(&sphere, NULL, &bvh, &error), &error);
    for (pass = 0; pass < 2; pass++) {
        float shift = pass ? 3.f : 0.f;
        double tilted = seconds_of_rays(bvh, 1e-6f, shift, 10000, &hits[0]);
        double parallel = seconds_of_rays(bvh, 0, shift, 10000, &hits[1]);
        check_report(parallel < 50 * fmax(tilted, 1e-4), __FILE__, __LINE__,
                     "axis-parallel rays need %g s, tilted ones %g s", parallel, tilted);
        CHECK(pass ? hits[0] == 0 && hits[1] == 0 : hits[1] > 7000 &&
                                                        abs(hits[1] - hits[0]) < 10);
    }
    itn_bvh_free(bvh);
    itn_mesh_free(&sphere);
}

/* Zooms in on needles in an upper half of light: no crash, no NaN; what is hit is lit. */
static void test_needles_under_a_map(void) {
    static const double heights[] = {1e-6, 1e-7, 1e-8};
    itn_image map;
    itn_error error;
    int k, i, tries, bad = 0;
    double lit = 0;
    stage_need(itn_image_create(8, 9, 1, NULL, &map, &error), &error);
    strcpy(map.names[0], "Y");
    for (i = 0; i < 72; i++) map.pixels[i] = i < 40 ? 1.f : 0.f;
    for (k = 0; k < 3; k++) {
        uint64_t random = (uint64_t)k;
        for (tries = 0; tries < 400; tries++) {
            itn_mesh mesh = solids_needles(&random, heights[k], 16);
            itn_image image;
            const float *p = mesh.positions;
            float x = .5f * (p[0] + p[3]), z = .5f * (p[2] + p[5]);
            stage s;
            begin_floor(&s, 8, .5);
            s.objects[0].mesh = &mesh;
            stage_map(&s, NULL, &map);
            s.desc.camera.target = solids_vec3(x, 0, z);
            s.desc.camera.eye = solids_vec3(x, 3, z), s.desc.camera.fov = 2e-6f;
            image = picture(&s, 4, NULL);
            bad += values_out_of(&image, 3);
            for (i = 0; i < 64; i++) lit += image.pixels[i];
            itn_image_free(&image);
            itn_mesh_free(&mesh);
        }
    }
    CHECK(bad == 0);
    CHECK(lit > 1);
    itn_image_free(&map);
}

/* ---- descs that must be refused -------------------------------------------------------------- */

static void test_huge_texture_coordinates(void) {
    static const float sizes[] = {FLT_MAX, -FLT_MAX, 2e6f, 1e6f};
    itn_mesh box = unit_box();
    itn_image texture = stage_patch(1, .5, .5, .5), image;
    float uvs[72];
    int k, i;
    stage s;
    begin_floor(&s, 4, .5);
    stage_constant(&s, NULL, 1);
    s.objects[0].mesh = &box, box.uvs = uvs;
    s.surfaces[0].texture = ITN_TEXTURE_IMAGE, s.surfaces[0].image = &texture;
    for (k = 0; k < 4; k++) {
        for (i = 0; i < 72; i++) uvs[i] = sizes[k];
        if (k < 3) check_refused(&s, NULL, ITN_ERROR_MESH, __LINE__);
    }
    image = picture(&s, 16, NULL);
    CHECK(values_out_of(&image, 1.001) == 0);
    box.uvs = NULL;
    itn_image_free(&image), itn_image_free(&texture);
    itn_mesh_free(&box);
}

static void test_images_without_names_or_pixels(void) {
    float pixels[4] = {.5f, .5f, .5f, .5f};
    char names[1][ITN_NAME_SIZE] = {"Y"};
    itn_image image = ITN_ZERO;
    stage s;
    image.width = image.height = 2, image.plane_count = 1, image.pixels = pixels;
    begin_floor(&s, 4, .5);
    s.surfaces[0].texture = ITN_TEXTURE_IMAGE, s.surfaces[0].image = &image;
    REFUSED(&s);
    image.names = names, image.pixels = NULL;
    REFUSED(&s);
    begin_floor(&s, 4, .5);
    stage_map(&s, "map", &image);
    REFUSED(&s);
    image.names = NULL, image.pixels = pixels;
    REFUSED(&s);
    image.names = names;
    check_refused(&s, NULL, ITN_OK, __LINE__);
}

/* coefficient `index` of all channels of a plain sky */
static void set_sky(stage *s, int index, double value) {
    int c;
    for (c = 0; c < 3; c++) s->lights[0].sky.coefficients[c][index] = (float)value;
}

static void test_exploding_skies(void) {
    static const double ninths[] = {1, -1, 1.5, -40};
    stage s;
    itn_scene *scene;
    int k;
    begin_floor(&s, 4, .5);
    stage_sky(&s, "sky");
    scene = stage_make(&s); /* this one is fine */
    itn_scene_free(scene);
    for (k = 0; k < 4; k++) set_sky(&s, 8, ninths[k]), REFUSED(&s);
    set_sky(&s, 8, .5), set_sky(&s, 0, 1), set_sky(&s, 1, 1000);
    REFUSED(&s);
    set_sky(&s, 0, 1e30), set_sky(&s, 1, 1);
    REFUSED(&s);
    set_sky(&s, 0, -.6), set_sky(&s, 1, -.4), set_sky(&s, 4, 1000); /* exp(1000 gamma) */
    REFUSED(&s);
    set_sky(&s, 4, -2), set_sky(&s, 2, 1e20);
    REFUSED(&s);
}

/* The sun's irradiance on a level floor: radiance * solid angle * mean cosine, which for a cone of
   half angle a at cosine c is c (1 + cos a)/2. */
static void test_power_of_the_sun(double planted) {
    static const double scales[] = {.01, 1, 70};
    static const float refused[] = {.0099f, 1e-3f, 1e-19f, 1e-30f, -1, 321};
    const double pi = 3.14159265358979, half = .2679 * pi / 180;
    stage s;
    int k, c;
    begin_floor(&s, 8, .5);
    s.objects[0].half_size = 10;
    stage_sky(&s, "sky");
    for (c = 0; c < 3; c++)
        s.lights[0].sky.radiance[c] = 0, s.lights[0].sky.sun_radiance[c] = 1e4f;
    s.lights[0].sun_direction = solids_vec3(.36, .8, .48);
    for (k = 0; k < 3; k++) {
        double solid = 4 * pi * pow(sin(half / 2), 2);
        double expected = .5 / pi * 1e4 * solid * .8 * (1 + cos(half * scales[k])) / 2;
        solids_mean mean;
        s.lights[0].sun_radius_scale = (float)scales[k];
        mean = brightness(&s, 4096);
        CHECK_NEAR(mean.value, expected * (1 + planted), 4.5 * mean.error + 2e-4 * expected);
        CHECK(mean.error < 1e-3 * expected);
    }
    for (k = 0; k < 6; k++) s.lights[0].sun_radius_scale = refused[k], REFUSED(&s);
}

static void test_counts_at_the_limit(void) {
    int k;
    for (k = 1; k < 16; k++) {
        stage s;
        begin_floor(&s, 4, .5);
        if (k & 1) s.desc.medium_count = INT_MAX;
        if (k & 2) s.desc.surface_count = INT_MAX;
        if (k & 4) s.desc.light_count = INT_MAX;
        if (k & 8) s.desc.object_count = INT_MAX;
        REFUSED(&s);
    }
}

/* An allocator that is out of memory beyond 64 MB. */
static void *small_allocate(size_t bytes, void *user) {
    (void)user;
    return bytes > (size_t)64 << 20 ? NULL : malloc(bytes);
}
static void small_free(void *block, void *user) {
    (void)user;
    free(block);
}

static void test_sizes_at_the_limit(void) {
    itn_context context = ITN_ZERO;
    itn_mesh mesh = ITN_ZERO, box = unit_box();
    itn_image image = ITN_ZERO;
    itn_error error;
    itn_result result;
    float pixels[4] = {1, 1, 1, 1};
    char names[1][ITN_NAME_SIZE] = {"Y"};
    stage s;
    context.allocate = small_allocate, context.deallocate = small_free;
    result = itn_mesh_create(INT_MAX, INT_MAX, 1, &context, &mesh, &error);
    CHECK(result != ITN_OK && error.code == result && mesh.positions == NULL);
    result = itn_image_create(INT_MAX, INT_MAX, INT_MAX, &context, &image, &error);
    CHECK(result != ITN_OK && error.code == result && image.pixels == NULL);
    image.width = image.height = 26000, image.plane_count = 1; /* never read */
    image.pixels = pixels, image.names = names;
    begin_floor(&s, 4, .5);
    stage_map(&s, "map", &image);
    check_refused(&s, &context, ITN_ERROR_MEMORY, __LINE__);
    image.width = image.height = 65536; /* more nodes than an int can number */
    check_refused(&s, &context, ITN_ERROR_ARGUMENT, __LINE__);
    image.width = image.height = INT_MAX;
    check_refused(&s, &context, ITN_ERROR_ARGUMENT, __LINE__);
    mesh = box, mesh.triangle_count = INT_MAX; /* the arrays are never read that far */
    s.lights[0].type = ITN_LIGHT_CONSTANT, s.objects[0].mesh = &mesh;
    check_refused(&s, &context, ITN_ERROR_MEMORY, __LINE__);
    itn_mesh_free(&box);
}

static void test_names_that_collide(void) {
    itn_mesh box = unit_box();
    stage s;
    begin_box(&s, &box, 1, .5); /* two surfaces of one name, though of two types */
    stage_diffuse(&s, "d", .5), stage_dielectric(&s, "d", 1.5, 0);
    REFUSED(&s);
    begin_box(&s, &box, 1, .5); /* two media */
    stage_medium(&s, "m", 1, .5, 0);
    REFUSED(&s);
    begin_box(&s, &box, 1, .5); /* two lights of two types */
    s.lights[0].name = "l", stage_sky(&s, "l");
    REFUSED(&s);
    begin_box(&s, &box, 1, .5); /* layers d_m_albedo_g of m.albedo_g and m_albedo.g */
    stage_medium(&s, "m_albedo", 1, .5, 0);
    s.desc.film.channels = 3;
    REFUSED(&s);
    begin_box(&s, &box, 1, .5); /* d_k_sun_scale of k.sun_scale and k_sun.scale */
    s.lights[0].name = "k_sun", stage_sky(&s, "k");
    REFUSED(&s);
    s.lights[0].name = "k_moon";
    check_refused(&s, NULL, ITN_OK, __LINE__);
    itn_mesh_free(&box);
}

/* ---- camera ---------------------------------------------------------------------------------- */

/* View and up have a direction only: any length gives the same picture. */
static void test_camera_vectors_of_any_length(void) {
    static const double sizes[] = {1e-25, 1e-38, 1e20, 1e37};
    itn_image map = stage_patch(1, .6, .3, 5), images[2];
    int k, j;
    for (k = 0; k < 4; k++) {
        for (j = 0; j < 2; j++) {
            double view = j ? sizes[k] : 1;
            stage s;
            stage_begin(&s, 8, 0, 60);
            stage_diffuse(&s, "floor", .5);
            stage_object(&s, NULL, NULL, "floor");
            stage_map(&s, NULL, &map);
            s.desc.camera.eye.y = 3; /* the view's components add to zeros only */
            s.desc.camera.target = solids_vec3(view, 3, view);
            s.desc.camera.up = solids_vec3(0, j ? 1 / view : 1, 0);
            images[j] = picture(&s, 16, NULL);
        }
        CHECK_NEAR(difference(&images[0], &images[1], 0, 0), 0, 1e-5);
        itn_image_free(&images[0]), itn_image_free(&images[1]);
    }
    itn_image_free(&map);
}

/* ---- media and surfaces ---------------------------------------------------------------------- */

/* A sphere in a sphere in a sphere; the middle one is index-matched, so it is not there. */
static double nested(int layers, double inner_ior, const itn_image *map, solids_mean *mean) {
    itn_mesh a = solids_sphere(1, 3), b = solids_sphere(.8, 3), c = solids_sphere(.5, 3);
    stage s;
    stage_begin(&s, 16, 5, 10);
    stage_medium(&s, "fog", 0, 0, 0);
    stage_dielectric(&s, "glass", 1.5, 0), stage_dielectric(&s, "inner", inner_ior, 0);
    stage_object(&s, &a, NULL, "glass");
    if (layers & 1) stage_object(&s, &b, "fog", NULL);
    if (layers & 2) stage_object(&s, &c, NULL, "inner");
    stage_map(&s, NULL, map);
    *mean = brightness(&s, 512);
    itn_mesh_free(&a), itn_mesh_free(&b), itn_mesh_free(&c);
    return mean->value;
}

static void test_index_goes_on_in_matched_objects(void) {
    itn_image map;
    itn_error error;
    solids_mean with, without;
    int i;
    stage_need(itn_image_create(8, 5, 1, NULL, &map, &error), &error);
    strcpy(map.names[0], "Y");
    for (i = 0; i < 40; i++) map.pixels[i] = i < 16 ? 1.f : 0.f;
    /* a bubble of air */
    nested(3, 1, &map, &with), nested(2, 1, &map, &without);
    CHECK_MEAN(with.value - without.value, hypot(with.error, without.error), 0, 4.5, .002);
    /* glass of the same index in the fog: nothing to see but the outer sphere */
    nested(3, 1.5, &map, &with), nested(0, 1.5, &map, &without);
    CHECK_MEAN(with.value - without.value, hypot(with.error, without.error), 0, 4.5, .002);
    itn_image_free(&map);
}

/* A rough boundary of next to no index step loses no light. */
static void test_rough_boundary_without_step(void) {
    itn_mesh sphere = solids_sphere(1, 3);
    itn_image map = stage_patch(1, .5, .5, 0);
    int i, light;
    for (light = 0; light < 2; light++) {
        solids_mean mean;
        stage s;
        stage_begin(&s, 8, 4, 20);
        stage_medium(&s, "m", 1, 1, 0);
        stage_dielectric(&s, "s", 1 + 2e-7, .5);
        stage_object(&s, &sphere, "m", "s");
        for (i = 0; i < map.width * map.height; i++) map.pixels[i] = 1;
        if (light)
            stage_map(&s, NULL, &map);
        else
            stage_constant(&s, NULL, 1);
        mean = brightness(&s, 512);
        CHECK_NEAR(mean.value, 1, 4.5 * mean.error + 1e-5);
        CHECK(mean.error < .002);
    }
    itn_image_free(&map);
    itn_mesh_free(&sphere);
}

/* ---- derivatives ----------------------------------------------------------------------------- */

/* The mean of d/d ior in green and blue does not depend on red: not even on a black one. The paths
   are the same, so values agree but for rounding, far below the standard errors. */
static void test_index_derivative_beside_black_red(double planted) {
    itn_mesh box = unit_box();
    itn_image images[2];
    const char *const names[2][2] = {{"d_s_ior.G", "d_s_ior_variance.G"},
                                     {"d_s_ior.B", "d_s_ior_variance.B"}};
    int k, c;
    for (k = 0; k < 2; k++) {
        stage s;
        stage_begin(&s, 16, 3, 20);
        s.desc.film.channels = 3;
        stage_medium(&s, "m", 4, .8 - planted * k, 0)->albedo[0] = k ? 0 : .8f;
        stage_dielectric(&s, "s", 1.5, .6);
        stage_object(&s, &box, "m", "s");
        stage_constant(&s, NULL, 1);
        images[k] = picture(&s, 512, "s.ior");
    }
    for (c = 0; c < 2; c++) {
        solids_mean grey = solids_plane_mean(&images[0], names[c][0], names[c][1]);
        solids_mean red = solids_plane_mean(&images[1], names[c][0], names[c][1]);
        CHECK_NEAR(red.value, grey.value, .1 * grey.error);
        CHECK(fabs(grey.value) > 10 * grey.error);
    }
    itn_image_free(&images[0]), itn_image_free(&images[1]);
    itn_mesh_free(&box);
}

/* Asking for an index costs the picture itself little. */
static void test_noise_with_an_index_asked_for(void) {
    itn_mesh box = unit_box();
    itn_image image;
    double errors[2];
    int k;
    for (k = 0; k < 2; k++) {
        stage s;
        stage_begin(&s, 16, 3, 20);
        stage_medium(&s, "m", .2, 1, 0);
        stage_dielectric(&s, "s", 1.8, .1);
        stage_object(&s, &box, "m", "s");
        stage_constant(&s, NULL, 1);
        image = picture_as(&s, 1024, k ? "s.ior" : NULL, ITN_MODE_REFERENCE);
        errors[k] = solids_plane_mean(&image, "Y", "Variance.Y").error;
        itn_image_free(&image);
    }
    if (getenv("SHOW")) printf("standard errors %g, with an index %g\n", errors[0], errors[1]);
    CHECK(errors[1] < 3 * errors[0]);
    itn_mesh_free(&box);
}

/* Gradient and variance are linear and quadratic in the weights, however small or large. */
static void test_gradients_of_any_size(void) {
    static const float sizes[] = {1, 1e-30f, 1e30f};
    itn_mesh box = unit_box();
    itn_scene *scene;
    itn_error error;
    double gradient[3], variance[3];
    float weights[16];
    int k, i, parameter;
    stage s;
    begin_box(&s, &box, 1, .5);
    scene = stage_make(&s);
    parameter = itn_parameter_find(scene, "m.albedo");
    for (k = 0; k < 3; k++) {
        double size = (double)sizes[k];
        for (i = 0; i < 16; i++) weights[i] = sizes[k];
        stage_need(itn_render_gradient(scene, NULL, NULL, weights, &parameter, 1, &gradient[k],
                                       &variance[k], &error), &error);
        CHECK(variance[k] > 0);
        CHECK_NEAR(gradient[k] / size, gradient[0], 1e-4 * gradient[0]);
        CHECK_NEAR(variance[k] / size / size, variance[0], 1e-4 * variance[0]);
    }
    itn_scene_free(scene);
    itn_mesh_free(&box);
}

/* ---- the loss -------------------------------------------------------------------------------- */

typedef struct watch {
    int calls, wrong, stop_at;
    double last;
} watch;

static int watch_progress(void *user, double fraction) {
    watch *w = (watch *)user;
    w->wrong += !(fraction >= w->last && fraction >= 0 && fraction <= 1);
    w->last = fraction;
    return ++w->calls == w->stop_at;
}

/* Statistics: untouched when the loss fails, those of both renders when it succeeds; the progress
   goes once from 0 to 1. */
static void test_reports_of_the_loss(void) {
    itn_mesh box = unit_box();
    itn_scene *scene;
    itn_error error;
    itn_render_options options = ITN_ZERO;
    itn_render_stats stats = {-1, -1, -1};
    watch w = ITN_ZERO;
    float target[16] = {0}, *theta;
    double loss = -1, gradient = -1;
    int albedo, ior, wrong = 99, k;
    stage s;
    begin_box(&s, &box, 1, .5);
    stage_dielectric(&s, "glass", 1.5, 0), s.objects[0].surface = "glass";
    s.lights[0].radiance[0] = 1e9f;
    scene = stage_make(&s);
    albedo = itn_parameter_find(scene, "m.albedo"), ior = itn_parameter_find(scene, "glass.ior");
    options.spp = 16, options.stats = &stats;
    options.progress = watch_progress, options.progress_user = &w;
#define LOSS(parameter, count, out)                                                                \
    itn_loss_gradient(scene, NULL, &options, target, parameter, count, &loss, out, &error)
    CHECK(LOSS(&wrong, 1, &gradient) == ITN_ERROR_ARGUMENT);
    CHECK(LOSS(&albedo, -1, &gradient) == ITN_ERROR_ARGUMENT);
    CHECK(LOSS(NULL, 1, &gradient) == ITN_ERROR_ARGUMENT);
    CHECK(LOSS(&ior, 1, &gradient) == ITN_ERROR_UNSUPPORTED);
    CHECK(LOSS(&albedo, 1, NULL) == ITN_ERROR_ARGUMENT);
    CHECK(strstr(error.message, "itn_render_gradient") == NULL);
    CHECK(w.calls == 0); /* nothing was rendered for that */
    CHECK(stats.paths == -1 && stats.collisions == -1 && loss == -1 && gradient == -1);
    CHECK(LOSS(&albedo, 1, &gradient) == ITN_OK);
    CHECK(stats.paths == (4 + 4) * 16 * 16 && stats.collisions > 0); /* 4 walks a ray */
    CHECK(w.calls >= 2 && w.wrong == 0 && w.last > .9);
    memset(&w, 0, sizeof w);
    CHECK(LOSS(NULL, 0, NULL) == ITN_OK); /* one render */
    CHECK(w.calls >= 1 && w.wrong == 0 && w.last > .9);
    stats.paths = stats.collisions = -1, loss = gradient = -1, options.progress = NULL;
    theta = (float *)malloc((size_t)itn_parameter_count(scene) * sizeof *theta);
    itn_parameter_values(scene, theta);
    theta[itn_parameter_find(scene, "light.scale")] = 1e12f;
    CHECK(itn_loss_gradient(scene, theta, &options, target, &albedo, 1, &loss, &gradient, &error) ==
          ITN_ERROR_ARGUMENT); /* a radiance whose square is none */
    CHECK(stats.paths == -1 && loss == -1 && gradient == -1);
    free(theta), options.progress = watch_progress;
    for (k = w.calls; k > 0; k--) { /* cancelled at every call, also late ones */
        watch stop = ITN_ZERO;
        stats.paths = stats.collisions = -1;
        loss = gradient = -1;
        stop.stop_at = k, options.progress_user = &stop;
        CHECK(LOSS(&albedo, 1, &gradient) == ITN_ERROR_CANCELLED);
        CHECK(stats.paths == -1 && stats.collisions == -1 && loss == -1 && gradient == -1);
    }
#undef LOSS
    itn_scene_free(scene);
    itn_mesh_free(&box);
}

/* An index of 1, where a rough surface has no derivative in it, is a place to which a network or a
   step can come: both go on from 1.001. And what has no name is not found. */
static void test_index_of_one(void) {
    itn_mesh box = unit_box();
    itn_scene *scene;
    itn_error error;
    itn_render_options renders = ITN_ZERO;
    itn_refine_options options = ITN_ZERO;
    itn_estimate estimate;
    itn_render_stats stats = {-1, -1, -1};
    float target[16] = {0}, *theta, predicted = -20;
    double loss, gradient;
    int ior;
    stage s;
    begin_box(&s, &box, 1, .5);
    stage_dielectric(&s, "glass", 1.5, .3), s.objects[0].surface = "glass";
    scene = stage_make(&s);
    ior = itn_parameter_find(scene, "glass.ior");
    renders.spp = 4, renders.stats = &stats;
    CHECK(itn_loss_image(scene, NULL, &renders, target, &ior, 1, &predicted, &loss, &gradient,
                         &error) == ITN_OK);
    CHECK(loss > 0 && isfinite(gradient) && stats.paths > 0);
    theta = (float *)malloc((size_t)itn_parameter_count(scene) * sizeof *theta);
    itn_parameter_values(scene, theta);
    theta[ior] = 1;
    options.iterations = 1, options.spp = 4, options.final_spp = 8;
    CHECK(itn_refine(scene, theta, target, &ior, 1, &options, &estimate, &error) == ITN_OK);
    CHECK(theta[ior] >= 1.001f && theta[ior] <= 4);
    CHECK(itn_parameter_find(scene, NULL) == -1 && itn_scene_thickness(scene, NULL, NULL) == 0);
    free(theta);
    itn_scene_free(scene);
    itn_mesh_free(&box);
}

/* Half a pixel sees an absorbing box, half the light behind it: the Sobol sampler spreads places in
   the pixel and flights together, so that its pictures differ less than random ones. planted: the
   sampler in its place. */
static void test_edge_pixel(itn_sampler planted) {
    itn_mesh box = unit_box();
    double deviations[2];
    int walks, k, i;
    for (walks = 1; walks <= 16; walks *= 4) {
        itn_scene *scene;
        stage s;
        begin_box(&s, &box, .35, 0);
        s.desc.camera.eye = solids_vec3(1, 0, 1000), s.desc.camera.target = solids_vec3(1, 0, 0);
        s.desc.camera.fov = .02f, s.desc.film.width = s.desc.film.height = 1;
        scene = stage_make(&s);
        for (k = 0; k < 2; k++) {
            double sum = 0, squares = 0;
            for (i = 0; i < 100; i++) {
                itn_render_options options = ITN_ZERO;
                itn_image image;
                itn_error error;
                options.mode = ITN_MODE_FAST, options.sampler = k ? planted : ITN_SAMPLER_RANDOM;
                options.walks = walks, options.spp = 64, options.seed = (uint64_t)i;
                stage_need(itn_render(scene, NULL, &options, NULL, 0, &image, &error), &error);
                sum += image.pixels[0] / 100, squares += image.pixels[0] * image.pixels[0] / 100;
                itn_image_free(&image);
            }
            CHECK_NEAR(sum, .75, .02);
            deviations[k] = sqrt(fabs(squares - sum * sum));
        }
        check_report(deviations[1] < .5 * deviations[0], __FILE__, __LINE__,
                     "%d walks: deviation %g, by random points %g", walks, deviations[1],
                     deviations[0]);
        itn_scene_free(scene);
    }
    itn_mesh_free(&box);
}

/* ---- threads ---------------------------------------------------------------------------------- */

/* A render of a scene by a thread that others do not know of. */
typedef struct visitor {
    const itn_scene *scene;
    itn_image image;
    itn_result result;
} visitor;

static void *visit(void *argument) {
    visitor *v = (visitor *)argument;
    itn_render_options options = ITN_ZERO;
    int albedo = itn_parameter_find(v->scene, "m.albedo");
    options.spp = 16;
    v->result = itn_render(v->scene, NULL, &options, &albedo, 1, &v->image, NULL);
    return NULL;
}

/* Threads that render a new scene at once, all of which find that its tables are still to be made,
   get the bits that one of them gets alone; nothing is lost or freed twice. planted: one has other
   light. */
static void test_visitors(int planted) {
    enum { VISITORS = 4, ROUNDS = 20 };
    itn_mesh box = unit_box();
    stage s;
    int round, k, different = 0;
    begin_box(&s, &box, 10, .9);
    for (round = 0; round < ROUNDS; round++) {
        pthread_t threads[VISITORS];
        visitor visitors[VISITORS];
        itn_scene *scene = stage_make(&s), *other;
        s.lights[0].radiance[0] *= 1.5f;
        other = stage_make(&s);
        s.lights[0].radiance[0] /= 1.5f;
        memset(visitors, 0, sizeof visitors);
        for (k = 0; k < VISITORS; k++) {
            visitors[k].scene = planted && k == 1 ? other : scene;
            CHECK(pthread_create(&threads[k], NULL, visit, &visitors[k]) == 0);
        }
        for (k = 0; k < VISITORS; k++) {
            CHECK(pthread_join(threads[k], NULL) == 0 && visitors[k].result == ITN_OK);
            different += memcmp(visitors[k].image.pixels, visitors[0].image.pixels,
                                4 * 16 * sizeof(float)) != 0;
        }
        for (k = 0; k < VISITORS; k++) itn_image_free(&visitors[k].image);
        itn_scene_free(scene), itn_scene_free(other);
    }
    CHECK(different == 0);
    itn_mesh_free(&box);
}

/* ---- seeds ----------------------------------------------------------------------------------- */

static void test_seeds_of_the_loss(void) {
    itn_mesh box = unit_box();
    itn_scene *scene;
    itn_error error;
    float target[16] = {0};
    double losses[2], gradients[2];
    int k, parameter;
    stage s;
    begin_box(&s, &box, 1, .5);
    scene = stage_make(&s);
    parameter = itn_parameter_find(scene, "m.albedo");
    for (k = 0; k < 2; k++) {
        itn_render_options options = ITN_ZERO;
        options.spp = 16, options.seed = k ? 7 + ((uint64_t)1 << 63) : 7;
        stage_need(itn_loss_gradient(scene, NULL, &options, target, &parameter, 1, &losses[k],
                                     &gradients[k], &error), &error);
    }
    CHECK(losses[0] != losses[1] && gradients[0] != gradients[1]);
    itn_scene_free(scene);
    itn_mesh_free(&box);
}

/* Steps do not depend on the unit of light. Pictures so dark that floats lose their squares
   are refused. planted: the second picture is another. */
static void test_refinement_in_dim_light(double planted) {
    static const double lights[3] = {1, 1e-6, 1e-18};
    itn_mesh box = unit_box();
    itn_error error;
    float target[16], found[2];
    int k, i;
    for (k = 0; k < 3; k++) {
        itn_refine_options options = ITN_ZERO;
        itn_estimate estimate;
        float theta[8];
        int parameter;
        itn_scene *scene;
        stage s;
        begin_box(&s, &box, 1, .5);
        for (i = 0; i < 3; i++) s.lights[0].radiance[i] = (float)lights[k];
        scene = stage_make(&s);
        parameter = itn_parameter_find(scene, "m.albedo");
        for (i = 0; i < 16; i++) target[i] = (float)(lights[k] * (.8 + (k ? planted : 0)));
        options.iterations = 6, options.spp = 8;
        itn_parameter_values(scene, theta);
        error.message[0] = 0;
        CHECK(itn_refine(scene, theta, target, &parameter, 1, &options, &estimate, &error) ==
              (k < 2 ? ITN_OK : ITN_ERROR_ARGUMENT));
        if (k < 2) found[k] = theta[parameter];
        else CHECK(strstr(error.message, "too small") != NULL);
        itn_scene_free(scene);
    }
    CHECK(found[0] > .52f);
    CHECK_NEAR(found[1], found[0], 1e-4);
    itn_mesh_free(&box);
}

/* The thickness of an object that is scaled more in one direction: a box of 2 x 2 x 2, drawn out
   to 200 x 200 x 2, has the mean chord 4 x 80000 / 81600. planted: the area of a cube of that
   volume. */
static void test_thickness_of_a_drawn_out_box(int planted) {
    itn_mesh box = solids_box(solids_vec3(-1, -1, -1), solids_vec3(1, 1, 1));
    itn_object_desc *object;
    itn_scene *scene;
    double area = planted ? 6 * pow(80000, 2. / 3) : 81600;
    stage s;
    stage_begin(&s, 4, 400, 30);
    stage_medium(&s, "m", 1, .5, 0);
    object = stage_object(&s, &box, "m", NULL);
    object->transform[0] = object->transform[5] = 100, object->transform[10] = 1;
    stage_constant(&s, NULL, 1);
    scene = stage_make(&s);
    CHECK_NEAR(itn_scene_thickness(scene, NULL, "m"), 4 * 80000 / area, 1e-4);
    itn_scene_free(scene);
    itn_mesh_free(&box);
}

/* Values beyond a logit's bounds, as of a material that another program made, have the coordinate
   of the bound; those of a logarithm do, too. */
static void test_coordinates_beyond(void) {
    itn_parameter p = ITN_ZERO;
    p.lower = -.999f, p.upper = .999f, p.transform = ITN_LOGIT;
    CHECK(itn_parameter_to_coordinate(&p, 1.5) == 16 && itn_parameter_to_coordinate(&p, -1) == -16);
    CHECK(itn_parameter_to_coordinate(&p, (double)p.upper) == 16);
    p.lower = 0, p.upper = 1e12f, p.transform = ITN_LOG;
    CHECK(itn_parameter_to_coordinate(&p, -1) == itn_parameter_to_coordinate(&p, 0));
}

/* The size of a PFM is read digit by digit: 2^24 + 1 is no float. */
static void test_size_of_a_pfm(void) {
    static const char file[] = "Pf\n16777217 1\n-1.0\nabcd";
    itn_image image = ITN_ZERO;
    itn_error error;
    CHECK(itn_image_from_memory(file, sizeof file - 1, "a.pfm", NULL, &image, &error) ==
          ITN_ERROR_FORMAT);
    CHECK(strstr(error.message, "needs 67108868") != NULL && !image.pixels);
}

/* A surface and a light of one name are told apart by everything but the values of images. */
static void test_texels_of_two(void) {
    itn_image map = stage_patch(1, .3, .2, 2), texture = stage_patch(1, .3, .2, .5);
    itn_image gradient = ITN_ZERO;
    itn_surface_desc *surface;
    itn_render_options options = ITN_ZERO;
    static float weights[16];
    itn_scene *scene;
    itn_error error;
    stage s;
    stage_begin(&s, 4, 4, 30);
    surface = stage_diffuse(&s, "a", .5);
    surface->texture = ITN_TEXTURE_IMAGE, surface->image = &texture;
    stage_object(&s, NULL, NULL, "a");
    stage_map(&s, "a", &map);
    scene = stage_make(&s);
    options.spp = 1;
    CHECK(itn_render_texel_gradient(scene, NULL, &options, weights, "a", &gradient, &error) ==
          ITN_ERROR_ARGUMENT);
    CHECK(strstr(error.message, "both a surface and a light \"a\"") && !gradient.pixels);
    itn_scene_free(scene);
    itn_image_free(&map), itn_image_free(&texture);
}

/* ---- faces in one point ---------------------------------------------------------------------- */

/* Unpolarised Fresnel reflectance from index a, at this sine in a vacuum, to index b. */
static double step_reflectance(double a, double b, double sine) {
    double ca = sqrt(a * a - sine * sine), cb = sqrt(b * b - sine * sine); /* times the index */
    double s = (ca - cb) / (ca + cb), p = (b * b * ca - a * a * cb) / (b * b * ca + a * a * cb);
    return (s * s + p * p) / 2;
}

/* Layers with smooth boundaries that absorb, from the side of the eye: what of uniform light of 1
   they reflect, and let through, over all orders of reflection. tau is upright; outside is 1. */
static void layers(const double *ior, const double *tau, int count, double sine, double *reflected,
                   double *through) {
    double r = step_reflectance(ior[count - 1], 1, sine), t = 1 - r;
    int k;
    for (k = count - 1; k >= 0; k--) {
        double step = step_reflectance(k ? ior[k - 1] : 1, ior[k], sine);
        double a = exp(-tau[k] * ior[k] / sqrt(ior[k] * ior[k] - sine * sine));
        double between = (1 - step) / (1 - step * a * a * r);
        t *= a * between, r = step + (1 - step) * between * a * a * r;
    }
    *reflected = r, *through = t;
}

/* Slabs along z whose faces coincide (ior 0: index-matched), and the layers that they are, from the
   top. */
enum { PILES = 8, PILE_OBJECTS = 4 };
static const struct {
    const char *title;
    int objects, layers;
    struct {
        double lower, upper, ior, sigma_t;
    } object[PILE_OBJECTS];
    double ior[PILE_OBJECTS], tau[PILE_OBJECTS];
} piles[PILES] = {
    {"touching", 2, 2, {{0, 1, 2.4, .5}, {1, 2, 1.3, .7}}, {1.3, 2.4}, {.7, .5}},
    {"touching, swapped", 2, 2, {{1, 2, 1.3, .7}, {0, 1, 2.4, .5}}, {1.3, 2.4}, {.7, .5}},
    {"flush", 2, 2, {{0, 1, 2.4, .5}, {.5, 1, 1.3, .7}}, {1.3, 2.4}, {.35, .25}},
    {"flush, swapped", 2, 1, {{.5, 1, 1.3, .7}, {0, 1, 2.4, .5}}, {2.4}, {.5}},
    {"same place", 2, 1, {{0, 1, 2.4, .5}, {0, 1, 1.3, .7}}, {1.3}, {.7}},
    {"matched, flush", 2, 2, {{0, 1, 2.4, .5}, {.5, 1, 0, .7}}, {2.4, 2.4}, {.35, .25}},
    {"matched, swapped", 2, 1, {{.5, 1, 0, .7}, {0, 1, 2.4, .5}}, {2.4}, {.5}},
    {"all at once", 4, 4,
     {{0, 1, 2.4, .5}, {1, 2, 1.3, .7}, {.5, 1, 1.7, .3}, {1, 1.5, 2, .2}},
     {1.3, 2, 1.7, 2.4}, {.35, .1, .15, .25}}};

/* Seen at a slant of that sine, or turned about x by `tilt` as a whole and moved. planted: moves
   every other slab up by so much. */
static void begin_pile(stage *s, itn_mesh meshes[PILE_OBJECTS], int pile, int below, double sine,
                       double tilt, double planted) {
    static const char *const names[PILE_OBJECTS] = {"a", "b", "c", "d"};
    double c = cos(tilt), d = sin(tilt), side = below ? -1 : 1;
    int k;
    stage_begin(s, 1, 0, .001);
    s->desc.camera.eye = solids_vec3(0, 10 * sine, 10 * side * sqrt(1 - sine * sine));
    if (tilt != 0) {
        s->desc.camera.up.x = 1;
        s->desc.camera.eye = solids_vec3(.3, .1 - 10 * side * d, -.2 + 10 * side * c);
        s->desc.camera.target = solids_vec3(.3, .1, -.2);
    }
    for (k = 0; k < piles[pile].objects; k++) {
        double up = k % 2 ? planted : 0, wide = 20 + k;
        float *m;
        meshes[k] = solids_box(solids_vec3(-wide, -wide, piles[pile].object[k].lower + up),
                               solids_vec3(wide, wide, piles[pile].object[k].upper + up));
        stage_medium(s, names[k], piles[pile].object[k].sigma_t, 0, 0);
        if (piles[pile].object[k].ior > 0)
            stage_dielectric(s, names[k], piles[pile].object[k].ior, 0);
        m = stage_object(s, &meshes[k], names[k],
                         piles[pile].object[k].ior > 0 ? names[k] : NULL)->transform;
        m[0] = 1, m[5] = m[10] = (float)c, m[6] = (float)-d, m[9] = (float)d;
        if (tilt != 0) m[3] = .3f, m[7] = .1f, m[11] = -.2f;
    }
}

static void end_pile(itn_mesh meshes[PILE_OBJECTS], int pile) {
    int k;
    for (k = 0; k < piles[pile].objects; k++) itn_mesh_free(&meshes[k]);
}

/* What the layers of a pile reflect and let through, seen from above or below. */
static void pile_layers(int pile, int below, double sine, double *reflected, double *through) {
    double ior[PILE_OBJECTS] = {1}, tau[PILE_OBJECTS] = {0};
    int count = piles[pile].layers, k;
    for (k = 0; k < count; k++) {
        ior[k] = piles[pile].ior[below ? count - 1 - k : k];
        tau[k] = piles[pile].tau[below ? count - 1 - k : k];
    }
    layers(ior, tau, count, sine, reflected, through);
}

static solids_mean mean_as(const stage *s, int spp, itn_mode mode) {
    itn_image image = picture_as(s, spp, NULL, mode);
    solids_mean mean = solids_plane_mean(&image, "Y", "Variance.Y");
    itn_image_free(&image);
    return mean;
}

/* Boundaries in one point are crossed together: from above and below, upright, at a slant and out of
   the axes, in both walks. */
static void test_faces_in_one_point(double planted) {
    int k;
    for (k = 0; k < 12 * PILES; k++) {
        int pile = k / 12, below = k % 2, slant = k / 2 % 3, fast = k / 6 % 2;
        double sine = slant == 1 ? .7 : 0, reflected, through;
        itn_mesh meshes[PILE_OBJECTS];
        solids_mean mean;
        stage s;
        begin_pile(&s, meshes, pile, below, sine, slant == 2 ? .6 : 0, planted);
        stage_constant(&s, NULL, 1);
        pile_layers(pile, below, sine, &reflected, &through);
        mean = mean_as(&s, fast ? 16384 : 40000, fast ? ITN_MODE_FAST : ITN_MODE_REFERENCE);
        if (getenv("SHOW"))
            printf("%s, %d %d %d: %.5f +- %.5f, %.5f\n", piles[pile].title, below, slant, fast,
                   mean.value, mean.error, reflected + through);
        CHECK_MEAN(mean.value, mean.error, reflected + through, 4.5, .003);
        end_pile(meshes, pile);
    }
}

/* Light from one side: what comes through a pile is the same from both. planted: as above. */
static void test_piles_are_reciprocal(double planted) {
    int pile, fast, side;
    for (pile = 0; pile < PILES; pile++)
        for (fast = 0; fast < 2; fast++) {
            solids_mean means[2];
            double reflected, through;
            for (side = 0; side < 2; side++) {
                itn_mesh meshes[PILE_OBJECTS];
                itn_image map = white_map();
                int x;
                stage s;
                for (x = 0; x < 4; x++) map.pixels[side ? x : 8 + x] = 0; /* zenith or nadir */
                begin_pile(&s, meshes, pile, side, 0, 1.5707963267948966, planted);
                stage_map(&s, NULL, &map); /* z has become -y */
                means[side] = mean_as(&s, fast ? 16384 : 40000,
                                      fast ? ITN_MODE_FAST : ITN_MODE_REFERENCE);
                pile_layers(pile, side, 0, &reflected, &through);
                CHECK_MEAN(means[side].value, means[side].error, through, 4.5, .003);
                end_pile(meshes, pile), itn_image_free(&map);
            }
            CHECK_MEAN(means[0].value - means[1].value, hypot(means[0].error, means[1].error), 0,
                       4.5, .005);
        }
}

/* A ball of water that fills a hollow in glass is what it is as a ball in whole glass: in either order
   of objects, where it is in the hollow, for rays of all slants. planted: the hollow is wider. */
static void test_liquid_fills_its_glass(double planted) {
    itn_mesh box = unit_box(), ball = solids_sphere(.7, 3), hollow = solids_sphere(.7 + planted, 3);
    itn_mesh glass;
    itn_error error;
    int i, fast, way;
    turn_over(&hollow);
    stage_need(itn_mesh_create(8 + hollow.vertex_count, 12 + hollow.triangle_count, 0, NULL, &glass,
                               &error), &error);
    memcpy(glass.positions, box.positions, 24 * sizeof(float));
    memcpy(glass.positions + 24, hollow.positions,
           3 * sizeof(float) * (size_t)hollow.vertex_count);
    memcpy(glass.triangles, box.triangles, 36 * sizeof(int));
    for (i = 0; i < 3 * hollow.triangle_count; i++)
        glass.triangles[36 + i] = 8 + hollow.triangles[i];
    for (fast = 0; fast < 2; fast++) {
        solids_mean means[3];
        for (way = 0; way < 3; way++) { /* whole glass; with a hollow, before the ball and after */
            stage s;
            stage_begin(&s, 24, 5, 30);
            s.desc.camera.eye.x = 1.3f, s.desc.camera.eye.y = .8f;
            stage_medium(&s, "a", .3, 0, 0), stage_medium(&s, "b", 1.5, .5, .5);
            stage_dielectric(&s, "a", 2, 0), stage_dielectric(&s, "b", 1.3, 0);
            if (way == 2) stage_object(&s, &ball, "b", "b");
            stage_object(&s, way ? &glass : &box, "a", "a");
            if (way < 2) stage_object(&s, &ball, "b", "b");
            stage_constant(&s, NULL, 1);
            means[way] = mean_as(&s, fast ? 64 : 128, fast ? ITN_MODE_FAST : ITN_MODE_REFERENCE);
            if (getenv("SHOW"))
                printf("liquid %d %d: %.5f +- %.5f\n", fast, way, means[way].value,
                       means[way].error);
            CHECK_MEAN(means[way].value - means[0].value,
                       hypot(means[way].error, means[0].error), 0, 4.5, .005);
        }
    }
    itn_mesh_free(&box), itn_mesh_free(&ball), itn_mesh_free(&hollow), itn_mesh_free(&glass);
}

/* Of rough boundaries in one point that of the later object holds, links to a light and directions
   alike: as if it reached a little into the other. planted: roughness that the other has more. */
static void test_rough_faces_in_one_point(double planted) {
    int fast, below;
    for (fast = 0; fast < 2; fast++)
        for (below = 0; below < 2; below++) {
            itn_image map = stage_patch(1, .25, below ? .9 : .1, 20);
            solids_mean means[2];
            int deep;
            for (deep = 0; deep < 2; deep++) {
                itn_mesh lower = solids_box(solids_vec3(-9, -1, -9), solids_vec3(9, 0, 9));
                itn_mesh upper = solids_box(solids_vec3(-9, deep ? -1e-4 : 0, -9),
                                            solids_vec3(9, 1, 9));
                stage s;
                stage_begin(&s, 1, 0, .001);
                s.desc.camera.eye = solids_vec3(2, below ? -9 : 9, 0);
                stage_medium(&s, "a", .5, .6, .3), stage_medium(&s, "b", .7, .4, 0);
                stage_dielectric(&s, "a", 2.2, deep ? .05 + planted : .05);
                stage_dielectric(&s, "b", 1.2, .5);
                stage_object(&s, &lower, "a", "a"), stage_object(&s, &upper, "b", "b");
                stage_map(&s, NULL, &map);
                means[deep] = mean_as(&s, fast ? 30000 : 80000,
                                      fast ? ITN_MODE_FAST : ITN_MODE_REFERENCE);
                itn_mesh_free(&lower), itn_mesh_free(&upper);
            }
            if (getenv("SHOW"))
                printf("rough %d %d: %.5f +- %.5f, %.5f +- %.5f\n", fast, below, means[0].value,
                       means[0].error, means[1].value, means[1].error);
            CHECK_MEAN(means[0].value - means[1].value, hypot(means[0].error, means[1].error), 0,
                       4.5, .02 * means[0].value);
            itn_image_free(&map);
        }
}

/* Glass on an opaque solid has air between them, as on the ground, in either order of objects: it is
   as bright as a little above. planted: how much above. */
static void test_glass_on_an_opaque_box(double planted) {
    int fast, order;
    for (fast = 0; fast < 2; fast++)
        for (order = 0; order < 2; order++) {
            solids_mean means[2];
            int above;
            for (above = 0; above < 2; above++) {
                double gap = above ? planted > 0 ? planted : 1e-4 : 0;
                itn_mesh lower = solids_box(solids_vec3(-9, -1, -9), solids_vec3(9, 0, 9));
                itn_mesh upper = solids_box(solids_vec3(-8, gap, -8), solids_vec3(8, gap + 1, 8));
                stage s;
                stage_begin(&s, 1, 0, .001);
                s.desc.camera.eye = solids_vec3(2, 9, 0);
                stage_medium(&s, "a", .2, .5, 0);
                stage_dielectric(&s, "a", 2, 0), stage_diffuse(&s, "b", .8);
                if (order) stage_object(&s, &lower, NULL, "b");
                stage_object(&s, &upper, "a", "a");
                if (!order) stage_object(&s, &lower, NULL, "b");
                stage_constant(&s, NULL, 1);
                means[above] = mean_as(&s, fast ? 20000 : 40000,
                                       fast ? ITN_MODE_FAST : ITN_MODE_REFERENCE);
                itn_mesh_free(&lower), itn_mesh_free(&upper);
            }
            if (getenv("SHOW"))
                printf("opaque %d %d: %.5f +- %.5f, %.5f +- %.5f\n", fast, order, means[0].value,
                       means[0].error, means[1].value, means[1].error);
            CHECK_MEAN(means[0].value - means[1].value, hypot(means[0].error, means[1].error), 0,
                       4.5, .004);
        }
}

#define RUN(call)                                                                                  \
    do {                                                                                           \
        clock_t start = clock();                                                                   \
        call;                                                                                      \
        if (getenv("SHOW"))                                                                        \
            printf("%s: %.2f s\n", #call, (double)(clock() - start) / CLOCKS_PER_SEC);             \
    } while (0)

int main(void) {
    RUN(test_parts_of_a_mesh(0));
    RUN(test_thin_parts(0));
    RUN(test_eye_in_touching_cubes(0));
    RUN(test_object_between_touching_cubes(0));
    RUN(test_ground_after_last_scattering(0));
    RUN(test_narrow_last_scattering(0));
    RUN(test_unused_medium());
    RUN(test_lights_through_a_hole(1));
    RUN(test_wall_behind_a_hole(0));
    RUN(test_edge_pixel(ITN_SAMPLER_SOBOL));
    RUN(test_thin_medium_with_a_hole(1));
    RUN(test_huge_sheets());
    RUN(test_far_unused_vertex());
    RUN(test_thin_slab_over_large_ground());
    RUN(test_standing_on_the_ground(0));
    RUN(test_glass_on_the_ground(0));
    RUN(test_forced_inside_out());
    RUN(test_inside_out_part(0));
    RUN(test_far_eye(0));
    RUN(test_speed_of_axis_parallel_rays());
    RUN(test_needles_under_a_map());
    RUN(test_huge_texture_coordinates());
    RUN(test_images_without_names_or_pixels());
    RUN(test_exploding_skies());
    RUN(test_power_of_the_sun(0));
    RUN(test_counts_at_the_limit());
    RUN(test_sizes_at_the_limit());
    RUN(test_names_that_collide());
    RUN(test_camera_vectors_of_any_length());
    RUN(test_index_goes_on_in_matched_objects());
    RUN(test_rough_boundary_without_step());
    RUN(test_index_derivative_beside_black_red(0));
    RUN(test_noise_with_an_index_asked_for());
    RUN(test_gradients_of_any_size());
    RUN(test_reports_of_the_loss());
    RUN(test_index_of_one());
    RUN(test_visitors(0));
    RUN(test_seeds_of_the_loss());
    RUN(test_refinement_in_dim_light(0));
    RUN(test_thickness_of_a_drawn_out_box(0));
    RUN(test_coordinates_beyond());
    RUN(test_size_of_a_pfm());
    RUN(test_texels_of_two());
    RUN(test_faces_in_one_point(0));
    RUN(test_piles_are_reciprocal(0));
    RUN(test_liquid_fills_its_glass(0));
    RUN(test_rough_faces_in_one_point(0));
    RUN(test_glass_on_an_opaque_box(0));
    CHECK_CATCHES(test_eye_in_touching_cubes(.02));
    CHECK_CATCHES(test_object_between_touching_cubes(.02));
    CHECK_CATCHES(test_narrow_last_scattering(.05));
    CHECK_CATCHES(test_ground_after_last_scattering(.05));
    CHECK_CATCHES(test_parts_of_a_mesh(-1));
    CHECK_CATCHES(test_inside_out_part(.01));
    CHECK_CATCHES(test_far_eye(.03));
    CHECK_CATCHES(test_thin_parts(4));
    CHECK_CATCHES(test_lights_through_a_hole(1.05));
    CHECK_CATCHES(test_wall_behind_a_hole(.1));
    CHECK_CATCHES(test_edge_pixel(ITN_SAMPLER_RANDOM));
    CHECK_CATCHES(test_thin_medium_with_a_hole(1.1));
    CHECK_CATCHES(test_standing_on_the_ground(.5));
    CHECK_CATCHES(test_glass_on_the_ground(.3));
    CHECK_CATCHES(test_power_of_the_sun(.003));
    CHECK_CATCHES(test_index_derivative_beside_black_red(.05));
    CHECK_CATCHES(test_visitors(1));
    CHECK_CATCHES(test_refinement_in_dim_light(-.6));
    CHECK_CATCHES(test_thickness_of_a_drawn_out_box(1));
    CHECK_CATCHES(test_faces_in_one_point(1e-4));
    CHECK_CATCHES(test_piles_are_reciprocal(1e-4));
    CHECK_CATCHES(test_liquid_fills_its_glass(.01));
    CHECK_CATCHES(test_rough_faces_in_one_point(.3));
    CHECK_CATCHES(test_glass_on_an_opaque_box(3));
    return check_end("regressions");
}
