#include "geometry/curves.h"

#include <algorithm>
#include <cmath>
#include <string>

namespace lajolla {

namespace {

Vec3f center_of(const std::array<float, 4> &p) { return {p[0], p[1], p[2]}; }

Vec3f unit(Vec3f v, Vec3f otherwise) {
    const float l = length(v);
    return l > 0 ? v / l : otherwise;
}

// Two directions across a tube that do not rotate along it: one as close to z as possible, and one across.
struct Around {
    Vec3f up, across;
};
Around around(Vec3f tangent) {
    const Vec3f up = unit(Vec3f{0, 0, 1} - tangent * tangent.z, {0, 1, 0});
    return {up, cross(up, tangent)};
}

// The derivative of the direction cos(angle) across + sin(angle) up along the curve.
Vec3f turning(Vec3f tangent, Vec3f tangent_change, const Around &frame, float cos_angle, float sin_angle) {
    const Vec3f z{0, 0, 1};
    const float l = length(z - tangent * tangent.z);
    if (!(l > 0)) return Vec3f(0);
    const Vec3f change = -(tangent_change * tangent.z + tangent * tangent_change.z);
    const Vec3f up = (change - frame.up * dot(frame.up, change)) / l;
    const Vec3f across = cross(up, tangent) + cross(frame.up, tangent_change);
    return across * cos_angle + up * sin_angle;
}

} // namespace

void Curves::build() {
    if (!curves) throw std::invalid_argument("a curves shape needs curves");
    const std::size_t needed = basis == CurveBasis::linear ? 2 : 4;
    for (const auto &p : curves->points) {
        if (!std::isfinite(dot(center_of(p), Vec3f(1))))
            throw std::invalid_argument("a control point is not finite");
        if (!(p[3] >= 0) || !std::isfinite(p[3]))
            throw std::invalid_argument("radii must be finite and not below zero");
    }
    for (const std::uint32_t first : curves->segments)
        if (first + needed > curves->points.size())
            throw std::invalid_argument("segment at control point " + std::to_string(first) +
                                        " is beyond the last of them");
    if (to_world == Transform{}) return;
    auto placed = std::make_shared<CurveSet>(*curves);
    for (auto &p : placed->points) {
        const Vec3f q = to_world.point(center_of(p));
        p = {q.x, q.y, q.z, p[3]};
    }
    curves = std::move(placed);
    to_world = Transform{};
}

float Curves::longest_segment() const {
    float longest = 0;
    for (const std::uint32_t first : curves->segments) {
        const auto &a = curves->points[first], &b = curves->points[first + 1];
        longest = std::max(longest, length(center_of(b) - center_of(a)) + a[3]);
    }
    return longest;
}

Bounds Curves::bounds() const {
    Bounds box;
    for (const auto &p : curves->points) {
        box.extend(center_of(p) - Vec3f(p[3]));
        box.extend(center_of(p) + Vec3f(p[3]));
    }
    return box;
}

Curves::Spine Curves::spine(std::uint32_t segment, float v) const {
    const std::array<float, 4> *const p = &curves->points[curves->segments[segment]];
    const auto blend = [&](auto &&value, float w0, float w1, float w2, float w3) {
        return value(p[0]) * w0 + value(p[1]) * w1 + value(p[2]) * w2 + value(p[3]) * w3;
    };
    const auto radius_of = [](const std::array<float, 4> &point) { return point[3]; };
    if (basis == CurveBasis::linear)
        return {center_of(p[0]) * (1 - v) + center_of(p[1]) * v, center_of(p[1]) - center_of(p[0]), Vec3f(0),
                p[0][3] * (1 - v) + p[1][3] * v, p[1][3] - p[0][3]};
    // The uniform cubic B-spline and its derivatives.
    const float w = 1 - v, sixth = 1.0f / 6;
    const std::array<float, 4> b{w * w * w * sixth, (3 * v * v * v - 6 * v * v + 4) * sixth,
                                 (3 * w * w * w - 6 * w * w + 4) * sixth, v * v * v * sixth};
    const std::array<float, 4> b1{-w * w / 2, (3 * v * v - 4 * v) / 2, (4 * w - 3 * w * w) / 2, v * v / 2};
    return {blend(center_of, b[0], b[1], b[2], b[3]), blend(center_of, b1[0], b1[1], b1[2], b1[3]),
            blend(center_of, w, 3 * v - 2, 3 * w - 2, v), blend(radius_of, b[0], b[1], b[2], b[3]),
            blend(radius_of, b1[0], b1[1], b1[2], b1[3])};
}

void Curves::fill(const Ray<float> &ray, const RayHit &found, const HitNeeds &, Hit<float> &hit) const {
    // Embree returns the position on the segment of the circle that was hit.
    const float v = found.b1 > 0 ? std::min(found.b1, 1.0f) : 0; // a number even for a segment of length zero
    const Spine s = spine(found.primitive, v);
    const Vec3f met = ray.origin + ray.direction * found.distance;
    const float speed = length(s.tangent);
    Vec3f radial = met - s.center;
    const Vec3f tangent = speed > 0 ? s.tangent / speed : frame_around(unit(radial, {0, 0, 1})).s;
    if (basis == CurveBasis::bspline)
        radial -= tangent * dot(tangent, radial); // circles are perpendicular to the curve
    radial = unit(radial, around(tangent).across);
    hit.position = s.center + radial * s.radius;
    const Vec3f extent = abs(s.center) + Vec3f(s.radius);
    hit.position_error = position_error(max_component(extent)) + s.radius * 1e-3f;

    // The surface is c + r(v) e(u, v); its normal is perpendicular to both derivatives. Cones between spheres
    // are hit at the circle where a sphere around c touches them, so that e is the normal.
    const float straight = speed * speed - dot(radial, s.second) * s.radius;
    const Vec3f across = basis == CurveBasis::linear ? radial : radial * straight - s.tangent * s.growth;
    hit.normal = unit(across, radial);
    hit.shading_normal = hit.normal;

    const Around frame = around(tangent);
    const float angle = atan2(dot(frame.up, radial), dot(frame.across, radial));
    const float turn = angle * (0.5f * inv_pi), count = static_cast<float>(curves->segments.size());
    hit.uv =
        hit.barycentric = {turn < 0 ? turn + 1 : turn, (static_cast<float>(found.primitive) + v) / count};
    hit.dp_du = cross(tangent, hit.position - s.center) * (2 * pi);
    const Vec3f tangent_change = speed > 0 ? (s.second - tangent * dot(tangent, s.second)) / speed : Vec3f(0);
    const Vec3f turned = turning(tangent, tangent_change, frame, cos(angle), sin(angle));
    hit.dp_dv = (s.tangent + radial * s.growth + turned * s.radius) * count;

    // The curvature around the tube, and along it if it is curved; the ends of cones are spheres.
    const bool at_end = basis == CurveBasis::linear && (v == 0 || v == 1);
    const float along = !(s.radius > 0) ? 0
                        : at_end        ? 1 / s.radius
                        : straight > 0  ? -dot(radial, s.second) / straight
                                        : 0;
    const float around_tube = s.radius > 0 ? 1 / s.radius : 0;
    const Vec3f a = unit(hit.dp_du, Vec3f(0));
    hit.dn = {hit.dp_du * around_tube, hit.dp_dv * along + a * (dot(a, hit.dp_dv) * (around_tube - along))};
}

} // namespace lajolla
