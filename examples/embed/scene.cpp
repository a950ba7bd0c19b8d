// itn.h in C++: a class that owns a scene, with vectors, strings and exceptions.
//
// Compile: c++ -std=c++11 -O3 -march=native scene.cpp -o scene -lpthread
// Run:     ./scene ../../scenes/default.itn
// Prints:  the derivatives of the picture's mean, a line each; then an albedo that it recovers.
// The header compiles as C++, too; a project has ITN_IMPLEMENTATION in one file of its own.
#define ITN_THREADS
#define ITN_IMPLEMENTATION
#include "../../itn.h"

#include <cstdio>
#include <memory>
#include <stdexcept>
#include <string>
#include <vector>

namespace itn {

struct error : std::runtime_error {
    itn_result code;
    explicit error(const itn_error &e) : std::runtime_error(e.message), code(e.code) {}
};

// A picture and its derivatives by the parameters asked for; planes are [C][height][width].
struct picture {
    int width, height, channels;
    std::vector<float> light, variance;
    std::vector<std::vector<float> > derivatives;
};

class scene {
    struct freed {
        void operator()(itn_scene *s) const { itn_scene_free(s); }
    };
    std::unique_ptr<itn_scene, freed> handle; // so scenes move, and do not copy
    std::vector<float> values;

    static void need(itn_result result, const itn_error &e) {
        if (result != ITN_OK) throw error(e);
    }

public:
    explicit scene(const std::string &path) {
        itn_scene *made = nullptr;
        itn_error e;
        need(itn_scene_load(path.c_str(), nullptr, &made, &e), e);
        handle.reset(made);
        values.resize(static_cast<std::size_t>(itn_parameter_count(made)));
        itn_parameter_values(made, values.data());
    }
    std::vector<std::string> names() const {
        std::vector<std::string> all;
        for (int i = 0; i < itn_parameter_count(handle.get()); i++)
            all.push_back(itn_parameter_get(handle.get(), i)->name);
        return all;
    }
    int index(const std::string &name) const {
        int i = itn_parameter_find(handle.get(), name.c_str());
        if (i < 0) throw std::out_of_range("no parameter is called " + name);
        return i;
    }
    float &operator[](const std::string &name) { return values.at(std::size_t(index(name))); }

    picture render(const std::vector<std::string> &derivatives, int spp) const {
        std::vector<int> asked;
        for (const std::string &name : derivatives) asked.push_back(index(name));
        itn_render_options options = ITN_ZERO;
        itn_image image;
        itn_error e;
        options.spp = spp;
        need(itn_render(handle.get(), values.data(), &options, asked.data(),
                        static_cast<int>(asked.size()), &image, &e), e);
        std::unique_ptr<itn_image, void (*)(itn_image *)> owner(&image, itn_image_free);
        picture p = {image.width, image.height, itn_scene_film(handle.get()).channels, {}, {}, {}};
        std::size_t n = static_cast<std::size_t>(p.width) * static_cast<std::size_t>(p.height) *
                        static_cast<std::size_t>(p.channels);
        p.light.assign(image.pixels, image.pixels + n);
        p.variance.assign(image.pixels + n, image.pixels + 2 * n);
        for (std::size_t k = 1; k <= asked.size(); k++)
            p.derivatives.emplace_back(image.pixels + 2 * k * n, image.pixels + (2 * k + 1) * n);
        return p;
    }

    // Searches for parameters from the present values on, and leaves there what it finds.
    std::vector<itn_estimate> refine(const picture &target,
                                     const std::vector<std::string> &unknowns) {
        std::vector<int> sought;
        for (const std::string &name : unknowns) sought.push_back(index(name));
        std::vector<itn_estimate> estimates(sought.size());
        itn_refine_options options = ITN_ZERO;
        itn_error e;
        options.spp = 16, options.target_variance = target.variance.data();
        need(itn_refine(handle.get(), values.data(), target.light.data(), sought.data(),
                        static_cast<int>(sought.size()), &options, estimates.data(), &e), e);
        return estimates;
    }
};

} // namespace itn

int main(int argc, char **argv) {
    try {
        itn::scene scene(argc > 1 ? argv[1] : "../../scenes/default.itn");
        std::vector<std::string> names = scene.names();
        itn::picture picture = scene.render(names, 16);
        for (std::size_t k = 0; k < names.size(); k++) {
            double sum = 0;
            for (float d : picture.derivatives[k]) sum += d;
            std::printf("%-18s %g\n", names[k].c_str(), sum / double(picture.light.size()));
        }
        double truth = double(scene["milk.albedo"]);
        scene["milk.albedo"] = .8f;
        itn_estimate found = scene.refine(picture, {"milk.albedo"})[0];
        std::printf("albedo %.4f +- %.4f\n", found.value, found.standard_error);
        return std::fabs(found.value - truth) < 4 * found.standard_error ? 0 : 1;
    } catch (const std::exception &e) {
        std::fprintf(stderr, "%s\n", e.what());
        return 1;
    }
}
