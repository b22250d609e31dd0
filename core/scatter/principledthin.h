#pragma once

#include <memory>

#include "base/warp.h"
#include "scatter/disney.h"
#include "scatter/fresnel.h"
#include "scatter/multiscatter.h"

namespace lajolla {

struct PrincipledThin {
    static constexpr const char *name = "principledthin";
    static constexpr const char *doc =
        "Leaves, paper and films: a surface without interior, as in Mitsuba 3 (Burley 2015).";
    Texture<Spectrum> base_color{Spectrum(0.5f)};
    Texture<float> roughness{0.5f}, anisotropic{0}, spec_trans{0}, eta{1.5f}, spec_tint{0}, sheen{0},
        sheen_tint{0}, flatness{0}, diff_trans{0};
    bool multiscatter = false;

    static constexpr auto fields() {
        return std::tuple(
            field("base_color", &PrincipledThin::base_color, "color of everything but reflections")
                .range(0, 1),
            field("roughness", &PrincipledThin::roughness, "square root of alpha, which is at least 0.001")
                .range(0, 1),
            field("anisotropic", &PrincipledThin::anisotropic, "stretches highlights along the tangent")
                .range(0, 1),
            field("spec_trans", &PrincipledThin::spec_trans, "0 is diffuse, 1 is glass").range(0, 1),
            field("eta", &PrincipledThin::eta, "index of refraction relative to both sides, 0.001 to 1000")
                .range(0),
            field("spec_tint", &PrincipledThin::spec_tint,
                  "gives the reflection of glass the hue of the base color")
                .range(0, 1),
            field("sheen", &PrincipledThin::sheen, "reflection of cloth at grazing angles").range(0, 1),
            field("sheen_tint", &PrincipledThin::sheen_tint, "gives sheen the hue of the base color")
                .range(0, 1),
            field("flatness", &PrincipledThin::flatness,
                  "flattened shape that approximates subsurface scattering")
                .range(0, 1),
            field("diff_trans", &PrincipledThin::diff_trans,
                  "0 reflects all diffuse light, 2 transmits all of it")
                .range(0, 2),
            field("multiscatter", &PrincipledThin::multiscatter,
                  "compensate the energy lost by single scattering; needs a constant eta and "
                  "anisotropic 0"));
    }

    BsdfTraits traits() const {
        return {.transmissive = true,
                .anisotropic = anisotropic != Texture<float>(0),
                .diffuse_colour = &base_color};
    }

    template <class Float>
    struct Lobe {
        Microfacet<Float> front, through; // of reflection and of transmission
        Float eta;
        Rgb<Float> base;
        Rgb<Float> tinted;      // the part of the reflection at normal incidence that has a hue
        Float spec_tint, glass; // share of that, and of the specular part altogether
        Float diffuse, diffuse_through, surface_roughness, flatness; // shares and shape of the rest
        disney::Tint<Float> sheen;
        const LostLight *lost = nullptr; // for multiple scattering

        Float roughness() const {
            return select(diffuse > 0.0f || diffuse_through > 0.0f, Float(1),
                          max(front.roughness(), through.roughness()));
        }

        // Both sides are equal.
        [[gnu::noinline]] BsdfEval<Float> eval(const Vec3<Float> &wo, const Vec3<Float> &wi) const {
            const Vec3<Float> above = turned(wo, wo);
            return eval_above(above, turned(wi, wo), choice(above));
        }
        [[gnu::noinline]] BsdfSample<Float> sample(const Vec3<Float> &wo, Float u_lobe,
                                                   const Vec2<Float> &u) const {
            BsdfSample<Float> s = sample_above(turned(wo, wo), u_lobe, u);
            s.wi = turned(s.wi, wo);
            return s;
        }

    private:
        using Bool = BoolOf<Float>;

        struct Choice {                                        // probabilities
            Float reflect, transmit, diffuse, diffuse_through; // the last two include the lost light
        };

        // Flips directions if wo is below.
        static Vec3<Float> turned(const Vec3<Float> &w, const Vec3<Float> &wo) {
            return select(wo.z > 0.0f, w, -w);
        }
        static Vec3<Float> up(const Vec3<Float> &w) { return {w.x, w.y, abs(w.z)}; }

        // Both surfaces have their long axis along the tangent.
        Microfacet<Float> surface(Bool reflects) const {
            return {MicrofacetKind::ggx, select(reflects, front.larger_alpha(), through.larger_alpha()),
                    select(reflects, front.smaller_alpha(), through.smaller_alpha())};
        }
        Rgb<Float> reflectance(Float cos_d) const {
            const auto [f, cos_t] = fresnel_dielectric(cos_d, eta);
            const Float w = disney::schlick_weight(select(eta > 1.0f, cos_d, cos_t));
            return Rgb<Float>(f * (1 - spec_tint) + w * spec_tint) + tinted * (1 - w);
        }
        Rgb<Float> transmittance(Float cos_d) const {
            return base * (1 - fresnel_dielectric(cos_d, eta).reflectance);
        }

        // The fraction of the lost light that is finally reflected, as at a smooth boundary.
        Float reflecting() const { return 1 - fresnel_diffuse_transmittance(eta); }
        // Over cos / pi.
        [[gnu::noinline]] Float lost_light(const Vec3<Float> &wo, const Vec3<Float> &wi) const {
            const Float mean = max(lost->mean(front), Float(1e-6f));
            return glass * (*lost)(front, wo) * (*lost)(front, wi) / mean;
        }

        // Estimates of the light that each part scatters towards wo. Facets visible at grazing angles are
        // tilted, the rougher the more: uses the mean of level and tilted ones.
        Choice choice(const Vec3<Float> &wo) const {
            const Float cos_o = wo.z;
            const Float alpha2 = sqr(front.roughness());
            const Float tilted = sqrt((sqr(cos_o) + alpha2) / (1 + alpha2));
            const Float r = glass / 2 * mean(reflectance(cos_o) + reflectance(tilted));
            const Float t = glass / 2 * mean(transmittance(cos_o) + transmittance(tilted));
            const Float w = disney::schlick_weight(cos_o);
            Float d = diffuse * (mean(base) * (1 + (surface_roughness - 0.5f) * w) +
                                 mean(sheen(base)) * disney::sheen_albedo(cos_o));
            Float d_t = diffuse_through * mean(base);
            if (lost) {
                const Float regained = glass * (*lost)(front, wo);
                d += regained * reflecting();
                d_t += regained * (1 - reflecting()) * mean(base);
            }
            const Float total = max(r + t + d + d_t, Float(1e-30f));
            return {r / total, t / total, d / total, d_t / total};
        }

        // Specular transmission is reflection flipped to the other side, by a surface whose roughness depends
        // on eta (Burley 2015, section 4.2). Light that hits a facet from behind is lost, as in Mitsuba.
        BsdfEval<Float> eval_above(const Vec3<Float> &wo, const Vec3<Float> &wi, const Choice &p) const {
            const auto valid = wo.z > 0.0f && wi.z != 0.0f, reflected = wi.z > 0.0f;
            if (!any(valid)) return {};
            const auto [m, cos_d] = disney::halfway(wo, up(wi));
            const Float cosine = cosine_hemisphere_pdf(abs(wi.z));
            const Float shape = disney::diffuse(wo.z, abs(wi.z), cos_d, surface_roughness, flatness);
            const Rgb<Float> cloth = sheen(base) * (disney::schlick_weight(cos_d) * wi.z);
            BsdfEval<Float> e{select(reflected, (base * (shape * cosine) + cloth) * diffuse,
                                     base * (diffuse_through * cosine)),
                              cosine * select(reflected, p.diffuse, p.diffuse_through)};
            if (any(glass > 0.0f)) {
                const Microfacet<Float> facets = surface(reflected);
                const auto meets = reflected || dot(wi, m) < 0.0f;
                const Float density = select(meets, facets.visible(wo, m) / 4, Float(0));
                e.f_cos += select(reflected, reflectance(cos_d), transmittance(cos_d)) *
                           (glass * density * facets.masking(wi));
                e.pdf += density * select(reflected, p.reflect, p.transmit);
            }
            if (lost)
                e.f_cos += select(reflected, Rgb<Float>(reflecting()), base * (1 - reflecting())) *
                           (lost_light(wo, up(wi)) * cosine);
            return select(valid, e, {});
        }

        BsdfSample<Float> sample_above(const Vec3<Float> &wo, Float u_lobe, const Vec2<Float> &u) const {
            const Choice p = choice(wo);
            const auto reflects = u_lobe < p.reflect, specular = u_lobe < p.reflect + p.transmit;
            const Microfacet<Float> facets = surface(reflects);
            Vec3<Float> wi = sample_cosine_hemisphere(u);
            wi = select(u_lobe < p.reflect + p.transmit + p.diffuse, wi, -wi);
            Bool lost_at_facet = false;
            if (any(specular)) {
                const Vec3<Float> m = facets.sample_visible(wo, u), mirrored = reflect(wo, m),
                                  w{mirrored.x, mirrored.y, select(reflects, mirrored.z, -mirrored.z)};
                lost_at_facet = specular && !(mirrored.z > 0.0f && (reflects || dot(w, m) < 0.0f));
                wi = select(specular, w, wi);
            }
            const BsdfEval<Float> e = eval_above(wo, wi, p);
            return {.valid = !lost_at_facet && e.pdf > 1e-30f,
                    .wi = wi,
                    .weight = e.f_cos / e.pdf,
                    .pdf = e.pdf,
                    .width = select(specular, facets.roughness(), Float(1))};
        }
    };

    void build() {
        if (!multiscatter) return;
        if (!eta.is_constant() || anisotropic != Texture<float>(0)) // tables would need more coordinates
            throw std::invalid_argument("multiscatter needs an eta that is a number, and anisotropic 0");
        const auto loss = [index = index_of(eta.constant)](const Microfacet<float> &surface, Vec3f w, int n) {
            const float reflected = surface.mean_over_visible(
                w, n, [&](Vec3f m) { return detail::reflected_fraction(surface, w, m, index); });
            const Microfacet<float> beyond = through(sqrt(surface.larger_alpha()), 0, index);
            const float transmitted = beyond.mean_over_visible(
                w, n, [&](Vec3f m) { return transmitted_fraction(beyond, w, m, index); });
            return max(1 - reflected - transmitted, 0.0f);
        };
        const Microfacet<float> surface = front(disney::fraction(roughness.constant), 0);
        const bool varies = !roughness.is_constant();
        lost_ = shared_table(key_of(surface, std::uint32_t{varies}, eta.constant),
                             [&] { return LostLight(surface, varies, loss); });
    }

    template <class Float>
    [[gnu::noinline]] Lobe<Float> prepare(const auto &read) const {
        const auto share = [&](const Texture<float> &texture) { return disney::fraction(read(texture)); };
        const Rgb<Float> base = disney::colour(read(base_color));
        const Float rough = share(roughness), stretch = share(anisotropic), tint = share(spec_tint);
        const Float index = index_of(read(eta)), t = share(spec_trans);
        const Float passing = disney::fraction(read(diff_trans) / 2);
        return {.front = front(rough, stretch),
                .through = through(rough, stretch, index),
                .eta = index,
                .base = base,
                .tinted = disney::Tint(base, Float(1))(base) * (tint * disney::reflectance_of_index(index)),
                .spec_tint = tint,
                .glass = t,
                .diffuse = (1 - t) * (1 - passing),
                .diffuse_through = (1 - t) * passing,
                .surface_roughness = rough,
                .flatness = share(flatness),
                .sheen = disney::Tint(base, share(sheen_tint)) * share(sheen),
                .lost = lost_.get()};
    }

private:
    template <class Float>
    static Float index_of(Float eta) {
        return clamp_number(eta, least_index, largest_index);
    }
    template <class Float>
    static Microfacet<Float> front(Float roughness, std::type_identity_t<Float> stretch) {
        return disney::microfacets(roughness, stretch, 1e-3f);
    }
    template <class Float>
    static Microfacet<Float> through(Float roughness, std::type_identity_t<Float> stretch, Float index) {
        const Float widening = 0.65f * index - 0.35f; // Burley 2015, figure 15
        return disney::microfacets(roughness * widening, stretch, 1e-3f);
    }
    // The untinted transmission of light along w at a facet of normal m, as in Lobe::eval_transmitted.
    static float transmitted_fraction(const Microfacet<float> &surface, Vec3f w, Vec3f m, float index) {
        const Vec3f wi = reflect(w, m); // flipped afterwards
        const bool passes = wi.z > 0 && dot(Vec3f{wi.x, wi.y, -wi.z}, m) < 0;
        return passes ? (1 - fresnel_dielectric(dot(w, m), index).reflectance) * surface.masking(wi) : 0;
    }

    std::shared_ptr<const LostLight> lost_;
};

} // namespace lajolla
