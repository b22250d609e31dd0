// Vectorised calls into the parts that the statistical tests judge: one array in, one array out, no
// statistics here.

#include "python/testing/bindings.h"

#include <nanobind/stl/string.h>

#include <algorithm>
#include <array>
#include <span>
#include <vector>

#include "base/distribution.h"
#include "base/frame.h"
#include "base/sampler.h"
#include "base/sums.h"
#include "base/warp.h"
#include "engine/described.h"
#include "geometry/hit.h"
#include "python/arrays.h"
#include "python/values.h"
#include "scatter/bsdfs.h"

namespace lajolla {

namespace {

SequenceKind sequence_kind(const std::string &name) {
    if (name == "sobol") return SequenceKind::sobol;
    if (name == "independent") return SequenceKind::independent;
    throw std::invalid_argument("kind: 'sobol' or 'independent' expected");
}

// Samples of paths, one a row: seed, x, y, index and, where a bounce is asked for, its number.
template <std::size_t N>
using SampleRows = nb::ndarray<const std::uint32_t, nb::shape<-1, static_cast<Py_ssize_t>(N)>, nb::c_contig,
                               nb::device::cpu>;

std::vector<Sampler> samplers_of(const std::string &kind, const auto &rows) {
    std::vector<Sampler> result;
    for (std::size_t i = 0; i < rows.shape(0); ++i)
        result.emplace_back(sequence_kind(kind), rows(i, 0), rows(i, 1), rows(i, 2), rows(i, 3));
    return result;
}

// Fills a table by one(row), or by wide(index of each lane -> row), whose lanes beyond the last row repeat
// it.
template <std::size_t N, class One, class Wide>
nb::object in_packets(std::size_t rows, bool one_lane, One &&one, Wide &&wide) {
    Table<float, N> table(rows);
    const auto step = static_cast<std::size_t>(one_lane ? 1 : lanes);
    for (std::size_t i = 0; i < rows; i += step) {
        if (one_lane) {
            std::ranges::copy(one(i), table.row(i));
            continue;
        }
        const std::array<WideFloat, N> numbers =
            wide([&](int k) { return std::min(i + static_cast<std::size_t>(k), rows - 1); });
        for (std::size_t k = 0; k < step && i + k < rows; ++k)
            for (std::size_t d = 0; d < N; ++d) table.row(i + k)[d] = numbers[d][static_cast<int>(k)];
    }
    return std::move(table).to_numpy();
}

template <class Float>
std::array<Float, 6> numbers_of(const CameraSample<Float> &s) {
    return {s.film.x, s.film.y, s.lens.x, s.lens.y, s.event, s.channel};
}
template <class Float>
std::array<Float, 8> numbers_of(const BounceSample<Float> &s) {
    return {s.light_uv.x, s.light_uv.y, s.bsdf_uv.x, s.bsdf_uv.y, s.light, s.lobe, s.roulette, s.event};
}

nb::object sampler_cameras(const std::string &kind, const SampleRows<4> &rows, bool one_lane) {
    const std::vector<Sampler> samplers = samplers_of(kind, rows);
    return in_packets<6>(
        samplers.size(), one_lane, [&](std::size_t i) { return numbers_of(samplers[i].camera()); },
        [&](auto &&row) {
            return numbers_of(Sampler::cameras([&](int k) -> const Sampler & { return samplers[row(k)]; }));
        });
}

nb::object sampler_bounces(const std::string &kind, const SampleRows<5> &rows, bool one_lane) {
    const std::vector<Sampler> samplers = samplers_of(kind, rows);
    return in_packets<8>(
        samplers.size(), one_lane, [&](std::size_t i) { return numbers_of(samplers[i].bounce(rows(i, 4))); },
        [&](auto &&row) {
            WideInt bounce;
            for (int k = 0; k < lanes; ++k) bounce.v[k] = static_cast<std::int32_t>(rows(row(k), 4));
            return numbers_of(
                Sampler::bounces([&](int k) -> const Sampler & { return samplers[row(k)]; }, bounce));
        });
}

// f(x, y) of the functions that base/math.h has for one number and for several.
template <class Float>
Float elementary_value(const std::string &name, Float x, Float y) {
    if (name == "exp") return exp(x);
    if (name == "log") return log(x);
    if (name == "pow") return pow(x, y);
    if (name == "sin") return sin(x);
    if (name == "cos") return cos(x);
    if (name == "atan2") return atan2(x, y);
    if (name == "acos") return acos(x);
    if (name == "log1p") return log1p(x);
    if (name == "expm1") return expm1(x);
    if (name == "tan") return tan(x);
    if (name == "tanh") return tanh(x);
    if (name == "sqrt") return sqrt(x);
    if (name == "floor") return floor(x);
    if (name == "min") return min(x, y);
    if (name == "max") return max(x, y);
    if (name == "copysign") return copysign(x, y);
    if (name == "to_int") return to_float(to_int(x));
    if (name == "isfinite") return select(isfinite(x), Float(1), Float(0));
    throw std::invalid_argument("elementary: there is no function " + name);
}

nb::object elementary(const std::string &name, const Column &x, const Column &y, bool one_lane) {
    if (x.shape(0) != y.shape(0)) throw std::invalid_argument("elementary: as many x as y expected");
    return in_packets<1>(
        x.shape(0), one_lane, [&](std::size_t i) { return std::array{elementary_value(name, x(i), y(i))}; },
        [&](auto &&row) {
            WideFloat a, b;
            for (int k = 0; k < lanes; ++k) a.v[k] = x(row(k)), b.v[k] = y(row(k));
            return std::array{elementary_value(name, a, b)};
        });
}

std::span<const float> values_of(const Column &array) { return {array.data(), array.shape(0)}; }

nb::dict distribution_sample(const Column &weights, const Column &u) {
    const Distribution distribution(values_of(weights));
    const std::size_t n = u.shape(0);
    Table<std::int32_t, 1> index(n);
    Table<float, 1> probability(n), rest(n);
    for (std::size_t i = 0; i < n; ++i) {
        const auto s = distribution.sample(u(i));
        index.set(i, static_cast<std::int32_t>(s.index));
        probability.set(i, s.probability);
        rest.set(i, s.rest);
    }
    nb::dict result;
    result["index"] = std::move(index).to_numpy();
    result["probability"] = std::move(probability).to_numpy();
    result["rest"] = std::move(rest).to_numpy();
    return result;
}

nb::object distribution_probability(const Column &weights) {
    const Distribution distribution(values_of(weights));
    return tabulate<1>(distribution.size(),
                       [&](std::size_t i) { return distribution.probability(static_cast<std::int32_t>(i)); });
}

using Grid = nb::ndarray<const float, nb::ndim<2>, nb::c_contig, nb::device::cpu>;

Distribution2D distribution_of(const Grid &weights) {
    return {{weights.data(), weights.size()},
            static_cast<std::uint32_t>(weights.shape(1)),
            static_cast<std::uint32_t>(weights.shape(0))};
}

nb::tuple distribution2d_sample(const Grid &weights, const Rows<2> &u) {
    const Distribution2D distribution = distribution_of(weights);
    Table<float, 2> position(u.shape(0));
    Table<float, 1> pdf(u.shape(0));
    for (std::size_t i = 0; i < u.shape(0); ++i) {
        const auto s = distribution.sample(pair(u, i));
        position.set(i, s.position);
        pdf.set(i, s.pdf);
    }
    return nb::make_tuple(std::move(position).to_numpy(), std::move(pdf).to_numpy());
}

nb::object distribution2d_pdf(const Grid &weights, const Rows<2> &positions) {
    const Distribution2D distribution = distribution_of(weights);
    return tabulate<1>(positions.shape(0),
                       [&](std::size_t i) { return distribution.pdf(pair(positions, i)); });
}

nb::object warp_disk(const Rows<2> &u) {
    return tabulate<2>(u.shape(0), [&](std::size_t i) { return sample_disk(pair(u, i)); });
}
nb::object warp_triangle(const Rows<2> &u) {
    return tabulate<2>(u.shape(0), [&](std::size_t i) { return sample_triangle(pair(u, i)); });
}
nb::object warp_sphere(const Rows<2> &u) {
    return tabulate<3>(u.shape(0), [&](std::size_t i) { return sample_sphere(pair(u, i)); });
}
nb::object warp_cosine_hemisphere(const Rows<2> &u) {
    return tabulate<3>(u.shape(0), [&](std::size_t i) { return sample_cosine_hemisphere(pair(u, i)); });
}
nb::object warp_cone(const Rows<2> &u, float height) {
    return tabulate<3>(u.shape(0), [&](std::size_t i) { return sample_cone(pair(u, i), height); });
}

nb::object frames_around(const Rows<3> &n) {
    return tabulate<9>(n.shape(0), [&](std::size_t i) { return frame_around(triple(n, i)); });
}
nb::object frames_along(const Rows<3> &n, const Rows<3> &dp_du) {
    require_one_or(dp_du.shape(0), n.shape(0), "dp_du");
    return tabulate<9>(n.shape(0),
                       [&](std::size_t i) { return frame_along(triple(n, i), triple(dp_du, i)); });
}

nb::object transform_inverse(nb::handle matrix) {
    Transform transform;
    read_value(matrix, transform, "matrix");
    const auto result = inverse(transform);
    return result ? object_of(Described<Transform>::write(*result)) : nb::none();
}

} // namespace

void bind_statistics(nb::module_ &m) {
    m.def(
        "sum_digits",
        [](const Column &terms) {
            Sums sums(1);
            for (std::size_t i = 0; i < terms.size(); ++i) sums.add(0, terms.data()[i]);
            return nb::make_tuple(sums.digits()[0].high, sums.digits()[0].low, sums.places()[0]);
        },
        nb::arg("terms"), "The sum of floats: its high digit, its low digit, and the place of the former.");
    m.def("sampler_cameras", &sampler_cameras, nb::arg("kind"), nb::arg("rows"), nb::arg("one_lane") = false,
          "The camera numbers (N, 6) of rows (N, 4) of seed, x, y, index: film x, y, lens x, y, event, "
          "channel.");
    m.def(
        "sampler_bounces", &sampler_bounces, nb::arg("kind"), nb::arg("rows"), nb::arg("one_lane") = false,
        "The numbers (N, 8) of rows (N, 5) of seed, x, y, index, bounce: light_uv x, y, bsdf_uv x, y, light, "
        "lobe, roulette, event.");
    m.def("elementary", &elementary, nb::arg("name"), nb::arg("x"), nb::arg("y"), nb::arg("one_lane") = false,
          "A function of base/math.h of x (N,) and y (N,), which those of one number ignore.");
    m.def("distribution_sample", &distribution_sample, nb::arg("weights"), nb::arg("u"),
          "Samples a discrete distribution with u (N,): a dict of arrays index, probability, rest (N,).");
    m.def("distribution_probability", &distribution_probability, nb::arg("weights"),
          "The probability of every entry of a discrete distribution.");
    m.def("distribution2d_sample", &distribution2d_sample, nb::arg("weights"), nb::arg("u"),
          "Samples a grid of weights (H, W) on the unit square with u (N, 2): positions (N, 2) and densities "
          "(N,).");
    m.def("distribution2d_pdf", &distribution2d_pdf, nb::arg("weights"), nb::arg("positions"),
          "The density of a grid of weights (H, W) at positions (N, 2) of the unit square.");
    m.def("warp_disk", &warp_disk, nb::arg("u"), "Uniform points of the unit disk (N, 2).");
    m.def("warp_triangle", &warp_triangle, nb::arg("u"), "Uniform barycentric coordinates b1, b2 (N, 2).");
    m.def("warp_sphere", &warp_sphere, nb::arg("u"), "Uniform directions (N, 3).");
    m.def("warp_cosine_hemisphere", &warp_cosine_hemisphere, nb::arg("u"),
          "Cosine-weighted directions (N, 3).");
    m.def("warp_cone", &warp_cone, nb::arg("u"), nb::arg("height"),
          "Uniform directions (N, 3) in the cone around +z of height 1 - cos(angle).");
    m.def("frames_around", &frames_around, nb::arg("n"), "Frames s, t, n (N, 9) around unit normals (N, 3).");
    m.def("frames_along", &frames_along, nb::arg("n"), nb::arg("dp_du"),
          "Frames s, t, n (N, 9) around unit normals whose s points along dp_du.");
    m.def("transform_inverse", &transform_inverse, nb::arg("matrix"),
          "The inverse of an affine 4x4 matrix, None where it is singular.");
}

} // namespace lajolla
