#pragma once
// Rough surfaces as statistics of tiny mirrors: the distribution of their normals and Smith's masking (Walter
// et al. 2007, "Microfacet Models for Refraction through Rough Surfaces"), with sampling of the visible
// normals (Heitz and d'Eon 2014).

#include <array>

#include "base/frame.h"
#include "base/vec.h"
#include "base/warp.h"
#include "scatter/fresnel.h"

namespace lajolla {

enum class MicrofacetKind { beckmann, ggx };
constexpr auto choices(MicrofacetKind) { return std::array{"beckmann", "ggx"}; }

namespace detail {

inline constexpr float inv_sqrt_pi = 0.56418958354775628695f;

template <std::size_t n>
constexpr float polynomial(float x, const float (&coefficients)[n]) { // the highest power first
    float sum = coefficients[0];
    for (std::size_t i = 1; i < n; ++i) sum = sum * x + coefficients[i];
    return sum;
}

// Giles 2010, "Approximating the erfinv function": single precision; the ends are kept finite.
inline float erf_inv(float x) {
    static constexpr float middle[]{2.81022636e-08f,  3.43273939e-07f, -3.5233877e-06f,
                                    -4.39150654e-06f, 0.00021858087f,  -0.00125372503f,
                                    -0.00417768164f,  0.246640727f,    1.50140941f};
    static constexpr float ends[]{-0.000200214257f, 0.000100950558f, 0.00134934322f,
                                  -0.00367342844f,  0.00573950773f,  -0.0076224613f,
                                  0.00943887047f,   1.00167406f,     2.83297682f};
    const float w = -std::log(std::max((1 - x) * (1 + x), 6e-8f));
    return x * (w < 5 ? polynomial(w - 2.5f, middle) : polynomial(std::sqrt(w) - 3, ends));
}

// exp(a^2) erfc(a) for a >= 0, within 1.5e-7 (Abramowitz and Stegun, 7.1.26).
inline float erfc_scaled(float a) {
    const float t = 1 / (1 + 0.3275911f * a);
    return t * polynomial(t, {1.061405429f, -1.453152027f, 1.421413741f, -0.284496736f, 0.254829592f});
}

// Twice the area that a Beckmann surface of roughness one shows under the angle theta, over that seen from
// above.
inline float beckmann_projection(float cot_theta) {
    if (cot_theta > 4) return 2;
    return 2 + std::exp(-cot_theta * cot_theta) * (inv_sqrt_pi / cot_theta - erfc_scaled(cot_theta));
}

// The slopes, along and across the direction, of a visible normal of a Beckmann surface of roughness one. The
// slope s along it has the density (1 - s / cot(theta)) exp(-s^2) for s < cot(theta). The linear factor is
// dealt with by parts: slopes within +-cot(theta) are drawn without it and s > 0 becomes -s with probability
// s / cot(theta); those below follow the tails of exp(-s^2) and of |s| exp(-s^2).
inline Vec2f sample_beckmann_slopes(Vec2f u, float cot_theta) {
    const float e = cot_theta > 4 ? 0 : std::exp(-cot_theta * cot_theta);
    const float tail = e * erfc_scaled(cot_theta) / 2, rim = e * inv_sqrt_pi / (2 * cot_theta);
    const float inner = 1 - 2 * tail; // erf(cot(theta))
    const float v = u.x * (inner + tail + rim);
    float along, across = 2 * u.y - 1; // in erf
    if (v < inner) {
        along = erf_inv(2 * v - inner);
        const float flip = std::max(along / cot_theta, 0.0f), size = std::abs(across);
        across = std::copysign(size < flip ? size / flip : (size - flip) / (1 - flip), across);
        along = size < flip ? -along : along;
    } else if (v < inner + tail) {
        along = erf_inv(inner - 2 * v);
    } else {
        const float beyond = (v - inner - tail) / rim;
        along = -std::sqrt(cot_theta * cot_theta - std::log(std::max(beyond, 1e-7f)));
    }
    return {along, erf_inv(across)};
}

} // namespace detail

// Directions are above the surface: w.z > 0. The roughness alpha_u is along the tangent s.
class Microfacet {
public:
    Microfacet(MicrofacetKind kind, float alpha_u, float alpha_v)
        : alpha_u_(std::max(alpha_u, 1e-4f)), alpha_v_(std::max(alpha_v, 1e-4f)), kind_(kind) {}

    MicrofacetKind kind() const { return kind_; }
    float smaller_alpha() const { return std::min(alpha_u_, alpha_v_); }
    float larger_alpha() const { return std::max(alpha_u_, alpha_v_); }
    // The roughness of the profile in the direction of w.
    float alpha_along(Vec3f w) const {
        const float sin2 = w.x * w.x + w.y * w.y;
        return sin2 > 0 ? std::sqrt((sqr(alpha_u_ * w.x) + sqr(alpha_v_ * w.y)) / sin2) : alpha_u_;
    }
    // An azimuth, as (cos, sin), where alpha_along() is at the fraction t from the smaller to the larger
    // alpha.
    Vec2f azimuth_of(float t) const {
        const float a = lerp(t, smaller_alpha(), larger_alpha()), difference = sqr(alpha_u_) - sqr(alpha_v_);
        const float cos2 = std::clamp((sqr(a) - sqr(alpha_v_)) / difference, 0.0f, 1.0f);
        return {std::sqrt(cos2), std::sqrt(1 - cos2)};
    }
    // For the footprint of a scattered ray.
    float roughness() const { return std::min(std::max(alpha_u_, alpha_v_), 1.0f); }

    // Density of normals: its integral times cos(theta_m) is one.
    float density(Vec3f m) const {
        const float slope2 = sqr(m.x / alpha_u_) + sqr(m.y / alpha_v_), cos2 = m.z * m.z;
        const float area = pi * alpha_u_ * alpha_v_;
        if (kind_ == MicrofacetKind::ggx) return 1 / (area * sqr(slope2 + cos2));
        return cos2 > 1e-16f ? std::exp(-slope2 / cos2) / (area * cos2 * cos2) : 0;
    }

    // Smith's G1: the fraction of the normals that face w and are not hidden from it.
    float masking(Vec3f w) const {
        const float sin2_alpha = sqr(alpha_u_ * w.x) + sqr(alpha_v_ * w.y);
        if (kind_ == MicrofacetKind::ggx) return 2 / (1 + std::sqrt(1 + sin2_alpha / (w.z * w.z)));
        return 2 / detail::beckmann_projection(w.z / std::sqrt(sin2_alpha));
    }

    // The density of visible normals, per solid angle of m, is visible(w, m) |dot(w, m)|.
    float visible(Vec3f w, Vec3f m) const { return density(m) * masking(w) / w.z; }

    Vec3f sample_visible(Vec3f w, Vec2f u) const {
        const Vec3f v = normalize({alpha_u_ * w.x, alpha_v_ * w.y, w.z}); // where the roughness is one
        const Vec3f m = kind_ == MicrofacetKind::ggx ? sample_ggx(v, u) : sample_beckmann(v, u);
        return normalize({alpha_u_ * m.x, alpha_v_ * m.y, m.z});
    }

    // Any normal, with the density density(m) cos(theta_m), of a Beckmann surface.
    Vec3f sample_all(Vec2f u) const {
        const float slope = std::sqrt(-std::log(1 - u.x)), phi = 2 * pi * u.y;
        return normalize({alpha_u_ * slope * std::cos(phi), alpha_v_ * slope * std::sin(phi), 1});
    }

    // The mean of f(m) over the microfacets of normal m that are visible from w, by the midpoint rule with
    // about n x n nodes. GGX: in the numbers that sample_visible() takes, with more nodes for its tail.
    // Beckmann: in slopes s, t along and across w, whose density is (cot - s) exp(-s^2 - t^2) for s < cot.
    template <class F>
    float mean_over_visible(Vec3f w, int n, const F &f) const;

private:
    // Half vectors of v and of a spherical cap (Dupuy and Benyoub 2023, "Sampling Visible GGX Normals with
    // Spherical Caps"). The height over the cap's rim is exact where 1 - u would cancel.
    static Vec3f sample_ggx(Vec3f v, Vec2f u) {
        const Vec3f cap = sample_cone(u, 1 + v.z);
        return {cap.x + v.x, cap.y + v.y, (1 - u.x) * (1 + v.z)};
    }
    static Vec3f sample_beckmann(Vec3f v, Vec2f u) {
        const float sin_theta = std::sqrt(v.x * v.x + v.y * v.y);
        return normal_of(v, detail::sample_beckmann_slopes(u, v.z / sin_theta));
    }
    // Of slopes along and across v, not normalized.
    static Vec3f normal_of(Vec3f v, Vec2f slope) {
        const float sin_theta = std::sqrt(v.x * v.x + v.y * v.y);
        const Vec2f phi = sin_theta > 0 ? Vec2f{v.x, v.y} * (1 / sin_theta) : Vec2f{1, 0};
        return {slope.y * phi.y - slope.x * phi.x, -slope.x * phi.y - slope.y * phi.x, 1};
    }

    float alpha_u_, alpha_v_;
    MicrofacetKind kind_;
};

template <class F>
float Microfacet::mean_over_visible(Vec3f w, int n, const F &f) const {
    constexpr float widest = 3.5f; // slope that counts
    const Vec3f v = normalize({alpha_u_ * w.x, alpha_v_ * w.y, w.z});
    const float cot = v.z / std::max(std::sqrt(v.x * v.x + v.y * v.y), 1e-6f),
                steepest = std::min(cot, widest);
    const bool half = w.y == 0; // symmetric across w: half is enough
    const int columns = half ? n / 2 : n;
    float sum = 0, weights = 0;
    for (int i = 0; i < n; ++i)
        for (int j = 0; j < columns; ++j) {
            const float x = (static_cast<float>(i) + 0.5f) / static_cast<float>(n),
                        y = (static_cast<float>(j) + 0.5f) / static_cast<float>(n);
            Vec3f m;
            float weight;
            if (kind_ == MicrofacetKind::ggx) {
                const float rest = 1 - x;
                weight = sqr(rest);
                m = sample_ggx(v, {1 - rest * weight, y});
            } else {
                const Vec2f slope{steepest - (steepest + widest) * sqr(x), (1 - 2 * y) * widest};
                weight = x * (1 - slope.x / cot) * std::exp(-sqr(slope.x) - sqr(slope.y));
                m = normal_of(v, slope);
            }
            sum += weight * f(normalize({alpha_u_ * m.x, alpha_v_ * m.y, m.z}));
            weights += weight;
        }
    return sum / weights;
}

namespace detail {

// Of the light along w on a boundary's microfacet m: what is reflected and transmitted in one bounce.
inline float reflected_fraction(const Microfacet &surface, Vec3f w, Vec3f m, float eta) {
    const Vec3f wi = reflect(w, m);
    return wi.z > 0 ? fresnel_dielectric(dot(w, m), eta).reflectance * surface.masking(wi) : 0;
}
inline float transmitted_fraction(const Microfacet &surface, Vec3f w, Vec3f m, float eta) {
    const auto [f, cos_t] = fresnel_dielectric(dot(w, m), eta);
    const Vec3f wi = -refract(w, m, dot(w, m), cos_t, eta);
    return wi.z > 0 ? (1 - f) * surface.masking(wi) : 0;
}

} // namespace detail

} // namespace lajolla
