#include "python/arrays.h"
#include "python/bindings.h"

#include <memory>
#include <tuple>

#include <nanobind/stl/array.h>
#include <nanobind/stl/shared_ptr.h>
#include <nanobind/stl/tuple.h>

#include "images/face_images.h"

namespace lajolla {

namespace {

using namespace nb::literals;

using Texels = nb::ndarray<nb::ro, nb::ndim<2>, nb::c_contig, nb::device::cpu>;
using Sizes = nb::ndarray<const std::uint8_t, nb::shape<-1, 2>, nb::c_contig, nb::device::cpu>;
using Neighbours = nb::ndarray<const std::int32_t, nb::shape<-1, 4>, nb::c_contig, nb::device::cpu>;
using Edges = nb::ndarray<const std::uint8_t, nb::shape<-1, 4>, nb::c_contig, nb::device::cpu>;
using Flags = nb::ndarray<const std::uint8_t, nb::ndim<1>, nb::c_contig, nb::device::cpu>;

constexpr std::uint8_t constant_flag = 1, part_flag = 2;

TexelType type_of(const Texels &texels) {
    const auto type = texels.dtype();
    if (type == nb::dtype<std::uint8_t>()) return TexelType::byte;
    if (type == nb::dtype<float>()) return TexelType::real;
    if (type.code == static_cast<std::uint8_t>(nb::dlpack::dtype_code::Float) && type.bits == 16)
        return TexelType::half;
    throw std::invalid_argument("texels must be uint8, float16 or float32");
}

std::shared_ptr<FaceImages> make(const Sizes &log_sizes, const Flags &flags, const Neighbours &neighbours,
                                 const Edges &edges, const Texels &texels, bool srgb) {
    const std::size_t count = log_sizes.shape(0);
    if (flags.size() != count || neighbours.shape(0) != count || edges.shape(0) != count)
        throw std::invalid_argument("all arrays must have as many rows as there are faces");
    std::vector<FaceImages::Face> faces(count);
    for (std::size_t f = 0; f < count; ++f) {
        faces[f] = {log_sizes(f, 0),
                    log_sizes(f, 1),
                    (flags(f) & constant_flag) != 0,
                    (flags(f) & part_flag) != 0,
                    {},
                    {}};
        for (std::size_t e = 0; e < 4; ++e)
            faces[f].neighbours[e] = neighbours(f, e), faces[f].edges[e] = edges(f, e);
    }
    const auto *bytes = static_cast<const std::uint8_t *>(texels.data());
    return std::make_shared<FaceImages>(std::move(faces), static_cast<std::uint32_t>(texels.shape(1)), srgb,
                                        type_of(texels),
                                        std::vector<std::uint8_t>(bytes, bytes + texels.nbytes()));
}

// What make() takes.
nb::tuple state_of(const FaceImages &self) {
    const std::size_t count = self.faces().size();
    std::vector<std::uint8_t> sizes, flags, edges;
    std::vector<std::int32_t> neighbours;
    for (const FaceImages::Face &face : self.faces()) {
        sizes.insert(sizes.end(), {face.log_width, face.log_height});
        flags.push_back(static_cast<std::uint8_t>((face.is_constant ? constant_flag : 0) |
                                                  (face.is_part ? part_flag : 0)));
        neighbours.insert(neighbours.end(), face.neighbours.begin(), face.neighbours.end());
        edges.insert(edges.end(), face.edges.begin(), face.edges.end());
    }
    const char *const types[]{"uint8", "float16", "float32"};
    const nb::object texels = array_of(self.texels(), {self.texels().size()})
                                  .attr("view")(types[static_cast<int>(self.type)])
                                  .attr("reshape")(-1, self.channels);
    return nb::make_tuple(array_of(std::move(sizes), {count, 2}), array_of(std::move(flags), {count}),
                          array_of(std::move(neighbours), {count, 4}), array_of(std::move(edges), {count, 4}),
                          texels, self.srgb);
}

nb::object smooth(const FaceImages &self, const nb::ndarray<const std::uint32_t, nb::ndim<1>> &faces,
                  const Rows<2> &places, int level) {
    if (faces.shape(0) != places.shape(0)) throw std::invalid_argument("one face is needed for each place");
    for (std::size_t i = 0; i < faces.shape(0); ++i)
        if (faces(i) >= self.faces().size()) throw nb::index_error("there is no such face");
    if (level > 0) self.make_levels();
    return tabulate<3>(faces.shape(0),
                       [&](std::size_t i) { return self.smooth(faces(i), pair(places, i), level); });
}

} // namespace

void bind_face_images(nb::module_ &m) {
    using State = std::tuple<Sizes, Flags, Neighbours, Edges, Texels, bool>;
    nb::class_<FaceImages>(m, "FaceImages", "A picture for each face of a mesh of quads.")
        .def(nb::new_(&make), "log_sizes"_a, "flags"_a, "neighbours"_a, "edges"_a, "texels"_a, "srgb"_a,
             "log_sizes (N, 2) uint8: log2 of width and height; flags (N,) uint8: 1 for faces with one texel "
             "for "
             "all, 2 for parts of faces that are no quads; neighbours (N, 4) int32: the face across each "
             "edge, "
             "-1 for none; edges (N, 4) uint8: the neighbour's edge there; texels (M, 1 or 3) uint8, float16 "
             "or "
             "float32: of one face after the other, row by row from t = 0. Raises ValueError where these do "
             "not "
             "fit together.")
        .def_prop_ro("face_count", [](const FaceImages &self) { return self.faces().size(); })
        .def_ro("channels", &FaceImages::channels)
        .def("bounds", &FaceImages::bounds,
             "(least, largest) value of any texel; (0, 1) for uint8, infinite where one is not a number.")
        .def("smooth", &smooth, "faces"_a, "places"_a,
             "level"_a = -static_cast<int>(FaceImages::most_log_size),
             nb::sig("def smooth(self, faces: numpy.typing.NDArray[numpy.uint32], places: "
                     "numpy.typing.NDArray[numpy.float32], level: int = -15) -> "
                     "numpy.typing.NDArray[numpy.float32]"),
             "Interpolated values, (N, 3), at places (N, 2) on faces; of pictures that are reduced by "
             "2^level.")
        .def("__getstate__", &state_of)
        .def("__setstate__", [](FaceImages &images, const State &state) {
            const auto made = std::apply(&make, state);
            new (&images) FaceImages(made->faces(), made->channels, made->srgb, made->type, made->texels());
        });
}

} // namespace lajolla
