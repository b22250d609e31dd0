#pragma once

#include "meshio/mesh_data.h"

#include <cstddef>
#include <span>

namespace lajolla {

/// Reads a Wavefront OBJ file: `v` (with `x y z r g b` colours, which become "vertex_color"), `vt`, `vn`,
/// `f`, `usemtl`, `mtllib`; everything else is skipped. Every distinct (v, vt, vn) corner becomes one vertex;
/// corners without vt, in a file that has some, get (0, 0), those without vn a normal made from the faces.
/// @param keep_polygons also gives the polygons, with the tags `t crease 2/1/0 A B SHARPNESS` and
/// `t corner 1/1/0 A SHARPNESS` of subdivision surfaces, as OpenSubdiv writes them: vertices count from 0.
/// @param shape_index which of the runs of faces between `g` and `usemtl` lines to keep; -1 for all.
/// @throws MeshError
MeshData read_obj(std::span<const std::byte> file, int shape_index = -1, bool keep_polygons = false);

} // namespace lajolla
