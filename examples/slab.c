/* A slab of milk, rendered and differentiated: a scene, a walk and its derivatives in one screen.

   You learn: scene desc, render with derivatives, and what comes back, each with a standard error.

   Compile: cc -O3 -march=native slab.c -o slab -lm
   Prints:  Y                0.7583 +- 0.0001      (exact: 0.75836)
            d_milk_sigma_t.Y -0.1234 +- 0.0001     (exact: -0.12345)
            d_milk_albedo.Y  1.9324 +- 0.0005      (exact: 1.93253)
            d_milk_g.Y       0.1822 +- 0.0006      (exact: 0.18206)
   and fails if a value lies more than four standard errors from the exact one. */
#define ITN_IMPLEMENTATION
#include "../itn.h"

int main(void) {
    static int faces[36] = {0, 2, 1, 1, 2, 3, 4, 5, 6, 5, 7, 6, 0, 1, 4, 1, 5, 4,
                            2, 6, 3, 3, 6, 7, 0, 4, 2, 2, 4, 6, 1, 3, 5, 3, 7, 5};
    static const double exact[4] = {.7583555, -.123454, .46833 + 1.4642, .18206};
    float corners[24];
    int i, bad = 0, asked[3] = {0, 1, 2}; /* milk.sigma_t, milk.albedo, milk.g */
    itn_mesh slab = ITN_ZERO;
    itn_medium_desc milk = ITN_ZERO;
    itn_object_desc object = ITN_ZERO;
    itn_light_desc light = ITN_ZERO;
    itn_scene_desc desc = ITN_ZERO;
    itn_render_options options = ITN_ZERO;
    itn_scene *scene;
    itn_image image;
    for (i = 0; i < 24; i++) /* corner i/3 has its bits as signs: 1000 x 1000 x 1 */
        corners[i] = (i % 3 == 2 ? .5f : 500.f) * (((i / 3) >> (i % 3)) & 1 ? 1.f : -1.f);
    slab.positions = corners, slab.vertex_count = 8;
    slab.triangles = faces, slab.triangle_count = 12;
    milk.name = "milk", milk.sigma_t = 2, milk.albedo[0] = .9f, milk.g = .75f;
    object.mesh = &slab, object.medium = "milk", light.radiance[0] = 1;
    desc.film.width = desc.film.height = 1, desc.camera.eye.z = 10, desc.camera.fov = .001f;
    desc.media = &milk, desc.objects = &object, desc.lights = &light;
    desc.medium_count = desc.object_count = desc.light_count = 1, options.spp = 400000;
    if (itn_scene_create(&desc, NULL, &scene, NULL)) return 1;
    if (itn_render(scene, NULL, &options, asked, 3, &image, NULL)) return 1;
    for (i = 0; i < 4; i++) { /* planes of one pixel: mean, variance, mean, variance... */
        double value = image.pixels[2 * i], error = sqrt(image.pixels[2 * i + 1]);
        printf("%-16s %.4f +- %.4f\n", image.names[2 * i], value, error);
        bad += !(fabs(value - exact[i]) <= 4 * error);
    }
    itn_image_free(&image);
    itn_scene_free(scene);
    return bad;
}
