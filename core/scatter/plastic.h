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
            field("int_ior", &Plastic::int_ior, "index of refraction of the coat").range(0),
            field("ext_ior", &Plastic::ext_ior, "index of refraction outside").range(0),
            field("diffuse_reflectance", &Plastic::diffuse_reflectance, "fraction of light the base reflects")
                .range(0, 1),
            field("specular_reflectance", &Plastic::specular_reflectance,
                  "tints the reflection; 1 is physical")
                .range(0, 1),
            field("nonlinear", &Plastic::nonlinear, "let colours deepen as light bounces under the coat"));
    }

    struct Lobe {
        static constexpr bool transmissive = false, delta = false;
        float eta;
        Spectrum base;        // albedo after bounces under the coat, over eta^2 for refraction on the way out
        Spectrum reflectance; // tint of the coat
        float diffuse_weight, specular_weight; // mean albedos: they steer the choice between base and coat

        float roughness() const { return 1; }

        BsdfEval eval(Vec3f wo, Vec3f wi) const {
            if (wo.z <= 0 || wi.z <= 0) return {};
            const float f_o = fresnel_dielectric(wo.z, eta).reflectance;
            return eval_base(f_o, choice(f_o).base, wi);
        }

        std::optional<BsdfSample> sample(Vec3f wo, float u_lobe, Vec2f u) const {
            if (wo.z <= 0) return std::nullopt;
            const float f_o = fresnel_dielectric(wo.z, eta).reflectance;
            const auto [p, p_base] = choice(f_o);
            if (u_lobe < p)
                return BsdfSample{{-wo.x, -wo.y, wo.z}, reflectance * (f_o / p), p, 1, ScatterKind::specular};
            const Vec3f wi = sample_cosine_hemisphere(u);
            const BsdfEval e = eval_base(f_o, p_base, wi);
            if (!(e.pdf > 0)) return std::nullopt;
            return BsdfSample{wi, e.f_cos / e.pdf, e.pdf};
        }

    private:
        struct Choice { // probabilities
            float coat, base;
        };

        Choice choice(float f_o) const {
            const float s = f_o * specular_weight, d = (1 - f_o) * diffuse_weight;
            return s > 0 ? Choice{s / (s + d), d / (s + d)} : Choice{0, 1};
        }
        BsdfEval eval_base(float f_o, float p_base, Vec3f wi) const {
            const float f_i = fresnel_dielectric(wi.z, eta).reflectance, pdf = cosine_hemisphere_pdf(wi.z);
            return {base * (pdf * (1 - f_o) * (1 - f_i)), pdf * p_base};
        }
    };

    void build() const { check_indices(int_ior, ext_ior); }

    Lobe prepare(const auto &read) const {
        const float relative = int_ior / ext_ior, inside = fresnel_diffuse_reflectance(1 / relative);
        const Spectrum d = read(diffuse_reflectance), s = read(specular_reflectance);
        // The geometric series of reflections between base and coat; the linear variant keeps the hue.
        const Spectrum escaping = Spectrum(1) - (nonlinear ? d * inside : Spectrum(inside));
        return {relative, d / (escaping * sqr(relative)), s, mean(d), mean(s)};
    }
};

} // namespace lajolla
