#pragma once
// The BSDF contract.
//
// A *model* is the stored declaration with its fields. `prepare<Float>(read)` reads its textures at one hit,
// or at those of all lanes, through `read(texture) -> value`, and gives a *lobe*: a small value that answers
// eval() and sample(). Lobes are templates over the number type (base/wide.h): what differs between lanes is
// a Float, what belongs to the model is a plain number or pointer. A model may also have a plain `Lobe` and
// `prepare(read)`; it is then run lane by lane.
//
// Directions are in the local frame (n = +z) and point away from the surface; `wo` is the known side, `wi`
// the generated side. Lobes that are not `transmissive` see wo.z > 0 only, but in lanes that are off. eval()
// is joint: the value times |cos wi| and the density per solid angle; both vanish for delta lobes. The
// density of the reverse direction is eval(wi, wo).pdf.
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
    BoolOf<Float> valid = false; // else there is no sample: the rest is meaningless
    Vec3<Float> wi;
    Rgb<Float> weight; // f_cos / pdf
    Float pdf = 0;     // per solid angle; of delta samples the discrete probability of the branch
    Float eta = 1; // index of refraction beyond the boundary relative to that of wo's side; 1 for reflection
    BoolOf<Float> delta = false; // a single direction
    Float width = 1; // how much the bounce widens a ray's footprint: 0 as a mirror, 1 as a diffuse surface
};

// Light that passes straight through, as if nothing were there. Lobes with such a part have
// `null_transmission(wo)`; their sample() takes that part for the last `probability` of u_lobe, so that
// transport may decide beforehand.
template <class Float>
struct NullTransmission {
    Rgb<Float> transmittance{0}; // how much of the light
    Float probability = 0;       // of a path doing so; 0 only where no light does
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

// What transport must know of a model before any of its lobes is made.
struct BsdfTraits {
    bool transmissive = false;      // light passes through: wo.z < 0 is meaningful
    bool delta = false;             // eval() is zero everywhere: light sampling is of no use
    bool anisotropic = false;       // it matters where the tangent points
    bool lambertian = false;        // f is a constant
    bool null_transmission = false; // its lobes have null_transmission()
    const Texture<Spectrum> *diffuse_colour = nullptr; // what stands for the colour of its diffuse part
};

// A texture reader as transport has it.
template <class Float>
struct AnyReader {
    Rgb<Float> operator()(const Texture<Spectrum> &) const;
    Float operator()(const Texture<float> &) const;
};

// A model whose lobes are templates over the number type.
template <class Model>
concept IsWide = requires(const Model &model) { model.template prepare<WideFloat>(AnyReader<WideFloat>()); };
// Whether all models of a variant are.
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
                     // In [0,1], of its widest part: 1 where there is a diffuse one.
                     { lobe.roughness() } -> std::convertible_to<Float>;
                 };

template <class Model>
concept IsBsdf = IsLobe<LobeOf<Model, float>, float> && requires(const Model &model) {
    { model.traits() } -> std::same_as<BsdfTraits>;
};

} // namespace lajolla
