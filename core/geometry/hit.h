#pragma once
// Rays, and the points that they hit.

#include <cstdint>

#include "base/frame.h"

namespace lajolla {

template <class Float>
struct Ray {
    Vec3<Float> origin, direction; // directions have unit length, except for shadow rays
    Float near = 0, far = infinity;
};

// The result of a ray query, from which a Hit is computed.
struct RayHit {
    static constexpr std::uint32_t no_instance = ~0u;
    float distance;
    float b1, b2; // barycentrics of triangles
    std::uint32_t shape, primitive;
    std::uint32_t instance = no_instance; // the instance of the shape that was hit
};

// The same for several rays; `shape` is -1 for rays without a hit.
struct RayHits {
    WideFloat distance, b1, b2;
    WideInt shape, primitive, instance; // instance is no_instance = -1 if there is none

    RayHit operator[](int k) const {
        return {distance[k],
                b1[k],
                b2[k],
                static_cast<std::uint32_t>(shape[k]),
                static_cast<std::uint32_t>(primitive[k]),
                static_cast<std::uint32_t>(instance[k])};
    }
};

inline void set_lane(RayHits &hits, int k, const RayHit &found) {
    hits.distance.v[k] = found.distance, hits.b1.v[k] = found.b1, hits.b2.v[k] = found.b2;
    hits.shape.v[k] = static_cast<std::int32_t>(found.shape);
    hits.primitive.v[k] = static_cast<std::int32_t>(found.primitive);
    hits.instance.v[k] = static_cast<std::int32_t>(found.instance);
}

// The footprint of a pixel's beam, followed as a cone (Akenine-Möller et al. 2021, "Improved Shader and
// Texture Level of Detail Using Ray Cones").
template <class Float>
struct RayCone {
    Float radius = 0; // at the ray's origin
    Float spread = 0; // growth of the radius per unit of distance

    RayCone at(Float distance) const { return {abs(radius + spread * distance), spread}; }

    // The cone after reflection or refraction by a surface of this curvature; width and eta as in BsdfSample.
    // A diffuse surface widens the cone to about 0.2 radians.
    RayCone scattered(Float mean_curvature, Float width, Float eta) const {
        const Float turned = 2 * mean_curvature * radius;
        const Float mirror =
            select(eta == 1.0f, spread + turned, spread / eta + turned * (1 / eta - 1) * 0.5f);
        return {radius, lerp(width, mirror, Float(0.2f))};
    }
};

// Where rays that are scattered at a hit start, relative to its position, on the front and on the back: on
// the smooth surface that vertex normals describe, if that is farther out than the triangle there; else zero.
template <class Float>
struct Lift {
    bool present = false; // otherwise the rest is undefined
    Vec3<Float> front{}, back{};

    static BoolOf<Float> is_raised(const Vec3<Float> &lift) { return !(lift == Vec3<Float>(0)); }
};

// A vertex of a path on a surface.
template <class Float>
struct Hit {
    Vec3<Float> position;
    Vec3<Float> normal; // geometric, on the front side of the shape's orientation
    Vec3<Float> shading_normal;
    Vec3<Float> dp_du, dp_dv;
    Vec2<Float> barycentric, uv;
    Float distance;       // along the ray that found it
    Float position_error; // maximum distance of the true surface from `position`
    Float mean_curvature; // from shading normals; positive if convex towards the normal's side
    Lift<Float> lift;
    RayCone<Float> footprint;
    IntOf<Float> shape, primitive;
    IntOf<Float> instance;           // -1 for none
    IntOf<Float> material, emitter;  // -1 for none
    IntOf<Float> interior, exterior; // media, -1 for none

    // The radius of the footprint in texture space.
    Float uv_footprint() const {
        const Float scale = max(length_squared(dp_du), length_squared(dp_dv));
        return select(scale > 0.0f, footprint.radius / sqrt(scale), Float(0));
    }
};

// Two conjugate radii, in texture space, of the ellipse that a hit's footprint covers, seen from `wo`: the
// radius across the plane of incidence, and the longer one along it (Akenine-Möller et al. 2021, section 5).
template <class Float>
struct UvEllipse {
    Vec2<Float> across, along;
};
template <class Float>
UvEllipse<Float> uv_ellipse(const Hit<Float> &hit, const Vec3<Float> &wo) {
    const Float cosine = dot(wo, hit.normal);
    const Vec3<Float> projected = wo - hit.normal * cosine;
    const Float sine = length(projected);
    const Vec3<Float> along = select(sine > 1e-4f, projected / sine, frame_around(hit.normal).s);
    const Vec3<Float> across = cross(hit.normal, along);
    const Float uu = length_squared(hit.dp_du), uv = dot(hit.dp_du, hit.dp_dv),
                vv = length_squared(hit.dp_dv), determinant = uu * vv - uv * uv;
    const auto to_uv = [&](const Vec3<Float> &step,
                           Float radius) { // least squares: dp_du and dp_dv may leave the plane
        const Float u = dot(hit.dp_du, step), v = dot(hit.dp_dv, step);
        const Vec2<Float> result = Vec2<Float>{vv * u - uv * v, uu * v - uv * u} * (radius / determinant);
        return select(determinant > 0.0f, result, Vec2<Float>());
    };
    constexpr float longest = 1e3f; // of the stretch: no filter uses more
    const Float radius = hit.footprint.radius;
    return {to_uv(across, radius), to_uv(along, radius / max(abs(cosine), Float(1 / longest)))};
}

// The start of a ray that leaves a hit, so that it does not hit the same surface again: offset by the error
// of the position, measured in ulps of its coordinates, to the side to which the ray goes.
template <class Float>
Vec3<Float> leave(const Hit<Float> &hit, const Vec3<Float> &direction) {
    return hit.position + hit.normal * copysign(hit.position_error, dot(hit.normal, direction));
}

// The start of a ray that is scattered at a hit.
template <class Float>
struct Departure {
    BoolOf<Float> front; // the side of the hit on which it starts
    Vec3<Float> vertex;  // the point whose light is gathered
    Vec3<Float> origin;  // of the ray
};
template <class Float>
Departure<Float> depart(const Hit<Float> &hit, const Vec3<Float> &direction) {
    return {dot(hit.normal, direction) >= 0.0f, hit.position, leave(hit, direction)};
}
// The same on one side of a hit with a lift, whatever the direction.
template <class Float>
Departure<Float> depart_lifted(const Hit<Float> &hit, BoolOf<Float> front) {
    const Vec3<Float> vertex = hit.position + select(front, hit.lift.front, hit.lift.back);
    return {front, vertex, vertex + hit.normal * select(front, hit.position_error, -hit.position_error)};
}

// The largest coordinates that entered a position, in units of 32 ulps: intersection and interpolation each
// lose a few ulps of the coordinates and of the extent of the primitive.
template <class Float>
constexpr Float position_error(Float largest_coordinate) {
    return largest_coordinate * 0x1p-18f;
}

// One lane of several rays and hits.
template <class Tag>
Triple<Tag, float> lane_of(const Triple<Tag, WideFloat> &v, int k) {
    return {v.x[k], v.y[k], v.z[k]};
}
inline Ray<float> lane_of(const Ray<WideFloat> &rays, int k) {
    return {lane_of(rays.origin, k), lane_of(rays.direction, k), rays.near[k], rays.far[k]};
}
inline Lift<float> lane_of(const Lift<WideFloat> &lifts, int k) {
    if (!lifts.present) return {};
    return {true, lane_of(lifts.front, k), lane_of(lifts.back, k)};
}
inline Hit<float> lane_of(const Hit<WideFloat> &hits, int k) {
    return {lane_of(hits.position, k),
            lane_of(hits.normal, k),
            lane_of(hits.shading_normal, k),
            lane_of(hits.dp_du, k),
            lane_of(hits.dp_dv, k),
            {hits.barycentric.x[k], hits.barycentric.y[k]},
            {hits.uv.x[k], hits.uv.y[k]},
            hits.distance[k],
            hits.position_error[k],
            hits.mean_curvature[k],
            lane_of(hits.lift, k),
            {hits.footprint.radius[k], hits.footprint.spread[k]},
            hits.shape[k],
            hits.primitive[k],
            hits.instance[k],
            hits.material[k],
            hits.emitter[k],
            hits.interior[k],
            hits.exterior[k]};
}

// Writes the fields of a hit that describe its position into one lane; those of the ray query are set
// already.
inline void set_lane(Vec3<WideFloat> &v, int k, const Vec3f &value) {
    v.x.v[k] = value.x, v.y.v[k] = value.y, v.z.v[k] = value.z;
}

inline void set_lane(Hit<WideFloat> &hits, int k, const Hit<float> &hit) {
    set_lane(hits.position, k, hit.position);
    set_lane(hits.normal, k, hit.normal);
    set_lane(hits.shading_normal, k, hit.shading_normal);
    set_lane(hits.dp_du, k, hit.dp_du);
    set_lane(hits.dp_dv, k, hit.dp_dv);
    hits.barycentric.x.v[k] = hit.barycentric.x, hits.barycentric.y.v[k] = hit.barycentric.y;
    hits.uv.x.v[k] = hit.uv.x, hits.uv.y.v[k] = hit.uv.y;
    hits.position_error.v[k] = hit.position_error;
    hits.mean_curvature.v[k] = hit.mean_curvature;
    if (hits.lift.present)
        set_lane(hits.lift.front, k, hit.lift.front), set_lane(hits.lift.back, k, hit.lift.back);
}

} // namespace lajolla
