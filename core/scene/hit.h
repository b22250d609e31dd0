#pragma once
// Rays, and what is known of the point that a ray hits.

#include <cstdint>

#include "base/frame.h"

namespace lajolla {

struct Ray {
    Vec3f origin, direction; // directions are of unit length but for shadow segments
    float near = 0, far = infinity;
};

// What the ray tracer finds: enough to compute everything else.
struct RayHit {
    static constexpr std::uint32_t no_instance = ~0u;
    float distance;
    float b1, b2; // barycentrics of triangles
    std::uint32_t shape, primitive;
    std::uint32_t instance = no_instance; // through which the shape is seen
};

// The footprint of a pixel's beam, followed as a cone (Akenine-Möller et al. 2021, "Improved Shader and
// Texture Level of Detail Using Ray Cones").
struct RayCone {
    float radius = 0; // at the ray's origin
    float spread = 0; // growth of the radius per unit of distance

    RayCone at(float distance) const { return {std::abs(radius + spread * distance), spread}; }

    // After a bounce off, or through, a surface of this curvature and roughness; eta as in BsdfSample. A
    // rough surface opens the cone to about a fifth of a radian.
    RayCone scattered(float mean_curvature, float roughness, float eta) const {
        const bool reflected = eta == 1;
        const float bent = 2 * mean_curvature * radius;
        const float mirror = reflected ? spread + bent : spread / eta + bent * (1 / eta - 1) / 2;
        return {radius, lerp(roughness, mirror, 0.2f)};
    }
};

// A vertex of a path on a surface.
struct Hit {
    Vec3f position;
    Vec3f normal; // geometric, on the side that the shape's orientation calls front
    Vec3f shading_normal;
    Vec3f dp_du, dp_dv;
    Vec2f barycentric, uv;
    float distance;       // along the ray that found it
    float position_error; // how far the true surface may be from `position`
    float
        mean_curvature; // of the shading normals' surface; positive where it bulges towards the normal's side
    RayCone footprint;
    std::uint32_t shape, primitive;
    std::int32_t material, emitter;  // -1 for none
    std::int32_t interior, exterior; // media, -1 for none

    // The radius of the footprint in texture space.
    float uv_footprint() const {
        const float scale = std::max(length_squared(dp_du), length_squared(dp_dv));
        return scale > 0 ? footprint.radius / std::sqrt(scale) : 0;
    }
};

// Two conjugate radii of the ellipse in texture space that a hit's footprint covers, seen from `wo`: the
// cone's section, and the same stretched along the plane of incidence (Akenine-Möller et al. 2021, section
// 5).
struct UvEllipse {
    Vec2f across, along;
};
inline UvEllipse uv_ellipse(const Hit &hit, const Vec3f &wo) {
    const float cosine = dot(wo, hit.normal);
    const Vec3f projected = wo - hit.normal * cosine;
    const float sine = length(projected);
    const Vec3f along = sine > 1e-4f ? projected / sine : frame_around(hit.normal).s;
    const Vec3f across = cross(hit.normal, along);
    const float uu = length_squared(hit.dp_du), uv = dot(hit.dp_du, hit.dp_dv),
                vv = length_squared(hit.dp_dv), determinant = uu * vv - uv * uv;
    if (!(determinant > 0)) return {};
    const auto to_uv = [&](Vec3f step, float radius) { // least squares: dp_du and dp_dv may leave the plane
        const float u = dot(hit.dp_du, step), v = dot(hit.dp_dv, step);
        return Vec2f{vv * u - uv * v, uu * v - uv * u} * (radius / determinant);
    };
    constexpr float longest = 1e3f; // of the stretch: no filter follows it beyond
    const float radius = hit.footprint.radius;
    return {to_uv(across, radius), to_uv(along, radius / std::max(std::abs(cosine), 1 / longest))};
}

// Where a ray that leaves a hit must start so that it does not find the same surface again: beyond the error
// of the position, measured in ulps of its coordinates, on the side to which the ray goes.
inline Vec3f leave(const Hit &hit, Vec3f direction) {
    return hit.position + hit.normal * std::copysign(hit.position_error, dot(hit.normal, direction));
}

// The largest coordinates that entered a position, in units of 32 ulps: intersection and interpolation each
// lose a few ulps of the coordinates and of the extent of the primitive.
inline float position_error(float largest_coordinate) { return largest_coordinate * 0x1p-18f; }

} // namespace lajolla
