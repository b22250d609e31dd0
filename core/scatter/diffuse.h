#pragma once

#include "base/warp.h"
#include "scatter/bsdf.h"

namespace lajolla {

struct Diffuse {
    static constexpr const char *name = "diffuse";
    static constexpr const char *doc = "Lambertian reflection: equally bright from every side.";
    Texture<Spectrum> reflectance{Spectrum(0.5f)};

    static constexpr auto fields() {
        return std::tuple(
            field("reflectance", &Diffuse::reflectance, "fraction of light reflected").range(0, 1));
    }
    BsdfTraits traits() const { return {.lambertian = true, .diffuse_colour = &reflectance}; }

    template <class Float>
    struct Lobe {
        Rgb<Float> reflectance;

        float roughness() const { return 1; }

        BsdfEval<Float> eval(const Vec3<Float> &wo, const Vec3<Float> &wi) const {
            const Float pdf = select(wo.z > 0.0f && wi.z > 0.0f, cosine_hemisphere_pdf(wi.z), Float(0));
            return {reflectance * pdf, pdf};
        }

        BsdfSample<Float> sample(const Vec3<Float> &wo, Float, const Vec2<Float> &u) const {
            const Vec3<Float> wi = sample_cosine_hemisphere(u);
            return {wo.z > 0.0f && wi.z > 0.0f, wi, reflectance, cosine_hemisphere_pdf(wi.z)};
        }
    };

    template <class Float>
    Lobe<Float> prepare(const auto &read) const {
        return {read(reflectance)};
    }
};

} // namespace lajolla
