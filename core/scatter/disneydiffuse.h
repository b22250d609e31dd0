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
            field("roughness", &DisneyDiffuse::roughness, "rough surfaces shine back at grazing angles")
                .range(0, 1),
            field("subsurface", &DisneyDiffuse::subsurface, "flatter, as if light spread under the surface")
                .range(0, 1));
    }

    struct Lobe {
        static constexpr bool transmissive = false, delta = false;
        Spectrum base{0}, sheen{0};
        float surface_roughness = 0, subsurface = 0;

        float roughness() const { return 1; }

        BsdfEval eval(Vec3f wo, Vec3f wi) const {
            if (wo.z <= 0 || wi.z <= 0) return {};
            const float cos_d = disney::halfway(wo, wi).cosine, pdf = cosine_hemisphere_pdf(wi.z);
            const float diffuse = disney::diffuse(wo.z, wi.z, cos_d, surface_roughness, subsurface);
            return {base * (diffuse * pdf) + sheen * (disney::schlick_weight(cos_d) * wi.z), pdf};
        }

        std::optional<BsdfSample> sample(Vec3f wo, float, Vec2f u) const {
            const Vec3f wi = sample_cosine_hemisphere(u);
            const BsdfEval e = eval(wo, wi);
            if (!(e.pdf > 0)) return std::nullopt;
            return BsdfSample{wi, e.f_cos / e.pdf, e.pdf};
        }
    };

    Lobe prepare(const auto &read) const {
        return {disney::colour(read(base_color)), Spectrum(0), disney::fraction(read(roughness)),
                disney::fraction(read(subsurface))};
    }
};

} // namespace lajolla
