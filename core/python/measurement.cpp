#include "python/bindings.h"

#include <nanobind/stl/shared_ptr.h>
#include <nanobind/stl/tuple.h>

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "python/arrays.h"
#include "scatter/measured.h"

namespace lajolla {

namespace {

using namespace nb::literals;

template <std::size_t N>
using Tensor = nb::ndarray<const float, nb::ndim<N>, nb::c_contig, nb::device::cpu>;

// Of the axes `rows` and the next.
SquareGrid grid_of(const auto &tensor, std::size_t rows) {
    if (std::max(tensor.shape(rows), tensor.shape(rows + 1)) > (1u << 20))
        throw std::invalid_argument("a measurement has at most a million nodes along an axis");
    return {static_cast<std::int32_t>(tensor.shape(rows + 1)), static_cast<std::int32_t>(tensor.shape(rows))};
}

std::vector<float> nodes_of(const auto &tensor) {
    std::vector<float> nodes(tensor.data(), tensor.data() + tensor.size());
    if (!std::all_of(nodes.begin(), nodes.end(), [](float v) { return std::isfinite(v); }))
        throw std::invalid_argument("a measurement must be finite");
    return nodes;
}

// What noise made negative is zero.
std::vector<float> densities_of(const auto &tensor) {
    std::vector<float> nodes = nodes_of(tensor);
    for (float &v : nodes) v = std::max(v, 0.0f);
    return nodes;
}

MeasuredTables tables_of(const Tensor<1> &phi, const Tensor<1> &theta, const Tensor<2> &ndf,
                         const Tensor<2> &sigma, const Tensor<4> &vndf, const Tensor<4> &luminance,
                         const Tensor<5> &colour, bool jacobian) {
    for (const auto &[p, t] :
         {std::pair(vndf.shape(0), vndf.shape(1)), std::pair(luminance.shape(0), luminance.shape(1)),
          std::pair(colour.shape(0), colour.shape(1))})
        if (p != phi.size() || t != theta.size())
            throw std::invalid_argument("the tables are not of as many directions as there are");
    if (colour.shape(4) != 3) throw std::invalid_argument("the colours do not have three channels");
    return {nodes_of(phi),
            nodes_of(theta),
            {grid_of(ndf, 0), densities_of(ndf)},
            {grid_of(sigma, 0), densities_of(sigma)},
            {grid_of(vndf, 2), densities_of(vndf)},
            {grid_of(luminance, 2), densities_of(luminance)},
            {grid_of(colour, 2), densities_of(colour)},
            jacobian};
}

std::shared_ptr<Measurement> make_measurement(const Tensor<1> &phi, const Tensor<1> &theta,
                                              const Tensor<2> &ndf, const Tensor<2> &sigma,
                                              const Tensor<4> &vndf, const Tensor<4> &luminance,
                                              const Tensor<5> &colour, bool jacobian) {
    return std::make_shared<Measurement>(
        tables_of(phi, theta, ndf, sigma, vndf, luminance, colour, jacobian));
}

using State = std::tuple<Tensor<1>, Tensor<1>, Tensor<2>, Tensor<2>, Tensor<4>, Tensor<4>, Tensor<5>, bool>;

// What `tables_of` takes: views of the measurement's memory.
nb::tuple state_of(nb::handle self) {
    const MeasuredTables &t = nb::cast<const Measurement &>(self).tables();
    const auto view = [&](const std::vector<float> &nodes, std::initializer_list<std::size_t> shape) {
        return nb::cast(nb::ndarray<nb::numpy, const float>(nodes.data(), shape, self),
                        nb::rv_policy::reference);
    };
    const std::size_t phi = t.phi.size(), theta = t.theta.size();
    const auto rows = [](const auto &table) { return static_cast<std::size_t>(table.grid.height); };
    const auto columns = [](const auto &table) { return static_cast<std::size_t>(table.grid.width); };
    return nb::make_tuple(
        view(t.phi, {phi}), view(t.theta, {theta}), view(t.ndf.nodes, {rows(t.ndf), columns(t.ndf)}),
        view(t.sigma.nodes, {rows(t.sigma), columns(t.sigma)}),
        view(t.vndf.nodes, {phi, theta, rows(t.vndf), columns(t.vndf)}),
        view(t.luminance.nodes, {phi, theta, rows(t.luminance), columns(t.luminance)}),
        view(t.colour.nodes, {phi, theta, rows(t.colour), columns(t.colour), 3}), t.jacobian);
}

} // namespace

void bind_measurements(nb::module_ &m) {
    nb::class_<Measurement>(m, "Measurement", "The tables of a measured material.")
        .def(nb::new_(&make_measurement), "phi"_a, "theta"_a, "ndf"_a, "sigma"_a, "vndf"_a, "luminance"_a,
             "colour"_a, "jacobian"_a = true,
             "float32 arrays as RGL files have them: phi (P,) and theta (T,) of the known direction, ndf and "
             "sigma (H, W), vndf and luminance (P, T, H, W), and linear sRGB colour (P, T, H, W, 3).")
        .def_prop_ro("roughness", &Measurement::roughness)
        .def("__getstate__", &state_of)
        .def("__setstate__", [](Measurement &measurement, const State &state) {
            new (&measurement) Measurement(std::apply(&tables_of, state));
        });
}

} // namespace lajolla
