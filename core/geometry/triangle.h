#pragma once
// What is known of a point on a triangle.

#include "geometry/hit.h"

namespace lajolla {

// What a render asks of hits; the rest of a Hit is then meaningless.
struct HitNeeds {
    bool uvs = true;       // uv
    bool tangents = true;  // dp_du, dp_dv
    bool curvature = true; // mean_curvature
};

template <class Float>
struct TriangleCorners {
    Vec3<Float> a, b, c;
};

// The vertex normals and texture coordinates of a triangle, where its mesh has them.
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

// Fills in position, normals and what is needed of the derivatives at barycentric coordinates b1, b2.
// `flipped` triangles are turned inside out.
template <class Float>
void fill_triangle(const TriangleCorners<Float> &p, const TriangleNormals<Float> &normals,
                   const TriangleUvs<Float> &uvs, BoolOf<Float> flipped, Float b1, Float b2,
                   const HitNeeds &needs, Hit<Float> &hit) {
    const Vec3<Float> e1 = p.b - p.a, e2 = p.c - p.a;
    const Float b0 = 1 - b1 - b2;
    hit.position = p.a * b0 + p.b * b1 + p.c * b2;
    hit.position_error = position_error(max_component(max(max(abs(p.a), abs(p.b)), abs(p.c))));

    const Vec3<Float> scaled_normal = cross(e1, e2);
    const Float inverse_area = 1 / sqrt(length_squared(scaled_normal));
    Vec3<Float> normal = scaled_normal * inverse_area, shading = normal;
    hit.mean_curvature = Float(0);
    if (any(normals.present)) {
        const Vec3<Float> sum = normals.n0 * b0 + normals.n1 * b1 + normals.n2 * b2;
        const Float squared = length_squared(sum);
        const auto smooth = normals.present && squared > 0.0f;
        const Float inverse_length = 1 / sqrt(squared);
        shading = select(smooth, sum * inverse_length, shading);
        // Windings vary between files, vertex normals are meant.
        normal = select(smooth && dot(shading, normal) < 0.0f, -normal, normal);
        if (needs.curvature) {
            // Half the trace of the map from steps on the triangle to changes of the normal, in the dual
            // basis of e1, e2.
            const Vec3<Float> dual1 = cross(e2, scaled_normal), dual2 = cross(scaled_normal, e1);
            const Float trace = dot(normals.n1 - normals.n0, dual1) + dot(normals.n2 - normals.n0, dual2);
            hit.mean_curvature =
                select(smooth, trace * inverse_length * (0.5f * inverse_area * inverse_area), Float(0));
        }
    }
    hit.normal = select(flipped, -normal, normal);
    hit.shading_normal = select(flipped, -shading, shading);
    hit.mean_curvature = select(flipped, -hit.mean_curvature, hit.mean_curvature);

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
