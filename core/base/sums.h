#pragma once
// Sums of floats that do not depend on the order of their terms, so that parts of a render can be added in
// any order, for the same bits.

#include <bit>
#include <cmath>
#include <cstdint>
#include <span>
#include <vector>

namespace lajolla {

// Many sums, by their index. Each term is split into two digits of base 2^32, at the same powers of two for
// all terms, and digits of the same place are added as integers, which is exact. A sum keeps the two highest
// places that its terms have. Of lower digits, at most 2^-32 of the largest term is lost for each term. This
// is the binned summation of Demmel and Nguyen 2015, "Parallel Reproducible Summation", with integers. 2^31
// terms cannot overflow it.
class Sums {
public:
    static constexpr int highest_place = 8; // of the largest float

    // `high` is the digit at `place`, `low` the one below.
    struct Digits {
        std::int64_t high = 0, low = 0;
    };

    explicit Sums(std::size_t count = 0) : digits_(count), places_(count) {}
    Sums(std::span<const Digits> digits, std::span<const std::int8_t> places)
        : digits_(digits.begin(), digits.end()), places_(places.begin(), places.end()) {}

    std::size_t size() const { return digits_.size(); }
    std::span<const Digits> digits() const { return digits_; }
    std::span<const std::int8_t> places() const { return places_; }

    void add(std::size_t i, float value) {
        const auto bits = std::bit_cast<std::uint32_t>(value);
        const auto exponent = static_cast<int>(bits >> 23 & 0xff);
        const std::int64_t mantissa = (bits & 0x7fffff) | (exponent > 0 ? 0x800000 : 0);
        if (mantissa == 0) return;
        const int lowest_bit = exponent > 0 ? exponent - 1 : 0; // in units of 2^-149
        const int place = lowest_bit / 32;
        const std::int64_t scaled = (value < 0 ? -mantissa : mantissa) << (lowest_bit % 32);
        const auto low = static_cast<std::int32_t>(scaled & 0xffffffff); // rounds `high` to nearest
        const std::int64_t high = (scaled - low) >> 32;
        if (high != 0) add(i, {high, low}, place + 1);
        else add(i, {low, 0}, place);
    }
    // Adds `count` sums of other terms, from `other_first` on, to those from `first` on.
    void add(std::size_t first, const Sums &other, std::size_t other_first, std::size_t count) {
        for (std::size_t i = 0; i < count; ++i)
            add(first + i, other.digits_[other_first + i], other.places_[other_first + i]);
    }
    double value(std::size_t i) const {
        const auto [high, low] = digits_[i];
        return std::ldexp(static_cast<double>(high) * 0x1p32 + static_cast<double>(low),
                          32 * (places_[i] - 1) - 149);
    }

private:
    void add(std::size_t i, const Digits &other, int place) {
        Digits &sum = digits_[i];
        if (place > places_[i]) {
            sum = {0, place == places_[i] + 1 ? sum.high : 0};
            places_[i] = static_cast<std::int8_t>(place);
        }
        if (place == places_[i]) sum.high += other.high, sum.low += other.low;
        else if (place + 1 == places_[i]) sum.low += other.high;
    }

    std::vector<Digits> digits_;
    std::vector<std::int8_t> places_; // of the higher digit; place 0 is that of 2^-149
};

} // namespace lajolla
