#pragma once
// The sum of a diffuse and a glossy lobe without interaction, as in models of the 1980s and 1990s.

#include "base/warp.h"
#include "scatter/bsdf.h"

namespace lajolla {

template <class Float>
struct GlossValue {
    Float f_cos, pdf;
};

// A Gloss has
//   eval(wo, wi)    its value times |cos wi| for a colour of one, and its density
//   sample(wo, u)   a direction, possibly below the surface
//   roughness()     as for lobes
template <class Float, class Gloss>
struct GlossyAndDiffuse {
    // Colours whose sum exceeds one are scaled down, similar to Mitsuba 0.6.
    GlossyAndDiffuse(const Gloss &gloss_, const Rgb<Float> &diffuse_, const Rgb<Float> &specular_)
        : gloss(gloss_), diffuse(diffuse_), specular(specular_) {
        const Float scale = 1 / max(max_component(diffuse + specular), Float(1));
        diffuse *= scale;
        specular *= scale;
        const Float d = mean(diffuse), s = mean(specular);
        p_gloss = select(s > 0.0f, s / (s + d), Float(0));
    }

    Float roughness() const { return select(p_gloss < 1.0f, Float(1), gloss.roughness()); }

    BsdfEval<Float> eval(const Vec3<Float> &wo, const Vec3<Float> &wi) const {
        const auto above = wo.z > 0.0f && wi.z > 0.0f;
        if (!any(above)) return {};
        const Float cosine = cosine_hemisphere_pdf(wi.z);
        const auto [f_cos, pdf] = gloss.eval(wo, wi);
        return select(above, BsdfEval<Float>{diffuse * cosine + specular * f_cos, lerp(p_gloss, cosine, pdf)},
                      {});
    }

    BsdfSample<Float> sample(const Vec3<Float> &wo, Float u_lobe, const Vec2<Float> &u) const {
        const auto glossy = u_lobe < p_gloss;
        Vec3<Float> wi = sample_cosine_hemisphere(u);
        if (any(glossy)) wi = select(glossy, gloss.sample(wo, u), wi);
        const BsdfEval<Float> e = eval(wo, wi);
        return {.valid = e.pdf > 1e-30f,
                .wi = wi,
                .weight = e.f_cos / e.pdf,
                .pdf = e.pdf,
                .width = select(glossy, gloss.roughness(), Float(1))};
    }

    Gloss gloss;
    Rgb<Float> diffuse, specular;
    Float p_gloss; // probability of the glossy lobe
};

} // namespace lajolla
