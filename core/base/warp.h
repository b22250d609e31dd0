#pragma once
// Maps from uniform samples in [0,1)^2 to directions and points, each beside its density.

#include "base/vec.h"

namespace lajolla {

// Sine and cosine of |x| <= pi/4 to an ulp or two, by the polynomials of Cephes' sinf and cosf (Moshier
// 1992).
struct SineCosine {
    float sine, cosine;
};
constexpr SineCosine sine_cosine_of_octant(float x) {
    const float z = x * x;
    const float sine = x + x * z * (-1.6666654611e-1f + z * (8.3321608736e-3f - z * 1.9515295891e-4f));
    const float cosine =
        1 - 0.5f * z +
        z * z * (4.166664568298827e-2f + z * (-1.388731625493765e-3f + z * 2.443315711809948e-5f));
    return {sine, cosine};
}

// Uniform on the unit disk; concentric squares keep strata together (Shirley and Chiu 1997).
inline Vec2f sample_disk(Vec2f u) {
    const float a = 2 * u.x - 1, b = 2 * u.y - 1;
    if (a == 0 && b == 0) return {0, 0};
    const bool wide = a * a > b * b;
    const auto [sine, cosine] = sine_cosine_of_octant((pi / 4) * (wide ? b / a : a / b));
    return wide ? Vec2f{a * cosine, a * sine} : Vec2f{b * sine, b * cosine};
}

// Cosine-weighted hemisphere around +z; density cos(theta) / pi.
inline Vec3f sample_cosine_hemisphere(Vec2f u) {
    const Vec2f p = sample_disk(u);
    return {p.x, p.y, safe_sqrt(1 - p.x * p.x - p.y * p.y)};
}
constexpr float cosine_hemisphere_pdf(float cos_theta) { return std::max(cos_theta, 0.0f) * inv_pi; }

// Uniform on the unit sphere; density 1 / (4 pi).
inline Vec3f sample_sphere(Vec2f u) {
    const float z = 1 - 2 * u.x, r = safe_sqrt(1 - z * z), phi = 2 * pi * u.y;
    return {r * std::cos(phi), r * std::sin(phi), z};
}
inline constexpr float sphere_pdf = inv_pi / 4;

// Uniform in the cone of directions around +z of height 1 - cos(angle). Taking the height and not the cosine
// keeps small cones exact: 1 - cos would cancel.
inline Vec3f sample_cone(Vec2f u, float height) {
    const float h = u.x * height, r = safe_sqrt(h * (2 - h)), phi = 2 * pi * u.y;
    return {r * std::cos(phi), r * std::sin(phi), 1 - h};
}
inline float cone_pdf(float height) { return 1 / (2 * pi * height); }

// Uniform barycentrics (b1, b2) of a triangle; the fold keeps strata together (Heitz 2019, "A Low-Distortion
// Map Between Triangle and Square").
constexpr Vec2f sample_triangle(Vec2f u) {
    const float half = std::min(u.x, u.y) / 2;
    return {u.x - half, u.y - half};
}

} // namespace lajolla
