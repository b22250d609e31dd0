#pragma once
// Triangle meshes as arrays.

#include <array>
#include <cstdint>
#include <map>
#include <string>
#include <vector>

#include "base/roomy.h"
#include "base/transform.h"

namespace lajolla {

using Triangle = std::array<std::uint32_t, 3>;

struct Mesh {
    struct Attribute {
        std::uint32_t channels;
        bool per_face;
        std::vector<float> values;
    };

    RoomyVector<Vec3f> positions;
    RoomyVector<Vec3f> normals; // unit length, one per vertex, or none: then faces are flat
    RoomyVector<Vec2f> uvs;     // one per vertex, or none
    RoomyVector<Triangle> triangles;
    std::map<std::string, Attribute> attributes;

    std::size_t bytes() const;
};

// Throws std::invalid_argument for an array of the wrong length, an invalid index or a non-finite position.
void validate(const Mesh &mesh);

Mesh transformed(const Mesh &mesh, const Transform &to_world);

// Vertex normals for a mesh that has none: the mean of adjacent face normals, weighted by the angle at the
// corner, computed after `to_world`. A later `transformed` with it yields these normals.
Mesh with_vertex_normals(const Mesh &mesh, const Transform &to_world);

// A mesh of some consecutive triangles and their vertices.
Mesh part_of(const Mesh &mesh, std::size_t first_triangle, std::size_t count);

// Vertex normals weighted by the angle at each corner (Thürmer and Wüthrich 1998; compared with others in Max
// 1999, "Weights for Computing Vertex Normals from Facet Normals"). Faces whose normals differ by more than
// `max_angle` (radians) keep a hard edge: their vertices are split.
Mesh with_smooth_normals(const Mesh &mesh, float max_angle);

} // namespace lajolla
