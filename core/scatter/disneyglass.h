#pragma once

#include "scatter/disney.h"
#include "scatter/roughdielectric.h"

namespace lajolla {

struct DisneyGlass {
    static constexpr const char *name = "disneyglass";
    static constexpr const char *doc = "Rough glass, part of disneybsdf (Burley 2015, section 3).";
    Texture<Spectrum> base_color{Spectrum(0.5f)};
    Texture<float> roughness{0.5f}, anisotropic{0};
    float eta = 1.5f;
    bool multiscatter = false;

    static constexpr auto fields() {
        return std::tuple(
            field("base_color", &DisneyGlass::base_color,
                  "tints the reflection, and light that passes two such surfaces")
                .range(0, 1),
            field("roughness", &DisneyGlass::roughness, "square root of alpha, which is at least 0.0001")
                .range(0, 1),
            field("anisotropic", &DisneyGlass::anisotropic, "stretches highlights along the tangent")
                .range(0, 1),
            field("eta", &DisneyGlass::eta, "index of refraction inside, relative to outside")
                .range(least_index, largest_index),
            field("multiscatter", &DisneyGlass::multiscatter,
                  "compensate the energy lost by single scattering; needs anisotropic 0"));
    }

    BsdfTraits traits() const {
        return {.transmissive = true,
                .anisotropic = anisotropic != Texture<float>(0),
                .diffuse_colour = &base_color};
    }

    template <class Float>
    using Lobe = RoughDielectric::Lobe<Float>;

    void build() {
        eta = bending_index(eta);
        if (!multiscatter) return;
        if (anisotropic != Texture<float>(0)) // as in RoughDielectric
            throw std::invalid_argument("multiscatter is for glass of one roughness; anisotropic must be 0");
        lost_ = RoughDielectric::Losses::of(
            disney::microfacets(disney::fraction(roughness.constant), 0, least_alpha),
            !roughness.is_constant(), eta);
    }

    template <class Float>
    Lobe<Float> prepare(const auto &read) const {
        const Rgb<Float> base = disney::colour(read(base_color));
        return {disney::microfacets(disney::fraction(read(roughness)), disney::fraction(read(anisotropic)),
                                    least_alpha),
                eta, base, sqrt(base), lost_.get()};
    }

private:
    static constexpr float least_alpha = 1e-4f;
    std::shared_ptr<const RoughDielectric::Losses> lost_;
};

} // namespace lajolla
