#pragma once
// What the models of the Disney family share (Burley 2012, "Physically Based Shading at Disney"; Burley 2015,
// "Extending the Disney BRDF to a BSDF with Integrated Subsurface Scattering"). Where the course notes leave
// a choice, the renderers that took them up differ; those differences are in the models.

#include <memory>
#include <stdexcept>
#include <string>

#include "scatter/bsdf.h"
#include "scatter/microfacet.h"
#include "scatter/multiscatter.h"

namespace lajolla::disney {

// Schlick 1994: what grazing angles add to the reflectance f0 at normal incidence, f0 + (1 - f0) weight.
constexpr float schlick_weight(float cosine) {
    const float m = std::clamp(1 - cosine, 0.0f, 1.0f);
    return sqr(sqr(m)) * m;
}
inline Spectrum schlick(Spectrum f0, float weight) { return f0 * (1 - weight) + Spectrum(weight); }
// Its mean over a cosine-weighted hemisphere, where the mean weight is 1/21, and at most one: colours may be
// more, and the series of bounces between facets that reflect more than one has no sum.
inline Spectrum schlick_mean(Spectrum f0, Spectrum f90 = Spectrum(1)) {
    return min(f0 * (20.0f / 21) + f90 * (1.0f / 21), Spectrum(1));
}

// Reflectance at normal incidence.
constexpr float reflectance_of_index(float eta) { return sqr((eta - 1) / (eta + 1)); }

// The index of refraction inside relative to outside, such that a rough boundary bends light. Throws
// std::invalid_argument where there is no such index.
inline float checked_index(float eta, bool refracts) {
    if (!(eta >= 1e-3f && eta <= 1e3f))
        throw std::invalid_argument("eta must be between 0.001 and 1000, not " + std::to_string(eta));
    return refracts && std::abs(eta - 1) < 1e-3f ? 1.001f : eta;
}

// What textures hold need not be a colour or a fraction.
constexpr Spectrum colour(Spectrum s) { return max(Spectrum(0), s); }
constexpr float fraction(float x) { return x >= 0 ? std::min(x, 1.0f) : 0; }

// The normal halfway between two directions, and its cosine with either.
struct Halfway {
    Vec3f m;
    float cosine;
};
inline Halfway halfway(Vec3f wo, Vec3f wi) {
    const Vec3f sum = wo + wi;
    const float l = length(sum);
    return {sum * (1 / l), l / 2};
}

// White and a base colour of luminance one, mixed: `white` + base * `hue`.
struct Tint {
    float white = 0, hue = 0;
    constexpr Tint(Spectrum base, float amount) {
        const float y = luminance(base);
        hue = y > 1e-12f ? amount / y : 0;
        white = y > 1e-12f ? 1 - amount : 1;
    }
    constexpr Tint operator*(float share) const {
        Tint scaled = *this;
        scaled.white *= share;
        scaled.hue *= share;
        return scaled;
    }
    constexpr Spectrum operator()(Spectrum base) const { return Spectrum(white) + base * hue; }
};

// Burley 2012, section 5.4: roughness is the square root of alpha, with a long axis along the tangent.
inline Microfacet microfacets(float roughness, float anisotropic, float least_alpha) {
    const float aspect = std::sqrt(1 - 0.9f * anisotropic), alpha = sqr(roughness);
    return {MicrofacetKind::ggx, std::max(alpha / aspect, least_alpha),
            std::max(alpha * aspect, least_alpha)};
}

// What such a surface loses where its facets reflect everything.
inline std::shared_ptr<const LostLight>
lost_by_reflection(const Texture<float> &roughness, const Texture<float> &anisotropic, float least_alpha) {
    return lajolla::lost_by_reflection(
        microfacets(fraction(roughness.constant), fraction(anisotropic.constant), least_alpha),
        !roughness.is_constant() || !anisotropic.is_constant());
}

// The diffuse shape, times pi: Burley 2012, section 5.3, with the retro-reflection of rough surfaces, and its
// flattened variant after Hanrahan and Krueger 1993 that looks like subsurface scattering. cos_d is the
// cosine between either direction and the one halfway.
inline float diffuse(float cos_o, float cos_i, float cos_d, float roughness, float flatness) {
    const float w_o = schlick_weight(cos_o), w_i = schlick_weight(cos_i);
    const float ss90 = roughness * sqr(cos_d), d90 = 0.5f + 2 * ss90;
    const float retro = lerp(w_o, 1.0f, d90) * lerp(w_i, 1.0f, d90);
    if (flatness == 0) return retro;
    const float ss = lerp(w_o, 1.0f, ss90) * lerp(w_i, 1.0f, ss90);
    const float flat = 1.25f * (ss * (1 / (cos_o + cos_i) - 0.5f) + 0.5f);
    return lerp(flatness, retro, flat);
}

// About what sheen scatters altogether, (1 - cos_d)^5 cos_i over the hemisphere: it steers choices only.
constexpr float sheen_albedo(float cos_o) { return 0.1f * sqr(1.05f - cos_o); }

// The second specular lobe with its wide tails: GTR1 normals (Burley 2012, appendix B) of alpha 0.1 to 0.001,
// and the masking of a GGX surface of alpha 0.25.
class Clearcoat {
public:
    explicit Clearcoat(float gloss) : alpha_(lerp(gloss, 0.1f, 0.001f)) {}

    float roughness() const { return alpha_; }

    // Its integral times cos(theta_m) is one.
    float density(Vec3f m) const {
        const float alpha2 = sqr(alpha_), sin2 = m.x * m.x + m.y * m.y;
        return (alpha2 - 1) * inv_pi / (std::log(alpha2) * (sin2 + alpha2 * m.z * m.z));
    }
    // With density density(m) cos(theta_m). The sine is what is exact near the normal.
    Vec3f sample(Vec2f u) const {
        const float alpha2 = sqr(alpha_);
        const float sin2 = std::min(alpha2 * std::expm1(-u.x * std::log(alpha2)) / (1 - alpha2), 1.0f);
        const float r = std::sqrt(sin2), phi = 2 * pi * u.y;
        return {r * std::cos(phi), r * std::sin(phi), std::sqrt(1 - sin2)};
    }
    // Schlick's reflectance of an interface of index 1.5.
    static float fresnel(float weight) { return lerp(weight, 0.04f, 1.0f); }
    static float masking(Vec3f w) {
        const float tan2 = (w.x * w.x + w.y * w.y) / (w.z * w.z);
        return 2 / (1 + std::sqrt(1 + sqr(0.25f) * tan2));
    }

private:
    float alpha_;
};

} // namespace lajolla::disney
