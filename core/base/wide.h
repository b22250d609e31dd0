#pragma once
// SIMD numbers: one in each lane of a vector register.
//
// Light transport is written once, as templates over the number type: `Float` is float, or WideFloat, which
// holds `lanes` of them. BoolOf<Float> and IntOf<Float> are the matching types. Code for both does not branch
// on values of lanes: select(condition, a, b) replaces `condition ? a : b`, and masks replace early returns.
// Every operation rounds as on floats, so that both give the same bits (-ffp-contract=off, because compilers
// could contract a * b + c in one and not in the other).

#include <bit>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <type_traits>
#include <utility>

#if defined(__SSE2__)
#include <immintrin.h>
#endif

namespace lajolla {

#if defined(__AVX512F__) && defined(__AVX512DQ__)
inline constexpr int lanes = 16;
#else
inline constexpr int lanes = 8;
#endif

struct WideBool {
    using Raw [[gnu::vector_size(4 * lanes)]] = std::int32_t;
    Raw v{}; // 0 or -1

    WideBool() = default;
    explicit WideBool(Raw raw) : v(raw) {}
    WideBool(bool b) : v((b ? -1 : 0) - Raw{}) {}

    friend WideBool operator&&(WideBool a, WideBool b) { return WideBool(a.v & b.v); }
    friend WideBool operator||(WideBool a, WideBool b) { return WideBool(a.v | b.v); }
    friend WideBool operator!(WideBool a) { return WideBool(~a.v); }
    friend WideBool operator==(WideBool a, WideBool b) { return WideBool(~(a.v ^ b.v)); }
    friend WideBool operator!=(WideBool a, WideBool b) { return WideBool(a.v ^ b.v); }
};

struct WideInt {
    using Raw = WideBool::Raw;
    Raw v{};

    WideInt() = default;
    explicit WideInt(Raw raw) : v(raw) {}
    WideInt(std::int32_t x) : v(x - Raw{}) {}

    std::int32_t operator[](int lane) const { return v[lane]; }

    friend WideInt operator+(WideInt a, WideInt b) { return WideInt(a.v + b.v); }
    friend WideInt operator-(WideInt a, WideInt b) { return WideInt(a.v - b.v); }
    friend WideInt operator*(WideInt a, WideInt b) { return WideInt(a.v * b.v); }
    friend WideInt operator-(WideInt a) { return WideInt(-a.v); }
    friend WideInt operator&(WideInt a, WideInt b) { return WideInt(a.v & b.v); }
    friend WideInt operator|(WideInt a, WideInt b) { return WideInt(a.v | b.v); }
    friend WideInt operator^(WideInt a, WideInt b) { return WideInt(a.v ^ b.v); }
    friend WideInt operator<<(WideInt a, int b) { return WideInt(a.v << b); }
    friend WideInt operator>>(WideInt a, int b) { return WideInt(a.v >> b); }
    friend WideBool operator<(WideInt a, WideInt b) { return WideBool(a.v < b.v); }
    friend WideBool operator<=(WideInt a, WideInt b) { return WideBool(a.v <= b.v); }
    friend WideBool operator>(WideInt a, WideInt b) { return WideBool(a.v > b.v); }
    friend WideBool operator>=(WideInt a, WideInt b) { return WideBool(a.v >= b.v); }
    friend WideBool operator==(WideInt a, WideInt b) { return WideBool(a.v == b.v); }
    friend WideBool operator!=(WideInt a, WideInt b) { return WideBool(a.v != b.v); }
    WideInt &operator+=(WideInt b) { return *this = *this + b; }
    WideInt &operator-=(WideInt b) { return *this = *this - b; }
};

struct WideFloat {
    using Raw [[gnu::vector_size(4 * lanes)]] = float;
    Raw v{};

    WideFloat() = default;
    explicit WideFloat(Raw raw) : v(raw) {}
    WideFloat(float x) : v(x - Raw{}) {}

    float operator[](int lane) const { return v[lane]; }

    friend WideFloat operator+(WideFloat a, WideFloat b) { return WideFloat(a.v + b.v); }
    friend WideFloat operator-(WideFloat a, WideFloat b) { return WideFloat(a.v - b.v); }
    friend WideFloat operator*(WideFloat a, WideFloat b) { return WideFloat(a.v * b.v); }
    friend WideFloat operator/(WideFloat a, WideFloat b) { return WideFloat(a.v / b.v); }
    friend WideFloat operator-(WideFloat a) { return WideFloat(-a.v); }
    friend WideBool operator<(WideFloat a, WideFloat b) { return WideBool(a.v < b.v); }
    friend WideBool operator<=(WideFloat a, WideFloat b) { return WideBool(a.v <= b.v); }
    friend WideBool operator>(WideFloat a, WideFloat b) { return WideBool(a.v > b.v); }
    friend WideBool operator>=(WideFloat a, WideFloat b) { return WideBool(a.v >= b.v); }
    friend WideBool operator==(WideFloat a, WideFloat b) { return WideBool(a.v == b.v); }
    friend WideBool operator!=(WideFloat a, WideFloat b) { return WideBool(a.v != b.v); }
    WideFloat &operator+=(WideFloat b) { return *this = *this + b; }
    WideFloat &operator-=(WideFloat b) { return *this = *this - b; }
    WideFloat &operator*=(WideFloat b) { return *this = *this * b; }
    WideFloat &operator/=(WideFloat b) { return *this = *this / b; }
};

// For the few steps that need more digits than float32 has.
struct WideDouble {
    using Raw [[gnu::vector_size(8 * lanes)]] = double;
    Raw v{};

    WideDouble() = default;
    explicit WideDouble(Raw raw) : v(raw) {}
    WideDouble(double x) : v(x - Raw{}) {}

    friend WideDouble operator+(const WideDouble &a, const WideDouble &b) { return WideDouble(a.v + b.v); }
    friend WideDouble operator-(const WideDouble &a, const WideDouble &b) { return WideDouble(a.v - b.v); }
    friend WideDouble operator*(const WideDouble &a, const WideDouble &b) { return WideDouble(a.v * b.v); }
    friend WideDouble operator/(const WideDouble &a, const WideDouble &b) { return WideDouble(a.v / b.v); }
    friend WideDouble operator-(const WideDouble &a) { return WideDouble(-a.v); }
};

namespace detail {
template <class>
struct Companions;
template <>
struct Companions<float> {
    using Bool = bool;
    using Int = std::int32_t;
    using Double = double;
};
template <>
struct Companions<WideFloat> {
    using Bool = WideBool;
    using Int = WideInt;
    using Double = WideDouble;
};
} // namespace detail

template <class Float>
using BoolOf = detail::Companions<Float>::Bool;
template <class Float>
using IntOf = detail::Companions<Float>::Int;
template <class Float>
using DoubleOf = detail::Companions<Float>::Double;

template <class Float>
inline constexpr bool is_wide = std::is_same_v<Float, WideFloat>;

// The processor's own vectors to and from WideFloat.
template <class Vector>
Vector raw_cast(WideFloat x) {
    return std::bit_cast<Vector>(x.v);
}
template <class Vector>
WideFloat raw_cast(Vector x) {
    return WideFloat(std::bit_cast<WideFloat::Raw>(x));
}

// --- masks

// One bit a lane, the first lane lowest.
inline unsigned bits(WideBool m) {
#if defined(__AVX512F__) && defined(__AVX512DQ__)
    return _mm512_movepi32_mask(std::bit_cast<__m512i>(m.v));
#elif defined(__AVX__)
    return static_cast<unsigned>(_mm256_movemask_ps(std::bit_cast<__m256>(m.v)));
#else
    unsigned result = 0;
    for (int k = 0; k < lanes; ++k) result |= static_cast<unsigned>(m.v[k] & 1) << k;
    return result;
#endif
}
inline unsigned bits(bool b) { return b; }
inline WideInt lane_numbers() {
    WideInt result;
    for (int k = 0; k < lanes; ++k) result.v[k] = k;
    return result;
}
// The mask of these bits.
inline WideBool mask_of(unsigned bits) {
    WideInt bit;
    for (int k = 0; k < lanes; ++k) bit.v[k] = 1 << k;
    return (WideInt(static_cast<std::int32_t>(bits)) & bit) != 0;
}
inline WideBool first_lanes(int count) { return lane_numbers() < WideInt(count); }

constexpr bool any(bool b) { return b; }
constexpr bool all(bool b) { return b; }
inline bool any(WideBool m) { return bits(m) != 0; }
inline bool all(WideBool m) { return bits(m) == (1u << lanes) - 1; }

constexpr float select(bool m, float a, float b) { return m ? a : b; }
constexpr std::int32_t select(bool m, std::int32_t a, std::int32_t b) { return m ? a : b; }
constexpr bool select(bool m, bool a, bool b) { return m ? a : b; }
inline WideFloat select(WideBool m, WideFloat a, WideFloat b) { return WideFloat(m.v ? a.v : b.v); }
inline WideInt select(WideBool m, WideInt a, WideInt b) { return WideInt(m.v ? a.v : b.v); }
inline WideBool select(WideBool m, WideBool a, WideBool b) { return WideBool((m.v & a.v) | (~m.v & b.v)); }

// Calls f(lane) for the lanes of a mask.
template <class F>
void for_each_lane(WideBool m, F &&f) {
    for (unsigned rest = bits(m); rest; rest &= rest - 1) f(std::countr_zero(rest));
}

// --- conversions

inline std::int32_t as_int(float x) { return std::bit_cast<std::int32_t>(x); }
inline float as_float(std::int32_t x) { return std::bit_cast<float>(x); }
inline WideInt as_int(WideFloat x) { return WideInt(std::bit_cast<WideInt::Raw>(x.v)); }
inline WideFloat as_float(WideInt x) { return WideFloat(std::bit_cast<WideFloat::Raw>(x.v)); }

// Rounds towards zero; undefined if the result is not representable.
inline std::int32_t to_int(float x) {
#if defined(__SSE2__)
    return _mm_cvttss_si32(_mm_set_ss(x));
#else
    return x >= -0x1p31f && x < 0x1p31f ? static_cast<std::int32_t>(x) : std::int32_t(-0x7fffffff - 1);
#endif
}
inline WideInt to_int(WideFloat x) { return WideInt(__builtin_convertvector(x.v, WideInt::Raw)); }
constexpr float to_float(std::int32_t x) { return static_cast<float>(x); }
inline WideFloat to_float(WideInt x) { return WideFloat(__builtin_convertvector(x.v, WideFloat::Raw)); }
constexpr double to_double(float x) { return x; }
inline WideDouble to_double(WideFloat x) { return WideDouble(__builtin_convertvector(x.v, WideDouble::Raw)); }
constexpr float to_float(double x) { return static_cast<float>(x); }
inline WideFloat to_float(const WideDouble &x) {
    return WideFloat(__builtin_convertvector(x.v, WideFloat::Raw));
}

// --- memory

inline WideFloat load(const float *p) {
    WideFloat result;
    std::memcpy(&result.v, p, sizeof result.v);
    return result;
}
inline WideInt load(const std::int32_t *p) {
    WideInt result;
    std::memcpy(&result.v, p, sizeof result.v);
    return result;
}
inline void store(float *p, WideFloat x) { std::memcpy(p, &x.v, sizeof x.v); }
inline void store(std::int32_t *p, WideInt x) { std::memcpy(p, &x.v, sizeof x.v); }

inline float gather(const float *from, std::int32_t i) { return from[i]; }
inline std::int32_t gather(const std::int32_t *from, std::int32_t i) { return from[i]; }
inline WideFloat gather(const float *from, WideInt i) {
#if defined(__AVX512F__) && defined(__AVX512DQ__)
    const auto index = std::bit_cast<__m512i>(i.v);
    return raw_cast(_mm512_mask_i32gather_ps(_mm512_setzero_ps(), 0xffff, index, from, 4));
#elif defined(__AVX2__)
    return raw_cast(_mm256_i32gather_ps(from, std::bit_cast<__m256i>(i.v), 4));
#else
    WideFloat result;
    for (int k = 0; k < lanes; ++k) result.v[k] = from[i.v[k]];
    return result;
#endif
}
inline WideInt gather(const std::int32_t *from, WideInt i) {
    return as_int(gather(reinterpret_cast<const float *>(from), i)); // only bits are moved
}

// Rows of four numbers to columns and back, for records in memory that differ from lane to lane.
template <class Float>
struct Quad {
    Float x, y, z, w;
};

namespace detail {

// For lane k of a shuffle of a and b: which lane of a, or of b behind it. All shuffles keep to blocks of four
// lanes.
constexpr int unpack_low(int k) { return (k % 2 ? lanes : 0) + k / 4 * 4 + k % 4 / 2; }
constexpr int unpack_high(int k) { return unpack_low(k) + 2; }
constexpr int low_halves(int k) { return (k % 4 / 2 ? lanes : 0) + k / 4 * 4 + k % 2; }
constexpr int high_halves(int k) { return low_halves(k) + 2; }

template <int (*pattern)(int), class Raw>
Raw shuffle(Raw a, Raw b) {
    return [&]<int... k>(std::integer_sequence<int, k...>) {
        return __builtin_shufflevector(a, b, pattern(k)...);
    }(std::make_integer_sequence<int, lanes>());
}

// A 4 x 4 matrix in each block of four lanes, transposed.
inline Quad<WideFloat> transposed(const Quad<WideFloat> &m) {
    const auto ab = shuffle<unpack_low>(m.x.v, m.y.v), cd = shuffle<unpack_low>(m.z.v, m.w.v),
               ab2 = shuffle<unpack_high>(m.x.v, m.y.v), cd2 = shuffle<unpack_high>(m.z.v, m.w.v);
    return {WideFloat(shuffle<low_halves>(ab, cd)), WideFloat(shuffle<high_halves>(ab, cd)),
            WideFloat(shuffle<low_halves>(ab2, cd2)), WideFloat(shuffle<high_halves>(ab2, cd2))};
}

// Blocks of four numbers to and from a vector. (Copying them through memory would stall the processor, which
// cannot forward several small stores to one large load.)
using Four [[gnu::vector_size(16)]] = float;
template <class Half>
auto side_by_side(Half a, Half b) {
    return [&]<int... k>(std::integer_sequence<int, k...>) {
        return __builtin_shufflevector(a, b, k...);
    }(std::make_integer_sequence<int, 2 * sizeof(Half) / sizeof(float)>());
}
template <int block>
Four four_of(WideFloat::Raw v) {
    return __builtin_shufflevector(v, v, 4 * block, 4 * block + 1, 4 * block + 2, 4 * block + 3);
}
inline Four load_four(const float *p) {
    Four result;
    std::memcpy(&result, p, sizeof result);
    return result;
}
} // namespace detail

// Loads four floats of each lane from where row(lane) points.
template <class Row>
[[gnu::always_inline]] inline Quad<WideFloat> load_rows(Row &&row) {
    const auto every_fourth = [&](int first) __attribute__((always_inline)) {
        const auto eight = [&](int lane) __attribute__((always_inline)) {
            return detail::side_by_side(detail::load_four(row(lane)), detail::load_four(row(lane + 4)));
        };
        if constexpr (lanes == 8) return WideFloat(eight(first));
        else return WideFloat(detail::side_by_side(eight(first), eight(first + 8)));
    };
    return detail::transposed({every_fourth(0), every_fourth(1), every_fourth(2), every_fourth(3)});
}
// Stores four floats of each lane to where row(lane) points.
template <class Row>
[[gnu::always_inline]] inline void store_rows(const Quad<WideFloat> &columns, Row &&row) {
    const Quad<WideFloat> rows = detail::transposed(columns);
    const auto every_fourth = [&](const WideFloat &x, int first) __attribute__((always_inline)) {
        [&]<int... block>(std::integer_sequence<int, block...>) __attribute__((always_inline)) {
            const auto put = [](float *to, detail::Four four) { std::memcpy(to, &four, sizeof four); };
            (put(row(first + 4 * block), detail::four_of<block>(x.v)), ...);
        }
        (std::make_integer_sequence<int, lanes / 4>());
    };
    every_fourth(rows.x, 0), every_fourth(rows.y, 1), every_fourth(rows.z, 2), every_fourth(rows.w, 3);
}

} // namespace lajolla
