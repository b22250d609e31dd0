#pragma once
// Microfacets: distribution of normals, Smith's masking (Walter et al. 2007, "Microfacet Models for
// Refraction through Rough Surfaces"), and sampling of visible normals (Heitz and d'Eon 2014).

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

// Giles 2010, "Approximating the erfinv function": single precision, for w = -log(1 - x^2).
template <class Float>
Float erf_inv(Float x, Float w) {
    static constexpr float middle[]{2.81022636e-08f,  3.43273939e-07f, -3.5233877e-06f,
                                    -4.39150654e-06f, 0.00021858087f,  -0.00125372503f,
                                    -0.00417768164f,  0.246640727f,    1.50140941f};
    static constexpr float ends[]{-0.000200214257f, 0.000100950558f, 0.00134934322f,
                                  -0.00367342844f,  0.00573950773f,  -0.0076224613f,
                                  0.00943887047f,   1.00167406f,     2.83297682f};
    const auto at_end = w >= 5.0f;
    Float ratio = polynomial(w - 2.5f, middle);
    if (any(at_end)) ratio = select(at_end, polynomial(sqrt(w) - 3, ends), ratio); // for 1 in 300
    return x * ratio;
}
// 1 - x^2, so that the ends of erf_inv stay finite.
template <class Float>
Float erf_inv_argument(Float x) {
    return max((1 - x) * (1 + x), Float(6e-8f));
}

// exp(a^2) erfc(a) for a >= 0, within 1.5e-7 (Abramowitz and Stegun, 7.1.26).
template <class Float>
Float erfc_scaled(Float a) {
    const Float t = 1 / (1 + 0.3275911f * a);
    return t * polynomial(t, {1.061405429f, -1.453152027f, 1.421413741f, -0.284496736f, 0.254829592f});
}

// Twice the projected area of a Beckmann surface of roughness one at the angle theta, over that at normal
// incidence.
template <class Float>
Float beckmann_projection(Float cot_theta) {
    const auto flat = cot_theta > 4.0f;
    if (all(flat)) return 2;
    return select(flat, Float(2),
                  2 + exp(-cot_theta * cot_theta) * (inv_sqrt_pi / cot_theta - erfc_scaled(cot_theta)));
}

// The slopes, along and across the direction, of a visible normal of a Beckmann surface of roughness one. The
// slope s along it has the density (1 - s / cot(theta)) exp(-s^2) for s < cot(theta). It is sampled in parts:
// |s| < cot(theta) without the linear factor, then s > 0 becomes -s with probability s / cot(theta); lower
// slopes follow the tails of exp(-s^2) and of |s| exp(-s^2).
template <class Float>
Vec2<Float> sample_beckmann_slopes(const Vec2<Float> &u, Float cot_theta) {
    const Float e = select(cot_theta > 4.0f, Float(0), exp(-cot_theta * cot_theta));
    const Float tail = e * erfc_scaled(cot_theta) / 2, rim = e * inv_sqrt_pi / (2 * cot_theta);
    const Float inner = 1 - 2 * tail; // erf(cot(theta))
    const Float v = u.x * (inner + tail + rim);
    const auto is_inner = v < inner, is_rim = v >= inner + tail;

    // Two of the three parts invert an error function; the last one needs only a logarithm.
    const Float x = select(is_inner, 2 * v - inner, inner - 2 * v);
    const Float beyond = max((v - inner - tail) / rim, Float(1e-7f));
    const Float w = -log(select(is_rim, beyond, erf_inv_argument(x)));
    const Float along = select(is_rim, -sqrt(cot_theta * cot_theta + w), erf_inv(x, w));

    // In the outer parts the slope is negative already.
    const Float flip = max(along / cot_theta, Float(0)), signed_size = 2 * u.y - 1, size = abs(signed_size);
    const auto flipped = size < flip;
    const Float across =
        copysign(select(flipped, size, size - flip) / select(flipped, flip, 1 - flip), signed_size); // in erf
    return {select(flipped, -along, along), erf_inv(across, -log(erf_inv_argument(across)))};
}

} // namespace detail

// Directions are above the surface: w.z > 0. The roughness alpha_u is along the tangent s.
template <class Float>
class Microfacet {
public:
    Microfacet(MicrofacetKind kind, Float alpha_u, Float alpha_v)
        : alpha_u_(max(alpha_u, Float(1e-4f))), alpha_v_(max(alpha_v, Float(1e-4f))), kind_(kind) {}

    MicrofacetKind kind() const { return kind_; }
    Float smaller_alpha() const { return min(alpha_u_, alpha_v_); }
    Float larger_alpha() const { return max(alpha_u_, alpha_v_); }
    // The roughness of the profile in the direction of w.
    Float alpha_along(const Vec3<Float> &w) const {
        const Float sin2 = w.x * w.x + w.y * w.y;
        return select(sin2 > 0.0f, sqrt((sqr(alpha_u_ * w.x) + sqr(alpha_v_ * w.y)) / sin2), alpha_u_);
    }
    // An azimuth, as (cos, sin), where alpha_along() is at the fraction t from the smaller to the larger
    // alpha.
    Vec2<Float> azimuth_of(Float t) const {
        const Float a = lerp(t, smaller_alpha(), larger_alpha()), difference = sqr(alpha_u_) - sqr(alpha_v_);
        const Float cos2 = clamp((sqr(a) - sqr(alpha_v_)) / difference, 0.0f, 1.0f);
        return {sqrt(cos2), sqrt(1 - cos2)};
    }
    // In [0, 1], for the footprint of a scattered ray.
    Float roughness() const { return min(larger_alpha(), Float(1)); }

    // Density of normals D(m): the integral of D(m) cos(theta_m) is one.
    Float density(const Vec3<Float> &m) const {
        const Float slope2 = sqr(m.x / alpha_u_) + sqr(m.y / alpha_v_), cos2 = m.z * m.z;
        const Float area = pi * alpha_u_ * alpha_v_;
        if (kind_ == MicrofacetKind::ggx) return 1 / (area * sqr(slope2 + cos2));
        return select(cos2 > 1e-16f, exp(-slope2 / cos2) / (area * cos2 * cos2), Float(0));
    }

    // Smith's G1: the fraction of the normals facing w that are visible from w.
    Float masking(const Vec3<Float> &w) const {
        const Float sin2_alpha = sqr(alpha_u_ * w.x) + sqr(alpha_v_ * w.y);
        if (kind_ == MicrofacetKind::ggx) return 2 / (1 + sqrt(1 + sin2_alpha / (w.z * w.z)));
        return 2 / detail::beckmann_projection(w.z / sqrt(sin2_alpha));
    }

    // The density of visible normals, per solid angle of m, is visible(w, m) |dot(w, m)|.
    Float visible(const Vec3<Float> &w, const Vec3<Float> &m) const { return density(m) * masking(w) / w.z; }

    Vec3<Float> sample_visible(const Vec3<Float> &w, const Vec2<Float> &u) const {
        const Vec3<Float> v = stretched(w),
                          m = kind_ == MicrofacetKind::ggx ? sample_ggx(v, u) : sample_beckmann(v, u);
        return stretched(m);
    }

    // A normal of a Beckmann surface with the density D(m) cos(theta_m).
    Vec3<Float> sample_all(const Vec2<Float> &u) const {
        const Float slope = sqrt(-log(1 - u.x));
        const auto [sine, cosine] = sine_cosine(2 * pi * u.y);
        return normalize(Vec3<Float>{alpha_u_ * slope * cosine, alpha_v_ * slope * sine, 1});
    }

    // The mean of f(m) over the microfacets of normal m that are visible from w, by the midpoint rule with
    // about n x n nodes. GGX: over the random numbers of sample_visible(), with more nodes for its tail.
    // Beckmann: in slopes s, t along and across w, whose density is (cot - s) exp(-s^2 - t^2) for s < cot.
    template <class F>
        requires std::is_same_v<Float, float>
    float mean_over_visible(Vec3f w, int n, const F &f) const;

private:
    // Transforms a direction to a surface of roughness one, and a normal back.
    Vec3<Float> stretched(const Vec3<Float> &w) const {
        return normalize(Vec3<Float>{alpha_u_ * w.x, alpha_v_ * w.y, w.z});
    }
    // Half vectors of v and of a spherical cap (Dupuy and Benyoub 2023, "Sampling Visible GGX Normals with
    // Spherical Caps"). Computes the height over the cap's rim, because 1 - u would cancel.
    static Vec3<Float> sample_ggx(const Vec3<Float> &v, const Vec2<Float> &u) {
        const Vec3<Float> cap = sample_cone(u, 1 + v.z);
        return {cap.x + v.x, cap.y + v.y, (1 - u.x) * (1 + v.z)};
    }
    static Vec3<Float> sample_beckmann(const Vec3<Float> &v, const Vec2<Float> &u) {
        const Float sin_theta = sqrt(v.x * v.x + v.y * v.y);
        return normal_of(v, detail::sample_beckmann_slopes(u, v.z / sin_theta));
    }
    // The normal for slopes along and across v, not normalized.
    static Vec3<Float> normal_of(const Vec3<Float> &v, const Vec2<Float> &slope) {
        const Float sin_theta = sqrt(v.x * v.x + v.y * v.y);
        const Vec2<Float> phi =
            select(sin_theta > 0.0f, Vec2<Float>{v.x, v.y} * (1 / sin_theta), Vec2<Float>{1, 0});
        return {slope.y * phi.y - slope.x * phi.x, -slope.x * phi.y - slope.y * phi.x, 1};
    }

    Float alpha_u_, alpha_v_;
    MicrofacetKind kind_;
};

template <class Float>
template <class F>
    requires std::is_same_v<Float, float>
float Microfacet<Float>::mean_over_visible(Vec3f w, int n, const F &f) const {
    constexpr float widest = 3.5f; // largest slope
    const Vec3f v = stretched(w);
    const float cot = v.z / max(sqrt(v.x * v.x + v.y * v.y), 1e-6f), steepest = min(cot, widest);
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
                weight = x * (1 - slope.x / cot) * exp(-sqr(slope.x) - sqr(slope.y));
                m = normal_of(v, slope);
            }
            sum += weight * f(stretched(m));
            weights += weight;
        }
    return sum / weights;
}

namespace detail {

// The light along w that a boundary's microfacet m reflects and transmits in one bounce.
inline float reflected_fraction(const Microfacet<float> &surface, Vec3f w, Vec3f m, float eta) {
    const Vec3f wi = reflect(w, m);
    return wi.z > 0 ? fresnel_dielectric(dot(w, m), eta).reflectance * surface.masking(wi) : 0;
}
// Reflection with wi and wo above a rough boundary: the value times cos(wi), and the density of sampling
// visible normals.
template <class Float>
struct FacetReflection {
    Float value, density;
};
template <class Float>
FacetReflection<Float> reflected_by_facets(const Microfacet<Float> &surface, const Vec3<Float> &wo,
                                           const Vec3<Float> &wi, std::type_identity_t<Float> eta) {
    const Vec3<Float> m = normalize(wo + wi);
    const Float density = surface.visible(wo, m) / 4;
    return {fresnel_dielectric(dot(wo, m), eta).reflectance * density * surface.masking(wi), density};
}
inline float transmitted_fraction(const Microfacet<float> &surface, Vec3f w, Vec3f m, float eta) {
    const auto [f, cos_t] = fresnel_dielectric(dot(w, m), eta);
    const Vec3f wi = -refract(w, m, dot(w, m), cos_t, eta);
    return wi.z > 0 ? (1 - f) * surface.masking(wi) : 0;
}

} // namespace detail

} // namespace lajolla
