#pragma once

#include "scatter/disney.h"

namespace lajolla {

struct DisneyMetal {
    static constexpr const char *name = "disneymetal";
    static constexpr const char *doc = "Rough metal, part of disneybsdf (Burley 2012, section 5.4).";
    Texture<Spectrum> base_color{Spectrum(0.5f)};
    Texture<float> roughness{0.5f}, anisotropic{0};

    static constexpr auto fields() {
        return std::tuple(
            field("base_color", &DisneyMetal::base_color, "reflectance at normal incidence").range(0, 1),
            field("roughness", &DisneyMetal::roughness, "square root of alpha, which is at least 0.0001")
                .range(0, 1),
            field("anisotropic", &DisneyMetal::anisotropic, "stretches highlights along the tangent")
                .range(0, 1));
    }

    struct Lobe {
        static constexpr bool transmissive = false, delta = false;
        Microfacet surface;
        Spectrum base;

        float roughness() const { return surface.roughness(); }

        BsdfEval eval(Vec3f wo, Vec3f wi) const {
            if (wo.z <= 0 || wi.z <= 0) return {};
            const auto [m, cos_d] = disney::halfway(wo, wi);
            const float pdf = surface.visible(wo, m) / 4;
            const Spectrum f = disney::schlick(base, disney::schlick_weight(cos_d));
            return {f * (pdf * surface.masking(wi)), pdf};
        }

        std::optional<BsdfSample> sample(Vec3f wo, float, Vec2f u) const {
            if (wo.z <= 0) return std::nullopt;
            const Vec3f wi = reflect(wo, surface.sample_visible(wo, u));
            const BsdfEval e = eval(wo, wi);
            if (!(e.pdf > 1e-30f)) return std::nullopt;
            return BsdfSample{wi, e.f_cos / e.pdf, e.pdf, 1, ScatterKind::glossy, roughness()};
        }
    };

    Lobe prepare(const auto &read) const {
        return {disney::microfacets(disney::fraction(read(roughness)), disney::fraction(read(anisotropic)),
                                    1e-4f),
                disney::colour(read(base_color))};
    }
};

} // namespace lajolla
