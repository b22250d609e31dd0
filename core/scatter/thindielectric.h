#pragma once

#include "scatter/bsdf.h"
#include "scatter/fresnel.h"

namespace lajolla {

struct ThinDielectric {
    static constexpr const char *name = "thindielectric";
    static constexpr const char *doc =
        "Thin sheet of glass, such as a window: refraction does not shift what is behind it.";
    float int_ior = 1.5046f, ext_ior = 1.000277f;
    Texture<Spectrum> specular_reflectance{Spectrum(1)}, specular_transmittance{Spectrum(1)};

    static constexpr auto fields() {
        return std::tuple(field("int_ior", &ThinDielectric::int_ior, "index of refraction of the sheet")
                              .range(least_index, largest_index),
                          field("ext_ior", &ThinDielectric::ext_ior, "index of refraction around the sheet")
                              .range(least_index, largest_index),
                          field("specular_reflectance", &ThinDielectric::specular_reflectance,
                                "tints the reflection; 1 is physical")
                              .range(0, 1),
                          field("specular_transmittance", &ThinDielectric::specular_transmittance,
                                "tints the transmission; 1 is physical")
                              .range(0, 1));
    }

    BsdfTraits traits() const { return {.transmissive = true, .delta = true, .null_transmission = true}; }

    template <class Float>
    struct Lobe {
        float eta;
        Rgb<Float> reflectance, transmittance;

        float roughness() const { return 0; }
        BsdfEval<Float> eval(const Vec3<Float> &, const Vec3<Float> &) const { return {}; }

        // Both faces together, with all reflections between them: f + (1-f)^2 f (1 + f^2 + f^4 + ...).
        Float sheet(const Vec3<Float> &wo) const {
            const Float face = fresnel_dielectric(abs(wo.z), eta).reflectance;
            return 2 * face / (1 + face);
        }
        NullTransmission<Float> null_transmission(const Vec3<Float> &wo) const {
            const Float r = sheet(wo);
            const Rgb<Float> transmitted = transmittance * (1 - r);
            const Float t = mean(transmitted), total = mean(reflectance) * r + t;
            return {transmitted, select(total > 0.0f, t / total, Float(0))};
        }

        BsdfSample<Float> sample(const Vec3<Float> &wo, Float u_lobe, const Vec2<Float> &) const {
            const auto [transmitted, p_t] = null_transmission(wo);
            const Float p_r = 1 - p_t;
            const auto reflected = u_lobe < p_r;
            const Rgb<Float> r = reflectance * sheet(wo);
            const Float p = select(reflected, p_r, p_t);
            return {.valid = !reflected || !is_black(r),
                    .wi = {-wo.x, -wo.y, select(reflected, wo.z, -wo.z)},
                    .weight = select(reflected, r, transmitted) / p,
                    .pdf = p,
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
