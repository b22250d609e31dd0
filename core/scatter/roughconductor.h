#pragma once

#include <memory>

#include "scatter/fresnel.h"
#include "scatter/metallobe.h"

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
            field("distribution", &RoughConductor::distribution, "microfacet distribution"),
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
                  "compensate the energy lost by single scattering"));
    }

    BsdfTraits traits() const { return {.anisotropic = !(alpha_u == alpha_v)}; }

    template <class Float>
    struct Facet {
        Rgb<Float> eta, k, tint;

        Rgb<Float> reflectance(Float cos_d) const { return tint * fresnel_conductor(cos_d, eta, k); }
    };
    template <class Float>
    using Lobe = MetalLobe<Float, Facet<Float>>;

    void build() {
        if (!multiscatter) return;
        lost_ = lost_by_reflection({distribution, alpha_u.constant, alpha_v.constant},
                                   !alpha_u.is_constant() || !alpha_v.is_constant());
    }

    template <class Float>
    Lobe<Float> prepare(const auto &read) const {
        Lobe<Float> lobe{{distribution, read(alpha_u), read(alpha_v)},
                         {read(eta), read(k), read(specular_reflectance)}};
        if (lost_) {
            lobe.lost = lost_.get();
            lobe.regained =
                lobe.facet.tint * regained_by_reflection(fresnel_conductor_mean(lobe.facet.eta, lobe.facet.k),
                                                         lobe.lost->mean(lobe.surface));
        }
        return lobe;
    }

private:
    std::shared_ptr<const LostLight> lost_;
};

} // namespace lajolla
