/* Hard cases: extreme media, surfaces, sizes, places and shapes; walks that must not get lost; bad
   descs, memory that runs out, callers that cancel.

   Most cases are furnaces: in a constant light of radiance 1, solids that lose no light (albedo 1,
   index-matched or smooth) are invisible, so every pixel is 1, exactly up to rounding for every
   path. A walk that slips through a wall, or out of one, ends in another medium than it should, and
   a pixel differs by a path's share. */
#ifndef ITN_APART
#define ITN_IMPLEMENTATION
#endif
#include "../itn.h"

#include <limits.h>
#include <time.h>

#include "check.h"
#include "solids.h"
#include "stage.h"

#include "limit_cases.h"

/* ---- furnaces --------------------------------------------------------------------------------------- */

/* Renders in one way and checks every pixel of the mean: 1 within rounding. Returns the largest
   distance. */
static double check_furnace_way(const char *title, stage *s, int spp, int way, double planted) {
    itn_scene *scene = stage_make(s);
    itn_render_options options = ITN_ZERO;
    itn_render_stats stats = ITN_ZERO;
    itn_image image = ITN_ZERO;
    itn_error error;
    double worst = 0;
    int i, count;
    options.spp = spp, options.stats = &stats;
    solids_way(&options, way);
    stage_need(itn_render(scene, NULL, &options, NULL, 0, &image, &error), &error);
    count = image.width * image.height;
    for (i = 0; i < count; i++) {
        double off = fabs(image.pixels[i] + planted / spp - 1);
        if (!(off <= worst)) worst = off;
    }
    /* no rounding in beta: factors are 1 or not there */
    check_report(worst <= 1e-6, __FILE__, __LINE__, "%s, way %d: a pixel is off by %g (a path of %d: %g)",
                 title, way, worst, spp, 1. / spp);
    if (getenv("SHOW"))
        printf("%s: off %.2g, %g paths, %.3g collisions\n", title, worst, stats.paths,
               stats.collisions);
    itn_image_free(&image);
    itn_scene_free(scene);
    return worst;
}

static double check_furnace(const char *title, stage *s, int spp, double planted) {
    double worst = 0;
    int way;
    if (!check_long()) spp = (spp + 7) / 8;
    for (way = 0; way < SOLIDS_WAYS; way++)
        worst = fmax(worst, check_furnace_way(title, s, spp, way, planted));
    return worst;
}

typedef struct furnace {
    double sigma_t, g, ior; /* ior 0: index-matched */
    double size, offset;    /* radius or half side; distance of the solid from the scene's origin */
    int spp;
} furnace;

/* A sphere or box, seen whole, in all its parameters. */
static void test_furnace(const furnace *f, int box, double planted) {
    itn_mesh mesh = box ? solids_box(solids_vec3(-f->size, -f->size, -f->size),
                                     solids_vec3(f->size, f->size, f->size))
                        : solids_sphere(f->size, 2);
    char title[160];
    itn_object_desc *object;
    stage s;
    stage_begin(&s, 16, 4 * f->size, 40);
    s.desc.camera.eye.x = s.desc.camera.target.x = (float)f->offset;
    s.desc.camera.eye.y = (float)(-f->offset + 1.1 * f->size);
    s.desc.camera.target.y = (float)-f->offset;
    stage_medium(&s, "m", f->sigma_t, 1, f->g);
    if (f->ior != 0) stage_dielectric(&s, "s", f->ior, 0);
    object = stage_object(&s, &mesh, "m", f->ior != 0 ? "s" : NULL);
    if (f->offset != 0) {
        object->transform[0] = object->transform[5] = object->transform[10] = 1;
        object->transform[3] = (float)f->offset, object->transform[7] = (float)-f->offset;
    }
    stage_constant(&s, NULL, 1);
    snprintf(title, sizeof title, "%s sigma_t %g g %g ior %g size %g offset %g",
             box ? "box" : "sphere", f->sigma_t, f->g, f->ior, f->size, f->offset);
    check_furnace(title, &s, f->spp, planted);
    itn_mesh_free(&mesh);
}

static void test_furnaces(void) {
    static const furnace cases[] = {
        {1e-4, 0, 0, 1, 0, 400},     {1, 0, 0, 1, 0, 400},        {100, 0, 0, 1, 0, 400},
        {500, 0, 0, 1, 0, 8},        {1e4, .999, 0, 1, 0, 16},     {10, .999, 0, 1, 0, 400},
        {10, -.999, 0, 1, 0, 400},    {10, .9, 0, 1, 0, 800},      {0, 0, 0, 1, 0, 400},
        {1e-4, 0, 1.5, 1, 0, 800},   {1, .5, 1.5, 1, 0, 800},     {20, .5, 1.5, 1, 0, 200},
        {1, .5, 1.0001, 1, 0, 400},  {1, .5, 4, 1, 0, 200},        {1, .5, 1, 1, 0, 400},
        {1e4, .5, 0, 1e-4, 0, 400},  {1e-4, .5, 0, 1e4, 0, 400},  {1e5, .5, 1.4, 1e-4, 0, 800},
        {1e-3, .5, 1.4, 1e4, 0, 400}, {1, .5, 0, 1, 1000, 400},    {5, .5, 1.4, 1, 1000, 400},
        {1, .5, 0, 1, 1e5, 800},     {1e8, 0, 0, 1e-8, 0, 800},   {1e-8, 0, 1.5, 1e8, 0, 400},
    };
    int k;
    for (k = 0; k < (int)(sizeof cases / sizeof cases[0]); k++) {
        test_furnace(&cases[k], 0, 0);
        if (k % 3 == 0 || check_long()) test_furnace(&cases[k], 1, 0);
    }
}

/* A lossless box of optical thickness 20000: one path in some hundreds wanders on for more than a
   million events, from where on it is cut by chance (and counts more if it lives), so that every
   call ends. All others are exact. */
static void test_very_thick(void) {
    itn_mesh mesh = solids_box(solids_vec3(-1, -1, -1), solids_vec3(1, 1, 1));
    itn_render_options options = ITN_ZERO;
    itn_image image = ITN_ZERO;
    itn_error error;
    itn_scene *scene;
    solids_mean mean;
    stage s;
    int i, way;
    stage_begin(&s, 16, 4, 40);
    stage_medium(&s, "m", 1e4, 1, 0);
    stage_object(&s, &mesh, "m", NULL);
    stage_constant(&s, NULL, 1);
    scene = stage_make(&s);
    for (way = 0; way < 2; way++) {
        int off = 0;
        options.spp = 2;
        solids_way(&options, way);
        stage_need(itn_render(scene, NULL, &options, NULL, 0, &image, &error), &error);
        for (i = 0; i < 256; i++) {
            off += image.pixels[i] != 1;
            CHECK(image.pixels[i] >= 0 && isfinite(image.pixels[i]));
        }
        CHECK(off <= 4);
        mean = solids_plane_mean(&image, "Y", "Variance.Y");
        CHECK_NEAR(mean.value, 1, 4.5 * mean.error + 1e-6);
        itn_image_free(&image);
    }
    itn_scene_free(scene);
    itn_mesh_free(&mesh);
}

/* A box stretched by powers of two: thin sheets and needles. */
static void test_thin(void) {
    static const double heights[] = {1e-1, 1e-3, 1e-5, 1e-6};
    int k, ior;
    for (k = 0; k < 4; k++)
        for (ior = 0; ior < 2; ior++) {
            double h = heights[k];
            itn_mesh sheet = solids_box(solids_vec3(-1, -h, -1), solids_vec3(1, h, 1));
            itn_mesh needle = solids_box(solids_vec3(-1, -h, -h), solids_vec3(1, h, h));
            char title[80];
            stage s;
            int shape;
            for (shape = 0; shape < 2; shape++) {
                stage_begin(&s, 16, 3, shape && h < .01 ? 400 * h : 30);
                s.desc.camera.eye.y = (float)(shape ? 2 * h : .3);
                stage_medium(&s, "m", ior ? 1 : .5 / h, 1, 0);
                stage_dielectric(&s, "s", 1.5, 0);
                stage_object(&s, shape ? &needle : &sheet, "m", ior ? "s" : NULL);
                stage_constant(&s, NULL, 1);
                snprintf(title, sizeof title, "%s of %g, ior %d", shape ? "needle" : "sheet", h,
                         ior);
                check_furnace(title, &s, 400, 0);
            }
            itn_mesh_free(&sheet), itn_mesh_free(&needle);
        }
}

/* A fan of needle triangles: a cone of 4096 sides with a lid. */
static itn_mesh needle_cone(void) {
    enum { SIDES = 4096 };
    itn_mesh mesh;
    itn_error error;
    int i;
    stage_need(itn_mesh_create(SIDES + 2, 2 * SIDES, 0, NULL, &mesh, &error), &error);
    for (i = 0; i < SIDES; i++) {
        double phi = 2 * 3.14159265358979 * i / SIDES;
        int next = (i + 1) % SIDES, *t = mesh.triangles + 6 * i;
        mesh.positions[3 * i] = (float)cos(phi), mesh.positions[3 * i + 2] = (float)sin(phi);
        mesh.positions[3 * i + 1] = -1;
        t[0] = next, t[1] = i, t[2] = SIDES; /* side */
        t[3] = i, t[4] = next, t[5] = SIDES + 1; /* lid */
    }
    mesh.positions[3 * SIDES + 1] = 1, mesh.positions[3 * (SIDES + 1) + 1] = -1;
    return mesh;
}

/* Two boxes that share an edge, as one mesh: a surface that touches itself. */
static itn_mesh touching_mesh(void) {
    itn_mesh a = solids_box(solids_vec3(-1, -1, -1), solids_vec3(0, 0, 1)), both;
    itn_mesh b = solids_box(solids_vec3(0, 0, -1), solids_vec3(1, 1, 1));
    itn_error error;
    int i;
    stage_need(itn_mesh_create(16, 24, 0, NULL, &both, &error), &error);
    memcpy(both.positions, a.positions, 24 * sizeof(float));
    memcpy(both.positions + 24, b.positions, 24 * sizeof(float));
    for (i = 0; i < 36; i++)
        both.triangles[i] = a.triangles[i], both.triangles[36 + i] = 8 + b.triangles[i];
    itn_mesh_free(&a), itn_mesh_free(&b);
    return both;
}

static void test_shapes(void) {
    itn_mesh cone = needle_cone(), touching = touching_mesh();
    itn_mesh sphere = solids_sphere(1, 3), core = solids_sphere(.5, 2), seed = solids_sphere(.2, 1);
    int ior;
    for (ior = 0; ior < 2; ior++) {
        const char *surface = ior ? "s" : NULL;
        int k;
        for (k = 0; k < 3; k++) {
            static const char *const titles[] = {"cone of needles", "touching mesh", "nested"};
            char title[64];
            stage s;
            stage_begin(&s, 16, 4, 40);
            s.desc.camera.eye.y = 1;
            stage_medium(&s, "m", 2, 1, .5);
            stage_medium(&s, "dense", 30, 1, .5);
            stage_dielectric(&s, "s", 1.5, 0);
            stage_dielectric(&s, "t", 1.2, 0);
            stage_object(&s, k == 0 ? &cone : k == 1 ? &touching : &sphere, "m", surface);
            if (k == 2) {
                stage_object(&s, &core, "dense", ior ? "t" : NULL);
                stage_object(&s, &seed, NULL, ior ? "s" : NULL);
                if (!ior) s.objects[2].medium = "m";
            }
            stage_constant(&s, NULL, 1);
            snprintf(title, sizeof title, "%s, ior %d", titles[k], ior);
            check_furnace(title, &s, ior ? 200 : 400, 0);
        }
    }
    itn_mesh_free(&cone), itn_mesh_free(&touching);
    itn_mesh_free(&sphere), itn_mesh_free(&core), itn_mesh_free(&seed);
}

/* The eye inside of a medium, on its wall, in its corner; views along walls. */
static void test_eyes(void) {
    static const float eyes[][6] = {
        {0, 0, 0, 1, .2f, .1f},      {0, 0, .999f, 0, 0, -1},   {0, 1, 0, 1, 1, .01f},
        {-1, 0, 0, 1, .001f, 0},     {-3, 1, 0, 1, 1, 0},       {-3, .9999999f, 0, 1, .9999999f, 0},
        {3, 3, 3, 1, 1, 1},          {1, 1, 1, -1, -1, -1},     {3, 1.0000001f, .5f, -1, 1, .5f},
        {0, -3, 0, 0, 1, .001f},
    };
    itn_mesh box = solids_box(solids_vec3(-1, -1, -1), solids_vec3(1, 1, 1));
    int k, ior;
    for (ior = 0; ior < 2; ior++)
        for (k = 0; k < 10; k++) {
            char title[64];
            stage s;
            stage_begin(&s, 16, 4, k < 4 ? 60 : 1);
            memcpy(&s.desc.camera.eye, eyes[k], 3 * sizeof(float));
            memcpy(&s.desc.camera.target, eyes[k] + 3, 3 * sizeof(float));
            s.desc.camera.up.z = 1, s.desc.camera.up.x = .1f;
            stage_medium(&s, "m", 2, 1, .5);
            stage_dielectric(&s, "s", 1.3, 0);
            stage_object(&s, &box, "m", ior ? "s" : NULL);
            stage_constant(&s, NULL, 1);
            snprintf(title, sizeof title, "eye %d, ior %d", k, ior);
            check_furnace(title, &s, 400, 0);
        }
    itn_mesh_free(&box);
}

/* ---- comparisons between renders --------------------------------------------------------------------- */

static solids_mean measure(stage *s, int spp, uint64_t seed) {
    itn_scene *scene = stage_make(s);
    solids_mean mean;
    itn_render_options options = ITN_ZERO;
    options.spp = spp, options.seed = seed;
    solids_measure(scene, NULL, &options, NULL, 0, &mean);
    itn_scene_free(scene);
    return mean;
}

/* An absorbing, rough solid at all scales and far from the origin: the same picture. The same seeds
   draw the same paths but where rounding decides, so pixels agree, most of them, to a few ulps. */
static void test_scale(void) {
    static const double scales[] = {1, 1e-4, 1e4, 1, 3};
    static const double offsets[] = {0, 0, 0, 1000, -3e4};
    itn_image images[5];
    int k, i;
    for (k = 0; k < 5; k++) {
        double size = scales[k], offset = offsets[k];
        itn_mesh mesh = solids_sphere(size, 2);
        itn_image map = stage_patch(1, .6, .3, 5);
        itn_scene *scene;
        itn_object_desc *object;
        itn_render_options options = ITN_ZERO;
        itn_error error;
        stage s;
        stage_begin(&s, 16, 4 * size, 32);
        s.desc.camera.eye.z = (float)(4 * size + offset), s.desc.camera.target.z = (float)offset;
        stage_medium(&s, "m", 2 / size, .9, .5);
        stage_dielectric(&s, "s", 1.4, .2);
        object = stage_object(&s, &mesh, "m", "s");
        object->transform[0] = object->transform[5] = object->transform[10] = 1;
        object->transform[11] = (float)offset;
        stage_map(&s, NULL, &map);
        scene = stage_make(&s);
        options.spp = 32;
        stage_need(itn_render(scene, NULL, &options, NULL, 0, &images[k], &error), &error);
        itn_scene_free(scene);
        itn_image_free(&map);
        itn_mesh_free(&mesh);
    }
    for (k = 1; k < 5; k++) {
        solids_mean a = solids_plane_mean(&images[0], "Y", "Variance.Y");
        solids_mean b = solids_plane_mean(&images[k], "Y", "Variance.Y");
        int near_by = 0;
        for (i = 0; i < 256; i++)
            near_by += fabs(images[0].pixels[i] - images[k].pixels[i]) <=
                       1e-3 * fabs(images[0].pixels[i]);
        if (getenv("SHOW"))
            printf("scale %g offset %g: %d of 256 pixels the same, means %g %g\n", scales[k],
                   offsets[k], near_by, a.value, b.value);
        CHECK_MEAN(a.value - b.value, hypot(a.error, b.error), 0, 4, .03 * a.value);
        CHECK(near_by > 128);
    }
    for (k = 0; k < 5; k++) itn_image_free(&images[k]);
}

/* Two boxes with a coincident face and the same medium are one box: compared in an absorbing
   medium, where a lost or doubled layer shows. planted: the second box moves away by so much. */
static void test_touching_boxes(double planted) {
    itn_mesh left = solids_box(solids_vec3(-1, -1, -1), solids_vec3(0, 1, 1));
    itn_mesh right = solids_box(solids_vec3(0, -1, -1), solids_vec3(1, 1, 1));
    itn_mesh whole = solids_box(solids_vec3(-1, -1, -1), solids_vec3(1, 1, 1));
    int view, smooth;
    for (view = 0; view < 6; view++) {
        solids_mean one, two;
        stage s;
        stage_begin(&s, 16, 4, 25);
        smooth = view >= 3; /* index-matched, or of glass */
        if (view % 3 == 1) s.desc.camera.eye = solids_vec3(4, .3, .2);
        if (view % 3 == 2) s.desc.camera.eye = solids_vec3(0, .5, 4); /* along the shared face */
        stage_medium(&s, "m", .8, .7, .3);
        stage_dielectric(&s, "s", 1.5, 0);
        stage_object(&s, &whole, "m", smooth ? "s" : NULL);
        stage_constant(&s, NULL, 1);
        one = measure(&s, 150, 1);
        s.objects[0].mesh = &left;
        stage_object(&s, &right, "m", smooth ? "s" : NULL);
        s.objects[1].transform[0] = s.objects[1].transform[5] = s.objects[1].transform[10] = 1;
        s.objects[1].transform[3] = (float)planted;
        two = measure(&s, 150, 2);
        CHECK_MEAN(two.value - one.value, hypot(one.error, two.error), 0, 4.5, .005);
        /* and lossless: nothing between them */
        s.media[0].albedo[0] = 1;
        if (planted == 0) check_furnace("touching boxes", &s, 400, 0);
    }
    itn_mesh_free(&left), itn_mesh_free(&right), itn_mesh_free(&whole);
}

/* Small parameters tend to the limit: alpha 1e-3 is nearly smooth, ior 1.0001 nearly nothing, albedo
   1 - 1e-6 nearly lossless, g 1e-8 isotropic. */
static void test_limits(void) {
    itn_mesh mesh = solids_sphere(1, 2);
    itn_image map = stage_patch(1, .6, .3, 5);
    solids_mean a, b;
    stage s;
    stage_begin(&s, 16, 4, 32);
    stage_medium(&s, "m", 1, .9, 0);
    stage_dielectric(&s, "s", 1.5, 0);
    stage_object(&s, &mesh, "m", "s");
    stage_map(&s, NULL, &map);
    a = measure(&s, 100, 1);
    s.surfaces[0].alpha = .001f;
    b = measure(&s, 100, 2);
    CHECK_MEAN(a.value - b.value, hypot(a.error, b.error), 0, 4.5, .02);
    s.surfaces[0].alpha = 0, s.surfaces[0].ior = 1.0001f;
    a = measure(&s, 100, 3);
    s.surfaces[0].alpha = .3f; /* barely turned: all facets transmit straight on */
    b = measure(&s, 100, 3);
    CHECK(b.value < a.value + 4.5 * hypot(a.error, b.error) && b.value > .8 * a.value);
    s.objects[0].surface = NULL;
    b = measure(&s, 100, 4);
    CHECK_MEAN(a.value - b.value, hypot(a.error, b.error), 0, 4.5, .02);
    s.media[0].g = 1e-8f;
    a = measure(&s, 100, 5);
    CHECK_MEAN(a.value - b.value, hypot(a.error, b.error), 0, 4.5, .02);
    itn_image_free(&map);
    itn_mesh_free(&mesh);
}

/* A limit at one of its values, by the reference and by what AUTO takes: radiance and derivatives
   agree with the truth, and variance planes tell how far they scatter (24 batches know that to a
   factor of 2). At the nearest value derivatives may be mostly noise, at the furthest they are not.
   planted: relative error of the truth of quantity `which`. */
static void test_limit(const limit *l, int value, int which, double planted) {
    itn_scene *scene = limit_make(l, value);
    double truth[LIMIT_QUANTITIES], claimed[LIMIT_QUANTITIES];
    int way, k;
    limit_truth(l, value, truth);
    for (way = 0; way < 2; way++) {
        itn_render_options options = ITN_ZERO;
        solids_mean means[LIMIT_QUANTITIES];
        options.spp = 4, options.seed = (uint64_t)way + 1;
        options.mode = way ? ITN_MODE_AUTO : ITN_MODE_REFERENCE;
        limit_measure(l, scene, &options, means, claimed);
        for (k = 0; k < limit_quantities(l); k++) {
            const char *name = limit_name(l, k);
            double expected = truth[k] * (1 + (k == which ? planted : 0)), error = means[k].error;
            double rounding = limit_rounding(truth, k);
            double largest = !way && k && l->asked[k - 1] == LIMIT_G ? .4 : .1;
            check_report(fabs(means[k].value - expected) <= 5 * error + rounding, __FILE__,
                         __LINE__, "%s, %s, way %d: %.7g +- %.2g, expected %.7g", l->name, name,
                         way, means[k].value, error, expected);
            check_report(error <= rounding ||
                             (claimed[k] < 2.5 * error && claimed[k] > .35 * error),
                         __FILE__, __LINE__, "%s, %s, way %d: error %.3g, the plane says %.3g",
                         l->name, name, way, error, claimed[k]);
            if (getenv("SHOW"))
                printf("%s, value %d, %s, way %d: %.5g +- %.2g (%.3f)\n", l->name, value, name, way,
                       means[k].value, error, error / fabs(truth[k]));
            if (k == 0 || value == 0)
                check_report(error <= largest * fabs(truth[k]), __FILE__, __LINE__,
                             "%s, value %d, %s, way %d: error %.3g of %.3g", l->name, value, name,
                             way, error, truth[k]);
        }
    }
    itn_scene_free(scene);
}

static void test_limit_cases(void) {
    int k;
    for (k = 0; k < LIMIT_COUNT; k++) {
        test_limit(&limits[k], 0, 0, 0);
        test_limit(&limits[k], LIMIT_VALUES - 1, 0, 0);
    }
}

/* Values and derivatives at the ends of all ranges: finite, and not negative where they are
   radiances. */
static void test_extremes(void) {
    static const float sigma_t[] = {0, 1e-4f, 1, 1e4f}, albedo[] = {0, 1, .5f};
    static const float g[] = {-.999f, 0, .999f}, alpha[] = {0, .001f, 1};
    static const float ior[] = {1.0001f, 1.5f, 4};
    itn_mesh mesh = solids_box(solids_vec3(-1, -1, -1), solids_vec3(1, 1, 1));
    itn_image map = stage_patch(1, .6, .3, 5);
    int n, bad = 0, cases = 0;
    for (n = 0; n < 4 * 3 * 3 * 3 * 3; n++) {
        itn_render_options options = ITN_ZERO;
        itn_image image = ITN_ZERO;
        itn_error error;
        stage s;
        itn_scene *scene;
        int parameters[8], count = 0, k;
        size_t i;
        stage_begin(&s, 4, 4, 50);
        stage_medium(&s, "m", sigma_t[n % 4], albedo[n / 4 % 3], g[n / 12 % 3]);
        stage_dielectric(&s, "s", ior[n / 108], alpha[n / 36 % 3]);
        stage_object(&s, &mesh, "m", "s");
        stage_map(&s, NULL, &map);
        scene = stage_make(&s);
        for (k = 0; k < itn_parameter_count(scene); k++)
            if (alpha[n / 36 % 3] > 0 || strcmp(itn_parameter_get(scene, k)->name, "s.ior"))
                parameters[count++] = k;
        options.spp = 8, options.max_scatter = 2000;
        stage_need(itn_render(scene, NULL, &options, parameters, count, &image, &error), &error);
        for (i = 0; i < 16 * (size_t)image.plane_count; i++)
            bad += !isfinite(image.pixels[i]) || (i < 16 && image.pixels[i] < 0);
        itn_image_free(&image);
        for (options.walks = 1; options.walks <= 4; options.walks += 3) { /* the fast walk */
            stage_need(itn_render(scene, NULL, &options, NULL, 0, &image, &error), &error);
            for (i = 0; i < 32; i++) bad += !isfinite(image.pixels[i]) || image.pixels[i] < 0;
            if (options.walks == 1) itn_image_free(&image);
        }
        if (bad && !cases)
            printf("sigma_t %g albedo %g g %g ior %g alpha %g: not finite\n", (double)sigma_t[n % 4],
                   (double)albedo[n / 4 % 3], (double)g[n / 12 % 3], (double)ior[n / 108],
                   (double)alpha[n / 36 % 3]);
        cases += bad > 0, bad = 0;
        itn_image_free(&image);
        itn_scene_free(scene);
    }
    CHECK(cases == 0);
    itn_image_free(&map);
    itn_mesh_free(&mesh);
}

/* Light that can never leave: an eye in a smooth cube of index 4 with next to no medium or with none,
   or between white walls, where it sees nothing. Paths end all the same, within .01 s or so; .5 s
   each where a medium might yet scatter them. */
enum { THIN, CLEAR, WHITE };
static void test_trapped(int kind) {
    itn_mesh box = solids_box(solids_vec3(-1, -1, -1), solids_vec3(1, 1, 1));
    itn_render_options options = ITN_ZERO;
    itn_image image = ITN_ZERO;
    itn_error error;
    itn_scene *scene;
    stage s;
    clock_t start = clock();
    int i, way;
    stage_begin(&s, 2, 4, 10);
    s.desc.camera.eye = solids_vec3(0, 0, 0), s.desc.camera.target = solids_vec3(1, .9, .8);
    stage_medium(&s, "m", 1e-12, 1, 0);
    stage_dielectric(&s, "s", 4, 0);
    stage_diffuse(&s, "w", 1);
    stage_object(&s, &box, kind == THIN ? "m" : NULL, kind == WHITE ? "w" : "s");
    stage_constant(&s, NULL, 1);
    scene = stage_make(&s);
    options.spp = 16;
    for (way = 0; way < 2; way++) {
        solids_way(&options, way);
        stage_need(itn_render(scene, NULL, &options, NULL, 0, &image, &error), &error);
        for (i = 0; i < 4; i++)
            CHECK(kind == THIN ? image.pixels[i] >= 0 && isfinite(image.pixels[i])
                               : image.pixels[i] == 0);
        itn_image_free(&image);
    }
    CHECK((double)(clock() - start) / CLOCKS_PER_SEC < 16); /* 128 paths */
    itn_scene_free(scene);
    itn_mesh_free(&box);
}

/* ---- searches at the limits ------------------------------------------------------------------ */

typedef struct limit_search {
    const char *name; /* of the unknown */
    float hidden, start;
} limit_search;

/* The hidden value is one of a picture that can be made; starts are ordinary. The first is no limit:
   a search that is determined. */
static const limit_search limit_searches[] = {
    {"m.albedo", .8f, .5f},
    {"m.albedo", 0, .5f},  {"m.albedo", 1, .8f},       {"m.g", .999f, .5f},
    {"m.g", -.999f, 0},    {"m.g", 0, .5f},            {"m.sigma_t", 0, .5f},
    {"m.sigma_t", 1e4f, 5}, {"s.alpha", .001f, .3f},    {"s.ior", 1.0001f, 1.3f},
    {"light.scale", 0, 1}, {"floor.reflectance", 0, .5f}, {"sealed.sigma_t", 1, 2},
    {"sealed.albedo", .5f, .9f},
};

typedef struct limit_watch {
    const itn_scene *scene;
    int steps, bad; /* bad: steps that are not finite or out of bounds */
} limit_watch;

static int watch_step(void *user, const itn_refine_step *step) {
    limit_watch *w = (limit_watch *)user;
    int k;
    if (step->fraction < 1) return 0;
    w->steps++, w->bad += !(fabs(step->misfit) < 1e30) || !(step->misfit_error >= 0);
    for (k = 0; k < itn_parameter_count(w->scene); k++) {
        const itn_parameter *p = itn_parameter_get(w->scene, k);
        w->bad += !(step->theta[k] >= p->lower && step->theta[k] <= p->upper);
    }
    return 0;
}

/* A ball of milk over a floor, of glass where alpha and ior are sought; beside it, in a closed shell
   that no light enters, a medium that does nothing. */
static itn_scene *limit_search_scene(const itn_mesh *ball, const itn_mesh *seed, int glass) {
    itn_object_desc *object;
    stage s;
    stage_begin(&s, 8, 5, 32);
    stage_medium(&s, "m", 2, .8, .3);
    stage_medium(&s, "sealed", 1, .5, 0);
    stage_dielectric(&s, "s", 1.4, .2);
    stage_diffuse(&s, "floor", .4);
    stage_object(&s, ball, "m", glass ? "s" : NULL);
    object = stage_object(&s, seed, NULL, "floor"); /* a shell, and in it */
    object->transform[0] = object->transform[5] = object->transform[10] = 1;
    object->transform[3] = 1.2f, object->transform[7] = -.8f;
    object = stage_object(&s, seed, "sealed", NULL);
    object->transform[0] = object->transform[5] = object->transform[10] = .5f;
    object->transform[3] = 1.2f, object->transform[7] = -.8f;
    stage_object(&s, NULL, NULL, "floor");
    stage_constant(&s, NULL, .7);
    return stage_make(&s);
}

/* Refines one unknown. The search must stay finite and within bounds, and must not
   stall silently: what it finds is right within its errors (a logarithm or logit never quite arrives
   at 0), or it is said not to be determined, or the misfit tells. planted: moves what is found. */
static void test_limit_search(const limit_search *in, double planted) {
    itn_mesh ball = solids_sphere(1, 2), seed = solids_sphere(.4, 1);
    itn_scene *scene = limit_search_scene(&ball, &seed, !strncmp(in->name, "s.", 2));
    int unknown = itn_parameter_find(scene, in->name);
    itn_render_options options = ITN_ZERO;
    itn_refine_options refine = ITN_ZERO;
    itn_image target = ITN_ZERO;
    itn_estimate estimate;
    itn_error error;
    float theta[64];
    double misfit, off;
    itn_refine_outcome outcome;
    limit_watch watch;
    itn_parameter_values(scene, theta);
    theta[unknown] = in->hidden;
    options.spp = 64, options.seed = 5;
    stage_need(itn_render(scene, theta, &options, NULL, 0, &target, &error), &error);
    theta[unknown] = in->start;
    watch.scene = scene, watch.steps = watch.bad = 0;
    refine.spp = in->hidden == .999f ? 128 : 32; /* fewer there, and noise leads astray */
    refine.iterations = 12;
    refine.target_variance = target.pixels + 64, refine.outcome = &outcome;
    refine.progress = watch_step, refine.progress_user = &watch;
    stage_need(itn_refine(scene, theta, target.pixels, &unknown, 1, &refine, &estimate, &error),
               &error);
    misfit = outcome.misfit;
    off = fabs(estimate.value + planted - in->hidden);
    check_report(watch.bad == 0 && watch.steps > 0 && theta[unknown] == (float)estimate.value,
                 __FILE__, __LINE__, "%s to %g, %d of %d steps are bad", in->name,
                 (double)in->hidden, watch.bad, watch.steps);
    check_report(fabs(estimate.value) < 1e30 && estimate.standard_error >= 0 && misfit >= 0,
                 __FILE__, __LINE__, "%s to %g, %g +- %g, misfit %g", in->name,
                 (double)in->hidden, estimate.value, estimate.standard_error, misfit);
    check_report(!estimate.determined || off <= 5 * estimate.standard_error + 1e-3 || misfit > 3,
                 __FILE__, __LINE__, "%s to %g, stalled at %g +- %g, misfit %g",
                 in->name, (double)in->hidden, estimate.value,
                 estimate.standard_error, misfit);
    check_report(misfit < 3 || !strcmp(in->name, "light.scale"),
                 __FILE__, __LINE__, "%s to %g: misfit %g is left", in->name, (double)in->hidden,
                 misfit); /* a light is black only at 0, which its logarithm has not */
    if (!strncmp(in->name, "sealed", 6))
        CHECK(!estimate.determined && estimate.value == in->start);
    if (getenv("SHOW"))
        printf("%s to %g, %g +- %.2g, determined %d, misfit %.2f, %d steps\n", in->name,
               (double)in->hidden, estimate.value, estimate.standard_error,
               estimate.determined, misfit, watch.steps);
    itn_image_free(&target);
    itn_scene_free(scene);
    itn_mesh_free(&ball), itn_mesh_free(&seed);
}

static void test_limit_searches(void) {
    int k;
    for (k = 0; k < (int)(sizeof limit_searches / sizeof limit_searches[0]); k++)
        test_limit_search(&limit_searches[k], 0);
}

/* ---- bad descs ---------------------------------------------------------------------------------------- */

/* A full scene that is valid; `spoil` may then break one thing. */
typedef struct theatre {
    stage s;
    itn_mesh mesh, open;
    itn_image map, texture;
    float uvs[80 * 6];
} theatre;

static void theatre_open(theatre *t, int channels) {
    int i;
    t->mesh = solids_sphere(1, 1), t->open = solids_sphere(1, 1);
    t->open.triangle_count--;
    t->map = stage_patch(channels, .6, .3, 5), t->texture = stage_patch(channels, .5, .5, .5);
    for (i = 0; i < 480; i++) t->uvs[i] = .01f * (float)i;
    stage_begin(&t->s, 4, 4, 30);
    t->s.desc.film.channels = channels;
    stage_medium(&t->s, "milk", 1, .8, .3);
    stage_dielectric(&t->s, "glass", 1.4, .2);
    stage_diffuse(&t->s, "floor", .5)->texture = ITN_TEXTURE_CHECKER;
    stage_diffuse(&t->s, "paint", .5)->texture = ITN_TEXTURE_IMAGE;
    t->s.surfaces[2].image = &t->texture;
    stage_object(&t->s, &t->mesh, "milk", "glass");
    stage_object(&t->s, NULL, NULL, "floor");
    stage_object(&t->s, &t->mesh, NULL, "paint");
    t->mesh.uvs = t->uvs;
    stage_constant(&t->s, NULL, 1);
    stage_map(&t->s, "map", &t->map);
    stage_sky(&t->s, "sky");
}

static void theatre_close(theatre *t) {
    t->mesh.uvs = NULL;
    itn_mesh_free(&t->mesh), itn_mesh_free(&t->open);
    itn_image_free(&t->map), itn_image_free(&t->texture);
}

/* Expects itn_scene_create to refuse the theatre with `wanted`, naming the item; the output stays. */
static void refuse(theatre *t, itn_result wanted, const char *word, int line) {
    itn_scene *scene = (itn_scene *)(void *)t, *before = scene;
    itn_error error;
    itn_result result;
    memset(&error, 0, sizeof error);
    result = itn_scene_create(&t->s.desc, NULL, &scene, &error);
    check_report(result == wanted && error.code == wanted && strstr(error.message, word) != NULL,
                 __FILE__, line, "expected '%s' about %s, got '%s': %s", itn_result_text(wanted),
                 word, itn_result_text(result), error.message);
    check_report(result == ITN_OK || scene == before, __FILE__, line, "scene touched");
    if (result == ITN_OK) itn_scene_free(scene);
    result = itn_scene_create(&t->s.desc, NULL, &scene, NULL); /* nobody listens */
    if (result == ITN_OK) itn_scene_free(scene);
}

/* SPOIL(what, word): does it to theatre t, and expects ARGUMENT naming the word. */
#define SPOIL_AS(wanted, what, word)                                                               \
    do {                                                                                           \
        theatre t;                                                                                 \
        theatre_open(&t, channels);                                                                \
        what;                                                                                      \
        refuse(&t, wanted, word, __LINE__);                                                        \
        theatre_close(&t);                                                                         \
    } while (0)
#define SPOIL(what, word) SPOIL_AS(ITN_ERROR_ARGUMENT, what, word)

static void test_bad_numbers(int channels) {
    static const float bad[] = {NAN, INFINITY, -INFINITY, -1, 1e30f};
    int k;
    { /* the theatre itself is fine */
        theatre t;
        itn_scene *scene = NULL;
        itn_error error;
        theatre_open(&t, channels);
        stage_need(itn_scene_create(&t.s.desc, NULL, &scene, &error), &error);
        itn_scene_free(scene);
        theatre_close(&t);
    }
    for (k = 0; k < 5; k++) {
        float x = bad[k];
        int last = channels - 1;
        SPOIL(t.s.media[0].sigma_t = x, "milk");
        SPOIL(t.s.media[0].albedo[last] = x, "milk");
        SPOIL(t.s.media[0].g = k == 3 ? -1 : x, "milk");
        SPOIL(t.s.surfaces[0].ior = x, "glass");
        SPOIL(t.s.surfaces[0].alpha = x, "glass");
        SPOIL(t.s.surfaces[1].reflectance[last] = x, "floor");
        SPOIL(t.s.surfaces[1].reflectance2[last] = x, "floor");
        if (k < 4) SPOIL(t.s.surfaces[1].checker_size = x, "floor");
        SPOIL(t.texture.pixels[5] = x, "paint");
        SPOIL(t.map.pixels[5] = x, "map");
        SPOIL(t.s.lights[0].radiance[last] = x, "light");
        SPOIL(t.s.lights[0].scale = x, "light");
        SPOIL(t.s.lights[1].scale = x, "map");
        SPOIL(t.s.lights[2].scale = x, "sky");
        SPOIL(t.s.lights[2].sun_scale = x, "sky");
        SPOIL(t.s.lights[2].sky.radiance[1] = x, "sky");
        SPOIL(t.s.lights[2].sky.sun_radiance[1] = x, "sky");
        SPOIL(t.s.lights[2].sun_radius_scale = x, "sky");
        SPOIL(t.s.lights[2].sun_direction.y = k == 4 ? 0 : x, "sky");
        SPOIL(t.s.desc.camera.fov = x, "camera");
        if (k < 3) {
            int i;
            for (i = 0; i < 9; i++)
                SPOIL(t.s.lights[2].sky.coefficients[k][i] = x, "sky");
            SPOIL(t.s.lights[2].sun_direction.x = x, "sky");
            SPOIL(t.s.desc.camera.eye.x = x, "camera");
            SPOIL(t.s.desc.camera.target.y = x, "camera");
            SPOIL(t.s.desc.camera.up.z = x, "camera");
            SPOIL(t.s.objects[1].plane_y = x, "object 2");
            SPOIL(t.s.objects[1].half_size = x, "object 2");
            SPOIL(t.s.objects[0].transform[7] = x, "object 1");
            SPOIL_AS(ITN_ERROR_MESH, t.mesh.positions[7] = x, "object 1");
            SPOIL_AS(ITN_ERROR_MESH, t.uvs[7] = x, "object 3");
        }
    }
    SPOIL(t.s.desc.camera.fov = 180, "camera");
    SPOIL(t.s.surfaces[0].ior = .9f, "glass");
    SPOIL(t.s.surfaces[0].ior = 4.1f, "glass");
    SPOIL(t.s.surfaces[0].alpha = .0009f, "glass");
    SPOIL(t.s.surfaces[0].alpha = 1.1f, "glass");
    SPOIL(t.s.objects[1].half_size = 0, "object 2");
    SPOIL(t.s.objects[1].half_size = -1, "object 2");
}

static void test_bad_words(int channels) {
    static char long_name[100];
    memset(long_name, 'a', 99);
    SPOIL(t.s.desc.film.width = -1, "film");
    SPOIL(t.s.desc.film.height = 1 << 20, "film");
    SPOIL(t.s.desc.film.channels = 2, "film");
    SPOIL(t.s.desc.film.filter = (itn_filter)5, "film");
    SPOIL(t.s.desc.film.deviation = .5f, "film");
    SPOIL((t.s.desc.film.filter = ITN_FILTER_GAUSSIAN, t.s.desc.film.deviation = NAN), "film");
    SPOIL((t.s.desc.film.filter = ITN_FILTER_GAUSSIAN, t.s.desc.film.deviation = -1), "film");
    SPOIL(t.s.desc.camera.target = t.s.desc.camera.eye, "camera");
    SPOIL(t.s.desc.camera.up.z = 1, "camera");
    SPOIL(t.s.media[0].name = NULL, "medium");
    SPOIL(t.s.media[0].name = "", "medium");
    SPOIL(t.s.media[0].name = "a b", "medium");
    SPOIL(t.s.media[0].name = "9a", "medium");
    SPOIL(t.s.media[0].name = long_name, "medium");
    SPOIL(t.s.surfaces[2].name = "floor", "floor"); /* twice */
    SPOIL(t.s.surfaces[1].name = NULL, "surface");
    SPOIL(t.s.surfaces[1].type = (itn_surface_type)9, "floor");
    SPOIL(t.s.surfaces[1].texture = (itn_texture_type)9, "floor");
    SPOIL(t.s.surfaces[2].image = NULL, "paint");
    SPOIL(t.s.lights[1].image = NULL, "map");
    SPOIL(t.s.lights[1].type = (itn_light_type)9, "map");
    SPOIL(t.s.lights[1].name = "light", "light");
    SPOIL(t.s.objects[0].medium = "honey", "object 1");
    SPOIL(t.s.objects[0].surface = "honey", "object 1");
    SPOIL((t.s.objects[0].medium = NULL, t.s.objects[0].surface = NULL), "object 1");
    SPOIL(t.s.objects[1].medium = "milk", "object 2");
    SPOIL((t.s.objects[0].transform[0] = 1, t.s.objects[0].transform[5] = 1), "object 1");
    SPOIL(t.mesh.triangle_count = 0, "object 1");
    SPOIL(t.mesh.vertex_count = -3, "object 1");
    SPOIL(t.s.desc.object_count = 0, "objects");
    SPOIL(t.s.desc.object_count = 65, "objects");
    SPOIL(t.s.desc.object_count = -1, "objects");
    SPOIL(t.s.desc.light_count = 1000, "lights");
    SPOIL(t.s.desc.light_count = -1, "lights");
    SPOIL(t.s.desc.medium_count = -1, "media");
    SPOIL(t.s.desc.medium_count = 1 << 30, "media");
    SPOIL(t.s.desc.surface_count = INT_MAX, "surfaces");
    SPOIL(t.s.desc.media = NULL, "NULL");
    SPOIL(t.s.desc.surfaces = NULL, "NULL");
    SPOIL(t.s.desc.objects = NULL, "NULL");
    SPOIL(t.s.desc.lights = NULL, "NULL");
}

/* Meshes that are no solids are refused for media and dielectrics, saying which edges; with `force`
   they are taken, and nothing crashes. Diffuse surfaces need no solid. */
static void test_bad_meshes(void) {
    int channels = 1, k;
    SPOIL_AS(ITN_ERROR_MESH, t.s.objects[0].mesh = &t.open, "3 open");
    SPOIL_AS(ITN_ERROR_MESH, (t.s.objects[0].mesh = &t.open, t.s.objects[0].surface = NULL),
             "object 1");
    SPOIL_AS(ITN_ERROR_MESH, (t.s.objects[0].mesh = &t.open, t.s.objects[0].medium = NULL),
             "object 1");
    SPOIL_AS(ITN_ERROR_MESH, t.mesh.triangles[4] = 999999, "object 1");
    SPOIL_AS(ITN_ERROR_MESH, t.mesh.triangles[4] = -1, "object 1");
    SPOIL_AS(ITN_ERROR_MESH, t.s.objects[1].surface = "glass", "object 2"); /* a plane of glass */
    SPOIL_AS(ITN_OK, (t.s.objects[2].mesh = &t.open, t.s.objects[0].force = 1), "");
    for (k = 0; k < 3; k++) {
        theatre t;
        itn_image image = ITN_ZERO;
        itn_error error;
        itn_scene *scene = NULL;
        itn_render_options options = ITN_ZERO;
        int i, way, bad = 0;
        theatre_open(&t, 1);
        t.mesh.uvs = NULL;
        if (k == 0) t.s.objects[0].mesh = &t.open;
        for (i = 0; i < (k == 1 ? t.mesh.triangle_count : k == 2 ? 1 : 0); i++) {
            int swap = t.mesh.triangles[3 * i]; /* inside out; one triangle flipped */
            t.mesh.triangles[3 * i] = t.mesh.triangles[3 * i + 1];
            t.mesh.triangles[3 * i + 1] = swap;
        }
        refuse(&t, ITN_ERROR_MESH, k == 0 ? "open" : k == 1 ? "inside out" : "flipped", __LINE__);
        t.s.objects[0].force = 1;
        stage_need(itn_scene_create(&t.s.desc, NULL, &scene, &error), &error);
        options.spp = 64, options.max_scatter = 1000;
        for (way = 0; way < SOLIDS_WAYS; way++) {
            solids_way(&options, way);
            stage_need(itn_render(scene, NULL, &options, NULL, 0, &image, &error), &error);
            for (i = 0; i < 32; i++) bad += !isfinite(image.pixels[i]);
            itn_image_free(&image);
        }
        CHECK(bad == 0);
        itn_scene_free(scene);
        theatre_close(&t);
    }
}

/* A mesh that has each of its faces twice, once for either side, encloses nothing: the message says
   so, and advises no `force`, which would not help. */
static void test_two_sided(void) {
    itn_scene *scene = NULL;
    itn_error error;
    itn_mesh twice = ITN_ZERO;
    theatre t;
    int i, count;
    theatre_open(&t, 1);
    count = t.mesh.triangle_count;
    stage_need(itn_mesh_create(t.mesh.vertex_count, 2 * count, 0, NULL, &twice, &error), &error);
    memcpy(twice.positions, t.mesh.positions, 3 * (size_t)t.mesh.vertex_count * sizeof(float));
    for (i = 0; i < 6 * count; i++) /* the second half backwards, which turns each triangle */
        twice.triangles[i] = t.mesh.triangles[i < 3 * count ? i : 6 * count - 1 - i];
    t.s.objects[0].mesh = &twice;
    memset(&error, 0, sizeof error);
    CHECK(itn_scene_create(&t.s.desc, NULL, &scene, &error) == ITN_ERROR_MESH);
    CHECK(strstr(error.message, "twice") && !strstr(error.message, "force"));
    itn_mesh_free(&twice);
    theatre_close(&t);
}

/* Directions need no unit length: huge and tiny ones mean the same. */
static void test_directions(void) {
    static const float sizes[] = {1, 1e-30f, 1e30f};
    double value[3];
    int k;
    for (k = 0; k < 3; k++) {
        stage s;
        itn_light_desc *sky;
        stage_begin(&s, 4, 4, 30);
        s.desc.camera.eye.y = 2;
        stage_diffuse(&s, "floor", .5);
        stage_object(&s, NULL, NULL, "floor");
        sky = stage_sky(&s, "sky");
        sky->sun_direction = solids_vec3(.1 * sizes[k], sizes[k], .1 * sizes[k]);
        s.desc.camera.up = solids_vec3(0, sizes[k], 0);
        value[k] = measure(&s, 64, 1).value;
        check_report(fabs(value[k] - value[0]) < 1e-3 * value[0], __FILE__, __LINE__,
                     "directions of length %g: mean %g, expected %g", (double)sizes[k], value[k],
                     value[0]);
    }
}

/* ---- arguments ---------------------------------------------------------------------------------------- */

static int cancel_after(void *user, double fraction) {
    (void)fraction;
    return --*(int *)user <= 0;
}

/* NULL and nonsense for every function that can fail; outputs stay as they were. */
static void test_arguments(void) {
    theatre t;
    itn_scene *scene = NULL, *far_off = NULL;
    itn_image image, untouched;
    itn_render_options options = ITN_ZERO;
    itn_context half = ITN_ZERO;
    itn_error error;
    float weights[16], theta[64];
    double gradient = 7, variance = 7, loss = 7;
    int parameters[2] = {0, 1}, same[2] = {1, 1}, wrong = 1000, k;
    memset(&image, 0x5a, sizeof image);
    untouched = image;
    theatre_open(&t, 1);
    half.allocate = (void *(*)(size_t, void *))0;
    half.deallocate = (void (*)(void *, void *))0;
    CHECK(itn_scene_create(NULL, NULL, &scene, &error) == ITN_ERROR_ARGUMENT);
    CHECK(itn_scene_create(&t.s.desc, NULL, NULL, &error) == ITN_ERROR_ARGUMENT);
    CHECK(scene == NULL);
    stage_need(itn_scene_create(&t.s.desc, &half, &scene, &error), &error);
    for (k = 0; k < 16; k++) weights[k] = 1;
    options.spp = 2;
#define REFUSED(call) CHECK((call) == ITN_ERROR_ARGUMENT && error.code == ITN_ERROR_ARGUMENT)
    t.s.desc.camera.eye = solids_vec3(0, 3e6, 4e6); /* of a scene that reaches a few units */
    REFUSED(itn_scene_create(&t.s.desc, NULL, &far_off, &error));
    CHECK(strstr(error.message, "5e+06 away") && far_off == NULL);
    REFUSED(itn_render(NULL, NULL, &options, NULL, 0, &image, &error));
    REFUSED(itn_render(scene, NULL, &options, NULL, 0, NULL, &error));
    REFUSED(itn_render(scene, NULL, &options, NULL, 1, &image, &error));
    REFUSED(itn_render(scene, NULL, &options, parameters, -1, &image, &error));
    REFUSED(itn_render(scene, NULL, &options, same, 2, &image, &error));
    REFUSED(itn_render(scene, NULL, &options, &wrong, 1, &image, &error));
    REFUSED(itn_render_gradient(NULL, NULL, &options, weights, parameters, 1, &gradient, &variance,
                                &error));
    REFUSED(itn_render_gradient(scene, NULL, &options, NULL, parameters, 1, &gradient, &variance,
                                &error));
    REFUSED(itn_render_gradient(scene, NULL, &options, weights, NULL, 1, &gradient, &variance,
                                &error));
    REFUSED(itn_render_gradient(scene, NULL, &options, weights, parameters, 0, &gradient, &variance,
                                &error));
    REFUSED(itn_render_gradient(scene, NULL, &options, weights, parameters, 1, NULL, &variance,
                                &error));
    REFUSED(itn_loss_gradient(NULL, NULL, &options, weights, parameters, 1, &loss, &gradient,
                              &error));
    REFUSED(itn_loss_gradient(scene, NULL, &options, NULL, parameters, 1, &loss, &gradient,
                              &error));
    REFUSED(itn_loss_gradient(scene, NULL, &options, weights, parameters, 1, NULL, &gradient,
                              &error));
    REFUSED(itn_loss_gradient(scene, NULL, &options, weights, parameters, 1, &loss, NULL, &error));
    REFUSED(itn_loss_gradient(scene, NULL, &options, weights, &wrong, 1, &loss, &gradient, &error));
    weights[7] = NAN;
    REFUSED(itn_render_gradient(scene, NULL, &options, weights, parameters, 1, &gradient, &variance,
                                &error));
    REFUSED(itn_loss_gradient(scene, NULL, &options, weights, parameters, 1, &loss, &gradient,
                              &error));
    REFUSED(itn_loss_gradient(scene, NULL, &options, weights, NULL, 0, &loss, NULL, &error));
    weights[7] = 1;
    options.spp = -1;
    REFUSED(itn_render(scene, NULL, &options, NULL, 0, &image, &error));
    options.spp = 2, options.max_scatter = -1;
    REFUSED(itn_render(scene, NULL, &options, NULL, 0, &image, &error));
    options.max_scatter = 0, options.mode = (itn_mode)9;
    REFUSED(itn_render(scene, NULL, &options, NULL, 0, &image, &error));
    options.mode = ITN_MODE_AUTO, options.walks = 257;
    REFUSED(itn_render(scene, NULL, &options, NULL, 0, &image, &error));
    options.walks = -1;
    REFUSED(itn_render(scene, NULL, &options, NULL, 0, &image, &error));
    options.walks = 0, options.sampler = (itn_sampler)9;
    REFUSED(itn_render(scene, NULL, &options, NULL, 0, &image, &error));
    options.sampler = ITN_SAMPLER_SOBOL, options.estimator = (itn_estimator)9;
    REFUSED(itn_render(scene, NULL, &options, NULL, 0, &image, &error));
    options.estimator = ITN_ESTIMATOR_BASELINE, options.spp = INT_MAX; /* of four walks each */
    REFUSED(itn_render(scene, NULL, &options, NULL, 0, &image, &error));
    options.spp = 2;
    REFUSED(itn_image_create(0, 4, 1, NULL, &image, &error));
    REFUSED(itn_image_create(4, -1, 1, NULL, &image, &error));
    REFUSED(itn_image_create(4, 4, 0, NULL, &image, &error));
    for (k = ITN_OK; k <= ITN_ERROR_CANCELLED; k++)
        CHECK(itn_result_text((itn_result)k)[0] &&
              (k == ITN_OK || strcmp(itn_result_text((itn_result)k), itn_result_text(ITN_OK))));
    CHECK(itn_result_text((itn_result)99) != NULL);
    for (k = 0; k < itn_parameter_count(scene); k++) {
        static const float bad[] = {NAN, INFINITY, -2};
        int i;
        for (i = 0; i < 3; i++) {
            itn_parameter_values(scene, theta);
            theta[k] = bad[i];
            REFUSED(itn_render(scene, theta, &options, NULL, 0, &image, &error));
            CHECK(strstr(error.message, itn_parameter_get(scene, k)->name) != NULL);
        }
    }
    for (k = 1; k <= 3; k += 2) { /* cancelled at the first and at a later call */
        int left = k;
        options.mode = k == 1 ? ITN_MODE_AUTO : ITN_MODE_REFERENCE; /* which calls more often */
        options.progress = cancel_after, options.progress_user = &left;
        CHECK(itn_render(scene, NULL, &options, parameters, 2, &image, &error) ==
              ITN_ERROR_CANCELLED && error.code == ITN_ERROR_CANCELLED);
        left = k;
        CHECK(itn_render_gradient(scene, NULL, &options, weights, parameters, 1, &gradient,
                                  &variance, NULL) == ITN_ERROR_CANCELLED);
        left = k;
        CHECK(itn_loss_gradient(scene, NULL, &options, weights, parameters, 1, &loss, &gradient,
                                NULL) == ITN_ERROR_CANCELLED);
    }
    CHECK(!memcmp(&image, &untouched, sizeof image));
    CHECK(gradient == 7 && variance == 7 && loss == 7);
    CHECK(itn_parameter_get(scene, -1) == NULL && itn_parameter_get(scene, 1000) == NULL);
    CHECK(itn_parameter_find(scene, "milk.nothing") == -1);
    CHECK(itn_scene_thickness(scene, NULL, "nothing") == 0);
    itn_scene_free(NULL), itn_image_free(NULL);
    itn_scene_free(scene);
    theatre_close(&t);
}

/* ---- memory ------------------------------------------------------------------------------------------- */

typedef struct bank {
    int calls, live, fail_at; /* fail_at: number of the call that fails, 0 none */
    int every;                /* 1: also all calls after it */
} bank;

static void *bank_allocate(size_t bytes, void *user) {
    bank *b = (bank *)user;
    b->calls++;
    if (b->fail_at && (b->calls == b->fail_at || (b->every && b->calls > b->fail_at))) return NULL;
    b->live++;
    return malloc(bytes);
}
static void bank_free(void *block, void *user) {
    if (block) ((bank *)user)->live--;
    free(block);
}

/* Runs one of nine calls; returns its result after checking that failure left the output alone. */
static itn_result call_once(int which, const theatre *t, const itn_context *context,
                            const itn_scene *scene, int planted) {
    static const float target[16] = {1, 2, 3};
    itn_render_options options = ITN_ZERO;
    itn_refine_options refine = ITN_ZERO;
    itn_scene *made = (itn_scene *)(void *)&options, *before = made;
    itn_image image = ITN_ZERO;
    itn_estimate estimates[2], kept[2];
    itn_error error;
    itn_result result;
    double gradient[2] = {7, 7}, variance[2] = {7, 7}, loss = 7;
    float theta[64], theta_before[64];
    int parameters[2] = {0, 1};
    memset(&error, 0, sizeof error);
    options.spp = 2;
    switch (which) {
    case 0:
        result = itn_scene_create(&t->s.desc, context, &made, &error);
        if (result == ITN_OK && !planted) itn_scene_free(made);
        if (result) CHECK(made == before);
        break;
    case 6: /* the tables of a scene */
        result = itn_scene_create(&t->s.desc, context, &made, &error);
        if (result) break;
        result = itn_scene_prepare(made, NULL, &options, &error);
        itn_scene_free(made);
        break;
    case 7:
        result = itn_render(scene, NULL, &options, NULL, 0, &image, &error);
        if (result) CHECK(image.pixels == NULL && image.names == NULL && image.width == 0);
        itn_image_free(&image);
        break;
    case 1:
        result = itn_render(scene, NULL, &options, parameters, 2, &image, &error);
        if (result) CHECK(image.pixels == NULL && image.names == NULL && image.width == 0);
        itn_image_free(&image);
        break;
    case 2:
        result = itn_render_gradient(scene, NULL, &options, target, parameters, 2, gradient,
                                     variance, &error);
        if (result) CHECK(gradient[0] == 7 && gradient[1] == 7 && variance[0] == 7);
        break;
    case 3:
        result = itn_loss_gradient(scene, NULL, &options, target, parameters, 2, &loss, gradient,
                                   &error);
        if (result) CHECK(gradient[0] == 7 && gradient[1] == 7 && loss == 7);
        break;
    case 8:
        result = itn_render_texel_gradient(scene, NULL, &options, target, "paint", &image, &error);
        if (result) CHECK(image.pixels == NULL && image.names == NULL && image.width == 0);
        itn_image_free(&image);
        break;
    case 5: {
        itn_view views[2];
        float values[2] = {1, .8f};
        memset(views, 0, sizeof views), memset(estimates, 0x5a, sizeof estimates);
        memcpy(kept, estimates, sizeof kept);
        views[0].scene = views[1].scene = scene, views[0].target = views[1].target = target;
        views[0].parameters = views[1].parameters = parameters;
        refine.spp = 2, refine.iterations = 2;
        result = itn_refine_views(views, 2, values, 2, &refine, estimates, &error);
        if (result)
            CHECK(values[0] == 1 && values[1] == .8f && !memcmp(estimates, kept, sizeof kept));
        break;
    }
    default:
        memset(estimates, 0x5a, sizeof estimates);
        memcpy(kept, estimates, sizeof kept);
        itn_parameter_values(scene, theta);
        memcpy(theta_before, theta, sizeof theta);
        refine.spp = 2, refine.iterations = 2;
        result = itn_refine(scene, theta, target, parameters, 2, &refine, estimates, &error);
        if (result)
            CHECK(!memcmp(theta, theta_before,
                          (size_t)itn_parameter_count(scene) * sizeof(float)) &&
                  !memcmp(estimates, kept, sizeof kept));
        break;
    }
    if (result) CHECK(error.code == result && error.message[0]);
    return result;
}

/* Fails the k-th allocation, or that and all after it, for every k until a call succeeds; beyond 200
   steps grow with k, as searches render often, and each render asks alike. */
static void test_memory(int planted) {
    theatre t;
    bank b = ITN_ZERO;
    itn_context context = ITN_ZERO;
    itn_scene *scene = NULL;
    itn_error error;
    int which, every;
    theatre_open(&t, 1);
    context.allocate = bank_allocate, context.deallocate = bank_free, context.memory_user = &b;
    for (which = 0; which < (planted ? 1 : 9); which++)
        for (every = 0; every < 2; every++) {
            int k, live;
            itn_result result = ITN_ERROR_MEMORY;
            b.fail_at = 0;
            stage_need(itn_scene_create(&t.s.desc, &context, &scene, &error), &error);
            stage_need(itn_scene_prepare(scene, NULL, NULL, &error), &error); /* keeps its tables */
            stage_give_back(scene), live = b.live;
            for (k = 1; result != ITN_OK && k < 20000; k += k < 200 ? 1 : k / (9 + every)) {
                b.calls = 0, b.fail_at = k, b.every = every;
                result = call_once(which, &t, &context, scene, planted);
                if (!CHECK(result == ITN_OK || result == ITN_ERROR_MEMORY)) break;
                b.fail_at = 0, stage_give_back(scene);
                if (!check_report(b.live == live, __FILE__, __LINE__,
                                  "call %d, allocation %d failing: %d blocks leaked", which, k,
                                  b.live - live))
                    break;
            }
            CHECK(result == ITN_OK && k > 4); /* from the first to the last */
            if (getenv("SHOW")) printf("call %d: %d allocations\n", which, k - 2);
            itn_scene_free(scene);
            if (!planted) CHECK(b.live == 0);
        }
    { /* half an allocator */
        itn_context half = context;
        half.deallocate = NULL;
        scene = NULL;
        CHECK(itn_scene_create(&t.s.desc, &half, &scene, &error) == ITN_ERROR_ARGUMENT);
        half = context, half.allocate = NULL;
        CHECK(itn_scene_create(&t.s.desc, &half, &scene, &error) == ITN_ERROR_ARGUMENT);
        CHECK(scene == NULL);
    }
    theatre_close(&t);
}

static void plant_lost_path(void) {
    static const furnace f = {1, 0, 0, 1, 0, 100};
    test_furnace(&f, 0, -1); /* one path of a pixel is lost */
}

int main(void) {
    test_furnaces();
    test_very_thick();
    test_thin();
    test_shapes();
    test_eyes();
    test_scale();
    test_touching_boxes(0);
    test_limits();
    test_limit_cases();
    test_limit_searches();
    test_extremes();
    test_trapped(THIN);
    test_trapped(CLEAR);
    test_trapped(WHITE);
    test_bad_numbers(1);
    test_bad_numbers(3);
    test_bad_words(1);
    test_bad_words(3);
    test_bad_meshes();
    test_two_sided();
    test_directions();
    test_arguments();
    test_memory(0);
    CHECK_CATCHES(plant_lost_path());
    CHECK_CATCHES(test_touching_boxes(.3));
    CHECK_CATCHES(test_limit(&limits[1], LIMIT_VALUES - 1, 0, .02));
    CHECK_CATCHES(test_limit(&limits[9], 0, 1, .5));
    CHECK_CATCHES(test_limit_search(&limit_searches[0], .1));
#ifndef __SANITIZE_ADDRESS__ /* this one leaks on purpose */
    CHECK_CATCHES(test_memory(1));
#endif
    return check_end("stability");
}
