#pragma once

#include "scatter/bsdf.h"

namespace lajolla {

struct Null {
    static constexpr const char *name = "null";
    static constexpr const char *doc =
        "Nothing at all: light passes straight through. Bounds media and carries lights.";

    static constexpr auto fields() { return std::tuple(); }

    struct Lobe {
        static constexpr bool transmissive = true, delta = true;

        float roughness() const { return 0; }
        Passage straight(Vec3f) const { return {Spectrum(1), 1}; }
        BsdfEval eval(Vec3f, Vec3f) const { return {}; }
        std::optional<BsdfSample> sample(Vec3f wo, float, Vec2f) const {
            return BsdfSample{-wo, Spectrum(1), 1, 1, ScatterKind::null};
        }
    };

    Lobe prepare(const auto &) const { return {}; }
};

} // namespace lajolla
