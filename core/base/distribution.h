#pragma once
// Tabulated distributions that are sampled by inverting their cumulative sums.

#include <algorithm>
#include <cstdint>
#include <span>
#include <vector>

#include "base/vec.h"

namespace lajolla {

// Discrete over n entries, proportional to non-negative weights.
class Distribution {
public:
    struct Sample {
        std::uint32_t index;
        float probability;
        float rest; // u stretched back to [0,1) within the entry: one number serves twice
    };

    Distribution() = default;
    explicit Distribution(std::span<const float> weights) : cdf_(weights.size() + 1), guide_(weights.size()) {
        double sum = 0;
        for (const float w : weights) sum += w;
        sum_ = static_cast<float>(sum);
        size_ = static_cast<float>(weights.size());
        const auto count = static_cast<double>(weights.size());
        double running = 0;
        for (std::size_t i = 0; i < weights.size(); ++i) {
            running += weights[i];
            cdf_[i + 1] = static_cast<float>(sum > 0 ? running / sum : static_cast<double>(i + 1) / count);
        }
        // Rounding must not leave a gap below one; entries of probability zero at the end stay at one too.
        if (!weights.empty()) std::replace(cdf_.begin() + 1, cdf_.end(), float(cdf_.back()), 1.0f);
        std::uint32_t entry = 0;
        for (std::size_t k = 0; k < guide_.size(); ++k) {
            const auto least = static_cast<float>(static_cast<double>(k) / count);
            while (entry + 1 < guide_.size() && cdf_[entry + 1] <= least) ++entry;
            guide_[k] = entry;
        }
    }

    std::size_t size() const { return cdf_.empty() ? 0 : cdf_.size() - 1; }
    float sum() const { return sum_; }
    float probability(std::uint32_t i) const { return cdf_[i + 1] - cdf_[i]; }

    // Searches from where the guide table points, a step or two (Chen and Asau 1974).
    Sample sample(float u) const {
        std::uint32_t index = guide_[static_cast<std::uint32_t>(u * size_)];
        while (cdf_[index + 1] <= u) ++index;
        while (cdf_[index] > u) --index; // where u * size was rounded up
        const float low = cdf_[index], p = cdf_[index + 1] - low;
        return {index, p, std::min((u - low) / p, one_minus_ulp)};
    }

private:
    std::vector<float> cdf_;           // cdf_[i] is the probability of all entries before i
    std::vector<std::uint32_t> guide_; // guide_[k] is the entry at u = k / size
    float sum_ = 0, size_ = 0;
};

// Piecewise constant on a width x height grid over the unit square.
class Distribution2D {
public:
    struct Sample {
        Vec2f position;
        float pdf; // per unit area of the square
    };

    Distribution2D() = default;
    Distribution2D(std::span<const float> weights, std::uint32_t width, std::uint32_t height)
        : width_(width), height_(height) {
        rows_.reserve(height);
        std::vector<float> sums(height);
        for (std::uint32_t y = 0; y < height; ++y) {
            rows_.emplace_back(weights.subspan(static_cast<std::size_t>(y) * width, width));
            sums[y] = rows_.back().sum();
        }
        marginal_ = Distribution(sums);
    }

    float sum() const { return marginal_.sum(); }
    bool empty() const { return rows_.empty(); }

    Sample sample(Vec2f u) const {
        const auto row = marginal_.sample(u.y);
        const auto column = rows_[row.index].sample(u.x);
        const auto w = static_cast<float>(width_), h = static_cast<float>(height_);
        return {{(static_cast<float>(column.index) + column.rest) / w,
                 (static_cast<float>(row.index) + row.rest) / h},
                row.probability * column.probability * w * h};
    }
    float pdf(Vec2f p) const {
        const std::uint32_t x = cell(p.x, width_), y = cell(p.y, height_);
        return marginal_.probability(y) * rows_[y].probability(x) * static_cast<float>(width_) *
               static_cast<float>(height_);
    }

private:
    // The cell of a coordinate; the nearest one outside of [0,1), the first for NaN.
    static std::uint32_t cell(float x, std::uint32_t count) {
        return x > 0 ? static_cast<std::uint32_t>(std::min(x, one_minus_ulp) * static_cast<float>(count)) : 0;
    }

    std::vector<Distribution> rows_;
    Distribution marginal_;
    std::uint32_t width_ = 0, height_ = 0;
};

} // namespace lajolla
