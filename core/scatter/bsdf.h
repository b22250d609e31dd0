#pragma once
// The BSDF contract.
//
// A *model* is the stored declaration with its fields. `prepare(read)` reads its textures at one hit, through
// `read(texture) -> value`, and gives a *lobe*: a small value that answers eval() and sample().
//
// Directions are in the local frame (n = +z) and point away from the surface; `wo` is the known side, `wi`
// the generated side. Lobes that are not `transmissive` see wo.z > 0 only. eval() is joint: the value times
// |cos wi| and the density per solid angle; both vanish for delta lobes. The density of the reverse direction
// is eval(wi, wo).pdf.
//
// Lobes do not contain the eta^2 that radiance gains at a refracting boundary: transport applies it once.

#include <array>
#include <cstdint>
#include <optional>
#include <type_traits>

#include "base/fields.h"
#include "base/frame.h"
#include "base/texture.h"
#include "base/vec.h"

namespace lajolla {

enum class ScatterKind : std::uint8_t {
    diffuse,  // smooth over the hemisphere
    glossy,   // a finite lobe around a direction
    specular, // a single direction
    null      // straight through, as if nothing were there
};

struct BsdfEval {
    Spectrum f_cos{0}; // BSDF times |cos(theta_i)|
    float pdf = 0;     // per solid angle, of sampling wi given wo
    float eta = 1;     // index of refraction beyond the boundary, as in BsdfSample
};

struct BsdfSample {
    Vec3f wi;
    Spectrum weight; // f_cos / pdf
    float pdf;       // per solid angle; for specular and null kinds the discrete probability of the branch
    float eta = 1; // index of refraction beyond the boundary relative to that of wo's side; 1 for reflection
    ScatterKind kind = ScatterKind::diffuse;
    float roughness = 1; // of glossy kinds, in [0,1]

    // How much the bounce widens a ray's footprint, in [0,1].
    float width() const { return kind == ScatterKind::glossy ? roughness : is_delta() ? 0.0f : 1.0f; }
    bool is_delta() const { return kind == ScatterKind::specular || kind == ScatterKind::null; }
};

// Light that passes straight through. Lobes with a part of the kind `null` have `straight(wo) -> Passage`;
// their sample() takes that part for the last `probability` of u_lobe, so that transport may decide
// beforehand.
struct Passage {
    Spectrum transmitted{0}; // how much of the light
    float probability = 0;   // of a path doing so; 0 only where no light does
};

constexpr float cos_theta(Vec3f w) { return w.z; }

template <class Lobe>
concept IsLobe = std::is_trivially_destructible_v<Lobe> && sizeof(Lobe) <= 96 &&
                 requires(const Lobe &lobe, Vec3f w, float u, Vec2f uv) {
                     { lobe.eval(w, w) } -> std::same_as<BsdfEval>;
                     { lobe.sample(w, u, uv) } -> std::same_as<std::optional<BsdfSample>>;
                     { Lobe::transmissive } -> std::convertible_to<bool>;
                     {
                         Lobe::delta
                     } -> std::convertible_to<bool>; // eval() is zero everywhere: light sampling is of no use
                     {
                         lobe.roughness()
                     } -> std::same_as<float>; // in [0,1], of its widest part: 1 where there is a diffuse one
                 };

} // namespace lajolla
