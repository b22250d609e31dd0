#pragma once

#include "scatter/bsdf.h"
#include "scatter/fresnel.h"

namespace lajolla {

struct Dielectric {
    static constexpr const char *name = "dielectric";
    static constexpr const char *doc = "Smooth boundary of clear glass or liquid: reflects and refracts.";
    float int_ior = 1.5046f, ext_ior = 1.000277f;
    Texture<Spectrum> specular_reflectance{Spectrum(1)}, specular_transmittance{Spectrum(1)};

    static constexpr auto fields() {
        return std::tuple(
            field("int_ior", &Dielectric::int_ior, "index of refraction behind the surface").range(0),
            field("ext_ior", &Dielectric::ext_ior, "index of refraction in front of the surface").range(0),
            field("specular_reflectance", &Dielectric::specular_reflectance,
                  "tints the reflection; 1 is physical")
                .range(0, 1),
            field("specular_transmittance", &Dielectric::specular_transmittance,
                  "tints the refraction; 1 is physical")
                .range(0, 1));
    }

    struct Lobe {
        static constexpr bool transmissive = true, delta = true;
        float eta; // inside relative to outside
        Spectrum reflectance, transmittance;

        float roughness() const { return 0; }
        BsdfEval eval(Vec3f, Vec3f) const { return {}; }

        std::optional<BsdfSample> sample(Vec3f wo, float u_lobe, Vec2f) const {
            const float side = std::copysign(1.0f, wo.z), beyond = wo.z > 0 ? eta : 1 / eta;
            const float f = fresnel_dielectric(side * wo.z, beyond).reflectance;
            const Spectrum r = reflectance * f, t = transmittance * (1 - f);
            const float total = mean(r) + mean(t), p_r = mean(r) / total, p_t = mean(t) / total;
            if (!(total > 0)) return std::nullopt;
            if (u_lobe < p_r) return BsdfSample{{-wo.x, -wo.y, wo.z}, r / p_r, p_r, 1, ScatterKind::specular};
            const float x = -wo.x / beyond, y = -wo.y / beyond;
            const Vec3f wi{x, y, -side * safe_sqrt(1 - x * x - y * y)};
            return BsdfSample{wi, t / p_t, p_t, beyond, ScatterKind::specular};
        }
    };

    void build() const { check_indices(int_ior, ext_ior); }
    Lobe prepare(const auto &read) const {
        return {int_ior / ext_ior, read(specular_reflectance), read(specular_transmittance)};
    }
};

} // namespace lajolla
