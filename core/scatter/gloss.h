#pragma once
// Reflection by a diffuse base and a glossy lobe that know nothing of each other, as models of the eighties
// and nineties put them together.

#include "base/warp.h"
#include "scatter/bsdf.h"

namespace lajolla {

struct GlossValue {
    float f_cos, pdf;
};

// A Gloss has
//   eval(wo, wi)    its value times |cos wi| for a colour of one, and its density
//   sample(wo, u)   a direction, perhaps below the surface
//   roughness()     as a lobe has
template <class Gloss>
struct GlossyAndDiffuse {
    static constexpr bool transmissive = false, delta = false;
    // Colours that exceed one together are scaled down, as in Mitsuba 0.6.
    GlossyAndDiffuse(const Gloss &gloss_, Spectrum diffuse_, Spectrum specular_)
        : gloss(gloss_), diffuse(diffuse_), specular(specular_) {
        const float scale = 1 / std::max(max_component(diffuse + specular), 1.0f);
        diffuse *= scale;
        specular *= scale;
        const float d = mean(diffuse), s = mean(specular);
        p_gloss = s > 0 ? s / (s + d) : 0;
    }

    float roughness() const { return p_gloss < 1 ? 1 : gloss.roughness(); }

    BsdfEval eval(Vec3f wo, Vec3f wi) const {
        if (wo.z <= 0 || wi.z <= 0) return {};
        const float cosine = cosine_hemisphere_pdf(wi.z);
        const auto [f_cos, pdf] = gloss.eval(wo, wi);
        return {diffuse * cosine + specular * f_cos, lerp(p_gloss, cosine, pdf)};
    }

    std::optional<BsdfSample> sample(Vec3f wo, float u_lobe, Vec2f u) const {
        if (wo.z <= 0) return std::nullopt;
        const bool glossy = u_lobe < p_gloss;
        const Vec3f wi = glossy ? gloss.sample(wo, u) : sample_cosine_hemisphere(u);
        const BsdfEval e = eval(wo, wi);
        if (!(e.pdf > 1e-30f)) return std::nullopt;
        return BsdfSample{wi,
                          e.f_cos / e.pdf,
                          e.pdf,
                          1,
                          glossy ? ScatterKind::glossy : ScatterKind::diffuse,
                          gloss.roughness()};
    }

    Gloss gloss;
    Spectrum diffuse, specular;
    float p_gloss; // of choosing the glossy lobe
};

} // namespace lajolla
