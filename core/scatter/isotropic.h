#pragma once

#include "base/warp.h"
#include "scatter/phase.h"

namespace lajolla {

struct Isotropic {
    static constexpr const char *name = "isotropic";
    static constexpr const char *doc = "Isotropic scattering.";

    static constexpr auto fields() { return std::tuple(); }

    struct Lobe {
        float eval(Vec3f, Vec3f) const { return sphere_pdf; }
        PhaseSample sample(Vec3f, Vec2f u) const { return {sample_sphere(u), sphere_pdf}; }
        float projected_area(Vec3f) const { return 1; }
    };

    Lobe prepare(const auto &) const { return {}; }
};

} // namespace lajolla
