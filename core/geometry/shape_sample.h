#pragma once
// Sampled points on shapes.

#include <cstdint>
#include <stdexcept>

#include "base/vec.h"

namespace lajolla {

struct Bounds {
    Vec3f low{infinity}, high{-infinity};
    void extend(Vec3f p) { low = min(low, p), high = max(high, p); }
    void extend(const Bounds &b) { low = min(low, b.low), high = max(high, b.high); }
    bool empty() const { return !(low.x <= high.x); }
};

struct BoundingSphere {
    Vec3f center{0};
    float radius = 1;
};

// A sampled point on a shape. Primitive and barycentrics are those of a ray that hits the point.
struct SurfaceSample {
    Vec3f position, normal;
    float position_error;
    float area_pdf;
    std::uint32_t primitive = 0;
    float b1 = 0, b2 = 0;
};

// The base of shapes whose area has no closed form: they cannot be sampled, so they cannot be lights.
struct NeverLight {
    void prepare_sampling() const { throw std::invalid_argument("this shape cannot be a light"); }
    float area() const { return 0; }
    SurfaceSample sample(float, Vec2f) const { return {}; }
};

} // namespace lajolla
