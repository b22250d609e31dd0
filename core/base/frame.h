#pragma once
// Orthonormal frames. In local coordinates the normal is +z.

#include "base/vec.h"

namespace lajolla {

template <class Float>
struct Frame {
    Vec3<Float> s{1, 0, 0}, t{0, 1, 0}, n{0, 0, 1};

    constexpr Vec3<Float> to_local(Vec3<Float> v) const { return {dot(v, s), dot(v, t), dot(v, n)}; }
    constexpr Vec3<Float> to_world(Vec3<Float> v) const { return s * v.x + t * v.y + n * v.z; }
};

template <class Float>
constexpr Frame<Float> select(BoolOf<Float> m, const Frame<Float> &a, const Frame<Float> &b) {
    return {select(m, a.s, b.s), select(m, a.t, b.t), select(m, a.n, b.n)};
}

// Any frame around a unit normal, without branches (Duff et al. 2017, "Building an Orthonormal Basis,
// Revisited").
template <class Float>
Frame<Float> frame_around(Vec3<Float> n) {
    const Float sign = copysign(Float(1), n.z);
    const Float a = -1 / (sign + n.z);
    const Float b = n.x * n.y * a;
    return {{1 + sign * n.x * n.x * a, sign * b, -sign * n.x}, {b, sign + n.y * n.y * a, -n.y}, n};
}

// The frame around a unit normal whose tangent s points along dp_du as far as it can (Gram-Schmidt).
template <class Float>
Frame<Float> frame_along(Vec3<Float> n, Vec3<Float> dp_du) {
    const Vec3<Float> tangent = dp_du - n * dot(n, dp_du);
    const Float squared = length_squared(tangent);
    const auto has_tangent = squared > 1e-12f * length_squared(dp_du) && squared <= 1e30f;
    const Vec3<Float> s = tangent * (1 / sqrt(squared));
    return select(has_tangent, Frame<Float>{s, cross(n, s), n}, frame_around(n));
}

template <class Float>
constexpr Vec3<Float> reflect(Vec3<Float> w, Vec3<Float> n) {
    return n * (2 * dot(w, n)) - w;
}

} // namespace lajolla
