#pragma once
// Maps from uniform samples in [0,1)^2 to directions and points, each beside its density.

#include "base/vec.h"

namespace lajolla {

// Uniform on the unit disk; concentric squares keep strata together (Shirley and Chiu 1997).
template <class Float>
Vec2<Float> sample_disk(Vec2<Float> u) {
    const Float a = 2 * u.x - 1, b = 2 * u.y - 1;
    const auto wide = a * a > b * b;
    const Float radius = select(wide, a, b), other = select(wide, b, a);
    const Float ratio = select(radius == 0.0f, Float(0), other / radius); // 0 / 0 in the centre
    const auto [sine, cosine] = sine_cosine_of_octant((pi / 4) * ratio);
    const Float along = radius * cosine, across = radius * sine;
    return {select(wide, along, across), select(wide, across, along)};
}

// Cosine-weighted hemisphere around +z; density cos(theta) / pi.
template <class Float>
Vec3<Float> sample_cosine_hemisphere(Vec2<Float> u) {
    const Vec2<Float> p = sample_disk(u);
    return {p.x, p.y, safe_sqrt(1 - p.x * p.x - p.y * p.y)};
}
template <class Float>
constexpr Float cosine_hemisphere_pdf(Float cos_theta) {
    return max(cos_theta, Float(0)) * inv_pi;
}

// Uniform on the unit sphere; density 1 / (4 pi).
template <class Float>
Vec3<Float> sample_sphere(Vec2<Float> u) {
    const Float z = 1 - 2 * u.x, r = safe_sqrt(1 - z * z);
    const auto [sine, cosine] = sine_cosine(2 * pi * u.y);
    return {r * cosine, r * sine, z};
}
inline constexpr float sphere_pdf = inv_pi / 4;

// Uniform in the cone of directions around +z of height 1 - cos(angle). Taking the height and not the cosine
// keeps small cones exact: 1 - cos would cancel.
template <class Float>
Vec3<Float> sample_cone(Vec2<Float> u, Float height) {
    const Float h = u.x * height, r = safe_sqrt(h * (2 - h));
    const auto [sine, cosine] = sine_cosine(2 * pi * u.y);
    return {r * cosine, r * sine, 1 - h};
}
template <class Float>
Float cone_pdf(Float height) {
    return 1 / (2 * pi * height);
}

// Uniform barycentrics (b1, b2) of a triangle; the bend keeps strata together (Heitz 2019, "A Low-Distortion
// Map Between Triangle and Square").
template <class Float>
constexpr Vec2<Float> sample_triangle(Vec2<Float> u) {
    const Float half = min(u.x, u.y) / 2;
    return {u.x - half, u.y - half};
}

} // namespace lajolla
