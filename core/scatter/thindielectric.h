#pragma once

#include "scatter/bsdf.h"
#include "scatter/fresnel.h"

namespace lajolla {

struct ThinDielectric {
    static constexpr const char *name = "thindielectric";
    static constexpr const char *doc =
        "Window pane: a sheet of glass too thin to shift what is seen through it.";
    float int_ior = 1.5046f, ext_ior = 1.000277f;
    Texture<Spectrum> specular_reflectance{Spectrum(1)}, specular_transmittance{Spectrum(1)};

    static constexpr auto fields() {
        return std::tuple(
            field("int_ior", &ThinDielectric::int_ior, "index of refraction of the sheet").range(0),
            field("ext_ior", &ThinDielectric::ext_ior, "index of refraction around the sheet").range(0),
            field("specular_reflectance", &ThinDielectric::specular_reflectance,
                  "tints the reflection; 1 is physical")
                .range(0, 1),
            field("specular_transmittance", &ThinDielectric::specular_transmittance,
                  "tints the transmission; 1 is physical")
                .range(0, 1));
    }

    struct Lobe {
        static constexpr bool transmissive = true, delta = true;
        float eta;
        Spectrum reflectance, transmittance;

        float roughness() const { return 0; }
        BsdfEval eval(Vec3f, Vec3f) const { return {}; }

        // Both faces together, with all reflections between them: f + (1-f)^2 f (1 + f^2 + f^4 + ...).
        float sheet(Vec3f wo) const {
            const float face = fresnel_dielectric(std::abs(wo.z), eta).reflectance;
            return 2 * face / (1 + face);
        }
        Passage straight(Vec3f wo) const {
            const float r = sheet(wo);
            const Spectrum transmitted = transmittance * (1 - r);
            const float t = mean(transmitted), total = mean(reflectance) * r + t;
            return total > 0 ? Passage{transmitted, t / total} : Passage{};
        }

        std::optional<BsdfSample> sample(Vec3f wo, float u_lobe, Vec2f) const {
            const Passage through = straight(wo);
            const float p_r = 1 - through.probability, p_t = through.probability;
            if (u_lobe >= p_r) return BsdfSample{-wo, through.transmitted / p_t, p_t, 1, ScatterKind::null};
            const Spectrum r = reflectance * sheet(wo);
            if (is_black(r)) return std::nullopt;
            return BsdfSample{{-wo.x, -wo.y, wo.z}, r / p_r, p_r, 1, ScatterKind::specular};
        }
    };

    void build() const { check_indices(int_ior, ext_ior); }
    Lobe prepare(const auto &read) const {
        return {int_ior / ext_ior, read(specular_reflectance), read(specular_transmittance)};
    }
};

} // namespace lajolla
