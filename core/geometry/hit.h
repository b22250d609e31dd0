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

// The derivatives of uv along dp_du and dp_dv, where these are the edges of a triangle whose texture
// coordinates lie on a line or in one point.
template <class Float>
struct UvChange {
    Vec2<Float> first{1, 0}, second{0, 1};
};

// Where rays that are scattered at a hit start, relative to its position, on the front and on the back: on
// the smooth surface that vertex normals describe, if that is farther out than the triangle there; else zero.
template <class Float>
struct Lift {
    Vec3<Float> front, back;

    static BoolOf<Float> is_raised(const Vec3<Float> &lift) { return !(lift == Vec3<Float>(0)); }
    BoolOf<Float> is_raised() const { return is_raised(front) || is_raised(back); }
};

// The optional properties of hits that a render needs; others are not computed.
struct HitNeeds {
    bool uvs = true;       // uv
    bool tangents = true;  // dp_du, dp_dv, duv
    bool curvature = true; // dn; not without tangents
    bool lift = false;     // of vertex normals
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
    std::optional<UvChange<Float>> duv;    // none if dp_du and dp_dv are the derivatives by u and v
    IntOf<Float> shape, primitive;
    IntOf<Float> instance;           // -1 for none
    IntOf<Float> material, emitter;  // -1 for none
    IntOf<Float> interior, exterior; // media, -1 for none

    // The coordinates of a step along the surface in terms of dp_du and dp_dv.
    DualBasis<Float> to_tangents() const { return {dp_du, dp_dv}; }
    // The same in texture space.
    DualBasis<Float> to_uv() const {
        DualBasis<Float> result = to_tangents();
        if (duv) {
            const Vec3<Float> first = result.u, second = result.v;
            result.u = first * duv->first.x + second * duv->second.x;
            result.v = first * duv->first.y + second * duv->second.y;
        }
        return result;
    }
    // From shading normals; positive if convex towards the normal's side.
    Float mean_curvature() const {
        if (!dn) return 0;
        const DualBasis<Float> uv = to_tangents();
        return (dot(dn->du, uv.u) + dot(dn->dv, uv.v)) * 0.5f;
    }
    Float gaussian_curvature() const {
        if (!dn) return 0;
        const DualBasis<Float> uv = to_tangents();
        return dot(dn->du, uv.u) * dot(dn->dv, uv.v) - dot(dn->du, uv.v) * dot(dn->dv, uv.u);
    }
    // The radius of the footprint: of the cone, or of a circle as large as what differentials span.
    Float radius() const {
        const auto &d = footprint.differentials;
        if (!d) return footprint.cone.radius;
        const Float round = round_radius(d->origin_dx, d->origin_dy) * 0.5f;
        return select(d->followed, round, footprint.cone.radius);
    }
    // The radius of the cone in texture space.
    Float uv_radius() const {
        const Float scale = max(length_squared(dp_du), length_squared(dp_dv));
        const Float radius = select(scale > 0.0f, footprint.cone.radius / sqrt(scale), Float(0));
        if (!duv) return radius;
        const DualBasis<Float> uv = to_uv();
        const Float along_line = footprint.cone.radius * sqrt(length_squared(uv.u) + length_squared(uv.v));
        return select(spans_plane(duv->first, duv->second), radius, along_line);
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

// Widens the differentials of a ray along `wi` by a round lobe, `spread` per unit of distance.
//
// In coordinates across the ray, they span the matrix P + t D at the distance t. Added is spread t R, where R
// is the rotation (or reflection) nearest to D, turned by 90 degrees: perpendicular to D, and to P too if the
// two differ by a scale, so that squares add up as those of the widths of convolved lobes do, even where rays
// converge. Otherwise R has the sign with which the sum of the squares does not become smaller either.
template <class Float>
void widen(RayDifferentials<Float> &rays, const Vec3<Float> &wi, Float spread) {
    const auto across = [&](const Vec3<Float> &v) { return v - wi * dot(wi, v); };
    const Vec3<Float> p_dx = across(rays.origin_dx), p_dy = across(rays.origin_dy);
    const auto turns = length_squared(rays.direction_dx) + length_squared(rays.direction_dy) > 0.0f;
    const Vec3<Float> dx = select(turns, across(rays.direction_dx), p_dx),
                      dy = select(turns, across(rays.direction_dy), p_dy);
    const Float side = copysign(Float(1), dot(wi, cross(dx, dy)));
    const Vec3<Float> nearest = dx - cross(wi, dy) * side; // its first column, by polar decomposition
    const Float squared = length_squared(nearest);
    const Vec3<Float> x = select(squared > 0.0f, nearest * (1 / sqrt(squared)), frame_around(wi).s),
                      y = cross(wi, x);
    const Float grows = dot(p_dx, y) - dot(p_dy, x) * side;
    const Float amount = copysign(spread, grows);
    const auto widens = spread > 0.0f;
    rays.direction_dx = select(widens, rays.direction_dx + y * amount, rays.direction_dx);
    rays.direction_dy = select(widens, rays.direction_dy - x * (amount * side), rays.direction_dy);
}

// The differentials of the ray that leaves a hit in the direction wi, after reflection or refraction of one
// that arrives along `direction`; width and eta as in BsdfSample. A slightly rough surface widens them. What
// becomes infinite is not followed.
template <class Float>
RayDifferentials<Float> scattered(const Hit<Float> &hit, const RayDifferentials<Float> &at_hit,
                                  const Vec3<Float> &direction, const Vec3<Float> &wi, Float width,
                                  Float eta) {
    // The microfacet's normal n, for which wi = direction / eta - n (dot(direction, n) / eta - dot(wi, n)) in
    // reflection and in refraction; it turns with the shading normal, as a part of the same rigid frame.
    const Vec3<Float> difference = direction - wi * eta;
    const Float squared = length_squared(difference);
    const Vec3<Float> unoriented = select(squared > 0.0f, difference / sqrt(squared), hit.shading_normal);
    const Vec3<Float> n = select(dot(unoriented, hit.shading_normal) < 0.0f, -unoriented, unoriented);
    const Float cosine = dot(direction, n), onward = dot(wi, n), slower = 1 / eta;
    const Float bend = slower * cosine - onward,
                bend_change = slower - sqr(slower) * cosine / bounded_cosine(onward);
    const auto straight = eta == 1.0f && dot(direction, hit.normal) * dot(wi, hit.normal) > 0.0f;
    const DualBasis<Float> tangents = hit.to_tangents();
    const auto turned = [&](const Vec3<Float> &step, const Vec3<Float> &change) {
        Vec3<Float> n_change;
        if (hit.dn) {
            const Vec2<Float> by = tangents(step);
            const Vec3<Float> unmapped_change = hit.dn->du * by.x + hit.dn->dv * by.y;
            n_change =
                unmapped_change * dot(hit.shading_normal, n) - hit.shading_normal * dot(unmapped_change, n);
        }
        const Float cosine_change = dot(change, n) + dot(direction, n_change);
        const Vec3<Float> bent = change * slower - (n_change * bend + n * (bend_change * cosine_change));
        return select(straight, change, bent);
    };
    RayDifferentials<Float> result{at_hit.origin_dx, at_hit.origin_dy,
                                   turned(at_hit.origin_dx, at_hit.direction_dx),
                                   turned(at_hit.origin_dy, at_hit.direction_dy), at_hit.followed};
    if (any(width > 0.0f)) widen(result, wi, width * (2 * RayCone<Float>::diffuse_spread));
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
            hits.duv ? std::optional(UvChange<float>{{hits.duv->first.x[k], hits.duv->first.y[k]},
                                                     {hits.duv->second.x[k], hits.duv->second.y[k]}})
                     : std::nullopt,
            hits.shape[k],
            hits.primitive[k],
            hits.instance[k],
            hits.material[k],
            hits.emitter[k],
            hits.interior[k],
            hits.exterior[k]};
}

inline void set_lane(Vec3<WideFloat> &v, int k, const Vec3f &value) {
    v.x.v[k] = value.x, v.y.v[k] = value.y, v.z.v[k] = value.z;
}

// Writes the fields of a hit that describe its position into one lane, the derivatives if they are needed;
// those of the ray query are set already.
inline void set_lane(Hit<WideFloat> &hits, int k, const Hit<float> &hit, const HitNeeds &needs) {
    set_lane(hits.position, k, hit.position);
    set_lane(hits.normal, k, hit.normal);
    set_lane(hits.shading_normal, k, hit.shading_normal);
    hits.barycentric.x.v[k] = hit.barycentric.x, hits.barycentric.y.v[k] = hit.barycentric.y;
    hits.uv.x.v[k] = hit.uv.x, hits.uv.y.v[k] = hit.uv.y;
    hits.position_error.v[k] = hit.position_error;
    if (needs.tangents) {
        set_lane(hits.dp_du, k, hit.dp_du);
        set_lane(hits.dp_dv, k, hit.dp_dv);
        if (hit.duv && !hits.duv) hits.duv.emplace();
        if (hits.duv) {
            const auto [first, second] = hit.duv.value_or(UvChange<float>{});
            hits.duv->first.x.v[k] = first.x, hits.duv->first.y.v[k] = first.y;
            hits.duv->second.x.v[k] = second.x, hits.duv->second.y.v[k] = second.y;
        }
    }
    if (needs.curvature) {
        if (!hits.dn) hits.dn.emplace();
        const NormalChange<float> flat{};
        set_lane(hits.dn->du, k, hit.dn.value_or(flat).du);
        set_lane(hits.dn->dv, k, hit.dn.value_or(flat).dv);
    }
    if (hit.lift && !hits.lift) hits.lift.emplace();
    if (hits.lift) {
        const Lift<float> lift = hit.lift.value_or(Lift<float>{});
        set_lane(hits.lift->front, k, lift.front), set_lane(hits.lift->back, k, lift.back);
    }
}

} // namespace lajolla
