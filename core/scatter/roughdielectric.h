#pragma once

#include "scatter/bsdf.h"
#include "scatter/fresnel.h"
#include "scatter/microfacet.h"

namespace lajolla {

struct RoughDielectric {
    static constexpr const char *name = "roughdielectric";
    static constexpr const char *doc = "Frosted glass: a rough boundary that reflects and refracts.";
    MicrofacetKind distribution = MicrofacetKind::beckmann;
    Texture<float> alpha_u{0.1f}, alpha_v{0.1f};
    float int_ior = 1.5046f, ext_ior = 1.000277f;
    Texture<Spectrum> specular_reflectance{Spectrum(1)}, specular_transmittance{Spectrum(1)};

    static constexpr auto fields() {
        return std::tuple(
            field("distribution", &RoughDielectric::distribution, "statistics of the microfacets"),
            field("alpha_u", &RoughDielectric::alpha_u, "roughness along the tangent, at least 0.0001")
                .range(0),
            field("alpha_v", &RoughDielectric::alpha_v, "roughness across the tangent, at least 0.0001")
                .range(0),
            field("int_ior", &RoughDielectric::int_ior, "index of refraction behind the surface").range(0),
            field("ext_ior", &RoughDielectric::ext_ior, "index of refraction in front of the surface")
                .range(0),
            field("specular_reflectance", &RoughDielectric::specular_reflectance,
                  "tints the reflection; 1 is physical")
                .range(0, 1),
            field("specular_transmittance", &RoughDielectric::specular_transmittance,
                  "tints the refraction; 1 is physical")
                .range(0, 1));
    }

    struct Lobe {
        static constexpr bool transmissive = true, delta = false;
        Microfacet surface;
        float eta; // inside relative to outside
        Spectrum reflectance, transmittance;

        float roughness() const { return surface.roughness(); }

        BsdfEval eval(Vec3f wo, Vec3f wi) const {
            return wo.z > 0 ? eval_above(wo, wi, eta) : eval_above(mirror(wo), mirror(wi), 1 / eta);
        }
        std::optional<BsdfSample> sample(Vec3f wo, float u_lobe, Vec2f u) const {
            if (wo.z > 0) return sample_above(wo, u_lobe, u, eta);
            auto s = sample_above(mirror(wo), u_lobe, u, 1 / eta);
            if (s) s->wi = mirror(s->wi);
            return s;
        }

    private:
        struct Split {
            Spectrum reflected, transmitted;
            float p_reflect, p_transmit; // of choosing either; zero where it is black
            float cos_t;
        };

        static Vec3f mirror(Vec3f w) { return {w.x, w.y, -w.z}; }

        Split split(float cos_o, float beyond) const {
            const auto [f, cos_t] = fresnel_dielectric(cos_o, beyond);
            const Spectrum r = reflectance * f, t = transmittance * (1 - f);
            const float p_r = mean(r), p_t = mean(t), total = std::max(p_r + p_t, 1e-30f);
            return {r, t, p_r / total, p_t / total, cos_t};
        }

        // With wo above the surface; `beyond` is the index of refraction below relative to that above.
        BsdfEval eval_above(Vec3f wo, Vec3f wi, float beyond) const {
            if (wo.z <= 0 || wi.z == 0) return {};
            const bool reflected = wi.z > 0;
            const Vec3f h = reflected ? wo + wi : wo + wi * beyond; // Walter et al., eq. 13 and 16
            const float h2 = length_squared(h);
            const Vec3f m = h * std::copysign(1 / std::sqrt(h2), h.z);
            const float cos_o = dot(wo, m), cos_i = dot(wi, m);
            if (cos_o <= 0 || cos_i * wi.z <= 0) // a facet's back
                return {};
            const Split s = split(cos_o, beyond);
            if (reflected) {
                const float density = surface.visible(wo, m) / 4;
                return {s.reflected * (density * surface.masking(wi)), density * s.p_reflect};
            }
            const float density =
                surface.visible(wo, m) * cos_o * sqr(beyond) * std::abs(cos_i) / h2; // eq. 17
            return {s.transmitted * (density * surface.masking(mirror(wi))), density * s.p_transmit, beyond};
        }

        std::optional<BsdfSample> sample_above(Vec3f wo, float u_lobe, Vec2f u, float beyond) const {
            if (wo.z <= 0) return std::nullopt;
            const Vec3f m = surface.sample_visible(wo, u);
            const float cos_o = dot(wo, m);
            const Split s = split(cos_o, beyond);
            if (s.p_reflect + s.p_transmit == 0) return std::nullopt; // black either way
            const bool reflected = u_lobe < s.p_reflect;
            const Vec3f wi = reflected ? reflect(wo, m) : refract(wo, m, cos_o, s.cos_t, beyond);
            if (reflected != (wi.z > 0)) return std::nullopt;
            const BsdfEval e = eval_above(wo, wi, beyond);
            if (!(e.pdf > 1e-30f)) return std::nullopt;
            return BsdfSample{wi,         e.f_cos / e.pdf, e.pdf, reflected ? 1 : beyond, ScatterKind::glossy,
                              roughness()};
        }
    };

    void build() const {
        check_indices(int_ior, ext_ior);
        if (int_ior == ext_ior)
            throw std::invalid_argument(
                "int_ior and ext_ior must differ: a rough boundary bends no light at " +
                std::to_string(int_ior) + " on both sides");
    }
    Lobe prepare(const auto &read) const {
        return {{distribution, read(alpha_u), read(alpha_v)},
                int_ior / ext_ior,
                read(specular_reflectance),
                read(specular_transmittance)};
    }
};

} // namespace lajolla
