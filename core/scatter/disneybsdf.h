#pragma once

#include "scatter/principledlobe.h"

namespace lajolla {

// Burley's model as lajolla's course defines it (Li, "CSE 272", UC San Diego, homework 1): no thin surfaces,
// no subsurface transport, sheen in reflection only, and only glass inside.
struct DisneyBsdf {
    static constexpr const char *name = "disneybsdf";
    static constexpr const char *doc =
        "Everything from cloth to metal to glass in one model, as lajolla defines it (Burley 2015).";
    Texture<Spectrum> base_color{Spectrum(0.5f)};
    Texture<float> specular_transmission{0}, metallic{0}, subsurface{0}, specular{0.5f}, roughness{0.5f},
        specular_tint{0}, anisotropic{0}, sheen{0}, sheen_tint{0.5f}, clearcoat{0}, clearcoat_gloss{1};
    float eta = 1.5f;
    bool multiscatter = false;

    static constexpr auto fields() {
        return std::tuple(
            field("base_color", &DisneyBsdf::base_color, "color of everything but clear coats").range(0, 1),
            field("specular_transmission", &DisneyBsdf::specular_transmission, "0 is opaque, 1 is glass")
                .range(0, 1),
            field("metallic", &DisneyBsdf::metallic, "0 is a dielectric, 1 is a metal").range(0, 1),
            field("subsurface", &DisneyBsdf::subsurface,
                  "flattened shape that approximates subsurface scattering")
                .range(0, 1),
            field("specular", &DisneyBsdf::specular, "strength of an opaque dielectric's reflection")
                .range(0, 1),
            field("roughness", &DisneyBsdf::roughness, "square root of alpha, which is at least 0.0001")
                .range(0, 1),
            field("specular_tint", &DisneyBsdf::specular_tint,
                  "gives that reflection the hue of the base color")
                .range(0, 1),
            field("anisotropic", &DisneyBsdf::anisotropic, "stretches highlights along the tangent")
                .range(0, 1),
            field("sheen", &DisneyBsdf::sheen, "reflection of cloth at grazing angles").range(0, 1),
            field("sheen_tint", &DisneyBsdf::sheen_tint, "gives sheen the hue of the base color").range(0, 1),
            field("clearcoat", &DisneyBsdf::clearcoat, "strength of a clear coat").range(0, 1),
            field("clearcoat_gloss", &DisneyBsdf::clearcoat_gloss,
                  "0 is satin (alpha 0.1), 1 is glossy (alpha 0.001)")
                .range(0, 1),
            field("eta", &DisneyBsdf::eta, "index of refraction inside, relative to outside")
                .range(least_index, largest_index),
            field("multiscatter", &DisneyBsdf::multiscatter,
                  "compensate the energy lost by single scattering in reflection"));
    }

    struct Rules {
        static constexpr bool tinted_reflection = true;
        template <class Float>
        static Float schlick(Float cos_o, Float, float) {
            return disney::schlick_weight(cos_o);
        }
        template <class Float>
        static Float clearcoat(Float cos_o, Float) {
            return 1 / (4 * cos_o);
        }
    };
    template <class Float>
    using Lobe = PrincipledLobe<Float, Rules>;

    BsdfTraits traits() const {
        return {.transmissive = specular_transmission != Texture<float>(0),
                .anisotropic = anisotropic != Texture<float>(0),
                .diffuse_colour = &base_color};
    }
    void build() {
        if (traits().transmissive) eta = bending_index(eta);
        if (multiscatter) lost_ = disney::lost_by_reflection(roughness, anisotropic, least_alpha);
    }

    template <class Float>
    [[gnu::noinline]] Lobe<Float> prepare(const auto &read) const {
        const auto share = [&](const Texture<float> &texture) { return disney::fraction(read(texture)); };
        const Rgb<Float> base = disney::colour(read(base_color));
        const Float m = share(metallic), t = share(specular_transmission), gloss = 1 - t * (1 - m);
        const Float normal = share(specular) * disney::reflectance_of_index(eta) * (1 - m);
        const Float rough = share(roughness);
        return {.surface = disney::microfacets(rough, share(anisotropic), least_alpha),
                .coat = disney::Clearcoat<Float>(share(clearcoat_gloss)),
                .eta = eta,
                .base = base,
                .metal = (disney::Tint(base, share(specular_tint))(base) * normal + base * m) * gloss,
                .metal_edge = gloss,
                .dielectric = 0,
                .glass = (1 - m) * t,
                .diffuse = (1 - m) * (1 - t),
                .surface_roughness = rough,
                .flatness = share(subsurface),
                .sheen = disney::Tint(base, share(sheen_tint)) * ((1 - m) * share(sheen)),
                .coat_share = share(clearcoat) / 4,
                .lost = lost_.get()};
    }

private:
    static constexpr float least_alpha = 1e-4f;
    std::shared_ptr<const LostLight> lost_;
};

} // namespace lajolla
