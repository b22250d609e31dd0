#pragma once

#include "base/warp.h"
#include "scatter/bsdf.h"

namespace lajolla {

struct DiffuseTransmitter {
    static constexpr const char *name = "difftrans";
    static constexpr const char *doc = "Lambertian transmission: paper or a leaf against the light.";
    Texture<Spectrum> transmittance{Spectrum(0.5f)};

    static constexpr auto fields() {
        return std::tuple(
            field("transmittance", &DiffuseTransmitter::transmittance, "fraction of light let through")
                .range(0, 1));
    }

    struct Lobe {
        static constexpr bool transmissive = true, delta = false;
        Spectrum transmittance;

        float roughness() const { return 1; }

        BsdfEval eval(Vec3f wo, Vec3f wi) const {
            if (wo.z * wi.z >= 0) return {};
            const float pdf = cosine_hemisphere_pdf(std::abs(wi.z));
            return {transmittance * pdf, pdf};
        }

        std::optional<BsdfSample> sample(Vec3f wo, float, Vec2f u) const {
            Vec3f wi = sample_cosine_hemisphere(u);
            if (wo.z == 0 || wi.z == 0) return std::nullopt;
            const float pdf = cosine_hemisphere_pdf(wi.z);
            wi.z = std::copysign(wi.z, -wo.z);
            return BsdfSample{wi, transmittance, pdf};
        }
    };

    Lobe prepare(const auto &read) const { return {read(transmittance)}; }
};

} // namespace lajolla
