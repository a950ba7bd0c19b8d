/* Lights in lanes: draws, densities and radiances against the functions for one direction, the
   integral of the density, and picks by bisection against a plain search. */
#define ITN_IMPLEMENTATION
#include "../itn.h"
#include "check.h"
#include "frame.h"
#include "one.h"
#include "scalar.h"
#include "stage.h"

#ifdef ITN_SANITIZED
enum { COUNT = 1 << 13 };
#else
enum { COUNT = 1 << 17 };
#endif

/* ---- helpers --------------------------------------------------------------------------------- */

/* Maps to try: 0 smooth, 1 noise with black rows, 2 one bright pixel, 3 poles only. */
static itn_image light_map(int channels, int width, int height, int kind) {
    static const char *const names[3] = {"R", "G", "B"};
    itn__rng rng = itn__rng_make(3, (uint64_t)width, (uint64_t)kind);
    itn_image image;
    itn_error error;
    int x, y, c;
    stage_need(itn_image_create(width, height, channels, NULL, &image, &error), &error);
    for (c = 0; c < channels; c++) {
        strcpy(image.names[c], channels == 1 ? "Y" : names[c]);
        for (y = 0; y < height; y++)
            for (x = 0; x < width; x++) {
                float *p = &image.pixels[(c * height + y) * width + x], u = itn__uniform(&rng);
                *p = 1 + .3f * sinf(6.2831853f * (float)x / (float)width) + .2f * (float)c;
                if (kind == 1) *p = y % 5 > 2 ? 0 : 3 * u * u;
                if (kind == 2) *p = y == height / 3 && x == width / 4 ? 1000 : .01f;
                if (kind == 3) *p = y == 0 || y == height - 1 ? 1.f : 0;
            }
    }
    return image;
}

enum { SMOOTH_MAP, NOISE, PIXEL, POLES, NARROW, TINY_MAP, SKY, NARROW_SUN, BRIGHT_SUN,
       CONSTANT, SEVERAL, SCENES };

/* A square under the lights of one of the kinds above. */
static itn_scene *light_scene(int kind, int channels) {
    static const int widths[6] = {64, 37, 50, 16, 1, 2}, heights[6] = {33, 20, 25, 9, 64, 2};
    itn_image map, other = light_map(channels, 31, 12, 2);
    itn_scene *scene;
    stage s;
    int size = kind < SKY ? kind : 0;
    map = light_map(channels, widths[size], heights[size],
                    kind == NARROW ? 0 : size < 4 ? size : 1);
    stage_begin(&s, 8, 3, 40);
    s.desc.film.channels = channels;
    stage_diffuse(&s, "s", .5);
    stage_object(&s, NULL, NULL, "s");
    if (kind < SKY || kind == SEVERAL) stage_map(&s, "map", &map);
    if (kind == CONSTANT || kind == SEVERAL) stage_constant(&s, "constant", .7);
    if (kind == SKY || kind == SEVERAL) stage_sky(&s, "sky");
    if (kind == NARROW_SUN) stage_sky(&s, "sky")->sun_radius_scale = 1;
    if (kind == BRIGHT_SUN) stage_sky(&s, "sky")->sun_scale = 1e4f;
    if (kind == SEVERAL) {
        stage_map(&s, "other", &other)->scale = 3;
        stage_sky(&s, "second")->sun_direction = itn__vec3(-.8f, .3f, -.1f);
    }
    scene = stage_make(&s);
    itn_image_free(&map);
    itn_image_free(&other);
    return scene;
}

/* Direction k of a test: mostly uniform on the sphere, every eighth one of the places where the
   lights have an edge: poles, horizon, the map's seam, the rim of a sun. */
static itn_vec3 test_direction(const itn_scene *scene, int k) {
    itn__rng rng = itn__rng_make(8, 0, (uint64_t)k);
    float small = expf(-40 * itn__uniform(&rng)), sign = itn__uniform(&rng) < .5f ? -1.f : 1.f;
    float y = 2 * itn__uniform(&rng) - 1, phi = 2 * ITN__PI * itn__uniform(&rng);
    float sine = sqrtf(1 - y * y), x;
    const itn__light *light = &scene->lights[(k / 32) % scene->light_count];
    itn_vec3 d = itn__vec3(sine * cosf(phi), y, sine * sinf(phi)), s, t;
    if (k == 0 || k == 8) return itn__vec3(0, k ? -1.f : 1.f, 0);
    if (k % 8) return d;
    if (k % 32 == 0) return itn__normalize(itn__vec3(d.x * small, sign, d.z * small));
    if (k % 32 == 8) return itn__normalize(itn__vec3(d.x, sign * small, d.z));
    if (k % 32 == 16) return itn__normalize(itn__vec3(sign * small, y, -1));
    if (!(light->sun_cone > 0)) return d;
    scalar_frame(light->to_sun, &s, &t);
    x = light->sun_cone * (1 + sign * .1f * small), sine = sqrtf(x * (2 - x));
    return itn__normalize(scalar_to_world(itn__vec3(sine * cosf(phi), sine * sinf(phi), 1 - x), s, t,
                                          light->to_sun));
}

/* Whether rounding decides what a light is here: on the rim of a sun, at the
   horizon, or in a pole of a map. */
static int on_edge(const itn_scene *scene, itn_vec3 d) {
    int i, edge = fabsf(d.y) < 2e-7f || fabsf(d.x) + fabsf(d.z) < 2e-7f;
    for (i = 0; i < scene->light_count; i++) {
        const itn__light *light = &scene->lights[i];
        float x = scalar_one_minus_cosine(d, light->to_sun);
        edge |= light->kind == ITN__LIGHT_SUN && fabsf(x - light->sun_cone) < 1e-6f * sqrtf(x);
    }
    return edge;
}

/* Largest change of a density or radiance that an error of a few ulp in the coordinates makes: the
   brightest node's value times what they can move in cells; of a density also by its 1/sine. */
typedef struct slack {
    double radiance, density, density_by_sine;
} slack;

static slack make_slack(const itn_scene *scene) {
    slack s = ITN_ZERO;
    int i;
    for (i = 0; i < scene->light_count; i++) {
        const itn__light *light = &scene->lights[i];
        size_t k, count = (size_t)light->grid.width * (size_t)light->grid.height;
        double most = 0, cells = light->grid.width + light->grid.height;
        if (!light->grid.density || !(light->share > 0)) continue;
        for (k = 0; k < count; k++) most = fmax(most, light->grid.density[k]);
        s.density += 4e-7 * most * light->share * cells / 20;
        s.density_by_sine += 4e-7 * most * light->share / 20;
        for (k = 0, most = 0; light->map && k < 3 * count; k++) most = fmax(most, light->map[k]);
        s.radiance += 4e-7 * most * cells;
    }
    return s;
}

static double density_slack(slack s, itn_vec3 d) {
    double sine = fmax(sqrt((double)d.x * d.x + (double)d.z * d.z), 1e-30);
    return (s.density + s.density_by_sine / sine) / sine;
}

static int agree(double a, double b, double tolerance) { return fabs(a - b) <= tolerance; }

/* Any lanes; all of them every fourth time. */
static unsigned test_bits(int k) {
    unsigned bits = (unsigned)itn__mix64((uint64_t)k + 1);
    return (bits & 3u << 30 ? bits : ~0u) & ITN__ALL_LANES;
}

/* ---- tests ----------------------------------------------------------------------------------- */

/* Density and radiance in given directions. `factor` plants an error. */
static void check_drawn(const itn_scene *scene, float factor) {
    float d[3][ITN__LANES], got[7][ITN__LANES], *theta;
    slack loose = make_slack(scene);
    int k, j, c, i, bad = 0;
    theta = (float *)malloc((size_t)itn_parameter_count(scene) * sizeof(float));
    if (!theta) exit(1);
    itn_parameter_values(scene, theta);
    for (k = 0; k < COUNT && !bad; k += ITN__LANES) {
        itn__vectors directions;
        itn__floats sampled[3], plain[3];
        for (j = 0; j < ITN__LANES; j++) {
            itn_vec3 one = test_direction(scene, k + j);
            d[0][j] = one.x, d[1][j] = one.y, d[2][j] = one.z;
        }
        directions = itn__vectors_of(itn__load(d[0]), itn__load(d[1]), itn__load(d[2]));
        itn__store(got[6], factor * itn__meet_lights(scene, theta, &directions, sampled, plain));
        for (c = 0; c < 3; c++) itn__store(got[c], sampled[c]), itn__store(got[3 + c], plain[c]);
        for (j = 0; j < ITN__LANES; j++) {
            itn_vec3 one = itn__vec3(d[0][j], d[1][j], d[2][j]);
            float expected[6] = {0, 0, 0, 0, 0, 0}, pdf = scalar_lights_pdf(scene, one);
            for (i = 0; i < scene->light_count; i++) {
                const itn__light *light = &scene->lights[i];
                float rgb[3];
                scalar_scene_radiance(scene, light, one, rgb);
                for (c = 0; c < scene->film.channels; c++)
                    expected[c + (light->share > 0 ? 0 : 3)] += theta[light->parameter] * rgb[c];
            }
            if (on_edge(scene, one)) continue;
            bad += !agree(got[6][j], pdf, 1e-5 * pdf + density_slack(loose, one));
            for (c = 0; c < 6; c++)
                bad += !agree(got[c][j], expected[c], 1e-5 * expected[c] + loose.radiance);
            if (bad)
                check_report(0, __FILE__, __LINE__, "direction %d (%g %g %g): density %g, not %g; "
                             "radiance %g %g %g + %g, not %g %g %g + %g", k + j, (double)one.x,
                             (double)one.y, (double)one.z, (double)got[6][j], (double)pdf,
                             (double)got[0][j], (double)got[1][j], (double)got[2][j],
                             (double)got[3][j], (double)expected[0], (double)expected[1],
                             (double)expected[2], (double)expected[3]);
            if (bad) break;
        }
    }
    CHECK(bad == 0);
    free(theta);
}

/* Draws from the same random numbers; those outside the mask draw nothing. */
static void check_draws(const itn_scene *scene, double tolerance) {
    float u[3][ITN__LANES], got[4][ITN__LANES];
    slack loose = make_slack(scene);
    int k, j, c, bad = 0, drawn = 0;
    for (k = 0; k < COUNT && !bad; k += ITN__LANES) {
        itn__vectors directions;
        itn__towards to;
        itn__floats pdf, lanes[3];
        itn__ints mask = itn__bits_mask(test_bits(k)), done;
        for (j = 0; j < ITN__LANES; j++) {
            itn__rng rng = itn__rng_make(2, 0, (uint64_t)(k + j));
            for (c = 0; c < 3; c++) u[c][j] = itn__uniform(&rng);
        }
        for (c = 0; c < 3; c++) lanes[c] = itn__load(u[c]);
        itn__draw_lights(scene, lanes, mask, &to, &pdf);
        directions = to.d, done = itn__less(itn__splat(0), pdf);
        itn__store(got[0], directions.x), itn__store(got[1], directions.y);
        itn__store(got[2], directions.z), itn__store(got[3], pdf);
        for (j = 0; j < ITN__LANES && !bad; j++) {
            itn__rng rng = itn__rng_make(2, 0, (uint64_t)(k + j));
            itn_vec3 d = itn__vec3(0, 0, 0), one = itn__vec3(got[0][j], got[1][j], got[2][j]);
            float expected = 0;
            int on = (int)((itn__mask_bits(mask) >> j) & 1), hit;
            int was = (int)((itn__mask_bits(done) >> j) & 1);
            hit = on && scalar_draw_light(scene, &rng, &d, &expected);
            drawn += hit;
            if (hit && (on_edge(scene, d) || on_edge(scene, one))) continue;
            bad += hit != was || (!was && got[3][j] != 0);
            if (hit)
                bad += !(itn__length(itn__sub(d, one)) <= tolerance) ||
                       !agree(got[3][j], expected, 1e-5 * expected + density_slack(loose, d));
            if (bad)
                check_report(0, __FILE__, __LINE__, "draw %d of %g %g %g: (%.8g %.8g %.8g) %.8g, "
                             "not (%.8g %.8g %.8g) %.8g", k + j, (double)u[0][j], (double)u[1][j],
                             (double)u[2][j], (double)one.x, (double)one.y, (double)one.z,
                             (double)got[3][j], (double)d.x, (double)d.y, (double)d.z,
                             (double)expected);
        }
    }
    CHECK(bad == 0);
    CHECK(drawn > COUNT / 3 || !(scene->lights[0].share > 0));
}

/* Draws at the ends of the unit interval are directions too. */
static void check_ends(const itn_scene *scene) {
    static const float ends[4] = {5.9604645e-8f, 1.7881393e-7f, .5f, .99999994f};
    int k;
    for (k = 0; k < 64; k++) {
        itn__towards to;
        itn__floats pdf, length, u[3];
        u[0] = itn__splat(ends[k % 4]), u[1] = itn__splat(ends[k / 4 % 4]);
        u[2] = itn__splat(ends[k / 16]);
        itn__draw_lights(scene, u, itn__splat_int(-1), &to, &pdf);
        length = itn__vdot(to.d, to.d);
        CHECK_NEAR(ITN__LANE(length, 0), 1, 2e-6);
        CHECK(itn__finite(ITN__LANE(pdf, 0)) && ITN__LANE(pdf, 0) >= 0);
    }
}

/* The density integrates to 1: a sun by its own solid angle, grids by the midpoint rule. */
static void check_integral(const itn_scene *scene, double factor) {
    enum { ROWS = 800, COLUMNS = 1600 };
    float d[3][ITN__LANES], pdf[ITN__LANES];
    itn__vectors directions;
    itn__towards to;
    double sum = 0;
    int r, c, j, i;
    for (r = 0; r < ROWS; r++)
        for (c = 0; c < COLUMNS; c += ITN__LANES) {
            for (j = 0; j < ITN__LANES; j++) {
                itn_vec3 one = scalar_map_direction((float)((c + j + .5) / COLUMNS),
                                                  (float)((r + .5) / ROWS));
                d[0][j] = one.x, d[1][j] = one.y, d[2][j] = one.z;
            }
            directions = itn__vectors_of(itn__load(d[0]), itn__load(d[1]), itn__load(d[2]));
            to = itn__towards_of(scene, &directions);
            itn__store(pdf, itn__lights_density(scene, &to));
            for (j = 0; j < ITN__LANES; j++) {
                itn_vec3 one = itn__vec3(d[0][j], d[1][j], d[2][j]);
                for (i = 0; i < scene->light_count; i++)
                    if (scene->lights[i].kind == ITN__LIGHT_SUN)
                        pdf[j] -= scene->lights[i].share * scalar_light_pdf(&scene->lights[i], one);
                sum += pdf[j] * sin(3.14159265358979 * (r + .5) / ROWS);
            }
        }
    sum *= 2 * 9.86960440108936 / ((double)ROWS * COLUMNS);
    for (i = 0; i < scene->light_count; i++)
        if (scene->lights[i].kind == ITN__LIGHT_SUN) sum += scene->lights[i].share;
    CHECK_NEAR(factor * sum, 1, .001);
}

static void test_scenes(void) {
    int kind, channels;
    for (kind = 0; kind < SCENES; kind++)
        for (channels = 1; channels <= 3; channels += 2) {
            itn_scene *scene = light_scene(kind, channels);
            check_drawn(scene, 1);
            check_draws(scene, 3e-6);
            check_ends(scene);
            if (kind == SKY) {
                CHECK_CATCHES(check_drawn(scene, 1.0003f));
                CHECK_CATCHES(check_draws(scene, 1e-9));
            }
            CHECK((scene->last_sampled < 0) == (kind == CONSTANT || kind == NARROW)); /* even maps */
            if (channels == 3 && scene->last_sampled >= 0) check_integral(scene, 1);
            if (channels == 3 && kind == SKY) CHECK_CATCHES(check_integral(scene, 1.003));
            itn_scene_free(scene);
        }
}

/* A pick is the first entry above u times the last; the rest is u's place in it. */
static void check_pick(int count, int kind, int off) {
    float *table = (float *)malloc((size_t)count * sizeof(float)), sum = 0;
    itn__rng rng = itn__rng_make(6, (uint64_t)count, (uint64_t)kind);
    int k, entry, bad = 0;
    if (!table) exit(1);
    for (k = 0; k < count; k++) {
        float u = itn__uniform(&rng);
        if (kind == 1) u = u < .7f ? 0 : u; /* entries that are never picked */
        if (kind == 2) u = k == count / 2 ? 1e6f : u;
        if (kind == 3) u = 0;
        table[k] = sum += u;
    }
    for (k = 0; k < 2000; k++) {
        float u = k == 0 ? .99999994f : k == 1 ? 5.9604645e-8f : itn__uniform(&rng), rest, before;
        float at;
        if (k > 1000) u = itn__max((float)(k % count) / (float)count, 5.9604645e-8f);
        at = u * sum;
        for (entry = 0; entry < count - 1 && table[entry] <= at; entry++) {}
        bad += entry != one_pick(table, count, u, &rest) + off;
        before = entry ? table[entry - 1] : 0;
        bad += !(fabsf(before + rest * (table[entry] - before) - at) <= 1e-6f * sum);
    }
    CHECK(bad == 0);
    free(table);
}

static void test_picks(void) {
    static const int counts[8] = {1, 2, 3, 10, 63, 64, 1000, 4097};
    int k, kind;
    for (k = 0; k < 8; k++)
        for (kind = 0; kind < 3; kind++) check_pick(counts[k], kind, 0);
    CHECK_CATCHES(check_pick(10, 0, 1));
}

/* A map whose numbers an index of 32 bits cannot count is refused before it is read. */
static void test_size(void) {
    float pixel = 1;
    char name[1][ITN_NAME_SIZE] = {"Y"};
    itn_image image = ITN_ZERO;
    itn_scene *scene = NULL;
    itn_error error;
    stage s;
    image.width = 65536, image.height = 32768, image.plane_count = 1;
    image.pixels = &pixel, image.names = name;
    stage_begin(&s, 8, 3, 40);
    stage_diffuse(&s, "s", .5);
    stage_object(&s, NULL, NULL, "s");
    stage_map(&s, "map", &image);
    CHECK(itn_scene_create(&s.desc, NULL, &scene, &error) == ITN_ERROR_ARGUMENT && !scene);
    CHECK(strstr(error.message, "65536 x 32768") != NULL);
}

/* Shares: a narrow sun takes what a broad sky is found without; alone, a light is always chosen. */
static void test_shares(void) {
    itn_scene *scene = light_scene(SEVERAL, 1);
    double sum = 0;
    int i;
    for (i = 0; i < scene->light_count; i++) sum += scene->lights[i].share;
    CHECK_NEAR(sum, 1, 1e-6);
    CHECK(scene->light_count == 9); /* what maps have everywhere is light 1, and 6 */
    for (i = 0; i < scene->light_count; i++)
        if (scene->lights[i].kind == ITN__LIGHT_CONSTANT) CHECK(scene->lights[i].share == 0);
        else CHECK(scene->lights[i].share >= .05f / 6.01f);
    itn_scene_free(scene);
    scene = light_scene(SKY, 1); /* p + breadth in proportion to strength, unless at the floor */
    for (i = 0, sum = 0; i < 2; i++) sum += scene->lights[i].strength;
    for (i = 0; i < 2; i++) {
        double p = (1 + scene->lights[0].breadth + scene->lights[1].breadth) *
                       scene->lights[i].strength / sum - scene->lights[i].breadth;
        p = p < 0 ? 0 : p > 1 ? 1 : p;
        CHECK_NEAR(scene->lights[i].share, .95 * p + .025, 1e-6);
    }
    CHECK(scene->lights[0].breadth > .3 && scene->lights[0].breadth < .5);
    CHECK_NEAR(scene->lights[1].breadth, .5 * scene->lights[1].sun_cone, 1e-7);
    itn_scene_free(scene);
    scene = light_scene(BRIGHT_SUN, 1); /* scattering finds enough of the sky */
    CHECK_NEAR(scene->lights[0].share, .025, 1e-6);
    CHECK_NEAR(scene->lights[1].share, .975, 1e-6);
    itn_scene_free(scene);
    scene = light_scene(SMOOTH_MAP, 3);
    CHECK_NEAR(scene->lights[0].share, 1, 1e-6);
    itn_scene_free(scene);
}

int main(void) {
    test_picks();
    test_size();
    test_shares();
    test_scenes();
    return check_end("light_lanes");
}
