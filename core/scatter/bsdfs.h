#pragma once
// The list of BSDFs. To add one: write its file, include it here and add its name to the list. The reader,
// the documentation and the statistical tests follow.

#include "base/match.h"
#include "scatter/bsdf.h"
#include "scatter/coating.h"
#include "scatter/conductor.h"
#include "scatter/dielectric.h"
#include "scatter/difftrans.h"
#include "scatter/diffuse.h"
#include "scatter/disneybsdf.h"
#include "scatter/disneyclearcoat.h"
#include "scatter/disneydiffuse.h"
#include "scatter/disneyglass.h"
#include "scatter/disneymetal.h"
#include "scatter/disneysheen.h"
#include "scatter/hair.h"
#include "scatter/measured.h"
#include "scatter/null.h"
#include "scatter/phong.h"
#include "scatter/plastic.h"
#include "scatter/principled.h"
#include "scatter/principledthin.h"
#include "scatter/roughconductor.h"
#include "scatter/roughdielectric.h"
#include "scatter/roughdiffuse.h"
#include "scatter/roughplastic.h"
#include "scatter/thindielectric.h"
#include "scatter/ward.h"

namespace lajolla {

// Those that stand by themselves.
using BareBsdf = std::variant<Diffuse, Dielectric, ThinDielectric, RoughDielectric, Conductor, RoughConductor,
                              Plastic, RoughPlastic, Principled, PrincipledThin, DisneyBsdf, DisneyDiffuse,
                              DisneyMetal, DisneyGlass, DisneyClearcoat, DisneySheen, RoughDiffuse,
                              DiffuseTransmitter, Phong, Ward, Hair, Measured, Null>;

namespace detail {
// The variant of the lobes, each of them once: models may share one.
template <class Variant, class... Lobes>
struct Distinct {
    using type = Variant;
};
template <class... Kept, class Next, class... Rest>
struct Distinct<std::variant<Kept...>, Next, Rest...>
    : std::conditional_t<(std::is_same_v<Kept, Next> || ...), Distinct<std::variant<Kept...>, Rest...>,
                         Distinct<std::variant<Kept..., Next>, Rest...>> {};

template <class>
struct LobesOf;
template <class... Model>
struct LobesOf<std::variant<Model...>> {
    static_assert((IsLobe<typename Model::Lobe> && ...));
    using type = Distinct<std::variant<>, typename Model::Lobe...>::type;
};
} // namespace detail

namespace detail {
template <class Variant, class Last>
struct With;
template <class... Models, class Last>
struct With<std::variant<Models...>, Last> {
    using type = std::variant<Models..., Last>;
};
} // namespace detail

using Coating = CoatingOf<BareBsdf, detail::LobesOf<BareBsdf>::type>;
using Bsdf = detail::With<BareBsdf, Coating>::type;

// A prepared lobe of any model.
using Lobe = detail::With<detail::LobesOf<BareBsdf>::type, Coating::Lobe>::type;
static_assert(sizeof(Coating::Lobe) <= 176);

// These three are flattened, and take directions by reference: passing three floats by value through a call
// that is not inlined costs a store-forwarding stall each.
template <class Read>
[[gnu::flatten]] Lobe prepare(const Bsdf &bsdf, const Read &read) {
    return match(bsdf, [&](const auto &model) -> Lobe { return model.prepare(read); });
}
[[gnu::flatten]] inline BsdfEval eval(const Lobe &lobe, const Vec3f &wo, const Vec3f &wi) {
    return match(lobe, [&](const auto &l) { return l.eval(wo, wi); });
}
[[gnu::flatten]] inline std::optional<BsdfSample> sample(const Lobe &lobe, const Vec3f &wo, float u_lobe,
                                                         const Vec2f &u) {
    return match(lobe, [&](const auto &l) { return l.sample(wo, u_lobe, u); });
}
// The parameter that stands for a BSDF's diffuse colour, where it has one.
template <class Read>
std::optional<Spectrum> diffuse_colour(const Bsdf &bsdf, const Read &read) {
    return match(bsdf, [&](const auto &model) -> std::optional<Spectrum> {
        if constexpr (requires { model.base_color; }) return read(model.base_color);
        else if constexpr (requires { model.diffuse_reflectance; }) return read(model.diffuse_reflectance);
        else if constexpr (requires { model.reflectance; }) return read(model.reflectance);
        else return std::nullopt;
    });
}
inline bool is_delta(const Bsdf &bsdf) {
    return match(bsdf, [](const auto &model) { return std::decay_t<decltype(model)>::Lobe::delta; });
}
inline float roughness(const Lobe &lobe) {
    return match(lobe, [](const auto &l) { return l.roughness(); });
}
// What passes straight through.
inline Passage passage(const Lobe &lobe, const Vec3f &wo) {
    return match(lobe, [&](const auto &l) -> Passage {
        if constexpr (requires { l.straight(wo); }) return l.straight(wo);
        else return {};
    });
}
inline bool lets_pass(const Bsdf &bsdf) {
    return match(bsdf, [](const auto &model) {
        return requires(const std::decay_t<decltype(model)>::Lobe &lobe) { lobe.straight(Vec3f()); };
    });
}
// Whether a BSDF does not care where the tangent points.
template <class Variant>
bool is_isotropic(const Variant &bsdf) {
    return match(bsdf, [](const auto &model) {
        if constexpr (requires { model.alpha_u; }) return model.alpha_u == model.alpha_v;
        else if constexpr (requires { model.anisotropic; }) return model.anisotropic == Texture<float>(0);
        else if constexpr (requires { model.base; }) return is_isotropic(model.base);
        else return !requires { model.uses_tangent; };
    });
}
// Whether light passes through: some models say so of their kind, others of their parameters.
inline bool is_transmissive(const Bsdf &bsdf) {
    return match(bsdf, [](const auto &model) {
        if constexpr (requires { model.transmissive(); }) return model.transmissive();
        else return std::decay_t<decltype(model)>::Lobe::transmissive;
    });
}

} // namespace lajolla
