#pragma once
// Meshes of polygons, as modelling programs make them, before they become triangles.

#include <array>
#include <cstdint>
#include <map>
#include <string>
#include <vector>

#include "geometry/mesh.h"

namespace lajolla {

struct PolygonMesh {
    struct Crease {
        std::array<std::uint32_t, 2> vertices;
        float sharpness;
    };
    struct Corner {
        std::uint32_t vertex;
        float sharpness;
    };

    std::vector<Vec3f> positions;
    std::vector<std::uint32_t> sizes;   // of the faces
    std::vector<std::uint32_t> corners; // the vertex at each corner of each face
    std::vector<Vec2f> uvs;
    std::vector<std::uint32_t> uv_corners; // the uv at each corner; none if there are no uvs
    std::vector<std::uint32_t> groups;     // of each face, which part of the mesh it belongs to; or none
    std::map<std::string, Mesh::Attribute> attributes;
    std::vector<Crease> creases;
    std::vector<Corner> sharp_corners;
};

// Throws std::invalid_argument for an array of the wrong length, an invalid index, a face that is no polygon
// or a number that is not finite.
void validate(const PolygonMesh &mesh);

// The number of the first quad of each face, and at the end the number of all. A face with four corners is
// one quad, any other face has one for each corner, as in Ptex.
std::vector<std::uint32_t> first_quads(const PolygonMesh &mesh);

} // namespace lajolla
