#pragma once

#include "scatter/bsdf.h"
#include "scatter/fresnel.h"
#include "scatter/microfacet.h"

namespace lajolla {

struct RoughConductor {
    static constexpr const char *name = "roughconductor";
    static constexpr const char *doc = "Rough metal: brushed, cast or sand-blasted.";
    MicrofacetKind distribution = MicrofacetKind::beckmann;
    Texture<float> alpha_u{0.1f}, alpha_v{0.1f};
    Texture<Spectrum> eta{Spectrum(0)}, k{Spectrum(1)}, specular_reflectance{Spectrum(1)};

    static constexpr auto fields() {
        return std::tuple(
            field("distribution", &RoughConductor::distribution, "statistics of the microfacets"),
            field("alpha_u", &RoughConductor::alpha_u, "roughness along the tangent, at least 0.0001")
                .range(0),
            field("alpha_v", &RoughConductor::alpha_v, "roughness across the tangent, at least 0.0001")
                .range(0),
            field("eta", &RoughConductor::eta, "index of refraction, real part").range(0, 1e6),
            field("k", &RoughConductor::k, "index of refraction, imaginary part (absorption)").range(0, 1e6),
            field("specular_reflectance", &RoughConductor::specular_reflectance,
                  "tints the reflection; 1 is physical")
                .range(0, 1));
    }

    struct Lobe {
        static constexpr bool transmissive = false, delta = false;
        Microfacet surface;
        Spectrum eta, k, reflectance;

        float roughness() const { return surface.roughness(); }

        BsdfEval eval(Vec3f wo, Vec3f wi) const {
            if (wo.z <= 0 || wi.z <= 0) return {};
            const Vec3f m = normalize(wo + wi);
            const float pdf = surface.visible(wo, m) / 4;
            return {reflectance * fresnel_conductor(dot(wo, m), eta, k) * (pdf * surface.masking(wi)), pdf};
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
        return {{distribution, read(alpha_u), read(alpha_v)}, read(eta), read(k), read(specular_reflectance)};
    }
};

} // namespace lajolla
