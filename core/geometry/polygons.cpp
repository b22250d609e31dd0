#include "geometry/polygons.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <stdexcept>

namespace lajolla {

namespace {

void require(bool fits, const std::string &problem) {
    if (!fits) throw std::invalid_argument(problem);
}

bool is_finite(const Vec3f &p) { return std::isfinite(p.x) && std::isfinite(p.y) && std::isfinite(p.z); }

void check_face(const PolygonMesh &mesh, std::size_t face, std::size_t first) {
    const auto name = [&] { return "face " + std::to_string(face); };
    const std::uint32_t size = mesh.sizes[face];
    require(size >= 3, name() + " has fewer than three corners");
    for (std::size_t i = first; i < first + size; ++i) {
        const std::uint32_t vertex = mesh.corners[i];
        require(vertex < mesh.positions.size(), name() + " has the vertex " + std::to_string(vertex) +
                                                    ", which is beyond the mesh's " +
                                                    std::to_string(mesh.positions.size()) + " vertices");
        for (std::size_t k = first; k < i; ++k)
            if (mesh.corners[k] == vertex)
                throw std::invalid_argument(name() + " has the vertex " + std::to_string(vertex) + " twice");
    }
}

void check_sharpness(const PolygonMesh &mesh) {
    const auto check = [&](std::uint32_t vertex, float sharpness, const char *what) {
        require(vertex < mesh.positions.size(),
                std::string(what) + " names the vertex " + std::to_string(vertex) + ", which is not there");
        require(sharpness >= 0, std::string("the sharpness of ") + what + " must not be below 0");
    };
    for (const auto &[vertices, sharpness] : mesh.creases)
        for (const std::uint32_t vertex : vertices) check(vertex, sharpness, "a crease");
    for (const auto &[vertex, sharpness] : mesh.sharp_corners) check(vertex, sharpness, "a sharp corner");
}

} // namespace

void validate(const PolygonMesh &mesh) {
    const std::size_t total = std::accumulate(mesh.sizes.begin(), mesh.sizes.end(), std::size_t{0});
    require(total == mesh.corners.size(), "the sizes of the faces do not add up to the number of corners");
    require(total < std::numeric_limits<std::int32_t>::max(), "the mesh has more than 2^31 corners");
    std::size_t first = 0;
    for (std::size_t face = 0; face < mesh.sizes.size(); first += mesh.sizes[face], ++face)
        check_face(mesh, face, first);
    for (std::size_t i = 0; i < mesh.positions.size(); ++i)
        require(is_finite(mesh.positions[i]), "vertex " + std::to_string(i) + " is not finite");
    require(mesh.uvs.empty() ? mesh.uv_corners.empty() : mesh.uv_corners.size() == total,
            "a mesh needs one uv per corner, or none");
    for (const std::uint32_t uv : mesh.uv_corners)
        require(uv < mesh.uvs.size(), "a corner names a uv that is not there");
    require(mesh.groups.empty() || mesh.groups.size() == mesh.sizes.size(),
            "a mesh needs one group per face");
    for (const auto &[name, attribute] : mesh.attributes) {
        const std::size_t elements = attribute.per_face ? mesh.sizes.size() : mesh.positions.size();
        require(attribute.values.size() == elements * attribute.channels,
                "attribute '" + name + "' has the wrong length");
    }
    check_sharpness(mesh);
}

std::vector<std::uint32_t> first_quads(const PolygonMesh &mesh) {
    std::vector<std::uint32_t> result{0};
    for (const std::uint32_t size : mesh.sizes) result.push_back(result.back() + (size == 4 ? 1 : size));
    return result;
}

} // namespace lajolla
