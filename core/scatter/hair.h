#pragma once

#include <array>

#include "scatter/bsdf.h"
#include "scatter/fresnel.h"
#include "scatter/microfacet.h"

namespace lajolla {

namespace detail {

// exp(-x) I_0(x) for x >= 0, within 2e-7 (Abramowitz and Stegun, 9.8.1
// and 9.8.2).
inline float bessel_i0_scaled(float x) {
    const float t = x / 3.75f;
    if (t < 1)
        return std::exp(-x) * polynomial(t * t, {0.0045813f, 0.0360768f, 0.2659732f, 1.2067492f, 3.0899424f,
                                                 3.5156229f, 1.0f});
    return polynomial(1 / t, {0.00392377f, -0.01647633f, 0.02635537f, -0.02057706f, 0.00916281f, -0.00157565f,
                              0.00225319f, 0.01328592f, 0.39894228f}) /
           std::sqrt(x);
}

} // namespace detail

// Chiang et al. 2016, "A Practical and Controllable Hair and Fur Model for
// Production Path Tracing", in the form of Pharr 2016, "The Implementation of a
// Hair Scattering Model". The fibre runs along y, and where it is hit follows
// from the angle between the normal z and the direction: one event stands for
// the whole way through the fibre.
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
            field("int_ior", &Hair::int_ior, "index of refraction of the fibre").range(0),
            field("ext_ior", &Hair::ext_ior, "index of refraction outside").range(0));
    }
    BsdfTraits traits() const { return {.transmissive = true, .anisotropic = true}; }

    // What all hits of a model share.
    struct Fibre {
        float eta = 1.55f;
        std::array<float, 4> variance{}; // of the longitudinal lobes
        float logistic = 1;              // scale of the azimuthal lobes
        std::array<Vec2f, 3> tilts{};    // (cos, sin) by which scales turn the lobes R, TT and TRT
    };

    struct Lobe {
        const Fibre *fibre;
        Spectrum sigma_a;

        float roughness() const { return 1; }

        BsdfEval<float> eval(const Vec3f &wo, const Vec3f &wi) const {
            const Arrival arrival(wo, *fibre, sigma_a);
            return value(arrival, longitude(wi), std::atan2(wi.z, wi.x) - arrival.phi);
        }

        BsdfSample<float> sample(const Vec3f &wo, float u_lobe, const Vec2f &u) const {
            const Arrival arrival(wo, *fibre, sigma_a);
            std::size_t p = 0; // how often the light passes through the fibre; 3 is
                               // any number from there on
            float rest = u_lobe;
            while (p < 3 && rest >= arrival.probability[p]) rest -= arrival.probability[p++];
            if (!(arrival.probability[p] > 0)) return {};
            rest = std::min(rest / arrival.probability[p], one_minus_ulp);

            // d'Eon et al. 2013, "Importance Sampling for Physically-Based Hair Fiber
            // Models"; in terms of 1 - cos, which stays exact for narrow lobes
            const Vec2f from = arrival.tilted(p, *fibre);
            const float v = fibre->variance[p];
            const float height =
                std::min(-v * std::log(std::max(u.x + (1 - u.x) * std::exp(-2 / v), 1e-37f)), 2.0f);
            const float sine = std::clamp((height - 1) * from.y + std::sqrt(height * (2 - height)) *
                                                                      std::cos(2 * pi * u.y) * from.x,
                                          -1.0f, 1.0f);
            const float cosine = safe_sqrt(1 - sine * sine);
            const float turn = p < 3 ? arrival.exit(p) + sample_logistic(rest) : 2 * pi * rest;
            const float phi = arrival.phi + turn;
            const Vec3f wi{cosine * std::cos(phi), sine, cosine * std::sin(phi)};
            const BsdfEval<float> e = value(arrival, {cosine, sine}, turn);
            if (!(e.pdf > 1e-30f)) return {};
            return {true, normalize(wi), e.f_cos / e.pdf, e.pdf};
        }

    private:
        // (cos, sin) of the angle between a direction and the plane across the
        // fibre.
        static Vec2f longitude(const Vec3f &w) { return {std::sqrt(w.x * w.x + w.z * w.z), w.y}; }

        // What depends on wo alone.
        struct Arrival {
            Vec2f theta;            // longitude
            float phi;              // azimuth, from x to z
            float gamma_o, gamma_t; // between the normal and the ray across the
                                    // fibre, outside and inside
            std::array<Spectrum, 4> attenuation;
            std::array<float, 4> probability;

            Arrival(const Vec3f &wo, const Fibre &fibre, Spectrum sigma_a)
                : theta(longitude(wo)), phi(std::atan2(wo.z, wo.x)), gamma_o(std::atan2(-wo.x, wo.z)) {
                const float cosine = std::max(theta.x, 1e-6f), h = -wo.x / cosine;
                const float inside =
                    safe_sqrt(sqr(fibre.eta) - sqr(theta.y)); // Marschner et al. 2003, sec. 4.1
                const float sin_t = std::clamp(h * cosine / std::max(inside, 1e-6f), -1.0f, 1.0f);
                gamma_t = std::asin(sin_t);
                // The length of a passage over the fibre's radius: 2 cos(gamma_t) /
                // cos(theta_t)
                const float passage = 2 * safe_sqrt(1 - sin_t * sin_t) * fibre.eta / std::max(inside, 1e-6f);
                const Spectrum t{std::exp(-sigma_a.x * passage), std::exp(-sigma_a.y * passage),
                                 std::exp(-sigma_a.z * passage)};
                const float f = fresnel_dielectric(std::abs(wo.z), fibre.eta).reflectance;
                attenuation[0] = Spectrum(f);
                attenuation[1] = t * sqr(1 - f);
                attenuation[2] = attenuation[1] * t * f;
                attenuation[3] = attenuation[2] * t * f / max(Spectrum(1) - t * f, Spectrum(1e-6f));
                float sum = 0;
                for (std::size_t p = 0; p < 4; ++p) sum += probability[p] = luminance(attenuation[p]);
                for (float &p : probability) p /= std::max(sum, 1e-30f);
            }

            // By how much the azimuth of a ray that meets no roughness changes.
            float exit(std::size_t p) const {
                return static_cast<float>(p) * (2 * gamma_t + pi) - 2 * gamma_o;
            }
            // The longitude as scales turn it.
            Vec2f tilted(std::size_t p, const Fibre &fibre) const {
                if (p == 3) return theta;
                const auto [c, s] = fibre.tilts[p];
                return {std::abs(theta.x * c - theta.y * s), theta.y * c + theta.x * s};
            }
        };

        BsdfEval<float> value(const Arrival &arrival, Vec2f theta, float turn) const {
            Spectrum sum(0);
            float pdf = 0;
            for (std::size_t p = 0; p < 4; ++p) {
                const float m = longitudinal(arrival.tilted(p, *fibre), theta, fibre->variance[p]);
                const float n = p < 3 ? azimuthal(turn - arrival.exit(p)) : 1 / (2 * pi);
                sum += arrival.attenuation[p] * (m * n);
                pdf += arrival.probability[p] * (m * n);
            }
            return {sum, pdf};
        }

        // d'Eon et al. 2011, "An Energy-Conserving Hair Reflectance Model",
        // equation 7, with the exponents put together: exp(-s / v) I_0(c / v) / (2
        // v sinh(1 / v)), c and s of products of cosines and sines.
        static float longitudinal(Vec2f from, Vec2f to, float v) {
            const float apart = (sqr(from.x - to.x) + sqr(from.y + to.y)) / 2; // 1 + s - c
            return std::exp(-apart / v) * detail::bessel_i0_scaled(from.x * to.x / v) /
                   (v * -std::expm1(-2 / v));
        }

        // A logistic distribution on [-pi, pi].
        float azimuthal(float angle) const {
            angle -= 2 * pi * std::round(angle / (2 * pi));
            const float s = fibre->logistic, e = std::exp(-std::abs(angle) / s);
            return e / (s * sqr(1 + e) * std::tanh(pi / (2 * s)));
        }
        float sample_logistic(float u) const {
            const float s = fibre->logistic, low = 1 / (1 + std::exp(pi / s));
            const float x = low + u * (1 - 2 * low);
            return std::clamp(s * (std::log(x) - std::log1p(-x)), -pi, pi);
        }
    };

    void build() {
        check_indices(int_ior, ext_ior);
        const float m = std::max(longitudinal_roughness, 0.05f), n = std::max(azimuthal_roughness, 0.02f);
        // Fits of Chiang et al. 2016, section 4.1
        const float v = sqr(0.726f * m + 0.812f * m * m + 3.7f * std::pow(m, 20.0f));
        fibre_.eta = int_ior / ext_ior;
        fibre_.variance = {v, v / 4, 4 * v, 4 * v};
        fibre_.logistic = std::sqrt(pi / 8) * (0.265f * n + 1.194f * n * n + 5.372f * std::pow(n, 22.0f));
        const float tilt = scale_tilt * (pi / 180), factors[]{-2, 1, 4};
        for (std::size_t p = 0; p < 3; ++p)
            fibre_.tilts[p] = {std::cos(factors[p] * tilt), std::sin(factors[p] * tilt)};
    }
    Lobe prepare(const auto &read) const { return {&fibre_, max(read(sigma_a) * scale, Spectrum(0))}; }

private:
    Fibre fibre_;
};

} // namespace lajolla
