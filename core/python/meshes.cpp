#include "python/bindings.h"

#include <filesystem>
#include <fstream>

#include <nanobind/ndarray.h>
#include <nanobind/stl/array.h>
#include <nanobind/stl/filesystem.h>
#include <nanobind/stl/map.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/shared_ptr.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/vector.h>

#include "geometry/curves.h"
#include "geometry/mesh.h"
#include "images/image.h"
#include "meshio/obj.h"
#include "meshio/ply.h"
#include "meshio/serialized.h"
#include "python/loaded_mesh.h"
#include "python/values.h"

namespace lajolla {

namespace {

using namespace nb::literals;

template <std::size_t N, class Elements, class T>
void assign(Elements &elements, const Rows<N, T> &table) {
    using Element = typename Elements::value_type;
    static_assert(sizeof(Element) == N * sizeof(T));
    const auto *first = reinterpret_cast<const Element *>(table.data());
    elements.assign(first, first + table.shape(0));
}

// A NumPy view of elements that each consist of N numbers.
template <class T, std::size_t N, class Elements>
nb::object rows_of(nb::handle owner, const Elements &elements) {
    static_assert(sizeof(elements[0]) == N * sizeof(T));
    return view(owner, reinterpret_cast<const T *>(elements.data()), {elements.size(), N});
}
template <class T, std::size_t N, class Elements>
nb::object rows_or_none(nb::handle owner, const Elements &elements) {
    return elements.empty() ? nb::none() : rows_of<T, N>(owner, elements);
}

// Values per vertex, or per face if the name begins with "face_".
using Attributes =
    std::map<std::string, nb::ndarray<const float, nb::ndim<2>, nb::c_contig, nb::device::cpu>>;

std::shared_ptr<LoadedMesh> make_mesh(const Rows<3> &vertices, const Rows<3, std::uint32_t> &faces,
                                      const std::optional<Rows<3>> &normals,
                                      const std::optional<Rows<2>> &uvs, const Attributes &attributes) {
    auto mesh = std::make_shared<LoadedMesh>();
    assign<3>(mesh->positions, vertices);
    assign<3>(mesh->triangles, faces);
    if (normals) assign<3>(mesh->normals, *normals);
    if (uvs) assign<2>(mesh->uvs, *uvs);
    for (const auto &[name, values] : attributes)
        mesh->attributes[name] = {static_cast<std::uint32_t>(values.shape(1)),
                                  name.starts_with("face_"),
                                  {values.data(), values.data() + values.size()}};
    validate(*mesh);
    return mesh;
}

std::shared_ptr<LoadedMesh> from_file(MeshData data, bool flip_uvs) {
    auto mesh = std::make_shared<LoadedMesh>();
    mesh->positions = std::move(data.positions);
    mesh->normals = std::move(data.normals);
    mesh->uvs = std::move(data.uvs);
    mesh->triangles = std::move(data.triangles);
    if (flip_uvs)
        for (Vec2f &uv : mesh->uvs) uv.y = 1 - uv.y;
    for (auto &attribute : data.attributes)
        mesh->attributes[attribute.name] = {static_cast<std::uint32_t>(attribute.channels),
                                            attribute.per_face, std::move(attribute.values)};
    for (const auto &group : data.groups)
        mesh->groups.emplace_back(group.material, group.first_triangle, group.triangle_count);
    mesh->material_libraries = std::move(data.material_libraries);
    mesh->face_normals = data.face_normals;
    mesh->mended = data.mended;
    keep_polygons(*mesh, data.polygons);
    return mesh;
}

struct FileContents {
    std::unique_ptr<std::byte[]> data;
    std::size_t size;
    std::span<const std::byte> bytes() const { return {data.get(), size}; }
};

FileContents read_file(const std::filesystem::path &path) {
    if (!std::filesystem::is_regular_file(path)) throw MeshError("not a file that can be read");
    std::ifstream file(path, std::ios::binary | std::ios::ate);
    const std::streamoff size = file ? static_cast<std::streamoff>(file.tellg()) : -1;
    if (size < 0) throw MeshError("cannot read the file");
    FileContents contents{std::make_unique_for_overwrite<std::byte[]>(static_cast<std::size_t>(size)),
                          static_cast<std::size_t>(size)};
    file.seekg(0);
    if (!file.read(reinterpret_cast<char *>(contents.data.get()), size))
        throw MeshError("cannot read the file");
    return contents;
}

nb::dict attributes(nb::handle self) {
    nb::dict result;
    for (const auto &[name, attribute] : nb::cast<const LoadedMesh &>(self).attributes)
        result[name.c_str()] = view(self, attribute.values.data(),
                                    {attribute.values.size() / attribute.channels, attribute.channels});
    return result;
}

// The same file's mesh with other vertices; its triangles keep their order.
std::shared_ptr<LoadedMesh> changed(const LoadedMesh &mesh, Mesh arrays) {
    auto result = std::make_shared<LoadedMesh>();
    static_cast<Mesh &>(*result) = std::move(arrays);
    result->groups = mesh.groups;
    result->material_libraries = mesh.material_libraries;
    result->face_normals = mesh.face_normals;
    result->mended = mesh.mended;
    return result;
}

NormalWeights weights_called(nb::handle name) {
    NormalWeights result{};
    read_value(name, result, "weights");
    return result;
}

std::shared_ptr<LoadedMesh> smoothed(const LoadedMesh &mesh, nb::handle to_world, float max_angle_degrees,
                                     nb::handle weights) {
    Transform matrix;
    read_value(to_world, matrix, "to_world");
    const float max_angle = max_angle_degrees * pi / 180;
    return changed(mesh, with_smooth_normals(mesh, matrix, max_angle, weights_called(weights)));
}

std::shared_ptr<LoadedMesh> with_normals(const LoadedMesh &mesh, nb::handle to_world, nb::handle weights) {
    Transform matrix;
    read_value(to_world, matrix, "to_world");
    const auto result = changed(mesh, with_vertex_normals(mesh, matrix, weights_called(weights)));
    result->computed_normals = true;
    return result;
}

std::shared_ptr<LoadedMesh> part(const LoadedMesh &mesh, std::size_t first, std::size_t count) {
    if (first > mesh.triangles.size() || count > mesh.triangles.size() - first)
        throw nb::index_error("there are not that many faces");
    auto result = std::make_shared<LoadedMesh>();
    static_cast<Mesh &>(*result) = part_of(mesh, first, count);
    result->computed_normals = mesh.computed_normals;
    return result;
}

using MeshArrays =
    std::tuple<Rows<3>, Rows<3, std::uint32_t>, std::optional<Rows<3>>, std::optional<Rows<2>>>;
using AttributeState = std::tuple<bool, nb::ndarray<const float, nb::ndim<2>, nb::c_contig, nb::device::cpu>>;
using MeshState = std::tuple<MeshArrays, std::map<std::string, AttributeState>, decltype(LoadedMesh::groups),
                             decltype(LoadedMesh::material_libraries), bool, bool, bool>;

nb::tuple mesh_state(nb::handle self) {
    const auto &mesh = nb::cast<const LoadedMesh &>(self);
    const nb::dict values = attributes(self);
    nb::dict attribute_states;
    for (const auto &[name, attribute] : mesh.attributes)
        attribute_states[name.c_str()] = nb::make_tuple(attribute.per_face, values[name.c_str()]);
    const nb::tuple arrays = nb::make_tuple(
        rows_of<float, 3>(self, mesh.positions), rows_of<std::uint32_t, 3>(self, mesh.triangles),
        rows_or_none<float, 3>(self, mesh.normals), rows_or_none<float, 2>(self, mesh.uvs));
    const nb::tuple state = nb::make_tuple(arrays, attribute_states, mesh.groups, mesh.material_libraries,
                                           mesh.face_normals, mesh.mended, mesh.computed_normals);
    if (mesh.face_coordinates.empty()) return state;
    constexpr std::size_t numbers = sizeof(FaceCoordinates) / sizeof(std::uint32_t);
    return nb::make_tuple(state, rows_of<std::uint32_t, numbers>(self, mesh.face_coordinates),
                          mesh.face_count);
}

using MeshOfFacesState =
    std::tuple<MeshState, Rows<sizeof(FaceCoordinates) / sizeof(std::uint32_t), std::uint32_t>,
               std::uint32_t>;

void restore_mesh(LoadedMesh &mesh, const MeshState &state) {
    const auto &[arrays, attribute_states, groups, material_libraries, face_normals, mended, computed] =
        state;
    const auto made = std::apply([](const auto &...a) { return make_mesh(a..., {}); }, arrays);
    for (const auto &[name, attribute] : attribute_states) {
        const auto &[per_face, values] = attribute;
        made->attributes[name] = {static_cast<std::uint32_t>(values.shape(1)),
                                  per_face,
                                  {values.data(), values.data() + values.size()}};
    }
    validate(*made);
    made->groups = groups;
    made->material_libraries = material_libraries;
    made->face_normals = face_normals;
    made->mended = mended;
    made->computed_normals = computed;
    new (&mesh) LoadedMesh(std::move(*made));
}

void restore_mesh_of_faces(LoadedMesh &mesh, const MeshOfFacesState &state) {
    const auto &[basic, coordinates, face_count] = state;
    restore_mesh(mesh, basic);
    const auto *first = reinterpret_cast<const FaceCoordinates *>(coordinates.data());
    mesh.face_coordinates.assign(first, first + coordinates.shape(0));
    mesh.face_count = face_count;
    validate(mesh);
}

using Indices = nb::ndarray<const std::uint32_t, nb::ndim<1>, nb::c_contig, nb::device::cpu>;

std::shared_ptr<CurveSet> make_curves(const Rows<4> &points, const Indices &segments) {
    auto curves = std::make_shared<CurveSet>();
    assign<4>(curves->points, points);
    curves->segments.assign(segments.data(), segments.data() + segments.size());
    return curves;
}

using Pixels = nb::ndarray<nb::ro, nb::c_contig, nb::device::cpu>;

std::shared_ptr<Image> make_image(const Pixels &pixels, bool srgb) {
    const std::size_t channels = pixels.ndim() == 3 ? pixels.shape(2) : 1;
    if ((pixels.ndim() != 2 && pixels.ndim() != 3) || pixels.size() == 0 || (channels != 1 && channels != 3))
        throw std::invalid_argument(
            "pixels must have the shape (height, width), (height, width, 1) or (height, width, 3)");
    const auto image_of = [&]<class T>(const T *values) {
        return std::make_shared<Image>(static_cast<std::uint32_t>(pixels.shape(1)),
                                       static_cast<std::uint32_t>(pixels.shape(0)),
                                       static_cast<std::uint32_t>(channels), srgb, values);
    };
    const auto type = pixels.dtype();
    if (type == nb::dtype<std::uint8_t>()) return image_of(static_cast<const std::uint8_t *>(pixels.data()));
    if (type == nb::dtype<float>()) return image_of(static_cast<const float *>(pixels.data()));
    if (type.code == static_cast<std::uint8_t>(nb::dlpack::dtype_code::Float) && type.bits == 16)
        return image_of(static_cast<const Image::Half *>(pixels.data()));
    throw std::invalid_argument("pixels must be uint8, float16 or float32");
}

using ImageState = std::tuple<std::uint32_t, std::uint32_t, std::uint32_t, bool, int,
                              nb::ndarray<const std::int32_t, nb::ndim<1>, nb::c_contig, nb::device::cpu>>;

void restore_image(Image &image, const ImageState &state) {
    const auto &[width, height, channels, srgb, type, words] = state;
    if (width == 0 || height == 0 || (channels != 1 && channels != 3) || type < 0 || type > 2)
        throw std::invalid_argument("this is not the state of an image");
    new (&image)
        Image(width, height, channels, srgb, static_cast<TexelType>(type), {words.data(), words.size()});
}

} // namespace

void bind_meshes(nb::module_ &m) {
    nb::exception<MeshError>(m, "MeshError", PyExc_ValueError);

    nb::class_<Mesh>(m, "MeshBase", "Arrays of a triangle mesh.");
    nb::class_<LoadedMesh, Mesh> mesh(m, "Mesh", "A triangle mesh; its arrays cannot be changed.");
    mesh.def(nb::new_(&make_mesh), "vertices"_a, "faces"_a, "normals"_a = nb::none(), "uvs"_a = nb::none(),
             "attributes"_a = Attributes(),
             "vertices (N, 3) float32; faces (M, 3) uint32, indices of vertices; normals (N, 3) float32 of "
             "unit length; "
             "uvs (N, 2) float32; attributes: (N, channels) float32 by names, or (M, channels) if the name "
             "begins with face_. Raises ValueError where shapes or indices do not fit.")
        .def_prop_ro(
            "vertices",
            [](nb::handle self) {
                return rows_of<float, 3>(self, nb::cast<const LoadedMesh &>(self).positions);
            },
            nb::sig("def vertices(self, /) -> numpy.typing.NDArray[numpy.float32]"))
        .def_prop_ro(
            "faces",
            [](nb::handle self) {
                return rows_of<std::uint32_t, 3>(self, nb::cast<const LoadedMesh &>(self).triangles);
            },
            nb::sig("def faces(self, /) -> numpy.typing.NDArray[numpy.uint32]"))
        .def_prop_ro(
            "normals",
            [](nb::handle self) {
                return rows_or_none<float, 3>(self, nb::cast<const LoadedMesh &>(self).normals);
            },
            nb::sig("def normals(self, /) -> numpy.typing.NDArray[numpy.float32] | None"))
        .def_prop_ro(
            "uvs",
            [](nb::handle self) {
                return rows_or_none<float, 2>(self, nb::cast<const LoadedMesh &>(self).uvs);
            },
            nb::sig("def uvs(self, /) -> numpy.typing.NDArray[numpy.float32] | None"))
        .def_prop_ro("attributes", &attributes,
                     nb::sig("def attributes(self, /) -> dict[str, numpy.typing.NDArray[numpy.float32]]"),
                     "Further values per vertex (vertex_...) or per face (face_...).")
        .def_ro("groups", &LoadedMesh::groups,
                "(material name, first face, number of faces) of an OBJ file's usemtl.")
        .def_ro("material_libraries", &LoadedMesh::material_libraries, "File names of an OBJ file's mtllib.")
        .def("with_smooth_normals", &smoothed, "to_world"_a, "max_angle_degrees"_a, "weights"_a = "angle",
             "A mesh with vertex normals, in which faces count by their \"angle\" or \"area\", or by Max's "
             "weights (\"max\"), as they are in the world; edges with a larger angle stay hard.")
        .def("with_vertex_normals", &with_normals, "to_world"_a, "weights"_a = "angle",
             "A mesh with such normals at its vertices, none of whose edges is hard.")
        .def("part", &part, "first_face"_a, "count"_a, "A mesh of consecutive faces.")
        .def_ro("face_normals", &LoadedMesh::face_normals, "Whether the file asks for flat faces.")
        .def_ro("mended", &LoadedMesh::mended,
                "Whether the file has concave polygons or lacks values: other programs may make something "
                "else of it.")
        .def_ro("computed_normals", &LoadedMesh::computed_normals,
                "Whether its normals come from `with_vertex_normals`, and not from a file.")
        .def("__getstate__", &mesh_state)
        .def("__setstate__", &restore_mesh)
        .def("__setstate__", &restore_mesh_of_faces);
    bind_polygons(m, mesh);

    nb::class_<CurveSet>(m, "Curves", "Control points of curves.")
        .def(nb::new_(&make_curves), "points"_a, "segments"_a,
             "points (N, 4) float32: x, y, z, radius; segments (M,) uint32: the first control point of each.")
        .def_prop_ro(
            "points",
            [](nb::handle self) { return rows_of<float, 4>(self, nb::cast<const CurveSet &>(self).points); },
            nb::sig("def points(self, /) -> numpy.typing.NDArray[numpy.float32]"))
        .def("__getstate__",
             [](nb::handle self) {
                 const auto &curves = nb::cast<const CurveSet &>(self);
                 return nb::make_tuple(rows_of<float, 4>(self, curves.points),
                                       view(self, curves.segments.data(), {curves.segments.size()}));
             })
        .def("__setstate__", [](CurveSet &curves, const std::tuple<Rows<4>, Indices> &state) {
            new (&curves) CurveSet(std::move(*std::apply(&make_curves, state)));
        });

    nb::class_<Image>(m, "Image", "Pixels of a texture.")
        .def(nb::new_(&make_image), "pixels"_a, "srgb"_a = false,
             "pixels (height, width[, 1 or 3]) of uint8, float16 or float32, kept as they are; srgb: 8-bit "
             "values are "
             "sRGB encoded, otherwise 255 means 1.")
        .def_ro("width", &Image::width)
        .def_ro("height", &Image::height)
        .def_ro("channels", &Image::channels)
        .def("bounds", &Image::bounds,
             "(least, largest) value of any texel; (0, 1) for uint8, infinite where one is not a number.")
        .def("__getstate__",
             [](nb::handle self) {
                 const auto &image = nb::cast<const Image &>(self);
                 return nb::make_tuple(image.width, image.height, image.channels, image.srgb,
                                       static_cast<int>(image.type),
                                       view(self, image.words(), {image.bytes() / sizeof(std::int32_t)}));
             })
        .def("__setstate__", &restore_image);

    m.def(
        "load_obj",
        [](const std::filesystem::path &path, int index, bool flip_uvs, bool polygons) {
            return from_file(read_obj(read_file(path).bytes(), index, polygons), flip_uvs);
        },
        "path"_a, "shape_index"_a = -1, "flip_uvs"_a = false, "polygons"_a = false,
        "Reads a Wavefront OBJ file, or one of the parts between its \"g\" and \"usemtl\" lines; flip_uvs: v "
        "runs the other way; polygons: keeps them too. Raises MeshError.");
    m.def(
        "load_ply",
        [](const std::filesystem::path &path, bool flip_uvs, bool srgb_colors, bool polygons) {
            return from_file(read_ply(read_file(path).bytes(), srgb_colors, polygons), flip_uvs);
        },
        "path"_a, "flip_uvs"_a = false, "srgb_colors"_a = false, "polygons"_a = false,
        "Reads a PLY file, text or binary; srgb_colors: integer colours are encoded; polygons: keeps them "
        "too. "
        "Raises MeshError.");
    m.def(
        "load_serialized",
        [](const std::filesystem::path &path, int index, bool flip_uvs) {
            return from_file(read_serialized(read_file(path).bytes(), index), flip_uvs);
        },
        "path"_a, "shape_index"_a = 0, "flip_uvs"_a = false,
        "Reads one mesh of a Mitsuba 0.6 .serialized file. Raises MeshError.");
}

} // namespace lajolla
