#pragma once
// Affine and projective 4x4 transforms, row-major, applied to column vectors.

#include <array>
#include <optional>

#include "base/vec.h"

namespace lajolla {

struct Transform {
    std::array<std::array<float, 4>, 4> m{{{1, 0, 0, 0}, {0, 1, 0, 0}, {0, 0, 1, 0}, {0, 0, 0, 1}}};

    template <class Float = float>
    constexpr Vec3<Float> point(const Vec3<Float> &p) const { // affine: the last row is taken as 0 0 0 1
        return {m[0][0] * p.x + m[0][1] * p.y + m[0][2] * p.z + m[0][3],
                m[1][0] * p.x + m[1][1] * p.y + m[1][2] * p.z + m[1][3],
                m[2][0] * p.x + m[2][1] * p.y + m[2][2] * p.z + m[2][3]};
    }
    template <class Float = float>
    constexpr Vec3<Float> vector(const Vec3<Float> &v) const {
        return {m[0][0] * v.x + m[0][1] * v.y + m[0][2] * v.z, m[1][0] * v.x + m[1][1] * v.y + m[1][2] * v.z,
                m[2][0] * v.x + m[2][1] * v.y + m[2][2] * v.z};
    }
    // The transposed linear part: normals go through the transpose of the inverse.
    template <class Float = float>
    constexpr Vec3<Float> transposed_vector(const Vec3<Float> &n) const {
        return {m[0][0] * n.x + m[1][0] * n.y + m[2][0] * n.z, m[0][1] * n.x + m[1][1] * n.y + m[2][1] * n.z,
                m[0][2] * n.x + m[1][2] * n.y + m[2][2] * n.z};
    }
    constexpr Vec3f axis(std::size_t i) const { return {m[0][i], m[1][i], m[2][i]}; }
    constexpr Vec3f origin() const { return axis(3); }
    friend constexpr bool operator==(const Transform &, const Transform &) = default;
};

// Determinant of the linear part: negative where the transform mirrors.
constexpr float determinant(const Transform &t) { return dot(cross(t.axis(0), t.axis(1)), t.axis(2)); }

// The inverse of an affine transform by cofactors in double precision; nothing where it is singular.
inline std::optional<Transform> inverse(const Transform &t) {
    const auto a = [&](std::size_t row, std::size_t column) { return static_cast<double>(t.m[row][column]); };
    double cofactor[3][3];
    for (std::size_t i = 0; i < 3; ++i)
        for (std::size_t j = 0; j < 3; ++j)
            cofactor[i][j] = a((i + 1) % 3, (j + 1) % 3) * a((i + 2) % 3, (j + 2) % 3) -
                             a((i + 1) % 3, (j + 2) % 3) * a((i + 2) % 3, (j + 1) % 3);
    const double det = a(0, 0) * cofactor[0][0] + a(0, 1) * cofactor[0][1] + a(0, 2) * cofactor[0][2];
    if (det == 0 || !std::isfinite(det)) return std::nullopt;
    Transform result;
    for (std::size_t i = 0; i < 3; ++i) {
        double translation = 0;
        for (std::size_t j = 0; j < 3; ++j) {
            result.m[i][j] = static_cast<float>(cofactor[j][i] / det);
            translation -= cofactor[j][i] / det * a(j, 3);
        }
        result.m[i][3] = static_cast<float>(translation);
    }
    return result;
}

// The largest term of the sums in transforming a point; rounding errors are measured in its ulps.
inline float largest_term(const Transform &t, Vec3f p) {
    return max_component(abs(t.axis(0)) * std::abs(p.x) + abs(t.axis(1)) * std::abs(p.y) +
                         abs(t.axis(2)) * std::abs(p.z) + abs(t.origin()));
}

// The factor by which a similarity (rotation, mirror, translation, even scaling) scales lengths; nothing for
// others.
inline std::optional<float> uniform_scale(const Transform &t) {
    const Vec3f x = t.axis(0), y = t.axis(1), z = t.axis(2);
    const float scale = length(x), tolerance = 1e-3f * scale;
    const bool even = std::abs(length(y) - scale) <= tolerance && std::abs(length(z) - scale) <= tolerance;
    const float skew = std::max({std::abs(dot(x, y)), std::abs(dot(y, z)), std::abs(dot(z, x))});
    if (!(scale > 0) || !even || skew > tolerance * scale) return std::nullopt;
    return scale;
}

} // namespace lajolla
