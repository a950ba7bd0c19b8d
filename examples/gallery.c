/* Materials side by side, with their names: scenes/gallery.itn as scenes/gallery.png.

   You learn: where a point of the scene is in a picture.

   Compile: cc -O3 -march=native gallery.c -o gallery -lm -lpthread
   Run:     ./gallery [SPP]         (64 samples take 20 s on two cores) */
#define ITN_THREADS
#define ITN_IMPLEMENTATION
#include "../itn.h"
#include "sheet.h"

/* As in the scene file. */
static const double eye[3] = {0, 2.9, 9.5}, target[3] = {0, .95, 0}, fov = 36;

/* Pixel of a point: its parts across, up and ahead of the camera, in units of half the film. */
static void project(const double p[3], int width, int height, double *x, double *y) {
    double ahead[3], d[3], across, up, depth, length = 0;
    for (int i = 0; i < 3; i++) length += pow(target[i] - eye[i], 2);
    for (int i = 0; i < 3; i++) ahead[i] = (target[i] - eye[i]) / sqrt(length), d[i] = p[i] - eye[i];
    across = d[0]; /* the camera looks along -z, so x is to the right */
    depth = d[1] * ahead[1] + d[2] * ahead[2];
    up = d[1] * -ahead[2] + d[2] * ahead[1];
    length = depth * tan(fov / 2 * 3.14159265 / 180);
    *x = width / 2. * (1 + across / length), *y = height / 2. - width / 2. * up / length;
}

int main(int argc, char **argv) {
    static const char *const names[2][6] = {
        {"diffuse", "rough diffuse", "mirror", "conductor", "rough metal", "ward"},
        {"ashikhmin", "blend", "glass", "frosted", "bump map", "two lobes"}};
    itn_render_options options = ITN_ZERO;
    itn_scene *scene;
    itn_image image, page;
    itn_error error;
    options.spp = argc > 1 ? atoi(argv[1]) : 64;
    if (itn_scene_load("../scenes/gallery.itn", NULL, &scene, &error) ||
        itn_render(scene, NULL, &options, NULL, 0, &image, &error)) {
        fprintf(stderr, "%s\n", error.message);
        return 1;
    }
    sheet_box all = {0, 0, image.width, image.height};
    if (!sheet_make(&page, image.width, image.height)) return 1;
    sheet_picture(&page, all, image.pixels, 3, image.width, image.height, 1, 1.6);
    for (int row = 0; row < 2; row++)
        for (int k = 0; k < 6; k++) {
            double foot[3] = {k - 2.5, row ? .72 : -.02, row ? -.8 : 1.2}, x, y;
            project(foot, image.width, image.height, &x, &y);
            sheet_text(&page, x, y, 0, 7, SHEET_INK, names[row][k]);
        }
    if (itn_image_save_png(&page, 0, 3, ITN_PNG_TONE, 1, "../scenes/gallery.png", &error)) return 1;
    itn_image_free(&page), itn_image_free(&image), itn_scene_free(scene);
    return 0;
}
