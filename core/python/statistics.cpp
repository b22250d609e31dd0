// Vectorised calls into the parts that the statistical tests judge: one array in, one array out, no
// statistics here.

#include "python/statistics.h"

#include <nanobind/stl/string.h>

#include <span>

#include "base/distribution.h"
#include "base/frame.h"
#include "base/sampler.h"
#include "base/warp.h"
#include "python/arrays.h"
#include "python/coated.h"
#include "python/describe.h"
#include "scatter/bsdfs.h"

namespace lajolla {

namespace {

// A BSDF by itself, outside a scene: its textures are constants.
class LoneBsdf {
public:
    explicit LoneBsdf(const nb::dict &description)
        : model_(variant_from<Bsdf>(description, "bsdf")), lobe_(prepare(model_, [](const auto &texture) {
              if (!texture.is_constant())
                  throw DescriptionError("bsdf: outside a scene textures must be constants");
              return texture.constant;
          })) {}
    LoneBsdf(const LoneBsdf &) = delete; // the lobe may point to tables of the model
    LoneBsdf &operator=(const LoneBsdf &) = delete;

    bool transmissive() const { return is_transmissive(model_); }
    bool delta() const { return is_delta(model_); }
    float roughness() const { return lajolla::roughness(lobe_); }

    nb::dict sample_many(const Rows<3> &wo, const Rows<3> &u) const;
    nb::tuple eval_many(const Rows<3> &wo, const Rows<3> &wi) const;

private:
    Bsdf model_;
    Lobe lobe_;
};

nb::dict LoneBsdf::sample_many(const Rows<3> &wo, const Rows<3> &u) const {
    const std::size_t n = u.shape(0);
    require_one_or(wo.shape(0), n, "wo");
    Table<float, 3> wi(n), weight(n);
    Table<float, 1> pdf(n), eta(n);
    Table<std::int32_t, 1> kind(n);
    Table<bool, 1> valid(n);
    for (std::size_t i = 0; i < n; ++i) {
        const auto s = sample(lobe_, triple(wo, i), u(i, 0), {u(i, 1), u(i, 2)});
        valid.set(i, s.has_value());
        if (!s) continue;
        wi.set(i, s->wi);
        weight.set(i, s->weight);
        pdf.set(i, s->pdf);
        eta.set(i, s->eta);
        kind.set(i, static_cast<std::int32_t>(s->kind));
    }
    nb::dict result;
    result["wi"] = std::move(wi).to_numpy();
    result["weight"] = std::move(weight).to_numpy();
    result["pdf"] = std::move(pdf).to_numpy();
    result["eta"] = std::move(eta).to_numpy();
    result["kind"] = std::move(kind).to_numpy();
    result["valid"] = std::move(valid).to_numpy();
    return result;
}

nb::tuple LoneBsdf::eval_many(const Rows<3> &wo, const Rows<3> &wi) const {
    const std::size_t n = wi.shape(0);
    require_one_or(wo.shape(0), n, "wo");
    Table<float, 3> f_cos(n);
    Table<float, 1> pdf(n);
    for (std::size_t i = 0; i < n; ++i) {
        const BsdfEval e = eval(lobe_, triple(wo, i), triple(wi, i));
        f_cos.set(i, e.f_cos);
        pdf.set(i, e.pdf);
    }
    return nb::make_tuple(std::move(f_cos).to_numpy(), std::move(pdf).to_numpy());
}

SequenceKind sequence_kind(const std::string &name) {
    if (name == "sobol") return SequenceKind::sobol;
    if (name == "independent") return SequenceKind::independent;
    throw std::invalid_argument("kind: 'sobol' or 'independent' expected");
}

nb::object sampler_camera(const std::string &kind, std::uint32_t seed, std::uint32_t x, std::uint32_t y,
                          std::uint32_t first, std::uint32_t count) {
    Table<float, 5> table(count);
    for (std::uint32_t i = 0; i < count; ++i) {
        const CameraSample s = Sampler(sequence_kind(kind), seed, x, y, first + i).camera();
        table.set(i, s.film.x, s.film.y, s.lens.x, s.lens.y, s.flight);
    }
    return std::move(table).to_numpy();
}

nb::object sampler_blocks(const std::string &kind, std::uint32_t seed, std::uint32_t x, std::uint32_t y,
                          std::uint32_t first, std::uint32_t count, std::uint32_t bounce) {
    Table<float, 8> table(count);
    for (std::uint32_t i = 0; i < count; ++i) {
        const BounceSample s = Sampler(sequence_kind(kind), seed, x, y, first + i).bounce(bounce);
        table.set(i, s.light_uv.x, s.light_uv.y, s.bsdf_uv.x, s.bsdf_uv.y, s.light, s.lobe, s.roulette,
                  s.flight);
    }
    return std::move(table).to_numpy();
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
    return tabulate<1>(distribution.size(), [&](std::size_t i) {
        return distribution.probability(static_cast<std::uint32_t>(i));
    });
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
    return result ? Described<Transform>::write(*result) : nb::none();
}

} // namespace

void bind_statistics(nb::module_ &m) {
    nb::class_<LoneBsdf>(m, "Bsdf",
                         "A BSDF by itself, its textures constants: what the statistical tests see of it.")
        .def(nb::init<const nb::dict &>(), nb::arg("description"))
        .def_prop_ro("transmissive", &LoneBsdf::transmissive)
        .def_prop_ro("delta", &LoneBsdf::delta)
        .def_prop_ro("roughness", &LoneBsdf::roughness)
        .def("sample_many", &LoneBsdf::sample_many, nb::arg("wo"), nb::arg("u"),
             "Samples wi given wo (1 or N, 3), u (N, 3) = u_lobe, u.x, u.y in [0, 1): a dict of arrays wi "
             "(N, 3), "
             "weight (N, 3), pdf, eta, kind (0 diffuse, 1 glossy, 2 specular, 3 null) and valid (N,).")
        .def("eval_many", &LoneBsdf::eval_many, nb::arg("wo"), nb::arg("wi"),
             "Evaluates wo (1 or N, 3), wi (N, 3): f_cos (N, 3) and pdf (N,) per solid angle.");
    m.def("sampler_camera", &sampler_camera, nb::arg("kind"), nb::arg("seed"), nb::arg("x"), nb::arg("y"),
          nb::arg("first"), nb::arg("count"),
          "A pixel's camera numbers (count, 5): film x, y, lens x, y, flight.");
    m.def("sampler_blocks", &sampler_blocks, nb::arg("kind"), nb::arg("seed"), nb::arg("x"), nb::arg("y"),
          nb::arg("first"), nb::arg("count"), nb::arg("bounce"),
          "A pixel's numbers of one bounce (count, 8): light_uv x, y, bsdf_uv x, y, light, lobe, roulette, "
          "medium.");
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
    bind_scene_statistics(m);
    bind_media_statistics(m);
}

} // namespace lajolla
