#pragma once
// Rough surfaces as statistics of tiny mirrors: the distribution of their normals and Smith's masking (Walter
// et al. 2007, "Microfacet Models for Refraction through Rough Surfaces"), with sampling of the visible
// normals (Heitz and d'Eon 2014).

#include <array>

#include "base/vec.h"
#include "base/warp.h"

namespace lajolla {

enum class MicrofacetKind { beckmann, ggx };
constexpr auto choices(MicrofacetKind) { return std::array{"beckmann", "ggx"}; }

namespace detail {

inline constexpr float inv_sqrt_pi = 0.56418958354775628695f;

// Giles 2010, "Approximating the erfinv function": single precision; the ends are kept finite.
inline float erf_inv(float x) {
    const auto polynomial = [](float t, const std::array<float, 9> &coefficients) {
        float sum = 0;
        for (const float c : coefficients)
            sum = sum * t + c;
        return sum;
    };
    const float w = -std::log(std::max((1 - x) * (1 + x), 6e-8f));
    if (w < 5)
        return x * polynomial(w - 2.5f,
                              {2.81022636e-08f, 3.43273939e-07f, -3.5233877e-06f, -4.39150654e-06f,
                               0.00021858087f, -0.00125372503f, -0.00417768164f, 0.246640727f, 1.50140941f});
    return x * polynomial(std::sqrt(w) - 3,
                          {-0.000200214257f, 0.000100950558f, 0.00134934322f, -0.00367342844f, 0.00573950773f,
                           -0.0076224613f, 0.00943887047f, 1.00167406f, 2.83297682f});
}

// 1 + erf(a) + exp(-a^2) / (a sqrt(pi)): twice the area that a Beckmann surface of roughness one shows under
// tan(theta) = 1 / a, over its area seen from above.
inline float beckmann_projection(float a) {
    return a > 4 ? 2 : 1 + std::erf(a) + std::exp(-a * a) * inv_sqrt_pi / a;
}

// The slope, in the plane of the direction, of a visible normal of a Beckmann surface of roughness one:
// inverts the cumulative density 1 + x + tan(theta) exp(-slope^2) / sqrt(pi), x = erf(slope), which is
// concave in x, by Newton's method. The first guess is exact at theta = pi / 2 (Jakob 2014, "An Improved
// Visible Normal Sampling Routine for the Beckmann Distribution").
inline float sample_beckmann_slope(float u, float cot_theta) {
    const float tan_theta = 1 / cot_theta, top = std::erf(cot_theta), lowest = -1 + 6e-8f;
    const float target = u * beckmann_projection(cot_theta);
    float x = top - (1 + top) * std::erf(std::sqrt(-std::log(u)));
    for (int i = 0; i < 3; ++i) {
        const float slope = erf_inv(x);
        const float excess = 1 + x + tan_theta * inv_sqrt_pi * std::exp(-slope * slope) - target;
        x = std::clamp(x - excess / std::max(1 - slope * tan_theta, 1e-4f), lowest, top);
    }
    return erf_inv(x);
}

} // namespace detail

// Directions are above the surface: w.z > 0. The roughness alpha_u is along the tangent s.
class Microfacet {
public:
    Microfacet(MicrofacetKind kind, float alpha_u, float alpha_v)
        : alpha_u_(std::max(alpha_u, 1e-4f)), alpha_v_(std::max(alpha_v, 1e-4f)), kind_(kind) {}

    // For the footprint of a scattered ray.
    float roughness() const { return std::min(std::max(alpha_u_, alpha_v_), 1.0f); }

    // Density of normals: its integral times cos(theta_m) is one.
    float density(Vec3f m) const {
        const float slope2 = sqr(m.x / alpha_u_) + sqr(m.y / alpha_v_), cos2 = m.z * m.z;
        const float area = pi * alpha_u_ * alpha_v_;
        if (kind_ == MicrofacetKind::ggx)
            return 1 / (area * sqr(slope2 + cos2));
        return cos2 > 1e-16f ? std::exp(-slope2 / cos2) / (area * cos2 * cos2) : 0;
    }

    // Smith's G1: the fraction of the normals that face w and are not hidden from it.
    float masking(Vec3f w) const {
        const float sin2_alpha = sqr(alpha_u_ * w.x) + sqr(alpha_v_ * w.y);
        if (kind_ == MicrofacetKind::ggx)
            return 2 / (1 + std::sqrt(1 + sin2_alpha / (w.z * w.z)));
        return 2 / detail::beckmann_projection(w.z / std::sqrt(sin2_alpha));
    }

    // The density of visible normals, per solid angle of m, is visible(w, m) |dot(w, m)|.
    float visible(Vec3f w, Vec3f m) const { return density(m) * masking(w) / w.z; }

    Vec3f sample_visible(Vec3f w, Vec2f u) const {
        const Vec3f v = normalize({alpha_u_ * w.x, alpha_v_ * w.y, w.z}); // where the roughness is one
        const Vec3f m = kind_ == MicrofacetKind::ggx ? sample_ggx(v, u) : sample_beckmann(v, u);
        return normalize({alpha_u_ * m.x, alpha_v_ * m.y, m.z});
    }

private:
    // Half vectors of v and of a spherical cap (Dupuy and Benyoub 2023, "Sampling Visible GGX Normals with
    // Spherical Caps"). The height over the cap's rim is exact where 1 - u would cancel.
    static Vec3f sample_ggx(Vec3f v, Vec2f u) {
        const Vec3f cap = sample_cone(u, 1 + v.z);
        return {cap.x + v.x, cap.y + v.y, (1 - u.x) * (1 + v.z)};
    }
    static Vec3f sample_beckmann(Vec3f v, Vec2f u) {
        const float sin_theta = std::sqrt(v.x * v.x + v.y * v.y);
        const Vec2f phi = sin_theta > 0 ? Vec2f{v.x, v.y} * (1 / sin_theta) : Vec2f{1, 0};
        const float along = detail::sample_beckmann_slope(u.x, v.z / sin_theta);
        const float across = detail::erf_inv(2 * u.y - 1);
        return {across * phi.y - along * phi.x, -along * phi.y - across * phi.x, 1};
    }

    float alpha_u_, alpha_v_;
    MicrofacetKind kind_;
};

} // namespace lajolla
