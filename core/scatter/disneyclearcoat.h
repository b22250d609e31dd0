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

    struct Lobe {
        static constexpr bool transmissive = false, delta = false;
        disney::Clearcoat coat;

        float roughness() const { return coat.roughness(); }

        BsdfEval eval(Vec3f wo, Vec3f wi) const {
            if (wo.z <= 0 || wi.z <= 0) return {};
            const auto [m, cos_d] = disney::halfway(wo, wi);
            const float density = coat.density(m);
            const float f = coat.fresnel(disney::schlick_weight(cos_d)) * density * coat.masking(wo) *
                            coat.masking(wi) / (4 * wo.z);
            return {Spectrum(f), density * m.z / (4 * cos_d)};
        }

        std::optional<BsdfSample> sample(Vec3f wo, float, Vec2f u) const {
            const Vec3f m = coat.sample(u);
            if (dot(wo, m) <= 0) return std::nullopt;
            const Vec3f wi = reflect(wo, m);
            const BsdfEval e = eval(wo, wi);
            if (!(e.pdf > 0)) return std::nullopt;
            return BsdfSample{wi, e.f_cos / e.pdf, e.pdf, 1, ScatterKind::glossy, roughness()};
        }
    };

    Lobe prepare(const auto &read) const {
        return {disney::Clearcoat(disney::fraction(read(clearcoat_gloss)))};
    }
};

} // namespace lajolla
