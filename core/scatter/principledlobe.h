#pragma once
// The lobe of disneybsdf and principled: a diffuse base with sheen, a GGX surface that reflects as a metal, a
// dielectric or a mixture, and refracts, and a clear coat. From inside, there is only the dielectric.
//
// The differences between the two models are in their `Rules`:
//   schlick(cos_o, cos_t, eta)     the weight of Schlick's approximation at a facet
//   clearcoat(cos_o, cos_i)        value over reflectance, density and masking of the coat, with its cosine
//   tinted_reflection              whether the base colour tints a dielectric's reflection, also from inside
//
// Its functions are large and are not inlined into the dispatch of all lobes.

#include "base/warp.h"
#include "scatter/disney.h"
#include "scatter/fresnel.h"

namespace lajolla {

template <class Float, class Rules>
struct PrincipledLobe {
    Microfacet<Float> surface;
    disney::Clearcoat<Float> coat;
    float eta; // inside relative to outside
    Rgb<Float> base;
    Rgb<Float> metal; // reflectance at normal incidence of what follows Schlick, times its share
    Float metal_edge; // the same at grazing angles
    Float dielectric; // share of untinted reflection at the boundary, seen from outside
    Float glass;      // share of refraction, and of reflection inside
    Float diffuse, surface_roughness, flatness;
    disney::Tint<Float> sheen; // scaled by its share
    Float coat_share;
    const LostLight *lost = nullptr; // for multiple scattering

    Float roughness() const {
        return select(diffuse > 0.0f || sheen.white > 0.0f || sheen.hue > 0.0f, Float(1), glossy_roughness());
    }

    [[gnu::noinline]] BsdfEval<Float> eval(const Vec3<Float> &given_wo, const Vec3<Float> &given_wi) const {
        const auto outside = given_wo.z > 0.0f;
        const Vec3<Float> wo = turned(given_wo, outside), wi = turned(given_wi, outside);
        const auto reflected = wi.z > 0.0f,
                   scatters = wo.z > 0.0f && (reflected || (wi.z < 0.0f && glass > 0.0f));
        if (!any(scatters)) return {};

        const Float beyond = index_beyond(outside);
        // Walter et al. 2007, equations 13 and 16
        const Vec3<Float> h = wo + wi * select(reflected, Float(1), beyond);
        const Float l = length(h);
        const Vec3<Float> m = h * copysign(1 / l, h.z);
        const auto front = reflected || (dot(wo, m) > 0.0f && dot(wi, m) < 0.0f); // not a facet's back
        const Float cos_o = select(reflected, l / 2, dot(wo, m));
        const BsdfEval<Float> e = eval_facet({wo, wi, m, outside, reflected, cos_o, beyond},
                                             split(cos_o, outside), choice(wo, outside));
        return select(scatters && front, e, {});
    }

    [[gnu::noinline]] BsdfSample<Float> sample(const Vec3<Float> &given_wo, Float u_lobe,
                                               const Vec2<Float> &u) const {
        const auto outside = given_wo.z > 0.0f;
        const Vec3<Float> wo = turned(given_wo, outside);
        const Float beyond = index_beyond(outside);
        const Choice p = choice(wo, outside);
        const auto is_diffuse = u_lobe < p.diffuse, is_surface = u_lobe >= p.diffuse + p.coat,
                   is_coat = !is_diffuse && !is_surface;
        // Either wi and the half vector, or a facet and the type of event.
        Vec3<Float> wi, m;
        if (any(is_diffuse)) {
            wi = sample_cosine_hemisphere(u);
            m = disney::halfway(wo, wi).m;
        }
        if (any(is_coat)) m = select(is_coat, coat.sample(u), m);
        if (any(is_surface)) m = select(is_surface, surface.sample_visible(wo, u), m);
        const Float cos_o = dot(wo, m);
        const Split s = split(cos_o, outside);
        const auto reflected = !is_surface || u_lobe - p.diffuse - p.coat < s.p_reflect * p.surface;
        wi = select(is_diffuse, wi, reflect(wo, m));
        if (!all(reflected)) wi = select(reflected, wi, refract(wo, m, cos_o, s.cos_t, beyond));

        const BsdfEval<Float> e = eval_facet({wo, wi, m, outside, reflected, cos_o, beyond}, s, p);
        return {.valid = wo.z > 0.0f && (!is_surface || p.surface > 0.0f) && wi.z != 0.0f &&
                         reflected == (wi.z > 0.0f) && e.pdf > 1e-30f,
                .wi = turned(wi, outside),
                .weight = e.f_cos / e.pdf,
                .pdf = e.pdf,
                .eta = e.eta,
                .width = select(is_diffuse, Float(1), glossy_roughness())};
    }

private:
    using Bool = BoolOf<Float>;

    struct Choice {                   // probabilities
        Float diffuse, coat, surface; // the first includes the lost light
    };
    // Reflection and refraction at a microfacet.
    struct Split {
        Rgb<Float> reflected, transmitted;
        Float p_reflect, p_transmit; // probabilities; zero if black
        Float total;                 // mean of both
        Float cos_t;
        Float weight; // of Schlick's approximation
    };
    // The facet of normal m that reflects or refracts wi to wo, which is above the surface. Light comes from
    // inside if not `outside`.
    struct Facet {
        Vec3<Float> wo, wi, m;
        Bool outside, reflected;
        Float cos_o;  // between m and wo
        Float beyond; // index of refraction on the far side
    };

    Float glossy_roughness() const {
        return select(coat_share > 0.0f, max(surface.roughness(), coat.roughness()), surface.roughness());
    }
    // Flips directions for light from inside, and back.
    static Vec3<Float> turned(const Vec3<Float> &w, Bool outside) {
        return {w.x, w.y, select(outside, w.z, -w.z)};
    }
    Float index_beyond(Bool outside) const { return select(outside, Float(eta), Float(1 / eta)); }

    Split split(Float cos_o, Bool outside) const {
        const auto [f, cos_t] = fresnel_dielectric(cos_o, index_beyond(outside));
        const Rgb<Float> tinted =
            Rules::tinted_reflection ? base * (glass * f) : Rgb<Float>(select(outside, Float(0), glass * f));
        const Float w = Rules::schlick(cos_o, cos_t, eta);
        const Rgb<Float> r =
            tinted + select(outside, metal * (1 - w) + Rgb<Float>(metal_edge * w + dielectric * f), {});
        const Rgb<Float> t = sqrt(base) * (glass * (1 - f));
        const Float p_r = mean(r), p_t = mean(t), total = max(p_r + p_t, Float(1e-30f));
        return {r, t, p_r / total, p_t / total, p_r + p_t, cos_t, w};
    }

    // The light along wo that reflection from outside loses and multiple scattering restores, as a lobe over
    // L(wi) cos(wi) / pi. Refracted light that is lost is not restored.
    [[gnu::noinline]] Rgb<Float> regained(const Vec3<Float> &wo) const {
        const Rgb<Float> untinted(dielectric * (1 - fresnel_diffuse_transmittance(eta)));
        const Rgb<Float> f =
            min(disney::schlick_mean(metal, Rgb<Float>(metal_edge)) + untinted, Rgb<Float>(1));
        return regained_by_reflection(f, lost->mean(surface)) * (*lost)(surface, wo);
    }

    // Probabilities are estimates of the light that each part scatters towards wo. Facets that are visible at
    // grazing angles are tilted: the rougher, the more. Inside there is only the surface.
    Choice choice(const Vec3<Float> &wo, Bool outside) const {
        if (!any(outside)) return {0, 0, 1};
        const Float cos_o = wo.z;
        const Float alpha2 = sqr(surface.roughness());
        const Float s = split(sqrt((sqr(cos_o) + alpha2) / (1 + alpha2)), true).total;
        const Float w = disney::schlick_weight(cos_o);
        Float d = mean(base) * diffuse * (1 + (surface_roughness - 0.5f) * w) +
                  mean(sheen(base)) * disney::sheen_albedo(cos_o);
        if (lost) d += mean(regained(wo));
        const Float c = coat_share * coat.fresnel(w) * Rules::clearcoat(cos_o, cos_o) * 4 * cos_o;
        const Float total = max(s + d + c, Float(1e-30f));
        return {select(outside, d / total, Float(0)), select(outside, c / total, Float(0)),
                select(outside, s / total, Float(1))};
    }

    BsdfEval<Float> eval_facet(const Facet &facet, const Split &s, const Choice &p) const {
        const auto &[wo, wi, m, outside, reflected, cos_o, beyond] = facet;
        // Walter et al. 2007, equations 17 and 21
        const Float bending = cos_o * sqr(beyond) * -dot(wi, m) / length_squared(wo + wi * beyond);
        const Float density = surface.visible(wo, m) * select(reflected, Float(0.25f), bending);
        BsdfEval<Float> e{select(reflected, s.reflected, s.transmitted) * (density * surface.masking(wi)),
                          density * select(reflected, s.p_reflect, s.p_transmit) * p.surface,
                          select(reflected, Float(1), beyond)};

        const auto covered = reflected && outside; // by everything else
        if (!any(covered)) return e;
        const Float cosine = cosine_hemisphere_pdf(wi.z);
        Rgb<Float> f_cos = sheen(base) * (disney::schlick_weight(cos_o) * wi.z);
        Float pdf = cosine * p.diffuse;
        if (any(diffuse > 0.0f))
            f_cos +=
                base * (diffuse * cosine * disney::diffuse(wo.z, wi.z, cos_o, surface_roughness, flatness));
        if (lost) f_cos += regained(wo) * ((*lost)(surface, wi) * cosine);
        if (any(coat_share > 0.0f)) {
            const Float d = coat.density(m);
            f_cos += Rgb<Float>(coat_share * coat.fresnel(s.weight) * d * coat.masking(wo) *
                                coat.masking(wi) * Rules::clearcoat(wo.z, wi.z));
            pdf += d * m.z / (4 * cos_o) * p.coat;
        }
        e.f_cos += select(covered, f_cos, {});
        e.pdf += select(covered, pdf, Float(0));
        return e;
    }
};

} // namespace lajolla
