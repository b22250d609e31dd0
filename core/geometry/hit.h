#pragma once
// Rays, and the points that they hit.

#include <cstdint>

#include "base/frame.h"
#include "geometry/edges.h"
#include "geometry/footprint.h"

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

// The derivatives of a shading normal by u and v.
template <class Float>
struct NormalChange {
    Vec3<Float> du, dv;
};

// Where rays that are scattered at a hit start, relative to its position, on the front and on the back: on
// the smooth surface that vertex normals describe, if that is farther out than the triangle there; else zero.
template <class Float>
struct Lift {
    Vec3<Float> front, back;

    static BoolOf<Float> is_raised(const Vec3<Float> &lift) { return !(lift == Vec3<Float>(0)); }
    BoolOf<Float> is_raised() const { return is_raised(front) || is_raised(back); }
};

// A vertex of a path on a surface.
template <class Float>
struct Hit {
    Vec3<Float> position;
    Vec3<Float> normal; // geometric, on the front side of the shape's orientation
    Vec3<Float> shading_normal;
    Vec3<Float> dp_du, dp_dv;
    Vec2<Float> barycentric, uv;
    Float distance;                  // along the ray that found it
    Float position_error;            // maximum distance of the true surface from `position`
    std::optional<Lift<Float>> lift; // none where it is zero; of lanes, where it is zero in all of them
    Footprint<Float> footprint;
    std::optional<NormalChange<Float>> dn; // none on flat surfaces, or where it is not needed
    IntOf<Float> shape, primitive;
    IntOf<Float> instance;           // -1 for none
    IntOf<Float> material, emitter;  // -1 for none
    IntOf<Float> interior, exterior; // media, -1 for none

    // The coordinates of a step along the surface in texture space.
    DualBasis<Float> to_uv() const { return {dp_du, dp_dv}; }
    // From shading normals; positive if convex towards the normal's side.
    Float mean_curvature() const {
        if (!dn) return 0;
        const DualBasis<Float> uv = to_uv();
        return (dot(dn->du, uv.u) + dot(dn->dv, uv.v)) * 0.5f;
    }
    Float gaussian_curvature() const {
        if (!dn) return 0;
        const DualBasis<Float> uv = to_uv();
        return dot(dn->du, uv.u) * dot(dn->dv, uv.v) - dot(dn->du, uv.v) * dot(dn->dv, uv.u);
    }
    // The radius of the footprint: of the cone, or half of the longer of two differentials.
    Float radius() const {
        const auto &d = footprint.differentials;
        if (!d) return footprint.cone.radius;
        const Float longer = max(length_squared(d->origin_dx), length_squared(d->origin_dy));
        return select(d->followed, sqrt(longer) * 0.5f, footprint.cone.radius);
    }
    // The radius of the cone in texture space.
    Float uv_radius() const {
        const Float scale = max(length_squared(dp_du), length_squared(dp_dv));
        return select(scale > 0.0f, footprint.cone.radius / sqrt(scale), Float(0));
    }
};

// Two conjugate radii, in texture space, of the ellipse that a hit's footprint covers.
template <class Float>
struct UvEllipse {
    Vec2<Float> first, second;
};

// Of differentials: half of the way to the next pixel, along x and along y.
template <class Float>
UvEllipse<Float> uv_ellipse(const Hit<Float> &hit, const RayDifferentials<Float> &at_hit) {
    const DualBasis<Float> uv = hit.to_uv();
    return {uv(at_hit.origin_dx) * Float(0.5f), uv(at_hit.origin_dy) * Float(0.5f)};
}

// Of the cone, seen from `wo`: the radius across the plane of incidence, and the longer one along it
// (Akenine-Möller et al. 2021, section 5).
template <class Float>
UvEllipse<Float> uv_ellipse(const Hit<Float> &hit, const Vec3<Float> &wo) {
    const Float cosine = dot(wo, hit.normal);
    const Vec3<Float> projected = wo - hit.normal * cosine;
    const Float sine = length(projected);
    const Vec3<Float> along = select(sine > 1e-4f, projected / sine, frame_around(hit.normal).s);
    const Vec3<Float> across = cross(hit.normal, along);
    const DualBasis<Float> uv = hit.to_uv();
    const Float radius = hit.footprint.cone.radius;
    return {uv(across) * radius, uv(along) * (radius / abs(bounded_cosine(cosine)))};
}

// The differentials of the ray that leaves a hit in the direction wi, after reflection or refraction of one
// that arrives along `direction`; width and eta as in BsdfSample. A slightly rough surface widens them in all
// directions, by as much as a cone. What becomes infinite is not followed.
template <class Float>
RayDifferentials<Float> scattered(const Hit<Float> &hit, const RayDifferentials<Float> &at_hit,
                                  const Vec3<Float> &direction, const Vec3<Float> &wi, Float width,
                                  Float eta) {
    // The microfacet's normal n, for which wi = direction / eta - n (dot(direction, n) / eta - dot(wi, n)) in
    // reflection and in refraction; it turns with the shading normal.
    const Vec3<Float> difference = direction - wi * eta;
    const Float squared = length_squared(difference);
    const Vec3<Float> unoriented = select(squared > 0.0f, difference / sqrt(squared), hit.shading_normal);
    const Vec3<Float> n = select(dot(unoriented, hit.shading_normal) < 0.0f, -unoriented, unoriented);
    const Float cosine = dot(direction, n), onward = dot(wi, n), slower = 1 / eta;
    const Float bend = slower * cosine - onward,
                bend_change = slower - sqr(slower) * cosine / bounded_cosine(onward);
    const auto straight = eta == 1.0f && dot(direction, hit.normal) * dot(wi, hit.normal) > 0.0f;
    const DualBasis<Float> uv = hit.to_uv();
    const auto turned = [&](const Vec3<Float> &step, const Vec3<Float> &change) {
        Vec3<Float> n_change;
        if (hit.dn) {
            const Vec2<Float> by = uv(step);
            n_change = hit.dn->du * by.x + hit.dn->dv * by.y;
        }
        const Float cosine_change = dot(change, n) + dot(direction, n_change);
        const Vec3<Float> bent = change * slower - (n_change * bend + n * (bend_change * cosine_change));
        return select(straight, change, bent);
    };
    RayDifferentials<Float> result{at_hit.origin_dx, at_hit.origin_dy,
                                   turned(at_hit.origin_dx, at_hit.direction_dx),
                                   turned(at_hit.origin_dy, at_hit.direction_dy), at_hit.followed};
    if (any(width > 0.0f)) {
        // Two perpendicular changes, which lead away from the ray where those of the position do.
        const Vec3<Float> across = at_hit.origin_dx - wi * dot(wi, at_hit.origin_dx);
        const Float reach = length(across);
        const Vec3<Float> x = select(reach > 0.0f, across / reach, frame_around(wi).s), y = cross(wi, x);
        const Float side = copysign(Float(RayCone<Float>::diffuse_spread), dot(y, at_hit.origin_dy));
        result.direction_dx = lerp(width, result.direction_dx, x * Float(2 * RayCone<Float>::diffuse_spread));
        result.direction_dy = lerp(width, result.direction_dy, y * (2 * side));
    }
    const Float size = length_squared(result.direction_dx) + length_squared(result.direction_dy) +
                       length_squared(result.origin_dx) + length_squared(result.origin_dy);
    result.followed = result.followed && size < infinity;
    return result;
}

// The footprint of the ray that leaves a hit; arguments as above. Differentials end at a rough surface.
template <class Float>
Footprint<Float> scattered_footprint(const Hit<Float> &hit, const Vec3<Float> &direction,
                                     const Vec3<Float> &wi, Float width, Float eta) {
    Footprint<Float> result{hit.footprint.cone.scattered(hit.mean_curvature(), width, eta), std::nullopt};
    constexpr float roughest = RayCone<Float>::blurred_spread / RayCone<Float>::diffuse_spread;
    const auto &at_hit = hit.footprint.differentials;
    if (!at_hit || !any(at_hit->followed && width < roughest)) return result;
    result.differentials = scattered(hit, *at_hit, direction, wi, width, eta);
    result.differentials->followed = result.differentials->followed && width < roughest;
    return result;
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
Vec3<Float> off_surface(const Hit<Float> &hit, BoolOf<Float> front) {
    return hit.normal * select(front, hit.position_error, -hit.position_error);
}
template <class Float>
Departure<Float> depart(const Hit<Float> &hit, const Vec3<Float> &direction) {
    const auto front = dot(hit.normal, direction) >= 0.0f;
    return {front, hit.position, hit.position + off_surface(hit, front)};
}
// The same on one side of a hit with a lift, whatever the direction.
template <class Float>
Departure<Float> depart_lifted(const Hit<Float> &hit, BoolOf<Float> front) {
    const Vec3<Float> vertex = hit.position + select(front, hit.lift->front, hit.lift->back);
    return {front, vertex, vertex + off_surface(hit, front)};
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
inline Footprint<float> lane_of(const Footprint<WideFloat> &footprints, int k) {
    Footprint<float> result{{footprints.cone.radius[k], footprints.cone.spread[k]}, std::nullopt};
    if (footprints.differentials) {
        const auto &d = *footprints.differentials;
        result.differentials = RayDifferentials<float>{lane_of(d.origin_dx, k), lane_of(d.origin_dy, k),
                                                       lane_of(d.direction_dx, k), lane_of(d.direction_dy, k),
                                                       (bits(d.followed) >> k & 1) != 0};
    }
    return result;
}
inline std::optional<Lift<float>> lane_of(const std::optional<Lift<WideFloat>> &lifts, int k) {
    if (!lifts) return std::nullopt;
    return Lift<float>{lane_of(lifts->front, k), lane_of(lifts->back, k)};
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
            lane_of(hits.lift, k),
            lane_of(hits.footprint, k),
            hits.dn ? std::optional(NormalChange<float>{lane_of(hits.dn->du, k), lane_of(hits.dn->dv, k)})
                    : std::nullopt,
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
    if (hits.dn) {
        const NormalChange<float> flat{};
        set_lane(hits.dn->du, k, hit.dn.value_or(flat).du);
        set_lane(hits.dn->dv, k, hit.dn.value_or(flat).dv);
    }
    hits.barycentric.x.v[k] = hit.barycentric.x, hits.barycentric.y.v[k] = hit.barycentric.y;
    hits.uv.x.v[k] = hit.uv.x, hits.uv.y.v[k] = hit.uv.y;
    hits.position_error.v[k] = hit.position_error;
    if (hit.lift && !hits.lift) hits.lift.emplace();
    if (hits.lift) {
        const Lift<float> lift = hit.lift.value_or(Lift<float>{});
        set_lane(hits.lift->front, k, lift.front), set_lane(hits.lift->back, k, lift.back);
    }
}

} // namespace lajolla
