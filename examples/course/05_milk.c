/* 5. Milk in a box.

   Now all of it together, by the library: a box of milk on a table in the sun. A scene is a few
   lines of text (or the same as structs of C, see ../slab.c); here the text is in memory, and so
   is the box, as eight corners and six squares in the words of an OBJ file (course.h). Whole milk
   scatters mu_s' = 3.21 times per mm and absorbs mu_a = .0011, .0024, .014 times of red, green
   and blue (Jensen, Marschner, Levoy and Hanrahan 2001): sigma_t is their sum, albedo the share
   of mu_s'. The box is 20 mm wide.

   Look at: edges that glow, where light has little way through, and are a little warmer.
   Check:   where nothing is absorbed and light is the same from everywhere, even a box that
   refracts cannot be seen: what is lost to one direction comes back from another (a white
   furnace).
   Exercise: skimmed milk has mu_s' = 1.22 and mu_a = .0014, .0025, .0142: show it beside.
   (Solution: compile with -DSOLUTION.)

   Compile: cc -O2 -march=native 05_milk.c -o 05_milk -lm -lpthread */
#define ITN_IMPLEMENTATION
#include "course.h"

/* Makes the scene of a text that goes on with `rest`. */
static itn_scene *make(int width, const char *medium, const char *rest) {
    char text[2000];
    itn_file box = {"box.obj", BOX, sizeof BOX - 1};
    itn_scene *scene;
    itn_error error;
    int size = snprintf(text, sizeof text,
                        "film   width %d height %d channels 3\n"
                        "camera eye 38 44 62  target 0 8 0  fov 26\n"
                        "medium milk %s\n%s\n", width, width, medium, rest);
    need(itn_scene_from_memory(text, (size_t)size, NULL, &box, 1, NULL, &scene, &error), &error);
    return scene;
}

static itn_image render(const itn_scene *scene, int spp) {
    itn_render_options options = ITN_ZERO;
    itn_image image;
    itn_error error;
    options.spp = spp;
    need(itn_render(scene, NULL, &options, NULL, 0, &image, &error), &error);
    return image;
}

int main(void) {
    static const char table[] = "surface table type diffuse reflectance .3 .22 .16\n"
                                "object  mesh box.obj medium milk scale 20\n"
                                "object  plane surface table y -.01 half 300\n"
                                "light   sky ../../scenes/t3-e60.sky sun .5 .8 -.35";
    static const char white[] = "surface skin type dielectric ior 1.35\n"
                                "object  mesh box.obj medium milk surface skin scale 20\n"
                                "light   constant radiance 1 1 1";
    static const char *const media[] = {"sigma_t 3.215 albedo .99966 .99925 .99565",
                                        "sigma_t 1.225 albedo .99886 .99796 .98841"};
    int kinds = 1;
#ifdef SOLUTION
    kinds = 2;
#endif
    itn_image page = new_page(kinds);
    for (int k = 0; k < kinds; k++) {
        itn_scene *scene = make(150, media[k], table);
        itn_image image = render(scene, 8);
        show(&page, k, image.pixels, 150, 150, 3, 55, k ? "skimmed milk" : "whole milk");
        itn_image_free(&image), itn_scene_free(scene);
    }
    save_page(&page, "05_milk.png");

    itn_scene *furnace = make(16, "sigma_t .2 albedo 1 g 0", white);
    itn_image image = render(furnace, 64);
    double sum = 0, variance = 0;
    for (int i = 0; i < 256; i++) sum += image.pixels[i] / 256.;
    for (int i = 0; i < 256; i++) variance += image.pixels[3 * 256 + i] / 65536.;
    check("what is seen in a white furnace", sum, 1, 4 * sqrt(variance) + 1e-4);
    itn_image_free(&image), itn_scene_free(furnace);
    return wrong;
}
