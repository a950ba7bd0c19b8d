/* Opaque surfaces: each model against a formula of its own in double, in values and slopes; its
   sampler against its density; energy and reciprocity; then in pictures by both walks, against
   quadrature and differences, and found again from a picture. */
#define ITN_IMPLEMENTATION
#include "../itn.h"
#include "check.h"
#include "solids.h"
#include "stage.h"

static const double opaque_pi = 3.14159265358979323846;

/* ---- f, without cosine, of parameters in the order of theta ---------------------------------- */

typedef struct opaque_vector {
    double x, y, z;
} opaque_vector;

static opaque_vector opaque_at(double theta, double phi) {
    opaque_vector v = {sin(theta) * cos(phi), sin(theta) * sin(phi), cos(theta)};
    return v;
}
static double opaque_dot(opaque_vector a, opaque_vector b) {
    return a.x * b.x + a.y * b.y + a.z * b.z;
}
static opaque_vector opaque_sum(opaque_vector a, opaque_vector b) {
    opaque_vector v = {a.x + b.x, a.y + b.y, a.z + b.z};
    return v;
}

/* Fresnel of index n = eta - i k by complex numbers: n cos(theta_t) = sqrt(n^2 - sin^2). */
static double metal_fresnel(double c, double eta, double k) {
    double re = eta * eta - k * k, im = -2 * eta * k, s2 = 1 - c * c;
    double r = sqrt(hypot(re - s2, im)), angle = .5 * atan2(im, re - s2);
    double a = r * cos(angle), b = r * sin(angle); /* a + i b */
    double s = (pow(c - a, 2) + b * b) / (pow(c + a, 2) + b * b);
    double p = (pow(re * c - a, 2) + pow(im * c - b, 2)) /
               (pow(re * c + a, 2) + pow(im * c + b, 2));
    return .5 * (s + p);
}

static double metal(const double *p, opaque_vector i, opaque_vector o, int beckmann) {
    opaque_vector h = opaque_sum(i, o);
    double length = sqrt(opaque_dot(h, h)), alpha = p[3], theta = acos(h.z / length), g = 1, d;
    double slope = tan(theta) / alpha;
    d = beckmann ? exp(-slope * slope) : 1 / pow(1 + slope * slope, 2);
    d /= opaque_pi * alpha * alpha * pow(cos(theta), 4);
    for (int k = 0; k < 2; k++) {
        double t = alpha * tan(acos(k ? o.z : i.z)), a = 1 / t;
        if (!beckmann) g *= 2 / (1 + sqrt(1 + t * t));
        else if (a < 1.6) g *= (3.535 * a + 2.181 * a * a) / (1 + 2.276 * a + 2.577 * a * a);
    }
    return p[0] * metal_fresnel(length / 2, p[1], p[2]) * d * g / (4 * i.z * o.z);
}
static double metal_ggx(const double *p, opaque_vector i, opaque_vector o) {
    return metal(p, i, o, 0);
}
static double metal_beckmann(const double *p, opaque_vector i, opaque_vector o) {
    return metal(p, i, o, 1);
}

static double oren_nayar(const double *p, opaque_vector i, opaque_vector o) {
    double s2 = pow(p[1] * opaque_pi / 180, 2), ti = acos(i.z), to = acos(o.z);
    double turn = cos(atan2(i.y, i.x) - atan2(o.y, o.x));
    double b = .45 * s2 / (s2 + .09) * fmax(0, turn) * sin(fmax(ti, to)) * tan(fmin(ti, to));
    return p[0] / opaque_pi * (1 - .5 * s2 / (s2 + .33) + b);
}

static double ward(const double *p, opaque_vector i, opaque_vector o, double across) {
    opaque_vector h = opaque_sum(i, o);
    double e = (pow(h.x / p[1], 2) + pow(h.y / across, 2)) / (h.z * h.z);
    return p[0] / (opaque_pi * p[1] * across) * exp(-e) * opaque_dot(h, h) / pow(h.z, 4);
}
static double ward_round(const double *p, opaque_vector i, opaque_vector o) {
    return ward(p, i, o, p[1]);
}
static double ward_long(const double *p, opaque_vector i, opaque_vector o) {
    return ward(p, i, o, p[2]);
}

static double ashikhmin(const double *p, opaque_vector i, opaque_vector o, double nv) {
    opaque_vector h = opaque_sum(i, o);
    double l = sqrt(opaque_dot(h, h)), nu = p[2], power, f, ground;
    h.x /= l, h.y /= l, h.z /= l;
    power = (nu * h.x * h.x + nv * h.y * h.y) / (h.x * h.x + h.y * h.y);
    f = p[1] + (1 - p[1]) * pow(1 - l / 2, 5);
    ground = 28 * p[0] / (23 * opaque_pi) * (1 - p[1]) * (1 - pow(1 - i.z / 2, 5)) *
             (1 - pow(1 - o.z / 2, 5));
    return sqrt((nu + 1) * (nv + 1)) / (8 * opaque_pi) * pow(h.z, power) /
           (l / 2 * fmax(i.z, o.z)) * f + ground;
}
static double ashikhmin_round(const double *p, opaque_vector i, opaque_vector o) {
    return ashikhmin(p, i, o, p[2]);
}
static double ashikhmin_long(const double *p, opaque_vector i, opaque_vector o) {
    return ashikhmin(p, i, o, p[3]);
}

/* ---- the models ------------------------------------------------------------------------------ */

enum { OPAQUE_MODELS = 9, OPAQUE_MOST = 4 };
static const struct opaque_model {
    const char *text; /* of its line in a scene file */
    double (*f)(const double *p, opaque_vector i, opaque_vector o);
    int count;
    double furnace; /* no more than this leaves */
} opaque_models[OPAQUE_MODELS] = {
    {"conductor reflectance .9 eta .2 k 3.9 alpha .3", metal_ggx, 4, .9},
    {"conductor eta 2.9 k 3.1 alpha .08", metal_ggx, 4, 1},
    {"conductor reflectance .8 eta 1.5 k .01 alpha .4 distribution beckmann", metal_beckmann, 4,
     .8},
    {"rough_diffuse reflectance .7 sigma 30", oren_nayar, 2, 1},
    {"rough_diffuse reflectance .7 sigma 80", oren_nayar, 2, 1},
    {"ward reflectance .6 alpha_x .2", ward_round, 2, .6},
    {"ward reflectance .5 alpha_x .15 alpha_y .5", ward_long, 3, .5},
    {"ashikhmin reflectance .5 specular .3 nu 60", ashikhmin_round, 3, 1},
    {"ashikhmin reflectance .6 specular .05 nu 10 nv 200", ashikhmin_long, 4, 1}};

/* A scene of one surface, a plane of it in light 1 (or another object and light), seen from
   direction d, of which a line's end is given too. */
static itn_scene *opaque_scene(const char *surface, opaque_vector d, const char *rest) {
    char text[2000];
    itn_scene *scene = NULL;
    itn_error error;
    snprintf(text, sizeof text,
             "film width 4 height 4\ncamera eye %.8g %.8g %.8g target 0 0 0 up .1 .2 .9 fov .01\n"
             "surface s type %s\n%s\n", 9 * d.x, 9 * d.y, 9 * d.z, surface,
             rest ? rest : "object plane surface s\nlight constant radiance 1");
    solids_need(itn_scene_from_memory(text, strlen(text), NULL, NULL, 0, NULL, &scene, &error),
                &error);
    return scene;
}

typedef struct opaque_case {
    const struct opaque_model *model;
    itn_scene *scene;
    float theta[32];
    double p[OPAQUE_MOST];
    itn__site site;
    itn__factor factor; /* its seeds are all parameters, in their order */
    opaque_vector i;
} opaque_case;

static void opaque_begin(opaque_case *c, int model, opaque_vector i) {
    itn__floats zero = itn__splat(0), one = itn__splat(1);
    itn__vectors n = itn__vectors_of(zero, zero, one), x = itn__vectors_of(one, zero, zero);
    itn__vectors d = itn__vectors_of(itn__splat((float)-i.x), itn__splat((float)-i.y),
                                     itn__splat((float)-i.z));
    opaque_vector up = {0, 1, 0};
    c->model = &opaque_models[model], c->i = i;
    c->scene = opaque_scene(c->model->text, up, NULL);
    itn_parameter_values(c->scene, c->theta);
    itn__site_make(&c->site, c->scene->surfaces, c->theta, 1, &n, &x, &d);
    CHECK(c->scene->surfaces->count == c->model->count && !c->site.smooth);
    c->factor.count = 0;
    for (int k = 0; k < c->model->count; k++) {
        c->p[k] = (double)c->theta[c->scene->surfaces->first + k];
        itn__add_seed(&c->factor, c->scene->surfaces->first + k, k);
    }
}

static double opaque_uniform(itn__rng *rng) { return (double)itn__uniform(rng); }

/* f cos(theta_o) and its slopes in single directions; back: f is that of the other way. */
static void opaque_values(int model, double theta, double phi, double planted) {
    opaque_case c, back;
    itn__rng rng = itn__rng_make(5, (uint64_t)model, (uint64_t)(theta * 100));
    opaque_begin(&c, model, opaque_at(theta, phi));
    for (int n = 0; n < 150; n++) {
        double turn = 2 * opaque_pi * opaque_uniform(&rng), spread = n % 2 ? .3 : 1.5, f;
        opaque_vector o = opaque_at(spread * opaque_uniform(&rng), turn), mirrored = c.i;
        itn__ints through;
        itn__floats pdf;
        if (n % 2) { /* around the mirrored direction */
            mirrored.x += o.x, mirrored.y += o.y, mirrored.x *= -1, mirrored.y *= -1;
            double l = sqrt(opaque_dot(mirrored, mirrored));
            o.x = mirrored.x / l, o.y = mirrored.y / l, o.z = mirrored.z / l;
        }
        o.x = (float)o.x, o.y = (float)o.y, o.z = (float)o.z;
        itn__vectors to = itn__vectors_of(itn__splat((float)o.x), itn__splat((float)o.y),
                                          itn__splat((float)o.z));
        itn__bsdf_eval(&c.site, &to, &c.factor, &pdf, &through);
        f = c.model->f(c.p, c.i, o) * o.z;
        if (f < 1e-20) continue;
        double got = (double)ITN__LANE(c.factor.value[0], ITN__LANES - 1);
        check_report(fabs(got - f * planted) < 1e-4 * f, __FILE__, __LINE__,
                     "%s: f %.8g, not %.8g", c.model->text, got, f);
        for (int k = 0; k < c.model->count; k++) {
            double p[OPAQUE_MOST], h = 1e-4 * c.p[k], slope;
            memcpy(p, c.p, sizeof p);
            p[k] += h, slope = c.model->f(p, c.i, o);
            p[k] -= 2 * h, slope = (slope - c.model->f(p, c.i, o)) * o.z / (2 * h);
            got = (double)ITN__LANE(c.factor.slope[k][0], ITN__LANES - 1);
            check_report(fabs(got - slope) < 1e-4 * (fabs(slope) + f / c.p[k]), __FILE__,
                         __LINE__, "%s: slope %d %.8g, not %.8g", c.model->text, k, got, slope);
        }
        if (n % 10) continue;
        opaque_begin(&back, model, o);
        to = itn__vectors_of(itn__splat((float)c.i.x), itn__splat((float)c.i.y),
                             itn__splat((float)c.i.z));
        itn__bsdf_eval(&back.site, &to, &back.factor, &pdf, &through);
        CHECK_NEAR(ITN__LANE(back.factor.value[0], 0) / c.i.z, f / o.z * planted, 2e-4 * f / o.z);
        itn_scene_free(back.scene);
    }
    itn_scene_free(c.scene);
}

/* Integrals over boxes of directions: of the density, of f cos(theta_o) and of its slopes. */
enum { OPAQUE_RINGS = 8, OPAQUE_TURNS = 8, OPAQUE_BOXES = OPAQUE_RINGS * OPAQUE_TURNS };
typedef struct opaque_integral {
    double pdf[OPAQUE_BOXES], total, f, slope[OPAQUE_MOST];
} opaque_integral;

static void opaque_integrate(opaque_case *c, opaque_integral *sum) {
    enum { FINE = 64 };
    memset(sum, 0, sizeof *sum);
    for (int box = 0; box < OPAQUE_BOXES; box++)
        for (int n = 0; n < FINE * FINE; n += ITN__LANES) { /* of 1 - z = s^2 */
            double s = (box / OPAQUE_TURNS + (n / FINE + .5) / FINE) / OPAQUE_RINGS, z = 1 - s * s;
            double area = 2 * s / (OPAQUE_RINGS * FINE) * 2 * opaque_pi / (OPAQUE_TURNS * FINE);
            itn__vectors o;
            itn__floats pdf;
            itn__ints through;
            o.x = o.y = o.z = itn__splat(z);
            for (int l = 0; l < ITN__LANES; l++) {
                double phi = (box % OPAQUE_TURNS + (n % FINE + l + .5) / FINE) / OPAQUE_TURNS;
                ITN__LANE(o.x, l) = (float)(sqrt(1 - z * z) * cos(2 * opaque_pi * phi));
                ITN__LANE(o.y, l) = (float)(sqrt(1 - z * z) * sin(2 * opaque_pi * phi));
            }
            itn__bsdf_eval(&c->site, &o, &c->factor, &pdf, &through);
            for (int l = 0; l < ITN__LANES; l++) {
                sum->pdf[box] += area * (double)ITN__LANE(pdf, l);
                sum->total += area * (double)ITN__LANE(pdf, l);
                sum->f += area * (double)ITN__LANE(c->factor.value[0], l);
                for (int k = 0; k < c->model->count; k++)
                    sum->slope[k] += area * (double)ITN__LANE(c->factor.slope[k][0], l);
            }
        }
}

/* The sampler draws as its density says (chi^2), and by f / pdf finds what quadrature does: the
   energy, no more than the model promises, and its slopes, so that scores less these have mean 0.
   planted multiplies the density. */
static void opaque_draws(int model, double theta, double phi, double planted) {
    enum { DRAWS = 1 << 16 };
    opaque_case c;
    opaque_integral exact;
    itn__rng rng = itn__rng_make(6, (uint64_t)model, (uint64_t)(theta * 100));
    double counts[OPAQUE_BOXES] = {0}, sums[1 + OPAQUE_MOST][2] = {{0}}, drawn = 0, chi2 = 0;
    int free = -1;
    opaque_begin(&c, model, opaque_at(theta, phi));
    opaque_integrate(&c, &exact);
    for (int n = 0; n < DRAWS; n += ITN__LANES) {
        itn__floats u[3] = {itn__splat(0), itn__splat(0), itn__splat(0)}, pdf;
        itn__ints through;
        itn__vectors o;
        for (int l = 0; l < 3 * ITN__LANES; l++) ITN__LANE(u[l % 3], l / 3) = itn__uniform(&rng);
        itn__ints good = itn__bsdf_sample(&c.site, u, &o, &c.factor, &pdf, &through);
        for (int l = 0; l < ITN__LANES; l++) {
            double turn = atan2((double)ITN__LANE(o.y, l), (double)ITN__LANE(o.x, l));
            double s = sqrt(1 - (double)ITN__LANE(o.z, l)), v;
            int ring = (int)(s * OPAQUE_RINGS);
            if (!ITN__LANE(good, l)) continue;
            if (ITN__LANE(through, l) || !itn__finite((double)ITN__LANE(pdf, l))) CHECK(0);
            turn = turn < 0 ? turn / (2 * opaque_pi) + 1 : turn / (2 * opaque_pi);
            ring = ring < OPAQUE_RINGS ? ring : OPAQUE_RINGS - 1;
            counts[ring * OPAQUE_TURNS + (int)(turn * OPAQUE_TURNS) % OPAQUE_TURNS]++, drawn++;
            for (int k = 0; k <= c.model->count; k++) {
                itn__floats *from = k ? c.factor.slope[k - 1] : c.factor.value;
                v = (double)ITN__LANE(from[0], l);
                sums[k][0] += v / DRAWS, sums[k][1] += v * v / DRAWS;
            }
        }
    }
    for (int box = 0; box < OPAQUE_BOXES; box++) {
        double e = exact.pdf[box] * planted * DRAWS;
        if (e < 10) continue;
        chi2 += (counts[box] - e) * (counts[box] - e) / (e + 1e-5 * e * e), free++;
    }
    check_report(chi2 < free + 5 * sqrt(2. * free), __FILE__, __LINE__, "%s: chi^2 %g of %d",
                 c.model->text, chi2, free);
    CHECK_NEAR(exact.total * planted, drawn / DRAWS, .004);
    CHECK(exact.f <= c.model->furnace * 1.001);
    for (int k = 0; k <= c.model->count; k++) {
        double error = sqrt((sums[k][1] - sums[k][0] * sums[k][0]) / DRAWS);
        double truth = k ? exact.slope[k - 1] : exact.f, unit = k ? 1 / c.p[k - 1] : 1;
        CHECK_MEAN(sums[k][0], error + 2e-4 * fabs(truth), truth, 4.5, .05 * exact.f * unit);
    }
    itn_scene_free(c.scene);
}

/* A plane in light 1 from everywhere, by each way to render: radiance and slopes are those of
   quadrature. `across`: a mesh whose first texture coordinate grows along z in the plane's place,
   so that along and across change places. */
static void opaque_furnace(int model, double theta, double phi, int across, double planted) {
    opaque_case c;
    opaque_integral exact;
    const struct opaque_model *m = &opaque_models[model];
    opaque_vector eye = {sin(theta) * cos(phi), cos(theta), -sin(theta) * sin(phi)};
    static const char mesh[] = "v -9 0 9\nv 9 0 9\nv 9 0 -9\nv -9 0 -9\nvt 1 0\nvt 1 1\nvt 0 1\n"
                               "vt 0 0\nf 1/1 2/2 3/3\nf 1/1 3/3 4/4\n";
    char text[600], names[OPAQUE_MOST][ITN_NAME_SIZE];
    const char *asked[OPAQUE_MOST];
    itn_file file = {"m.obj", mesh, sizeof mesh - 1};
    itn_scene *scene = NULL;
    itn_error error;
    opaque_begin(&c, model, opaque_at(theta, across ? opaque_pi / 2 - phi : phi));
    opaque_integrate(&c, &exact);
    for (int k = 0; k < m->count; k++) {
        strcpy(names[k], c.scene->parameters[c.scene->surfaces->first + k].name);
        asked[k] = names[k];
    }
    snprintf(text, sizeof text, "film width 4 height 4\ncamera eye %.8g %.8g %.8g target 0 0 0 up "
             ".1 .2 .9 fov .01\nsurface s type %s\nobject %s surface s\nlight constant radiance 1",
             9 * eye.x, 9 * eye.y, 9 * eye.z, m->text, across ? "mesh m.obj" : "plane");
    solids_need(itn_scene_from_memory(text, strlen(text), NULL, &file, 1, NULL, &scene, &error),
                &error);
    for (int way = 0; way < SOLIDS_WAYS; way++) {
        itn_render_options options = ITN_ZERO;
        solids_mean found[1 + OPAQUE_MOST];
        options.spp = 1000;
        solids_way(&options, way);
        solids_measure(scene, NULL, &options, asked, m->count, found);
        for (int k = 0; k <= m->count; k++) {
            double truth = k ? exact.slope[k - 1] : exact.f, unit = k ? 1 / c.p[k - 1] : 1;
            CHECK_MEAN(found[k].value, found[k].error + 2e-4 * fabs(truth), truth * planted, 4.5,
                       .05 * (exact.f * unit + fabs(truth)));
        }
    }
    itn_scene_free(scene);
    itn_scene_free(c.scene);
}

static void test_models(void) {
    for (int m = 0; m < OPAQUE_MODELS; m++)
        for (int a = 0; a < 3; a++) {
            double theta = .2 + .5 * a, phi = .4 + 2 * a; /* up to 69 degrees */
            opaque_values(m, theta, phi, 1);
            opaque_draws(m, theta, phi, 1);
            if (a == 1) opaque_furnace(m, theta, .3, 0, 1);
            if (a == 1 && m % 2 == 0 && m > 5) opaque_furnace(m, theta, .3, 1, 1);
        }
    CHECK_CATCHES(opaque_values(3, .7, .4, 1.001));
    CHECK_CATCHES(opaque_draws(6, .7, .4, 1.03));
    CHECK_CATCHES(opaque_draws(8, .7, .4, .97));
    CHECK_CATCHES(opaque_furnace(6, .7, .3, 0, 1.1));
}

/* ---- pictures -------------------------------------------------------------------------------- */

static itn_surface_desc *opaque_surface(stage *s, const char *name, itn_surface_type type,
                                        double reflectance) {
    itn_surface_desc *surface = stage_diffuse(s, name, reflectance);
    surface->type = type, surface->has_reflectance = 1;
    return surface;
}

/* Balls of metal, Ward's and Ashikhmin's on a rough floor, under a map. */
static itn_scene *opaque_still(int size) {
    static const char *const names[4] = {"metal", "brushed", "gloss", "mirror"};
    itn_mesh ball = solids_sphere(.5, 3);
    itn_image map = stage_patch(1, .3, .3, 8);
    itn_surface_desc *surface;
    itn_scene *scene;
    stage s;
    stage_begin(&s, size, 5, 28);
    s.desc.camera.eye.y = 1.5f;
    surface = opaque_surface(&s, "metal", ITN_SURFACE_CONDUCTOR, .9);
    surface->eta[0] = .8f, surface->k[0] = 2, surface->alpha = .25f;
    surface->distribution = ITN_BECKMANN;
    surface = opaque_surface(&s, "brushed", ITN_SURFACE_WARD, .7);
    surface->alpha_x = .15f, surface->alpha_y = .4f;
    surface = opaque_surface(&s, "gloss", ITN_SURFACE_ASHIKHMIN, .5);
    surface->specular[0] = .2f, surface->nu = 30;
    opaque_surface(&s, "mirror", ITN_SURFACE_MIRROR, .8);
    surface = opaque_surface(&s, "floor", ITN_SURFACE_ROUGH_DIFFUSE, .6);
    surface->sigma = 35;
    stage_object(&s, NULL, NULL, "floor")->plane_y = -.6f;
    for (int k = 0; k < 4; k++) {
        itn_object_desc *object = stage_object(&s, &ball, NULL, names[k]);
        for (int d = 0; d < 3; d++) object->transform[5 * d] = 1;
        object->transform[3] = (k % 2 ? .55f : -.55f), object->transform[11] = k < 2 ? -.6f : .6f;
    }
    stage_map(&s, NULL, &map);
    scene = stage_make(&s);
    itn_image_free(&map), itn_mesh_free(&ball);
    return scene;
}

/* The mean of the picture, and its slopes by parameters, by both walks, against differences of
   renders of the same random numbers. */
static void test_slopes(int count, double planted) {
    enum { RUNS = 4, MOST = 8 };
    static const char *const names[MOST] = {"floor.sigma", "metal.alpha", "metal.eta", "metal.k",
                                            "brushed.alpha_x", "brushed.alpha_y", "gloss.nu",
                                            "gloss.specular"};
    static const double steps[MOST] = {2, .02, .1, .2, .01, .03, 3, .05};
    itn_scene *scene = opaque_still(20);
    float theta[32];
    solids_mean found[2][1 + MOST];
    for (int way = 0; way < 2; way++) {
        itn_render_options options = ITN_ZERO;
        options.spp = way ? 64 : 256, options.seed = 1;
        solids_way(&options, 2 * way);
        solids_measure(scene, NULL, &options, names, count, found[way]);
    }
    CHECK_NEAR(found[0][0].value, found[1][0].value,
               4.5 * hypot(found[0][0].error, found[1][0].error));
    CHECK(found[0][0].error < .01 * found[0][0].value);
    for (int k = 0; k < count; k++) {
        int at = itn_parameter_find(scene, names[k]);
        double mean = 0, square = 0;
        for (int run = 0; run < RUNS; run++) {
            itn_render_options options = ITN_ZERO;
            solids_mean ends[2];
            options.spp = 32, options.seed = 10 + (uint64_t)run;
            options.mode = ITN_MODE_REFERENCE;
            for (int end = 0; end < 2; end++) {
                itn_parameter_values(scene, theta);
                theta[at] += (float)(end ? steps[k] : -steps[k]);
                solids_measure(scene, theta, &options, NULL, 0, &ends[end]);
            }
            double slope = (ends[1].value - ends[0].value) / (2 * steps[k]);
            mean += slope / RUNS, square += slope * slope / RUNS;
        }
        double error = sqrt((square - mean * mean) / (RUNS - 1));
        for (int way = 0; way < 2; way++)
            CHECK_NEAR(found[way][1 + k].value * planted, mean,
                       5.5 * hypot(found[way][1 + k].error, error)); /* of few runs */
    }
    itn_scene_free(scene);
}

/* What a refinement says of the metal's alpha and the floor's sigma, and of eta and k, which a
   picture in one channel hardly tells apart: errors that hold, and the names in words. */
static void opaque_judge(const itn_estimate *found, const double *truth, int count) {
    for (int k = 0; k < count; k++)
        CHECK_NEAR(found[k].value, truth[k], 4 * found[k].standard_error);
    CHECK(found[0].standard_error < .05 && found[1].standard_error < 1);
}

static void test_found(void) {
    enum { SIZE = 16, COUNT = 4 };
    static const char *const names[COUNT] = {"metal.alpha", "floor.sigma", "metal.eta", "metal.k"};
    static const double starts[COUNT] = {.15, 10, .8, 2}, planted[COUNT] = {.25, 45, .8, 2};
    static const double truth[COUNT] = {.25, 35, .8, 2};
    itn_scene *scene = opaque_still(SIZE);
    itn_render_options shot = ITN_ZERO;
    itn_refine_options options = ITN_ZERO;
    itn_refine_outcome outcome;
    itn_estimate found[COUNT];
    itn_error error;
    itn_image image;
    const itn_parameter *parameters[COUNT];
    double covariance[COUNT * COUNT];
    float theta[32];
    char words[2000];
    int asked[COUNT];
    for (int k = 0; k < COUNT; k++) {
        asked[k] = itn_parameter_find(scene, names[k]);
        parameters[k] = itn_parameter_get(scene, asked[k]);
    }
    itn_parameter_values(scene, theta);
    for (int k = 0; k < COUNT; k++) theta[asked[k]] = (float)starts[k];
    shot.spp = 1024, shot.seed = 77;
    stage_need(itn_render(scene, NULL, &shot, NULL, 0, &image, &error), &error);
    options.spp = 64, options.final_spp = 512, options.seconds = 120;
    options.target_variance = image.pixels + SIZE * SIZE;
    options.covariance = covariance, options.outcome = &outcome;
    stage_need(itn_refine(scene, theta, image.pixels, asked, COUNT, &options, found, &error),
               &error);
    CHECK(itn_refine_words(parameters, COUNT, found, covariance, &outcome, words, sizeof words) <
          (int)sizeof words);
    if (getenv("SHOW")) printf("%s", words);
    opaque_judge(found, truth, COUNT);
    CHECK_CATCHES(opaque_judge(found, planted, COUNT));
    CHECK(strstr(words, "metal.alpha is determined") && strstr(words, "floor.sigma is determined"));
    CHECK(strstr(words, "metal.eta and metal.k are determined") != NULL);
    itn_image_free(&image);
    itn_scene_free(scene);
}

/* What is said of surfaces that cannot be, in files and descs; and of what counts where nothing is
   given. */
static void test_refused(void) {
    static const char *const cases[][2] = {
        {"conductor eta .2", "k is missing"},
        {"conductor eta 0 k 1", "eta 0 is not in [0.001, 100]"},
        {"conductor eta .2 k -1", "k -1 is not in [0, 100]"},
        {"conductor eta .2 k 3 alpha 1.5", "alpha 1.5 is neither 0 nor in [0.001, 1]"},
        {"conductor eta .2 k 3 distribution phong", "none of: ggx beckmann"},
        {"conductor eta .2 k 3 reflectance 1.5", "reflectance 1.5 is not in [0, 1]"},
        {"mirror", "reflectance is a colour"},
        {"rough_diffuse reflectance .5", "sigma is missing"},
        {"rough_diffuse reflectance .5 sigma 91", "sigma 91 is not in [0, 90]"},
        {"ward reflectance .5 alpha_y .2", "alpha_x is missing"},
        {"ward reflectance .5 alpha_x 0", "alpha_x 0 is not in [0.001, 1]"},
        {"ashikhmin reflectance .5 specular .2", "nu is missing"},
        {"ashikhmin reflectance .5 specular 2 nu 1", "specular 2 is not in [0, 1]"},
        {"lambert reflectance .5", "none of: dielectric diffuse mirror conductor"}};
    opaque_vector up = {0, 1, 0};
    itn_error error;
    itn_scene *scene = NULL;
    stage s;
    for (size_t k = 0; k < sizeof cases / sizeof *cases; k++) {
        char text[400];
        snprintf(text, sizeof text, "camera eye 0 1 0 target 0 0 0 up 1 0 0\nobject plane surface s"
                 "\nlight constant radiance 1\nsurface s type %s", cases[k][0]);
        CHECK(itn_scene_from_memory(text, strlen(text), NULL, NULL, 0, NULL, &scene, &error) ==
              ITN_ERROR_FORMAT);
        check_report(strstr(error.message, cases[k][1]) && error.line == 4, __FILE__, __LINE__,
                     "%s: %s", cases[k][0], error.message);
    }
    scene = opaque_scene("conductor eta .2 k 3.9", up, NULL);
    CHECK(itn_parameter_find(scene, "s.reflectance") == 0 && scene->parameters[0].value == 1);
    CHECK(itn_parameter_find(scene, "s.alpha") == -1);
    itn_scene_free(scene);
    scene = opaque_scene("conductor reflectance 0 eta .2 k 3.9", up, NULL);
    CHECK(scene->parameters[0].value == 0);
    itn_scene_free(scene);
    for (int given = 0; given < 3; given++) { /* a desc: no eta, an eta, and a black one */
        stage_begin(&s, 4, 5, 30);
        itn_surface_desc *surface = opaque_surface(&s, "s", ITN_SURFACE_CONDUCTOR, 0);
        surface->eta[0] = given ? 1 : 0, surface->has_reflectance = given == 2;
        stage_object(&s, NULL, NULL, "s"), stage_constant(&s, NULL, 1);
        CHECK(itn_scene_create(&s.desc, NULL, &scene, &error) ==
              (given ? ITN_OK : ITN_ERROR_ARGUMENT));
        if (given) CHECK(scene->parameters[0].value == 2 - given), itn_scene_free(scene);
        else CHECK(strstr(error.message, "eta 0 is not in") != NULL);
    }
}

/* Slopes by a reflectance of 0, which is the light that would come, and by that of a mirror. */
static void test_black(void) {
    static const char *const surfaces[3] = {"mirror reflectance 0",
                                            "conductor reflectance 0 eta .2 k 3.9",
                                            "conductor reflectance 0 eta .2 k 3.9 alpha .001"};
    static const char *const asked[] = {"s.reflectance"};
    for (int k = 0; k < 3; k++) {
        itn_scene *scene = opaque_scene(surfaces[k], opaque_at(.7, .3), NULL);
        itn_render_options options = ITN_ZERO;
        solids_mean found[2];
        opaque_vector d = opaque_at(.7, .3);
        options.spp = 200;
        solids_measure(scene, NULL, &options, asked, 1, found);
        CHECK(found[0].value == 0);
        CHECK_NEAR(found[1].value, k ? metal_fresnel(d.y, .2, 3.9) : 1, 1e-3);
        itn_scene_free(scene);
    }
}

/* A metal in three channels, with a checker: each of its 13 parameters has, asked for with all
   others, the slope it has in a scene of its channel alone. */
static void test_colours(void) {
    static const char *const eta[3] = {".3", ".8", "1.5"}, *const k[3] = {"4", "2", "1.2"};
    static const char rest[] = "object plane surface s half 3\nlight constant radiance 1\n"
                               "camera eye 1 2 2 target 0 0 0 fov 40\n";
    static const char *const one[3] = {".9 .3", ".7 .4", ".5 .6"};
    static const char letters[] = "rgb", planes[] = "RGB";
    const char *names[5] = {"s.reflectance", "s.reflectance2", "s.eta", "s.k", "s.alpha"};
    itn_render_options options = ITN_ZERO;
    itn_image image;
    char text[700], name[60], plane[99], variance[99];
    int asked[13];
    itn_scene *scene, *own;
    itn_error error;
    options.spp = 256;
    snprintf(text, sizeof text, "film width 8 height 8 channels 3\n%ssurface s type conductor "
             "eta .3 .8 1.5 k 4 2 1.2 alpha .3 reflectance checker .9 .7 .5 .3 .4 .6 .5", rest);
    solids_need(itn_scene_from_memory(text, strlen(text), NULL, NULL, 0, NULL, &scene, &error),
                &error);
    for (int j = 0; j < 13; j++) asked[j] = scene->surfaces->first + j;
    CHECK(scene->surfaces->count == 13);
    for (int run = 0; run < 6; run++) { /* two ways, three channels */
        int c = run / 2;
        solids_mean alone[6];
        solids_way(&options, run % 2 * 2);
        options.seed = 5;
        solids_need(itn_render(scene, NULL, &options, asked, 13, &image, &error), &error);
        snprintf(text, sizeof text, "film width 8 height 8\n%ssurface s type conductor eta %s k %s "
                 "alpha .3 reflectance checker %s .5", rest, eta[c], k[c], one[c]);
        solids_need(itn_scene_from_memory(text, strlen(text), NULL, NULL, 0, NULL, &own, &error),
                    &error);
        options.seed = 6;
        solids_measure(own, NULL, &options, names, 5, alone);
        for (int j = 0; j < 5; j++) {
            snprintf(name, sizeof name, j < 4 ? "d_s_%s_%c" : "d_s_%s", names[j] + 2, letters[c]);
            snprintf(plane, sizeof plane, "%s.%c", name, planes[c]);
            snprintf(variance, sizeof variance, "%s_variance.%c", name, planes[c]);
            solids_mean all = solids_plane_mean(&image, plane, variance);
            CHECK(all.value != 0);
            CHECK_NEAR(all.value, alone[1 + j].value, 5 * hypot(all.error, alone[1 + j].error));
        }
        itn_image_free(&image), itn_scene_free(own);
    }
    itn_scene_free(scene);
}

/* An image as texture: its slopes by texels, times these, add up to that by the reflectance, times
   it, as both multiply the light. */
static void test_texture(itn_surface_type type, double planted) {
    enum { SIZE = 12 };
    itn_image pattern, texels;
    itn_scene *scene;
    itn_error error;
    itn_render_options options = ITN_ZERO;
    float weights[SIZE * SIZE];
    double gradient, sum = 0;
    stage s;
    stage_need(itn_image_create(3, 4, 1, NULL, &pattern, &error), &error);
    strcpy(pattern.names[0], "Y");
    for (int j = 0; j < 12; j++) pattern.pixels[j] = .3f + .05f * (float)j;
    stage_begin(&s, SIZE, 2, 60);
    s.desc.camera.eye.y = 1;
    itn_surface_desc *surface = opaque_surface(&s, "s", type, .8);
    surface->texture = ITN_TEXTURE_IMAGE, surface->image = &pattern;
    surface->eta[0] = 1, surface->k[0] = 2, surface->alpha = .3f;
    surface->sigma = 40, surface->alpha_x = .2f, surface->alpha_y = .3f, surface->nu = 20;
    stage_object(&s, NULL, NULL, "s"), stage_constant(&s, NULL, 1);
    scene = stage_make(&s);
    int asked = itn_parameter_find(scene, "s.reflectance");
    for (int j = 0; j < SIZE * SIZE; j++) weights[j] = 1;
    options.spp = 16, options.mode = ITN_MODE_REFERENCE;
    stage_need(itn_render_gradient(scene, NULL, &options, weights, &asked, 1, &gradient, NULL,
                                   &error), &error);
    stage_need(itn_render_texel_gradient(scene, NULL, &options, weights, "s", &texels, &error),
               &error);
    for (int j = 0; j < 12; j++)
        sum += (double)texels.pixels[j] * (double)pattern.pixels[j];
    CHECK_NEAR(sum * planted, gradient * .8, 1e-4 * gradient);
    CHECK(gradient > 1);
    itn_image_free(&texels), itn_image_free(&pattern);
    itn_scene_free(scene);
}

int main(void) {
    test_refused();
    test_black();
    test_colours();
    for (int k = ITN_SURFACE_MIRROR; k <= ITN_SURFACE_ASHIKHMIN; k++)
        test_texture((itn_surface_type)k, 1);
    CHECK_CATCHES(test_texture(ITN_SURFACE_WARD, 1.01));
    test_models();
    test_slopes(8, 1);
    test_found();
    CHECK_CATCHES(test_slopes(1, 1.5));
    return check_end("opaque");
}
