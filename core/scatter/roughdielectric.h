#pragma once

#include <memory>

#include "base/warp.h"
#include "scatter/bsdf.h"
#include "scatter/fresnel.h"
#include "scatter/microfacet.h"
#include "scatter/multiscatter.h"

namespace lajolla {

struct RoughDielectric {
    static constexpr const char *name = "roughdielectric";
    static constexpr const char *doc = "Frosted glass: a rough boundary that reflects and refracts.";
    MicrofacetKind distribution = MicrofacetKind::beckmann;
    Texture<float> alpha_u{0.1f}, alpha_v{0.1f};
    float int_ior = 1.5046f, ext_ior = 1.000277f;
    Texture<Spectrum> specular_reflectance{Spectrum(1)}, specular_transmittance{Spectrum(1)};
    bool multiscatter = false;

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
                .range(0, 1),
            field("multiscatter", &RoughDielectric::multiscatter,
                  "give back the light that bounces between microfacets, of one alpha"));
    }

    // What single scattering loses on either side of the boundary.
    struct Losses {
        LostLight above, below;

        Losses(const Microfacet &surface, bool varies, float eta)
            : above(surface, varies, Loss{eta}), below(surface, varies, Loss{1 / eta}) {}

    private:
        struct Loss {
            float beyond;
            float operator()(const Microfacet &surface, Vec3f w, int n) const {
                return surface.mean_over_visible(w, n, [&](Vec3f m) {
                    return 1 - detail::reflected_fraction(surface, w, m, beyond) -
                           detail::transmitted_fraction(surface, w, m, beyond);
                });
            }
        };
    };

    struct Lobe {
        static constexpr bool transmissive = true, delta = false;
        Microfacet surface;
        float eta; // inside relative to outside
        Spectrum reflectance, transmittance;
        const Losses *lost = nullptr; // where multiple scattering counts

        float roughness() const { return surface.roughness(); }

        BsdfEval eval(Vec3f wo, Vec3f wi) const {
            const BsdfEval single =
                wo.z > 0 ? eval_above(wo, wi, eta) : eval_above(mirror(wo), mirror(wi), 1 / eta);
            return lost ? with_lost_light(single, wo, wi) : single;
        }
        std::optional<BsdfSample> sample(Vec3f wo, float u_lobe, Vec2f u) const {
            if (lost) return sample_with_lost_light(wo, u_lobe, u);
            return sample_single(wo, u_lobe, u);
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

        // Light that came from one side and was lost there, on its way to both sides: fractions over the mean
        // loss of the side where it arrives, which make the lobe of LostLight.
        struct Regained {
            Spectrum reflected, transmitted;
        };

        // As much is transmitted as diffuse light would be at a smooth boundary, less where the sides lose
        // differently: reciprocity asks for equal n^2 mean(L) t.
        Regained regained(bool above) const {
            const float a = lost->above.mean(surface), b = lost->below.mean(surface);
            const float here = std::max(above ? a : b, 1e-6f), there = std::max(above ? b : a, 1e-6f);
            const float beyond = above ? eta : 1 / eta, denser = std::max(beyond, 1 / beyond);
            const float entering = 1 - fresnel_diffuse_reflectance(denser);
            const float t = (beyond > 1 ? entering : entering / sqr(denser)) * std::min(here, there) / here;
            return {reflectance * ((1 - t) / here), transmittance * (t / there)};
        }
        const LostLight &losses(bool above) const { return above ? lost->above : lost->below; }
        static Vec3f up(Vec3f w) { return {w.x, w.y, std::abs(w.z)}; }

        // Of the lost light: the probability that it is reflected.
        static float reflecting(const Regained &r) {
            const float reflected = mean(r.reflected), total = reflected + mean(r.transmitted);
            return total > 0 ? reflected / total : 0;
        }

        [[gnu::noinline]] BsdfEval with_lost_light(const BsdfEval &single, const Vec3f &wo,
                                                   const Vec3f &wi) const {
            if (wo.z == 0 || wi.z == 0) return {};
            const bool above = wo.z > 0, reflected = above == (wi.z > 0);
            const Regained r = regained(above);
            const float p = losses(above)(surface, up(wo)), q = losses(wi.z > 0)(surface, up(wi)),
                        cosine = cosine_hemisphere_pdf(std::abs(wi.z)),
                        chosen = reflected ? reflecting(r) : 1 - reflecting(r);
            return {single.f_cos + (reflected ? r.reflected : r.transmitted) * (p * q * cosine),
                    lerp(p, single.pdf, cosine * chosen),
                    reflected ? 1
                    : above   ? eta
                              : 1 / eta};
        }

        [[gnu::noinline]] std::optional<BsdfSample> sample_with_lost_light(const Vec3f &wo, float u_lobe,
                                                                           const Vec2f &u) const {
            if (wo.z == 0) return std::nullopt;
            const bool above = wo.z > 0;
            const float p = losses(above)(surface, up(wo));
            BsdfSample result;
            if (u_lobe >= p) {
                const auto single = sample_single(wo, std::min((u_lobe - p) / (1 - p), one_minus_ulp), u);
                if (!single) return std::nullopt;
                result = *single;
            } else {
                const bool reflected = u_lobe / p < reflecting(regained(above));
                result = {sample_cosine_hemisphere(u), Spectrum(0), 0};
                if (reflected != above) result.wi = mirror(result.wi);
            }
            const BsdfEval e = eval(wo, result.wi);
            if (!(e.pdf > 1e-30f)) return std::nullopt;
            result.weight = e.f_cos / e.pdf;
            result.pdf = e.pdf;
            result.eta = e.eta;
            return result;
        }

        std::optional<BsdfSample> sample_single(const Vec3f &wo, float u_lobe, const Vec2f &u) const {
            if (wo.z > 0) return sample_above(wo, u_lobe, u, eta);
            auto s = sample_above(mirror(wo), u_lobe, u, 1 / eta);
            if (s) s->wi = mirror(s->wi);
            return s;
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

    void build() {
        check_indices(int_ior, ext_ior);
        if (int_ior == ext_ior)
            throw std::invalid_argument(
                "int_ior and ext_ior must differ: a rough boundary bends no light at " +
                std::to_string(int_ior) + " on both sides");
        if (!multiscatter) return;
        if (!(alpha_u == alpha_v)) // total reflection makes the loss a function that tables do not hold
            throw std::invalid_argument(
                "multiscatter is for equal roughness along both tangents; alpha_u and alpha_v differ");
        lost_ = std::make_shared<Losses>(Microfacet(distribution, alpha_u.constant, alpha_v.constant),
                                         !alpha_u.is_constant(), int_ior / ext_ior);
    }
    Lobe prepare(const auto &read) const {
        return {{distribution, read(alpha_u), read(alpha_v)},
                int_ior / ext_ior,
                read(specular_reflectance),
                read(specular_transmittance),
                lost_.get()};
    }

private:
    std::shared_ptr<const Losses> lost_;
};

} // namespace lajolla
