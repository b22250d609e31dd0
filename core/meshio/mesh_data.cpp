#include "meshio/mesh_data.h"

#include <array>
#include <cmath>
#include <span>

namespace lajolla {
namespace {

using Vector = std::array<double, 3>;

Vector load(std::span<const float> values, size_t index) {
    return {values[3 * index], values[3 * index + 1], values[3 * index + 2]};
}

void store(std::span<float> values, size_t index, const Vector &v) {
    for (size_t axis = 0; axis < 3; ++axis) values[3 * index + axis] = static_cast<float>(v[axis]);
}

/// In double precision, so that neither tiny nor huge vectors lose their direction.
bool normalize(Vector &v) {
    double length = std::hypot(v[0], v[1], v[2]);
    if (!(length > 0) || !std::isfinite(length)) return false;
    for (double &component : v) component /= length;
    return true;
}

/// Twice the area times the normal.
Vector scaled_normal(const Vector &a, const Vector &b, const Vector &c) {
    Vector e{b[0] - a[0], b[1] - a[1], b[2] - a[2]};
    Vector f{c[0] - a[0], c[1] - a[1], c[2] - a[2]};
    return {e[1] * f[2] - e[2] * f[1], e[2] * f[0] - e[0] * f[2], e[0] * f[1] - e[1] * f[0]};
}

std::vector<Vector> area_weighted_normals(const MeshData &mesh) {
    std::vector<Vector> sums(mesh.positions.size() / 3, Vector{});
    for (size_t i = 0; i < mesh.indices.size(); i += 3) {
        const uint32_t *corner = &mesh.indices[i];
        Vector n = scaled_normal(load(mesh.positions, corner[0]), load(mesh.positions, corner[1]),
                                 load(mesh.positions, corner[2]));
        for (int k = 0; k < 3; ++k)
            for (size_t axis = 0; axis < 3; ++axis) sums[corner[k]][axis] += n[axis];
    }
    return sums;
}

void complete_normals(MeshData &mesh) {
    std::vector<size_t> missing;
    for (size_t vertex = 0; vertex < mesh.normals.size() / 3; ++vertex) {
        Vector n = load(mesh.normals, vertex);
        if (normalize(n)) store(mesh.normals, vertex, n);
        else missing.push_back(vertex);
    }
    if (missing.empty()) return;
    std::vector<Vector> sums = area_weighted_normals(mesh);
    for (size_t vertex : missing) {
        if (!normalize(sums[vertex]))
            sums[vertex] = {0, 0, 1}; // only degenerate triangles touch it: any direction will do
        store(mesh.normals, vertex, sums[vertex]);
    }
}

void clear_nonfinite(std::vector<float> &values) {
    for (float &value : values)
        if (!std::isfinite(value)) value = 0;
}

} // namespace

void finish(MeshData &mesh) {
    for (size_t i = 0; i < mesh.positions.size(); ++i)
        if (!std::isfinite(mesh.positions[i]))
            throw MeshError("the position of vertex " + std::to_string(i / 3) + " is not finite");
    clear_nonfinite(mesh.uvs);
    for (MeshData::Attribute &attribute : mesh.attributes) clear_nonfinite(attribute.values);
    complete_normals(mesh);
}

} // namespace lajolla
