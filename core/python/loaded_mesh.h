#pragma once
// Meshes with what only their files knew.

#include <cstdint>
#include <memory>
#include <string>
#include <tuple>
#include <vector>

#include "geometry/polygons.h"
#include "meshio/mesh_data.h"
#include "python/arrays.h"

namespace lajolla {

struct LoadedMesh : Mesh {
    std::vector<std::tuple<std::string, std::uint32_t, std::uint32_t>> groups;
    std::vector<std::string> material_libraries;
    bool face_normals = false, mended = false;
    bool computed_normals = false;               // by `with_vertex_normals`, and not the file's
    std::shared_ptr<const PolygonMesh> polygons; // before they were cut, if they were asked for
};

// A NumPy view of memory that `owner` keeps alive.
template <class T>
nb::object view(nb::handle owner, const T *data, std::initializer_list<std::size_t> shape) {
    return nb::cast(nb::ndarray<nb::numpy, const T>(data, shape, owner), nb::rv_policy::reference);
}

// Gives a mesh its polygons, and its triangles their places in them.
void keep_polygons(LoadedMesh &mesh, const MeshData::Polygons &polygons);

// Adds what meshes of polygons can do to the class of meshes.
void bind_polygons(nb::module_ &m, nb::class_<LoadedMesh, Mesh> &mesh);

} // namespace lajolla
