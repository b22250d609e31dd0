#pragma once

#include "base/vec.h"

#include <array>
#include <cstdint>
#include <span>
#include <vector>

namespace lajolla {

/// Cuts polygons into triangles: convex ones into fans, others by clipping ears.
class PolygonCutter {
public:
    using Triangle = std::array<uint32_t, 3>; // numbers of corners

    /// The triangles of a polygon, until the next call. Fewer than three corners make none.
    std::span<const Triangle> cut(std::span<const Vec3f> corners);

    /// The same without looking at it.
    std::span<const Triangle> fan(size_t corners);

    bool met_concave = false; // in any call

private:
    struct Point {
        double x, y;
    };

    bool flatten(std::span<const Vec3f> corners);
    double turn(uint32_t a, uint32_t b, uint32_t c) const;
    bool is_reflex(uint32_t corner) const;
    bool is_ear(uint32_t corner, size_t &budget) const;
    void clip_ears();

    std::vector<Triangle> triangles;
    std::vector<Point> points; // counterclockwise, as seen along the largest component of the normal
    std::vector<uint32_t> previous, next; // corners that are left, in a ring
    std::vector<bool> reflex;
};

} // namespace lajolla
