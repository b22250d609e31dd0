// The engine without Python: describes a small box with a light, renders it and writes a PFM file.

#include <cstdio>
#include <fstream>
#include <stdexcept>

#include "engine/accumulator.h"
#include "engine/build.h"
#include "geometry/mesh.h"

namespace {

using namespace lajolla;

// The matrix with these axes and this origin.
Value placed(const List &x, const List &y, const List &z, const List &at) {
    List rows;
    for (std::size_t i = 0; i < 3; ++i) rows.push_back(List{x[i], y[i], z[i], at[i]});
    rows.push_back(List{0, 0, 0, 1});
    return rows;
}

// A rectangle from -1 to 1 along x and y, that looks along z.
Value wall(Value to_world, int material, int emitter = -1) {
    return Dict{{"type", "rectangle"}, {"to_world", to_world}, {"material", material}, {"emitter", emitter}};
}

std::shared_ptr<const Mesh> pyramid() {
    auto mesh = std::make_shared<Mesh>();
    mesh->positions = {{-0.7f, -1, 0.1f}, {-0.1f, -1, 0.4f}, {-0.5f, -1, 0.8f}, {-0.4f, 0.2f, 0.4f}};
    mesh->triangles = {{0, 3, 1}, {1, 3, 2}, {2, 3, 0}};
    validate(*mesh);
    return mesh;
}

Dict box() {
    const List shapes{
        wall(placed({1, 0, 0}, {0, 0, -1}, {0, 1, 0}, {0, -1, 0}), 0),
        wall(placed({1, 0, 0}, {0, 0, 1}, {0, -1, 0}, {0, 1, 0}), 0),
        wall(placed({1, 0, 0}, {0, 1, 0}, {0, 0, 1}, {0, 0, -1}), 0),
        wall(placed({0, 0, -1}, {0, 1, 0}, {1, 0, 0}, {-1, 0, 0}), 1),
        wall(placed({0, 0, 1}, {0, 1, 0}, {-1, 0, 0}, {1, 0, 0}), 2),
        wall(placed({0.3, 0, 0}, {0, 0, 0.3}, {0, -1, 0}, {0, 0.99, 0}), 0, 0),
        Dict{{"type", "sphere"}, {"center", List{0.4, -0.6, -0.2}}, {"radius", 0.4}, {"material", 3}},
        Dict{{"type", "mesh"}, {"mesh", pyramid()}, {"material", 0}}};
    const Value camera = placed({-1, 0, 0}, {0, 1, 0}, {0, 0, -1}, {0, 0, 3.9});
    return {
        {"bsdfs", List{Dict{{"type", "diffuse"}, {"reflectance", 0.75}},
                       Dict{{"type", "diffuse"}, {"reflectance", List{0.6, 0.06, 0.05}}},
                       Dict{{"type", "diffuse"}, {"reflectance", List{0.1, 0.45, 0.08}}},
                       Dict{{"type", "dielectric"}}}},
        {"materials", List{Dict{{"front", 0}}, Dict{{"front", 1}}, Dict{{"front", 2}}, Dict{{"front", 3}}}},
        {"emitters", List{Dict{{"type", "area"}, {"radiance", List{18, 14, 8}}}}},
        {"shapes", shapes},
        {"sensor", Dict{{"type", "perspective"}, {"fov", 40}, {"to_world", camera}}},
        {"film", Dict{{"width", 64}, {"height", 64}}},
        {"integrator", Dict{{"type", "path"}, {"max_depth", 8}}}};
}

// PFM files begin with the lowest row; the scale is negative where bytes are in the order of this machine's.
void write_pfm(const char *path, const Accumulator &render) {
    std::ofstream file(path, std::ios::binary);
    const std::size_t row = 3 * render.width();
    file << "PF\n" << render.width() << ' ' << render.height() << "\n-1\n";
    const std::vector<float> image = render.image();
    for (std::size_t y = render.height(); y-- > 0;)
        file.write(reinterpret_cast<const char *>(&image[y * row]), static_cast<std::streamsize>(4 * row));
    if (!file.flush()) throw std::runtime_error(std::string("cannot write ") + path);
}

} // namespace

int main(int argc, char **argv) try {
    if (argc != 2) throw std::invalid_argument("usage: lajolla-core PICTURE.pfm");
    const auto scene = build_scene(box());
    Accumulator render(*scene);
    render.advance(16);
    write_pfm(argv[1], render);
    return 0;
} catch (const std::exception &error) {
    std::fprintf(stderr, "lajolla-core: %s\n", error.what());
    return 1;
}
