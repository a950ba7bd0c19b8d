/* The suites that look inside the header, as one program, `build/suites NAME`: so the header is
   compiled once. A suite is a file test_NAME.c, which is a program of its own as well; its main is
   suite_NAME here. So no two of them may have a name at file scope in common. */
#define _XOPEN_SOURCE 700 /* mkdtemp, symlink */
#define ITN_THREADS
#define ITN_IMPLEMENTATION
#include "../itn.h"
#include "check.h"

#define main suite_fast
#include "test_fast.c"
#undef main
#define main suite_files
#include "test_files.c"
#undef main
#define main suite_geometry
#include "test_geometry.c"
#undef main
#define main suite_lanes
#include "test_lanes.c"
#undef main
#define main suite_light
#include "test_light.c"
#undef main
#define main suite_light_lanes
#include "test_light_lanes.c"
#undef main
#define main suite_maps
#include "test_maps.c"
#undef main
#define main suite_medium
#include "test_medium.c"
#undef main
#define main suite_net
#include "test_net.c"
#undef main
#define main suite_opaque
#include "test_opaque.c"
#undef main
#define main suite_refine
#include "test_refine.c"
#undef main
#define main suite_reuse
#include "test_reuse.c"
#undef main
#define main suite_scenefile
#include "test_scenefile.c"
#undef main
#define main suite_sobol
#include "test_sobol.c"
#undef main
#define main suite_spectral
#include "test_spectral.c"
#undef main
#define main suite_surface
#include "test_surface.c"
#undef main
#define main suite_texels
#include "test_texels.c"
#undef main
#define main suite_voxels
#include "test_voxels.c"
#undef main

#define SUITE(name) {#name, suite_##name}
int main(int count, char **words) {
    static const struct {
        const char *name;
        int (*run)(void);
    } suites[] = {
        SUITE(fast), SUITE(files), SUITE(geometry), SUITE(lanes), SUITE(light),
        SUITE(light_lanes), SUITE(maps), SUITE(medium), SUITE(net), SUITE(opaque), SUITE(refine),
        SUITE(reuse), SUITE(scenefile), SUITE(sobol), SUITE(spectral), SUITE(surface),
        SUITE(texels), SUITE(voxels)
    };
    size_t i;
    for (i = 0; count == 2 && i < sizeof suites / sizeof *suites; i++)
        if (!strcmp(words[1], suites[i].name)) return suites[i].run();
    printf("usage: suites NAME\n");
    return 2;
}
