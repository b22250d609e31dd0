#pragma once
// Orthonormal frames. In local coordinates the normal is +z.

#include "base/vec.h"

namespace lajolla {

struct Frame {
    Vec3f s{1, 0, 0}, t{0, 1, 0}, n{0, 0, 1};

    constexpr Vec3f to_local(Vec3f v) const { return {dot(v, s), dot(v, t), dot(v, n)}; }
    constexpr Vec3f to_world(Vec3f v) const { return s * v.x + t * v.y + n * v.z; }
};

// Any frame around a unit normal, without branches (Duff et al. 2017, "Building an Orthonormal Basis,
// Revisited").
inline Frame frame_around(Vec3f n) {
    const float sign = std::copysign(1.0f, n.z);
    const float a = -1 / (sign + n.z);
    const float b = n.x * n.y * a;
    return {{1 + sign * n.x * n.x * a, sign * b, -sign * n.x}, {b, sign + n.y * n.y * a, -n.y}, n};
}

// The frame around a unit normal whose tangent s points along dp_du as far as it can (Gram-Schmidt).
inline Frame frame_along(Vec3f n, Vec3f dp_du) {
    const Vec3f tangent = dp_du - n * dot(n, dp_du);
    const float squared = length_squared(tangent);
    if (!(squared > 1e-12f * length_squared(dp_du)) || squared > 1e30f) return frame_around(n);
    const Vec3f s = tangent * (1 / std::sqrt(squared));
    return {s, cross(n, s), n};
}

constexpr Vec3f reflect(Vec3f w, Vec3f n) { return n * (2 * dot(w, n)) - w; }

} // namespace lajolla
