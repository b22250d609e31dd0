#pragma once

#include "base/warp.h"
#include "scatter/disney.h"

namespace lajolla {

struct DisneyDiffuse {
    static constexpr const char *name = "disneydiffuse";
    static constexpr const char *doc = "Diffuse part of disneybsdf (Burley 2012, section 5.3).";
    Texture<Spectrum> base_color{Spectrum(0.5f)};
    Texture<float> roughness{0.5f}, subsurface{0};

    static constexpr auto fields() {
        return std::tuple(
            field("base_color", &DisneyDiffuse::base_color, "fraction of light reflected").range(0, 1),
            field("roughness", &DisneyDiffuse::roughness, "also controls retroreflection at grazing angles")
                .range(0, 1),
            field("subsurface", &DisneyDiffuse::subsurface,
                  "flattened shape that approximates subsurface scattering")
                .range(0, 1));
    }

    BsdfTraits traits() const { return {.diffuse_colour = &base_color}; }

    template <class Float>
    struct Lobe {
        Rgb<Float> base{0}, sheen{0};
        Float surface_roughness = 0, subsurface = 0;

        float roughness() const { return 1; }

        BsdfEval<Float> eval(const Vec3<Float> &wo, const Vec3<Float> &wi) const {
            const Float pdf = cosine_hemisphere_pdf(wi.z);
            return select(wo.z > 0.0f && wi.z > 0.0f, BsdfEval<Float>{shape(wo, wi) * pdf, pdf}, {});
        }

        BsdfSample<Float> sample(const Vec3<Float> &wo, Float, const Vec2<Float> &u) const {
            const Vec3<Float> wi = sample_cosine_hemisphere(u);
            return {wo.z > 0.0f && wi.z > 0.0f, wi, shape(wo, wi), cosine_hemisphere_pdf(wi.z)};
        }

    private:
        Rgb<Float> shape(const Vec3<Float> &wo, const Vec3<Float> &wi) const { // the BSDF times pi
            const Float cos_d = disney::halfway(wo, wi).cosine;
            return base * disney::diffuse(wo.z, wi.z, cos_d, surface_roughness, subsurface) +
                   sheen * (pi * disney::schlick_weight(cos_d));
        }
    };

    template <class Float>
    Lobe<Float> prepare(const auto &read) const {
        return {.base = disney::colour(read(base_color)),
                .surface_roughness = disney::fraction(read(roughness)),
                .subsurface = disney::fraction(read(subsurface))};
    }
};

} // namespace lajolla
