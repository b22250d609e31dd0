#pragma once
// Products of the edges of a triangle, or of other vectors that span a plane, at any scale.

#include "base/vec.h"

namespace lajolla {

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

// The coordinates of steps in the plane of two vectors, a step being the first times step.u + the second
// times step.v; of other steps those of their projection. Zero if the vectors span no plane.
template <class Float>
struct DualBasis {
    Vec3<Float> u, v;

    DualBasis(const Vec3<Float> &first, const Vec3<Float> &second) {
        const EdgeCross<Float> plane(first, second);
        const Float inverse = select(plane.squared > 0.0f, plane.scale / plane.squared, Float(0));
        u = cross(plane.e2, plane.normal) * inverse;
        v = cross(plane.normal, plane.e1) * inverse;
    }
    Vec2<Float> operator()(const Vec3<Float> &step) const { return {dot(u, step), dot(v, step)}; }
};

// Whether two steps in texture space span a plane, in spite of rounding.
template <class Float>
BoolOf<Float> spans_plane(const Vec2<Float> &first, const Vec2<Float> &second) {
    const Float a = first.x * second.y, b = first.y * second.x;
    return abs(a - b) > (abs(a) + abs(b)) * 0x1p-16f;
}

// The radius of a circle of the same area as the ellipse with these conjugate radii.
template <class Float>
Float round_radius(const Vec2<Float> &first, const Vec2<Float> &second) {
    return sqrt(abs(first.x * second.y - first.y * second.x));
}
template <class Float>
Float round_radius(const Vec3<Float> &first, const Vec3<Float> &second) {
    return sqrt(EdgeCross<Float>(first, second).area());
}

} // namespace lajolla
