#include "geometry/sdfgrid.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "base/match.h"

namespace lajolla {

namespace {

// A polynomial c0 + c1 t + c2 t^2 + c3 t^3.
struct Cubic {
    double c0, c1, c2, c3;
    double operator()(double t) const { return ((c3 * t + c2) * t + c1) * t + c0; }
};

// The interpolant of a voxel's corner values along o + t d, where the voxel is the unit cube (the paper's
// equation 6, multiplied out).
Cubic along_ray(const std::array<float, 8> &f, Vec3f origin, Vec3f direction) {
    const double x = origin.x, y = origin.y, z = origin.z, u = direction.x, v = direction.y, w = direction.z;
    const double k = f[0], kx = f[1] - k, ky = f[2] - k, kz = f[4] - k;
    const double kxy = f[3] - k - kx - ky, kyz = f[6] - k - ky - kz, kxz = f[5] - k - kx - kz;
    const double kxyz = f[7] - k - kx - ky - kz - kxy - kyz - kxz;
    return {k + kx * x + ky * y + kz * z + kxy * x * y + kyz * y * z + kxz * x * z + kxyz * x * y * z,
            kx * u + ky * v + kz * w + kxy * (x * v + y * u) + kyz * (y * w + z * v) + kxz * (x * w + z * u) +
                kxyz * (x * y * w + x * v * z + u * y * z),
            kxy * u * v + kyz * v * w + kxz * u * w + kxyz * (x * v * w + u * y * w + u * v * z),
            kxyz * u * v * w};
}

// The root in an interval in which the polynomial is monotone and changes its sign: regula falsi with the
// Illinois method, and bisection if that is slow.
double root_between(const Cubic &f, double low, double high) {
    double at_low = f(low), at_high = f(high);
    for (int i = 0; i < 60 && high - low > 1e-9 * (1 + std::abs(high)); ++i) {
        const double secant = (low * at_high - high * at_low) / (at_high - at_low);
        const bool inside = secant > low && secant < high;
        const double t = i % 3 == 2 || !inside ? 0.5 * (low + high) : secant;
        const double at_t = f(t);
        if (at_t == 0) return t;
        if ((at_t < 0) == (at_low < 0)) {
            low = t, at_low = at_t;
            at_high /= 2;
        } else {
            high = t, at_high = at_t;
            at_low /= 2;
        }
    }
    return 0.5 * (low + high);
}

// The first root in [0, length].
std::optional<double> first_root(const Cubic &f, double length) {
    // Between the roots of its derivative it is monotone.
    std::array<double, 4> ends{0, length, length, length};
    const double a = 3 * f.c3, b = f.c2, discriminant = b * b - a * f.c1; // a t^2 + 2 b t + c1
    if (discriminant > 0) {
        const double q = -(b + std::copysign(std::sqrt(discriminant), b));
        const double r0 = q / a, r1 = f.c1 / q; // not finite with fewer than two turning points
        const auto turning = [&](double r) { return r > 0 && r < length ? r : length; };
        ends = {0, std::min(turning(r0), turning(r1)), std::max(turning(r0), turning(r1)), length};
    }
    for (std::size_t i = 0; i + 1 < ends.size(); ++i)
        if (ends[i] < ends[i + 1] && (f(ends[i]) < 0) != (f(ends[i + 1]) < 0))
            return root_between(f, ends[i], ends[i + 1]);
    return std::nullopt;
}

} // namespace

void SdfGrid::build() {
    if (!grid) throw std::invalid_argument("an sdfgrid needs a grid");
    if (grid->channels != 1) throw std::invalid_argument("the grid of an sdfgrid needs one channel");
    for (std::size_t axis = 0; axis < 3; ++axis) size_[axis] = grid->size(axis);
    if (size_[0] < 2 || size_[1] < 2 || size_[2] < 2)
        throw std::invalid_argument("the grid of an sdfgrid needs two values along each axis");
    const auto inverted = inverse(to_world);
    if (!inverted) throw std::invalid_argument("to_world is singular: it flattens the shape");
    world_to_voxels_ = *inverted, voxels_to_world_ = to_world;
    for (std::size_t axis = 0; axis < 3; ++axis) {
        const auto voxels = static_cast<float>(size_[axis] - 1);
        for (float &entry : world_to_voxels_.m[axis]) entry *= voxels;
        for (std::size_t row = 0; row < 3; ++row) voxels_to_world_.m[row][axis] /= voxels;
    }
    match(grid->values, [&](const auto &stored) {
        values_.reserve(stored.size());
        for (const auto v : stored) {
            values_.push_back(static_cast<float>(v));
            if (!std::isfinite(values_.back()))
                throw std::invalid_argument("a value of the grid is not finite");
        }
    });
    float largest = 0; // the surface does not depend on the unit
    for (const float v : values_) largest = std::max(largest, std::abs(v));
    if (largest > 0)
        for (float &v : values_) v /= largest;
    for (std::uint32_t z = 0; z + 1 < size_[2]; ++z)
        for (std::uint32_t y = 0; y + 1 < size_[1]; ++y)
            for (std::uint32_t x = 0; x + 1 < size_[0]; ++x) {
                const auto f = corner_values({x, y, z});
                const auto [low, high] = std::minmax_element(f.begin(), f.end());
                if (*low <= 0 && *high >= 0 && *low < *high) voxels_.push_back({x, y, z});
            }
}

std::array<float, 8> SdfGrid::corner_values(const Corner &c) const {
    std::array<float, 8> f{};
    for (std::uint32_t i = 0; i < 8; ++i) f[i] = value(c[0] + (i & 1), c[1] + (i >> 1 & 1), c[2] + (i >> 2));
    return f;
}

Bounds SdfGrid::bounds() const {
    Bounds box;
    for (std::uint32_t i = 0; i < primitive_count(); ++i) box.extend(bounds(i));
    return box;
}

Bounds SdfGrid::bounds(std::uint32_t voxel) const {
    const Corner &c = voxels_[voxel];
    Bounds box;
    for (std::uint32_t i = 0; i < 8; ++i)
        box.extend(voxels_to_world_.point({static_cast<float>(c[0] + (i & 1)),
                                           static_cast<float>(c[1] + (i >> 1 & 1)),
                                           static_cast<float>(c[2] + (i >> 2))}));
    return box;
}

float SdfGrid::intersect(const Ray<float> &ray, std::uint32_t voxel) const {
    const Corner &corner = voxels_[voxel];
    const Vec3f low{static_cast<float>(corner[0]), static_cast<float>(corner[1]),
                    static_cast<float>(corner[2])};
    const Vec3f o = world_to_voxels_.point(ray.origin) - low, d = world_to_voxels_.vector(ray.direction);
    // Slightly more than the unit cube, so that no ray passes between two voxels.
    constexpr float slack = 1e-4f;
    float from = ray.near, to = ray.far;
    for (std::size_t axis = 0; axis < 3; ++axis) {
        const float a = (-slack - o[axis]) / d[axis], b = (1 + slack - o[axis]) / d[axis];
        if (std::isnan(a) || std::isnan(b)) return infinity; // along a face's plane, far from the voxel
        from = std::max(from, std::min(a, b));
        to = std::min(to, std::max(a, b));
    }
    if (!(from < to)) return infinity;
    const float unit = unit_scale(max_component(abs(d))); // of the ray's parameter: about a voxel
    const auto root = first_root(along_ray(corner_values(corner), o + d * from, d * unit),
                                 static_cast<double>(to - from) / static_cast<double>(unit));
    if (!root) return infinity;
    const float t = from + static_cast<float>(*root) * unit;
    return t > ray.near && t < ray.far ? t : infinity;
}

float SdfGrid::interpolated(Vec3f p) const {
    std::uint32_t at[3];
    float w[3];
    for (std::size_t axis = 0; axis < 3; ++axis) {
        const float clamped = std::clamp(p[axis], 0.0f, static_cast<float>(size_[axis] - 1));
        at[axis] = std::min(static_cast<std::uint32_t>(clamped), size_[axis] - 2);
        w[axis] = clamped - static_cast<float>(at[axis]);
    }
    const auto f = corner_values({at[0], at[1], at[2]});
    const auto along_x = [&](std::size_t i) { return lerp(w[0], f[i], f[i + 1]); };
    return lerp(w[2], lerp(w[1], along_x(0), along_x(2)), lerp(w[1], along_x(4), along_x(6)));
}

Vec3f SdfGrid::difference(Vec3f p, Vec3f low) const {
    const auto across = [&](std::size_t axis) {
        Vec3f first = p, second = p;
        first[axis] = low[axis], second[axis] = low[axis] + 1;
        return interpolated(second) - interpolated(first);
    };
    return {across(0), across(1), across(2)};
}

// Section 4 of the paper: the unit normals of the eight voxels around the corner next to p, weighted
// trilinearly between the voxels' centres. Voxels outside the grid are ignored. Units are those of the cube,
// as in Mitsuba 3.
Vec3f SdfGrid::smooth_gradient(Vec3f p) const {
    const Vec3f corner{std::round(p.x), std::round(p.y), std::round(p.z)};
    const Vec3f weight = p - corner + Vec3f(0.5f);
    const Vec3f voxels{static_cast<float>(size_[0] - 1), static_cast<float>(size_[1] - 1),
                       static_cast<float>(size_[2] - 1)};
    Vec3f sum(0);
    for (unsigned i = 0; i < 8; ++i) {
        const Vec3f step{i & 1 ? 1.0f : 0.0f, i & 2 ? 1.0f : 0.0f, i & 4 ? 1.0f : 0.0f};
        const Vec3f low = corner + step - Vec3f(1);
        float share = 1;
        for (std::size_t axis = 0; axis < 3; ++axis) {
            const bool outside = low[axis] < 0 || low[axis] + 1 > static_cast<float>(size_[axis] - 1);
            const bool alone = corner[axis] < 1 || corner[axis] + 1 > static_cast<float>(size_[axis] - 1);
            share *= outside ? 0 : alone ? 1 : step[axis] > 0 ? weight[axis] : 1 - weight[axis];
        }
        if (share <= 0) continue;
        const Vec3f normal = difference(p, low) * voxels;
        const float l = length(normal);
        if (l > 0) sum += normal * (share / l);
    }
    return world_to_voxels_.transposed_vector(sum / voxels);
}

// Half the divergence of the unit gradient (Goldman 2005, "Curvature formulas for implicit curves and
// surfaces", equation 4.2), from differences over the adjacent voxels.
float SdfGrid::mean_curvature(Vec3f p) const {
    const auto at = [&](std::size_t a, float step_a, std::size_t b, float step_b) {
        Vec3f q = p;
        q[a] += step_a, q[b] += step_b;
        return interpolated(q);
    };
    float hessian[3][3];
    Vec3f gradient;
    const float middle = interpolated(p);
    for (std::size_t a = 0; a < 3; ++a) {
        const float next = at(a, 1, a, 0), before = at(a, -1, a, 0);
        gradient[a] = (next - before) / 2;
        hessian[a][a] = next - 2 * middle + before;
        for (std::size_t b = 0; b < a; ++b)
            hessian[a][b] = hessian[b][a] =
                (at(a, 1, b, 1) - at(a, 1, b, -1) - at(a, -1, b, 1) + at(a, -1, b, -1)) / 4;
    }
    const auto form = [&](Vec3f v) {
        float sum = 0;
        for (std::size_t a = 0; a < 3; ++a)
            for (std::size_t b = 0; b < 3; ++b) sum += hessian[a][b] * v[a] * v[b];
        return sum;
    };
    const Vec3f g = world_to_voxels_.transposed_vector(gradient);
    const float trace =
        form(world_to_voxels_.axis(0)) + form(world_to_voxels_.axis(1)) + form(world_to_voxels_.axis(2));
    const float squared = length_squared(g);
    return squared > 0
               ? (squared * trace - form(world_to_voxels_.vector(g))) / (2 * squared * std::sqrt(squared))
               : 0;
}

void SdfGrid::fill(const Ray<float> &ray, const RayHit &found, const HitNeeds &, Hit<float> &hit) const {
    const Corner &corner = voxels_[found.primitive];
    const Vec3f low{static_cast<float>(corner[0]), static_cast<float>(corner[1]),
                    static_cast<float>(corner[2])};
    Vec3f p = world_to_voxels_.point(ray.origin + ray.direction * found.distance);
    Vec3f gradient = difference(p, low);
    if (const float slope = length(gradient); slope > 0) // onto the surface, by Newton's method
        p -= gradient * (std::clamp(interpolated(p) / slope, -1e-2f, 1e-2f) / slope);

    const Vec3f scaled_normal = world_to_voxels_.transposed_vector(gradient);
    const float l = length(scaled_normal);
    hit.normal = l > 0 ? scaled_normal / l : -normalize(ray.direction);
    hit.position = voxels_to_world_.point(p);
    const float stretch = l > 0 ? l / length(gradient) : 1; // of distances: voxel units per world unit
    hit.position_error = position_error(largest_term(world_to_voxels_, hit.position)) / stretch +
                         position_error(largest_term(voxels_to_world_, p));
    const Vec3f smooth = normals == SdfNormals::smooth ? smooth_gradient(p) : Vec3f(0);
    const float smooth_length = length(smooth);
    hit.shading_normal = smooth_length > 0 ? smooth / smooth_length : hit.normal;
    hit.uv = hit.barycentric = {0, 0};
    const Frame<float> tangents = frame_around(hit.normal);
    hit.dp_du = tangents.s, hit.dp_dv = tangents.t;
    const float curvature = mean_curvature(p); // all that is known: taken as that of a sphere
    hit.dn = {hit.dp_du * curvature, hit.dp_dv * curvature};
}

} // namespace lajolla
