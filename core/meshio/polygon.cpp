#include "meshio/polygon.h"

#include <cmath>

namespace lajolla {
namespace {

// Corners that turn the other way by less, as a sine, are straight.
constexpr double straight = 1e-6;

// Comparisons with other corners, per corner of a polygon, after which the rest of it becomes a fan.
constexpr size_t effort = 1024;

} // namespace

std::span<const PolygonCutter::Triangle> PolygonCutter::fan(size_t corners) {
    triangles.clear();
    for (uint32_t i = 2; i < corners; ++i) triangles.push_back({0, i - 1, i});
    return triangles;
}

std::span<const PolygonCutter::Triangle> PolygonCutter::cut(std::span<const Vec3f> corners) {
    if (corners.size() <= 3 || !flatten(corners)) return fan(corners.size());
    const auto count = static_cast<uint32_t>(corners.size());
    previous.resize(count);
    next.resize(count);
    reflex.resize(count);
    for (uint32_t i = 0; i < count; ++i) {
        previous[i] = (i + count - 1) % count;
        next[i] = (i + 1) % count;
    }
    bool is_concave = false;
    for (uint32_t i = 0; i < count; ++i) {
        reflex[i] = is_reflex(i);
        is_concave |= reflex[i];
    }
    if (!is_concave) return fan(count);
    met_concave = true;
    clip_ears();
    return triangles;
}

/// Projects the polygon along an axis, by its normal (Newell's method). False where it has no area.
bool PolygonCutter::flatten(std::span<const Vec3f> corners) {
    std::array<double, 3> normal{};
    for (size_t i = 0; i < corners.size(); ++i) {
        const Vec3f &a = corners[i], &b = corners[(i + 1) % corners.size()];
        normal[0] += (double(a.y) - b.y) * (double(a.z) + b.z);
        normal[1] += (double(a.z) - b.z) * (double(a.x) + b.x);
        normal[2] += (double(a.x) - b.x) * (double(a.y) + b.y);
    }
    size_t axis = 0;
    for (size_t k = 1; k < 3; ++k)
        if (std::abs(normal[k]) > std::abs(normal[axis])) axis = k;
    if (!(std::abs(normal[axis]) > 0) || !std::isfinite(normal[axis])) return false;
    const double sign = normal[axis] > 0 ? 1 : -1;
    points.clear();
    for (const Vec3f &c : corners) {
        const std::array<double, 3> p{c.x, c.y, c.z};
        points.push_back({p[(axis + 1) % 3], sign * p[(axis + 2) % 3]});
    }
    return true;
}

/// Twice the area of a triangle, positive where it runs counterclockwise.
double PolygonCutter::turn(uint32_t a, uint32_t b, uint32_t c) const {
    return (points[b].x - points[a].x) * (points[c].y - points[a].y) -
           (points[b].y - points[a].y) * (points[c].x - points[a].x);
}

bool PolygonCutter::is_reflex(uint32_t corner) const {
    const Point &a = points[previous[corner]], &b = points[corner], &c = points[next[corner]];
    const double lengths = std::hypot(b.x - a.x, b.y - a.y) * std::hypot(c.x - b.x, c.y - b.y);
    return turn(previous[corner], corner, next[corner]) < -straight * lengths;
}

/// Whether the triangle at a corner can be cut off: no other corner is in it.
bool PolygonCutter::is_ear(uint32_t corner, size_t &budget) const {
    const uint32_t a = previous[corner], b = corner, c = next[corner];
    if (reflex[corner]) return false;
    const auto same = [&](uint32_t i, uint32_t k) {
        return points[i].x == points[k].x && points[i].y == points[k].y;
    };
    for (uint32_t i = next[c]; i != a && budget > 0; i = next[i]) {
        --budget;
        if (!reflex[i] || same(i, a) || same(i, b) || same(i, c)) continue;
        if (turn(a, b, i) >= 0 && turn(b, c, i) >= 0 && turn(c, a, i) >= 0) return false;
    }
    return true;
}

void PolygonCutter::clip_ears() {
    triangles.clear();
    size_t left = points.size(), budget = effort * left, without_ear = 0;
    uint32_t corner = 0;
    while (left > 3 && budget > 0 && without_ear < left) {
        if (!is_ear(corner, budget)) {
            corner = next[corner];
            ++without_ear;
            continue;
        }
        const uint32_t a = previous[corner], c = next[corner];
        triangles.push_back({a, corner, c});
        next[a] = c;
        previous[c] = a;
        reflex[a] = is_reflex(a);
        reflex[c] = is_reflex(c);
        corner = c;
        without_ear = 0;
        --left;
    }
    for (uint32_t i = next[corner]; next[i] != corner; i = next[i]) triangles.push_back({corner, i, next[i]});
}

} // namespace lajolla
