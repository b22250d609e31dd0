#pragma once

#include "base/warp.h"
#include "scatter/phase.h"

namespace lajolla {

// Henyey and Greenstein 1941, "Diffuse radiation in the Galaxy".
struct HenyeyGreenstein {
    static constexpr const char *name = "hg";
    static constexpr const char *doc = "Henyey-Greenstein: forward (g > 0) or backward (g < 0) scattering.";
    float g = 0.8f;

    static constexpr auto fields() {
        return std::tuple(
            field("g", &HenyeyGreenstein::g, "mean cosine of the deflection").range(-0.999, 0.999));
    }

    struct Lobe {
        float g;

        // (1 - g^2) / (4 pi (1 + g^2 - 2 g cos)^(3/2)), around the axis to which g points, where
        // 1 + g^2 - 2 g cos = (1 - g)^2 + 2 g (1 - cos) has no cancellation.
        float eval(Vec3f wo, Vec3f wi) const {
            const float a = std::abs(g), h = deflection(g > 0 ? wo : -wo, wi);
            const float d = sqr(1 - a) + 2 * a * h;
            return sphere_pdf * (1 - a) * (1 + a) / (d * std::sqrt(d));
        }

        // The inverse of the cumulative distribution, written for 1 - cos.
        PhaseSample sample(Vec3f wo, Vec2f u) const {
            const float a = std::abs(g), b = 1 - a + 2 * a * u.x;
            const float h = sqr(1 - a) * (1 - u.x) / b * ((1 + a) / b + 1);
            const Vec3f wi = direction_around(g > 0 ? -wo : wo, h, u.y);
            return {wi, eval(wo, wi)};
        }
        float projected_area(Vec3f) const { return 1; }
    };

    Lobe prepare(const auto &) const { return {g}; }
};

} // namespace lajolla
