#pragma once

#include "base/warp.h"
#include "scatter/phase.h"

namespace lajolla {

struct Rayleigh {
    static constexpr const char *name = "rayleigh";
    static constexpr const char *doc =
        "Particles much smaller than the wavelength, such as the molecules of air.";

    static constexpr auto fields() { return std::tuple(); }

    struct Lobe {
        // 3 (1 + cos^2) / (16 pi)
        float eval(Vec3f wo, Vec3f wi) const { return 0.75f * sphere_pdf * (1 + sqr(dot(wo, wi))); }

        // Cardano's root of the cumulative distribution (Frisvad 2011, "Importance sampling the Rayleigh
        // phase function").
        PhaseSample sample(Vec3f wo, Vec2f u) const {
            const float z = 4 * u.x - 2, root = pow(abs(z) + sqrt(z * z + 1), 1.0f / 3);
            const float cosine = std::min(root - 1 / root, 1.0f);
            const Vec3f wi = direction_around(z < 0 ? wo : -wo, 1 - cosine, u.y);
            return {wi, eval(wo, wi)};
        }
        float projected_area(Vec3f) const { return 1; }
    };

    Lobe prepare(const auto &) const { return {}; }
};

} // namespace lajolla
