#pragma once
// Properties of points on triangles.

#include "geometry/hit.h"

namespace lajolla {

// The optional properties of hits that a render needs; others are not computed.
struct HitNeeds {
    bool uvs = true;       // uv
    bool tangents = true;  // dp_du, dp_dv
    bool curvature = true; // mean_curvature
    bool lift = false;     // of materials that have one
};

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

// The cross product of two edges, which are scaled by a power of two if its square would overflow (edges of
// 1e9) or underflow (edges of 1e-9).
template <class Float>
struct EdgeCross {
    Vec3<Float> e1, e2; // scaled
    Vec3<Float> normal; // not normalized
    Float squared;      // its length
    Float scale = 1;

    EdgeCross(const Vec3<Float> &edge1, const Vec3<Float> &edge2)
        : e1(edge1), e2(edge2), normal(cross(edge1, edge2)), squared(length_squared(normal)) {
        if (all(squared > 1e-30f && squared < 1e30f)) [[likely]]
            return;
        scale = unit_scale(max_component(max(abs(e1), abs(e2))));
        e1 *= scale, e2 *= scale;
        normal = cross(e1, e2);
        squared = length_squared(normal);
    }
    // The area of the parallelogram that the edges span.
    Float area() const { return sqrt(squared) / sqr(scale); }
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
    hit.mean_curvature = Float(0);
    if (any(normals.present)) {
        const Vec3<Float> sum = normals.n0 * b0 + normals.n1 * b1 + normals.n2 * b2;
        const Float squared = length_squared(sum);
        const auto smooth = normals.present && squared > 0.0f;
        const Float inverse_length = 1 / sqrt(squared);
        shading = select(smooth, sum * inverse_length, shading);
        // Vertex normals determine the front, because windings vary between files.
        normal = select(smooth && dot(shading, normal) < 0.0f, -normal, normal);
        if (needs.curvature) {
            // Half the trace of the derivative of the normal by the position, in the dual basis of e1, e2.
            const Vec3<Float> dual1 = cross(face.e2, face.normal), dual2 = cross(face.normal, face.e1);
            const Float trace = dot(normals.n1 - normals.n0, dual1) + dot(normals.n2 - normals.n0, dual2);
            const Float curvature = trace * inverse_length * (0.5f * inverse_area * inverse_area);
            hit.mean_curvature = select(smooth, curvature * face.scale, Float(0));
        }
    }
    hit.normal = select(flipped, -normal, normal);
    hit.shading_normal = select(flipped, -shading, shading);
    hit.mean_curvature = select(flipped, -hit.mean_curvature, hit.mean_curvature);
    if (hit.lift.present && any(normals.present)) {
        const auto lift = [&](float sign) {
            const Vec3<Float> found = smooth_lift(p, normals, hit.position, b0, b1, b2, sign);
            return select(normals.present, clear_lift(found, normal * sign, hit.position_error),
                          Vec3<Float>(0));
        };
        const Vec3<Float> above = lift(1), below = lift(-1);
        hit.lift.front = select(flipped, below, above);
        hit.lift.back = select(flipped, above, below);
    }

    hit.barycentric = {b1, b2};
    if (needs.uvs || needs.tangents) {
        const Vec2<Float> d1 = uvs.uv1 - uvs.uv0, d2 = uvs.uv2 - uvs.uv0;
        hit.uv = select(uvs.present, uvs.uv0 + d1 * b1 + d2 * b2, hit.barycentric);
        if (needs.tangents) {
            const Float det = d1.x * d2.y - d1.y * d2.x, inverse = 1 / det;
            const auto mapped = uvs.present && det != 0.0f;
            hit.dp_du = select(mapped, (e1 * d2.y - e2 * d1.y) * inverse, e1);
            hit.dp_dv = select(mapped, (e2 * d1.x - e1 * d2.x) * inverse, e2);
        }
    }
}

} // namespace lajolla
