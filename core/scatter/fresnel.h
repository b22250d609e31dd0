#pragma once
// Fresnel reflectance of smooth interfaces for unpolarized light.

#include <stdexcept>
#include <string>

#include "base/vec.h"

namespace lajolla {

// Reflection and refraction at a dielectric boundary.
template <class Float>
struct DielectricSplit {
    Float reflectance;
    Float cos_t; // of the refracted direction, positive; 0 under total internal reflection
};

// eta = n_transmitted / n_incident.
template <class Float>
DielectricSplit<Float> fresnel_dielectric(Float cos_i, std::type_identity_t<Float> eta) {
    const Float cos2_t = 1 - (1 - cos_i * cos_i) / (eta * eta), cos_t = sqrt(cos2_t);
    const Float r_s = (cos_i - eta * cos_t) / (cos_i + eta * cos_t);
    const Float r_p = (eta * cos_i - cos_t) / (eta * cos_i + cos_t);
    const auto refracts = cos2_t > 0.0f && cos_i > 0.0f;
    return {select(refracts, (r_s * r_s + r_p * r_p) / 2, Float(1)), select(refracts, cos_t, Float(0))};
}

// The direction into which w refracts at the normal m, where dot(w, m) = cos_i > 0. Normalized, because at
// small eta it is a difference of long vectors.
template <class Float>
Vec3<Float> refract(Vec3<Float> w, Vec3<Float> m, std::type_identity_t<Float> cos_i,
                    std::type_identity_t<Float> cos_t, std::type_identity_t<Float> eta) {
    const Float inv_eta = 1 / eta;
    return normalize(m * (cos_i * inv_eta - cos_t) - w * inv_eta);
}

// A metal with complex index eta + i k in vacuum (Born and Wolf, "Principles of Optics", 14.2, with
// a + i b = sqrt((eta + i k)^2 - sin^2)).
template <class Float>
Float fresnel_conductor(Float cos_i, std::type_identity_t<Float> eta, std::type_identity_t<Float> k) {
    const Float cos2 = cos_i * cos_i, sin2 = max(1 - cos2, Float(0));
    const Float real = eta * eta - k * k - sin2, imaginary = 2 * eta * k;
    const Float a2_b2 = sqrt(real * real + imaginary * imaginary);
    const Float larger = sqrt((a2_b2 + abs(real)) / 2); // of |a| and |b|: no cancellation
    const Float a = select(real >= 0.0f, larger, eta * k / larger);

    const Float s_sum = a2_b2 + cos2, s_difference = 2 * cos_i * a;
    const Float p_sum = a2_b2 * cos2 + sin2 * sin2, p_difference = s_difference * sin2;
    const auto ratio = [](Float sum, Float difference) { // 0/0 if eta = 1 and k = 0
        return max(sum - difference, Float(0)) /
               max(sum + difference, Float(std::numeric_limits<float>::min()));
    };
    const Float r_s = ratio(s_sum, s_difference);
    return r_s * (1 + ratio(p_sum, p_difference)) / 2;
}
template <class Float>
Rgb<Float> fresnel_conductor(Float cos_i, Rgb<Float> eta, Rgb<Float> k) {
    return {fresnel_conductor(cos_i, eta.x, k.x), fresnel_conductor(cos_i, eta.y, k.y),
            fresnel_conductor(cos_i, eta.z, k.z)};
}

// The mean of fresnel_conductor over a cosine-weighted hemisphere, by Gauss-Jacobi quadrature for the weight
// 2 cos (three nodes).
template <class Float>
Rgb<Float> fresnel_conductor_mean(Rgb<Float> eta, Rgb<Float> k) {
    return fresnel_conductor(Float(0.2123405382f), eta, k) * 0.1396539598f +
           fresnel_conductor(Float(0.5905331356f), eta, k) * 0.4584822128f +
           fresnel_conductor(Float(0.9114120405f), eta, k) * 0.4018638274f;
}

// The transmittance T of a boundary for diffuse light: 1 minus the mean of fresnel_dielectric over a
// cosine-weighted hemisphere. Fits of d'Eon and Irving 2011 for eta >= 1 (within 0.06 %) and of Egan and
// Hilgeman 1973 for eta in [0.5, 1) (within 0.6 %). For eta > 5, where those are inaccurate, a rational
// function of our own (within 0.2 %); for eta < 0.5 reciprocity, T(eta) = eta^2 T(1 / eta). T itself is
// fitted, because a fit of 1 - T would lose its digits for large ratios.
template <class Float>
constexpr Float fresnel_diffuse_transmittance(Float eta) {
    const Float r = 1 / eta, less = min(eta, r);
    const Float fit = 1 - polynomial(less, {-1.36881f, 4.98554f, -7.80989f, 6.75335f, -3.4793f, 0.919317f});
    const Float beyond = less * polynomial(less, {54.502375f, 346.190339f, 5.32677414f}) /
                         polynomial(less, {288.936651f, 73.6512111f, 1});
    const Float from_outside = select(less < 0.2f, beyond, fit);
    const Float from_inside = select(eta >= 0.5f, 0.3319f - 0.0636f * r - eta * (0.7099f - eta * 1.4399f),
                                     eta * eta * from_outside);
    return select(eta >= 1.0f, from_outside, from_inside);
}

// The range of indices of refraction and of their ratios.
inline constexpr float least_index = 1e-3f, largest_index = 1e3f;

// Throws std::invalid_argument if the indices or their ratio are out of range.
inline void check_indices(float int_ior, float ext_ior) {
    const float eta = int_ior / ext_ior;
    if (!(eta >= least_index && eta <= largest_index))
        throw std::invalid_argument("the ratio of int_ior and ext_ior must be between 0.001 and 1000; got " +
                                    std::to_string(int_ior) + " and " + std::to_string(ext_ior));
}

// The relative index of a rough boundary, kept away from 1 so that the facet's normal follows from both
// directions.
inline float bending_index(float eta) {
    if (abs(eta - 1) >= 1e-3f) return eta;
    return eta < 1 ? 0.999f : 1.001f;
}

} // namespace lajolla
