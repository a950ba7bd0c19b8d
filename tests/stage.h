/* A stage: a scene desc with room for a few items of each kind, filled by one call per item.
   Include after itn.h and check.h. What fails here stops the program. */
#ifndef STAGE_H
#define STAGE_H

#if defined(__GNUC__)
#define STAGE_STATIC static __attribute__((unused))
#else
#define STAGE_STATIC static
#endif

enum { STAGE_ITEMS = 8 };

typedef struct stage {
    itn_scene_desc desc;
    itn_medium_desc media[STAGE_ITEMS];
    itn_surface_desc surfaces[STAGE_ITEMS];
    itn_object_desc objects[STAGE_ITEMS];
    itn_light_desc lights[STAGE_ITEMS];
} stage;

/* An empty stage seen from (0,0,distance) towards the origin. */
STAGE_STATIC void stage_begin(stage *s, int size, double distance, double fov) {
    memset(s, 0, sizeof *s);
    s->desc.film.width = s->desc.film.height = size;
    s->desc.camera.eye.z = (float)distance;
    s->desc.camera.fov = (float)fov;
    s->desc.media = s->media, s->desc.surfaces = s->surfaces;
    s->desc.objects = s->objects, s->desc.lights = s->lights;
}

STAGE_STATIC itn_medium_desc *stage_medium(stage *s, const char *name, double sigma_t,
                                           double albedo, double g) {
    itn_medium_desc *medium = &s->media[s->desc.medium_count++];
    medium->name = name, medium->sigma_t = (float)sigma_t, medium->g = (float)g;
    medium->albedo[0] = medium->albedo[1] = medium->albedo[2] = (float)albedo;
    return medium;
}

STAGE_STATIC itn_surface_desc *stage_dielectric(stage *s, const char *name, double ior,
                                                double alpha) {
    itn_surface_desc *surface = &s->surfaces[s->desc.surface_count++];
    surface->name = name, surface->ior = (float)ior, surface->alpha = (float)alpha;
    return surface;
}

STAGE_STATIC itn_surface_desc *stage_diffuse(stage *s, const char *name, double reflectance) {
    itn_surface_desc *surface = &s->surfaces[s->desc.surface_count++];
    surface->name = name, surface->type = ITN_SURFACE_DIFFUSE;
    surface->reflectance[0] = surface->reflectance[1] = surface->reflectance[2] =
        (float)reflectance;
    return surface;
}

/* mesh NULL: a square of half size 3 at y = -1.2. */
STAGE_STATIC itn_object_desc *stage_object(stage *s, const itn_mesh *mesh, const char *medium,
                                           const char *surface) {
    itn_object_desc *object = &s->objects[s->desc.object_count++];
    object->mesh = mesh, object->medium = medium, object->surface = surface;
    if (!mesh) object->plane_y = -1.2f, object->half_size = 3;
    return object;
}

STAGE_STATIC itn_light_desc *stage_constant(stage *s, const char *name, double radiance) {
    itn_light_desc *light = &s->lights[s->desc.light_count++];
    light->name = name;
    light->radiance[0] = light->radiance[1] = light->radiance[2] = (float)radiance;
    return light;
}

STAGE_STATIC itn_light_desc *stage_map(stage *s, const char *name, const itn_image *image) {
    itn_light_desc *light = &s->lights[s->desc.light_count++];
    light->name = name, light->type = ITN_LIGHT_MAP, light->image = image;
    return light;
}

/* A plain sky whose radiance rises towards the sun. The numbers are not those of a real sky. */
STAGE_STATIC itn_light_desc *stage_sky(stage *s, const char *name) {
    static const float coefficients[9] = {-.6f, -.4f, 1, .5f, -2, .2f, .1f, 1, .5f};
    itn_light_desc *light = &s->lights[s->desc.light_count++];
    int c;
    light->name = name, light->type = ITN_LIGHT_SKY;
    for (c = 0; c < 3; c++) {
        memcpy(light->sky.coefficients[c], coefficients, sizeof coefficients);
        light->sky.radiance[c] = .5f + .2f * (float)c, light->sky.sun_radiance[c] = 300;
    }
    light->sun_direction.x = .5f, light->sun_direction.y = .7f, light->sun_direction.z = .6f;
    light->sun_radius_scale = 30;
    return light;
}

STAGE_STATIC void stage_need(itn_result result, const itn_error *error) {
    if (result == ITN_OK) return;
    printf("FAILED to set up a test: %s\n", error->message);
    exit(1);
}

STAGE_STATIC itn_scene *stage_make(const stage *s) {
    itn_scene *scene = NULL;
    itn_error error;
    stage_need(itn_scene_create(&s->desc, NULL, &scene, &error), &error);
    return scene;
}

/* A map of channels 1 or 3: a bright patch, centred at (u, v), on a dim ground. */
STAGE_STATIC itn_image stage_patch(int channels, double u, double v, double bright) {
    static const char *const names[3] = {"R", "G", "B"};
    itn_image image;
    itn_error error;
    int width = 16, height = 9, x, y, c;
    stage_need(itn_image_create(width, height, channels, NULL, &image, &error), &error);
    for (c = 0; c < channels; c++) {
        strcpy(image.names[c], channels == 1 ? "Y" : names[c]);
        for (y = 0; y < height; y++)
            for (x = 0; x < width; x++) {
                double du = (x + .5) / width - u, dv = y / (height - 1.) - v;
                image.pixels[(c * height + y) * width + x] =
                    (float)(.1 + .1 * c + bright * exp(-20 * (du * du + dv * dv)));
            }
    }
    return image;
}

/* A render that is refused gives back what its scene keeps of renders' memory. */
STAGE_STATIC void stage_give_back(const itn_scene *scene) {
    const int none = -1;
    itn_image image;
    CHECK(itn_render(scene, NULL, NULL, &none, 1, &image, NULL) == ITN_ERROR_ARGUMENT);
}

#endif
