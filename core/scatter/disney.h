#pragma once
// Functions shared by Disney's models (Burley 2012, "Physically Based Shading at Disney"; Burley 2015,
// "Extending the Disney BRDF to a BSDF with Integrated Subsurface Scattering"). Renderers interpret these
// notes differently; the differences are in the models.

#include <memory>

#include "scatter/bsdf.h"
#include "scatter/microfacet.h"
#include "scatter/multiscatter.h"

namespace lajolla::disney {

// The weight in Schlick's approximation (1994): F = f0 + (1 - f0) weight, f0 at normal incidence.
template <class Float>
Float schlick_weight(Float cosine) {
    const Float m = clamp(1 - cosine, 0.0f, 1.0f);
    return sqr(sqr(m)) * m;
}
template <class Float>
Rgb<Float> schlick(const Rgb<Float> &f0, Float weight) {
    return f0 * (1 - weight) + Rgb<Float>(weight);
}
// The mean of F over a cosine-weighted hemisphere, where the mean weight is 1/21. At most one: colours may
// exceed it, and the series of bounces between facets would diverge.
template <class Float>
Rgb<Float> schlick_mean(const Rgb<Float> &f0, const Rgb<Float> &f90 = Rgb<Float>(1)) {
    return min(f0 * (20.0f / 21) + f90 * (1.0f / 21), Rgb<Float>(1));
}

// Reflectance at normal incidence.
template <class Float>
Float reflectance_of_index(Float eta) {
    return sqr((eta - 1) / (eta + 1));
}

// Textures may contain values that are not colours or fractions. NaN becomes 0, the first operand of max.
template <class Float>
Rgb<Float> colour(const Rgb<Float> &s) {
    return max(Rgb<Float>(0), s);
}
template <class Float>
Float fraction(Float x) {
    return clamp_number(x, 0.0f, 1.0f);
}

// The half vector of two directions, and its cosine with either.
template <class Float>
struct Halfway {
    Vec3<Float> m;
    Float cosine;
};
template <class Float>
Halfway<Float> halfway(const Vec3<Float> &wo, const Vec3<Float> &wi) {
    const Vec3<Float> sum = wo + wi;
    const Float l = length(sum);
    return {sum * (1 / l), l / 2};
}

// White and a base colour of luminance one, mixed: `white` + base * `hue`.
template <class Float>
struct Tint {
    Float white = 0, hue = 0;
    Tint(const Rgb<Float> &base, Float amount) {
        const Float y = luminance(base);
        const auto has_hue = y > 1e-12f;
        hue = select(has_hue, amount / y, Float(0));
        white = select(has_hue, 1 - amount, Float(1));
    }
    Tint operator*(Float share) const {
        Tint scaled = *this;
        scaled.white *= share;
        scaled.hue *= share;
        return scaled;
    }
    Rgb<Float> operator()(const Rgb<Float> &base) const { return Rgb<Float>(white) + base * hue; }
};

// Burley 2012, section 5.4: roughness is the square root of alpha, with a long axis along the tangent.
template <class Float>
Microfacet<Float> microfacets(Float roughness, std::type_identity_t<Float> anisotropic, float least_alpha) {
    const Float aspect = sqrt(1 - 0.9f * anisotropic), alpha = sqr(roughness);
    return {MicrofacetKind::ggx, max(alpha / aspect, Float(least_alpha)),
            max(alpha * aspect, Float(least_alpha))};
}

// The energy loss of such a surface if its facets reflect all light.
inline std::shared_ptr<const LostLight>
lost_by_reflection(const Texture<float> &roughness, const Texture<float> &anisotropic, float least_alpha) {
    return lajolla::lost_by_reflection(
        microfacets(fraction(roughness.constant), fraction(anisotropic.constant), least_alpha),
        !roughness.is_constant() || !anisotropic.is_constant());
}

// The diffuse shape, times pi: Burley 2012, section 5.3, with the retro-reflection of rough surfaces, and its
// flattened variant after Hanrahan and Krueger 1993 that looks like subsurface scattering. cos_d is the
// cosine between either direction and the one halfway.
template <class Float>
Float diffuse(Float cos_o, Float cos_i, Float cos_d, Float roughness, Float flatness) {
    const Float w_o = schlick_weight(cos_o), w_i = schlick_weight(cos_i);
    const Float ss90 = roughness * sqr(cos_d), d90 = 0.5f + 2 * ss90;
    const Float retro = lerp(w_o, Float(1), d90) * lerp(w_i, Float(1), d90);
    if (!any(flatness != 0.0f)) return retro;
    const Float ss = lerp(w_o, Float(1), ss90) * lerp(w_i, Float(1), ss90);
    const Float flat = 1.25f * (ss * (1 / (cos_o + cos_i) - 0.5f) + 0.5f);
    return lerp(flatness, retro, flat);
}

// The approximate albedo of sheen, (1 - cos_d)^5 cos_i over the hemisphere; used only to select lobes.
template <class Float>
Float sheen_albedo(Float cos_o) {
    return 0.1f * sqr(1.05f - cos_o);
}

// The second specular lobe with its wide tails: GTR1 normals (Burley 2012, appendix B) of alpha 0.1 to 0.001,
// and the masking of a GGX surface of alpha 0.25.
template <class Float>
class Clearcoat {
public:
    explicit Clearcoat(Float gloss) : alpha_(lerp(gloss, Float(0.1f), Float(0.001f))) {}

    Float roughness() const { return alpha_; }

    // Its integral times cos(theta_m) is one.
    Float density(const Vec3<Float> &m) const {
        const Float alpha2 = sqr(alpha_), sin2 = m.x * m.x + m.y * m.y;
        return (alpha2 - 1) * inv_pi / (log(alpha2) * (sin2 + alpha2 * m.z * m.z));
    }
    // With density density(m) cos(theta_m). Computes the sine, which is exact near the normal.
    Vec3<Float> sample(const Vec2<Float> &u) const {
        const Float alpha2 = sqr(alpha_);
        const Float sin2 = min(alpha2 * expm1(-u.x * log(alpha2)) / (1 - alpha2), Float(1));
        const Float r = sqrt(sin2);
        const auto [sine, cosine] = sine_cosine(2 * pi * u.y);
        return {r * cosine, r * sine, sqrt(1 - sin2)};
    }
    // Schlick's reflectance of an interface of index 1.5.
    static Float fresnel(Float weight) { return lerp(weight, Float(0.04f), Float(1)); }
    static Float masking(const Vec3<Float> &w) {
        const Float tan2 = (w.x * w.x + w.y * w.y) / (w.z * w.z);
        return 2 / (1 + sqrt(1 + sqr(0.25f) * tan2));
    }

private:
    Float alpha_;
};

} // namespace lajolla::disney
