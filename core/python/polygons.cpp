#include "python/loaded_mesh.h"

#include <algorithm>
#include <bit>
#include <numeric>
#include <optional>
#include <span>
#include <unordered_map>

#include <nanobind/stl/map.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/shared_ptr.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/vector.h>

#include "engine/entries.h"
#include "geometry/subdivision.h"
#include "meshio/polygon.h"
#include "python/values.h"

namespace lajolla {

namespace {

using namespace nb::literals;

template <class T>
using Flat = nb::ndarray<const T, nb::ndim<1>, nb::c_contig, nb::device::cpu>;
using Numbers = nb::ndarray<const float, nb::ndim<2>, nb::c_contig, nb::device::cpu>;

template <class T>
std::span<const T> span_of(const Flat<T> &array) {
    return {array.data(), array.size()};
}

// --- polygons and triangles ------------------------------------------------------------------------------

// A vertex and a texture coordinate, bit by bit.
struct PointWithUv {
    std::uint32_t point;
    std::uint64_t uv;
    bool operator==(const PointWithUv &) const = default;
};
struct HashOfPointWithUv {
    std::size_t operator()(const PointWithUv &key) const {
        return std::hash<std::uint64_t>()((key.uv ^ key.point * 0x9e3779b97f4a7c15u) * 0xd6e8feb86659fd93u);
    }
};

void copy_attributes(const Mesh &mesh, const MeshData::Polygons &polygons,
                     std::span<const std::uint32_t> sources, PolygonMesh &result) {
    for (const auto &[name, attribute] : mesh.attributes) {
        Mesh::Attribute copy{attribute.channels, attribute.per_face, {}};
        const auto append = [&](std::size_t element) {
            const float *first = attribute.values.data() + element * attribute.channels;
            copy.values.insert(copy.values.end(), first, first + attribute.channels);
        };
        if (attribute.per_face) {
            std::size_t triangle = 0;
            for (const std::uint32_t size : polygons.sizes) append(triangle), triangle += size - 2;
        } else {
            for (const std::uint32_t vertex : sources) append(vertex);
        }
        result.attributes[name] = std::move(copy);
    }
}

// Vertices at the same point of a file become one again, with a uv for each value that they had.
std::shared_ptr<PolygonMesh> joined(const Mesh &mesh, const MeshData::Polygons &polygons) {
    auto result = std::make_shared<PolygonMesh>();
    result->sizes = polygons.sizes, result->groups = polygons.groups;
    std::unordered_map<std::uint32_t, std::uint32_t> points; // from the file's numbers
    std::unordered_map<PointWithUv, std::uint32_t, HashOfPointWithUv> uvs;
    std::vector<std::uint32_t> sources; // a vertex of each point
    for (const std::uint32_t vertex : polygons.corners) {
        const auto [point, is_new] = points.try_emplace(polygons.points[vertex], sources.size());
        result->corners.push_back(point->second);
        if (is_new) {
            sources.push_back(vertex);
            result->positions.push_back(mesh.positions[vertex]);
        }
        if (mesh.uvs.empty()) continue;
        const Vec2f uv = mesh.uvs[vertex];
        const PointWithUv key{point->second, std::bit_cast<std::uint64_t>(std::array{uv.x, uv.y})};
        const auto [number, is_new_uv] = uvs.try_emplace(key, result->uvs.size());
        result->uv_corners.push_back(number->second);
        if (is_new_uv) result->uvs.push_back(uv);
    }
    copy_attributes(mesh, polygons, sources, *result);
    for (const auto &[ends, sharpness] : polygons.creases)
        if (points.contains(ends[0]) && points.contains(ends[1]))
            result->creases.push_back({{points.at(ends[0]), points.at(ends[1])}, sharpness});
    for (const auto &[point, sharpness] : polygons.sharp_corners)
        if (points.contains(point)) result->sharp_corners.push_back({points.at(point), sharpness});
    return result;
}

// The places of the corners of quads: they have the coordinates of a face. Triangles of other polygons get
// any, for these have coordinates only after subdivision: their parts at each corner count as faces.
void locate_triangles(Mesh &mesh, const PolygonMesh &polygons, std::span<const std::uint32_t> corners) {
    std::vector<std::uint32_t> order(polygons.sizes.size()), firsts{0};
    std::iota(order.begin(), order.end(), 0u);
    if (!polygons.groups.empty())
        std::ranges::stable_sort(order, {}, [&](std::uint32_t f) { return polygons.groups[f]; });
    for (const std::uint32_t size : polygons.sizes) firsts.push_back(firsts.back() + size);
    const std::vector<std::uint32_t> faces = first_quads(polygons);
    const auto place = [](std::uint32_t corner) {
        return FaceCoordinates::packed(corner == 1 || corner == 2, corner >= 2);
    };
    for (const std::uint32_t f : order)
        for (std::uint32_t k = 2; k < polygons.sizes[f]; ++k) {
            const Triangle &triangle = mesh.triangles[mesh.face_coordinates.size()];
            FaceCoordinates where{faces[f], {}};
            for (std::size_t i = 0; i < 3; ++i)
                for (std::uint32_t c = 0; c < polygons.sizes[f]; ++c)
                    if (corners[firsts[f] + c] == triangle[i]) where.corners[i] = place(c);
            mesh.face_coordinates.push_back(where);
        }
    mesh.face_count = faces.back();
}

} // namespace

void keep_polygons(LoadedMesh &mesh, const MeshData::Polygons &polygons) {
    std::size_t triangles = 0;
    for (const std::uint32_t size : polygons.sizes) triangles += size - 2;
    if (polygons.sizes.empty() || triangles != mesh.triangles.size()) return; // triangle strips
    mesh.polygons = joined(mesh, polygons);
    locate_triangles(mesh, *mesh.polygons, polygons.corners);
}

namespace {

// --- polygons from arrays --------------------------------------------------------------------------------

Triangle at_corners(const std::array<std::uint32_t, 3> &t, const std::uint32_t *corners) {
    return {corners[t[0]], corners[t[1]], corners[t[2]]};
}

// Triangles of the polygons, and attributes of faces for each of them. A vertex has the first uv that it has
// at any corner, unless uvs are those of vertices.
std::shared_ptr<LoadedMesh> cut(std::shared_ptr<const PolygonMesh> polygons) {
    auto mesh = std::make_shared<LoadedMesh>();
    std::unordered_map<PointWithUv, std::uint32_t, HashOfPointWithUv> vertices;
    std::vector<std::uint32_t> sources, corners; // the vertex of each corner
    for (std::size_t c = 0; c < polygons->corners.size(); ++c) {
        const std::uint32_t point = polygons->corners[c];
        const std::uint32_t uv = polygons->uvs.empty() ? 0 : polygons->uv_corners[c];
        const auto [vertex, is_new] = vertices.try_emplace({point, uv}, sources.size());
        corners.push_back(vertex->second);
        if (!is_new) continue;
        sources.push_back(point);
        mesh->positions.push_back(polygons->positions[point]);
        if (!polygons->uvs.empty()) mesh->uvs.push_back(polygons->uvs[uv]);
    }
    PolygonCutter cutter;
    std::vector<std::uint32_t> faces; // of each triangle
    std::vector<Vec3f> outline;
    std::size_t first = 0;
    for (std::uint32_t f = 0; f < polygons->sizes.size(); first += polygons->sizes[f], ++f) {
        outline.clear();
        for (std::size_t k = 0; k < polygons->sizes[f]; ++k)
            outline.push_back(polygons->positions[polygons->corners[first + k]]);
        for (const auto &t : cutter.cut(outline)) {
            mesh->triangles.push_back(at_corners(t, corners.data() + first));
            faces.push_back(f);
        }
    }
    for (const auto &[name, attribute] : polygons->attributes) {
        Mesh::Attribute copy{attribute.channels, attribute.per_face, {}};
        for (const std::uint32_t element : attribute.per_face ? faces : sources) {
            const float *value = attribute.values.data() + element * attribute.channels;
            copy.values.insert(copy.values.end(), value, value + attribute.channels);
        }
        mesh->attributes[name] = std::move(copy);
    }
    mesh->mended = cutter.met_concave;
    locate_triangles(*mesh, *polygons, corners);
    mesh->polygons = std::move(polygons);
    return mesh;
}

std::shared_ptr<LoadedMesh>
make_polygons(const Rows<3> &vertices, const Flat<std::uint32_t> &sizes, const Flat<std::uint32_t> &corners,
              const std::optional<Rows<2>> &uvs, const std::optional<Flat<std::uint32_t>> &uv_corners,
              const std::map<std::string, Numbers> &attributes, const Rows<2, std::uint32_t> &creases,
              const Flat<float> &sharpness, const Flat<std::uint32_t> &sharp_corners,
              const Flat<float> &corner_sharpness) {
    auto mesh = std::make_shared<PolygonMesh>();
    for (std::size_t i = 0; i < vertices.shape(0); ++i)
        mesh->positions.emplace_back(vertices(i, 0), vertices(i, 1), vertices(i, 2));
    mesh->sizes.assign(sizes.data(), sizes.data() + sizes.size());
    mesh->corners.assign(corners.data(), corners.data() + corners.size());
    if (uvs)
        for (std::size_t i = 0; i < uvs->shape(0); ++i) mesh->uvs.push_back(pair(*uvs, i));
    if (uv_corners) mesh->uv_corners.assign(uv_corners->data(), uv_corners->data() + uv_corners->size());
    for (const auto &[name, values] : attributes)
        mesh->attributes[name] = {static_cast<std::uint32_t>(values.shape(1)),
                                  name.starts_with("face_"),
                                  {values.data(), values.data() + values.size()}};
    if (creases.shape(0) != sharpness.size() || sharp_corners.size() != corner_sharpness.size())
        throw std::invalid_argument("each crease and each sharp corner needs its sharpness");
    for (std::size_t i = 0; i < sharpness.size(); ++i)
        mesh->creases.push_back({{creases(i, 0), creases(i, 1)}, sharpness(i)});
    for (std::size_t i = 0; i < corner_sharpness.size(); ++i)
        mesh->sharp_corners.push_back({sharp_corners(i), corner_sharpness(i)});
    validate(*mesh);
    return cut(std::move(mesh));
}

// --- subdivision -----------------------------------------------------------------------------------------

const PolygonMesh &polygons_of(const LoadedMesh &mesh) {
    if (!mesh.polygons) throw std::invalid_argument("the mesh has no polygons");
    return *mesh.polygons;
}

nb::object edges_of(const LoadedMesh &mesh) {
    const PolygonMesh &polygons = polygons_of(mesh);
    Table<float, 6> edges(polygons.corners.size());
    std::size_t first = 0;
    for (const std::uint32_t size : polygons.sizes) {
        for (std::uint32_t k = 0; k < size; ++k) {
            const Vec3f a = polygons.positions[polygons.corners[first + k]],
                        b = polygons.positions[polygons.corners[first + (k + 1) % size]];
            edges.set(first + k, a.x, a.y, a.z, b.x, b.y, b.z);
        }
        first += size;
    }
    return std::move(edges).to_numpy();
}

template <class Choice>
Choice choice_of(const std::string &name) {
    constexpr auto names = choices(Choice{});
    const auto found = std::find(names.begin(), names.end(), name);
    if (found == names.end()) throw std::invalid_argument("there is no choice '" + name + "'");
    return static_cast<Choice>(found - names.begin());
}

nb::tuple subdivided(const LoadedMesh &mesh, const Flat<std::uint8_t> &levels, const std::string &boundary,
                     const std::string &uvs, std::size_t most_triangles) {
    const SubdivisionRules rules{choice_of<SubdivisionBoundary>(boundary), choice_of<SubdivisionUvs>(uvs)};
    SubdivisionSurface surface;
    {
        const nb::gil_scoped_release release;
        surface = subdivide(polygons_of(mesh), rules, span_of(levels), most_triangles);
    }
    auto result = std::make_shared<LoadedMesh>();
    static_cast<Mesh &>(*result) = std::move(surface.mesh);
    result->material_libraries = mesh.material_libraries;
    if (!mesh.groups.empty())
        for (const auto &[group, first, count] : surface.groups)
            result->groups.emplace_back(std::get<0>(mesh.groups[group]), first, count);
    const std::size_t count = surface.points.size();
    return nb::make_tuple(result, array_of(std::move(surface.points), {count}), surface.levels_dropped);
}

std::shared_ptr<LoadedMesh> moved(const LoadedMesh &mesh, const Flat<std::uint32_t> &points,
                                  const Flat<float> &distances) {
    auto result = std::make_shared<LoadedMesh>(mesh);
    static_cast<Mesh &>(*result) = displaced(mesh, span_of(points), span_of(distances));
    return result;
}

std::shared_ptr<LoadedMesh> with_faces_of(const LoadedMesh &mesh, const LoadedMesh &other) {
    auto result = std::make_shared<LoadedMesh>(mesh);
    result->face_coordinates = other.face_coordinates;
    result->face_count = other.face_count;
    validate(*result);
    return result;
}

// The value of a texture at each vertex, as the first triangle there sees it.
nb::object texture_values(const nb::dict &description, std::int32_t texture,
                          const std::shared_ptr<const LoadedMesh> &mesh) {
    std::vector<TextureModel> textures;
    with_dict(description, [&](const Dict &dict) {
        for_each_entry(dict, "textures", [&](const Dict &entry, const std::string &where) {
            textures.push_back(read_texture(entry, textures.size(), where));
        });
        return 0;
    });
    if (texture < 0 || static_cast<std::size_t>(texture) >= textures.size())
        throw nb::index_error("there is no such texture");
    TriangleMesh model;
    model.mesh = mesh;
    model.build();
    const Shape shape = std::move(model);
    Texture<float> handle;
    handle.id = texture;
    Table<float, 1> values(mesh->positions.size());
    for (std::size_t i = 0; i < mesh->positions.size(); ++i) values.set(i, 0.0f);
    for (std::size_t t = mesh->triangles.size(); t-- > 0;)
        for (std::size_t k = 0; k < 3; ++k) {
            const RayHit found{0, k == 1 ? 1.0f : 0.0f, k == 2 ? 1.0f : 0.0f, 0,
                               static_cast<std::uint32_t>(t)};
            Hit<float> hit;
            hit.shape = 0, hit.primitive = static_cast<std::int32_t>(t);
            std::get<TriangleMesh>(shape).fill({}, found, {}, hit);
            const TexturePoint<float> at{hit.uv, &hit, &shape, {}, false};
            const TextureReader<float> read(textures, at);
            values.set(mesh->triangles[t][k], read(handle));
        }
    return std::move(values).to_numpy();
}

} // namespace

void bind_polygons(nb::module_ &m, nb::class_<LoadedMesh, Mesh> &mesh) {
    mesh.def_ro(
            "face_count", &LoadedMesh::face_count,
            "The number of faces, where polygons other than quads count as one at each corner; 0 if the mesh "
            "does not know.")
        .def_prop_ro(
            "has_polygons", [](const LoadedMesh &self) { return self.polygons != nullptr; },
            "Whether it can be subdivided.")
        .def_prop_ro("polygon_edges", &edges_of,
                     nb::sig("def polygon_edges(self, /) -> numpy.typing.NDArray[numpy.float32]"),
                     "(corners, 6): both ends of the edge that starts at each corner of the polygons.")
        .def("subdivided", &subdivided, "levels"_a, "boundary"_a, "uvs"_a, "most_triangles"_a,
             nb::sig(
                 "def subdivided(self, levels: numpy.typing.NDArray[numpy.uint8], boundary: str, uvs: str, "
                 "most_triangles: int) -> tuple[Mesh, numpy.typing.NDArray[numpy.uint32], int]"),
             "The Catmull-Clark surface of the polygons, where the edge at each corner has 2^level pieces; "
             "the "
             "point of the surface at each vertex; and how many levels were left out everywhere to stay "
             "within "
             "the number of triangles. Raises ValueError for polygons that cannot be subdivided.")
        .def("with_faces_of", &with_faces_of, "other"_a,
             "The same mesh with the faces of another one that has the same triangles. Raises ValueError.")
        .def("displaced", &moved, "points"_a, "distances"_a,
             "The surface moved along its normals; both arrays have one number per vertex.");
    m.def("polygon_mesh", &make_polygons, "vertices"_a, "sizes"_a, "corners"_a, "uvs"_a, "uv_corners"_a,
          "attributes"_a, "creases"_a, "sharpness"_a, "sharp_corners"_a, "corner_sharpness"_a,
          "A mesh of polygons: sizes (M,) of the faces, corners (sum of sizes,) indices of vertices, "
          "uv_corners "
          "indices of uvs, creases (K, 2) pairs of vertices. Raises ValueError where these do not fit "
          "together.");
    m.def("texture_values", &texture_values, "description"_a, "texture"_a, "mesh"_a,
          nb::sig("def texture_values(description: dict, texture: int, mesh: Mesh) -> "
                  "numpy.typing.NDArray[numpy.float32]"),
          "The value of one of the description's textures at each vertex of a mesh, (N,).");
}

} // namespace lajolla
