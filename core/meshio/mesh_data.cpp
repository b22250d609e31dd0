#include "meshio/mesh_data.h"

#include <cmath>
#include <optional>

namespace lajolla {
namespace {

/// In double precision, so that neither tiny nor huge vectors lose their direction.
struct Vector {
    double x = 0, y = 0, z = 0;
    Vector() = default;
    explicit Vector(const Vec3f &v) : x(v.x), y(v.y), z(v.z) {}
};

/// The unit vector, or nothing where there is no direction.
std::optional<Vec3f> unit(const Vector &v) {
    double length = std::sqrt(v.x * v.x + v.y * v.y + v.z * v.z);
    if (!(length > 0) || !std::isfinite(length)) return std::nullopt;
    if (std::abs(length - 1) < 2e-7) length = 1; // as near as float32 comes: what was written once stays
    return Vec3f(static_cast<float>(v.x / length), static_cast<float>(v.y / length),
                 static_cast<float>(v.z / length));
}

/// Adds twice the area times the normal.
void add_scaled_normal(Vector &sum, const Vector &a, const Vector &b, const Vector &c) {
    double ex = b.x - a.x, ey = b.y - a.y, ez = b.z - a.z;
    double fx = c.x - a.x, fy = c.y - a.y, fz = c.z - a.z;
    sum.x += ey * fz - ez * fy;
    sum.y += ez * fx - ex * fz;
    sum.z += ex * fy - ey * fx;
}

std::vector<Vector> area_weighted_normals(const MeshData &mesh) {
    std::vector<Vector> sums(mesh.positions.size());
    for (const MeshData::Triangle &t : mesh.triangles)
        for (uint32_t vertex : t)
            add_scaled_normal(sums[vertex], Vector(mesh.positions[t[0]]), Vector(mesh.positions[t[1]]),
                              Vector(mesh.positions[t[2]]));
    return sums;
}

void complete_normals(MeshData &mesh) {
    std::vector<size_t> missing;
    for (size_t vertex = 0; vertex < mesh.normals.size(); ++vertex) {
        if (std::optional<Vec3f> n = unit(Vector(mesh.normals[vertex]))) mesh.normals[vertex] = *n;
        else missing.push_back(vertex);
    }
    if (missing.empty()) return;
    mesh.mended = true;
    std::vector<Vector> sums = area_weighted_normals(mesh);
    for (size_t vertex : missing) // where only degenerate triangles touch it, any direction will do
        mesh.normals[vertex] = unit(sums[vertex]).value_or(Vec3f(0, 0, 1));
}

bool is_finite(const Vec3f &p) { return std::isfinite(p.x) && std::isfinite(p.y) && std::isfinite(p.z); }

/// Vertices that nothing uses go where another one is, so that the mesh keeps its bounds.
void complete_positions(MeshData &mesh) {
    std::vector<size_t> missing;
    for (size_t vertex = 0; vertex < mesh.positions.size(); ++vertex)
        if (!is_finite(mesh.positions[vertex])) missing.push_back(vertex);
    if (missing.empty()) return;
    mesh.mended = true;
    for (const MeshData::Triangle &t : mesh.triangles)
        for (uint32_t vertex : t)
            if (!is_finite(mesh.positions[vertex]))
                throw MeshError("the position of vertex " + std::to_string(vertex) + " is not finite");
    const Vec3f elsewhere = mesh.triangles.empty() ? Vec3f(0) : mesh.positions[mesh.triangles[0][0]];
    for (size_t vertex : missing) mesh.positions[vertex] = elsewhere;
}

void make_finite(float &value, bool &mended) {
    if (std::isfinite(value)) return;
    value = 0;
    mended = true;
}

} // namespace

void finish(MeshData &mesh) {
    complete_positions(mesh);
    for (Vec2f &uv : mesh.uvs) make_finite(uv.x, mesh.mended), make_finite(uv.y, mesh.mended);
    for (MeshData::Attribute &attribute : mesh.attributes)
        for (float &value : attribute.values) make_finite(value, mesh.mended);
    complete_normals(mesh);
}

} // namespace lajolla
