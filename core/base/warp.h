#pragma once
// Maps from uniform samples in [0,1)^2 to directions and points, each beside its density.

#include "base/vec.h"

namespace lajolla {

// Uniform on the unit disk; concentric squares keep strata together (Shirley and Chiu 1997).
inline Vec2f sample_disk(Vec2f u) {
    const float a = 2 * u.x - 1, b = 2 * u.y - 1;
    if (a == 0 && b == 0) return {0, 0};
    const bool wide = a * a > b * b;
    const float r = wide ? a : b;
    const float phi = wide ? (pi / 4) * (b / a) : (pi / 2) - (pi / 4) * (a / b);
    return {r * std::cos(phi), r * std::sin(phi)};
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
    if (u.y > u.x) {
        const float b1 = u.x / 2;
        return {b1, u.y - b1};
    }
    const float b2 = u.y / 2;
    return {u.x - b2, b2};
}

} // namespace lajolla
