#pragma once
// Shading normals: changes by maps, and corrections that prevent black surfaces.

#include "base/frame.h"

namespace lajolla {

// A normal during traversal of the maps of a material.
template <class Float>
struct MappedNormal {
    Vec3<Float> n;                  // unit
    Vec3<Float> tangent;            // along which u grows; any length, not in n's plane exactly
    BoolOf<Float> mirrored = false; // seen from behind: n is flipped, and u, v and n are left-handed
    bool shadowed = false;          // by bumps
    bool softened = false;          // the terminator of vertex normals: see terminator_shadowing
};

// The normal of a surface that is displaced along n, from the displacement's derivatives by u and v. Neglects
// the derivative of n itself (Blinn 1978, "Simulation of Wrinkled Surfaces", equation 3).
template <class Float>
Vec3<Float> bumped(const Vec3<Float> &n, const Vec3<Float> &dp_du, const Vec3<Float> &dp_dv, Float by_u,
                   Float by_v) {
    const Vec3<Float> u = dp_du + n * (by_u - dot(n, dp_du)), v = dp_dv + n * (by_v - dot(n, dp_dv));
    const Vec3<Float> sum = cross(u, v);
    const Float squared = length_squared(sum);
    return select(squared > 0.0f && isfinite(squared), sum * copysign(1 / sqrt(squared), dot(sum, n)), n);
}

// Rotates a normal that faces away from a viewer on the side of `around` by 180 degrees around that axis
// (Schüssler et al. 2017, "Microfacet-based Normal Mapping for Robust Monte Carlo Path Tracing", section 3).
template <class Float>
Vec3<Float> facing(const Vec3<Float> &n, const Vec3<Float> &around, const Vec3<Float> &wo) {
    return select(dot(around, wo) * dot(n, wo) <= 0.0f, reflect(n, around), n);
}

// The normal nearest to n in the plane of n and the true normal `ng` around which the mirror image of the
// viewer is above the surface by at least min(0.025, 0.9 dot(ng, wo)), the bounds used by Cycles.
// Needs dot(ng, wo) > 0. With wo = (x, z) in that plane, z along ng, a normal (sin a, cos a) has a mirror
// image of height x sin 2a + z cos 2a = r cos(2a - b), where r and b are the length and the angle of (x, z).
template <class Float>
Vec3<Float> with_mirror_image_above(const Vec3<Float> &n, const Vec3<Float> &ng, const Vec3<Float> &wo) {
    const Float z = dot(ng, wo), n_ng = dot(n, ng), n_wo = dot(n, wo);
    const Float height = min(Float(0.025f), 0.9f * z);
    const auto is_above = n_wo > 0.0f && 2 * n_wo * n_ng - z >= height;
    if (all(is_above)) return n;
    const Vec3<Float> along = n - ng * n_ng;
    const Float squared = length_squared(along);
    const Vec3<Float> axis = along * (1 / sqrt(squared));
    const Float x = dot(axis, wo), r = hypot(x, z);
    const Float angle = (atan2(x, z) + acos(height / r)) * 0.5f;
    const auto [sine, cosine] = sine_cosine(angle);
    const Vec3<Float> lifted = normalize(axis * sine + ng * cosine);
    return select(is_above, n, select(squared > 0.0f, lifted, ng));
}

// A normal near n that does not point into the surface and faces the viewer: sufficient for Lambertian lobes,
// which then lose at most the half below the surface.
template <class Float>
Vec3<Float> seen_from_above(const Vec3<Float> &n, const Vec3<Float> &ng, const Vec3<Float> &wo) {
    constexpr float lowest = 1e-4f;
    const Float height = dot(n, ng);
    const Vec3<Float> outwards = select(height < 0.0f, normalize(n - ng * (height - lowest)), n);
    const Float z = dot(outwards, wo);
    return select(z >= lowest, outwards, normalize(outwards + wo * (lowest - z)));
}

// Normals on the viewer's side.
template <class Float>
struct SeenNormals {
    BoolOf<Float> behind; // the viewer is behind the surface
    Vec3<Float> geometric, shading;
};
template <class Float>
SeenNormals<Float> seen_from(const Vec3<Float> &wo, const Vec3<Float> &geometric,
                             const MappedNormal<Float> &normal) {
    const auto behind = dot(geometric, wo) < 0.0f;
    return {behind, select(behind, -geometric, geometric),
            select(behind && !normal.mirrored, -normal.n, normal.n)};
}

template <class Float>
constexpr Float tangent_squared(Float cosine) {
    return max(1 - sqr(cosine), Float(0)) / max(sqr(cosine), Float(1e-12f));
}

// The fraction of light that is not shadowed by bumps, for a direction with tan^2 = `light` and a normal that
// is rotated by an angle with tan^2 = `bump`: Smith's shadowing of a GGX surface with alpha^2 = min(bump / 8,
// 1) (Estevez et al. 2019, "A Microfacet-Based Shadowing Function to Solve the Bump Terminator Problem",
// equations 1, 2).
template <class Float>
Float bump_shadowing(Float bump, Float light) {
    return 2 / (1 + sqrt(1 + min(0.125f * bump, Float(1)) * light));
}

// The fraction of light from `wi` that a triangle does not shadow if that is to begin smoothly, for the
// normal `ng` of the triangle and the interpolated one `n` (Chiang et al. 2019, "Taming the Shadow
// Terminator").
template <class Float>
Float terminator_shadowing(const Vec3<Float> &ng, const Vec3<Float> &n, const Vec3<Float> &wi) {
    const Float g = dot(ng, wi) / (dot(n, wi) * dot(ng, n));
    return select(g > 0.0f && g < 1.0f, g * (1 + g * (1 - g)), Float(1));
}

} // namespace lajolla
