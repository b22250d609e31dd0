#pragma once
// Properties of points on triangles.

#include "geometry/edges.h"
#include "geometry/hit.h"

namespace lajolla {

template <class Float>
struct TriangleCorners {
    Vec3<Float> a, b, c;
};

// The vertex normals and texture coordinates of a triangle, if its mesh has them.
template <class Float>
struct TriangleNormals {
    BoolOf<Float> present = false;
    Vec3<Float> n0, n1, n2;
};
template <class Float>
struct TriangleUvs {
    BoolOf<Float> present = false;
    Vec2<Float> uv0, uv1, uv2;
};

// The smooth position on one side of a triangle, relative to the flat one: the mean of the projections onto
// the tangent planes of the vertices (Hanika 2021, "Hacking the Shadow Terminator"), as far as these are
// farther out. `sign` is 1 for the side of the vertex normals, -1 for the other.
template <class Float>
Vec3<Float> smooth_lift(const TriangleCorners<Float> &p, const TriangleNormals<Float> &normals,
                        const Vec3<Float> &position, Float b0, Float b1, Float b2, float sign) {
    const auto towards = [&](const Vec3<Float> &corner, const Vec3<Float> &n, Float weight) {
        return n * (max(dot(corner - position, n) * sign, Float(0)) * weight);
    };
    const Vec3<Float> sum =
        towards(p.a, normals.n0, b0) + towards(p.b, normals.n1, b1) + towards(p.c, normals.n2, b2);
    return sum * sign;
}

// The part of a lift on the side of `outwards` that is not lost in the error of the position.
template <class Float>
Vec3<Float> clear_lift(const Vec3<Float> &lift, const Vec3<Float> &outwards, Float error) {
    return select(dot(lift, outwards) > error, lift, Vec3<Float>(0));
}

// Sets position, normals and the needed derivatives at barycentric coordinates b1, b2. `flipped` reverses the
// normals.
template <class Float>
void fill_triangle(const TriangleCorners<Float> &p, const TriangleNormals<Float> &normals,
                   const TriangleUvs<Float> &uvs, BoolOf<Float> flipped, Float b1, Float b2,
                   const HitNeeds &needs, Hit<Float> &hit) {
    const Vec3<Float> e1 = p.b - p.a, e2 = p.c - p.a;
    const Float b0 = 1 - b1 - b2;
    hit.position = p.a * b0 + p.b * b1 + p.c * b2;
    hit.position_error = position_error(max_component(max(max(abs(p.a), abs(p.b)), abs(p.c))));

    const EdgeCross<Float> face(e1, e2);
    const Float inverse_area = 1 / sqrt(face.squared);
    Vec3<Float> normal = face.normal * inverse_area, shading = normal;
    Vec3<Float> dn_db1, dn_db2; // of the shading normal
    if (any(normals.present)) {
        const Vec3<Float> d1 = normals.n1 - normals.n0, d2 = normals.n2 - normals.n0;
        const Vec3<Float> sum = normals.n0 * b0 + normals.n1 * b1 + normals.n2 * b2;
        const Float squared = length_squared(sum);
        const auto smooth = normals.present && squared > 0.0f;
        const Float inverse_length = 1 / sqrt(squared);
        shading = select(smooth, sum * inverse_length, shading);
        // Vertex normals determine the front, because windings vary between files.
        normal = select(smooth && dot(shading, normal) < 0.0f, -normal, normal);
        if (needs.curvature) {
            const auto change = [&](const Vec3<Float> &d) { // of the sum divided by its length
                return select(smooth, (d - shading * dot(shading, d)) * inverse_length, Vec3<Float>(0));
            };
            dn_db1 = change(d1), dn_db2 = change(d2);
        }
    }
    hit.normal = select(flipped, -normal, normal);
    hit.shading_normal = select(flipped, -shading, shading);
    if (needs.lift && any(normals.present)) {
        const auto lift = [&](float sign) {
            const Vec3<Float> found = smooth_lift(p, normals, hit.position, b0, b1, b2, sign);
            return select(normals.present, clear_lift(found, normal * sign, hit.position_error),
                          Vec3<Float>(0));
        };
        const Vec3<Float> above = lift(1), below = lift(-1);
        const Lift<Float> both{select(flipped, below, above), select(flipped, above, below)};
        if (any(both.is_raised())) hit.lift = both;
    }

    hit.barycentric = {b1, b2};
    if (!needs.uvs && !needs.tangents) return;
    const Vec2<Float> d1 = uvs.uv1 - uvs.uv0, d2 = uvs.uv2 - uvs.uv0;
    hit.uv = select(uvs.present, uvs.uv0 + d1 * b1 + d2 * b2, hit.barycentric);
    if (!needs.tangents) return;
    const Float det = d1.x * d2.y - d1.y * d2.x, inverse = 1 / det;
    const auto spanned = spans_plane(d1, d2), mapped = uvs.present && spanned;
    if (any(uvs.present && !spanned)) [[unlikely]] {
        const UvChange<Float> same;
        const auto kept = mapped || !uvs.present;
        hit.duv = {select(kept, same.first, d1), select(kept, same.second, d2)};
    }
    const auto by_u = [&](const Vec3<Float> &by_b1, const Vec3<Float> &by_b2) {
        return select(mapped, (by_b1 * d2.y - by_b2 * d1.y) * inverse, by_b1);
    };
    const auto by_v = [&](const Vec3<Float> &by_b1, const Vec3<Float> &by_b2) {
        return select(mapped, (by_b2 * d1.x - by_b1 * d2.x) * inverse, by_b2);
    };
    hit.dp_du = by_u(e1, e2), hit.dp_dv = by_v(e1, e2);
    if (!needs.curvature) return;
    hit.dn = {by_u(dn_db1, dn_db2), by_v(dn_db1, dn_db2)};
    hit.dn->du = select(flipped, -hit.dn->du, hit.dn->du);
    hit.dn->dv = select(flipped, -hit.dn->dv, hit.dn->dv);
}

} // namespace lajolla
