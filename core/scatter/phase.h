#pragma once
// The phase function contract.
//
// A *model* is the stored declaration with its fields. `prepare(read)` reads its volumes at one point, with
// `read(volume) -> value`, and returns a *lobe*: a small value with eval() and sample().
//
// Directions have unit length, are in world space, and point away from the point; `wo` is given, `wi` is
// sampled. Unscattered light has wi = -wo. Phase functions are normalised and sampled exactly: eval() is both
// the value and the density of sample(), so samples have no weight.
//
// The projected area of particles that are not spheres depends on the direction. projected_area(wo)
// multiplies the medium's extinction (Jakob et al. 2010, "A radiative transfer framework for rendering
// materials with anisotropic structure"); projected_area(wo) eval(wo, wi) is reciprocal.

#include <cstdint>
#include <type_traits>

#include "base/fields.h"
#include "base/frame.h"
#include "base/vec.h"
#include "base/volume.h"

namespace lajolla {

struct PhaseSample {
    Vec3f wi;
    float pdf; // per solid angle: the value of the phase function
};

// A phase function by its index in the scene's list; -1 is isotropic scattering.
struct PhaseId {
    std::int32_t id = -1;
    friend constexpr bool operator==(PhaseId, PhaseId) = default;
};

template <class Lobe>
concept IsPhaseLobe = std::is_trivially_destructible_v<Lobe> && sizeof(Lobe) <= 32 &&
                      requires(const Lobe &lobe, Vec3f w, Vec2f u) {
                          { lobe.eval(w, w) } -> std::same_as<float>;
                          { lobe.sample(w, u) } -> std::same_as<PhaseSample>;
                          { lobe.projected_area(w) } -> std::same_as<float>;
                      };

// 1 - cos(theta) = |wo + wi|^2 / 2, with theta the angle of deflection. The cosine itself has no significant
// digits near one.
constexpr float deflection(Vec3f wo, Vec3f wi) { return length_squared(wo + wi) / 2; }

// The direction at 1 - cos(theta) = height from an axis, turned by u.
inline Vec3f direction_around(Vec3f axis, float height, float u) {
    const float r = safe_sqrt(height * (2 - height));
    const auto [sine, cosine] = sine_cosine(2 * pi * u);
    return frame_around(axis).to_world({r * cosine, r * sine, 1 - height});
}

} // namespace lajolla
