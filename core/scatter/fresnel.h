#pragma once
// Fresnel reflectance of smooth interfaces for unpolarized light.

#include <stdexcept>
#include <string>

#include "base/vec.h"

namespace lajolla {

// The two ways on at the boundary of two dielectrics.
struct DielectricSplit {
    float reflectance;
    float cos_t; // of the refracted direction, positive; 0 under total internal reflection
};

// eta is the index of refraction beyond the boundary relative to that on this side.
inline DielectricSplit fresnel_dielectric(float cos_i, float eta) {
    const float cos2_t = 1 - (1 - cos_i * cos_i) / (eta * eta);
    if (cos2_t <= 0 || cos_i <= 0) return {1, 0};
    const float cos_t = std::sqrt(cos2_t);
    const float r_s = (cos_i - eta * cos_t) / (cos_i + eta * cos_t);
    const float r_p = (eta * cos_i - cos_t) / (eta * cos_i + cos_t);
    return {(r_s * r_s + r_p * r_p) / 2, cos_t};
}

// The direction of transmission for w arriving around m, where dot(w, m) = cos_i > 0. Normalized: at small
// eta it is a difference of long vectors.
inline Vec3f refract(Vec3f w, Vec3f m, float cos_i, float cos_t, float eta) {
    const float inv_eta = 1 / eta;
    return normalize(m * (cos_i * inv_eta - cos_t) - w * inv_eta);
}

// A metal of complex index eta + i k, seen from vacuum (Born and Wolf, "Principles of Optics", 14.2; in the
// terms a, b of the complex root sqrt((eta + i k)^2 - sin^2) = a + i b).
inline float fresnel_conductor(float cos_i, float eta, float k) {
    const float cos2 = cos_i * cos_i, sin2 = std::max(1 - cos2, 0.0f);
    const float real = eta * eta - k * k - sin2, imaginary = 2 * eta * k;
    const float a2_b2 = std::sqrt(real * real + imaginary * imaginary);
    const float larger = std::sqrt((a2_b2 + std::abs(real)) / 2); // of |a| and |b|: no cancellation
    const float a = real >= 0 ? larger : eta * k / larger;

    const float s_sum = a2_b2 + cos2, s_difference = 2 * cos_i * a;
    const float p_sum = a2_b2 * cos2 + sin2 * sin2, p_difference = s_difference * sin2;
    const auto ratio = [](float sum, float difference) { // 0/0 where there is no interface: eta = 1, k = 0
        return std::max(sum - difference, 0.0f) /
               std::max(sum + difference, std::numeric_limits<float>::min());
    };
    const float r_s = ratio(s_sum, s_difference);
    return r_s * (1 + ratio(p_sum, p_difference)) / 2;
}
inline Spectrum fresnel_conductor(float cos_i, Spectrum eta, Spectrum k) {
    return {fresnel_conductor(cos_i, eta.x, k.x), fresnel_conductor(cos_i, eta.y, k.y),
            fresnel_conductor(cos_i, eta.z, k.z)};
}

// The mean of fresnel_conductor over a cosine-weighted hemisphere, by Gauss-Jacobi quadrature for the weight
// 2 cos (three nodes).
inline Spectrum fresnel_conductor_mean(Spectrum eta, Spectrum k) {
    return fresnel_conductor(0.2123405382f, eta, k) * 0.1396539598f +
           fresnel_conductor(0.5905331356f, eta, k) * 0.4584822128f +
           fresnel_conductor(0.9114120405f, eta, k) * 0.4018638274f;
}

// The mean of fresnel_dielectric over a cosine-weighted hemisphere: fits of Egan and Hilgeman 1973 for eta in
// [0.5, 1) (within 0.6 %; beyond that it would exceed 1) and of d'Eon and Irving 2011 for eta >= 1 (within
// 0.2 %). The two sides of a boundary are bound by reciprocity: 1 - F(eta) = eta^2 (1 - F(1 / eta)).
constexpr float fresnel_diffuse_reflectance(float eta) {
    const float r = 1 / eta;
    if (eta >= 1)
        return 0.919317f + r * (-3.4793f + r * (6.75335f + r * (-7.80989f + r * (4.98554f + r * -1.36881f))));
    if (eta >= 0.5f) return 0.0636f * r + 0.6681f + eta * (0.7099f - eta * 1.4399f);
    return 1 - eta * eta * (1 - fresnel_diffuse_reflectance(r));
}

// Throws std::invalid_argument where there is no such pair of dielectrics.
inline void check_indices(float int_ior, float ext_ior) {
    const float eta = int_ior / ext_ior;
    if (!(int_ior > 0 && ext_ior > 0 && eta >= 1e-3f && eta <= 1e3f))
        throw std::invalid_argument(
            "int_ior and ext_ior must be positive, their ratio between 0.001 and 1000; got " +
            std::to_string(int_ior) + " and " + std::to_string(ext_ior));
}

} // namespace lajolla
