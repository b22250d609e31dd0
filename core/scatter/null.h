#pragma once

#include "scatter/bsdf.h"

namespace lajolla {

struct Null {
    static constexpr const char *name = "null";
    static constexpr const char *doc =
        "Nothing at all: light passes straight through. Bounds media and carries lights.";

    static constexpr auto fields() { return std::tuple(); }

    BsdfTraits traits() const { return {.transmissive = true, .delta = true, .null_transmission = true}; }

    template <class Float>
    struct Lobe {
        float roughness() const { return 0; }
        NullTransmission<Float> null_transmission(const Vec3<Float> &) const { return {Rgb<Float>(1), 1}; }
        BsdfEval<Float> eval(const Vec3<Float> &, const Vec3<Float> &) const { return {}; }
        BsdfSample<Float> sample(const Vec3<Float> &wo, Float, const Vec2<Float> &) const {
            return {.valid = true, .wi = -wo, .weight = Rgb<Float>(1), .pdf = 1, .delta = true, .width = 0};
        }
    };

    template <class Float>
    Lobe<Float> prepare(const auto &) const {
        return {};
    }
};

} // namespace lajolla
