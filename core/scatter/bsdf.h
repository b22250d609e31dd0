#pragma once
// The BSDF contract.
//
// A *model* is the stored declaration with its fields. `prepare<Float>(read)` reads its textures at one hit,
// or at those of all lanes, with `read(texture) -> value`, and returns a *lobe*: a small value with eval()
// and sample(). Lobes are templates over the number type (base/wide.h): values that differ between lanes are
// Float, those of the model are plain numbers or pointers. A model may also have a plain `Lobe` and
// `prepare(read)`; it is then evaluated one lane at a time.
//
// Directions are in the local frame (n = +z) and point away from the surface; `wo` is given, `wi` is sampled.
// Lobes that are not `transmissive` are called with wo.z > 0 only, except in inactive lanes. eval() returns
// the value times |cos wi| and the density per solid angle; both are zero for delta lobes. The density of the
// reverse direction is eval(wi, wo).pdf.
//
// Lobes do not contain the eta^2 that radiance gains at a refracting boundary: transport applies it once.

#include <array>
#include <cstdint>
#include <type_traits>
#include <variant>

#include "base/fields.h"
#include "base/frame.h"
#include "base/texture.h"
#include "base/vec.h"

namespace lajolla {

template <class Float>
struct BsdfEval {
    Rgb<Float> f_cos{0}; // BSDF times |cos(theta_i)|
    Float pdf = 0;       // per solid angle, of sampling wi given wo
    Float eta = 1;       // index of refraction beyond the boundary, as in BsdfSample
};

template <class Float>
struct BsdfSample {
    BoolOf<Float> valid = false; // if false, there is no sample, and the rest is undefined
    Vec3<Float> wi;
    Rgb<Float> weight; // f_cos / pdf
    Float pdf = 0;     // per solid angle; of delta samples the discrete probability of the branch
    Float eta = 1; // index of refraction beyond the boundary relative to that of wo's side; 1 for reflection
    BoolOf<Float> delta = false; // a single direction
    Float width = 1;             // widening of the ray's footprint: 0 for a mirror, 1 for a diffuse surface
};

// Light that passes straight through a surface. Lobes with such a component have `null_transmission(wo)`;
// their sample() selects it if u_lobe >= 1 - probability, so that transport can decide in advance.
template <class Float>
struct NullTransmission {
    Rgb<Float> transmittance{0}; // fraction of the light
    Float probability = 0;       // that a path passes; 0 only if transmittance is 0
};

template <class Float>
BsdfEval<Float> select(BoolOf<Float> m, const BsdfEval<Float> &a, const BsdfEval<Float> &b) {
    return {select(m, a.f_cos, b.f_cos), select(m, a.pdf, b.pdf), select(m, a.eta, b.eta)};
}
template <class Float>
BsdfSample<Float> select(BoolOf<Float> m, const BsdfSample<Float> &a, const BsdfSample<Float> &b) {
    return {select(m, a.valid, b.valid), select(m, a.wi, b.wi),   select(m, a.weight, b.weight),
            select(m, a.pdf, b.pdf),     select(m, a.eta, b.eta), select(m, a.delta, b.delta),
            select(m, a.width, b.width)};
}

// Properties of a model that transport needs before it prepares a lobe.
struct BsdfTraits {
    bool transmissive = false;                         // light passes through: wo.z < 0 is valid
    bool delta = false;                                // eval() is zero everywhere: light sampling is useless
    bool anisotropic = false;                          // depends on the direction of the tangent
    bool lambertian = false;                           // f is a constant
    bool null_transmission = false;                    // its lobes have null_transmission()
    const Texture<Spectrum> *diffuse_colour = nullptr; // for the albedo channel
};

// The texture reader that transport passes.
template <class Float>
struct AnyReader {
    Rgb<Float> operator()(const Texture<Spectrum> &) const;
    Float operator()(const Texture<float> &) const;
};

// A model whose lobes are templates over the number type.
template <class Model>
concept IsWide = requires(const Model &model) { model.template prepare<WideFloat>(AnyReader<WideFloat>()); };
// The same for all models of a variant.
template <class>
inline constexpr bool are_wide = false;
template <class... Model>
inline constexpr bool are_wide<std::variant<Model...>> = (IsWide<Model> && ...);

template <class Float, class Model, class Read>
auto prepare_lobe(const Model &model, const Read &read) {
    if constexpr (requires { model.template prepare<Float>(read); })
        return model.template prepare<Float>(read);
    else return model.prepare(read);
}
template <class Model, class Float>
using LobeOf = decltype(prepare_lobe<Float>(std::declval<const Model &>(), AnyReader<Float>()));

template <class Lobe, class Float>
concept IsLobe = std::is_trivially_destructible_v<Lobe> &&
                 requires(const Lobe &lobe, Vec3<Float> w, Float u, Vec2<Float> uv) {
                     { lobe.eval(w, w) } -> std::same_as<BsdfEval<Float>>;
                     { lobe.sample(w, u, uv) } -> std::same_as<BsdfSample<Float>>;
                     // In [0, 1], of the widest component: 1 if there is a diffuse one.
                     { lobe.roughness() } -> std::convertible_to<Float>;
                 };

template <class Model>
concept IsBsdf = IsLobe<LobeOf<Model, float>, float> && requires(const Model &model) {
    { model.traits() } -> std::same_as<BsdfTraits>;
};

} // namespace lajolla
