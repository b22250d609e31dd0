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

    struct Lobe {
        static constexpr bool transmissive = false, delta = true;
        Spectrum eta, k, reflectance;

        float roughness() const { return 0; }
        BsdfEval eval(Vec3f, Vec3f) const { return {}; }

        std::optional<BsdfSample> sample(Vec3f wo, float, Vec2f) const {
            if (wo.z <= 0) return std::nullopt;
            const Spectrum f = reflectance * fresnel_conductor(wo.z, eta, k);
            return BsdfSample{{-wo.x, -wo.y, wo.z}, f, 1, 1, ScatterKind::specular};
        }
    };

    Lobe prepare(const auto &read) const { return {read(eta), read(k), read(specular_reflectance)}; }
};

} // namespace lajolla
