#pragma once
// Rough metals: microfacets that reflect by some Fresnel term, `reflectance(cos)`, and what they lose.

#include "base/warp.h"
#include "scatter/bsdf.h"
#include "scatter/microfacet.h"
#include "scatter/multiscatter.h"

namespace lajolla {

template <class Facet>
struct MetalLobe {
    static constexpr bool transmissive = false, delta = false;
    Microfacet surface;
    Facet facet;
    const LostLight *lost = nullptr; // where multiple scattering counts, and then
    Spectrum regained{0};            // what becomes of the lost light, over its mean

    float roughness() const { return surface.roughness(); }

    BsdfEval eval(Vec3f wo, Vec3f wi) const {
        if (wo.z <= 0 || wi.z <= 0) return {};
        const Vec3f m = normalize(wo + wi);
        const float pdf = surface.visible(wo, m) / 4;
        const BsdfEval single{facet.reflectance(dot(wo, m)) * (pdf * surface.masking(wi)), pdf};
        return lost ? with_lost_light(single, wo, wi) : single;
    }

    std::optional<BsdfSample> sample(Vec3f wo, float u_lobe, Vec2f u) const {
        if (wo.z <= 0) return std::nullopt;
        const bool single = !lost || u_lobe >= (*lost)(surface, wo);
        const Vec3f wi = single ? reflect(wo, surface.sample_visible(wo, u)) : sample_cosine_hemisphere(u);
        const BsdfEval e = eval(wo, wi);
        if (!(e.pdf > 1e-30f)) return std::nullopt;
        return BsdfSample{
            wi, e.f_cos / e.pdf, e.pdf, 1, single ? ScatterKind::glossy : ScatterKind::diffuse, roughness()};
    }

private:
    [[gnu::noinline]] BsdfEval with_lost_light(const BsdfEval &single, const Vec3f &wo,
                                               const Vec3f &wi) const {
        const float p = (*lost)(surface, wo), cosine = cosine_hemisphere_pdf(wi.z);
        return {single.f_cos + regained * (p * (*lost)(surface, wi) * cosine), lerp(p, single.pdf, cosine)};
    }
};

} // namespace lajolla
