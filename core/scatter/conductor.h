#pragma once

#include "scatter/bsdf.h"
#include "scatter/fresnel.h"

namespace lajolla {

struct Conductor {
    static constexpr const char *name = "conductor";
    static constexpr const char *doc = "Polished metal; by default a perfect mirror.";
    Texture<Spectrum> eta{Spectrum(0)}, k{Spectrum(1)}, specular_reflectance{Spectrum(1)};

    static constexpr auto fields() {
        return std::tuple(
            field("eta", &Conductor::eta, "index of refraction, real part").range(0, 1e6),
            field("k", &Conductor::k, "index of refraction, imaginary part (absorption)").range(0, 1e6),
            field("specular_reflectance", &Conductor::specular_reflectance,
                  "tints the reflection; 1 is physical")
                .range(0, 1));
    }

    BsdfTraits traits() const { return {.delta = true}; }

    template <class Float>
    struct Lobe {
        Rgb<Float> eta, k, reflectance;

        float roughness() const { return 0; }
        BsdfEval<Float> eval(const Vec3<Float> &, const Vec3<Float> &) const { return {}; }

        BsdfSample<Float> sample(const Vec3<Float> &wo, Float, const Vec2<Float> &) const {
            return {.valid = wo.z > 0.0f,
                    .wi = {-wo.x, -wo.y, wo.z},
                    .weight = reflectance * fresnel_conductor(wo.z, eta, k),
                    .pdf = 1,
                    .delta = true,
                    .width = 0};
        }
    };

    template <class Float>
    Lobe<Float> prepare(const auto &read) const {
        return {read(eta), read(k), read(specular_reflectance)};
    }
};

} // namespace lajolla
