#pragma once

#include "base/warp.h"
#include "scatter/bsdf.h"

namespace lajolla {

enum class RoughDiffuseVariant { full, fast, energy_preserving };
constexpr auto choices(RoughDiffuseVariant) { return std::array{"full", "fast", "energy-preserving"}; }

// Oren and Nayar 1994, "Generalization of Lambert's Reflectance Model": V-shaped grooves of Lambertian
// facets.
struct RoughDiffuse {
    static constexpr const char *name = "roughdiffuse";
    static constexpr const char *doc =
        "Chalk, clay or plaster: flatter than Lambertian, brighter at the rim.";
    RoughDiffuseVariant variant = RoughDiffuseVariant::full;
    Texture<Spectrum> reflectance{Spectrum(0.5f)};
    Texture<float> alpha{0.2f};

    static constexpr auto fields() {
        return std::tuple(
            field(
                "variant", &RoughDiffuse::variant,
                "Oren and Nayar's model with two bounces, its approximation of one, or a fit to all bounces"),
            field("reflectance", &RoughDiffuse::reflectance, "fraction of light the facets reflect")
                .range(0, 1),
            field("alpha", &RoughDiffuse::alpha, "root mean square slope of the facets").range(0));
    }

    struct Lobe {
        static constexpr bool transmissive = false, delta = false;
        Spectrum reflectance;
        float sigma2; // variance of the facets' angle
        RoughDiffuseVariant variant;

        float roughness() const { return 1; }

        BsdfEval eval(Vec3f wo, Vec3f wi) const {
            if (wo.z <= 0 || wi.z <= 0) return {};
            const float pdf = cosine_hemisphere_pdf(wi.z);
            return {max(relative(wo, wi), Spectrum(0)) * pdf, pdf};
        }

        std::optional<BsdfSample> sample(Vec3f wo, float, Vec2f u) const {
            const Vec3f wi = sample_cosine_hemisphere(u);
            const BsdfEval e = eval(wo, wi);
            if (!(e.pdf > 0)) return std::nullopt;
            return BsdfSample{wi, e.f_cos / e.pdf, e.pdf};
        }

    private:
        // The BRDF over that of a white Lambertian surface.
        Spectrum relative(Vec3f wo, Vec3f wi) const {
            if (variant == RoughDiffuseVariant::energy_preserving) return energy_preserving(wo, wi);
            // alpha and beta are the larger and the smaller of the angles to the normal
            const float cos_alpha = std::min(wo.z, wi.z), cos_beta = std::max(wo.z, wi.z),
                        sin_alpha = safe_sqrt(1 - sqr(cos_alpha)), sin_beta = safe_sqrt(1 - sqr(cos_beta));
            const float sines = sin_alpha * sin_beta,
                        cos_phi =
                            sines > 1e-12f ? std::clamp((wo.x * wi.x + wo.y * wi.y) / sines, -1.0f, 1.0f) : 0;
            const float tan_beta = sin_beta / cos_beta;
            if (variant == RoughDiffuseVariant::fast)
                return reflectance * (a() + b() * std::max(cos_phi, 0.0f) * sin_alpha * tan_beta);

            // Equations 27 to 30 of the paper: one bounce, and two
            const float angle_alpha = std::acos(cos_alpha), angle_beta = std::acos(cos_beta);
            const float rim = 2 * angle_beta / pi, ratio = sigma2 / (sigma2 + 0.09f),
                        c2 = 0.45f * ratio * (sin_alpha - (cos_phi < 0 ? rim * rim * rim : 0)),
                        c3 = 0.125f * ratio * sqr(4 * angle_alpha * angle_beta / sqr(pi)),
                        tan_half = (sin_alpha + sin_beta) / (cos_alpha + cos_beta);
            const float one = a() + c2 * cos_phi * tan_beta + c3 * (1 - std::abs(cos_phi)) * tan_half,
                        two = 0.17f * sigma2 / (sigma2 + 0.13f) * (1 - cos_phi * sqr(rim));
            return reflectance * (Spectrum(one) + reflectance * two);
        }

        float a() const { return 1 - 0.5f * sigma2 / (sigma2 + 0.33f); }
        float b() const { return 0.45f * sigma2 / (sigma2 + 0.09f); }

        // Portsmouth, Kutz and Hill 2025, "EON: A Practical Energy-Preserving Rough Diffuse BRDF", with the
        // roughness r that has the same ratio of its two terms as Oren and Nayar's.
        Spectrum energy_preserving(Vec3f wo, Vec3f wi) const {
            const float r = b() / a(), s = wo.x * wi.x + wo.y * wi.y;
            const float constant = 1 / (1 + (0.5f - 2 / (3 * pi)) * r);
            const float single = constant * (1 + r * (s > 0 ? s / std::max(wo.z, wi.z) : s));
            const float albedo = constant * (1 + (2.0f / 3 - 28 / (15 * pi)) * r); // mean of single bounces
            const float lost = (1 - constant * (1 + r * rim_light(wo.z))) *
                               (1 - constant * (1 + r * rim_light(wi.z))) / std::max(1 - albedo, 1e-7f);
            const Spectrum more =
                reflectance * reflectance * albedo / (Spectrum(1) - reflectance * (1 - albedo));
            return reflectance * single + more * std::max(lost, 0.0f);
        }
        // G / pi of that paper, equation 24: how the albedo of single bounces grows towards the rim.
        static float rim_light(float cosine) {
            const float sine = safe_sqrt(1 - sqr(cosine));
            const float g = sine * (std::acos(std::min(cosine, 1.0f)) - sine * cosine) +
                            2.0f / 3 * (sine / cosine * (1 - sine * sine * sine) - sine);
            return g / pi;
        }
    };

    Lobe prepare(const auto &read) const {
        // The variance of angles for that of slopes, as in Mitsuba 0.6
        return {read(reflectance), sqr(std::max(read(alpha), 0.0f)) / 2, variant};
    }
};

} // namespace lajolla
