/* Solids in a light: the meshes and the small scenes that the physical tests are made of. Include
   after itn.h and check.h. Everything here stops the program when it fails, except measurements,
   which are for the caller to judge. */
#ifndef SOLIDS_H
#define SOLIDS_H

#if defined(__GNUC__)
#define SOLIDS_STATIC static __attribute__((unused))
#else
#define SOLIDS_STATIC static
#endif

SOLIDS_STATIC void solids_need(itn_result result, const itn_error *error) {
    if (result == ITN_OK) return;
    printf("FAILED to set up a test: %s\n", error->message);
    exit(1);
}

SOLIDS_STATIC itn_vec3 solids_vec3(double x, double y, double z) {
    itn_vec3 v;
    v.x = (float)x, v.y = (float)y, v.z = (float)z;
    return v;
}

/* ---- meshes: closed, counter-clockwise seen from outside; free with itn_mesh_free ------------ */

/* The box between two corners, 12 triangles. */
SOLIDS_STATIC itn_mesh solids_box(itn_vec3 lower, itn_vec3 upper) {
    static const int triangles[12][3] = {{0, 2, 1}, {1, 2, 3}, {4, 5, 6}, {5, 7, 6},
                                         {0, 1, 4}, {1, 5, 4}, {2, 6, 3}, {3, 6, 7},
                                         {0, 4, 2}, {2, 4, 6}, {1, 3, 5}, {3, 7, 5}};
    itn_mesh mesh;
    itn_error error;
    int i;
    solids_need(itn_mesh_create(8, 12, 0, NULL, &mesh, &error), &error);
    for (i = 0; i < 8; i++) {
        mesh.positions[3 * i] = i & 1 ? upper.x : lower.x;
        mesh.positions[3 * i + 1] = i & 2 ? upper.y : lower.y;
        mesh.positions[3 * i + 2] = i & 4 ? upper.z : lower.z;
    }
    memcpy(mesh.triangles, triangles, sizeof triangles);
    return mesh;
}

/* A layer from y = -thickness to y = 0, half_width to each side in x and z. */
SOLIDS_STATIC itn_mesh solids_slab(double thickness, double half_width) {
    return solids_box(solids_vec3(-half_width, -thickness, -half_width),
                      solids_vec3(half_width, 0, half_width));
}

/* The triangles of an icosahedron divided `levels` times (20 * 4^levels), corners on the sphere. */
SOLIDS_STATIC itn_mesh solids_sphere(double radius, int levels) {
    static const int faces[20][3] = {
        {0, 11, 5}, {0, 5, 1},  {0, 1, 7},   {0, 7, 10}, {0, 10, 11}, {1, 5, 9}, {5, 11, 4},
        {11, 10, 2}, {10, 7, 6}, {7, 1, 8},  {3, 9, 4},  {3, 4, 2},   {3, 2, 6}, {3, 6, 8},
        {3, 8, 9},  {4, 9, 5},  {2, 4, 11},  {6, 2, 10}, {8, 6, 7},   {9, 8, 1}};
    static const double t = 1.6180339887498949;
    const double corners[12][3] = {{-1, t, 0}, {1, t, 0}, {-1, -t, 0}, {1, -t, 0},
                                   {0, -1, t}, {0, 1, t}, {0, -1, -t}, {0, 1, -t},
                                   {t, 0, -1}, {t, 0, 1}, {-t, 0, -1}, {-t, 0, 1}};
    int n = 1 << levels, row = (n + 1) * (n + 2) / 2, face, i, j, k, vertex = 0, triangle = 0;
    itn_mesh mesh;
    itn_error error;
    /* vertices on the edges of the 20 faces are repeated, at the same positions: the sums below
       take the corners in the order of their number, so that both faces round alike */
    solids_need(itn_mesh_create(20 * row, 20 * n * n, 0, NULL, &mesh, &error), &error);
    for (face = 0; face < 20; face++) {
        int base = vertex;
        for (i = 0; i <= n; i++)
            for (j = 0; j <= n - i; j++, vertex++) {
                int weight[3], order[3] = {0, 1, 2}, a, b;
                double p[3] = {0, 0, 0}, length;
                weight[0] = n - i - j, weight[1] = i, weight[2] = j;
                for (a = 0; a < 2; a++)
                    for (b = a + 1; b < 3; b++)
                        if (faces[face][order[b]] < faces[face][order[a]]) {
                            int swap = order[a];
                            order[a] = order[b], order[b] = swap;
                        }
                for (a = 0; a < 3; a++)
                    for (k = 0; k < 3; k++)
                        p[k] += weight[order[a]] * corners[faces[face][order[a]]][k];
                length = sqrt(p[0] * p[0] + p[1] * p[1] + p[2] * p[2]);
                for (k = 0; k < 3; k++)
                    mesh.positions[3 * vertex + k] = (float)(radius * p[k] / length);
            }
#define SOLIDS_INDEX(i, j) (base + (i) * (n + 1) - (i) * ((i) - 1) / 2 + (j))
        for (i = 0; i < n; i++)
            for (j = 0; j < n - i; j++) {
                int *out = mesh.triangles + 3 * triangle++;
                out[0] = SOLIDS_INDEX(i, j);
                out[1] = SOLIDS_INDEX(i + 1, j), out[2] = SOLIDS_INDEX(i, j + 1);
                if (j + 1 < n - i) {
                    out = mesh.triangles + 3 * triangle++;
                    out[0] = SOLIDS_INDEX(i + 1, j);
                    out[1] = SOLIDS_INDEX(i + 1, j + 1), out[2] = SOLIDS_INDEX(i, j + 1);
                }
            }
#undef SOLIDS_INDEX
    }
    return mesh;
}

/* Triangles of next to no height in the plane y = 0, not closed, drawn from `random`. */
SOLIDS_STATIC itn_mesh solids_needles(uint64_t *random, double height, int count) {
    itn_mesh mesh;
    itn_error error;
    int i, k;
    solids_need(itn_mesh_create(3 * count, count, 0, NULL, &mesh, &error), &error);
    for (i = 0; i < count; i++) {
        double a[2], c[2], t = check_uniform(random);
        float *p = mesh.positions + 9 * i;
        for (k = 0; k < 2; k++)
            a[k] = 2 * check_uniform(random) - 1, c[k] = 2 * check_uniform(random) - 1;
        p[0] = (float)a[0], p[2] = (float)a[1], p[3] = (float)c[0], p[5] = (float)c[1];
        p[6] = (float)(a[0] + t * (c[0] - a[0]) - height * (c[1] - a[1]));
        p[8] = (float)(a[1] + t * (c[1] - a[1]) + height * (c[0] - a[0]));
        for (k = 0; k < 3; k++) mesh.triangles[3 * i + k] = 3 * i + k;
    }
    return mesh;
}

/* ---- scenes: one solid, one light, one camera ------------------------------------------------ */

/* A solid of medium "m" with surface "s" (if ior is not 0) in a light "light". All-zero fields:
   no medium if sigma_t is negative, no surface, constant light 1, a film of 16 x 16, eye (0,1,0)
   looking down with a field of view of .01 degrees. */
typedef struct solids_desc {
    const itn_mesh *mesh;
    double sigma_t, albedo, g;
    double ior, alpha;
    itn_distribution distribution;
    const itn_image *map; /* instead of the constant light */
    const itn_light_desc *light; /* instead of map and constant light */
    itn_vec3 eye, target, up;
    double fov;
    int width, height;
} solids_desc;

SOLIDS_STATIC itn_scene *solids_scene(const solids_desc *in) {
    itn_medium_desc medium = ITN_ZERO;
    itn_surface_desc surface = ITN_ZERO;
    itn_object_desc object = ITN_ZERO;
    itn_light_desc light = ITN_ZERO;
    itn_scene_desc desc = ITN_ZERO;
    itn_scene *scene = NULL;
    itn_error error;
    int k;
    medium.name = "m", medium.sigma_t = (float)in->sigma_t, medium.g = (float)in->g;
    for (k = 0; k < 3; k++) medium.albedo[k] = (float)in->albedo, light.radiance[k] = 1;
    surface.name = "s", surface.ior = (float)in->ior, surface.alpha = (float)in->alpha;
    surface.distribution = in->distribution;
    object.mesh = in->mesh;
    object.medium = in->sigma_t < 0 ? NULL : "m";
    object.surface = in->ior != 0 ? "s" : NULL;
    if (in->map) light.type = ITN_LIGHT_MAP, light.image = in->map;
    if (in->light) light = *in->light;
    desc.media = &medium, desc.medium_count = in->sigma_t < 0 ? 0 : 1;
    desc.surfaces = &surface, desc.surface_count = in->ior != 0 ? 1 : 0;
    desc.objects = &object, desc.object_count = 1;
    desc.lights = &light, desc.light_count = 1;
    desc.film.width = in->width ? in->width : 16, desc.film.height = in->height ? in->height : 16;
    desc.camera.eye = in->eye, desc.camera.target = in->target, desc.camera.up = in->up;
    desc.camera.fov = (float)(in->fov != 0 ? in->fov : .01);
    if (in->eye.x == 0 && in->eye.y == 0 && in->eye.z == 0) desc.camera.eye.y = 1;
    if (in->up.x == 0 && in->up.y == 0 && in->up.z == 0) desc.camera.up.z = 1;
    solids_need(itn_scene_create(&desc, NULL, &scene, &error), &error);
    return scene;
}

/* ---- measurements ---------------------------------------------------------------------------- */

typedef struct solids_mean {
    double value, error; /* mean and its standard error */
} solids_mean;

/* The ways to render: the reference, and the fast walk with each of its samplers. */
enum { SOLIDS_WAYS = 3 };
SOLIDS_STATIC void solids_way(itn_render_options *options, int way) {
    int fast = way && !options->max_scatter; /* limits are the reference's */
    options->mode = fast ? ITN_MODE_FAST : ITN_MODE_REFERENCE;
    options->sampler = way == 1 ? ITN_SAMPLER_RANDOM : ITN_SAMPLER_SOBOL;
    options->walks = way == 1 ? 1 : 0;
}

/* Mean of plane `name` over all pixels; its standard error from plane `variance`. */
SOLIDS_STATIC solids_mean solids_plane_mean(const itn_image *image, const char *name,
                                            const char *variance) {
    const float *value = itn_image_plane(image, name), *spread = itn_image_plane(image, variance);
    int i, count = image->width * image->height;
    solids_mean mean = ITN_ZERO;
    if (!value || !spread) {
        mean.value = mean.error = NAN;
        return mean;
    }
    for (i = 0; i < count; i++) mean.value += value[i], mean.error += spread[i];
    mean.value /= count, mean.error = sqrt(mean.error) / count;
    return mean;
}

/* Renders and averages over the film: means[0] is the radiance, means[1 + k] its derivative in
   names[k] ("m.albedo"). At most 8 names. */
SOLIDS_STATIC void solids_measure(const itn_scene *scene, const float *theta,
                                  const itn_render_options *options, const char *const *names,
                                  int count, solids_mean *means) {
    int parameters[8] = {0}, k;
    itn_image image = ITN_ZERO;
    itn_error error;
    error.message[0] = 0;
    for (k = 0; k < count; k++) parameters[k] = itn_parameter_find(scene, names[k]);
    solids_need(itn_render(scene, theta, options, parameters, count, &image, &error), &error);
    means[0] = solids_plane_mean(&image, "Y", "Variance.Y");
    for (k = 0; k < count; k++) {
        char mean[2 * ITN_NAME_SIZE], variance[3 * ITN_NAME_SIZE], *dot;
        snprintf(mean, sizeof mean, "d_%s", names[k]);
        dot = strchr(mean, '.');
        if (dot) *dot = '_';
        snprintf(variance, sizeof variance, "%s_variance.Y", mean);
        strcat(mean, ".Y");
        means[1 + k] = solids_plane_mean(&image, mean, variance);
    }
    itn_image_free(&image);
}

/* The same for a scene that is needed only once. */
SOLIDS_STATIC void solids_measure_desc(const solids_desc *desc, int spp, uint64_t seed,
                                       const char *const *names, int count, solids_mean *means) {
    itn_scene *scene = solids_scene(desc);
    itn_render_options options = ITN_ZERO;
    options.spp = spp, options.seed = seed;
    solids_measure(scene, NULL, &options, names, count, means);
    itn_scene_free(scene);
}
#endif
