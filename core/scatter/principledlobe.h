#pragma once
// The lobe of the models that mix everything: disneybsdf and principled. A diffuse base with sheen, a GGX
// surface that reflects as a metal, as a dielectric or as a mixture, and refracts, and a clear coat. Behind
// the surface, where light travels inside, there is the dielectric alone.
//
// Where the two models differ is in their `Rules`:
//   schlick(cos_o, cos_t, eta)     the weight of Schlick's approximation at a facet
//   clearcoat(cos_o, cos_i)        value over reflectance, density and masking of the coat, with its cosine
//   tinted_reflection              whether a dielectric's reflection takes the base colour, where light is
//                                  inside, too
//
// Its functions are large and stay out of the dispatch that all lobes share.

#include "base/warp.h"
#include "scatter/disney.h"
#include "scatter/fresnel.h"

namespace lajolla {

template <class Rules>
struct PrincipledLobe {
    static constexpr bool transmissive = true, delta = false;
    Microfacet surface;
    disney::Clearcoat coat;
    float eta; // inside relative to outside
    Spectrum base;
    Spectrum metal;   // reflectance at normal incidence of what follows Schlick, times its share
    float metal_edge; // the same at grazing angles
    float dielectric; // share of untinted reflection at the boundary, seen from outside
    float glass;      // share of refraction, and of reflection inside
    float diffuse, surface_roughness, flatness;
    disney::Tint sheen; // scaled by its share
    float coat_share;
    const LostLight *lost = nullptr; // where multiple scattering counts

    float roughness() const {
        return diffuse > 0 || sheen.white > 0 || sheen.hue > 0 ? 1 : glossy_roughness();
    }

    [[gnu::noinline]] BsdfEval eval(const Vec3f &wo, const Vec3f &wi) const {
        return wo.z > 0 ? eval_above(wo, wi, true, choice(wo))
                        : eval_above(mirror(wo), mirror(wi), false, {0, 0, 1});
    }
    [[gnu::noinline]] std::optional<BsdfSample> sample(const Vec3f &wo, float u_lobe, const Vec2f &u) const {
        if (wo.z > 0) return sample_above(wo, u_lobe, u, true, choice(wo));
        auto s = sample_above(mirror(wo), u_lobe, u, false, {0, 0, 1});
        if (s) s->wi = mirror(s->wi);
        return s;
    }

private:
    struct Choice {                   // probabilities
        float diffuse, coat, surface; // the first with the lost light
    };
    // The two ways on from a facet.
    struct Split {
        Spectrum reflected, transmitted;
        float p_reflect, p_transmit; // of choosing either; zero where it is black
        float total;                 // mean of both
        float cos_t;
        float weight; // of Schlick's approximation
    };

    float glossy_roughness() const {
        return coat_share > 0 ? std::max(surface.roughness(), coat.roughness()) : surface.roughness();
    }
    static Vec3f mirror(Vec3f w) { return {w.x, w.y, -w.z}; }

    Split split(float cos_o, bool outside) const {
        const auto [f, cos_t] = fresnel_dielectric(cos_o, outside ? eta : 1 / eta);
        const Spectrum tinted =
            Rules::tinted_reflection ? base * (glass * f) : Spectrum(outside ? 0 : glass * f);
        const float w = Rules::schlick(cos_o, cos_t, eta);
        const Spectrum r =
            outside ? metal * (1 - w) + Spectrum(metal_edge * w + dielectric * f) + tinted : tinted;
        const Spectrum t = sqrt(base) * (glass * (1 - f));
        const float p_r = mean(r), p_t = mean(t), total = std::max(p_r + p_t, 1e-30f);
        return {r, t, p_r / total, p_t / total, p_r + p_t, cos_t, w};
    }

    // What becomes of the light along wo that the reflection seen from outside loses, as a lobe over
    // L(wi) cos(wi) / pi. Refracted light that is lost stays so.
    [[gnu::noinline]] Spectrum regained(const Vec3f &wo) const {
        const Spectrum untinted(dielectric * fresnel_diffuse_reflectance(eta));
        const Spectrum f = min(disney::schlick_mean(metal, Spectrum(metal_edge)) + untinted, Spectrum(1));
        return regained_by_reflection(f, lost->mean(surface)) * (*lost)(surface, wo);
    }

    // The parts are chosen by estimates of what they scatter towards wo. Facets that are seen at grazing
    // angles are tilted: the rougher, the more.
    Choice choice(Vec3f wo) const {
        const float cos_o = wo.z;
        const float alpha2 = sqr(surface.roughness());
        const float s = split(std::sqrt((sqr(cos_o) + alpha2) / (1 + alpha2)), true).total;
        const float w = disney::schlick_weight(cos_o);
        const float d = mean(base) * diffuse * (1 + (surface_roughness - 0.5f) * w) +
                        mean(sheen(base)) * disney::sheen_albedo(cos_o) + (lost ? mean(regained(wo)) : 0);
        const float c = coat_share * coat.fresnel(w) * Rules::clearcoat(cos_o, cos_o) * 4 * cos_o;
        const float total = std::max(s + d + c, 1e-30f);
        return {d / total, c / total, s / total};
    }

    // With wo above the surface; light is inside there if not `outside`.
    BsdfEval eval_above(Vec3f wo, Vec3f wi, bool outside, Choice p) const {
        if (wo.z <= 0 || wi.z == 0) return {};
        if (wi.z < 0) return eval_refracted(wo, wi, outside, p.surface);
        const auto [m, cos_d] = disney::halfway(wo, wi);
        const Split s = split(cos_d, outside);
        const float density = surface.visible(wo, m) / 4;
        BsdfEval e{s.reflected * (density * surface.masking(wi)), density * s.p_reflect * p.surface};
        if (!outside) return e;

        const float cosine = cosine_hemisphere_pdf(wi.z);
        if (diffuse > 0)
            e.f_cos +=
                base * (diffuse * cosine * disney::diffuse(wo.z, wi.z, cos_d, surface_roughness, flatness));
        e.f_cos += sheen(base) * (disney::schlick_weight(cos_d) * wi.z);
        if (lost) e.f_cos += regained(wo) * ((*lost)(surface, wi) * cosine);
        e.pdf += cosine * p.diffuse;
        if (coat_share > 0) {
            const float d = coat.density(m);
            e.f_cos += Spectrum(coat_share * coat.fresnel(s.weight) * d * coat.masking(wo) *
                                coat.masking(wi) * Rules::clearcoat(wo.z, wi.z));
            e.pdf += d * m.z / (4 * cos_d) * p.coat;
        }
        return e;
    }

    // Walter et al. 2007, equations 16, 17 and 21.
    BsdfEval eval_refracted(Vec3f wo, Vec3f wi, bool outside, float p_surface) const {
        if (glass == 0) return {};
        const float beyond = outside ? eta : 1 / eta;
        const Vec3f h = wo + wi * beyond;
        const float h2 = length_squared(h);
        const Vec3f m = h * std::copysign(1 / std::sqrt(h2), h.z);
        const float cos_o = dot(wo, m), cos_i = dot(wi, m);
        if (cos_o <= 0 || cos_i >= 0) return {}; // a facet's back
        const Split s = split(cos_o, outside);
        const float density = surface.visible(wo, m) * cos_o * sqr(beyond) * -cos_i / h2;
        return {s.transmitted * (density * surface.masking(wi)), density * s.p_transmit * p_surface, beyond};
    }

    std::optional<BsdfSample> sample_above(Vec3f wo, float u_lobe, Vec2f u, bool outside, Choice p) const {
        if (wo.z <= 0) return std::nullopt;
        Vec3f wi;
        float beyond = 1;
        const bool is_diffuse = u_lobe < p.diffuse;
        if (is_diffuse) {
            wi = sample_cosine_hemisphere(u);
        } else if (u_lobe < p.diffuse + p.coat) {
            wi = reflect(wo, coat.sample(u));
            if (wi.z <= 0) return std::nullopt;
        } else {
            if (p.surface <= 0) return std::nullopt;
            const Vec3f m = surface.sample_visible(wo, u);
            const float cos_o = dot(wo, m);
            const Split s = split(cos_o, outside);
            const bool reflected = u_lobe - p.diffuse - p.coat < s.p_reflect * p.surface;
            if (!reflected) beyond = outside ? eta : 1 / eta;
            wi = reflected ? reflect(wo, m) : refract(wo, m, cos_o, s.cos_t, beyond);
            if (reflected != (wi.z > 0)) return std::nullopt;
        }
        const BsdfEval e = eval_above(wo, wi, outside, p);
        if (!(e.pdf > 1e-30f)) return std::nullopt;
        if (is_diffuse) return BsdfSample{wi, e.f_cos / e.pdf, e.pdf};
        return BsdfSample{wi, e.f_cos / e.pdf, e.pdf, beyond, ScatterKind::glossy, glossy_roughness()};
    }
};

} // namespace lajolla
