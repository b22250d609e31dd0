#pragma once
// Meshes of polygons as level 0 of their subdivision, with the sharpness of creases and borders.

#include "geometry/catmull_clark.h"
#include "geometry/subdivision.h"

namespace lajolla {

// Positions, followed by the attributes of vertices. Throws std::invalid_argument for a crease along no edge.
SubdivisionLevel control_surface(const PolygonMesh &mesh, SubdivisionBoundary boundary);

// Texture coordinates as a surface of their own, whose borders stay where they are. It has the same
// half-edges.
SubdivisionLevel control_uvs(const PolygonMesh &mesh);

} // namespace lajolla
