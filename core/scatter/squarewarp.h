#pragma once
// Families of densities over the unit square, bilinear between the nodes of a grid, and the maps from uniform
// samples to these densities: first the row, then the position along it.

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <limits>
#include <utility>
#include <vector>

#include "base/vec.h"

namespace lajolla {

// The members of a family between which a parameter is, and their weights.
template <class Float>
struct SliceMix {
    std::array<IntOf<Float>, 4> slice;
    std::array<Float, 4> share;
    std::size_t count = 0;

    void add(IntOf<Float> i, Float s) {
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

// The last of the `count` intervals of an increasing function of integers that begins below x.
template <class Float>
IntOf<Float> interval(std::int32_t count, Float x, auto &&f) {
    IntOf<Float> low = 0, high = count;
    while (any(high - low > 1)) {
        const IntOf<Float> middle = (low + high) >> 1;
        const auto below = f(middle) < x;
        low = select(below, middle, low);
        high = select(below, high, middle);
    }
    return low;
}

// Neighbours in an increasing list of nodes; beyond its ends, the ends.
template <class Float>
struct Neighbours {
    IntOf<Float> lower, upper;
    Float t;
};

template <class Float>
Neighbours<Float> neighbours(const std::vector<float> &nodes, Float x) {
    if (nodes.size() == 1) return {0, 0, 0};
    const auto node = [&](IntOf<Float> i) { return gather(nodes.data(), i); };
    const IntOf<Float> i = interval(static_cast<std::int32_t>(nodes.size()) - 1, x, node);
    return {i, i + 1, clamp((x - node(i)) / (node(i + 1) - node(i)), 0.0f, 1.0f)};
}

// The numbers of nodes of a grid over the unit square, at least two along each axis, and positions in it.
struct SquareGrid {
    std::int32_t width = 2, height = 2;

    template <class Float>
    struct Cell {
        IntOf<Float> column, row;
        Vec2<Float> t; // position in the cell
    };
    std::int32_t size() const { return width * height; }
    float columns() const { return to_float(width - 1); }
    float rows() const { return to_float(height - 1); }
    template <class Float>
    Cell<Float> cell(const Vec2<Float> &p) const {
        const Float x = clamp_number(p.x, 0.0f, 1.0f) * columns(), y = clamp_number(p.y, 0.0f, 1.0f) * rows();
        const IntOf<Float> column = to_int(min(x, Float(columns() - 1))),
                           row = to_int(min(y, Float(rows() - 1)));
        return {column, row, {x - to_float(column), y - to_float(row)}};
    }
    // The bilinear value in a cell, blended over the slices; the values of nodes are node(index).
    template <class Float>
    auto value(const Cell<Float> &c, IntOf<Float> slice, auto &&node) const {
        const IntOf<Float> n = slice * size() + c.row * width + c.column;
        return lerp(c.t.y, lerp(c.t.x, node(n), node(n + 1)),
                    lerp(c.t.x, node(n + width), node(n + width + 1)));
    }
};

class SquareWarp {
public:
    template <class Float>
    struct Placed {
        Vec2<Float> position;
        Float density; // of the family at the mapped point, for both directions of the map
    };

    // Slices of non-negative nodes, one after the other, with any scale. A slice of zeros becomes uniform.
    SquareWarp(std::vector<float> nodes, SquareGrid grid)
        : grid_(grid), nodes_(std::move(nodes)), along_rows_(nodes_.size()),
          rows_(nodes_.size() / static_cast<std::size_t>(grid.width)) {
        const auto size = static_cast<std::size_t>(grid.size());
        for (std::size_t first = 0; first < nodes_.size(); first += size) normalise(first);
    }

    template <class Float>
    Float density(const Vec2<Float> &p, const SliceMix<Float> &blend) const {
        const auto cell = grid_.cell(p);
        return blend.mix([&](IntOf<Float> slice) {
            return grid_.value(cell, slice, [&](IntOf<Float> i) { return gather(nodes_.data(), i); });
        });
    }
    template <class Float>
    Placed<Float> sample(const Vec2<Float> &u, const SliceMix<Float> &blend) const;
    // The inverse of sample().
    template <class Float>
    Placed<Float> invert(const Vec2<Float> &p, const SliceMix<Float> &blend) const;

private:
    SquareGrid grid_;
    std::vector<float> nodes_;      // densities
    std::vector<float> along_rows_; // their integral along the row, up to the node
    std::vector<float> rows_;       // the integral of all up to the row

    void normalise(std::size_t first);
    template <class Float>
    Float row(IntOf<Float> y, const SliceMix<Float> &blend) const {
        return blend.mix([&](IntOf<Float> s) { return gather(rows_.data(), s * grid_.height + y); });
    }
    template <class Float>
    Float node(const std::vector<float> &table, IntOf<Float> x, IntOf<Float> y,
               const SliceMix<Float> &blend) const {
        const IntOf<Float> at = y * grid_.width + x;
        return blend.mix([&](IntOf<Float> s) { return gather(table.data(), s * grid_.size() + at); });
    }
    // The same, a fraction t of the way to the next row.
    template <class Float>
    Float between(const std::vector<float> &table, IntOf<Float> x, IntOf<Float> y, Float t,
                  const SliceMix<Float> &blend) const {
        return lerp(t, node(table, x, y, blend), node(table, x, y + 1, blend));
    }
    // The integral of the line from a to b over [0, t], and its inverse.
    template <class Float>
    static Float area(Float t, Float a, Float b) {
        return t * lerp(t / 2, a, b);
    }
    template <class Float>
    static Float place(Float area, Float a, Float b) {
        const Float divisor = a + safe_sqrt(a * a + 2 * area * (b - a));
        return clamp(2 * area / max(divisor, Float(std::numeric_limits<float>::min())), 0.0f, 1.0f);
    }
};

inline void SquareWarp::normalise(std::size_t first) {
    const auto width = static_cast<std::size_t>(grid_.width), height = static_cast<std::size_t>(grid_.height);
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
    const auto begin = nodes_.begin() + static_cast<std::ptrdiff_t>(first), end = begin + grid_.size();
    const double total = accumulate();
    if (total > 0) std::transform(begin, end, begin, [&](float v) { return static_cast<float>(v / total); });
    else std::fill(begin, end, 1.0f);
    accumulate();
}

template <class Float>
SquareWarp::Placed<Float> SquareWarp::sample(const Vec2<Float> &u, const SliceMix<Float> &blend) const {
    constexpr float margin = 0x1p-24f; // distance from the ends, where the density may be zero
    using Int = IntOf<Float>;
    const Int last = grid_.width - 1;
    const auto within = [&](Float v) { return clamp(v, margin, 1 - margin); };

    const Float y = within(u.y) * row(Int(grid_.height - 1), blend);
    const Int r = interval(grid_.height - 1, y, [&](Int i) { return row(i, blend); });
    const Float sum = node(along_rows_, last, r, blend), next = node(along_rows_, last, r + 1, blend);
    const Float ty = place((y - row(r, blend)) * grid_.rows(), sum, next);

    const Float x = within(u.x) * lerp(ty, sum, next);
    const auto integral = [&](Int i) { return between(along_rows_, i, r, ty, blend); };
    const Int c = interval(grid_.width - 1, x, integral);
    const Float left = between(nodes_, c, r, ty, blend), right = between(nodes_, c + 1, r, ty, blend);
    const Float tx = place((x - integral(c)) * grid_.columns(), left, right);
    return {{(to_float(c) + tx) / grid_.columns(), (to_float(r) + ty) / grid_.rows()}, lerp(tx, left, right)};
}

template <class Float>
SquareWarp::Placed<Float> SquareWarp::invert(const Vec2<Float> &p, const SliceMix<Float> &blend) const {
    const auto [c, r, t] = grid_.cell(p);
    const IntOf<Float> last = grid_.width - 1;
    const Float left = between(nodes_, c, r, t.y, blend), right = between(nodes_, c + 1, r, t.y, blend);
    const Float sum = node(along_rows_, last, r, blend), next = node(along_rows_, last, r + 1, blend);
    const Float x = between(along_rows_, c, r, t.y, blend) + area(t.x, left, right) / grid_.columns(),
                y = row(r, blend) + area(t.y, sum, next) / grid_.rows();
    const auto fraction = [](Float part, Float whole) {
        return select(whole > 0.0f, clamp(part / whole, 0.0f, 1.0f), Float(0));
    };
    return {{fraction(x, lerp(t.y, sum, next)), fraction(y, row(IntOf<Float>(grid_.height - 1), blend))},
            lerp(t.x, left, right)};
}

} // namespace lajolla
