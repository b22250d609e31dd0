#pragma once
// Rough metals: microfacets with a Fresnel term `reflectance(cos)`, and compensation of their energy loss.

#include "base/warp.h"
#include "scatter/bsdf.h"
#include "scatter/microfacet.h"
#include "scatter/multiscatter.h"

namespace lajolla {

template <class Float, class Facet>
struct MetalLobe {
    Microfacet<Float> surface;
    Facet facet;
    const LostLight *lost = nullptr; // for multiple scattering, with
    Rgb<Float> regained{0};          // the reflected fraction of the lost light, over its mean

    Float roughness() const { return surface.roughness(); }

    BsdfEval<Float> eval(const Vec3<Float> &wo, const Vec3<Float> &wi) const {
        const Vec3<Float> m = normalize(wo + wi);
        const Float pdf = surface.visible(wo, m) / 4;
        const BsdfEval<Float> single{facet.reflectance(dot(wo, m)) * (pdf * surface.masking(wi)), pdf};
        return select(wo.z > 0.0f && wi.z > 0.0f, lost ? with_lost_light(single, wo, wi) : single, {});
    }

    BsdfSample<Float> sample(const Vec3<Float> &wo, Float u_lobe, const Vec2<Float> &u) const {
        if (lost) return sample_with_lost_light(wo, u_lobe, u);
        const Vec3<Float> m = surface.sample_visible(wo, u), wi = reflect(wo, m);
        const Float pdf = surface.visible(wo, m) / 4;
        return {.valid = wo.z > 0.0f && wi.z > 0.0f && pdf > 1e-30f,
                .wi = wi,
                .weight = facet.reflectance(dot(wo, m)) * surface.masking(wi),
                .pdf = pdf,
                .width = roughness()};
    }

private:
    [[gnu::noinline]] BsdfEval<Float> with_lost_light(const BsdfEval<Float> &single, const Vec3<Float> &wo,
                                                      const Vec3<Float> &wi) const {
        const Float p = (*lost)(surface, wo), cosine = cosine_hemisphere_pdf(wi.z);
        return {single.f_cos + regained * (p * (*lost)(surface, wi) * cosine), lerp(p, single.pdf, cosine)};
    }

    [[gnu::noinline]] BsdfSample<Float> sample_with_lost_light(const Vec3<Float> &wo, Float u_lobe,
                                                               const Vec2<Float> &u) const {
        const auto single = u_lobe >= (*lost)(surface, wo);
        const Vec3<Float> wi =
            select(single, reflect(wo, surface.sample_visible(wo, u)), sample_cosine_hemisphere(u));
        const BsdfEval<Float> e = eval(wo, wi);
        return {.valid = e.pdf > 1e-30f,
                .wi = wi,
                .weight = e.f_cos / e.pdf,
                .pdf = e.pdf,
                .width = select(single, roughness(), Float(1))};
    }
};

} // namespace lajolla
