#pragma once
// Thin tubes around curves: hair, fur, grass.

#include <array>
#include <cstdint>
#include <memory>
#include <stdexcept>
#include <tuple>
#include <vector>

#include "base/fields.h"
#include "base/transform.h"
#include "geometry/hit.h"
#include "geometry/shape_sample.h"
#include "geometry/triangle.h"

namespace lajolla {

// Control points and segments in Embree's format.
struct CurveSet {
    std::vector<std::array<float, 4>> points; // x, y, z, radius
    std::vector<std::uint32_t> segments;      // first control point of each

    std::size_t bytes() const {
        return points.size() * sizeof(points[0]) + segments.size() * sizeof(segments[0]);
    }
};

enum class CurveBasis { linear, bspline };
constexpr auto choices(CurveBasis) { return std::array{"linear", "bspline"}; }

struct Curves : NeverLight {
    static constexpr const char *name = "curves";
    static constexpr const char *doc = "Curves with a round cross section. Texture coordinates run "
                                       "around (u) and along all of them (v).";
    std::shared_ptr<const CurveSet> curves;
    CurveBasis basis = CurveBasis::linear;
    Transform to_world;

    static constexpr auto fields() {
        return std::tuple(
            field("curves", &Curves::curves, "control points and segments"),
            field("basis", &Curves::basis, "cones between spheres, or uniform cubic B-splines"),
            field("to_world", &Curves::to_world, "placement in the scene; radii are not scaled"));
    }
    void build();
    Bounds bounds() const;
    float longest_segment() const; // distance of its control points, plus radius
    void fill(const Ray<float> &ray, const RayHit &found, const HitNeeds &, Hit<float> &hit) const;

private:
    // The centre of a tube, its radius, and their derivatives along a segment.
    struct Spine {
        Vec3f center, tangent, second; // c, c', c''
        float radius, growth;          // r, r'
    };
    Spine spine(std::uint32_t segment, float v) const;
};

} // namespace lajolla
