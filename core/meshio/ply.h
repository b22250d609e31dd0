#pragma once

#include "meshio/mesh_data.h"

#include <cstddef>
#include <span>

namespace lajolla {

/// Reads a PLY file, ASCII or binary of either byte order. Vertices need x y z and may have nx ny nz, texture
/// coordinates (texture_u texture_v, s t or u v), colours (r g b or red green blue, giving "vertex_color")
/// and groups of 1 or 3 properties that share a prefix (w_0; tint_r tint_g tint_b; see Mitsuba 3's PLY
/// plugin), which become attributes. Integer colours are divided by the largest value of their type, and
/// decoded if `srgb_colors` is set. Faces are polygons (`element face`), with texture
/// coordinates of their corners if there is a list `texcoord`, or triangle strips (`element tristrips`).
/// Other properties and elements are skipped. The polygons are kept if asked for; triangle strips have none.
/// @throws MeshError
MeshData read_ply(std::span<const std::byte> file, bool srgb_colors = false, bool keep_polygons = false);

} // namespace lajolla
