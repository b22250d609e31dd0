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
        "Leaves, paper, foils and panes: a surface without inside, as Mitsuba 3 defines it (Burley 2015).";
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
            field("flatness", &PrincipledThin::flatness, "flatter, as if light spread under the surface")
                .range(0, 1),
            field("diff_trans", &PrincipledThin::diff_trans,
                  "0 reflects all diffuse light, 2 transmits all of it")
                .range(0, 2),
            field("multiscatter", &PrincipledThin::multiscatter,
                  "give back the light that bounces between microfacets, where eta is a number and "
                  "anisotropic is 0"));
    }

    struct Lobe {
        static constexpr bool transmissive = true, delta = false;
        Microfacet front, through; // of reflection and of transmission
        float eta;
        Spectrum base;
        Spectrum tinted;        // the part of the reflection at normal incidence that has a hue
        float spec_tint, glass; // share of that, and of the specular part altogether
        float diffuse, diffuse_through, surface_roughness, flatness; // shares and shape of the rest
        disney::Tint sheen;
        const LostLight *lost = nullptr; // where multiple scattering counts

        float roughness() const {
            return diffuse > 0 || diffuse_through > 0 ? 1 : std::max(front.roughness(), through.roughness());
        }

        // Both sides are alike.
        [[gnu::noinline]] BsdfEval eval(const Vec3f &wo, const Vec3f &wi) const {
            return wo.z > 0 ? eval_above(wo, wi, choice(wo)) : eval_above(-wo, -wi, choice(-wo));
        }
        [[gnu::noinline]] std::optional<BsdfSample> sample(const Vec3f &wo, float u_lobe,
                                                           const Vec2f &u) const {
            if (wo.z > 0) return sample_above(wo, u_lobe, u);
            auto s = sample_above(-wo, u_lobe, u);
            if (s) s->wi = -s->wi;
            return s;
        }

    private:
        struct Choice {                                        // probabilities
            float reflect, transmit, diffuse, diffuse_through; // the last two with the lost light
        };

        static Vec3f mirror(Vec3f w) { return {w.x, w.y, -w.z}; }

        Spectrum reflectance(float cos_d) const {
            const auto [f, cos_t] = fresnel_dielectric(cos_d, eta);
            const float w = disney::schlick_weight(eta > 1 ? cos_d : cos_t);
            return Spectrum(f * (1 - spec_tint) + w * spec_tint) + tinted * (1 - w);
        }
        Spectrum transmittance(float cos_d) const {
            return base * (1 - fresnel_dielectric(cos_d, eta).reflectance);
        }

        // Of the lost light: the fraction that is reflected in the end, as much as at a smooth boundary.
        float reflecting() const { return fresnel_diffuse_reflectance(eta); }
        [[gnu::noinline]] float lost_light(const Vec3f &wo, const Vec3f &wi) const { // over cos / pi
            const float mean = std::max(lost->mean(front), 1e-6f);
            return glass * (*lost)(front, wo) * (*lost)(front, wi) / mean;
        }

        // By estimates of what the parts scatter towards wo. Facets seen at grazing angles are tilted, the
        // rougher the more: the mean of level and tilted ones.
        Choice choice(Vec3f wo) const {
            const float cos_o = wo.z;
            const float alpha2 = sqr(front.roughness());
            const float tilted = std::sqrt((sqr(cos_o) + alpha2) / (1 + alpha2));
            const float r = glass / 2 * mean(reflectance(cos_o) + reflectance(tilted));
            const float t = glass / 2 * mean(transmittance(cos_o) + transmittance(tilted));
            const float w = disney::schlick_weight(cos_o);
            float d = diffuse * (mean(base) * (1 + (surface_roughness - 0.5f) * w) +
                                 mean(sheen(base)) * disney::sheen_albedo(cos_o));
            float d_t = diffuse_through * mean(base);
            if (lost) {
                const float regained = glass * (*lost)(front, wo);
                d += regained * reflecting();
                d_t += regained * (1 - reflecting()) * mean(base);
            }
            const float total = std::max(r + t + d + d_t, 1e-30f);
            return {r / total, t / total, d / total, d_t / total};
        }

        BsdfEval eval_above(Vec3f wo, Vec3f wi, Choice p) const {
            if (wo.z <= 0 || wi.z == 0) return {};
            return wi.z > 0 ? eval_reflected(wo, wi, p) : eval_transmitted(wo, wi, p);
        }
        BsdfEval eval_reflected(Vec3f wo, Vec3f wi, Choice p) const {
            const auto [m, cos_d] = disney::halfway(wo, wi);
            const float cosine = cosine_hemisphere_pdf(wi.z);
            const float shape = disney::diffuse(wo.z, wi.z, cos_d, surface_roughness, flatness);
            const Spectrum cloth = sheen(base) * (disney::schlick_weight(cos_d) * wi.z);
            BsdfEval e{(base * (shape * cosine) + cloth) * diffuse, cosine * p.diffuse};
            if (glass > 0) {
                const float density = front.visible(wo, m) / 4;
                e.f_cos += reflectance(cos_d) * (glass * density * front.masking(wi));
                e.pdf += density * p.reflect;
            }
            if (lost) e.f_cos += Spectrum(lost_light(wo, wi) * reflecting() * cosine);
            return e;
        }
        // Specular transmission is reflection turned to the other side, by a surface whose roughness depends
        // on eta (Burley 2015, section 4.2). What would meet a facet from behind is lost, as in Mitsuba.
        BsdfEval eval_transmitted(Vec3f wo, Vec3f wi, Choice p) const {
            const float cosine = cosine_hemisphere_pdf(-wi.z);
            BsdfEval e{base * (diffuse_through * cosine), cosine * p.diffuse_through};
            if (lost) e.f_cos += base * (lost_light(wo, mirror(wi)) * (1 - reflecting()) * cosine);
            if (glass > 0) {
                const auto [m, cos_d] = disney::halfway(wo, mirror(wi));
                if (dot(wi, m) >= 0) return e;
                const float density = through.visible(wo, m) / 4;
                e.f_cos += transmittance(cos_d) * (glass * density * through.masking(wi));
                e.pdf += density * p.transmit;
            }
            return e;
        }

        std::optional<BsdfSample> sample_above(Vec3f wo, float u_lobe, Vec2f u) const {
            if (wo.z <= 0) return std::nullopt;
            const Choice p = choice(wo);
            const Microfacet &surface = u_lobe < p.reflect ? front : through;
            const bool specular = u_lobe < p.reflect + p.transmit;
            Vec3f wi;
            if (specular) {
                const Vec3f m = surface.sample_visible(wo, u);
                wi = reflect(wo, m);
                if (wi.z <= 0) return std::nullopt;
                if (u_lobe >= p.reflect) wi = mirror(wi);
                if (u_lobe >= p.reflect && dot(wi, m) >= 0) return std::nullopt;
            } else {
                wi = sample_cosine_hemisphere(u);
                if (u_lobe >= p.reflect + p.transmit + p.diffuse) wi = -wi;
            }
            const BsdfEval e = eval_above(wo, wi, p);
            if (!(e.pdf > 1e-30f)) return std::nullopt;
            if (!specular) return BsdfSample{wi, e.f_cos / e.pdf, e.pdf};
            return BsdfSample{wi, e.f_cos / e.pdf, e.pdf, 1, ScatterKind::glossy, surface.roughness()};
        }
    };

    void build() {
        if (!multiscatter) return;
        if (!eta.is_constant() || anisotropic != Texture<float>(0)) // tables would need more coordinates
            throw std::invalid_argument("multiscatter needs an eta that is a number, and anisotropic 0");
        const auto loss = [index = index_of(eta.constant)](const Microfacet &surface, Vec3f w, int n) {
            const float reflected = surface.mean_over_visible(
                w, n, [&](Vec3f m) { return detail::reflected_fraction(surface, w, m, index); });
            const Microfacet beyond = through(std::sqrt(surface.larger_alpha()), 0, index);
            const float transmitted = beyond.mean_over_visible(
                w, n, [&](Vec3f m) { return transmitted_fraction(beyond, w, m, index); });
            return std::max(1 - reflected - transmitted, 0.0f);
        };
        lost_ = std::make_shared<LostLight>(front(disney::fraction(roughness.constant), 0),
                                            !roughness.is_constant(), loss);
    }

    [[gnu::noinline]] Lobe prepare(const auto &read) const {
        const auto share = [&](const Texture<float> &texture) { return disney::fraction(read(texture)); };
        const Spectrum base = disney::colour(read(base_color));
        const float rough = share(roughness), stretch = share(anisotropic), tint = share(spec_tint);
        const float index = index_of(read(eta)), t = share(spec_trans);
        const float passing = disney::fraction(read(diff_trans) / 2);
        return {.front = front(rough, stretch),
                .through = through(rough, stretch, index),
                .eta = index,
                .base = base,
                .tinted = disney::Tint(base, 1)(base) * (tint * disney::reflectance_of_index(index)),
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
    static float index_of(float eta) { return std::min(std::max(1e-3f, eta), 1e3f); }
    static Microfacet front(float roughness, float stretch) {
        return disney::microfacets(roughness, stretch, 1e-3f);
    }
    static Microfacet through(float roughness, float stretch, float index) {
        const float widening = 0.65f * index - 0.35f; // Burley 2015, figure 15
        return disney::microfacets(roughness * widening, stretch, 1e-3f);
    }
    // Of light along w on a facet of normal m, without tint: what Lobe::eval_transmitted makes of it.
    static float transmitted_fraction(const Microfacet &surface, Vec3f w, Vec3f m, float index) {
        const Vec3f wi = reflect(w, m); // mirrored then
        const bool passes = wi.z > 0 && dot(Vec3f{wi.x, wi.y, -wi.z}, m) < 0;
        return passes ? (1 - fresnel_dielectric(dot(w, m), index).reflectance) * surface.masking(wi) : 0;
    }

    std::shared_ptr<const LostLight> lost_;
};

} // namespace lajolla
