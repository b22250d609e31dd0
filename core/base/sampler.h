#pragma once
// A stateless sampler: (seed, pixel, sample index, block) -> eight numbers in [0,1). Blocks have named
// dimensions, so that no feature shifts another's numbers, and the eight numbers of a block come from one
// computation in eight lanes.

#include <bit>
#include <cstdint>

#include "base/fields.h"
#include "base/vec.h"

namespace lajolla {

using U32x8 [[gnu::vector_size(32)]] = std::uint32_t;
using I32x8 [[gnu::vector_size(32)]] = std::int32_t;
using F32x8 [[gnu::vector_size(32)]] = float;

namespace detail {

// The finalizer of MurmurHash3 (Appleby) on 64 bits.
constexpr std::uint64_t mix64(std::uint64_t x) {
    x = (x ^ (x >> 33)) * 0xff51afd7ed558ccdull;
    x = (x ^ (x >> 33)) * 0xc4ceb9fe1a85ec53ull;
    return x ^ (x >> 33);
}

inline U32x8 broadcast(std::uint32_t x) { return U32x8{x, x, x, x, x, x, x, x}; }

// "lowbias32" of Wellons' search for integer hashes with little bias.
inline U32x8 mix32(U32x8 x) {
    x = (x ^ (x >> 16)) * 0x7feb352du;
    x = (x ^ (x >> 15)) * 0x846ca68bu;
    return x ^ (x >> 16);
}

// Odd multipliers that turn one hash into eight.
inline constexpr U32x8 lane_multipliers{0x9e3779b1u, 0x85ebca77u, 0xc2b2ae3du, 0x27d4eb2fu,
                                        0x165667b1u, 0x7feb352du, 0x846ca68bu, 0xd168aaadu};

inline U32x8 reverse_bits(U32x8 x) {
    using U8x32 [[gnu::vector_size(32)]] = std::uint8_t;
    x = ((x >> 1) & 0x55555555u) | ((x & 0x55555555u) << 1);
    x = ((x >> 2) & 0x33333333u) | ((x & 0x33333333u) << 2);
    x = ((x >> 4) & 0x0f0f0f0fu) | ((x & 0x0f0f0f0fu) << 4);
    const auto bytes = std::bit_cast<U8x32>(x);
    return std::bit_cast<U32x8>(__builtin_shufflevector(bytes, bytes, 3, 2, 1, 0, 7, 6, 5, 4, 11, 10, 9, 8,
                                                        15, 14, 13, 12, 19, 18, 17, 16, 23, 22, 21, 20, 27,
                                                        26, 25, 24, 31, 30, 29, 28));
}

constexpr std::uint32_t reverse_bits(std::uint32_t x) {
    x = ((x >> 1) & 0x55555555u) | ((x & 0x55555555u) << 1);
    x = ((x >> 2) & 0x33333333u) | ((x & 0x33333333u) << 2);
    x = ((x >> 4) & 0x0f0f0f0fu) | ((x & 0x0f0f0f0fu) << 4);
    x = ((x >> 8) & 0x00ff00ffu) | ((x & 0x00ff00ffu) << 8);
    return (x >> 16) | (x << 16);
}

// A hash of bit-reversed numbers in which a bit depends on lower bits only: Owen's nested scrambling (Laine
// and Karras 2011, with Vegdahl's constants of 2021).
inline U32x8 laine_karras(U32x8 x, U32x8 seed) {
    x ^= x * 0x3d20adeau;
    x += seed;
    x *= (seed >> 16) | 1u;
    x ^= x * 0x05526c56u;
    x ^= x * 0x53a22864u;
    return x;
}

// Multiplies the bits of odd lanes with Pascal's triangle modulo 2: the second dimension of Sobol's sequence,
// bit reversed. Binomial(c, r) is odd where r's bits are a subset of c's (Lucas), hence five masked shifts.
inline U32x8 pascal_odd_lanes(U32x8 x) {
    const auto odd = [](std::uint32_t mask) { return U32x8{0, mask, 0, mask, 0, mask, 0, mask}; };
    x ^= (x >> 1) & odd(0x55555555u);
    x ^= (x >> 2) & odd(0x33333333u);
    x ^= (x >> 4) & odd(0x0f0f0f0fu);
    x ^= (x >> 8) & odd(0x00ff00ffu);
    return x ^ ((x >> 16) & odd(0x0000ffffu));
}

inline F32x8 to_unit_floats(U32x8 x) {
    return __builtin_convertvector(std::bit_cast<I32x8>(x >> 8), F32x8) * 0x1p-24f;
}

} // namespace detail

// Whether something happens that has this probability, decided by a uniform number that stays uniform and fit
// for the next decision.
inline bool passes(float probability, float &u) {
    if (probability <= 0) return false;
    const bool result = u < probability;
    u = result ? u / probability : (u - probability) / (1 - probability);
    u = std::min(u, one_minus_ulp);
    return result;
}

// The eight numbers of one bounce.
struct BounceSample {
    Vec2f light_uv, bsdf_uv;
    float light, lobe;
    float roulette, flight; // flight: what happens on the way to the next vertex
};

// The numbers that start a path.
struct CameraSample {
    Vec2f film, lens;
    float flight, channel;
};

// Numbers for decisions that nobody can count beforehand, such as collisions in a medium: a hashed counter
// (Steele et al. 2014, "Fast splittable pseudorandom number generators").
class NumberStream {
public:
    explicit NumberStream(std::uint64_t key) : state_(key) {}
    float next() {
        return static_cast<float>(detail::mix64(state_ += 0x9e3779b97f4a7c15ull) >> 40) * 0x1p-24f;
    }

private:
    std::uint64_t state_;
};

enum class SequenceKind { sobol, independent };

// The sample points of one pixel's one path.
class Sampler {
public:
    Sampler(SequenceKind kind, std::uint32_t seed, std::uint32_t x, std::uint32_t y, std::uint32_t index)
        : pixel_(detail::mix64(detail::mix64((std::uint64_t(seed) << 32) | 0x9e3779b9u) ^
                               ((std::uint64_t(y) << 32) | x))),
          index_(kind == SequenceKind::sobol ? detail::reverse_bits(index) : index), kind_(kind) {}

    CameraSample camera() const {
        const auto u = block(0);
        return {{u[0], u[1]}, {u[2], u[3]}, u[4], u[5]};
    }
    BounceSample bounce(std::uint32_t depth) const { return std::bit_cast<BounceSample>(block(depth + 1)); }
    // One of many streams of independent numbers.
    NumberStream stream(std::uint32_t number) const {
        return NumberStream(detail::mix64(detail::mix64(~pixel_ + number) ^ index_));
    }

private:
    // Sobol': each pair of dimensions is a two-dimensional Owen-scrambled sequence of its own, its index
    // shuffled by another scrambling, so that pairs are independent (Burley 2020, "Practical Hash-based Owen
    // Scrambling").
    F32x8 block(std::uint32_t number) const {
        using namespace detail;
        if (kind_ == SequenceKind::independent) {
            const std::uint64_t hash = mix64(mix64(pixel_ + number) ^ index_);
            const U32x8 lane{0, 1, 2, 3, 4, 5, 6, 7};
            return to_unit_floats(mix32(mix32(broadcast(std::uint32_t(hash)) + lane * 0x9e3779b9u) ^
                                        broadcast(std::uint32_t(hash >> 32))));
        }
        const std::uint64_t hash = mix64(pixel_ + number);
        const U32x8 scramble = broadcast(std::uint32_t(hash >> 32)) * lane_multipliers;
        const U32x8 per_lane = broadcast(std::uint32_t(hash)) * lane_multipliers;
        const U32x8 shuffle =
            __builtin_shufflevector(per_lane, per_lane, 0, 0, 2, 2, 4, 4, 6, 6); // one a pair
        const U32x8 shuffled = reverse_bits(laine_karras(broadcast(index_), shuffle));
        return to_unit_floats(reverse_bits(laine_karras(pascal_odd_lanes(shuffled), scramble)));
    }

    std::uint64_t pixel_;
    std::uint32_t index_;
    SequenceKind kind_;
};

} // namespace lajolla
