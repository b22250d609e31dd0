#pragma once

#include "base/match.h"
#include "scatter/bsdf.h"
#include "scatter/fresnel.h"
#include "scatter/microfacet.h"
#include "scatter/multiscatter.h"
#include "scatter/roughplastic.h"

namespace lajolla {

// A clear or absorbing layer on a base, as in Mitsuba 0.6, after Weidlich and Wilkie 2007, "Arbitrarily
// Layered Micro-Facet Surfaces": light refracts on its way in and out as at a smooth boundary, and internal
// reflection in the layer is lost. `Base` is a variant of models, `BaseLobe` that of their lobes.
template <class Base, template <class> class BaseLobe>
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
            field("int_ior", &CoatingOf::int_ior, "index of refraction of the layer")
                .range(least_index, largest_index),
            field("ext_ior", &CoatingOf::ext_ior, "index of refraction outside")
                .range(least_index, largest_index),
            field("distribution", &CoatingOf::distribution, "microfacet distribution"),
            field("alpha", &CoatingOf::alpha, "roughness of the layer; 0 is smooth").range(0));
    }
    BsdfTraits traits() const {
        const BsdfTraits below = match(base, [](const auto &model) { return model.traits(); });
        return {.anisotropic = below.anisotropic};
    }

    template <class Float>
    struct Lobe {
        Microfacet<Float> surface;
        float eta;
        const CosineTable *entering; // fraction of light that a rough layer transmits; null: it is smooth
        Rgb<Float> absorption;       // over the layer's thickness
        Rgb<Float> reflectance;      // tint of the layer
        Float specular_weight;       // in [0, 1], for the selection of layer or base
        BaseLobe<Float> base;

        Float roughness() const {
            const Float below = match(base, [](const auto &lobe) -> Float { return lobe.roughness(); });
            return entering ? max(surface.roughness(), below) : below;
        }

        BsdfEval<Float> eval(const Vec3<Float> &wo, const Vec3<Float> &wi) const {
            const Side o = side(wo);
            const auto above = wo.z > 0.0f && wi.z > 0.0f;
            if (!any(above)) return {};
            return select(above, eval_above(wo, wi, o, choice(o)), {});
        }

        BsdfSample<Float> sample(const Vec3<Float> &wo, Float u_lobe, const Vec2<Float> &u) const {
            const Side o = side(wo);
            const Float p = choice(o);
            const auto at_layer = u_lobe < p;
            BsdfSample<Float> below;
            if (!entering || !all(at_layer)) below = sample_base(o.inner, rest(u_lobe, p), u);
            const auto comes_back = o.inner.z > 0.0f && below.valid && below.wi.z > 0.0f,
                       is_mirror = comes_back && below.delta;

            BsdfSample<Float> image;
            const auto mirrored = entering ? is_mirror && !at_layer : is_mirror || at_layer;
            if (any(mirrored)) image = mirror_image(wo, o, p, below, is_mirror);
            if (all(mirrored)) return image;

            Vec3<Float> wi = outwards(below.wi);
            if (entering && any(at_layer))
                wi = select(at_layer, reflect(wo, surface.sample_visible(wo, u)), wi);
            const BsdfEval<Float> e = eval_above(wo, wi, o, p);
            const BsdfSample<Float> scattered{.valid = wo.z > 0.0f && wi.z > 0.0f &&
                                                       (at_layer || comes_back) && e.pdf > 1e-30f,
                                              .wi = wi,
                                              .weight = e.f_cos / e.pdf,
                                              .pdf = e.pdf,
                                              .width = select(at_layer, surface.roughness(), below.width)};
            return select(mirrored, image, scattered);
        }

    private:
        // The refraction of a direction into the layer.
        struct Side {
            Vec3<Float> inner; // z = 0 under total reflection
            Float through;     // fraction transmitted
        };

        Side side(const Vec3<Float> &w) const {
            const auto [reflected, cos_t] = fresnel_dielectric(w.z, eta);
            return {{w.x / eta, w.y / eta, cos_t}, entering ? (*entering)(w.z) : 1 - reflected};
        }
        Vec3<Float> outwards(const Vec3<Float> &inner) const {
            const Float x = inner.x * eta, y = inner.y * eta;
            return {x, y, safe_sqrt(1 - x * x - y * y)};
        }
        Rgb<Float> passed(const Side &o, const Side &i) const {
            const Float through = o.through * i.through;
            if (!any(max_component(absorption) > 0.0f)) return Rgb<Float>(through);
            const Float length = 1 / o.inner.z + 1 / i.inner.z;
            const auto left = [&](Float a) { return through * select(a > 0.0f, exp(-a * length), Float(1)); };
            return {left(absorption.x), left(absorption.y), left(absorption.z)};
        }
        // The probability of sampling the layer.
        Float choice(const Side &o) const {
            const Float above = (1 - o.through) * specular_weight, below = o.through * (1 - specular_weight);
            const Float p = select(above + below > 0.0f, above / (above + below), Float(1));
            return select(is_black(reflectance), Float(0), p);
        }
        // The rest of u_lobe for the base. It is 0 for samples of the layer: models select their mirror for
        // small numbers, and a smooth layer reflects in the same direction.
        static Float rest(Float u_lobe, Float p) {
            return clamp((u_lobe - p) / (1 - p), 0.0f, one_minus_ulp);
        }

        BsdfEval<Float> eval_above(const Vec3<Float> &wo, const Vec3<Float> &wi, const Side &o,
                                   Float p) const {
            BsdfEval<Float> result;
            if (entering) {
                const auto [reflected, density] = detail::reflected_by_facets(surface, wo, wi, eta);
                result = {reflectance * reflected, density * p};
            }
            const Side i = side(wi);
            const auto passes = o.inner.z > 0.0f && i.inner.z > 0.0f;
            const BsdfEval<Float> below = eval_base(o.inner, i.inner);
            const Float compression = wi.z / (sqr(eta) * i.inner.z); // of solid angles
            result.f_cos += select(passes, below.f_cos * passed(o, i) * compression, {});
            result.pdf += select(passes, below.pdf * (1 - p) * compression, Float(0));
            return result;
        }
        // The reflection of a mirror as base, together with that of a smooth layer.
        BsdfSample<Float> mirror_image(const Vec3<Float> &wo, const Side &o, Float p,
                                       const BsdfSample<Float> &below, BoolOf<Float> is_mirror) const {
            Rgb<Float> value = select(is_mirror, below.weight * passed(o, o) * below.pdf, {});
            Float chosen = select(is_mirror, below.pdf * (1 - p), Float(0));
            if (!entering) {
                value += reflectance * (1 - o.through);
                chosen += p;
            }
            return {wo.z > 0.0f, {-wo.x, -wo.y, wo.z}, value / chosen, chosen, 1, true, 0};
        }
        // Not inlined, because another copy of the code of all models would be large.
        [[gnu::noinline]] BsdfEval<Float> eval_base(const Vec3<Float> &wo, const Vec3<Float> &wi) const {
            return match(base, [&](const auto &lobe) { return lobe.eval(wo, wi); });
        }
        [[gnu::noinline]] BsdfSample<Float> sample_base(const Vec3<Float> &wo, Float u_lobe,
                                                        const Vec2<Float> &u) const {
            return match(base, [&](const auto &lobe) { return lobe.sample(wo, u_lobe, u); });
        }
    };

    void build();

    template <class Float>
        requires(!is_wide<Float> || are_wide<Base>)
    Lobe<Float> prepare(const auto &read) const {
        const Rgb<Float> absorption = read(sigma_a) * thickness;
        return {{distribution, alpha, alpha},
                int_ior / ext_ior,
                alpha > 0 ? &entering_ : nullptr,
                absorption,
                read(specular_reflectance),
                1 / (1 + mean(exp(absorption * -2))),
                match(base, [&](const auto &model) -> BaseLobe<Float> {
                    return prepare_lobe<Float>(model, read);
                })};
    }

private:
    CosineTable entering_;
};

template <class Base, template <class> class BaseLobe>
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
