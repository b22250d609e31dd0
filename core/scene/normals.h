#pragma once
// Shading normals: how maps turn them, and how they are kept from making surfaces black.

#include <cmath>

#include "base/frame.h"

namespace lajolla {

// A normal on the way through the maps of a material.
struct MappedNormal {
    Vec3f n;               // unit
    Vec3f tangent;         // along which u grows; any length, not in n's plane exactly
    bool mirrored = false; // seen from behind: n is turned over, and u, v and n are left-handed
    bool turned_by_maps = false, shadowed = false;
};

// The normal of the surface that a displacement along n makes of this one, from its derivatives by u and v.
// The derivative of n itself is left out (Blinn 1978, "Simulation of Wrinkled Surfaces", equation 3).
inline Vec3f bumped(Vec3f n, Vec3f dp_du, Vec3f dp_dv, float by_u, float by_v) {
    const Vec3f u = dp_du + n * (by_u - dot(n, dp_du)), v = dp_dv + n * (by_v - dot(n, dp_dv));
    const Vec3f sum = cross(u, v);
    const float squared = length_squared(sum);
    if (!(squared > 0) || !std::isfinite(squared)) return n;
    return sum * std::copysign(1 / std::sqrt(squared), dot(sum, n));
}

// A normal that faces away from a viewer on the side of `around` is turned by half a turn around that
// (Schüssler et al. 2017, "Microfacet-based Normal Mapping for Robust Monte Carlo Path Tracing", section 3).
inline Vec3f facing(Vec3f n, Vec3f around, Vec3f wo) {
    return dot(around, wo) * dot(n, wo) <= 0 ? reflect(n, around) : n;
}

// The normal nearest to n in the plane of n and the true normal `ng` around which the mirror image of the
// viewer is above the surface: above the lesser of 0.025 and 0.9 dot(ng, wo), the bounds that Cycles takes.
// Needs dot(ng, wo) > 0. With wo = (x, z) in that plane, z along ng, a normal (sin a, cos a) has a mirror
// image of height x sin 2a + z cos 2a = r cos(2a - b), where r and b are the length and the angle of (x, z).
inline Vec3f with_mirror_image_above(Vec3f n, Vec3f ng, Vec3f wo) {
    const float z = dot(ng, wo);
    const float height = std::min(0.025f, 0.9f * z);
    if (dot(n, wo) > 0 && 2 * dot(n, wo) * dot(n, ng) - z >= height) return n;
    const Vec3f along = n - ng * dot(n, ng);
    const float squared = length_squared(along);
    if (!(squared > 0)) return ng;
    const Vec3f axis = along * (1 / std::sqrt(squared));
    const float x = dot(axis, wo), r = std::hypot(x, z);
    const float angle = (std::atan2(x, z) + std::acos(height / r)) / 2;
    return normalize(axis * std::sin(angle) + ng * std::cos(angle));
}

// A normal near n that neither points into the surface nor is seen from behind: enough for Lambertian lobes,
// which then lose no more than the half below the surface.
inline Vec3f seen_from_above(Vec3f n, Vec3f ng, Vec3f wo) {
    constexpr float lowest = 1e-4f;
    const float height = dot(n, ng);
    if (height < 0) n = normalize(n - ng * (height - lowest));
    const float z = dot(n, wo);
    return z >= lowest ? n : normalize(n + wo * (lowest - z));
}

// Normals on the viewer's side.
struct SeenNormals {
    bool behind; // the viewer is behind the surface
    Vec3f geometric, shading;
};
inline SeenNormals seen_from(Vec3f wo, Vec3f geometric, const MappedNormal &normal) {
    const bool behind = dot(geometric, wo) < 0;
    return {behind, behind ? -geometric : geometric, behind && !normal.mirrored ? -normal.n : normal.n};
}

constexpr float tangent_squared(float cosine) {
    return std::max(1 - sqr(cosine), 0.0f) / std::max(sqr(cosine), 1e-12f);
}

// What is left of light from a direction with a tangent^2 of `light` where bumps turned the normal by an
// angle with a tangent^2 of `bump`: Smith's shadowing of a GGX surface as rough as the bump is steep (Estevez
// et al. 2019, "A Microfacet-Based Shadowing Function to Solve the Bump Terminator Problem", equations 1, 2).
inline float bump_shadowing(float bump, float light) {
    return 2 / (1 + std::sqrt(1 + std::min(0.125f * bump, 1.0f) * light));
}

} // namespace lajolla
