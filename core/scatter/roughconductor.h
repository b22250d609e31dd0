#pragma once

#include <memory>

#include "base/warp.h"
#include "scatter/bsdf.h"
#include "scatter/fresnel.h"
#include "scatter/microfacet.h"
#include "scatter/multiscatter.h"

namespace lajolla {

struct RoughConductor {
    static constexpr const char *name = "roughconductor";
    static constexpr const char *doc = "Rough metal: brushed, cast or sand-blasted.";
    MicrofacetKind distribution = MicrofacetKind::beckmann;
    Texture<float> alpha_u{0.1f}, alpha_v{0.1f};
    Texture<Spectrum> eta{Spectrum(0)}, k{Spectrum(1)}, specular_reflectance{Spectrum(1)};
    bool multiscatter = false;

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
                .range(0, 1),
            field("multiscatter", &RoughConductor::multiscatter,
                  "give back the light that bounces between microfacets"));
    }

    struct Lobe {
        static constexpr bool transmissive = false, delta = false;
        Microfacet surface;
        Spectrum eta, k, reflectance;
        const LostLight *lost = nullptr; // where multiple scattering counts, and then
        Spectrum regained{0};            // what becomes of the lost light, over its mean

        float roughness() const { return surface.roughness(); }

        BsdfEval eval(Vec3f wo, Vec3f wi) const {
            if (wo.z <= 0 || wi.z <= 0) return {};
            const Vec3f m = normalize(wo + wi);
            const float pdf = surface.visible(wo, m) / 4;
            const BsdfEval single{
                reflectance * fresnel_conductor(dot(wo, m), eta, k) * (pdf * surface.masking(wi)), pdf};
            return lost ? with_lost_light(single, wo, wi) : single;
        }

        std::optional<BsdfSample> sample(Vec3f wo, float u_lobe, Vec2f u) const {
            if (wo.z <= 0) return std::nullopt;
            const bool single = !lost || u_lobe >= (*lost)(surface, wo);
            const Vec3f wi =
                single ? reflect(wo, surface.sample_visible(wo, u)) : sample_cosine_hemisphere(u);
            const BsdfEval e = eval(wo, wi);
            if (!(e.pdf > 1e-30f)) return std::nullopt;
            return BsdfSample{
                wi,         e.f_cos / e.pdf, e.pdf, 1, single ? ScatterKind::glossy : ScatterKind::diffuse,
                roughness()};
        }

    private:
        [[gnu::noinline]] BsdfEval with_lost_light(const BsdfEval &single, const Vec3f &wo,
                                                   const Vec3f &wi) const {
            const float p = (*lost)(surface, wo), cosine = cosine_hemisphere_pdf(wi.z);
            return {single.f_cos + regained * (p * (*lost)(surface, wi) * cosine),
                    lerp(p, single.pdf, cosine)};
        }
    };

    void build() {
        if (!multiscatter) return;
        lost_ = std::make_shared<LostLight>(distribution, alpha_u, alpha_v,
                                            [](const Microfacet &surface, Vec3f w, Vec3f m) {
                                                const Vec3f wi = reflect(w, m);
                                                return wi.z > 0 ? 1 - surface.masking(wi) : 1;
                                            });
    }

    Lobe prepare(const auto &read) const {
        Lobe lobe{
            {distribution, read(alpha_u), read(alpha_v)}, read(eta), read(k), read(specular_reflectance)};
        if (lost_) {
            lobe.lost = lost_.get();
            lobe.regained = regained(lobe);
        }
        return lobe;
    }

private:
    // The fraction of the lost light that is not absorbed at its second and later bounces: the geometric
    // series of F mean(L) after F^2 (1 - mean(L)), with F the mean Fresnel reflectance (Hill 2018,
    // "A Multi-Faceted Exploration", part 4).
    static Spectrum regained(const Lobe &lobe) {
        const Spectrum f = fresnel_conductor_mean(lobe.eta, lobe.k);
        const float mean = std::max(lobe.lost->mean(lobe.surface), 1e-6f);
        return lobe.reflectance * f * f * ((1 - mean) / mean) / (Spectrum(1) - f * mean);
    }

    std::shared_ptr<const LostLight> lost_;
};

} // namespace lajolla
