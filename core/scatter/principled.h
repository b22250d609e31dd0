#pragma once

#include "scatter/principledlobe.h"

namespace lajolla {

// Burley's model as in Mitsuba 3, with three differences from Burley: dielectrics use the Fresnel equations,
// Schlick's approximation uses the refracted angle if eta < 1, and the clear coat lacks the two cosines in
// the denominator of microfacet models.
struct Principled {
    static constexpr const char *name = "principled";
    static constexpr const char *doc =
        "Everything from cloth to metal to glass in one model, as Mitsuba 3 defines it (Burley 2015).";
    Texture<Spectrum> base_color{Spectrum(0.5f)};
    Texture<float> roughness{0.5f}, anisotropic{0}, metallic{0}, spec_trans{0}, spec_tint{0}, sheen{0},
        sheen_tint{0}, flatness{0}, clearcoat{0}, clearcoat_gloss{0};
    float eta = 1.5f;
    bool multiscatter = false;

    static constexpr auto fields() {
        return std::tuple(
            field("base_color", &Principled::base_color, "color of everything but clear coats").range(0, 1),
            field("roughness", &Principled::roughness, "square root of alpha, which is at least 0.001")
                .range(0, 1),
            field("anisotropic", &Principled::anisotropic, "stretches highlights along the tangent")
                .range(0, 1),
            field("metallic", &Principled::metallic, "0 is a dielectric, 1 is a metal").range(0, 1),
            field("spec_trans", &Principled::spec_trans, "0 is opaque, 1 is glass").range(0, 1),
            field("eta", &Principled::eta, "index of refraction inside, relative to outside")
                .range(least_index, largest_index),
            field("spec_tint", &Principled::spec_tint,
                  "gives a dielectric's reflection the hue of the base color")
                .range(0, 1),
            field("sheen", &Principled::sheen, "reflection of cloth at grazing angles").range(0, 1),
            field("sheen_tint", &Principled::sheen_tint, "gives sheen the hue of the base color").range(0, 1),
            field("flatness", &Principled::flatness,
                  "flattened shape that approximates subsurface scattering")
                .range(0, 1),
            field("clearcoat", &Principled::clearcoat, "strength of a clear coat").range(0, 1),
            field("clearcoat_gloss", &Principled::clearcoat_gloss,
                  "0 is satin (alpha 0.1), 1 is glossy (alpha 0.001)")
                .range(0, 1),
            field("multiscatter", &Principled::multiscatter,
                  "compensate the energy lost by single scattering in reflection"));
    }

    struct Rules {
        static constexpr bool tinted_reflection = false;
        template <class Float>
        static Float schlick(Float cos_o, Float cos_t, float eta) {
            return disney::schlick_weight(eta > 1 ? cos_o : cos_t);
        }
        template <class Float>
        static Float clearcoat(Float, Float cos_i) {
            return cos_i;
        }
    };
    template <class Float>
    using Lobe = PrincipledLobe<Float, Rules>;

    BsdfTraits traits() const {
        return {.transmissive = spec_trans != Texture<float>(0),
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
        const Float m = share(metallic), t = share(spec_trans), tint = share(spec_tint);
        const Rgb<Float> tinted = disney::Tint(base, Float(1))(base) * disney::reflectance_of_index(eta);
        const Float rough = share(roughness);
        return {.surface = disney::microfacets(rough, share(anisotropic), least_alpha),
                .coat = disney::Clearcoat<Float>(share(clearcoat_gloss)),
                .eta = eta,
                .base = base,
                .metal = base * m + tinted * ((1 - m) * tint),
                .metal_edge = m + (1 - m) * tint,
                .dielectric = (1 - m) * (1 - tint),
                .glass = (1 - m) * t,
                .diffuse = (1 - m) * (1 - t),
                .surface_roughness = rough,
                .flatness = share(flatness),
                .sheen = disney::Tint(base, share(sheen_tint)) * ((1 - m) * share(sheen)),
                .coat_share = share(clearcoat) / 4,
                .lost = lost_.get()};
    }

private:
    static constexpr float least_alpha = 1e-3f;
    std::shared_ptr<const LostLight> lost_;
};

} // namespace lajolla
