#pragma once

#include "base/warp.h"
#include "scatter/bsdf.h"
#include "scatter/fresnel.h"

namespace lajolla {

struct Plastic {
    static constexpr const char *name = "plastic";
    static constexpr const char *doc = "Polished plastic: a diffuse base under a smooth clear coat.";
    float int_ior = 1.49f, ext_ior = 1.000277f;
    Texture<Spectrum> diffuse_reflectance{Spectrum(0.5f)}, specular_reflectance{Spectrum(1)};
    bool nonlinear = false;

    static constexpr auto fields() {
        return std::tuple(
            field("int_ior", &Plastic::int_ior, "index of refraction of the coat")
                .range(least_index, largest_index),
            field("ext_ior", &Plastic::ext_ior, "index of refraction outside")
                .range(least_index, largest_index),
            field("diffuse_reflectance", &Plastic::diffuse_reflectance, "fraction of light the base reflects")
                .range(0, 1),
            field("specular_reflectance", &Plastic::specular_reflectance,
                  "tints the reflection; 1 is physical")
                .range(0, 1),
            field("nonlinear", &Plastic::nonlinear, "saturate colours by scattering under the coat"));
    }

    BsdfTraits traits() const { return {.diffuse_colour = &diffuse_reflectance}; }

    template <class Float>
    struct Lobe {
        float eta;
        Rgb<Float> base; // albedo after bounces under the coat, over eta^2 for refraction on the way out
        Rgb<Float> reflectance;                // tint of the coat
        Float diffuse_weight, specular_weight; // mean albedos, for the selection of base or coat

        float roughness() const { return 1; }

        BsdfEval<Float> eval(const Vec3<Float> &wo, const Vec3<Float> &wi) const {
            const Float f_o = fresnel_dielectric(wo.z, eta).reflectance, pdf = cosine_hemisphere_pdf(wi.z);
            const BsdfEval<Float> e{base_over_cosine(f_o, wi) * pdf, pdf * choice(f_o).base};
            return select(wo.z > 0.0f && wi.z > 0.0f, e, {});
        }

        BsdfSample<Float> sample(const Vec3<Float> &wo, Float u_lobe, const Vec2<Float> &u) const {
            const Float f_o = fresnel_dielectric(wo.z, eta).reflectance;
            const Choice p = choice(f_o);
            const auto specular = u_lobe < p.coat;
            const Vec3<Float> diffuse = sample_cosine_hemisphere(u);
            const Float pdf = select(specular, p.coat, cosine_hemisphere_pdf(diffuse.z) * p.base);
            return {.valid = wo.z > 0.0f && pdf > 0.0f,
                    .wi = select(specular, {-wo.x, -wo.y, wo.z}, diffuse),
                    .weight = select(specular, reflectance * f_o, base_over_cosine(f_o, diffuse)) /
                              select(specular, p.coat, p.base),
                    .pdf = pdf,
                    .delta = specular,
                    .width = select(specular, Float(0), Float(1))};
        }

    private:
        struct Choice { // probabilities
            Float coat, base;
        };

        Choice choice(Float f_o) const {
            const Float s = f_o * specular_weight, d = (1 - f_o) * diffuse_weight;
            const auto coated = s > 0.0f;
            return {select(coated, s / (s + d), Float(0)), select(coated, d / (s + d), Float(1))};
        }
        // The value of the base divided by the density of cosine-weighted sampling.
        Rgb<Float> base_over_cosine(Float f_o, const Vec3<Float> &wi) const {
            const Float f_i = fresnel_dielectric(wi.z, eta).reflectance;
            return base * ((1 - f_o) * (1 - f_i));
        }
    };

    void build() const { check_indices(int_ior, ext_ior); }

    template <class Float>
    Lobe<Float> prepare(const auto &read) const {
        const float relative = int_ior / ext_ior, leaving = fresnel_diffuse_transmittance(1 / relative);
        const Rgb<Float> d = read(diffuse_reflectance), s = read(specular_reflectance);
        // The geometric series of reflections between base and coat; the linear variant keeps the hue.
        const Rgb<Float> escaping = nonlinear ? Rgb<Float>(1) - d + d * leaving : Rgb<Float>(leaving);
        return {relative, d / (escaping * sqr(relative)), s, mean(d), mean(s)};
    }
};

} // namespace lajolla
