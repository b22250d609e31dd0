#pragma once

#include "scatter/disney.h"

namespace lajolla {

struct DisneyClearcoat {
    static constexpr const char *name = "disneyclearcoat";
    static constexpr const char *doc = "Thin clear coat, part of disneybsdf (Burley 2012, section 5.4).";
    Texture<float> clearcoat_gloss{1};

    static constexpr auto fields() {
        return std::tuple(field("clearcoat_gloss", &DisneyClearcoat::clearcoat_gloss,
                                "0 is satin (alpha 0.1), 1 is glossy (alpha 0.001)")
                              .range(0, 1));
    }

    BsdfTraits traits() const { return {}; }

    template <class Float>
    struct Lobe {
        disney::Clearcoat<Float> coat;

        Float roughness() const { return coat.roughness(); }

        BsdfEval<Float> eval(const Vec3<Float> &wo, const Vec3<Float> &wi) const {
            const auto [m, cos_d] = disney::halfway(wo, wi);
            const Float density = coat.density(m);
            const Float f = coat.fresnel(disney::schlick_weight(cos_d)) * density * coat.masking(wo) *
                            coat.masking(wi) / (4 * wo.z);
            return select(wo.z > 0.0f && wi.z > 0.0f,
                          BsdfEval<Float>{Rgb<Float>(f), density * m.z / (4 * cos_d)}, {});
        }

        BsdfSample<Float> sample(const Vec3<Float> &wo, Float, const Vec2<Float> &u) const {
            const Vec3<Float> m = coat.sample(u), wi = reflect(wo, m);
            const Float cos_d = dot(wo, m);
            const Float weight = coat.fresnel(disney::schlick_weight(cos_d)) * coat.masking(wo) *
                                 coat.masking(wi) * cos_d / (wo.z * m.z);
            const Float pdf = coat.density(m) * m.z / (4 * cos_d);
            return {.valid = wo.z > 0.0f && wi.z > 0.0f && pdf > 0.0f,
                    .wi = wi,
                    .weight = Rgb<Float>(weight),
                    .pdf = pdf,
                    .width = roughness()};
        }
    };

    template <class Float>
    Lobe<Float> prepare(const auto &read) const {
        return {disney::Clearcoat<Float>(disney::fraction(read(clearcoat_gloss)))};
    }
};

} // namespace lajolla
