#pragma once
// Elementary functions of one float and of several, with the same bits for both. Polynomials and range
// reductions are those of Cephes' single precision functions (Moshier 1992), within four units in the last
// place; sine and cosine within 1e-7, and pow(x, y) within 2 (1 + |y log x|) units. atan2 and acos of NaN are
// numbers.

#include <algorithm>
#include <cmath>
#include <limits>

#include "base/wide.h"

namespace lajolla {

inline constexpr float pi = 3.14159265358979323846f;
inline constexpr float inv_pi = 1 / pi;
inline constexpr float infinity = std::numeric_limits<float>::infinity();
// The largest float below one: samples are in [0, one_minus_ulp].
inline constexpr float one_minus_ulp = 0x1.fffffep-1f;

// --- what the processor computes

// If an operand is NaN, min and max return the first operand, like std::min and std::max.
constexpr float min(float a, float b) { return b < a ? b : a; }
constexpr float max(float a, float b) { return a < b ? b : a; }
inline float sqrt(float x) { return std::sqrt(x); }
inline float abs(float x) { return std::abs(x); }
inline float copysign(float x, float sign) { return std::copysign(x, sign); }
inline float floor(float x) { return std::floor(x); }
inline bool isfinite(float x) { return std::isfinite(x); }

namespace detail {
template <class F>
WideFloat each_lane(WideFloat x, F &&f) {
    WideFloat result;
    for (int k = 0; k < lanes; ++k) result.v[k] = f(x.v[k]);
    return result;
}
inline constexpr std::int32_t sign_bit = std::numeric_limits<std::int32_t>::min();
} // namespace detail

#if defined(__AVX512F__) && defined(__AVX512DQ__)
// With a mask of all lanes, because the headers of g++ warn of the forms without one.
inline WideFloat min(WideFloat a, WideFloat b) {
    return raw_cast(_mm512_maskz_min_ps(0xffff, raw_cast<__m512>(b), raw_cast<__m512>(a)));
}
inline WideFloat max(WideFloat a, WideFloat b) {
    return raw_cast(_mm512_maskz_max_ps(0xffff, raw_cast<__m512>(b), raw_cast<__m512>(a)));
}
inline WideFloat sqrt(WideFloat x) { return raw_cast(_mm512_maskz_sqrt_ps(0xffff, raw_cast<__m512>(x))); }
inline WideFloat floor(WideFloat x) {
    return raw_cast(_mm512_maskz_roundscale_ps(0xffff, raw_cast<__m512>(x), _MM_FROUND_FLOOR));
}
#elif defined(__AVX__)
inline WideFloat min(WideFloat a, WideFloat b) {
    return raw_cast(_mm256_min_ps(raw_cast<__m256>(b), raw_cast<__m256>(a)));
}
inline WideFloat max(WideFloat a, WideFloat b) {
    return raw_cast(_mm256_max_ps(raw_cast<__m256>(b), raw_cast<__m256>(a)));
}
inline WideFloat sqrt(WideFloat x) { return raw_cast(_mm256_sqrt_ps(raw_cast<__m256>(x))); }
inline WideFloat floor(WideFloat x) { return raw_cast(_mm256_floor_ps(raw_cast<__m256>(x))); }
#else
inline WideFloat min(WideFloat a, WideFloat b) { return select(b < a, b, a); }
inline WideFloat max(WideFloat a, WideFloat b) { return select(a < b, b, a); }
inline WideFloat sqrt(WideFloat x) {
    return detail::each_lane(x, [](float y) { return std::sqrt(y); });
}
inline WideFloat floor(WideFloat x) {
    return detail::each_lane(x, [](float y) { return std::floor(y); });
}
#endif
inline WideFloat abs(WideFloat x) { return as_float(as_int(x) & ~detail::sign_bit); }
inline WideFloat copysign(WideFloat x, WideFloat sign) {
    return as_float((as_int(x) & ~detail::sign_bit) | (as_int(sign) & detail::sign_bit));
}
inline WideBool isfinite(WideFloat x) { return abs(x) < WideFloat(infinity); }

// The power of two that brings a positive normal number into [1, 2): multiplying by it is exact.
template <class Float>
Float unit_scale(Float x) {
    constexpr std::int32_t exponent = 0x7f800000, one_twice = 0x7f000000;
    return as_float(one_twice - (as_int(x) & exponent));
}

constexpr float sqr(float x) { return x * x; }
inline WideFloat sqr(WideFloat x) { return x * x; }
template <class Float>
Float safe_sqrt(Float x) {
    return sqrt(max(x, Float(0)));
}
// The square root of a double that is positive and in the range of float32, to 45 bits: one step of Newton's
// method from the root in float32.
template <class Double>
Double root_in_double(const Double &x) {
    const Double start = to_double(sqrt(max(to_float(x), decltype(to_float(x))(1e-37f))));
    return Double(0.5) * (start + x / start);
}
template <class Float>
Float clamp(Float x, std::type_identity_t<Float> low, std::type_identity_t<Float> high) {
    return min(max(x, low), high); // of NaN NaN
}
// For what becomes an index, or was never promised to be a number: of NaN `low`.
template <class T>
T clamp_number(T x, std::type_identity_t<T> low, std::type_identity_t<T> high) {
    return min(max(low, x), high);
}
inline float hypot(float x, float y) { return sqrt(x * x + y * y); }
inline WideFloat hypot(WideFloat x, WideFloat y) { return sqrt(x * x + y * y); }

// --- what takes polynomials

template <class Float, std::size_t n>
constexpr Float polynomial(Float x, const float (&coefficients)[n]) { // the highest power first
    Float sum = coefficients[0];
    for (std::size_t i = 1; i < n; ++i) sum = sum * x + coefficients[i];
    return sum;
}

template <class Float>
struct SineCosine {
    Float sine, cosine;
};
// Of |x| <= pi/4.
template <class Float>
constexpr SineCosine<Float> sine_cosine_of_octant(Float x) {
    const Float z = x * x;
    return {x + x * z * polynomial(z, {-1.9515295891e-4f, 8.3321608736e-3f, -1.6666654611e-1f}),
            1 - 0.5f * z +
                z * z *
                    polynomial(z, {2.443315711809948e-5f, -1.388731625493765e-3f, 4.166664568298827e-2f})};
}

// Accurate for |x| below some thousands.
template <class Float>
SineCosine<Float> sine_cosine(Float x) {
    // The nearest multiple j of pi/2, taken off in three parts that are exact for small j (Cody and Waite).
    const Float j = floor(x * (2 / pi) + 0.5f);
    const auto quadrant = to_int(j);
    const Float rest = ((x - j * 1.5703125f) - j * 4.837512969970703125e-4f) - j * 7.54978995489188216e-8f;
    const auto [s, c] = sine_cosine_of_octant(rest);
    const auto swapped = (quadrant & 1) != 0;
    const auto sine_sign = (quadrant & 2) << 30, cosine_sign = ((quadrant + 1) & 2) << 30;
    return {as_float(as_int(select(swapped, c, s)) ^ sine_sign),
            as_float(as_int(select(swapped, s, c)) ^ cosine_sign)};
}
template <class Float>
Float sin(Float x) {
    return sine_cosine(x).sine;
}
template <class Float>
Float cos(Float x) {
    return sine_cosine(x).cosine;
}
template <class Float>
Float tan(Float x) {
    const auto [sine, cosine] = sine_cosine(x);
    return sine / cosine;
}

// 0 below about -87, infinity above about 88.
template <class Float>
Float exp(Float x) {
    const Float bounded = clamp(x, -87.3f, 89.0f); // no denormal products: they are slow
    const Float n = floor(bounded * 1.44269504088896341f + 0.5f);
    const Float r = (bounded - n * 0.693359375f) - n * -2.12194440e-4f;
    const Float e = polynomial(r, {1.9875691500e-4f, 1.3981999507e-3f, 8.3334519073e-3f, 4.1665795894e-2f,
                                   1.6666665459e-1f, 5.0000001201e-1f}) *
                        (r * r) +
                    r + 1;
    const auto exponent = to_int(n); // in two steps, because 2^128 is no float
    const auto half = exponent >> 1;
    const auto power = [](auto k) { return as_float((k + 127) << 23); };
    const Float result = e * power(half) * power(exponent - half);
    return select(x < -87.3f, Float(0), select(x > 88.72283f, Float(infinity), select(x == x, result, x)));
}

// Of 0 minus infinity, of what is negative NaN; denormal numbers count as zero.
template <class Float>
Float log(Float x) {
    const auto raw = as_int(x) & 0x7fffffff; // without the sign, as the difference must not overflow
    const auto shifted = raw - 0x3f3504f3;   // the bits of sqrt(1/2), so that the mantissa lies around 1
    const Float e = to_float(shifted >> 23);
    const Float f = as_float((shifted & 0x007fffff) + 0x3f3504f3) - 1;
    const Float z = f * f;
    const Float p = polynomial(f, {7.0376836292e-2f, -1.1514610310e-1f, 1.1676998740e-1f, -1.2420140846e-1f,
                                   1.4249322787e-1f, -1.6668057665e-1f, 2.0000714765e-1f, -2.4999993993e-1f,
                                   3.3333331174e-1f});
    const Float result = f + (p * f * z - e * 2.12194440e-4f - 0.5f * z) + e * 0.693359375f;
    const Float special = select(x < 0.0f, Float(std::numeric_limits<float>::quiet_NaN()),
                                 select(x < std::numeric_limits<float>::min(), Float(-infinity), x));
    return select(x >= std::numeric_limits<float>::min() && x < infinity, result, special);
}

// log(1 + x) and exp(x) - 1 of finite x, exact near zero: what rounding does to 1 + x, or to exp(x), is
// taken back (Kahan).
template <class Float>
Float log1p(Float x) {
    const Float y = 1 + x;
    return select(y == 1.0f, x, log(y) * (x / (y - 1)));
}
template <class Float>
Float expm1(Float x) {
    const Float y = exp(x);
    return select(y == 1.0f, x, select(abs(x) > 1.0f, y - 1, (y - 1) * (x / log(y))));
}
template <class Float>
Float tanh(Float x) {
    const Float below = expm1(-2 * abs(x));
    return copysign(-below / (2 + below), x);
}

// Of x >= 0.
template <class Float>
Float pow(Float x, std::type_identity_t<Float> y) {
    return select(y == 0.0f, Float(1), exp(y * log(x)));
}

template <class Float>
Float atan2(Float y, Float x) {
    const Float ax = abs(x), ay = abs(y);
    const Float larger = max(ax, ay), smaller = min(ax, ay);
    const Float t = select(larger > 0.0f, smaller / larger, Float(0)); // in [0, 1]
    const auto steep = t > 0.41421356f;                                // tan(pi/8)
    const Float r = select(steep, (t - 1) / (t + 1), t);
    const Float z = r * r;
    Float angle =
        r +
        r * z * polynomial(z, {8.05374449538e-2f, -1.38776856032e-1f, 1.99777106478e-1f, -3.33329491539e-1f});
    angle = angle + select(steep, Float(pi / 4), Float(0));
    angle = select(ay > ax, pi / 2 - angle, angle);
    angle = select(as_int(x) < 0, pi - angle, angle);
    return copysign(angle, y);
}
template <class Float>
Float acos(Float x) {
    return atan2(safe_sqrt((1 - x) * (1 + x)), x);
}

} // namespace lajolla
