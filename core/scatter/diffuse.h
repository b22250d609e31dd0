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

    struct Lobe {
        static constexpr bool transmissive = false, delta = false;
        Spectrum reflectance;

        float roughness() const { return 1; }

        BsdfEval eval(Vec3f wo, Vec3f wi) const {
            if (cos_theta(wo) <= 0 || cos_theta(wi) <= 0) return {};
            const float pdf = cosine_hemisphere_pdf(cos_theta(wi));
            return {reflectance * pdf, pdf};
        }

        std::optional<BsdfSample> sample(Vec3f wo, float, Vec2f u) const {
            const Vec3f wi = sample_cosine_hemisphere(u);
            if (cos_theta(wo) <= 0 || cos_theta(wi) <= 0) return std::nullopt;
            return BsdfSample{wi, reflectance, cosine_hemisphere_pdf(cos_theta(wi))};
        }
    };

    Lobe prepare(const auto &read) const { return {read(reflectance)}; }
};

} // namespace lajolla
