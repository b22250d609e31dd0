#pragma once
// Families of densities over the unit square, bilinear between the nodes of a grid, and the maps that make
// even samples follow them: rows by their sums, then along a row.

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <limits>
#include <span>
#include <utility>
#include <vector>

#include "base/vec.h"

namespace lajolla {

// The members of a family between which a parameter lies, and their shares.
struct SliceMix {
    std::array<std::uint32_t, 4> slice{};
    std::array<float, 4> share{};
    std::size_t count = 0;

    void add(std::uint32_t i, float s) {
        if (!(s > 0)) return;
        slice[count] = i;
        share[count++] = s;
    }
    // The blend of f(slice).
    auto mix(auto &&f) const {
        auto sum = f(slice[0]) * share[0];
        for (std::size_t k = 1; k < count; ++k) sum += f(slice[k]) * share[k];
        return sum;
    }
};

// Neighbours in a rising list of nodes; beyond its ends, the ends.
struct Neighbours {
    std::uint32_t lower, upper;
    float t;
};

inline Neighbours neighbours(std::span<const float> nodes, float x) {
    if (nodes.size() == 1) return {0, 0, 0};
    const auto above = std::lower_bound(nodes.begin() + 1, nodes.end() - 1, x);
    const auto i = static_cast<std::uint32_t>(above - nodes.begin());
    return {i - 1, i, std::clamp((x - nodes[i - 1]) / (nodes[i] - nodes[i - 1]), 0.0f, 1.0f)};
}

// The numbers of nodes of a grid over the unit square, at least two each way, and positions in it.
struct SquareGrid {
    std::uint32_t width = 2, height = 2;

    struct Cell {
        std::uint32_t column, row;
        Vec2f t; // position within
    };
    std::size_t size() const { return std::size_t{width} * height; }
    float columns() const { return static_cast<float>(width - 1); }
    float rows() const { return static_cast<float>(height - 1); }
    Cell cell(Vec2f p) const {
        const float x = std::clamp(p.x, 0.0f, 1.0f) * columns(), y = std::clamp(p.y, 0.0f, 1.0f) * rows();
        const std::uint32_t column = std::min(static_cast<std::uint32_t>(x), width - 2),
                            row = std::min(static_cast<std::uint32_t>(y), height - 2);
        return {column, row, {x - static_cast<float>(column), y - static_cast<float>(row)}};
    }
    // The bilinear value in a cell of one slice after the other.
    auto value(const auto &nodes, const Cell &c, std::uint32_t slice) const {
        const auto *const n = nodes.data() + slice * size() + c.row * std::size_t{width} + c.column;
        return lerp(c.t.y, lerp(c.t.x, n[0], n[1]), lerp(c.t.x, n[width], n[width + 1]));
    }
};

class SquareWarp {
public:
    struct Placed {
        Vec2f position;
        float density; // at the place in the square of the family, whichever way it was mapped
    };

    // Slices of non-negative nodes, one after the other, of any scale. One that is zero everywhere counts as
    // even.
    SquareWarp(std::vector<float> nodes, SquareGrid grid)
        : grid_(grid), nodes_(std::move(nodes)), along_rows_(nodes_.size()),
          rows_(nodes_.size() / grid.width) {
        for (std::size_t first = 0; first < nodes_.size(); first += grid.size()) normalise(first);
    }

    float density(Vec2f p, const SliceMix &blend) const {
        const auto cell = grid_.cell(p);
        return blend.mix([&](std::uint32_t slice) { return grid_.value(nodes_, cell, slice); });
    }
    Placed sample(Vec2f u, const SliceMix &blend) const;
    // What sample() would have to be given for p.
    Placed invert(Vec2f p, const SliceMix &blend) const;

private:
    SquareGrid grid_;
    std::vector<float> nodes_;      // densities
    std::vector<float> along_rows_; // their integral along the row, up to the node
    std::vector<float> rows_;       // the integral of all up to the row

    void normalise(std::size_t first);
    float row(std::uint32_t y, const SliceMix &blend) const {
        return blend.mix([&](std::uint32_t s) { return rows_[std::size_t{s} * grid_.height + y]; });
    }
    float node(const std::vector<float> &table, std::uint32_t x, std::uint32_t y, const SliceMix &b) const {
        return b.mix([&](std::uint32_t s) { return table[s * grid_.size() + y * grid_.width + x]; });
    }
    // The same, a fraction t of the way to the next row.
    float between(const std::vector<float> &table, std::uint32_t x, std::uint32_t y, float t,
                  const SliceMix &blend) const {
        return lerp(t, node(table, x, y, blend), node(table, x, y + 1, blend));
    }
    // The last of the `count` intervals of a rising function of whole numbers that begins below x.
    static std::uint32_t interval(std::uint32_t count, float x, auto &&f) {
        std::uint32_t low = 0, high = count;
        while (high - low > 1) {
            const std::uint32_t middle = (low + high) / 2;
            (f(middle) < x ? low : high) = middle;
        }
        return low;
    }
    // The integral of the line from a to b over [0, t], and the t where it is so much.
    static float area(float t, float a, float b) { return t * lerp(t / 2, a, b); }
    static float place(float area, float a, float b) {
        const float divisor = a + safe_sqrt(a * a + 2 * area * (b - a));
        return std::clamp(2 * area / std::max(divisor, std::numeric_limits<float>::min()), 0.0f, 1.0f);
    }
};

inline void SquareWarp::normalise(std::size_t first) {
    const std::size_t width = grid_.width, height = grid_.height;
    const auto accumulate = [&] {
        double above = 0, total = 0;
        for (std::size_t y = 0; y < height; ++y) {
            const float *const v = nodes_.data() + first + y * width;
            double sum = 0;
            for (std::size_t x = 1; x < width; ++x) {
                sum += (static_cast<double>(v[x - 1]) + static_cast<double>(v[x])) / (2.0 * grid_.columns());
                along_rows_[first + y * width + x] = static_cast<float>(sum);
            }
            if (y > 0) total += (above + sum) / (2.0 * grid_.rows());
            rows_[first / width + y] = static_cast<float>(total);
            above = sum;
        }
        return total;
    };
    const auto begin = nodes_.begin() + static_cast<std::ptrdiff_t>(first),
               end = begin + static_cast<std::ptrdiff_t>(grid_.size());
    const double total = accumulate();
    if (total > 0) std::transform(begin, end, begin, [&](float v) { return static_cast<float>(v / total); });
    else std::fill(begin, end, 1.0f);
    accumulate();
}

inline SquareWarp::Placed SquareWarp::sample(Vec2f u, const SliceMix &blend) const {
    constexpr float margin = 0x1p-24f; // of the ends, where the density may be zero
    const std::uint32_t last = grid_.width - 1;
    const auto within = [&](float v) { return std::clamp(v, margin, 1 - margin); };

    const float y = within(u.y) * row(grid_.height - 1, blend);
    const std::uint32_t r = interval(grid_.height - 1, y, [&](std::uint32_t i) { return row(i, blend); });
    const float sum = node(along_rows_, last, r, blend), next = node(along_rows_, last, r + 1, blend);
    const float ty = place((y - row(r, blend)) * grid_.rows(), sum, next);

    const float x = within(u.x) * lerp(ty, sum, next);
    const auto integral = [&](std::uint32_t i) { return between(along_rows_, i, r, ty, blend); };
    const std::uint32_t c = interval(grid_.width - 1, x, integral);
    const float left = between(nodes_, c, r, ty, blend), right = between(nodes_, c + 1, r, ty, blend);
    const float tx = place((x - integral(c)) * grid_.columns(), left, right);
    return {{(static_cast<float>(c) + tx) / grid_.columns(), (static_cast<float>(r) + ty) / grid_.rows()},
            lerp(tx, left, right)};
}

inline SquareWarp::Placed SquareWarp::invert(Vec2f p, const SliceMix &blend) const {
    const auto [c, r, t] = grid_.cell(p);
    const std::uint32_t last = grid_.width - 1;
    const float left = between(nodes_, c, r, t.y, blend), right = between(nodes_, c + 1, r, t.y, blend);
    const float sum = node(along_rows_, last, r, blend), next = node(along_rows_, last, r + 1, blend);
    const float x = between(along_rows_, c, r, t.y, blend) + area(t.x, left, right) / grid_.columns(),
                y = row(r, blend) + area(t.y, sum, next) / grid_.rows();
    const auto fraction = [](float part, float whole) {
        return whole > 0 ? std::clamp(part / whole, 0.0f, 1.0f) : 0.0f;
    };
    return {{fraction(x, lerp(t.y, sum, next)), fraction(y, row(grid_.height - 1, blend))},
            lerp(t.x, left, right)};
}

} // namespace lajolla
