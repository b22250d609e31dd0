#pragma once
// A handle to a parameter that varies in space: a constant, or the id of a volume that lives in the scene.
// The counterpart of Texture for media and phase functions, read through the function that prepare() is
// given.

#include <cstdint>

#include "base/vec.h"

namespace lajolla {

template <class T>
struct Volume {
    T constant{};
    std::int32_t id = -1; // index into the scene's volumes, -1 for a constant

    constexpr Volume() = default;
    constexpr Volume(T value) : constant(value) {}
    constexpr bool is_constant() const { return id < 0; }
    friend constexpr bool operator==(const Volume &, const Volume &) = default;
};

// A symmetric 3x3 matrix, in the order in which Mitsuba's six-channel volumes store one.
struct SymmetricMatrix {
    float xx = 1, yy = 1, zz = 1, xy = 0, xz = 0, yz = 0;

    constexpr Vec3f operator*(Vec3f v) const {
        return {xx * v.x + xy * v.y + xz * v.z, xy * v.x + yy * v.y + yz * v.z,
                xz * v.x + yz * v.y + zz * v.z};
    }
    constexpr float trace() const { return xx + yy + zz; }
    constexpr SymmetricMatrix adjugate() const {
        return {yy * zz - yz * yz, xx * zz - xz * xz, xx * yy - xy * xy,
                xz * yz - xy * zz, xy * yz - xz * yy, xy * xz - xx * yz};
    }
    constexpr float determinant() const {
        const SymmetricMatrix a = adjugate();
        return xx * a.xx + xy * a.xy + xz * a.xz;
    }
    friend constexpr bool operator==(const SymmetricMatrix &, const SymmetricMatrix &) = default;
};

} // namespace lajolla
