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
    static constexpr const char *doc = "Rough glass: a rough boundary that reflects and refracts.";
    MicrofacetKind distribution = MicrofacetKind::beckmann;
    Texture<float> alpha_u{0.1f}, alpha_v{0.1f};
    float int_ior = 1.5046f, ext_ior = 1.000277f;
    Texture<Spectrum> specular_reflectance{Spectrum(1)}, specular_transmittance{Spectrum(1)};
    bool multiscatter = false;

    static constexpr auto fields() {
        return std::tuple(
            field("distribution", &RoughDielectric::distribution, "microfacet distribution"),
            field("alpha_u", &RoughDielectric::alpha_u, "roughness along the tangent, at least 0.0001")
                .range(0),
            field("alpha_v", &RoughDielectric::alpha_v, "roughness across the tangent, at least 0.0001")
                .range(0),
            field("int_ior", &RoughDielectric::int_ior, "index of refraction behind the surface")
                .range(least_index, largest_index),
            field("ext_ior", &RoughDielectric::ext_ior, "index of refraction in front of the surface")
                .range(least_index, largest_index),
            field("specular_reflectance", &RoughDielectric::specular_reflectance,
                  "tints the reflection; 1 is physical")
                .range(0, 1),
            field("specular_transmittance", &RoughDielectric::specular_transmittance,
                  "tints the refraction; 1 is physical")
                .range(0, 1),
            field("multiscatter", &RoughDielectric::multiscatter,
                  "compensate the energy lost by single scattering; needs equal alpha_u and alpha_v"));
    }

    BsdfTraits traits() const { return {.transmissive = true, .anisotropic = !(alpha_u == alpha_v)}; }

    // The energy that single scattering loses on each side of the boundary.
    struct Losses {
        LostLight above, below;

        static std::shared_ptr<const Losses> of(const Microfacet<float> &surface, bool varies, float eta) {
            return shared_table(key_of(surface, std::uint32_t{varies}, eta),
                                [&] { return Losses(surface, varies, eta); });
        }

    private:
        Losses(const Microfacet<float> &surface, bool varies, float eta)
            : above(surface, varies, Loss{eta}), below(surface, varies, Loss{1 / eta}) {}

        struct Loss {
            float beyond;
            float operator()(const Microfacet<float> &surface, Vec3f w, int n) const {
                return surface.mean_over_visible(w, n, [&](Vec3f m) {
                    return 1 - detail::reflected_fraction(surface, w, m, beyond) -
                           detail::transmitted_fraction(surface, w, m, beyond);
                });
            }
        };
    };

    template <class Float>
    struct Lobe {
        Microfacet<Float> surface;
        float eta; // inside relative to outside
        Rgb<Float> reflectance, transmittance;
        const Losses *lost = nullptr; // for multiple scattering

        Float roughness() const { return surface.roughness(); }

        BsdfEval<Float> eval(const Vec3<Float> &wo, const Vec3<Float> &wi) const {
            const BsdfEval<Float> single = eval_single(wo, wi);
            return lost ? with_lost_light(single, wo, wi) : single;
        }
        BsdfSample<Float> sample(const Vec3<Float> &wo, Float u_lobe, const Vec2<Float> &u) const {
            return lost ? sample_with_lost_light(wo, u_lobe, u) : sample_single(wo, u_lobe, u);
        }

    private:
        using Bool = BoolOf<Float>;

        struct Split {
            Rgb<Float> reflected, transmitted;
            Float p_reflect, p_transmit; // probabilities; zero if black
            Float cos_t;
        };

        Split split(Float cos_o, Float beyond) const {
            const auto [f, cos_t] = fresnel_dielectric(cos_o, beyond);
            const Rgb<Float> r = reflectance * f, t = transmittance * (1 - f);
            const Float p_r = mean(r), p_t = mean(t), total = max(p_r + p_t, Float(1e-30f));
            return {r, t, p_r / total, p_t / total, cos_t};
        }

        static Vec3<Float> up(const Vec3<Float> &w) { return {w.x, w.y, abs(w.z)}; }
        // w, flipped if `side` is below.
        static Vec3<Float> towards(const Vec3<Float> &side, const Vec3<Float> &w) {
            return {w.x, w.y, select(side.z > 0.0f, w.z, -w.z)};
        }
        // n_far / n_w: the far side relative to the side of w.
        Float index_beyond(const Vec3<Float> &w) const {
            return select(w.z > 0.0f, Float(eta), Float(1 / eta));
        }

        // Single scattering. Both directions are flipped so that wo is above the surface.
        BsdfEval<Float> eval_single(const Vec3<Float> &given_wo, const Vec3<Float> &given_wi) const {
            const Vec3<Float> wo = up(given_wo), wi = towards(given_wo, given_wi);
            const Float beyond = index_beyond(given_wo);
            const auto reflected = wi.z > 0.0f;
            // Walter et al., eq. 13 and 16
            const Vec3<Float> h = wo + wi * select(reflected, Float(1), beyond);
            const Float h2 = length_squared(h);
            const Vec3<Float> m = h * copysign(1 / sqrt(h2), h.z);
            const Float cos_o = dot(wo, m), cos_i = dot(wi, m);
            // Neither tangential nor at a facet's back.
            const auto valid = wo.z > 0.0f && wi.z != 0.0f && cos_o > 0.0f && cos_i * wi.z > 0.0f;

            const Split s = split(cos_o, beyond);
            const Float density = single_density(wo, m, reflected, cos_o, cos_i, h2, beyond);
            const BsdfEval<Float> e{
                select(reflected, s.reflected, s.transmitted) * (density * surface.masking(up(wi))),
                density * select(reflected, s.p_reflect, s.p_transmit), select(reflected, Float(1), beyond)};
            return select(valid, e, {});
        }

        // The density of wi if the facet reflects or transmits all light; h2 is the squared length of the
        // half vector of transmission before it is normalized.
        Float single_density(const Vec3<Float> &wo, const Vec3<Float> &m, Bool reflected, Float cos_o,
                             Float cos_i, Float h2, Float beyond) const {
            const Float bending = cos_o * sqr(beyond) * abs(cos_i) / h2; // Walter et al., eq. 17
            return surface.visible(wo, m) * select(reflected, Float(0.25f), bending);
        }

        BsdfSample<Float> sample_single(const Vec3<Float> &given_wo, Float u_lobe,
                                        const Vec2<Float> &u) const {
            const Vec3<Float> wo = up(given_wo);
            const Float beyond = index_beyond(given_wo);
            const Vec3<Float> m = surface.sample_visible(wo, u);
            const Float cos_o = dot(wo, m);
            const Split s = split(cos_o, beyond);
            const auto reflected = u_lobe < s.p_reflect;
            const Vec3<Float> wi = select(reflected, reflect(wo, m), refract(wo, m, cos_o, s.cos_t, beyond));

            const Float h2 = length_squared(wo + wi * beyond);
            const Float p = select(reflected, s.p_reflect, s.p_transmit); // zero if it is black either way
            const Float pdf = p * single_density(wo, m, reflected, cos_o, s.cos_t, h2, beyond);
            return {.valid = wo.z > 0.0f && wi.z != 0.0f && reflected == (wi.z > 0.0f) && pdf > 1e-30f,
                    .wi = towards(given_wo, wi),
                    .weight = select(reflected, s.reflected, s.transmitted) * (surface.masking(up(wi)) / p),
                    .pdf = pdf,
                    .eta = select(reflected, Float(1), beyond),
                    .width = roughness()};
        }

        // Light lost on one side that leaves to both sides: fractions over the mean loss of the side where it
        // arrives, which scale the lobe of LostLight.
        struct Regained {
            Rgb<Float> reflected, transmitted;
        };

        // The transmitted fraction t is that of diffuse light at a smooth boundary, or less if the losses of
        // the sides differ: reciprocity requires n^2 mean(L) t to be equal on both sides.
        Regained regained(const Vec3<Float> &wo) const {
            const auto above = wo.z > 0.0f;
            const Float a = lost->above.mean(surface), b = lost->below.mean(surface);
            const Float here = max(select(above, a, b), Float(1e-6f)),
                        there = max(select(above, b, a), Float(1e-6f));
            const Float beyond = index_beyond(wo), denser = max(beyond, 1 / beyond);
            const Float entering = fresnel_diffuse_transmittance(denser);
            const Float t = select(beyond > 1.0f, entering, entering / sqr(denser)) * min(here, there) / here;
            return {reflectance * ((1 - t) / here), transmittance * (t / there)};
        }
        // The fraction lost along w, on its side.
        Float loss(const Vec3<Float> &w) const {
            return select(w.z > 0.0f, lost->above(surface, up(w)), lost->below(surface, up(w)));
        }

        // The probability that lost light is reflected.
        static Float reflecting(const Regained &r) {
            const Float reflected = mean(r.reflected), total = reflected + mean(r.transmitted);
            return select(total > 0.0f, reflected / total, Float(0));
        }

        [[gnu::noinline]] BsdfEval<Float>
        with_lost_light(const BsdfEval<Float> &single, const Vec3<Float> &wo, const Vec3<Float> &wi) const {
            const auto above = wo.z > 0.0f, reflected = above == (wi.z > 0.0f);
            const Regained r = regained(wo);
            const Float p = loss(wo), q = loss(wi), cosine = cosine_hemisphere_pdf(abs(wi.z)),
                        chosen = select(reflected, reflecting(r), 1 - reflecting(r));
            const BsdfEval<Float> e{
                single.f_cos + select(reflected, r.reflected, r.transmitted) * (p * q * cosine),
                lerp(p, single.pdf, cosine * chosen), select(reflected, Float(1), index_beyond(wo))};
            return select(wo.z != 0.0f && wi.z != 0.0f, e, {});
        }

        [[gnu::noinline]] BsdfSample<Float> sample_with_lost_light(const Vec3<Float> &wo, Float u_lobe,
                                                                   const Vec2<Float> &u) const {
            const Float p = loss(wo);
            const auto above = wo.z > 0.0f, is_single = u_lobe >= p;
            const BsdfSample<Float> single =
                sample_single(wo, min((u_lobe - p) / (1 - p), Float(one_minus_ulp)), u);
            const auto reflected = u_lobe / p < reflecting(regained(wo));
            const Vec3<Float> diffuse = sample_cosine_hemisphere(u);
            const Float z = select(reflected == above, diffuse.z, -diffuse.z);
            const Vec3<Float> wi = select(is_single, single.wi, {diffuse.x, diffuse.y, z});
            const BsdfEval<Float> e = eval(wo, wi);
            return {.valid = (!is_single || single.valid) && e.pdf > 1e-30f,
                    .wi = wi,
                    .weight = e.f_cos / e.pdf,
                    .pdf = e.pdf,
                    .eta = e.eta,
                    .width = select(is_single, single.width, Float(1))};
        }
    };

    void build() {
        check_indices(int_ior, ext_ior);
        if (int_ior == ext_ior)
            throw std::invalid_argument(
                "int_ior and ext_ior must differ: a rough boundary does not refract light at " +
                std::to_string(int_ior) + " on both sides");
        if (!multiscatter) return;
        if (!(alpha_u == alpha_v)) // with total reflection, the tables have too few coordinates
            throw std::invalid_argument(
                "multiscatter is for equal roughness along both tangents; alpha_u and alpha_v differ");
        lost_ = Losses::of(Microfacet<float>(distribution, alpha_u.constant, alpha_v.constant),
                           !alpha_u.is_constant(), index());
    }

    template <class Float>
    Lobe<Float> prepare(const auto &read) const {
        return {{distribution, read(alpha_u), read(alpha_v)},
                index(),
                read(specular_reflectance),
                read(specular_transmittance),
                lost_.get()};
    }

private:
    float index() const { return bending_index(int_ior / ext_ior); }
    std::shared_ptr<const Losses> lost_;
};

} // namespace lajolla
