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

// Models without a base.
using BareBsdf = std::variant<Diffuse, Dielectric, ThinDielectric, RoughDielectric, Conductor, RoughConductor,
                              Plastic, RoughPlastic, Principled, PrincipledThin, DisneyBsdf, DisneyDiffuse,
                              DisneyMetal, DisneyGlass, DisneyClearcoat, DisneySheen, RoughDiffuse,
                              DiffuseTransmitter, Phong, Ward, Hair, Measured, Null>;

namespace detail {
// The variant of the lobes, without duplicates: models may share one.
template <class Variant, class... Lobes>
struct Distinct {
    using type = Variant;
};
template <class... Kept, class Next, class... Rest>
struct Distinct<std::variant<Kept...>, Next, Rest...>
    : std::conditional_t<(std::is_same_v<Kept, Next> || ...), Distinct<std::variant<Kept...>, Rest...>,
                         Distinct<std::variant<Kept..., Next>, Rest...>> {};

template <class, class Float>
struct LobesOf;
template <class... Model, class Float>
struct LobesOf<std::variant<Model...>, Float> {
    static_assert((IsBsdf<Model> && ...) && ((sizeof(LobeOf<Model, float>) <= 96) && ...));
    using type = Distinct<std::variant<>, LobeOf<Model, Float>...>::type;
};

template <class Variant, class Last>
struct With;
template <class... Models, class Last>
struct With<std::variant<Models...>, Last> {
    using type = std::variant<Models..., Last>;
};
} // namespace detail

template <class Float>
using BareLobe = detail::LobesOf<BareBsdf, Float>::type;

using Coating = CoatingOf<BareBsdf, BareLobe>;
using Bsdf = detail::With<BareBsdf, Coating>::type;

// A prepared lobe of any model, at one hit.
using Lobe = detail::With<BareLobe<float>, Coating::Lobe<float>>::type;
static_assert(IsBsdf<Coating> && sizeof(Coating::Lobe<float>) <= 176);

// These three are flattened, and take directions by reference: passing three floats by value to a function
// that is not inlined causes a store-forwarding stall each.
template <class Read>
[[gnu::flatten]] Lobe prepare(const Bsdf &bsdf, const Read &read) {
    return match(bsdf, [&](const auto &model) -> Lobe { return prepare_lobe<float>(model, read); });
}
[[gnu::flatten]] inline BsdfEval<float> eval(const Lobe &lobe, const Vec3f &wo, const Vec3f &wi) {
    return match(lobe, [&](const auto &l) { return l.eval(wo, wi); });
}
[[gnu::flatten]] inline BsdfSample<float> sample(const Lobe &lobe, const Vec3f &wo, float u_lobe,
                                                 const Vec2f &u) {
    return match(lobe, [&](const auto &l) { return l.sample(wo, u_lobe, u); });
}
inline float roughness(const Lobe &lobe) {
    return match(lobe, [](const auto &l) -> float { return l.roughness(); });
}
// The null transmission of a lobe, zero for most.
inline NullTransmission<float> null_transmission(const Lobe &lobe, const Vec3f &wo) {
    return match(lobe, [&](const auto &l) -> NullTransmission<float> {
        if constexpr (requires { l.null_transmission(wo); }) return l.null_transmission(wo);
        else return {};
    });
}
inline BsdfTraits traits(const Bsdf &bsdf) {
    return match(bsdf, [](const auto &model) { return model.traits(); });
}

} // namespace lajolla
