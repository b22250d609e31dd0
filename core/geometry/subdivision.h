#pragma once
// Subdivision surfaces as triangle meshes: the limit surface of Catmull-Clark at the points of a grid on each
// face. Faces may have grids of different sizes: their common edges have the same points.

#include <array>
#include <cstdint>
#include <span>
#include <string>
#include <tuple>
#include <vector>

#include "geometry/polygons.h"

namespace lajolla {

// What the surface does where the mesh ends.
enum class SubdivisionBoundary { pin_corners, smooth, pin_boundary };
constexpr auto choices(SubdivisionBoundary) { return std::array{"pin_corners", "smooth", "pin_boundary"}; }

// How texture coordinates are subdivided: with the surface, but for their borders, or not at all.
enum class SubdivisionUvs { smooth, linear };
constexpr auto choices(SubdivisionUvs) { return std::array{"smooth", "linear"}; }

struct SubdivisionRules {
    SubdivisionBoundary boundary = SubdivisionBoundary::pin_corners;
    SubdivisionUvs uvs = SubdivisionUvs::smooth;
};

constexpr unsigned most_subdivision_levels = 12; // a grid on a face has as many squares as 16 bits count

struct SubdivisionSurface {
    Mesh mesh; // with normals and face coordinates; its triangles are ordered by group
    // Of each vertex, the point of the surface where it is. Vertices with different texture coordinates, or
    // on different sides of a crease, may share one.
    std::vector<std::uint32_t> points;
    std::vector<std::array<std::uint32_t, 3>> groups; // number, first triangle, number of triangles
    unsigned levels_dropped = 0;                      // everywhere, to stay within the number of triangles
};

// `levels` has one number for each corner: the edge that starts there is divided into 2^level pieces. Where
// neighbours differ, the larger one counts. A face with other than four corners is divided at least once.
// Throws std::invalid_argument for an invalid mesh.
SubdivisionSurface subdivide(const PolygonMesh &mesh, const SubdivisionRules &rules,
                             std::span<const std::uint8_t> levels, std::size_t most_triangles);

// The surface moved along its normals, by a distance for each vertex. Vertices at the same point move alike:
// by the mean of their distances, along the mean of their normals. Creases remain.
Mesh displaced(const Mesh &mesh, std::span<const std::uint32_t> points, std::span<const float> distances);

} // namespace lajolla
