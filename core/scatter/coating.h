#pragma once

#include "base/match.h"
#include "scatter/bsdf.h"
#include "scatter/fresnel.h"
#include "scatter/microfacet.h"
#include "scatter/multiscatter.h"
#include "scatter/roughplastic.h"

namespace lajolla {

// A clear or absorbing layer on a base, as Mitsuba 0.6 has it, after Weidlich and Wilkie 2007, "Arbitrarily
// Layered Micro-Facet Surfaces": light refracts on its way in and out as at a smooth boundary, and what is
// reflected back down within the layer is lost. `Base` is a variant of models, `BaseLobe` that of their
// lobes.
template <class Base, class BaseLobe>
struct CoatingOf {
    static constexpr const char *name = "coating";
    static constexpr const char *doc = "A layer of varnish, clear or tinted, on another BSDF.";
    Base base;
    float thickness = 1;
    Texture<Spectrum> sigma_a{Spectrum(0)}, specular_reflectance{Spectrum(1)};
    float int_ior = 1.5046f, ext_ior = 1.000277f;
    MicrofacetKind distribution = MicrofacetKind::beckmann;
    float alpha = 0;

    static constexpr auto fields() {
        return std::tuple(
            field("base", &CoatingOf::base, "what is coated; light must not pass through it"),
            field("thickness", &CoatingOf::thickness, "of the layer, in units of 1 / sigma_a").range(0),
            field("sigma_a", &CoatingOf::sigma_a, "absorption in the layer").range(0),
            field("specular_reflectance", &CoatingOf::specular_reflectance,
                  "tints the reflection; 1 is physical")
                .range(0, 1),
            field("int_ior", &CoatingOf::int_ior, "index of refraction of the layer").range(0),
            field("ext_ior", &CoatingOf::ext_ior, "index of refraction outside").range(0),
            field("distribution", &CoatingOf::distribution, "statistics of the microfacets"),
            field("alpha", &CoatingOf::alpha, "roughness of the layer; 0 is smooth").range(0));
    }
    BsdfTraits traits() const {
        const BsdfTraits below = match(base, [](const auto &model) { return model.traits(); });
        return {.anisotropic = below.anisotropic};
    }

    struct Lobe {
        Microfacet<float> surface;
        float eta;
        const CosineTable *entering; // fraction of light that a rough layer lets through; none: it is smooth
        Spectrum absorption;         // over the layer's thickness
        Spectrum reflectance;        // tint of the layer
        float specular_weight;       // in [0, 1], for the choice between layer and base
        BaseLobe base;

        float roughness() const {
            const float below = match(base, [](const auto &lobe) -> float { return lobe.roughness(); });
            return entering ? std::max(surface.roughness(), below) : below;
        }

        BsdfEval<float> eval(const Vec3f &wo, const Vec3f &wi) const {
            if (wo.z <= 0 || wi.z <= 0) return {};
            const Side o = side(wo), i = side(wi);
            const float p = choice(o);
            BsdfEval<float> result;
            if (entering) {
                const Vec3f m = normalize(wo + wi);
                const float density = surface.visible(wo, m) / 4;
                const float f = fresnel_dielectric(dot(wo, m), eta).reflectance;
                result = {reflectance * (f * density * surface.masking(wi)), density * p};
            }
            if (o.inner.z <= 0 || i.inner.z <= 0) return result;
            const BsdfEval<float> below = eval_base(o.inner, i.inner);
            const float compression = wi.z / (sqr(eta) * i.inner.z); // of solid angles
            result.f_cos += below.f_cos * passed(o, i) * compression;
            result.pdf += below.pdf * (1 - p) * compression;
            return result;
        }

        BsdfSample<float> sample(const Vec3f &wo, float u_lobe, const Vec2f &u) const {
            if (wo.z <= 0) return {};
            const Side o = side(wo);
            const float p = choice(o);
            if (u_lobe < p) {
                if (!entering) return mirrored(wo, o, p, u);
                const Vec3f wi = reflect(wo, surface.sample_visible(wo, u));
                return finished(wo, wi, surface.roughness());
            }
            if (o.inner.z <= 0) return {};
            const float u_base = std::min((u_lobe - p) / (1 - p), one_minus_ulp);
            const BsdfSample<float> below = sample_base(o.inner, u_base, u);
            if (!below.valid || below.wi.z <= 0) return {};
            if (below.delta && !entering) return mirrored(wo, o, p, u);
            const Vec3f wi = outwards(below.wi);
            if (wi.z <= 0) return {};
            if (!below.delta) return finished(wo, wi, below.width);
            const Spectrum weight = below.weight * passed(o, side(wi)) / (1 - p);
            return {true, wi, weight, below.pdf * (1 - p), 1, true, below.width};
        }

    private:
        // A direction outside, and what becomes of light that enters along it.
        struct Side {
            Vec3f inner;   // z = 0 under total reflection
            float through; // fraction
        };

        Side side(const Vec3f &w) const {
            const auto [reflected, cos_t] = fresnel_dielectric(w.z, eta);
            return {{w.x / eta, w.y / eta, cos_t}, entering ? (*entering)(w.z) : 1 - reflected};
        }
        Vec3f outwards(const Vec3f &inner) const {
            const float x = inner.x * eta, y = inner.y * eta;
            return {x, y, safe_sqrt(1 - x * x - y * y)};
        }
        Spectrum passed(const Side &o, const Side &i) const {
            const float ways = 1 / o.inner.z + 1 / i.inner.z, through = o.through * i.through;
            const auto left = [&](float a) { return a > 0 ? through * std::exp(-a * ways) : through; };
            return {left(absorption.x), left(absorption.y), left(absorption.z)};
        }
        // The mirror image in a smooth layer, and with it that in a base which is a mirror, too: models
        // choose their specular part by small u_lobe.
        BsdfSample<float> mirrored(const Vec3f &wo, const Side &o, float p, const Vec2f &u) const {
            Spectrum value = reflectance * (1 - o.through);
            if (o.inner.z > 0)
                if (const BsdfSample<float> below = sample_base(o.inner, 0, u); below.valid && below.delta) {
                    value += below.weight * passed(o, o) * below.pdf;
                    p += below.pdf * (1 - p);
                }
            return {true, {-wo.x, -wo.y, wo.z}, value / p, p, 1, true, 0};
        }
        // The probability of sampling the layer.
        float choice(const Side &o) const {
            if (is_black(reflectance)) return 0;
            const float above = (1 - o.through) * specular_weight, below = o.through * (1 - specular_weight);
            return above + below > 0 ? above / (above + below) : 1;
        }
        BsdfSample<float> finished(const Vec3f &wo, const Vec3f &wi, float width) const {
            const BsdfEval<float> e = eval(wo, wi);
            if (!(e.pdf > 1e-30f)) return {};
            return {true, wi, e.f_cos / e.pdf, e.pdf, 1, false, width};
        }
        // Not inlined: the code of all models once more would be large.
        [[gnu::noinline]] BsdfEval<float> eval_base(const Vec3f &wo, const Vec3f &wi) const {
            return match(base, [&](const auto &lobe) { return lobe.eval(wo, wi); });
        }
        [[gnu::noinline]] BsdfSample<float> sample_base(const Vec3f &wo, float u_lobe, const Vec2f &u) const {
            return match(base, [&](const auto &lobe) { return lobe.sample(wo, u_lobe, u); });
        }
    };

    void build();

    Lobe prepare(const auto &read) const {
        const Spectrum absorption = read(sigma_a) * thickness, tint = read(specular_reflectance);
        const Spectrum left{std::exp(-2 * absorption.x), std::exp(-2 * absorption.y),
                            std::exp(-2 * absorption.z)};
        return {{distribution, alpha, alpha},
                int_ior / ext_ior,
                alpha > 0 ? &entering_ : nullptr,
                absorption,
                tint,
                1 / (1 + mean(left)),
                match(base, [&](const auto &model) -> BaseLobe { return prepare_lobe<float>(model, read); })};
    }

private:
    CosineTable entering_;
};

template <class Base, class BaseLobe>
void CoatingOf<Base, BaseLobe>::build() {
    check_indices(int_ior, ext_ior);
    const bool clear = match(base, [](const auto &model) { return model.traits().transmissive; });
    if (clear) throw std::invalid_argument("a coating needs a base that light does not pass through");
    if (alpha == 0) return;
    const Microfacet<float> surface(distribution, alpha, alpha);
    for (std::size_t i = 0; i < entering_.values.size(); ++i) {
        const float z = CosineTable::node(i);
        const Vec3f w{safe_sqrt(1 - z * z), 0, z};
        entering_.values[i] = surface.mean_over_visible(
            w, 64, [&](Vec3f m) { return detail::transmitted_fraction(surface, w, m, int_ior / ext_ior); });
    }
}

} // namespace lajolla
