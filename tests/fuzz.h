/* What is done with bytes that nobody made on purpose, of a kind: a scene, a mesh, a picture, a
   network's weights, or the descs of a caller. Whatever they are, calls end, give back their
   memory, leave outputs alone where they fail and say why, and make only what is valid where they
   do not. fuzz.c searches for bytes that break this; what searches have kept, in corpus/KIND.txt,
   is tried again by the suite `files`: an input a line, where \ and two digits are a byte by its
   hexadecimal number. Include after itn.h. */
#ifndef FUZZ_H
#define FUZZ_H
#include "accountant.h"
#ifndef FUZZ_HOLDS
#define FUZZ_HOLDS(condition) CHECK(condition)
#endif

static void *fuzz_allocate(size_t bytes, void *user) { /* large blocks are refused */
    return bytes > 1u << 26 ? NULL : count_allocate(bytes, user);
}

/* A failure says why, in the code that it returns. */
static void fuzz_said(itn_result result, const itn_error *error) {
    FUZZ_HOLDS(result == ITN_OK || (error->code == result && *error->message &&
                                    memchr(error->message, 0, sizeof error->message)));
}

/* One picture of a scene, of few scatterings; and the other walk's, where it is not long. Samples are
   few, as one that is caught between mirrors takes up to a second. */
static void fuzz_render(const itn_scene *scene) {
    itn_film_desc film = itn_scene_film(scene);
    itn_render_options options = ITN_ZERO;
    itn_image image = ITN_ZERO;
    itn_error error = ITN_ZERO;
    double thickest = 0;
    if ((double)film.width * film.height > 16) return;
    for (int k = 0; k < itn_parameter_count(scene); k++) {
        const itn_parameter *p = itn_parameter_get(scene, k);
        FUZZ_HOLDS(p->lower <= p->value && p->value <= p->upper);
        FUZZ_HOLDS(itn_parameter_find(scene, p->name) == k);
        if (strstr(p->name, ".sigma_t")) {
            char medium[ITN_NAME_SIZE];
            strcpy(medium, p->name), *strchr(medium, '.') = 0;
            double thickness = itn_scene_thickness(scene, NULL, medium);
            FUZZ_HOLDS(thickness >= 0);
            if (thickness > thickest) thickest = thickness;
        }
    }
    options.spp = options.walks = 1, options.max_scatter = 4;
    for (int fast = 0; fast < 1 + (thickest < 10); fast++, options.max_scatter = 0) {
        itn_result result = itn_render(scene, NULL, &options, NULL, 0, &image, &error);
        fuzz_said(result, &error);
        FUZZ_HOLDS(!result || result == ITN_ERROR_MEMORY || result == ITN_ERROR_UNSUPPORTED);
        for (int k = 0; !result && k < film.width * film.height * film.channels; k++)
            FUZZ_HOLDS(itn__finite(image.pixels[k]));
        itn_image_free(&image);
    }
}

static void fuzz_mesh(const unsigned char *bytes, size_t size, const itn_context *context) {
    itn_mesh mesh = ITN_ZERO;
    itn_mesh_report report;
    itn_bvh *bvh = NULL;
    itn_error error = ITN_ZERO;
    itn_result result = itn_mesh_from_memory(bytes, size, NULL, context, &mesh, &error);
    fuzz_said(result, &error);
    FUZZ_HOLDS(result ? !mesh.positions && !mesh.triangles : mesh.triangle_count > 0);
    if (result) return;
    FUZZ_HOLDS(!itn_mesh_check(&mesh, context, &report, &error));
    FUZZ_HOLDS(!report.bad_indices && !report.bad_vertices);
    result = itn_bvh_create(&mesh, context, &bvh, &error);
    FUZZ_HOLDS(!result || result == ITN_ERROR_MEMORY);
    for (int k = 0; k < 8 && bvh; k++) {
        itn_ray ray = {{0, 0, 5}, {(float)k / 16, .1f, -1}, 0, 1e30f};
        itn_hit hit = {0, 0, 0, 0, 0};
        if (itn_bvh_nearest(bvh, &ray, &hit))
            FUZZ_HOLDS(hit.triangle >= 0 && hit.triangle < mesh.triangle_count && hit.t > 0);
    }
    itn_bvh_free(bvh), itn_mesh_free(&mesh);
}

static void fuzz_image(const unsigned char *bytes, size_t size, const itn_context *context) {
    itn_image image = ITN_ZERO, photo = ITN_ZERO;
    itn_film_desc film = ITN_ZERO;
    itn_error error = ITN_ZERO;
    itn_result result = itn_image_from_memory(bytes, size, NULL, context, &image, &error);
    fuzz_said(result, &error);
    FUZZ_HOLDS(result ? !image.pixels && !image.names : image.plane_count > 0);
    if (result) return;
    for (int k = 0; k < image.plane_count; k++)
        FUZZ_HOLDS(memchr(image.names[k], 0, ITN_NAME_SIZE) &&
                   itn_image_plane(&image, image.names[k]));
    film.width = image.width, film.height = image.height, film.channels = 1;
    if ((double)image.width * image.height < 4096) {
        result = itn_photo_make(&image, NULL, film, &photo, NULL, &error);
        fuzz_said(result, &error);
        FUZZ_HOLDS(result ? !photo.pixels : photo.pixels && photo.plane_count <= 2);
    }
    itn_image_free(&photo), itn_image_free(&image);
}

/* Checksums are made right, that what is behind them be reached. */
static void fuzz_png(unsigned char *bytes, size_t size, const itn_context *context) {
    for (size_t at = 8, length; size > at && size - at >= 12; at += 12 + length) {
        length = (size_t)itn__from_bytes(bytes + at, 4, 1);
        if (length > size - at - 12) break;
        uint32_t crc = itn__crc32(bytes + at + 4, length + 4);
        for (int k = 0; k < 4; k++)
            bytes[at + 8 + length + (size_t)k] = (unsigned char)(crc >> (24 - 8 * k) & 255);
    }
    fuzz_image(bytes, size, context);
}

static void fuzz_net(unsigned char *bytes, size_t size, const itn_context *context) {
    itn_net *net = NULL;
    itn_error error = ITN_ZERO;
    uint64_t sum = size > 8 ? itn__fnv1a(bytes, size - 8) : 0;
    for (size_t k = 0; k < 8 && size > 8; k++)
        bytes[size - 8 + k] = (unsigned char)(sum >> 8 * k & 255);
    itn_result result = itn_net_from_memory(bytes, size, NULL, 1, context, &net, &error);
    fuzz_said(result, &error);
    FUZZ_HOLDS(!result == !!net);
    itn_net_desc shape = ITN_ZERO;
    if (net) shape = itn_net_shape(net);
    if (net && (double)shape.width * shape.height * shape.channels <= 4096) {
        static float seen[4096], outputs[4096];
        result = itn_net_forward(net, 1, seen, outputs, &error);
        fuzz_said(result, &error);
    }
    itn_net_free(net);
}

/* A scene file, among the files that shipped ones name. */
static void fuzz_scene(const unsigned char *bytes, size_t size, const itn_context *context) {
    static const char cube[] = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 0\nv 0 0 1\nv 1 0 1\nv 0 1 1\n"
                               "v 1 1 1\nf 1 3 4 2\nf 5 6 8 7\nf 1 2 6 5\nf 3 7 8 4\nf 1 5 7 3\n"
                               "f 2 4 8 6\n";
    static const char steep[] = "PF 2 2 -1.0\n\0\0\0\x3f\0\0\0\x3f\0\0\x80\x3f\0\0\0\x3f\0\0\0\x3f"
                                "\0\0\x80\x3f\0\0\0\x3f\0\0\0\x3f\0\0\x80\x3f\0\0\0\x3f\0\0\0\x3f"
                                "\0\0\x80\x3f";
    static const char map[] = "Pf 2 2 -1.0\n\0\0\0\x3f\0\0\0\x3f\0\0\0\x3f\0\0\x80\x3f";
    static const char sky[] = "coefficients_r -1 -.4 1 .5 -2 .2 .1 1 .5\n"
                              "coefficients_g -1 -.4 1 .5 -2 .2 .1 1 .5\n"
                              "coefficients_b -1 -.4 1 .5 -2 .2 .1 1 .5\n"
                              "radiance 1 2 3\nsun_radiance 100 90 80\n";
    const itn_file files[] = {{"a.obj", cube, sizeof cube - 1}, {"a.pfm", map, sizeof map - 1},
                              {"a.sky", sky, sizeof sky - 1}, {"self", bytes, size},
                              {"n.pfm", steep, sizeof steep - 1}};
    itn_scene *scene = NULL;
    itn_error error = ITN_ZERO;
    itn_result result =
        itn_scene_from_memory(bytes, size, "/none/x", files, 5, context, &scene, &error);
    fuzz_said(result, &error);
    FUZZ_HOLDS(!result == !!scene);
    if (scene) fuzz_render(scene);
    itn_scene_free(scene);
}

/* Descs whose numbers are the bytes: halves of them as they are, so that ranges are met often. */
typedef struct fuzz_bytes {
    const unsigned char *at, *end;
} fuzz_bytes;
static int fuzz_byte(fuzz_bytes *b) { return b->at < b->end ? *b->at++ : 0; }
static float fuzz_float(fuzz_bytes *b) {
    static const float special[] = {0, 1, -1, .5f, 1e-12f, 1e12f, 1e18f, 3e38f, 1e-40f, .999f,
                                    INFINITY, -INFINITY, NAN, 4, 180, 65536};
    int kind = fuzz_byte(b);
    if (kind < 160) return (float)(kind - 16) / 16;
    if (kind < 240) return special[kind % 16];
    uint32_t bits = 0;
    for (int k = 0; k < 4; k++) bits = bits << 8 | (uint32_t)fuzz_byte(b);
    return itn__float_of(bits);
}
static void fuzz_floats(fuzz_bytes *b, float *floats, int count) {
    for (int k = 0; k < count; k++) floats[k] = fuzz_float(b);
}
static itn_vec3 fuzz_vec3(fuzz_bytes *b) {
    float x = fuzz_float(b), y = fuzz_float(b);
    return itn__vec3(x, y, fuzz_float(b));
}
static int fuzz_int(fuzz_bytes *b) {
    int kind = fuzz_byte(b);
    return kind == 255 ? INT_MAX : kind == 254 ? INT_MIN : kind < 200 ? kind % 8 : kind - 230;
}
static void fuzz_desc(const unsigned char *bytes, size_t size, const itn_context *context) {
    static const char *const names[] = {"a", "b", "c", "", NULL, "1x", "a name", "light"};
    fuzz_bytes b = {bytes, bytes + size};
    itn_scene_desc desc = ITN_ZERO;
    itn_medium_desc media[2];
    itn_surface_desc surfaces[2];
    itn_object_desc objects[3];
    itn_light_desc lights[2];
    itn_mesh mesh = ITN_ZERO;
    itn_image image = ITN_ZERO;
    float corners[24], uvs[72], pixels[12];
    int faces[36];
    char plane_names[3][ITN_NAME_SIZE] = {"R", "G", "B"};
    memset(media, 0, sizeof media), memset(surfaces, 0, sizeof surfaces);
    memset(objects, 0, sizeof objects), memset(lights, 0, sizeof lights);
    mesh.vertex_count = 8, mesh.triangle_count = 12, mesh.positions = corners;
    mesh.triangles = faces, mesh.uvs = fuzz_byte(&b) % 2 ? uvs : NULL;
    for (int k = 0; k < 36; k++) {
        static const int cube[36] = {0, 2, 1, 1, 2, 3, 4, 5, 6, 5, 7, 6, 0, 1, 4, 1, 5, 4,
                                     2, 6, 3, 3, 6, 7, 0, 4, 2, 2, 4, 6, 1, 3, 5, 3, 7, 5};
        faces[k] = cube[k], corners[k % 24] = (float)(((k % 24 / 3) >> (k % 3)) & 1);
    }
    for (int k = fuzz_byte(&b) % 4; k > 0; k--) corners[fuzz_byte(&b) % 24] = fuzz_float(&b);
    for (int k = fuzz_byte(&b) % 3; k > 0; k--) faces[fuzz_byte(&b) % 36] = fuzz_int(&b);
    fuzz_floats(&b, uvs, mesh.uvs ? 4 : 0), memset(uvs + 4, 0, sizeof uvs - 4 * sizeof *uvs);
    if (!mesh.uvs) memset(uvs, 0, sizeof uvs);
    image.width = 2, image.height = 2, image.plane_count = 1 + 2 * (fuzz_byte(&b) % 2);
    image.names = plane_names, image.pixels = pixels;
    fuzz_floats(&b, pixels, 4), memcpy(pixels + 4, pixels, 16), memcpy(pixels + 8, pixels, 16);
    desc.film.width = desc.film.height = 1 + fuzz_byte(&b) % 2;
    if (fuzz_byte(&b) > 250) desc.film.width = fuzz_int(&b);
    desc.film.channels = fuzz_byte(&b) % 4, desc.film.filter = (itn_filter)(fuzz_byte(&b) % 3);
    desc.film.deviation = fuzz_float(&b), desc.film.exposure = fuzz_float(&b);
    desc.film.has_background = fuzz_byte(&b) % 2;
    if (desc.film.has_background) fuzz_floats(&b, desc.film.background, 3);
    desc.camera.eye = fuzz_vec3(&b), desc.camera.target = fuzz_vec3(&b);
    desc.camera.up = fuzz_vec3(&b), desc.camera.fov = 30 * fuzz_float(&b);
    desc.medium_count = fuzz_byte(&b) % 3, desc.surface_count = fuzz_byte(&b) % 3;
    desc.object_count = fuzz_byte(&b) % 4, desc.light_count = fuzz_byte(&b) % 3;
    for (int k = 0; k < desc.medium_count; k++) {
        media[k].name = names[fuzz_byte(&b) % 8], media[k].sigma_t = fuzz_float(&b);
        fuzz_floats(&b, media[k].albedo, 3), media[k].g = fuzz_float(&b);
        if (fuzz_byte(&b) % 4 == 3) fuzz_floats(&b, media[k].sigma_t_rgb, 3);
        if (fuzz_byte(&b) % 4 == 3) fuzz_floats(&b, media[k].g_rgb, 3);
        if (fuzz_byte(&b) % 2) media[k].phase = (itn_phase_type)(fuzz_byte(&b) % 4);
        if (media[k].phase) media[k].kappa = fuzz_float(&b);
        if (media[k].phase) media[k].lobe_count = fuzz_byte(&b) % 6;
        for (int m = 0; m < 4 && m < media[k].lobe_count; m++) {
            media[k].lobes[m].phase = (itn_phase_type)(fuzz_byte(&b) % 4);
            media[k].lobes[m].shape = fuzz_float(&b), media[k].lobes[m].weight = fuzz_float(&b);
        }
    }
    for (int k = 0; k < desc.surface_count; k++) {
        surfaces[k].name = names[fuzz_byte(&b) % 8];
        surfaces[k].type = (itn_surface_type)(fuzz_byte(&b) % 10);
        surfaces[k].ior = fuzz_float(&b), surfaces[k].alpha = fuzz_float(&b);
        fuzz_floats(&b, surfaces[k].reflectance, 3), fuzz_floats(&b, surfaces[k].reflectance2, 3);
        surfaces[k].texture = (itn_texture_type)(fuzz_byte(&b) % 4);
        surfaces[k].checker_size = fuzz_float(&b);
        surfaces[k].image = fuzz_byte(&b) % 2 ? &image : NULL;
        surfaces[k].distribution = (itn_distribution)(fuzz_byte(&b) % 3);
        surfaces[k].has_reflectance = fuzz_byte(&b) % 2;
        fuzz_floats(&b, surfaces[k].eta, 3), fuzz_floats(&b, surfaces[k].k, 3);
        surfaces[k].sigma = fuzz_float(&b), fuzz_floats(&b, surfaces[k].specular, 3);
        surfaces[k].alpha_x = fuzz_float(&b), surfaces[k].alpha_y = fuzz_float(&b);
        surfaces[k].nu = fuzz_float(&b), surfaces[k].nv = fuzz_float(&b);
        surfaces[k].bump = fuzz_byte(&b) % 4 == 3 ? &image : NULL;
        surfaces[k].normal = fuzz_byte(&b) % 4 == 3 ? &image : NULL;
        surfaces[k].bump_scale = surfaces[k].bump ? fuzz_float(&b) : 0;
        surfaces[k].parts = names + fuzz_byte(&b) % 6, surfaces[k].part_count = fuzz_byte(&b) % 3;
        surfaces[k].weights = pixels;
        surfaces[k].measured.bytes = bytes, surfaces[k].measured.size = size;
    }
    for (int k = 0; k < desc.object_count; k++) {
        objects[k].mesh = fuzz_byte(&b) % 4 ? &mesh : NULL;
        objects[k].medium = names[fuzz_byte(&b) % 5], objects[k].surface = names[fuzz_byte(&b) % 5];
        objects[k].plane_y = fuzz_float(&b), objects[k].half_size = fuzz_float(&b);
        objects[k].force = fuzz_byte(&b) % 2;
        if (fuzz_byte(&b) % 2) fuzz_floats(&b, objects[k].transform, 12);
    }
    for (int k = 0; k < desc.light_count; k++) {
        lights[k].name = names[fuzz_byte(&b) % 8];
        lights[k].type = (itn_light_type)(fuzz_byte(&b) % 4);
        fuzz_floats(&b, lights[k].radiance, 3), lights[k].scale = fuzz_float(&b);
        lights[k].sun_scale = fuzz_float(&b), lights[k].has_scale = fuzz_byte(&b) % 2;
        lights[k].image = fuzz_byte(&b) % 8 ? &image : NULL;
        lights[k].repair = fuzz_byte(&b) % 2, lights[k].rotate = 90 * fuzz_float(&b);
        if (lights[k].type == ITN_LIGHT_SKY) {
            fuzz_floats(&b, lights[k].sky.coefficients[0], 9);
            memcpy(lights[k].sky.coefficients[1], lights[k].sky.coefficients[0], 36);
            memcpy(lights[k].sky.coefficients[2], lights[k].sky.coefficients[0], 36);
            fuzz_floats(&b, lights[k].sky.radiance, 3);
            fuzz_floats(&b, lights[k].sky.sun_radiance, 3);
            lights[k].sun_direction = fuzz_vec3(&b);
            lights[k].sun_radius_scale = 30 * fuzz_float(&b);
        }
    }
    desc.media = media, desc.surfaces = surfaces, desc.objects = objects, desc.lights = lights;
    itn_scene *scene = NULL;
    itn_error error = ITN_ZERO;
    itn_result result = itn_scene_create(&desc, context, &scene, &error);
    fuzz_said(result, &error);
    FUZZ_HOLDS(!result == !!scene);
    if (scene) fuzz_render(scene);
    itn_scene_free(scene);
}

/* Tries bytes as a file of a kind: a copy of them, which may be changed, and ends where it says.
   leak: how many blocks of memory are not to come back, 0 but for a planted error. */
static void fuzz_one(const char *kind, const unsigned char *given, size_t size, int leak) {
    accountant a = {0, 0, 0, 0};
    itn_context context = count_context(&a);
    unsigned char *bytes = (unsigned char *)malloc(size + !size);
    if (!bytes) return;
    if (size) memcpy(bytes, given, size);
    context.allocate = fuzz_allocate;
    if (!strcmp(kind, "scene")) fuzz_scene(bytes, size, &context);
    else if (!strcmp(kind, "obj") || !strcmp(kind, "ply")) fuzz_mesh(bytes, size, &context);
    else if (!strcmp(kind, "png")) fuzz_png(bytes, size, &context);
    else if (!strcmp(kind, "net")) fuzz_net(bytes, size, &context);
    else if (!strcmp(kind, "desc")) fuzz_desc(bytes, size, &context);
    else fuzz_image(bytes, size, &context);
    FUZZ_HOLDS(a.live == leak);
    free(bytes);
}

/* Calls `each` for every input of a corpus, with its number; returns how many there are. */
static int fuzz_corpus(const char *kind, void (*each)(const char *kind, int number,
                                                      const unsigned char *bytes, size_t size)) {
    static unsigned char bytes[8192];
    char path[100];
    size_t size = 0;
    int count = 0, c;
    snprintf(path, sizeof path, "corpus/%s.txt", kind);
    FILE *file = fopen(path, "r");
    while (file && (c = getc(file)) != EOF && size < sizeof bytes) {
        unsigned hex = 0;
        if (c == '\n') each(kind, count++, bytes, size), size = 0;
        else if (c != '\\' || fscanf(file, "%2x", &hex) == 1)
            bytes[size++] = (unsigned char)(c == '\\' ? hex : (unsigned)c);
    }
    if (file) fclose(file);
    return count;
}
#endif
