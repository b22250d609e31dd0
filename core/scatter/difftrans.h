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
            field("transmittance", &DiffuseTransmitter::transmittance, "fraction of light transmitted")
                .range(0, 1));
    }
    BsdfTraits traits() const { return {.transmissive = true}; }

    template <class Float>
    struct Lobe {
        Rgb<Float> transmittance;

        float roughness() const { return 1; }

        BsdfEval<Float> eval(const Vec3<Float> &wo, const Vec3<Float> &wi) const {
            const Float pdf = select(wo.z * wi.z < 0.0f, cosine_hemisphere_pdf(abs(wi.z)), Float(0));
            return {transmittance * pdf, pdf};
        }

        BsdfSample<Float> sample(const Vec3<Float> &wo, Float, const Vec2<Float> &u) const {
            const Vec3<Float> above = sample_cosine_hemisphere(u);
            const Vec3<Float> wi{above.x, above.y, copysign(above.z, -wo.z)};
            return {wo.z != 0.0f && wi.z != 0.0f, wi, transmittance, cosine_hemisphere_pdf(above.z)};
        }
    };

    template <class Float>
    Lobe<Float> prepare(const auto &read) const {
        return {read(transmittance)};
    }
};

} // namespace lajolla
