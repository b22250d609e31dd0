#pragma once

#include "base/frame.h"
#include "scatter/gloss.h"

namespace lajolla {

// Phong 1975, "Illumination for Computer Generated Pictures", normalized as by Lafortune and Willems 1994,
// "Using the Modified Phong Reflectance Model for Physically Based Rendering".
struct Phong {
    static constexpr const char *name = "phong";
    static constexpr const char *doc = "Phong model: a diffuse component and a highlight.";
    Texture<float> exponent{30};
    Texture<Spectrum> diffuse_reflectance{Spectrum(0.5f)}, specular_reflectance{Spectrum(0.2f)};

    static constexpr auto fields() {
        return std::tuple(
            field("exponent", &Phong::exponent, "larger values make smaller highlights").range(0),
            field("diffuse_reflectance", &Phong::diffuse_reflectance, "fraction of light the base reflects")
                .range(0, 1),
            field("specular_reflectance", &Phong::specular_reflectance,
                  "fraction of light in the highlights; with the base's at most one")
                .range(0, 1));
    }
    BsdfTraits traits() const { return {.diffuse_colour = &diffuse_reflectance}; }

    // A power of the cosine around the mirrored direction.
    template <class Float>
    struct Gloss {
        Float exponent;

        // Beckmann's roughness of about the same width (Walter et al. 2007, section 5.1).
        Float roughness() const { return sqrt(2 / (exponent + 2)); }

        GlossValue<Float> eval(const Vec3<Float> &wo, const Vec3<Float> &wi) const {
            // 1 - cos from the difference of the directions: the cosine itself has too few digits near one
            const Float height = length_squared(wi - mirrored(wo)) / 2;
            const Float power = exp(exponent * log1p(-height));
            const Float lobe = select(height < 1.0f, power / (2 * pi), Float(0));
            return {(exponent + 2) * lobe * wi.z, (exponent + 1) * lobe};
        }
        Vec3<Float> sample(const Vec3<Float> &wo, const Vec2<Float> &u) const {
            const Float height = -expm1(log(1 - u.x) / (exponent + 1)), r = sqrt(height * (2 - height));
            const auto [sine, cosine] = sine_cosine(2 * pi * u.y);
            return normalize(frame_around(mirrored(wo)).to_world({r * cosine, r * sine, 1 - height}));
        }

    private:
        static Vec3<Float> mirrored(const Vec3<Float> &w) { return {-w.x, -w.y, w.z}; }
    };
    template <class Float>
    using Lobe = GlossyAndDiffuse<Float, Gloss<Float>>;

    template <class Float>
    Lobe<Float> prepare(const auto &read) const {
        return {{max(read(exponent), Float(0))}, read(diffuse_reflectance), read(specular_reflectance)};
    }
};

} // namespace lajolla
