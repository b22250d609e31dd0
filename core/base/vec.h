#pragma once
// Two- and three-component float values. Points, vectors, normals and colours are told apart by their tag, so
// that a colour never slips in where a direction is meant.

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>

namespace lajolla {

inline constexpr float pi = 3.14159265358979323846f;
inline constexpr float inv_pi = 1 / pi;
inline constexpr float infinity = std::numeric_limits<float>::infinity();
// The largest float below one: samples are in [0, one_minus_ulp].
inline constexpr float one_minus_ulp = 0x1.fffffep-1f;

struct Vec2f {
    float x = 0, y = 0;
    constexpr Vec2f() = default;
    constexpr Vec2f(float x_, float y_) : x(x_), y(y_) {}
    friend constexpr Vec2f operator+(Vec2f a, Vec2f b) { return {a.x + b.x, a.y + b.y}; }
    friend constexpr Vec2f operator-(Vec2f a, Vec2f b) { return {a.x - b.x, a.y - b.y}; }
    friend constexpr Vec2f operator*(Vec2f a, Vec2f b) { return {a.x * b.x, a.y * b.y}; }
    friend constexpr Vec2f operator*(Vec2f a, float s) { return {a.x * s, a.y * s}; }
    friend constexpr Vec2f operator*(float s, Vec2f a) { return {a.x * s, a.y * s}; }
    friend constexpr bool operator==(Vec2f a, Vec2f b) = default;
};

template <class Tag>
struct Triple {
    float x = 0, y = 0, z = 0;

    constexpr Triple() = default;
    constexpr explicit Triple(float v) : x(v), y(v), z(v) {}
    constexpr Triple(float x_, float y_, float z_) : x(x_), y(y_), z(z_) {}
    // Written out, because a compiler may copy a trivial triple as eight bytes and four: reading eight bytes
    // that were just stored as two floats stalls the processor, which cost a third of a Cornell box render.
    constexpr Triple(const Triple &o) : x(o.x), y(o.y), z(o.z) {}
    constexpr Triple &operator=(const Triple &o) {
        x = o.x, y = o.y, z = o.z;
        return *this;
    }
    template <class Other>
    constexpr explicit Triple(const Triple<Other> &o) : x(o.x), y(o.y), z(o.z) {}

    constexpr float operator[](std::size_t i) const { return i == 0 ? x : i == 1 ? y : z; }
    constexpr float &operator[](std::size_t i) { return i == 0 ? x : i == 1 ? y : z; }

    friend constexpr Triple operator+(Triple a, Triple b) { return {a.x + b.x, a.y + b.y, a.z + b.z}; }
    friend constexpr Triple operator-(Triple a, Triple b) { return {a.x - b.x, a.y - b.y, a.z - b.z}; }
    friend constexpr Triple operator*(Triple a, Triple b) { return {a.x * b.x, a.y * b.y, a.z * b.z}; }
    friend constexpr Triple operator/(Triple a, Triple b) { return {a.x / b.x, a.y / b.y, a.z / b.z}; }
    friend constexpr Triple operator*(Triple a, float s) { return {a.x * s, a.y * s, a.z * s}; }
    friend constexpr Triple operator*(float s, Triple a) { return {a.x * s, a.y * s, a.z * s}; }
    friend constexpr Triple operator/(Triple a, float s) { return a * (1 / s); }
    friend constexpr Triple operator-(Triple a) { return {-a.x, -a.y, -a.z}; }
    constexpr Triple &operator+=(Triple b) { return *this = *this + b; }
    constexpr Triple &operator-=(Triple b) { return *this = *this - b; }
    constexpr Triple &operator*=(Triple b) { return *this = *this * b; }
    constexpr Triple &operator*=(float s) { return *this = *this * s; }
    constexpr Triple &operator/=(float s) { return *this = *this / s; }
    friend constexpr bool operator==(Triple a, Triple b) = default;
};

using Vec3f = Triple<struct VectorTag>;
// Linear sRGB (Rec. 709 primaries), one number per channel; used for reflectance, radiance and throughput
// alike.
using Spectrum = Triple<struct SpectrumTag>;

template <class Tag>
constexpr float dot(Triple<Tag> a, Triple<Tag> b) {
    return a.x * b.x + a.y * b.y + a.z * b.z;
}
constexpr Vec3f cross(Vec3f a, Vec3f b) {
    return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}
constexpr float length_squared(Vec3f v) { return dot(v, v); }
inline float length(Vec3f v) { return std::sqrt(dot(v, v)); }
inline Vec3f normalize(Vec3f v) { return v * (1 / length(v)); }
constexpr float sqr(float x) { return x * x; }
inline float safe_sqrt(float x) { return std::sqrt(std::max(x, 0.0f)); }

template <class Tag>
inline Triple<Tag> abs(Triple<Tag> a) {
    return {std::abs(a.x), std::abs(a.y), std::abs(a.z)};
}
template <class Tag>
constexpr float max_component(Triple<Tag> a) {
    return std::max({a.x, a.y, a.z});
}
template <class Tag>
constexpr Triple<Tag> min(Triple<Tag> a, Triple<Tag> b) {
    return {std::min(a.x, b.x), std::min(a.y, b.y), std::min(a.z, b.z)};
}
template <class Tag>
constexpr Triple<Tag> max(Triple<Tag> a, Triple<Tag> b) {
    return {std::max(a.x, b.x), std::max(a.y, b.y), std::max(a.z, b.z)};
}
inline Spectrum sqrt(Spectrum s) { return {std::sqrt(s.x), std::sqrt(s.y), std::sqrt(s.z)}; }
template <class T>
constexpr T lerp(float t, T a, T b) {
    return a * (1 - t) + b * t;
}

constexpr bool is_black(Spectrum s) { return s.x == 0 && s.y == 0 && s.z == 0; }
constexpr float mean(Spectrum s) { return (s.x + s.y + s.z) * (1.0f / 3); }
// Relative luminance of linear sRGB (IEC 61966-2-1).
constexpr float luminance(Spectrum s) { return 0.212671f * s.x + 0.715160f * s.y + 0.072169f * s.z; }
inline bool is_finite(Spectrum s) { return std::isfinite(s.x) && std::isfinite(s.y) && std::isfinite(s.z); }

} // namespace lajolla
