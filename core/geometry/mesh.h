#pragma once
// Triangle meshes as arrays.

#include <array>
#include <cstdint>
#include <map>
#include <span>
#include <string>
#include <vector>

#include "base/roomy.h"
#include "base/transform.h"

namespace lajolla {

using Triangle = std::array<std::uint32_t, 3>;

// The place of a triangle in one of the faces from which its mesh was made.
struct FaceCoordinates {
    using Place = std::array<std::uint16_t, 2>; // from 0 to 65535 along the edges of the face

    std::uint32_t face;
    std::array<Place, 3> corners;

    static Place packed(float s, float t) { // of coordinates in [0, 1]
        return {static_cast<std::uint16_t>(s * 65535 + 0.5f), static_cast<std::uint16_t>(t * 65535 + 0.5f)};
    }
    static Vec2f unpacked(Place place) { return Vec2f(place[0], place[1]) * (1 / 65535.0f); }
};

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
    // Of each triangle, for meshes that keep their faces. Faces that are no quads count as one at each
    // corner.
    std::vector<FaceCoordinates> face_coordinates;
    std::uint32_t face_count = 0; // of all, also of those that `part_of` left out

    std::size_t bytes() const;
};

// Throws std::invalid_argument for an array of the wrong length, an invalid index or a non-finite position.
void validate(const Mesh &mesh);

Mesh transformed(const Mesh &mesh, const Transform &to_world);

// How much a face counts in the normal of a vertex: by the angle at its corner (Thürmer and Wüthrich 1998),
// by its area (Gouraud 1971), or by the sine of the angle over the lengths of both edges, which gives the
// normal of the sphere if all vertices around are on one (Max 1999, "Weights for Computing Vertex Normals
// from Facet Normals").
enum class NormalWeights { angle, area, max };
constexpr auto choices(NormalWeights) { return std::array{"angle", "area", "max"}; }

// Vertex normals for a mesh that has none: the weighted mean of adjacent face normals, computed after
// `to_world`. A later `transformed` with it yields these normals.
Mesh with_vertex_normals(const Mesh &mesh, const Transform &to_world,
                         NormalWeights weights = NormalWeights::angle);

// The same for a mesh whose vertices moved. Vertices at one of the `points` that had the same normal share
// one again; the others were on different sides of a hard edge.
Mesh with_normals_after_moving(Mesh moved, std::span<const std::uint32_t> points);

// A mesh of some consecutive triangles and their vertices.
Mesh part_of(const Mesh &mesh, std::size_t first_triangle, std::size_t count);

// The same where faces whose normals differ by more than `max_angle` (radians) keep a hard edge: their
// vertices are split.
Mesh with_smooth_normals(const Mesh &mesh, const Transform &to_world, float max_angle,
                         NormalWeights weights = NormalWeights::angle);

} // namespace lajolla
