#pragma once

#include "scatter/disney.h"
#include "scatter/metallobe.h"

namespace lajolla {

struct DisneyMetal {
    static constexpr const char *name = "disneymetal";
    static constexpr const char *doc = "Rough metal, part of disneybsdf (Burley 2012, section 5.4).";
    Texture<Spectrum> base_color{Spectrum(0.5f)};
    Texture<float> roughness{0.5f}, anisotropic{0};
    bool multiscatter = false;

    static constexpr auto fields() {
        return std::tuple(
            field("base_color", &DisneyMetal::base_color, "reflectance at normal incidence").range(0, 1),
            field("roughness", &DisneyMetal::roughness, "square root of alpha, which is at least 0.0001")
                .range(0, 1),
            field("anisotropic", &DisneyMetal::anisotropic, "stretches highlights along the tangent")
                .range(0, 1),
            field("multiscatter", &DisneyMetal::multiscatter,
                  "compensate the energy lost by single scattering"));
    }

    BsdfTraits traits() const {
        return {.anisotropic = anisotropic != Texture<float>(0), .diffuse_colour = &base_color};
    }

    template <class Float>
    struct Facet {
        Rgb<Float> base;

        Rgb<Float> reflectance(Float cos_d) const {
            return disney::schlick(base, disney::schlick_weight(cos_d));
        }
    };
    template <class Float>
    using Lobe = MetalLobe<Float, Facet<Float>>;

    void build() {
        if (multiscatter) lost_ = disney::lost_by_reflection(roughness, anisotropic, least_alpha);
    }

    template <class Float>
    Lobe<Float> prepare(const auto &read) const {
        const Rgb<Float> base = disney::colour(read(base_color));
        Lobe<Float> lobe{disney::microfacets(disney::fraction(read(roughness)),
                                             disney::fraction(read(anisotropic)), least_alpha),
                         {base}};
        if (lost_) {
            lobe.lost = lost_.get();
            lobe.regained = regained_by_reflection(disney::schlick_mean(base), lobe.lost->mean(lobe.surface));
        }
        return lobe;
    }

private:
    static constexpr float least_alpha = 1e-4f;
    std::shared_ptr<const LostLight> lost_;
};

} // namespace lajolla
