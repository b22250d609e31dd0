// BSDFs by themselves, outside of scenes.

#include "python/bindings.h"

#include <algorithm>

#include "engine/described.h"
#include "geometry/hit.h"
#include "python/arrays.h"
#include "python/values.h"
#include "scatter/bsdfs.h"

namespace lajolla {

namespace {

// A BSDF by itself, outside a scene: its textures are constants.
struct ConstantReader {
    template <class T>
    static const T &value(const Texture<T> &texture) {
        if (!texture.is_constant())
            throw DescriptionError("bsdf: outside a scene textures must be constants");
        return texture.constant;
    }
    const Spectrum &operator()(const Texture<Spectrum> &texture) const { return value(texture); }
    float operator()(const Texture<float> &texture) const { return value(texture); }
};

// All of it is asked in lanes where the model has them, the last packet with some lanes off, or one by one.
class LoneBsdf {
public:
    explicit LoneBsdf(const nb::dict &description)
        : model_(variant_from<Bsdf>(description, "bsdf")), lobe_(prepare(model_, ConstantReader())) {}
    LoneBsdf(const LoneBsdf &) = delete; // the lobe may point to tables of the model
    LoneBsdf &operator=(const LoneBsdf &) = delete;

    bool transmissive() const { return traits(model_).transmissive; }
    bool delta() const { return traits(model_).delta; }
    float roughness() const { return lajolla::roughness(lobe_); }
    bool wide() const {
        return match(model_, [](const auto &model) { return IsWide<std::decay_t<decltype(model)>>; });
    }

    nb::dict sample_many(const Rows<3> &wo, const Rows<3> &u, bool one_lane) const;
    nb::tuple eval_many(const Rows<3> &wo, const Rows<3> &wi, bool one_lane) const;

private:
    // f(first row, rows, lobe of all lanes) for packets of rows; false where the model has no such lobe.
    template <class F>
    bool in_lanes(std::size_t rows, F &&f) const {
        return match(model_, [&](const auto &model) {
            if constexpr (IsWide<std::decay_t<decltype(model)>>) {
                const auto lobe = model.template prepare<WideFloat>([](const auto &texture) {
                    const auto value = ConstantReader()(texture);
                    if constexpr (std::is_same_v<decltype(value), const float>) return WideFloat(value);
                    else return Rgb<WideFloat>(value);
                });
                for (std::size_t i = 0; i < rows; i += lanes)
                    f(i, std::min(rows - i, static_cast<std::size_t>(lanes)), lobe);
                return true;
            } else return false;
        });
    }

    Bsdf model_;
    Lobe lobe_;
};

// Rows of an array, or its only one, as lanes.
Vec3<WideFloat> rows_of(const Rows<3> &array, std::size_t first, std::size_t count) {
    Vec3<WideFloat> result;
    for (std::size_t k = 0; k < lanes; ++k)
        set_lane(result, static_cast<int>(k),
                 triple(array, array.shape(0) == 1 ? 0 : first + std::min(k, count - 1)));
    return result;
}

nb::dict LoneBsdf::sample_many(const Rows<3> &wo, const Rows<3> &u, bool one_lane) const {
    const std::size_t n = u.shape(0);
    require_one_or(wo.shape(0), n, "wo");
    Table<float, 3> wi(n), weight(n);
    Table<float, 1> pdf(n), eta(n), width(n);
    Table<bool, 1> valid(n), delta(n);
    const auto set_invalid = [&](std::size_t i) {
        wi.set(i, Vec3f(0)), weight.set(i, Vec3f(0));
        pdf.set(i, 0.0f), eta.set(i, 0.0f), width.set(i, 0.0f), delta.set(i, false);
    };
    const auto set = [&](std::size_t i, const BsdfSample<float> &s) {
        valid.set(i, s.valid);
        if (!s.valid) return set_invalid(i);
        wi.set(i, s.wi);
        weight.set(i, s.weight);
        pdf.set(i, s.pdf);
        eta.set(i, s.eta);
        width.set(i, s.width);
        delta.set(i, s.delta);
    };
    const bool done = !one_lane && in_lanes(n, [&](std::size_t first, std::size_t count, const auto &lobe) {
        const Vec3<WideFloat> numbers = rows_of(u, first, count);
        const auto s =
            lobe.sample(rows_of(wo, first, count), numbers.x, Vec2<WideFloat>{numbers.y, numbers.z});
        for (int k = 0; k < static_cast<int>(count); ++k)
            set(first + static_cast<std::size_t>(k),
                {s.valid.v[k] != 0, lane_of(s.wi, k), lane_of(s.weight, k), s.pdf[k], s.eta[k],
                 s.delta.v[k] != 0, s.width[k]});
    });
    for (std::size_t i = 0; i < n && !done; ++i)
        set(i, sample(lobe_, triple(wo, i), u(i, 0), {u(i, 1), u(i, 2)}));
    nb::dict result;
    result["wi"] = std::move(wi).to_numpy();
    result["weight"] = std::move(weight).to_numpy();
    result["pdf"] = std::move(pdf).to_numpy();
    result["eta"] = std::move(eta).to_numpy();
    result["width"] = std::move(width).to_numpy();
    result["delta"] = std::move(delta).to_numpy();
    result["valid"] = std::move(valid).to_numpy();
    return result;
}

nb::tuple LoneBsdf::eval_many(const Rows<3> &wo, const Rows<3> &wi, bool one_lane) const {
    const std::size_t n = wi.shape(0);
    require_one_or(wo.shape(0), n, "wo");
    Table<float, 3> f_cos(n);
    Table<float, 1> pdf(n);
    const auto set = [&](std::size_t i, const Spectrum &f, float density) {
        f_cos.set(i, f);
        pdf.set(i, density);
    };
    const bool done = !one_lane && in_lanes(n, [&](std::size_t first, std::size_t count, const auto &lobe) {
        const auto e = lobe.eval(rows_of(wo, first, count), rows_of(wi, first, count));
        for (int k = 0; k < static_cast<int>(count); ++k)
            set(first + static_cast<std::size_t>(k), lane_of(e.f_cos, k), e.pdf[k]);
    });
    for (std::size_t i = 0; i < n && !done; ++i) {
        const BsdfEval<float> e = eval(lobe_, triple(wo, i), triple(wi, i));
        set(i, e.f_cos, e.pdf);
    }
    return nb::make_tuple(std::move(f_cos).to_numpy(), std::move(pdf).to_numpy());
}

} // namespace

void bind_bsdfs(nb::module_ &m) {
    nb::class_<LoneBsdf>(m, "Bsdf", "A BSDF by itself; its textures are constants.")
        .def(nb::init<const nb::dict &>(), nb::arg("description"))
        .def_prop_ro("transmissive", &LoneBsdf::transmissive)
        .def_prop_ro("delta", &LoneBsdf::delta)
        .def_prop_ro("roughness", &LoneBsdf::roughness)
        .def_prop_ro("wide", &LoneBsdf::wide, "Whether it is computed in the lanes of vectors.")
        .def("sample_many", &LoneBsdf::sample_many, nb::arg("wo"), nb::arg("u"), nb::arg("one_lane") = false,
             "Samples wi given wo (1 or N, 3), u (N, 3) = u_lobe, u.x, u.y in [0, 1): a dict of arrays wi "
             "(N, 3), "
             "weight (N, 3), pdf, eta, width, delta and valid (N,).")
        .def("eval_many", &LoneBsdf::eval_many, nb::arg("wo"), nb::arg("wi"), nb::arg("one_lane") = false,
             "Evaluates wo (1 or N, 3), wi (N, 3): f_cos (N, 3) and pdf (N,) per solid angle.");
}

} // namespace lajolla
