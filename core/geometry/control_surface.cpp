#include "geometry/control_surface.h"

#include <algorithm>
#include <stdexcept>
#include <string>
#include <unordered_map>

namespace lajolla {

namespace {

std::vector<float> crease_sharpness(const PolygonMesh &mesh) {
    std::unordered_map<std::uint64_t, float> creases;
    const auto key = [](std::uint64_t a, std::uint64_t b) { return std::min(a, b) << 32 | std::max(a, b); };
    for (const auto &[v, sharpness] : mesh.creases) creases[key(v[0], v[1])] = sharpness;
    std::vector<float> result;
    std::unordered_map<std::uint64_t, float> missing = creases;
    std::size_t first = 0;
    for (const std::uint32_t size : mesh.sizes) {
        for (std::uint32_t k = 0; k < size; ++k) {
            const std::uint64_t edge = key(mesh.corners[first + k], mesh.corners[first + (k + 1) % size]);
            const auto found = creases.find(edge);
            result.push_back(found == creases.end() ? 0 : std::min(found->second, infinitely_sharp));
            missing.erase(edge);
        }
        first += size;
    }
    for (const auto &[v, sharpness] : mesh.creases)
        if (missing.contains(key(v[0], v[1])))
            throw std::invalid_argument("a crease names the vertices " + std::to_string(v[0]) + " and " +
                                        std::to_string(v[1]) + ", which no edge joins");
    return result;
}

std::vector<float> corner_sharpness(const PolygonMesh &mesh) {
    std::vector<float> result(mesh.positions.size());
    for (const auto &[vertex, sharpness] : mesh.sharp_corners)
        result[vertex] = std::min(sharpness, infinitely_sharp);
    return result;
}

} // namespace

SubdivisionLevel control_surface(const PolygonMesh &mesh, SubdivisionBoundary boundary) {
    std::size_t width = 3;
    for (const auto &[name, attribute] : mesh.attributes)
        if (!attribute.per_face) width += attribute.channels;
    std::vector<double> values;
    values.reserve(width * mesh.positions.size());
    for (std::size_t v = 0; v < mesh.positions.size(); ++v) {
        const Vec3f p = mesh.positions[v];
        values.insert(values.end(), {p.x, p.y, p.z});
        for (const auto &[name, attribute] : mesh.attributes)
            if (!attribute.per_face)
                for (std::size_t c = 0; c < attribute.channels; ++c)
                    values.push_back(attribute.values[v * attribute.channels + c]);
    }
    std::vector<float> sharpness = crease_sharpness(mesh), corners = corner_sharpness(mesh);
    const SubdivisionLevel level(mesh.sizes, mesh.corners, sharpness, corners, {}, 0);
    for (std::uint32_t h = 0; h < level.half_edge_count(); ++h) {
        if (!level.is_boundary(h) || boundary == SubdivisionBoundary::smooth) continue;
        for (const std::uint32_t v : {level.start(h), level.start(level.next(h))})
            if (boundary == SubdivisionBoundary::pin_boundary || level.around(v).size() == 1)
                corners[v] = infinitely_sharp;
    }
    return {mesh.sizes, mesh.corners, std::move(sharpness), std::move(corners), std::move(values), width};
}

SubdivisionLevel control_uvs(const PolygonMesh &mesh) {
    std::vector<float> sharpness = crease_sharpness(mesh), corners(mesh.uvs.size());
    const std::vector<float> of_vertices = corner_sharpness(mesh);
    for (std::size_t h = 0; h < mesh.corners.size(); ++h)
        corners[mesh.uv_corners[h]] = of_vertices[mesh.corners[h]];
    std::vector<double> values;
    for (const Vec2f uv : mesh.uvs) values.insert(values.end(), {uv.x, uv.y});
    const SubdivisionLevel level(mesh.sizes, mesh.uv_corners, sharpness, corners, {}, 0);
    for (std::uint32_t h = 0; h < level.half_edge_count(); ++h)
        if (level.is_boundary(h))
            corners[level.start(h)] = corners[level.start(level.next(h))] = infinitely_sharp;
    return {mesh.sizes, mesh.uv_corners, std::move(sharpness), std::move(corners), std::move(values), 2};
}

} // namespace lajolla
