#include "images/grid.h"

#include <algorithm>
#include <cmath>

#include "base/match.h"

namespace lajolla {

namespace {

float decode(std::uint8_t value) { return static_cast<float>(value) * (1.0f / 255); }
float decode(Grid::Half value) { return static_cast<float>(value); }
float decode(float value) { return value; }

// The sample used for an index outside of [0, size).
std::int32_t wrapped(std::int32_t i, std::int32_t size, WrapMode mode) {
    if (i >= 0 && i < size) return i;
    if (mode == WrapMode::repeat) return ((i % size) + size) % size;
    if (mode == WrapMode::mirror) {
        const std::int32_t rest = ((i % (2 * size)) + 2 * size) % (2 * size);
        return rest < size ? rest : 2 * size - 1 - rest;
    }
    return i < 0 ? 0 : size - 1;
}

// Positions far outside lose their fraction anyway; this keeps them within the integers.
float bounded(float x) { return std::isfinite(x) ? std::clamp(x, -1e9f, 1e9f) : 0; }

// Along one axis: the two samples around a position, in strides, and the second one's weight.
struct Span {
    std::size_t low, high;
    float weight;
};

Span span_at(float position, std::uint32_t size, std::size_t stride, WrapMode mode) {
    const auto n = static_cast<std::int32_t>(size);
    if (position >= 0 && position < static_cast<float>(n - 1)) { // almost always
        const auto i = static_cast<std::uint32_t>(position);
        const std::size_t low = i * stride;
        return {low, low + stride, position - static_cast<float>(i)};
    }
    const float x = bounded(position), floor = std::floor(x);
    const auto i = static_cast<std::int32_t>(floor);
    return {static_cast<std::size_t>(wrapped(i, n, mode)) * stride,
            static_cast<std::size_t>(wrapped(i + 1, n, mode)) * stride, x - floor};
}

template <class Value>
float trilinear(const Value *v, const Span &x, const Span &y, const Span &z) {
    const auto row = [&](std::size_t offset) {
        return lerp(x.weight, decode(v[offset + x.low]), decode(v[offset + x.high]));
    };
    const auto plane = [&](std::size_t offset) {
        return lerp(y.weight, row(offset + y.low), row(offset + y.high));
    };
    return lerp(z.weight, plane(z.low), plane(z.high));
}

} // namespace

std::size_t Grid::bytes() const {
    return match(values, [](const auto &v) { return v.size() * sizeof(v[0]); });
}

void look_up(const Grid &grid, Vec3f position, GridFilter filter, WrapMode wrap, std::span<float> result) {
    if (filter == GridFilter::nearest) // half a sample on, the one below is the nearest
        position = {std::floor(bounded(position.x) + 0.5f), std::floor(bounded(position.y) + 0.5f),
                    std::floor(bounded(position.z) + 0.5f)};
    const std::size_t column = grid.channels, row = column * grid.width, plane = row * grid.height;
    const Span x = span_at(position.x, grid.width, column, wrap),
               y = span_at(position.y, grid.height, row, wrap),
               z = span_at(position.z, grid.depth, plane, wrap);
    match(grid.values, [&](const auto &values) {
        for (std::size_t i = 0; i < result.size(); ++i) result[i] = trilinear(values.data() + i, x, y, z);
    });
}

float largest(const Grid &grid, const std::int32_t (&first)[3], const std::int32_t (&last)[3]) {
    std::size_t low[3], high[3];
    for (std::size_t axis = 0; axis < 3; ++axis) {
        const auto end = static_cast<std::int32_t>(grid.size(axis)) - 1;
        low[axis] = static_cast<std::size_t>(std::clamp(first[axis], 0, end));
        high[axis] = static_cast<std::size_t>(std::clamp(last[axis], 0, end));
    }
    return match(grid.values, [&](const auto &values) {
        float result = 0;
        for (std::size_t z = low[2]; z <= high[2]; ++z)
            for (std::size_t y = low[1]; y <= high[1]; ++y) {
                const std::size_t row = (z * grid.height + y) * grid.width;
                for (std::size_t i = (row + low[0]) * grid.channels; i < (row + high[0] + 1) * grid.channels;
                     ++i)
                    result = std::max(result, decode(values[i]));
            }
        return result;
    });
}

float largest_row_sum(const Grid &grid) {
    return match(grid.values, [&](const auto &values) {
        float result = 0;
        for (std::size_t i = 0; i + 6 <= values.size(); i += 6) {
            const auto at = [&](std::size_t k) { return std::abs(decode(values[i + k])); };
            result = std::max({result, at(0) + at(3) + at(4), at(1) + at(3) + at(5), at(2) + at(4) + at(5)});
        }
        return result;
    });
}

} // namespace lajolla
