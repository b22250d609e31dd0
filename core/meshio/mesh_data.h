#pragma once

#include "base/roomy.h"
#include "base/vec.h"

#include <array>
#include <cstdint>
#include <stdexcept>
#include <string>
#include <vector>

namespace lajolla {

/// A triangle mesh as it was found in a file. All values are finite and every index is below the vertex
/// count. Polygons have been cut into triangles; degenerate ones are kept. Strings are UTF-8.
struct MeshData {
    /// One named value per vertex or per triangle, named as Mitsuba 3 does: "vertex_..." or "face_...".
    struct Attribute {
        std::string name;
        int channels; // 1 or 3
        bool per_face;
        std::vector<float> values; // `channels` per vertex (or per triangle)
    };

    /// The triangles that use one material.
    struct Group {
        std::string material; // empty for triangles before the first `usemtl`
        uint32_t first_triangle;
        uint32_t triangle_count;
    };

    /// The polygons before they were cut, in the order of the file. Those with fewer than three corners are
    /// left out. A polygon of n corners is n - 2 consecutive triangles.
    struct Polygons {
        struct Crease {
            std::array<uint32_t, 2> points;
            float sharpness;
        };
        struct Corner {
            uint32_t point;
            float sharpness;
        };
        std::vector<uint32_t> sizes;
        std::vector<uint32_t> corners; // vertices
        std::vector<uint32_t> groups;  // of each polygon; empty if there are none
        std::vector<uint32_t> points;  // of each vertex, the position in the file: vertices may share one
        std::vector<Crease> creases;
        std::vector<Corner> sharp_corners;
    };

    using Triangle = std::array<uint32_t, 3>;

    RoomyVector<Vec3f> positions;
    RoomyVector<Vec3f> normals; // one per vertex, unit length; or empty
    RoomyVector<Vec2f> uvs;     // one per vertex, as in the file (v is not flipped); or empty
    RoomyVector<Triangle> triangles;
    std::vector<Attribute> attributes;
    std::vector<Group> groups;                   // contiguous, in the order of the triangles; OBJ only
    Polygons polygons;                           // if they were asked for
    std::vector<std::string> material_libraries; // `mtllib` names; OBJ only
    std::string name;                            // serialized version 4 only
    bool face_normals = false;                   // the file requests flat faces; serialized only
    bool mended = false; // concave polygons or missing values, of which other programs make something else
};

/// An error in a mesh file with its location: a line number for text, a byte offset for binary data.
class MeshError : public std::runtime_error {
public:
    using std::runtime_error::runtime_error;
};

/// Makes the promises of `MeshData` true for freshly read arrays whose indices are in range already: normals
/// become unit vectors (missing ones, stored as zero, become the area-weighted mean of the adjacent faces),
/// values that are not finite become zero, and positions of which no triangle is made that of another vertex.
/// @throws MeshError if a position is not finite and a triangle uses it.
void finish(MeshData &mesh);

} // namespace lajolla
