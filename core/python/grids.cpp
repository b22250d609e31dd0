#include "python/bindings.h"

#include <nanobind/ndarray.h>
#include <nanobind/stl/shared_ptr.h>

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "images/grid.h"

namespace lajolla {

namespace {

using namespace nb::literals;
using Voxels = nb::ndarray<nb::ro, nb::c_contig, nb::device::cpu>;

template <class T>
std::vector<T> values_of(const Voxels &voxels) {
    const auto *first = static_cast<const T *>(voxels.data());
    std::vector<T> values(first, first + voxels.size());
    if constexpr (!std::is_integral_v<T>)
        if (!std::all_of(values.begin(), values.end(),
                         [](T v) { return std::isfinite(static_cast<float>(v)); }))
            throw std::invalid_argument("voxels must be finite");
    return values;
}

std::shared_ptr<Grid> make_grid(const Voxels &voxels) {
    const std::size_t channels = voxels.ndim() == 4 ? voxels.shape(3) : 1;
    if ((voxels.ndim() != 3 && voxels.ndim() != 4) || voxels.size() == 0 ||
        (channels != 1 && channels != 3 && channels != 6))
        throw std::invalid_argument("voxels must have the shape (depth, height, width[, 1, 3 or 6])");
    auto grid = std::make_shared<Grid>();
    grid->depth = static_cast<std::uint32_t>(voxels.shape(0));
    grid->height = static_cast<std::uint32_t>(voxels.shape(1));
    grid->width = static_cast<std::uint32_t>(voxels.shape(2));
    if (std::max({voxels.shape(0), voxels.shape(1), voxels.shape(2)}) > (1u << 20))
        throw std::invalid_argument("a grid has at most a million voxels along an axis");
    grid->channels = static_cast<std::uint32_t>(channels);
    const auto type = voxels.dtype();
    if (type == nb::dtype<std::uint8_t>()) grid->values = values_of<std::uint8_t>(voxels);
    else if (type == nb::dtype<float>()) grid->values = values_of<float>(voxels);
    else if (type.code == static_cast<std::uint8_t>(nb::dlpack::dtype_code::Float) && type.bits == 16)
        grid->values = values_of<Grid::Half>(voxels);
    else throw std::invalid_argument("voxels must be uint8, float16 or float32");
    return grid;
}

// What `make_grid` takes: a view of the grid's memory.
nb::object voxels_of(nb::handle self) {
    const auto &grid = nb::cast<const Grid &>(self);
    return std::visit(
        [&]<class T>(const std::vector<T> &values) {
            const auto code =
                std::is_integral_v<T> ? nb::dlpack::dtype_code::UInt : nb::dlpack::dtype_code::Float;
            const nb::dlpack::dtype type{static_cast<std::uint8_t>(code), 8 * sizeof(T), 1};
            return nb::cast(
                nb::ndarray<nb::numpy, nb::ro>(
                    values.data(), {grid.depth, grid.height, grid.width, grid.channels}, self, {}, type),
                nb::rv_policy::reference);
        },
        grid.values);
}

} // namespace

void bind_grids(nb::module_ &m) {
    nb::class_<Grid>(m, "Grid", "Voxels of a volume.")
        .def(nb::new_(&make_grid), "voxels"_a,
             "voxels (depth, height, width[, 1, 3 or 6]) of uint8, float16 or float32, kept as they are; 255 "
             "means 1.")
        .def_ro("width", &Grid::width)
        .def_ro("height", &Grid::height)
        .def_ro("depth", &Grid::depth)
        .def_ro("channels", &Grid::channels)
        .def("__getstate__", &voxels_of)
        .def("__setstate__",
             [](Grid &grid, const Voxels &voxels) { new (&grid) Grid(std::move(*make_grid(voxels))); });
}

} // namespace lajolla
