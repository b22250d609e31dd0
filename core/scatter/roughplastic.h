#pragma once

#include <memory>

#include "base/shared_table.h"
#include "base/warp.h"
#include "scatter/bsdf.h"
#include "scatter/fresnel.h"
#include "scatter/microfacet.h"

namespace lajolla {

// A function of cos(theta) in [0,1], linear between equidistant nodes.
struct CosineTable {
    std::array<float, 64> values{};

    static float node(std::size_t i) { return max(static_cast<float>(i) / 63, 1e-6f); }
    template <class Float>
    Float operator()(Float cos_theta) const {
        const Float x = clamp_number(cos_theta, 0.0f, 1.0f) * 63;
        const IntOf<Float> i = to_int(min(x, Float(62)));
        return lerp(x - to_float(i), gather(values.data(), i), gather(values.data() + 1, i));
    }
};

struct RoughPlastic {
    static constexpr const char *name = "roughplastic";
    static constexpr const char *doc = "Rough plastic: a diffuse base under a rough clear coat.";
    MicrofacetKind distribution = MicrofacetKind::beckmann;
    float alpha = 0.1f;
    float int_ior = 1.49f, ext_ior = 1.000277f;
    Texture<Spectrum> diffuse_reflectance{Spectrum(0.5f)}, specular_reflectance{Spectrum(1)};
    bool nonlinear = false, multiscatter = false;

    static constexpr auto fields() {
        return std::tuple(
            field("distribution", &RoughPlastic::distribution, "microfacet distribution"),
            field("alpha", &RoughPlastic::alpha, "roughness of the coat, at least 0.0001").range(0),
            field("int_ior", &RoughPlastic::int_ior, "index of refraction of the coat")
                .range(least_index, largest_index),
            field("ext_ior", &RoughPlastic::ext_ior, "index of refraction outside")
                .range(least_index, largest_index),
            field("diffuse_reflectance", &RoughPlastic::diffuse_reflectance,
                  "fraction of light the base reflects")
                .range(0, 1),
            field("specular_reflectance", &RoughPlastic::specular_reflectance,
                  "tints the reflection; 1 is physical")
                .range(0, 1),
            field("nonlinear", &RoughPlastic::nonlinear, "saturate colours by scattering under the coat"),
            field("multiscatter", &RoughPlastic::multiscatter,
                  "add the energy lost by single scattering to the base"));
    }

    BsdfTraits traits() const { return {.diffuse_colour = &diffuse_reflectance}; }

    template <class Float>
    struct Lobe {
        Microfacet<Float> surface;
        float eta;
        const CosineTable *entering; // fraction of light that the coat transmits, in both directions
        Rgb<Float> base; // albedo after bounces under the coat, over eta^2 for refraction on the way out
        Rgb<Float> reflectance;                // tint of the coat
        Float diffuse_weight, specular_weight; // mean albedos, for the selection of base or coat

        float roughness() const { return 1; }

        BsdfEval<Float> eval(const Vec3<Float> &wo, const Vec3<Float> &wi) const {
            const Float t = (*entering)(wo.z);
            return select(wo.z > 0.0f && wi.z > 0.0f, eval_above(wo, wi, t, choice(t)), {});
        }

        BsdfSample<Float> sample(const Vec3<Float> &wo, Float u_lobe, const Vec2<Float> &u) const {
            const Float t = (*entering)(wo.z);
            const Choice p = choice(t);
            const auto specular = u_lobe < p.coat;
            Vec3<Float> wi = sample_cosine_hemisphere(u);
            if (any(specular)) wi = select(specular, reflect(wo, surface.sample_visible(wo, u)), wi);
            const BsdfEval<Float> e = eval_above(wo, wi, t, p);
            return {.valid = wo.z > 0.0f && wi.z > 0.0f && e.pdf > 1e-30f,
                    .wi = wi,
                    .weight = e.f_cos / e.pdf,
                    .pdf = e.pdf,
                    .width = select(specular, surface.roughness(), Float(1))};
        }

    private:
        struct Choice { // probabilities
            Float coat, base;
        };

        Choice choice(Float t) const {
            const Float s = (1 - t) * specular_weight, d = t * diffuse_weight;
            const auto coated = s > 0.0f;
            return {select(coated, s / (s + d), Float(0)), select(coated, d / (s + d), Float(1))};
        }
        BsdfEval<Float> eval_above(const Vec3<Float> &wo, const Vec3<Float> &wi, Float t,
                                   const Choice &p) const {
            const auto [reflected, density] = detail::reflected_by_facets(surface, wo, wi, eta);
            const Float cosine = cosine_hemisphere_pdf(wi.z);
            return {reflectance * reflected + base * (cosine * t * (*entering)(wi.z)),
                    density * p.coat + cosine * p.base};
        }
    };

    void build();

    template <class Float>
    Lobe<Float> prepare(const auto &read) const {
        const float relative = int_ior / ext_ior;
        const Rgb<Float> d = read(diffuse_reflectance), s = read(specular_reflectance);
        // The geometric series of reflections between base and coat; the linear variant keeps the hue.
        const Rgb<Float> escaping =
            nonlinear ? Rgb<Float>(1) - d + d * coat_->leaving : Rgb<Float>(coat_->leaving);
        return {{distribution, alpha, alpha},
                relative,
                &coat_->entering,
                d / (escaping * sqr(relative)),
                s,
                mean(d),
                mean(s)};
    }

private:
    struct Coat {
        CosineTable entering;
        float leaving = 1; // fraction of diffuse light from below that the coat transmits
    };
    Coat coat() const;

    std::shared_ptr<const Coat> coat_;
};

inline void RoughPlastic::build() {
    check_indices(int_ior, ext_ior);
    coat_ = shared_table(key_of(distribution, alpha, int_ior, ext_ior, std::uint32_t{multiscatter}),
                         [&] { return coat(); });
}

inline RoughPlastic::Coat RoughPlastic::coat() const {
    Coat result;
    const Microfacet<float> surface(distribution, alpha, alpha);
    const float eta = int_ior / ext_ior;
    const auto fraction = [&](auto of, float cos_theta, float beyond) {
        const Vec3f w{safe_sqrt(1 - cos_theta * cos_theta), 0, cos_theta};
        return surface.mean_over_visible(w, 64, [&](Vec3f m) { return of(surface, w, m, beyond); });
    };
    float inside = 0, entering = 0;
    for (std::size_t i = 0; i < result.entering.values.size(); ++i) {
        const float cos_theta = CosineTable::node(i);
        const float value = multiscatter ? 1 - fraction(detail::reflected_fraction, cos_theta, eta)
                                         : fraction(detail::transmitted_fraction, cos_theta, eta);
        result.entering.values[i] = value;
        entering += cos_theta * value;
        inside += cos_theta * fraction(detail::reflected_fraction, cos_theta, 1 / eta);
    }
    // With `multiscatter`, reciprocity requires leaving = mean(entering) / eta^2 (trapezoidal rule).
    // Otherwise it is Mitsuba's mean over the nodes, so that the same file gives the same picture; that is
    // not smaller, except for an index for which there are too few nodes.
    const auto nodes = static_cast<float>(result.entering.values.size());
    entering -= result.entering.values.back() / 2;
    const float reciprocal = 2 * entering / ((nodes - 1) * sqr(eta));
    result.leaving = multiscatter ? reciprocal : max(1 - 2 * inside / nodes, reciprocal);
    return result;
}

} // namespace lajolla
