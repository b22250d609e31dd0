#pragma once
// Two- and three-component values of float or WideFloat. Points, vectors, normals and colours are distinct
// by their tag, so that a colour never slips in where a direction is meant.

#include <array>
#include <cstddef>

#include "base/math.h"

namespace lajolla {

template <class Float>
struct Vec2 {
    Float x{}, y{};
    constexpr Vec2() = default;
    constexpr Vec2(Float x_, Float y_) : x(x_), y(y_) {}
    friend constexpr Vec2 operator+(Vec2 a, Vec2 b) { return {a.x + b.x, a.y + b.y}; }
    friend constexpr Vec2 operator-(Vec2 a, Vec2 b) { return {a.x - b.x, a.y - b.y}; }
    friend constexpr Vec2 operator*(Vec2 a, Vec2 b) { return {a.x * b.x, a.y * b.y}; }
    friend constexpr Vec2 operator*(Vec2 a, Float s) { return {a.x * s, a.y * s}; }
    friend constexpr Vec2 operator*(Float s, Vec2 a) { return {a.x * s, a.y * s}; }
    friend constexpr auto operator==(Vec2 a, Vec2 b) { return a.x == b.x && a.y == b.y; }
};
using Vec2f = Vec2<float>;

template <class Tag, class Float>
struct Triple {
    Float x{}, y{}, z{};

    constexpr Triple() = default;
    constexpr explicit Triple(Float v) : x(v), y(v), z(v) {}
    constexpr Triple(Float x_, Float y_, Float z_) : x(x_), y(y_), z(z_) {}
    // Written out, because a compiler may copy a trivial triple as eight bytes and four: reading eight bytes
    // that were just stored as two floats stalls the processor, which cost a third of a Cornell box render.
    constexpr Triple(const Triple &o) : x(o.x), y(o.y), z(o.z) {}
    constexpr Triple &operator=(const Triple &o) {
        x = o.x, y = o.y, z = o.z;
        return *this;
    }
    template <class Other>
        requires(!std::is_same_v<Other, Tag>)
    constexpr explicit Triple(const Triple<Other, Float> &o) : x(o.x), y(o.y), z(o.z) {}
    // One value for all lanes.
    constexpr Triple(const Triple<Tag, float> &o)
        requires(!std::is_same_v<Float, float>)
        : x(o.x), y(o.y), z(o.z) {}

    constexpr Float operator[](std::size_t i) const { return i == 0 ? x : i == 1 ? y : z; }
    constexpr Float &operator[](std::size_t i) { return i == 0 ? x : i == 1 ? y : z; }

    friend constexpr Triple operator+(Triple a, Triple b) { return {a.x + b.x, a.y + b.y, a.z + b.z}; }
    friend constexpr Triple operator-(Triple a, Triple b) { return {a.x - b.x, a.y - b.y, a.z - b.z}; }
    friend constexpr Triple operator*(Triple a, Triple b) { return {a.x * b.x, a.y * b.y, a.z * b.z}; }
    friend constexpr Triple operator/(Triple a, Triple b) { return {a.x / b.x, a.y / b.y, a.z / b.z}; }
    friend constexpr Triple operator*(Triple a, Float s) { return {a.x * s, a.y * s, a.z * s}; }
    friend constexpr Triple operator*(Float s, Triple a) { return {a.x * s, a.y * s, a.z * s}; }
    friend constexpr Triple operator/(Triple a, Float s) { return a * (1 / s); }
    friend constexpr Triple operator-(Triple a) { return {-a.x, -a.y, -a.z}; }
    constexpr Triple &operator+=(Triple b) { return *this = *this + b; }
    constexpr Triple &operator-=(Triple b) { return *this = *this - b; }
    constexpr Triple &operator*=(Triple b) { return *this = *this * b; }
    constexpr Triple &operator*=(Float s) { return *this = *this * s; }
    constexpr Triple &operator/=(Float s) { return *this = *this / s; }
    friend constexpr auto operator==(Triple a, Triple b) { return a.x == b.x && a.y == b.y && a.z == b.z; }
};

template <class Float>
using Vec3 = Triple<struct VectorTag, Float>;
using Vec3f = Vec3<float>;
// Linear sRGB (Rec. 709 primaries), one number per channel; used for reflectance, radiance and throughput
// alike.
template <class Float>
using Rgb = Triple<struct SpectrumTag, Float>;
using Spectrum = Rgb<float>;

template <class Tag, class Float>
constexpr Float dot(Triple<Tag, Float> a, Triple<Tag, Float> b) {
    return a.x * b.x + a.y * b.y + a.z * b.z;
}
template <class Float = float>
constexpr Vec3<Float> cross(Vec3<Float> a, Vec3<Float> b) {
    return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}
template <class Float = float>
constexpr Float length_squared(Vec3<Float> v) {
    return dot(v, v);
}
template <class Float = float>
Float length(Vec3<Float> v) {
    return sqrt(dot(v, v));
}
template <class Float = float>
Vec3<Float> normalize(Vec3<Float> v) {
    return v * (1 / length(v));
}

template <class Tag, class Float>
Triple<Tag, Float> abs(Triple<Tag, Float> a) {
    return {abs(a.x), abs(a.y), abs(a.z)};
}
template <class Tag, class Float>
constexpr Float max_component(Triple<Tag, Float> a) {
    return max(max(a.x, a.y), a.z);
}
template <class Tag, class Float>
constexpr Triple<Tag, Float> min(Triple<Tag, Float> a, Triple<Tag, Float> b) {
    return {min(a.x, b.x), min(a.y, b.y), min(a.z, b.z)};
}
template <class Tag, class Float>
constexpr Triple<Tag, Float> max(Triple<Tag, Float> a, Triple<Tag, Float> b) {
    return {max(a.x, b.x), max(a.y, b.y), max(a.z, b.z)};
}
template <class Tag, class Float>
constexpr Triple<Tag, Float> select(BoolOf<Float> m, Triple<Tag, Float> a, Triple<Tag, Float> b) {
    return {select(m, a.x, b.x), select(m, a.y, b.y), select(m, a.z, b.z)};
}
template <class Float>
constexpr Vec2<Float> select(BoolOf<Float> m, Vec2<Float> a, Vec2<Float> b) {
    return {select(m, a.x, b.x), select(m, a.y, b.y)};
}
template <class Float>
Rgb<Float> sqrt(Rgb<Float> s) {
    return {sqrt(s.x), sqrt(s.y), sqrt(s.z)};
}
template <class Float>
Rgb<Float> exp(Rgb<Float> s) {
    return {exp(s.x), exp(s.y), exp(s.z)};
}
template <class Float, class T>
constexpr T lerp(Float t, T a, T b) {
    return a * (1 - t) + b * t;
}

template <class Float>
constexpr BoolOf<Float> is_black(Rgb<Float> s) {
    return s.x == 0.0f && s.y == 0.0f && s.z == 0.0f;
}
template <class Float>
constexpr Float mean(Rgb<Float> s) {
    return (s.x + s.y + s.z) * (1.0f / 3);
}
// Relative luminance of linear sRGB (IEC 61966-2-1).
template <class Float>
constexpr Float luminance(Rgb<Float> s) {
    return 0.212671f * s.x + 0.715160f * s.y + 0.072169f * s.z;
}
template <class Float>
BoolOf<Float> is_finite(Rgb<Float> s) {
    return isfinite(s.x) && isfinite(s.y) && isfinite(s.z);
}

} // namespace lajolla
