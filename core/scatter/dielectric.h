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
            field("int_ior", &Dielectric::int_ior, "index of refraction behind the surface")
                .range(least_index, largest_index),
            field("ext_ior", &Dielectric::ext_ior, "index of refraction in front of the surface")
                .range(least_index, largest_index),
            field("specular_reflectance", &Dielectric::specular_reflectance,
                  "tints the reflection; 1 is physical")
                .range(0, 1),
            field("specular_transmittance", &Dielectric::specular_transmittance,
                  "tints the refraction; 1 is physical")
                .range(0, 1));
    }

    BsdfTraits traits() const { return {.transmissive = true, .delta = true}; }

    template <class Float>
    struct Lobe {
        float eta; // inside relative to outside
        Rgb<Float> reflectance, transmittance;

        float roughness() const { return 0; }
        BsdfEval<Float> eval(const Vec3<Float> &, const Vec3<Float> &) const { return {}; }

        BsdfSample<Float> sample(const Vec3<Float> &wo, Float u_lobe, const Vec2<Float> &) const {
            const Float beyond = select(wo.z > 0.0f, Float(eta), Float(1 / eta));
            const Float f = fresnel_dielectric(abs(wo.z), beyond).reflectance;
            const Rgb<Float> r = reflectance * f, t = transmittance * (1 - f);
            const Float p_r = mean(r), p_t = mean(t), total = p_r + p_t;
            const auto reflected = u_lobe < p_r / total;
            const Float p = select(reflected, p_r, p_t) / total;
            const Float x = -wo.x / beyond, y = -wo.y / beyond;
            const Vec3<Float> refracted{x, y, copysign(safe_sqrt(1 - x * x - y * y), -wo.z)};
            return {.valid = total > 0.0f,
                    .wi = select(reflected, {-wo.x, -wo.y, wo.z}, refracted),
                    .weight = select(reflected, r, t) / p,
                    .pdf = p,
                    .eta = select(reflected, Float(1), beyond),
                    .delta = true,
                    .width = 0};
        }
    };

    void build() const { check_indices(int_ior, ext_ior); }

    template <class Float>
    Lobe<Float> prepare(const auto &read) const {
        return {int_ior / ext_ior, read(specular_reflectance), read(specular_transmittance)};
    }
};

} // namespace lajolla
