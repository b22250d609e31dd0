#pragma once
// Tabulated distributions that are sampled by inverting their cumulative sums.

#include <algorithm>
#include <cstdint>
#include <span>
#include <vector>

#include "base/vec.h"

namespace lajolla {

template <class Float>
struct DistributionSample {
    IntOf<Float> index;
    Float probability;
    Float rest; // u stretched back to [0,1) within the entry: one number serves twice
};

// The tables of one or more distributions, one after the other, so that each lane can use another one. A
// distribution of n entries takes n + 1 numbers of both arrays.
struct CumulativeSums {
    std::vector<float> cdf;          // for each entry the probability of all before it; the last one is 1
    std::vector<std::int32_t> guide; // guide[k] is the entry at u = k / n

    // Appends a distribution that is proportional to non-negative weights, and returns their sum.
    float append(std::span<const float> weights) {
        double sum = 0;
        for (const float w : weights) sum += w;
        const std::size_t first = cdf.size();
        const auto count = static_cast<double>(weights.size());
        double running = 0;
        cdf.push_back(0);
        for (std::size_t i = 0; i < weights.size(); ++i) {
            running += weights[i];
            cdf.push_back(static_cast<float>(sum > 0 ? running / sum : static_cast<double>(i + 1) / count));
        }
        // Rounding must not leave a gap below one; entries of probability zero at the end stay at one too.
        const auto sums = std::span(cdf).subspan(first);
        if (!weights.empty()) std::replace(sums.begin() + 1, sums.end(), float(sums.back()), 1.0f);
        std::size_t entry = 0;
        for (std::size_t k = 0; k < sums.size(); ++k) {
            const auto least = static_cast<float>(static_cast<double>(k) / count);
            while (entry + 1 < weights.size() && sums[entry + 1] <= least) ++entry;
            guide.push_back(static_cast<std::int32_t>(entry));
        }
        return static_cast<float>(sum);
    }
    void append(const CumulativeSums &other) {
        cdf.insert(cdf.end(), other.cdf.begin(), other.cdf.end());
        guide.insert(guide.end(), other.guide.begin(), other.guide.end());
    }

    // Samples the distribution of `size` entries whose numbers begin at `first`. It searches from where the
    // guide table points, a step or two (Chen and Asau 1974), until the last lane has arrived.
    template <class Float>
    DistributionSample<Float> sample(IntOf<Float> first, Float size, Float u) const {
        u = clamp_number(u, 0.0f, one_minus_ulp); // keeps lanes that are off inside, even NaN
        IntOf<Float> at = first + gather(guide.data(), first + to_int(u * size));
        Float high = gather(cdf.data(), at + 1);
        for (auto passed = high <= u; any(passed); passed = high <= u) {
            at = select(passed, at + 1, at);
            high = gather(cdf.data(), at + 1);
        }
        Float low = gather(cdf.data(), at);
        for (auto before = low > u; any(before); before = low > u) { // where u * size was rounded up
            high = select(before, low, high);
            at = select(before, at - 1, at);
            low = gather(cdf.data(), at);
        }
        const Float p = high - low;
        return {at - first, p, min((u - low) / p, Float(one_minus_ulp))};
    }
};

// Discrete over n entries, proportional to non-negative weights.
class Distribution {
public:
    Distribution() = default;
    explicit Distribution(std::span<const float> weights)
        : sum_(sums_.append(weights)), size_(static_cast<float>(weights.size())) {}

    std::size_t size() const { return sums_.cdf.empty() ? 0 : sums_.cdf.size() - 1; }
    float sum() const { return sum_; }
    const CumulativeSums &sums() const { return sums_; }

    template <class Int>
    auto probability(Int i) const {
        return gather(sums_.cdf.data(), i + 1) - gather(sums_.cdf.data(), i);
    }
    template <class Float>
    DistributionSample<Float> sample(Float u) const {
        if (size() == 1) return {0, 1, u};
        return sums_.sample<Float>(0, size_, u);
    }

private:
    CumulativeSums sums_;
    float sum_ = 0, size_ = 0;
};

// Piecewise constant on a width x height grid over the unit square.
class Distribution2D {
public:
    template <class Float>
    struct Sample {
        Vec2<Float> position;
        Float pdf; // per unit area of the square
    };

    Distribution2D() = default;
    Distribution2D(std::span<const float> weights, std::uint32_t width, std::uint32_t height)
        : width_(static_cast<float>(width)), height_(static_cast<float>(height)),
          stride_(static_cast<std::int32_t>(width + 1)) {
        std::vector<float> sums(height);
        rows_.cdf.reserve(height * (static_cast<std::size_t>(width) + 1));
        rows_.guide.reserve(rows_.cdf.capacity());
        for (std::uint32_t y = 0; y < height; ++y)
            sums[y] = rows_.append(weights.subspan(static_cast<std::size_t>(y) * width, width));
        marginal_ = Distribution(sums);
    }

    float sum() const { return marginal_.sum(); }
    bool empty() const { return rows_.cdf.empty(); }

    // The row by the sums of all rows, the column by the sums within that row.
    template <class Float>
    Sample<Float> sample(const Vec2<Float> &u) const {
        const auto row = marginal_.sample(u.y);
        const auto column = rows_.sample<Float>(row.index * stride_, width_, u.x);
        return {{(to_float(column.index) + column.rest) / width_, (to_float(row.index) + row.rest) / height_},
                row.probability * column.probability * width_ * height_};
    }
    template <class Float>
    Float pdf(const Vec2<Float> &p) const {
        const auto x = cell(p.x, width_), y = cell(p.y, height_);
        const auto at = y * stride_ + x;
        const Float column = gather(rows_.cdf.data(), at + 1) - gather(rows_.cdf.data(), at);
        return marginal_.probability(y) * column * width_ * height_;
    }

private:
    // The cell of a coordinate; the nearest one outside of [0,1), the first for NaN.
    template <class Float>
    static IntOf<Float> cell(Float x, float count) {
        return to_int(clamp_number(x, 0.0f, one_minus_ulp) * count);
    }

    CumulativeSums rows_;
    Distribution marginal_;
    float width_ = 0, height_ = 0;
    std::int32_t stride_ = 0; // numbers of a row in rows_
};

} // namespace lajolla
