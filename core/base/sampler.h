#pragma once
// A stateless sampler: (seed, pixel, sample index, block) -> eight numbers in [0,1). Blocks have named
// dimensions, so that no feature shifts another's numbers, and the eight numbers of a block come from one
// computation in eight lanes.

#include <array>
#include <bit>
#include <cstdint>
#include <utility>

#include "base/fields.h"
#include "base/vec.h"

namespace lajolla {

namespace detail {

// SIMD vectors: eight lanes hold the numbers of one block, `lanes` lanes one number of several paths.
using U32x8 [[gnu::vector_size(32)]] = std::uint32_t;
using I32x8 [[gnu::vector_size(32)]] = std::int32_t;
using F32x8 [[gnu::vector_size(32)]] = float;
using WideUint [[gnu::vector_size(4 * lanes)]] = std::uint32_t;

// The finalizer of MurmurHash3 (Appleby) on 64 bits.
constexpr std::uint64_t mix64(std::uint64_t x) {
    x = (x ^ (x >> 33)) * 0xff51afd7ed558ccdull;
    x = (x ^ (x >> 33)) * 0xc4ceb9fe1a85ec53ull;
    return x ^ (x >> 33);
}

// "lowbias32" of Wellons' search for integer hashes with little bias.
template <class Uint>
Uint mix32(Uint x) {
    x = (x ^ (x >> 16)) * 0x7feb352du;
    x = (x ^ (x >> 15)) * 0x846ca68bu;
    return x ^ (x >> 16);
}

// Odd multipliers that turn one hash into eight.
inline constexpr std::uint32_t multipliers[8]{0x9e3779b1u, 0x85ebca77u, 0xc2b2ae3du, 0x27d4eb2fu,
                                              0x165667b1u, 0x7feb352du, 0x846ca68bu, 0xd168aaadu};
inline constexpr U32x8 multiplier_vector{multipliers[0], multipliers[1], multipliers[2], multipliers[3],
                                         multipliers[4], multipliers[5], multipliers[6], multipliers[7]};

// The bytes of each number in the opposite order.
template <class Uint>
Uint reverse_bytes(Uint x) {
    using Bytes [[gnu::vector_size(sizeof(Uint))]] = std::uint8_t;
    const auto bytes = std::bit_cast<Bytes>(x);
    return [&]<int... k>(std::integer_sequence<int, k...>) {
        return std::bit_cast<Uint>(__builtin_shufflevector(bytes, bytes, (k / 4 * 4 + 3 - k % 4)...));
    }(std::make_integer_sequence<int, sizeof(Uint)>());
}
template <class Uint>
Uint reverse_bits(Uint x) {
    x = ((x >> 1) & 0x55555555u) | ((x & 0x55555555u) << 1);
    x = ((x >> 2) & 0x33333333u) | ((x & 0x33333333u) << 2);
    x = ((x >> 4) & 0x0f0f0f0fu) | ((x & 0x0f0f0f0fu) << 4);
    if constexpr (std::is_same_v<Uint, std::uint32_t>) return __builtin_bswap32(x);
    else return reverse_bytes(x);
}

// A hash of bit-reversed numbers in which a bit depends on lower bits only: Owen's nested scrambling (Laine
// and Karras 2011, with Vegdahl's constants of 2021).
template <class Uint>
Uint laine_karras(Uint x, Uint seed) {
    x ^= x * 0x3d20adeau;
    x += seed;
    x *= (seed >> 16) | 1u;
    x ^= x * 0x05526c56u;
    x ^= x * 0x53a22864u;
    return x;
}

// Multiplies the bits with Pascal's triangle modulo 2, where a mask selects: the second dimension of Sobol's
// sequence, bit reversed. Binomial(c, r) is odd where r's bits are a subset of c's (Lucas), hence five masked
// shifts.
template <class Uint, class Mask>
Uint pascal(Uint x, Mask selected) {
    x ^= (x >> 1) & (selected & 0x55555555u);
    x ^= (x >> 2) & (selected & 0x33333333u);
    x ^= (x >> 4) & (selected & 0x0f0f0f0fu);
    x ^= (x >> 8) & (selected & 0x00ff00ffu);
    return x ^ ((x >> 16) & (selected & 0x0000ffffu));
}

inline F32x8 to_unit_floats(U32x8 x) {
    return __builtin_convertvector(std::bit_cast<I32x8>(x >> 8), F32x8) * 0x1p-24f;
}
inline WideFloat to_unit_float(WideUint x) {
    return to_float(WideInt(std::bit_cast<WideInt::Raw>(x >> 8))) * 0x1p-24f;
}

} // namespace detail

// Whether something happens that has this probability, decided by a uniform number that stays uniform and fit
// for the next decision.
template <class Float>
BoolOf<Float> passes(Float probability, Float &u) {
    const auto possible = probability > 0.0f, result = possible && u < probability;
    const Float rest = select(result, u / probability, (u - probability) / (1 - probability));
    u = select(possible, min(rest, Float(one_minus_ulp)), u);
    return result;
}

// The eight numbers of one bounce.
template <class Float>
struct BounceSample {
    Vec2<Float> light_uv, bsdf_uv;
    Float light, lobe;
    Float roulette;
    Float event; // what comes next along the ray: PathState::u_event
};

// The numbers that start a path.
template <class Float>
struct CameraSample {
    Vec2<Float> film, lens;
    Float event, channel;
};

// Numbers for an unknown number of decisions, such as collisions in a medium: a hashed counter
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
    Sampler() = default;
    Sampler(SequenceKind kind, std::uint32_t seed, std::uint32_t x, std::uint32_t y, std::uint32_t index)
        : pixel_(detail::mix64(detail::mix64((std::uint64_t(seed) << 32) | 0x9e3779b9u) ^
                               ((std::uint64_t(y) << 32) | x))),
          index_(kind == SequenceKind::sobol ? detail::reverse_bits(index) : index), kind_(kind) {}

    CameraSample<float> camera() const {
        const auto u = block(0);
        return {{u[0], u[1]}, {u[2], u[3]}, u[4], u[5]};
    }
    BounceSample<float> bounce(std::uint32_t depth) const {
        return std::bit_cast<BounceSample<float>>(block(depth + 1));
    }
    // One of many streams of independent numbers.
    NumberStream stream(std::uint32_t number) const {
        return NumberStream(detail::mix64(detail::mix64(~pixel_ + number) ^ index_));
    }

    // The same numbers of a path in each lane; sampler(k) is that of lane k.
    template <class Samplers>
    static CameraSample<WideFloat> cameras(const Samplers &sampler) {
        const auto u = blocks(sampler, WideInt(0));
        return {{u[0], u[1]}, {u[2], u[3]}, u[4], u[5]};
    }
    template <class Samplers>
    static BounceSample<WideFloat> bounces(const Samplers &sampler, WideInt depth) {
        const auto u = blocks(sampler, depth + 1);
        return {{u[0], u[1]}, {u[2], u[3]}, u[4], u[5], u[6], u[7]};
    }

private:
    // Sobol': each pair of dimensions is a two-dimensional Owen-scrambled sequence of its own, its index
    // shuffled by another scrambling, so that pairs are independent (Burley 2020, "Practical Hash-based Owen
    // Scrambling").
    detail::F32x8 block(std::uint32_t number) const {
        using namespace detail;
        const U32x8 zero{};
        const auto hash = hash_of(std::uint32_t(pixel_), std::uint32_t(pixel_ >> 32), index_, number);
        const U32x8 low = zero + hash.low, high = zero + hash.high;
        if (kind_ == SequenceKind::independent) {
            const U32x8 lane{0, 1, 2, 3, 4, 5, 6, 7};
            return to_unit_floats(mix32(mix32(low + lane * 0x9e3779b9u) ^ high));
        }
        const U32x8 per_lane = low * multiplier_vector;
        const U32x8 shuffle =
            __builtin_shufflevector(per_lane, per_lane, 0, 0, 2, 2, 4, 4, 6, 6); // one a pair
        const U32x8 odd_lanes{0, ~0u, 0, ~0u, 0, ~0u, 0, ~0u};
        const U32x8 shuffled = reverse_bits(laine_karras(zero + index_, shuffle));
        return to_unit_floats(
            reverse_bits(laine_karras(pascal(shuffled, odd_lanes), high * multiplier_vector)));
    }

    template <class Samplers>
    static std::array<WideFloat, 8> blocks(const Samplers &sampler, WideInt number) {
        using namespace detail;
        static_assert(sizeof(Sampler) == 4 * sizeof(float)); // the pixel's hash, the index and the kind
        const auto columns = load_rows([&](int k) { return reinterpret_cast<const float *>(&sampler(k)); });
        const auto integers = [](const WideFloat &x) { return std::bit_cast<WideUint>(x.v); };
        const WideUint index = integers(columns.z);
        const auto [low, high] = sampler(0).hash_of(integers(columns.x), integers(columns.y), index,
                                                    std::bit_cast<WideUint>(number.v));
        std::array<WideFloat, 8> result;
        if (sampler(0).kind_ == SequenceKind::independent) {
            for (std::uint32_t d = 0; d < 8; ++d)
                result[d] = to_unit_float(mix32(mix32(low + d * 0x9e3779b9u) ^ high));
            return result;
        }
        for (std::size_t d = 0; d < 8; d += 2) {
            const WideUint shuffled = reverse_bits(laine_karras(index, low * multipliers[d]));
            result[d] = to_unit_float(reverse_bits(laine_karras(shuffled, high * multipliers[d])));
            result[d + 1] =
                to_unit_float(reverse_bits(laine_karras(pascal(shuffled, ~0u), high * multipliers[d + 1])));
        }
        return result;
    }

    // 64 bits for each block of a pixel, or of a sample where these are independent.
    template <class Uint>
    struct Hash {
        Uint low, high;
    };
    template <class Uint>
    Hash<Uint> hash_of(Uint pixel_low, Uint pixel_high, Uint index, Uint number) const {
        using detail::mix32;
        const Uint low = mix32(pixel_low ^ mix32(number)), high = mix32(low + pixel_high);
        if (kind_ == SequenceKind::sobol) return {low, high};
        const Uint mixed = mix32(low ^ index);
        return {mixed, mix32(high + mixed)};
    }

    std::uint64_t pixel_ = 0;
    std::uint32_t index_ = 0;
    SequenceKind kind_ = SequenceKind::sobol;
};

} // namespace lajolla
