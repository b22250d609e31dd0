#pragma once

#include "base/frame.h"
#include "scatter/gloss.h"

namespace lajolla {

// Phong 1975, "Illumination for Computer Generated Pictures", normalized as by Lafortune and Willems 1994,
// "Using the Modified Phong Reflectance Model for Physically Based Rendering".
struct Phong {
    static constexpr const char *name = "phong";
    static constexpr const char *doc = "A diffuse base with highlights, as in the early days.";
    Texture<float> exponent{30};
    Texture<Spectrum> diffuse_reflectance{Spectrum(0.5f)}, specular_reflectance{Spectrum(0.2f)};

    static constexpr auto fields() {
        return std::tuple(
            field("exponent", &Phong::exponent, "the higher, the smaller the highlights").range(0),
            field("diffuse_reflectance", &Phong::diffuse_reflectance, "fraction of light the base reflects")
                .range(0, 1),
            field("specular_reflectance", &Phong::specular_reflectance,
                  "fraction of light in the highlights; with the base's at most one")
                .range(0, 1));
    }

    // A power of the cosine around the mirrored direction.
    struct Gloss {
        float exponent;

        // Beckmann's roughness of about the same width (Walter et al. 2007, section 5.1).
        float roughness() const { return std::sqrt(2 / (exponent + 2)); }

        GlossValue eval(Vec3f wo, Vec3f wi) const {
            // 1 - cos from the difference of the directions: the cosine itself is too coarse near one
            const float height = length_squared(wi - mirrored(wo)) / 2;
            if (height >= 1) return {0, 0};
            const float lobe = std::exp(exponent * std::log1p(-height)) / (2 * pi);
            return {(exponent + 2) * lobe * wi.z, (exponent + 1) * lobe};
        }
        Vec3f sample(Vec3f wo, Vec2f u) const {
            const float height = -std::expm1(std::log(1 - u.x) / (exponent + 1));
            const float r = std::sqrt(height * (2 - height)), phi = 2 * pi * u.y;
            return normalize(
                frame_around(mirrored(wo)).to_world({r * std::cos(phi), r * std::sin(phi), 1 - height}));
        }

    private:
        static Vec3f mirrored(Vec3f w) { return {-w.x, -w.y, w.z}; }
    };
    using Lobe = GlossyAndDiffuse<Gloss>;

    Lobe prepare(const auto &read) const {
        return {{std::max(read(exponent), 0.0f)}, read(diffuse_reflectance), read(specular_reflectance)};
    }
};

} // namespace lajolla
