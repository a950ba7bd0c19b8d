/* Whole walks against exact answers of radiative transfer.

   UR1 and UT1 are the fluxes that a plane layer reflects and transmits of a normal beam. By
   reciprocity the same numbers are the radiance that a camera looking straight down sees in light
   that is 1 in the upper (lower) half of all directions, so a camera with a very narrow view over a
   very wide box measures them. Unless said otherwise the expected values come from adding-doubling
   in double precision, good to all digits given; it reproduces Chandrasekhar's H functions, van de
   Hulst's Multiple Light Scattering (1980), Table 12, and Giovanelli's .2600.

   ITN_LONG_TESTS=1 in the environment runs complete tables with a tenth of the error;
   ITN_VERBOSE=1 prints every measurement. */
#ifndef ITN_APART
#define ITN_IMPLEMENTATION
#endif
#include "../itn.h"
#include <time.h>

#include "check.h"
#include "solids.h"

static double effort = 3.2; /* factor of all standard errors asked for */
static const double sigmas = 4;
static uint64_t seed = 1; /* of the next run: every check has its own random numbers */

enum { MOST_QUANTITIES = 6 };
static const char *const by_albedo[1] = {"m.albedo"};

/* A measured quantity: NULL is the radiance, else the derivative in that parameter. */
typedef struct quantity {
    const char *name;
    double expected, largest; /* largest: standard error that is good enough */
    double slack;             /* of what is expected, relative */
} quantity;

static quantity wanted(const char *name, double expected, double largest) {
    quantity q;
    q.name = name, q.expected = expected, q.largest = largest, q.slack = 1e-6;
    return q;
}

static void check_quantity(const char *label, const quantity *q, solids_mean mean) {
    double largest = q->largest * effort;
    check_report(fabs(mean.value - q->expected) <=
                         sigmas * mean.error + q->slack * fabs(q->expected) &&
                     mean.error <= largest,
                 __FILE__, __LINE__,
                 "%s, %s: %.7g +- %.2g (at most %.2g), expected %.7g: %.1f sigma", label,
                 q->name ? q->name : "value", mean.value, mean.error, largest, q->expected,
                 (mean.value - q->expected) / mean.error);
    if (getenv("ITN_VERBOSE") && !check_quiet)
        printf("%-34s %-10s %11.6f +- %.6f  %11.6f  %5.2f\n", label, q->name ? q->name : "",
               mean.value, mean.error, q->expected, (mean.value - q->expected) / mean.error);
}

/* Measures all quantities (the first is the radiance) to the errors asked for, in one way to render
   (see solids_way): a short run tells how long the real one has to be; where that is very long, a
   longer one tells it better. */
static void measure_to(const solids_desc *desc, int max_scatter, int way, const quantity *q,
                       int count, solids_mean *means) {
    itn_render_options options = ITN_ZERO;
    itn_scene *scene = solids_scene(desc);
    const char *names[MOST_QUANTITIES];
    double factor = 1000;
    int k, spp;
    for (k = 1; k < count; k++) names[k - 1] = q[k].name;
    options.max_scatter = max_scatter, options.seed = seed++;
    solids_way(&options, way);
    for (spp = 20; spp < 1000 && factor >= 200; spp *= 20) {
        options.spp = spp, factor = 0;
        solids_measure(scene, NULL, &options, names, count - 1, means);
        for (k = 0; k < count; k++) {
            double ratio = means[k].error / (q[k].largest * effort);
            factor = fmax(factor, ratio * ratio * spp / 20);
        }
    }
    if (way) factor *= 1.6; /* the fast walk tells its error from fewer independent parts */
    options.spp = factor > 4e4 ? 1000000 : factor < .8 ? 20 : (int)(25 * factor);
    options.seed = seed++;
    solids_measure(scene, NULL, &options, names, count - 1, means);
    itn_scene_free(scene);
}

/* All quantities by the reference, and the radiance by the fast walk, which limits of scattering do
   not reach, with one of its samplers or, in long tests, both. */
static void check_scene(const char *label, const solids_desc *desc, int max_scatter,
                        const quantity *q, int count) {
    solids_mean means[MOST_QUANTITIES];
    int k, way;
    measure_to(desc, max_scatter, 0, q, count, means);
    for (k = 0; k < count; k++) check_quantity(label, &q[k], means[k]);
    for (way = 1; way < SOLIDS_WAYS && !max_scatter; way++)
        if (check_long() || (uint64_t)way == 1 + seed / 4 % 2) {
            measure_to(desc, max_scatter, way, q, 1, means);
            check_quantity(way == 1 ? "the same, fast, random" : "the same, fast, Sobol", q, means[0]);
        }
}

/* A planted error, after which random numbers go on from one place, wherever it is caught. */
#define CATCHES(call)                                                                              \
    do {                                                                                           \
        uint64_t next = seed + 4;                                                                  \
        CHECK_CATCHES(call);                                                                       \
        seed = next;                                                                               \
    } while (0)

/* ---- half-spaces ----------------------------------------------------------------------------- */

/* A box so deep and wide (in mean free paths) that nothing comes back from its other faces. */
static solids_desc half_space(itn_mesh *mesh, double albedo, double g) {
    solids_desc desc = ITN_ZERO;
    *mesh = solids_slab(600, 600);
    desc.mesh = mesh, desc.sigma_t = 1, desc.albedo = albedo, desc.g = g;
    return desc;
}

/* Reflectance of a half-space, error of the value relative to it; d/d sigma_t has to vanish. A
   derivative that is not known is given as 0 and not measured. */
static void check_half_space(double albedo, double g, double ior, double alpha, double value,
                             double by_a, double by_g) {
    quantity q[4];
    int count = 1;
    char label[80];
    itn_mesh mesh;
    solids_desc desc = half_space(&mesh, albedo, g);
    desc.ior = ior, desc.alpha = alpha;
    q[0] = wanted(NULL, value, (ior != 0 ? .003 : .002) * value);
    if (by_a != 0) q[count++] = wanted("m.albedo", by_a, .01 * by_a);
    if (by_a != 0) q[count++] = wanted("m.sigma_t", 0, .01 * by_a);
    if (by_g != 0) q[count++] = wanted("m.g", by_g, -.014 * by_g);
    sprintf(label, "half-space a %g g %g n %g", albedo, g, ior);
    check_scene(label, &desc, 0, q, count);
    itn_mesh_free(&mesh);
}

static void test_isotropic_half_spaces(void) {
    static const double rows[7][3] = {/* albedo, UR1, dUR1/da */
                                      {.3, .0572144, .238585},   {.5, .1152259, .354720},
                                      {.8, .2852545, .947970},   {.9, .4149475, 1.824176},
                                      {.95, .5355410, 3.281206}, {.99, .7527207, 10.487477},
                                      {.999, .9128453, 41.292438}};
    int k;
    for (k = 0; k < 7; k++) check_half_space(rows[k][0], 0, 0, 0, rows[k][1], rows[k][2], 0);
    CATCHES(check_half_space(.5, 0, 0, 0, 1.03 * .1152259, .354720, 0));
    CATCHES(check_half_space(.5, 0, 0, 0, .1152259, 1.12 * .354720, 0));
    CATCHES(check_half_space(.81, 0, 0, 0, .2852545, 0, 0));
}

static void test_half_spaces(void) {
    static const double albedo[5] = {.39, .59, .74, .87, .95}, g[5] = {0, .2, .4, .6, .8};
    static const double value[5][5] = {{.080517, .058776, .039290, .022544, .009191},
                                       {.150912, .117151, .083754, .051340, .021811},
                                       {.235587, .193310, .147645, .097901, .045047},
                                       {.366491, .319767, .264206, .195143, .104930},
                                       {.535541, .493217, .438471, .361920, .238946}};
    static const double slopes[6][4] = {/* row, column, dUR1/da, dUR1/dg */
                                        {2, 0, .72566, -.20389},  {2, 2, .59041, -.23810},
                                        {2, 4, .24477, -.26262},  {4, 0, 3.28121, -.18866},
                                        {4, 2, 3.58890, -.31690}, {4, 4, 3.30588, -.82254}};
    int r, c, k;
    for (k = 0; k < 6; k++) {
        r = (int)slopes[k][0], c = (int)slopes[k][1];
        check_half_space(albedo[r], g[c], 0, 0, value[r][c], slopes[k][2], slopes[k][3]);
    }
    for (r = 0; r < 5; r++)
        for (c = 0; c < 5; c++)
            if (check_long() || (r == 0 && c == 0) || (r == 3 && c == 3))
                check_half_space(albedo[r], g[c], 0, 0, value[r][c], 0, 0);
    CATCHES(check_half_space(.74, -.4, 0, 0, .147645, .59041, -.23810));
}

/* ---- Lambertian light ------------------------------------------------------------------------ */

/* URU (+ UTU) = 2 int_0^1 R(mu) mu dmu over tilted cameras, at eight Gauss nodes, which are
   rendered in all ways in turn. */
static void check_lambertian(const char *label, solids_desc desc, double expected) {
    static const double node[4] = {.1834346424956498, .5255324099163290, .7966664774136267,
                                   .9602898564975363};
    static const double weight[4] = {.3626837833783620, .3137066458778873, .2223810344533745,
                                     .1012285362903763};
    quantity q = wanted(NULL, expected, .002 * expected);
    solids_mean sum = ITN_ZERO;
    int k;
    for (k = 0; k < 8; k++) {
        double mu = .5 * (1 + (k < 4 ? -node[k] : node[k - 4])), w = mu * weight[k % 4];
        solids_mean mean;
        desc.eye = solids_vec3(sqrt(1 - mu * mu), mu, 0);
        measure_to(&desc, 0, k % SOLIDS_WAYS, &q, 1, &mean);
        sum.value += w * mean.value, sum.error += w * w * mean.error * mean.error;
    }
    sum.error = sqrt(sum.error);
    check_quantity(label, &q, sum);
}

static void test_lambertian(void) {
    itn_mesh mesh;
    solids_desc desc = half_space(&mesh, .8, 0);
    check_lambertian("Lambertian, half-space .8", desc, .3418668);
    desc.albedo = .95, desc.g = .8;
    check_lambertian("Lambertian, half-space .95, g .8", desc, .331967);
    itn_mesh_free(&mesh);
    mesh = solids_slab(2, 200);
    desc.albedo = .9, desc.g = .75;
    check_lambertian("Lambertian, slab .9, 2, .75", desc, .1910902 + .5018161);
    CATCHES(check_lambertian("", desc, .0973946 + .6609577));
    itn_mesh_free(&mesh);
}

/* ---- slabs ----------------------------------------------------------------------------------- */

typedef struct slab {
    double albedo, thickness, g;
    double value[2], by_a[2], by_b[2], by_g[2]; /* reflected, transmitted */
} slab;

static const slab slabs[8] = {
    {.9, 2, .75, {.0973946, .6609577}, {.46833, 1.46420}, {.033803, -.157257}, {-.45385, .63591}},
    {.8, 1, 0, {.2108466, .5413996}, {.49989, .43896}, {.099588, -.338569}, {-.21420, .20668}},
    {.8, 1, .8, {.0304135, .7638814}, {.09906, .76014}, {.022318, -.222474}, {-.19118, .30732}},
    {.5, 1, 0, {.099119, .446058}, {.27862, .22963}, {.030882, -.374277}, {-.13295, .11765}},
    {.95, 10, 0, {.535298, .019081}, {3.26372, .56306}, {.000185, -.007241}, {-.18953, .03878}},
    {.95, 10, .8, {.229769, .196842}, {2.86398, 3.08921}, {.003294, -.035364}, {-.87284, .92624}},
    {1, 4, 0, {.690926, .309074}, {4.95471, 3.69757}, {.056362, -.056362}, {-.22807, .22807}},
    {1, 4, .75, {.311639, .688361}, {2.91859, 4.40237}, {.064863, -.064863}, {-1.06857, 1.06857}}};

/* A map that is 1 in the upper (side 0) or lower (1) half of all directions. Between its two rows
   at the horizon it goes linearly, which moves fluxes by some 1e-6. */
static itn_image half_sphere(int side) {
    itn_image image;
    itn_error error;
    int r;
    solids_need(itn_image_create(1, 1024, 1, NULL, &image, &error), &error);
    strcpy(image.names[0], "Y");
    for (r = 0; r < 512; r++) image.pixels[side ? r + 512 : r] = 1;
    return image;
}

/* A slab in light from above (0), below (1) or everywhere (2). sigma_t is 1, so a derivative by it
   is b times that by b. Errors are relative to the sizes of what is added. */
static void check_slab(const slab *s, int side) {
    quantity q[4];
    char label[80];
    itn_mesh mesh = solids_slab(s->thickness, 200 * s->thickness);
    itn_image map = ITN_ZERO;
    solids_desc desc = ITN_ZERO;
    double share[2];
    share[0] = side != 1, share[1] = side != 0;
    if (side < 2) map = half_sphere(side), desc.map = &map;
    desc.mesh = &mesh, desc.sigma_t = 1, desc.albedo = s->albedo, desc.g = s->g;
#define SLAB_SUM(field, f) (f(share[0] * s->field[0]) + f(share[1] * s->field[1]))
    q[0] = wanted(NULL, SLAB_SUM(value, ), .002 * SLAB_SUM(value, fabs));
    q[1] = wanted("m.albedo", SLAB_SUM(by_a, ), .01 * SLAB_SUM(by_a, fabs));
    /* by sigma_t: absorption and scattering cancel, so the terms are larger than the sum */
    q[2] = wanted("m.sigma_t", s->thickness * SLAB_SUM(by_b, ),
                  .01 * (s->thickness * SLAB_SUM(by_b, fabs) + .5 * SLAB_SUM(value, fabs)));
    q[3] = wanted("m.g", SLAB_SUM(by_g, ), .01 * SLAB_SUM(by_g, fabs));
#undef SLAB_SUM
    sprintf(label, "slab a %g b %g g %g side %d", s->albedo, s->thickness, s->g, side);
    check_scene(label, &desc, 0, q, 4);
    itn_image_free(&map);
    itn_mesh_free(&mesh);
}

static void test_slabs(void) {
    slab wrong = slabs[1];
    int k;
    for (k = 0; k < 8; k++) { /* from one side, derivatives by g and sigma_t do not cancel */
        check_slab(&slabs[k], k % 2);
        if (check_long() || k == 0) check_slab(&slabs[k], (k + 1) % 2), check_slab(&slabs[k], 2);
    }
    wrong.by_b[1] *= 1.2;
    CATCHES(check_slab(&wrong, 2));
    wrong = slabs[0], wrong.g = -wrong.g;
    CATCHES(check_slab(&wrong, 2));
}

/* Values only. */
static void test_more_slabs(void) {
    static const double rows[5][4] = {{.9, 1, 0, .2674103 + .5916251},
                                      {.9, 4, 0, .4081422 + .1285237},
                                      {.99, 10, 0, .7409323 + .0847609},
                                      {.99, 10, .75, .4725709 + .3400124},
                                      {.5, 1, .9, .0049573 + .5907195}};
    int k;
    for (k = 0; k < 5; k++) {
        itn_mesh mesh = solids_slab(rows[k][1], 200 * rows[k][1]);
        quantity q = wanted(NULL, rows[k][3], .001 * rows[k][3]);
        solids_desc desc = ITN_ZERO;
        char label[80];
        desc.mesh = &mesh, desc.sigma_t = 1, desc.albedo = rows[k][0], desc.g = rows[k][2];
        sprintf(label, "slab a %g b %g g %g", rows[k][0], rows[k][1], rows[k][2]);
        check_scene(label, &desc, 0, &q, 1);
        itn_mesh_free(&mesh);
    }
}

/* ---- smooth faces ---------------------------------------------------------------------------- */

/* albedo, thickness, g, n, diffusely reflected (without the first mirror image), transmitted */
static const double faces[4][6] = {{.9, 2, .75, 1.5, .086822, .493147},
                                   {1, 4, 0, 1.5, .577962, .382038},
                                   {.99, 10, 0, 1.4, .594101, .102603},
                                   {0, 1, 0, 1.5, .044990 - .04, .339111}};

static void check_faces(const double *row, int side) {
    itn_mesh mesh = solids_slab(row[1], 200 * row[1]);
    itn_image map = ITN_ZERO;
    double mirror = (row[3] - 1) / (row[3] + 1) * (row[3] - 1) / (row[3] + 1), expected = 0;
    quantity q;
    solids_desc desc = ITN_ZERO;
    char label[80];
    desc.mesh = &mesh, desc.sigma_t = 1, desc.albedo = row[0], desc.g = row[2], desc.ior = row[3];
    if (side != 1) expected += mirror + row[4];
    if (side != 0) expected += row[5];
    q = wanted(NULL, expected, .003 * expected);
    if (side < 2) map = half_sphere(side), desc.map = &map;
    sprintf(label, "smooth slab a %g b %g n %g side %d", row[0], row[1], row[3], side);
    check_scene(label, &desc, 0, &q, 1);
    itn_image_free(&map);
    itn_mesh_free(&mesh);
}

static void test_smooth_faces(void) {
    int k;
    check_half_space(.9, 0, 1.5, 0, .04 + .21992, 1.3812, 0);
    check_half_space(.99, 0, 1.5, 0, .04 + .56198, 0, 0);
    check_half_space(.8, 0, 1.33, 0, .0200593 + .17020, 0, 0);
    check_half_space(.95, .9, 1.5, 0, .04 + .05722, 0, 0);
    /* a rough face that is nearly smooth */
    check_half_space(.9, 0, 1.5, .002, .04 + .21992, 0, 0);
    for (k = 0; k < 4; k++) check_faces(faces[k], 2);
    for (k = 0; k < 4; k++)
        if (check_long() || k == 0) check_faces(faces[k], 0), check_faces(faces[k], 1);
    CATCHES(check_half_space(.9, 0, 1.45, 0, .04 + .21992, 0, 0));
}

/* The derivative in the index of a smooth face is refused, not answered wrongly. */
static void test_smooth_ior(void) {
    itn_mesh mesh;
    solids_desc desc = half_space(&mesh, .9, 0);
    itn_image image = ITN_ZERO;
    itn_scene *scene;
    itn_error error;
    int ior;
    desc.ior = 1.5;
    scene = solids_scene(&desc);
    ior = itn_parameter_find(scene, "s.ior");
    CHECK(ior >= 0);
    CHECK(itn_render(scene, NULL, NULL, &ior, 1, &image, &error) == ITN_ERROR_UNSUPPORTED);
    CHECK(!image.pixels);
    itn_scene_free(scene);
    itn_mesh_free(&mesh);
}

/* Three channels in one walk are three half-spaces. */
static void check_channels(double worst_albedo) {
    static const double value[3] = {.1152259, .2852545, .5355410};
    static const double slope[3] = {.354720, .947970, 3.281206};
    itn_mesh mesh = solids_slab(600, 600);
    itn_medium_desc medium = ITN_ZERO;
    itn_object_desc object = ITN_ZERO;
    itn_light_desc light = ITN_ZERO;
    itn_scene_desc desc = ITN_ZERO;
    itn_render_options options = ITN_ZERO;
    itn_image image = ITN_ZERO;
    itn_scene *scene;
    itn_error error;
    int parameters[3], c, d;
    medium.name = "m", medium.sigma_t = 1, medium.albedo[0] = .5f, medium.albedo[1] = .8f;
    medium.albedo[2] = (float)worst_albedo;
    object.mesh = &mesh, object.medium = "m";
    for (c = 0; c < 3; c++) light.radiance[c] = (float)(c + 1);
    desc.media = &medium, desc.objects = &object, desc.lights = &light;
    desc.medium_count = desc.object_count = desc.light_count = 1;
    desc.film.width = desc.film.height = 16, desc.film.channels = 3;
    desc.camera.eye.y = desc.camera.up.z = 1, desc.camera.fov = .01f;
    solids_need(itn_scene_create(&desc, NULL, &scene, &error), &error);
    for (c = 0; c < 3; c++) {
        static const char *const names[3] = {"m.albedo_r", "m.albedo_g", "m.albedo_b"};
        parameters[c] = itn_parameter_find(scene, names[c]);
    }
    options.spp = 1200, options.seed = seed++;
    solids_need(itn_render(scene, NULL, &options, parameters, 3, &image, &error), &error);
    for (c = 0; c < 3; c++) {
        static const char *const rgb[3] = {"R", "G", "B"};
        char name[2][ITN_NAME_SIZE];
        solids_mean mean;
        sprintf(name[0], "Variance.%s", rgb[c]);
        mean = solids_plane_mean(&image, rgb[c], name[0]);
        CHECK_MEAN(mean.value, mean.error, (c + 1) * value[c], sigmas, .009 * (c + 1) * value[c]);
        for (d = 0; d < 3; d++) { /* by albedo d: nothing unless it is the channel's own */
            sprintf(name[0], "d_m_albedo_%c.%s", "rgb"[d], rgb[c]);
            sprintf(name[1], "d_m_albedo_%c_variance.%s", "rgb"[d], rgb[c]);
            mean = solids_plane_mean(&image, name[0], name[1]);
            CHECK_MEAN(mean.value, mean.error, c == d ? (c + 1) * slope[c] : 0, sigmas,
                       .03 * (c + 1) * slope[c]);
        }
    }
    itn_image_free(&image);
    options.spp = check_long() ? 600 : 300; /* times 4 */
    solids_need(itn_render(scene, NULL, &options, NULL, 0, &image, &error), &error);
    for (c = 0; c < 3; c++) {
        static const char *const planes[3][2] = {
            {"R", "Variance.R"}, {"G", "Variance.G"}, {"B", "Variance.B"}};
        solids_mean mean = solids_plane_mean(&image, planes[c][0], planes[c][1]);
        CHECK_MEAN(mean.value, mean.error, (c + 1) * value[c], sigmas, .009 * (c + 1) * value[c]);
    }
    itn_image_free(&image);
    itn_scene_free(scene);
    itn_mesh_free(&mesh);
}

static void test_channels(void) {
    check_channels(.95);
    CATCHES(check_channels(.94));
}

/* ---- single scattering, no scattering -------------------------------------------------------- */

/* Half-space, one scattering: UR1 = a (1 - ln 2) / 2. At albedo 0 the image is black, its
   derivative is not. */
static void test_single_scattering(void) {
    const double slope = .5 * (1 - log(2.));
    itn_mesh mesh;
    solids_desc desc = half_space(&mesh, .8, 0);
    quantity q[2];
    int scatter;
    q[0] = wanted(NULL, .8 * slope, .001 * .8 * slope);
    q[1] = wanted("m.albedo", slope, .001 * slope);
    check_scene("single scattering", &desc, 1, q, 2);
    q[0] = wanted(NULL, 0, 0), q[1].largest = .002 * slope;
    desc.albedo = 0;
    for (scatter = 0; scatter < 3; scatter++) {
        solids_mean means[2];
        static const char *const names[1] = {"m.albedo"};
        itn_render_options options = ITN_ZERO;
        itn_scene *scene = solids_scene(&desc);
        options.spp = 6000, options.max_scatter = scatter, options.seed = seed++;
        solids_measure(scene, NULL, &options, names, 1, means);
        CHECK(means[0].value == 0 && means[0].error == 0);
        q[1].largest = .0028 * slope / effort;
        check_quantity("albedo 0", &q[1], means[1]);
        options.spp = 500;
        solids_measure(scene, NULL, &options, NULL, 0, means); /* the fast walk */
        CHECK(means[0].value == 0 && means[0].error == 0);
        itn_scene_free(scene);
    }
    itn_mesh_free(&mesh);
}

/* A slab in a beam at cosine mu0, seen at cosine |mu|, from above (mu > 0) or below, at a right angle
   to the beam in azimuth. The beam is a sun, not quite parallel; pi times the reflection or
   transmission function is seen. */
static const double beam_slack = 4e-6;
static solids_desc beam(itn_mesh *mesh, itn_light_desc *light, double albedo, double thickness,
                        double mu0, double mu) {
    const double pi = 3.14159265358979323846, radius = .2679 * pi / 180;
    double solid_angle = 4 * pi * pow(sin(radius / 2), 2);
    solids_desc desc = ITN_ZERO;
    int k;
    *mesh = solids_slab(thickness, thickness > 100 ? thickness : 200 * thickness);
    memset(light, 0, sizeof *light);
    desc.mesh = mesh, desc.sigma_t = 1, desc.albedo = albedo, desc.light = light;
    light->type = ITN_LIGHT_SKY, light->sun_direction = solids_vec3(sqrt(1 - mu0 * mu0), mu0, 0);
    for (k = 0; k < 3; k++) light->sky.sun_radiance[k] = (float)(pi / (mu0 * solid_angle));
    desc.eye = solids_vec3(0, mu, sqrt(1 - mu * mu)), desc.up = solids_vec3(1, 0, 0);
    if (mu < 0) desc.eye.y -= (float)thickness, desc.target.y = -(float)thickness;
    return desc;
}

/* by_sigma_t: the derivative; 0: not asked for. */
static void check_beam(const char *label, double albedo, double thickness, double mu0, double mu,
                       int max_scatter, double expected, double by_sigma_t) {
    itn_mesh mesh;
    itn_light_desc light;
    solids_desc desc = beam(&mesh, &light, albedo, thickness, mu0, mu);
    quantity q[2];
    q[0] = wanted(NULL, expected, .002 * expected);
    q[1] = wanted("m.sigma_t", by_sigma_t, .003 * fabs(by_sigma_t));
    q[0].slack = q[1].slack = beam_slack;
    check_scene(label, &desc, max_scatter, q, by_sigma_t != 0 ? 2 : 1);
    itn_mesh_free(&mesh);
}

/* What a half-space of albedo .7, seen at cosine .5, reflects by one scattering; *paths receives how
   many mean free paths the ways in and out through a slab are long together, which reflects
   1 - e^-paths of that. */
static double single_beam(double thickness, double mu0, double *paths) {
    *paths = thickness * (1 / .5 + 1 / mu0);
    return .7 / (4 * (.5 + mu0));
}

/* A slab that scatters once, from so thin that one path in a thousand would collide. `planted`
   changes what is expected. */
static void check_single_beam(double thickness, double mu0, double planted) {
    double paths, most = single_beam(thickness, mu0, &paths);
    check_beam("beam, single", .7, thickness, mu0, .5, 1, most * -expm1(-paths) * (1 + planted),
               paths < 1 ? most * paths * exp(-paths) : 0);
}

/* However thin, what is seen is right, and as sure as the number of collisions lets it be. */
static void check_thin_beam(double thickness, double planted) {
    double paths, most = single_beam(thickness, .7, &paths), expected = most * -expm1(-paths);
    itn_mesh mesh;
    itn_light_desc light;
    solids_desc desc = beam(&mesh, &light, .7, thickness, .7, .5);
    itn_scene *scene = solids_scene(&desc);
    itn_render_options options = ITN_ZERO;
    solids_mean mean;
    options.spp = 1024, options.max_scatter = 1;
    solids_measure(scene, NULL, &options, NULL, 0, &mean);
    CHECK_NEAR(mean.value, expected * (1 + planted), sigmas * mean.error + beam_slack * expected);
    CHECK(mean.error <= 1.2 * expected / sqrt(1024 * 16 * 16 * 2 * thickness)); /* collisions */
    itn_scene_free(scene);
    itn_mesh_free(&mesh);
}

static void test_beams(void) {
    static const double mu[6] = {1, .9, .7, .5, .3, .1};
    /* van de Hulst, Table 12: isotropic, a = .8, b = 2, mu = .5 */
    static const double reflected[6] = {.28616, .30277, .34188, .39102, .45353, .53214};
    static const double transmitted[6] = {.14864, .14731, .13963, .12222, .09425, .06601};
    static const double h[3] = {1.1721431, 1.5560338, 1.8500985}; /* H at .1, .5, 1 for a = .9 */
    static const double at[3] = {.1, .5, 1};
    static const double thick[3] = {.001, .1, 2};
    int k, j;
    for (k = 0; k < 6; k++) {
        double m = mu[k];
        if (!check_long() && k % 2 == 1) continue;
        check_beam("beam, R", .8, 2, m, .5, 0, reflected[k], 0);
        if (check_long() || k == 0 || k == 4)
            check_beam("beam, T", .8, 2, m, -.5, 0, transmitted[k], 0);
        check_single_beam(1.5, m, 0);
    }
    for (k = 0; k < 3; k++) check_single_beam(thick[k], .7, 0);
    for (k = 0; k < 3; k++)
        for (j = 0; j < 3; j++)
            if (check_long() || j == 1)
                check_beam("beam, H", .9, 600, at[k], at[j], 0,
                           .9 / (4 * (at[k] + at[j])) * h[k] * h[j], 0);
    CATCHES(check_beam("", .8, 2, .7, -.5, 0, .14731, 0));
    CATCHES(check_single_beam(.1, .7, .03));
    check_thin_beam(.01, 0), check_thin_beam(.0001, 0);
    CATCHES(check_thin_beam(.01, .1));
}

/* ---- solids in uniform light ----------------------------------------------------------------- */

/* A camera so far off in direction d that its rays are parallel to 1/200; the film is a square of
   side 2.02 `radius` through the origin. */
static void look_from(solids_desc *desc, double radius, double x, double y, double z) {
    const double pi = 3.14159265358979323846, far = 200 * radius;
    desc->eye = solids_vec3(far * x, far * y, far * z);
    desc->up = fabs(x) < .8 ? solids_vec3(1, 0, 0) : solids_vec3(0, 1, 0);
    desc->fov = 360 / pi * atan(1.01 * radius / far);
    desc->width = desc->height = 64;
}

/* White furnace: albedo 1 in light 1 is 1 in every sample, whatever the solid. With seed 212 a ray
   of the first case runs into an edge of the outline, where it enters and leaves in one point. */
static void check_furnace(double sigma_t, double albedo, double g, double ior) {
    static const char *const names[2] = {"m.sigma_t", "m.g"};
    itn_mesh mesh = solids_sphere(1, 3);
    itn_render_options options = ITN_ZERO;
    itn_image image = ITN_ZERO;
    itn_scene *scene;
    itn_error error;
    solids_mean means[3];
    solids_desc desc = ITN_ZERO;
    int i, way;
    desc.mesh = &mesh, desc.sigma_t = sigma_t, desc.albedo = albedo, desc.g = g, desc.ior = ior;
    look_from(&desc, 1, 0, .6, .8);
    options.spp = sigma_t == 3 && g > 0 && ior == 0 ? 48 : 16, options.seed = 212;
    scene = solids_scene(&desc);
    for (way = 0; way < SOLIDS_WAYS; way++) {
        double worst = 0;
        solids_way(&options, way);
        solids_need(itn_render(scene, NULL, &options, NULL, 0, &image, &error), &error);
        for (i = 0; i < 64 * 64; i++)
            if (!(fabs((double)image.pixels[i] - 1) <= worst))
                worst = fabs((double)image.pixels[i] - 1); /* NaN, too */
        check_report(worst <= 1e-6, __FILE__, __LINE__,
                     "furnace sigma_t %g, albedo %g, g %g, n %g, way %d: a pixel is off by %g",
                     sigma_t, albedo, g, ior, way, worst);
        itn_image_free(&image);
    }
    solids_way(&options, 0);
    solids_measure(scene, NULL, &options, names, 2, means);
    /* with no scattering, light that is caught inside has derivatives of no finite variance */
    for (i = 1; i < 3 && (sigma_t > 0 || ior == 0); i++)
        CHECK_MEAN(means[i].value, means[i].error, 0, sigmas, .08);
    itn_scene_free(scene);
    itn_mesh_free(&mesh);
}

static void test_furnace(void) {
    static const double g[3] = {.8, 0, -.5}, ior[3] = {0, 1.33, 1.5};
    int k;
    for (k = 0; k < 9; k++)
        if (check_long() || k % 3 == k / 3) check_furnace(k < 6 ? 3 : 2, 1, g[k % 3], ior[k / 3]);
    check_furnace(0, 1, .5, 1.5);
    check_furnace(0, 1, .5, 0);
    CATCHES(check_furnace(3, .999, 0, 0));
}

/* Light spends the time in a solid that its volume allows, however it is scattered: the mean path
   of isotropic light is 4 volume / surface (Blanco and Fournier 2003), times n^2 inside a
   refracting boundary. So at albedo 1 the derivative in the albedo, integrated over the film and
   averaged over all directions to look from, is sigma_t n^2 volume. */
static void check_mean_path(const char *label, const itn_mesh *mesh, double radius, double sigma_t,
                            double g, double ior) {
    const int directions = check_long() ? 96 : 32;
    itn_mesh_report report;
    itn_error error;
    itn_render_options options = ITN_ZERO;
    solids_mean sum = ITN_ZERO;
    double area = pow(2.02 * radius, 2);
    quantity q;
    int k;
    solids_need(itn_mesh_check(mesh, NULL, &report, &error), &error);
    for (k = 0; k < directions; k++) { /* a spiral of golden turns */
        double z = 1 - (2 * k + 1.) / directions, r = sqrt(1 - z * z), turn = 2.399963229728653 * k;
        solids_mean means[2];
        itn_scene *scene;
        solids_desc desc = ITN_ZERO;
        desc.mesh = mesh, desc.sigma_t = sigma_t, desc.albedo = 1, desc.g = g, desc.ior = ior;
        look_from(&desc, radius, r * cos(turn), r * sin(turn), z);
        scene = solids_scene(&desc);
        options.spp = check_long() ? 18 : 2, options.seed = seed++;
        solids_measure(scene, NULL, &options, by_albedo, 1, means);
        itn_scene_free(scene);
        sum.value += means[1].value * area / directions;
        sum.error += means[1].error * means[1].error;
    }
    sum.error = sqrt(sum.error) * area / directions;
    q = wanted("m.albedo", sigma_t * report.volume, .005 * sigma_t * report.volume);
    if (ior != 0) q.expected *= ior * ior;
    check_quantity(label, &q, sum);
}

/* A star: a ball with dents and bumps. */
static itn_mesh star(void) {
    itn_mesh mesh = solids_sphere(1, 3);
    int i, k;
    for (i = 0; i < mesh.vertex_count; i++) {
        float *p = mesh.positions + 3 * i, r = 1 - 3.6f * p[0] * p[0] * p[1] * p[1] - .5f * p[2];
        for (k = 0; k < 3; k++) p[k] *= r;
    }
    return mesh;
}

static void test_mean_path(void) {
    itn_mesh sphere = solids_sphere(1, 3), dented = star();
    itn_mesh cube = solids_box(solids_vec3(-1, -1, -1), solids_vec3(1, 1, 1));
    double none = 0;
    check_mean_path("mean path, sphere", &sphere, 1, 2, 0, none);
    check_mean_path("mean path, sphere, g .8", &sphere, 1, 5, .8, none);
    check_mean_path("mean path, cube", &cube, 1.7321, 2, 0, none);
    check_mean_path("mean path, star", &dented, 1.5, 3, -.3, none);
    check_mean_path("mean path, cube, n 1.4", &cube, 1.7321, 1, .3, 1.4);
    CATCHES(check_mean_path("", &cube, .9, 2, 0, none)); /* corners outside the film */
    itn_mesh_free(&cube);
    itn_mesh_free(&dented);
    itn_mesh_free(&sphere);
}

/* Transmittance of a ball of optical radius x, on average over its disc, along the axis, and from
   the centre outwards. */
static void check_absorbing_sphere(double x) {
    const double pi = 3.14159265358979323846, e = exp(-2 * x);
    itn_mesh mesh = solids_sphere(1, 6);
    double mean = (1 - (1 + 2 * x) * e) / (2 * x * x), share = pi / pow(2.02, 2);
    double slope = 2 * e / x - 2 * mean / x; /* of the mean, by x */
    quantity q[2];
    solids_desc desc = ITN_ZERO;
    desc.mesh = &mesh, desc.sigma_t = x;
    look_from(&desc, 1, 0, .6, .8);
    q[0] = wanted(NULL, 1 + share * (mean - 1), .0005);
    q[1] = wanted("m.sigma_t", share * slope, .0005);
    check_scene("absorbing sphere", &desc, 0, q, 2);
    desc.width = desc.height = 16, desc.fov = .001;
    q[0] = wanted(NULL, e, .0002), q[1] = wanted("m.sigma_t", -2 * e, .0004);
    check_scene("through the centre", &desc, 0, q, 2);
    desc.eye = solids_vec3(1e-6, 0, 0), desc.target = solids_vec3(1, .2, .3), desc.fov = 90;
    q[0] = wanted(NULL, exp(-x), .002 * exp(-x));
    q[1] = wanted("m.sigma_t", -exp(-x), .004 * exp(-x));
    check_scene("from the centre", &desc, 0, q, 2);
    itn_mesh_free(&mesh);
}

static void test_absorbing_spheres(void) {
    check_absorbing_sphere(.5);
    if (check_long()) check_absorbing_sphere(1);
    check_absorbing_sphere(2);
}

static void run(const char *name, void (*test)(void)) {
    clock_t start = clock();
    test();
    if (getenv("ITN_VERBOSE"))
        printf("%s: %.1f s\n", name, (double)(clock() - start) / CLOCKS_PER_SEC);
    fflush(stdout);
}

int main(void) {
    if (check_long()) effort = 1 / 3.;
    run("isotropic half-spaces", test_isotropic_half_spaces);
    run("half-spaces", test_half_spaces);
    run("Lambertian light", test_lambertian);
    run("slabs", test_slabs);
    run("more slabs", test_more_slabs);
    run("smooth faces", test_smooth_faces);
    run("smooth index", test_smooth_ior);
    run("single scattering", test_single_scattering);
    run("beams", test_beams);
    run("channels", test_channels);
    run("furnace", test_furnace);
    run("mean path", test_mean_path);
    run("absorbing spheres", test_absorbing_spheres);
    return check_end("transport");
}
