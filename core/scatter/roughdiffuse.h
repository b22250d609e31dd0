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
    BsdfTraits traits() const { return {.diffuse_colour = &reflectance}; }

    template <class Float>
    struct Lobe {
        Rgb<Float> reflectance;
        Float sigma2; // variance of the facets' angle
        RoughDiffuseVariant variant;

        float roughness() const { return 1; }

        BsdfEval<Float> eval(const Vec3<Float> &wo, const Vec3<Float> &wi) const {
            const auto valid = wo.z > 0.0f && wi.z > 0.0f;
            if (!any(valid)) return {};
            const Float pdf = cosine_hemisphere_pdf(wi.z);
            return select(valid, BsdfEval<Float>{relative(wo, wi) * pdf, pdf}, {});
        }

        BsdfSample<Float> sample(const Vec3<Float> &wo, Float, const Vec2<Float> &u) const {
            const Vec3<Float> wi = sample_cosine_hemisphere(u);
            return {wo.z > 0.0f && wi.z > 0.0f, wi, relative(wo, wi), cosine_hemisphere_pdf(wi.z)};
        }

    private:
        // The BRDF divided by that of a white Lambertian surface.
        Rgb<Float> relative(const Vec3<Float> &wo, const Vec3<Float> &wi) const {
            return max(variant == RoughDiffuseVariant::energy_preserving ? energy_preserving(wo, wi)
                                                                         : oren_nayar(wo, wi),
                       Rgb<Float>(0));
        }

        Rgb<Float> oren_nayar(const Vec3<Float> &wo, const Vec3<Float> &wi) const {
            // alpha and beta are the larger and the smaller of the angles to the normal
            const Float cos_alpha = min(wo.z, wi.z), cos_beta = max(wo.z, wi.z),
                        sin_alpha = safe_sqrt(1 - sqr(cos_alpha)), sin_beta = safe_sqrt(1 - sqr(cos_beta));
            const Float sines = sin_alpha * sin_beta,
                        cos_phi = select(sines > 1e-12f,
                                         clamp((wo.x * wi.x + wo.y * wi.y) / sines, -1.0f, 1.0f), Float(0));
            const Float tan_beta = sin_beta / cos_beta;
            if (variant == RoughDiffuseVariant::fast)
                return reflectance * (a() + b() * max(cos_phi, Float(0)) * sin_alpha * tan_beta);

            // Equations 27 to 30 of the paper: one bounce, and two
            const Float angle_alpha = acos(cos_alpha), angle_beta = acos(cos_beta);
            const Float rim = 2 * angle_beta / pi, ratio = sigma2 / (sigma2 + 0.09f),
                        c2 = 0.45f * ratio * (sin_alpha - select(cos_phi < 0.0f, rim * rim * rim, Float(0))),
                        c3 = 0.125f * ratio * sqr(4 * angle_alpha * angle_beta / sqr(pi)),
                        tan_half = (sin_alpha + sin_beta) / (cos_alpha + cos_beta);
            const Float one = a() + c2 * cos_phi * tan_beta + c3 * (1 - abs(cos_phi)) * tan_half,
                        two = 0.17f * sigma2 / (sigma2 + 0.13f) * (1 - cos_phi * sqr(rim));
            return reflectance * (Rgb<Float>(one) + reflectance * two);
        }

        Float a() const { return 1 - 0.5f * sigma2 / (sigma2 + 0.33f); }
        Float b() const { return 0.45f * sigma2 / (sigma2 + 0.09f); }

        // Portsmouth, Kutz and Hill 2025, "EON: A Practical Energy-Preserving Rough Diffuse BRDF", with the
        // roughness r that has the same ratio of its two terms as Oren and Nayar's.
        Rgb<Float> energy_preserving(const Vec3<Float> &wo, const Vec3<Float> &wi) const {
            const Float r = b() / a(), s = wo.x * wi.x + wo.y * wi.y;
            const Float constant = 1 / (1 + (0.5f - 2 / (3 * pi)) * r);
            const Float single = constant * (1 + r * select(s > 0.0f, s / max(wo.z, wi.z), s));
            const Float albedo = constant * (1 + (2.0f / 3 - 28 / (15 * pi)) * r); // mean of single bounces
            const Float lost = (1 - constant * (1 + r * rim_light(wo.z))) *
                               (1 - constant * (1 + r * rim_light(wi.z))) / max(1 - albedo, Float(1e-7f));
            const Rgb<Float> more =
                reflectance * reflectance * albedo / (Rgb<Float>(1) - reflectance * (1 - albedo));
            return reflectance * single + more * max(lost, Float(0));
        }
        // G / pi of that paper, equation 24: the increase of the single-scattering albedo towards the rim.
        static Float rim_light(Float cosine) {
            const Float sine = safe_sqrt(1 - sqr(cosine));
            const Float g = sine * (acos(min(cosine, Float(1))) - sine * cosine) +
                            2.0f / 3 * (sine / cosine * (1 - sine * sine * sine) - sine);
            return g / pi;
        }
    };

    template <class Float>
    Lobe<Float> prepare(const auto &read) const {
        // The variance of angles for a variance of slopes, as in Mitsuba 0.6
        return {read(reflectance), sqr(max(read(alpha), Float(0))) / 2, variant};
    }
};

} // namespace lajolla
