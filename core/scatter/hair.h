#pragma once

#include <array>

#include "scatter/bsdf.h"
#include "scatter/fresnel.h"

namespace lajolla {

namespace detail {

// exp(-x) I_0(x) for x >= 0, within 2e-7 (Abramowitz and Stegun, 9.8.1 and 9.8.2).
template <class Float>
Float bessel_i0_scaled(Float x) {
    const Float t = x / 3.75f;
    const Float small = exp(-x) * polynomial(t * t, {0.0045813f, 0.0360768f, 0.2659732f, 1.2067492f,
                                                     3.0899424f, 3.5156229f, 1.0f});
    const Float large = polynomial(1 / t, {0.00392377f, -0.01647633f, 0.02635537f, -0.02057706f, 0.00916281f,
                                           -0.00157565f, 0.00225319f, 0.01328592f, 0.39894228f}) /
                        sqrt(x);
    return select(t < 1.0f, small, large);
}

} // namespace detail

// Chiang et al. 2016, "A Practical and Controllable Hair and Fur Model for Production Path Tracing", in the
// form of Pharr 2016, "The Implementation of a Hair Scattering Model". The fibre is along y. The angle
// between the normal z and the direction determines where the fibre is hit. One event represents all
// scattering in the fibre.
struct Hair {
    static constexpr const char *name = "hair";
    static constexpr const char *doc = "A fibre of hair or fur, on curves.";
    Texture<Spectrum> sigma_a{Spectrum(0.5821f, 0.9861f, 1.991f)};
    float scale = 1;
    float longitudinal_roughness = 0.3f, azimuthal_roughness = 0.3f, scale_tilt = 2;
    float int_ior = 1.55f, ext_ior = 1.000277f;

    static constexpr auto fields() {
        return std::tuple(
            field("sigma_a", &Hair::sigma_a, "absorption in the fibre, per radius; brown by default")
                .range(0),
            field("scale", &Hair::scale, "factor of sigma_a").range(0),
            field("longitudinal_roughness", &Hair::longitudinal_roughness,
                  "roughness along the fibre, at least 0.05")
                .range(0, 1),
            field("azimuthal_roughness", &Hair::azimuthal_roughness,
                  "roughness around the fibre, at least 0.02")
                .range(0, 1),
            field("scale_tilt", &Hair::scale_tilt, "slope of the scales on the fibre")
                .range(-45, 45)
                .unit("degrees"),
            field("int_ior", &Hair::int_ior, "index of refraction of the fibre")
                .range(least_index, largest_index),
            field("ext_ior", &Hair::ext_ior, "index of refraction outside")
                .range(least_index, largest_index));
    }
    BsdfTraits traits() const { return {.transmissive = true, .anisotropic = true}; }

    // Values shared by all hits of a model.
    struct Fibre {
        float eta = 1.55f;
        std::array<float, 4> variance{}; // of the longitudinal lobes
        std::array<float, 4> area{};     // their integrals before they are normalized
        float logistic = 1;              // scale of the azimuthal lobes
        float logistic_area = 1;         // their integral
        std::array<Vec2f, 3> tilts{};    // (cos, sin) by which scales turn the lobes R, TT and TRT
    };

    template <class Float>
    struct Lobe {
        const Fibre *fibre;
        Rgb<Float> sigma_a;

        float roughness() const { return 1; }

        BsdfEval<Float> eval(const Vec3<Float> &wo, const Vec3<Float> &wi) const {
            const Outgoing outgoing(wo, *fibre, sigma_a);
            return value(outgoing, longitude(wi), atan2(wi.z, wi.x) - outgoing.phi);
        }

        BsdfSample<Float> sample(const Vec3<Float> &wo, Float u_lobe, const Vec2<Float> &u) const {
            const Outgoing outgoing(wo, *fibre, sigma_a);
            const Chosen lobe = choose(outgoing, u_lobe);

            // d'Eon et al. 2013, "Importance Sampling for Physically-Based Hair Fiber Models"; in terms of
            // 1 - cos, which stays exact for narrow lobes
            const Float v = lobe.variance;
            const Float height = min(-v * log(max(u.x + (1 - u.x) * exp(-2 / v), Float(1e-37f))), Float(2));
            const Float across = sqrt(height * (2 - height)) * cos(2 * pi * u.y);
            const Float sine = clamp((height - 1) * lobe.from.y + across * lobe.from.x, -1.0f, 1.0f);
            const Float cosine = safe_sqrt(1 - sine * sine);
            const Float turn =
                select(lobe.is_last, 2 * pi * lobe.rest, lobe.exit + sample_logistic(lobe.rest));
            const auto [sin_phi, cos_phi] = sine_cosine(outgoing.phi + turn);
            const BsdfEval<Float> e = value(outgoing, {cosine, sine}, turn);
            return {lobe.probability > 0.0f && e.pdf > 1e-30f,
                    normalize(Vec3<Float>{cosine * cos_phi, sine, cosine * sin_phi}), e.f_cos / e.pdf, e.pdf};
        }

    private:
        // (cos, sin) of the angle between a direction and the plane across the fibre.
        static Vec2<Float> longitude(const Vec3<Float> &w) { return {sqrt(w.x * w.x + w.z * w.z), w.y}; }

        // Values that depend on wo only.
        struct Outgoing {
            Vec2<Float> theta;      // longitude
            Float phi;              // azimuth, from x to z
            Float gamma_o, gamma_t; // between the normal and the ray across the fibre, outside and inside
            std::array<Rgb<Float>, 4> attenuation;
            std::array<Float, 4> probability;

            Outgoing(const Vec3<Float> &wo, const Fibre &fibre, const Rgb<Float> &sigma_a)
                : theta(longitude(wo)), phi(atan2(wo.z, wo.x)), gamma_o(atan2(-wo.x, wo.z)) {
                const Float cosine = max(theta.x, Float(1e-6f)), h = -wo.x / cosine;
                const Float inside = max(safe_sqrt(sqr(fibre.eta) - sqr(theta.y)),
                                         Float(1e-6f)); // Marschner et al. 2003, sec. 4.1
                const Float sin_t = clamp(h * cosine / inside, -1.0f, 1.0f),
                            cos_t = safe_sqrt(1 - sin_t * sin_t);
                gamma_t = atan2(sin_t, cos_t);
                // Length of a segment inside the fibre over its radius: 2 cos(gamma_t) / cos(theta_t)
                const Rgb<Float> t = exp(sigma_a * (-2 * cos_t * fibre.eta / inside));
                const Float f = fresnel_dielectric(abs(wo.z), fibre.eta).reflectance;
                attenuation[0] = Rgb<Float>(f);
                attenuation[1] = t * sqr(1 - f);
                attenuation[2] = attenuation[1] * t * f;
                attenuation[3] = attenuation[2] * t * f / max(Rgb<Float>(1) - t * f, Rgb<Float>(1e-6f));
                Float sum = 0;
                for (std::size_t p = 0; p < 4; ++p) sum += probability[p] = luminance(attenuation[p]);
                for (Float &p : probability) p /= max(sum, Float(1e-30f));
            }

            // The change of the azimuth of a ray in a smooth fibre.
            Float exit(std::size_t p) const {
                return static_cast<float>(p) * (2 * gamma_t + pi) - 2 * gamma_o;
            }
            // The longitude, tilted by the scales.
            Vec2<Float> tilted(std::size_t p, const Fibre &fibre) const {
                if (p == 3) return theta;
                const auto [c, s] = fibre.tilts[p];
                return {abs(theta.x * c - theta.y * s), theta.y * c + theta.x * s};
            }
        };

        // The lobe that a random number selects.
        struct Chosen {
            Float rest; // of the number: uniform again
            Float probability, variance, exit;
            Vec2<Float> from;             // tilted longitude
            BoolOf<Float> is_last = true; // of all segments inside the fibre from the third on
        };
        Chosen choose(const Outgoing &outgoing, Float u) const {
            Chosen chosen{u, outgoing.probability[0], fibre->variance[0], outgoing.exit(0),
                          outgoing.tilted(0, *fibre)};
            for (std::size_t p = 1; p < 4; ++p) {
                const auto further = chosen.is_last && chosen.rest >= chosen.probability;
                chosen.rest = select(further, chosen.rest - chosen.probability, chosen.rest);
                chosen.probability = select(further, outgoing.probability[p], chosen.probability);
                chosen.variance = select(further, Float(fibre->variance[p]), chosen.variance);
                chosen.exit = select(further, outgoing.exit(p), chosen.exit);
                chosen.from = select(further, outgoing.tilted(p, *fibre), chosen.from);
                chosen.is_last = further;
            }
            chosen.rest = min(chosen.rest / chosen.probability, Float(one_minus_ulp));
            return chosen;
        }

        BsdfEval<Float> value(const Outgoing &outgoing, const Vec2<Float> &theta, Float turn) const {
            BsdfEval<Float> sum;
            for (std::size_t p = 0; p < 4; ++p) {
                const Float m = longitudinal(p, outgoing.tilted(p, *fibre), theta);
                const Float n = p < 3 ? azimuthal(turn - outgoing.exit(p)) : Float(inv_pi / 2);
                sum.f_cos += outgoing.attenuation[p] * (m * n);
                sum.pdf += outgoing.probability[p] * (m * n);
            }
            return sum;
        }

        // d'Eon et al. 2011, "An Energy-Conserving Hair Reflectance Model", equation 7, with the exponents
        // put together: exp(-s / v) I_0(c / v) / (2 v sinh(1 / v)), c and s of products of cosines and sines.
        Float longitudinal(std::size_t p, const Vec2<Float> &from, const Vec2<Float> &to) const {
            const float v = fibre->variance[p];
            const Float apart = (sqr(from.x - to.x) + sqr(from.y + to.y)) / 2; // 1 + s - c
            return exp(-apart / v) * detail::bessel_i0_scaled(from.x * to.x / v) / fibre->area[p];
        }

        // A logistic distribution on [-pi, pi].
        Float azimuthal(Float angle) const {
            angle -= 2 * pi * floor(angle * (inv_pi / 2) + 0.5f);
            const Float e = exp(-abs(angle) / fibre->logistic);
            return e / (fibre->logistic_area * sqr(1 + e));
        }
        Float sample_logistic(Float u) const {
            const float s = fibre->logistic, low = 1 / (1 + exp(pi / s));
            const Float x = low + u * (1 - 2 * low);
            return clamp(s * (log(x) - log1p(-x)), -pi, pi);
        }
    };

    void build() {
        check_indices(int_ior, ext_ior);
        const float m = max(longitudinal_roughness, 0.05f), n = max(azimuthal_roughness, 0.02f);
        // Fits of Chiang et al. 2016, section 4.1
        const float v = sqr(0.726f * m + 0.812f * m * m + 3.7f * pow(m, 20.0f));
        const float s = std::sqrt(pi / 8) * (0.265f * n + 1.194f * n * n + 5.372f * pow(n, 22.0f));
        fibre_.eta = int_ior / ext_ior;
        fibre_.variance = {v, v / 4, 4 * v, 4 * v};
        for (std::size_t p = 0; p < 4; ++p)
            fibre_.area[p] = fibre_.variance[p] * -expm1(-2 / fibre_.variance[p]);
        fibre_.logistic = s;
        fibre_.logistic_area = s * tanh(pi / (2 * s));
        const float tilt = scale_tilt * (pi / 180), factors[]{-2, 1, 4};
        for (std::size_t p = 0; p < 3; ++p)
            fibre_.tilts[p] = {cos(factors[p] * tilt), sin(factors[p] * tilt)};
    }
    template <class Float>
    Lobe<Float> prepare(const auto &read) const {
        return {&fibre_, max(read(sigma_a) * scale, Rgb<Float>(0))};
    }

private:
    Fibre fibre_;
};

} // namespace lajolla
