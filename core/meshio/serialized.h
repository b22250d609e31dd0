#pragma once

#include "meshio/mesh_data.h"

#include <cstddef>
#include <span>

namespace lajolla {

/// Reads mesh number `shape_index` (from 0) of a file in the `.serialized` format of Mitsuba 0.x, version 3
/// or 4. Vertex colours become "vertex_color"; normals are dropped if the mesh asks for face normals.
/// @throws MeshError
MeshData read_serialized(std::span<const std::byte> file, int shape_index);

} // namespace lajolla
