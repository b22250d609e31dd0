#include "scene/camera.h"

#include <stdexcept>

namespace lajolla {

namespace {

constexpr float degrees = pi / 180;

// Half the width of the picture at unit distance.
float half_width_of(float fov, FovAxis axis, float aspect) {
    const float half = std::tan(fov * degrees / 2);
    switch (axis) {
    case FovAxis::y: return half * aspect;
    case FovAxis::diagonal: return half / std::sqrt(1 + 1 / sqr(aspect));
    case FovAxis::smaller: return aspect > 1 ? half * aspect : half;
    case FovAxis::larger: return aspect > 1 ? half : half * aspect;
    default: return half;
    }
}

// A unit-length world ray whose clipping distances were given along camera space directions of length
// `stretch`.
Ray world_ray(const Transform &to_world, Vec3f origin, Vec3f direction, float near, float far) {
    const Vec3f d = to_world.vector(direction);
    const float stretch = length(d);
    return {to_world.point(origin), d / stretch, near * stretch, far * stretch};
}

void require_clip_range(float near, float far) {
    if (!(near < far)) throw std::invalid_argument("near_clip must be smaller than far_clip");
}

void require_invertible(const Transform &to_world) {
    if (!inverse(to_world)) throw std::invalid_argument("to_world of the sensor is singular");
}

} // namespace

void Perspective::build(const CameraFit &fit) {
    require_clip_range(near_clip, far_clip);
    require_invertible(to_world);
    half_width = half_width_of(fov, fov_axis, fit.aspect);
    half_height = half_width / fit.aspect;
    pixel = half_width / fit.width; // half a pixel's width: the radius of its beam at unit distance
}

CameraRay Perspective::leave(Vec3f origin, Vec3f direction) const {
    // `direction` has z = 1, so that the clipping distances are along z. Cones are in units of a unit-length
    // ray.
    return {world_ray(to_world, origin, direction, near_clip, far_clip), {0, pixel / length(direction)}, 0};
}

CameraRay Perspective::generate(Vec2f film, Vec2f) const { return leave(Vec3f(0), through(film)); }

CameraRay ThinLens::generate(Vec2f film, Vec2f lens) const {
    const Vec2f p = sample_disk(lens) * aperture_radius;
    const Vec3f origin{p.x, p.y, 0}, focus = through(film) * focus_distance;
    return leave(origin, (focus - origin) / focus_distance);
}

void Orthographic::build(const CameraFit &fit) {
    require_clip_range(near_clip, far_clip);
    require_invertible(to_world);
    aspect_ = fit.aspect;
    pixel_ = length(to_world.axis(0)) / fit.width;
}

CameraRay Orthographic::generate(Vec2f film, Vec2f) const {
    const Vec3f origin{1 - 2 * film.x, (1 - 2 * film.y) / aspect_, 0};
    CameraRay camera{world_ray(to_world, origin, {0, 0, 1}, near_clip, far_clip), {pixel_, 0}, 0};
    // Orthographic cameras are zoomed by scaling them: that must not bring the far plane nearer.
    camera.ray.far = camera.ray.near + (far_clip - near_clip);
    return camera;
}

// The lens is round in world space, and the focus distance measured there, however the picture is scaled.
CameraRay Telecentric::generate(Vec2f film, Vec2f lens) const {
    CameraRay camera = Orthographic::generate(film, lens);
    const Vec2f p = sample_disk(lens) * aperture_radius;
    const Vec3f offset = normalize(to_world.axis(0)) * p.x + normalize(to_world.axis(1)) * p.y;
    camera.ray.direction = normalize(camera.ray.direction * focus_distance - offset);
    camera.ray.origin += offset;
    return camera;
}

void Spherical::build(const CameraFit &fit) {
    require_invertible(to_world);
    pixel_ = pi / fit.width; // half of the angle at the horizon
}

CameraRay Spherical::generate(Vec2f film, Vec2f) const {
    const float phi = 2 * pi * film.x, theta = pi * film.y, sine = std::sin(theta);
    const Vec3f local{std::sin(phi) * sine, std::cos(theta), -std::cos(phi) * sine};
    return {{to_world.origin(), normalize(to_world.vector(local))}, {0, pixel_}, 0};
}

void RadianceMeter::build(const CameraFit &) { require_invertible(to_world); }

CameraRay RadianceMeter::generate(Vec2f, Vec2f) const {
    return {{to_world.origin(), normalize(to_world.axis(2))}, {}, 0};
}

void Distant::build(const CameraFit &fit) {
    require_invertible(to_world);
    scene_ = fit.scene;
    axes_ = frame_around(normalize(to_world.axis(2)));
}

CameraRay Distant::generate(Vec2f, Vec2f lens) const {
    const Vec2f p = sample_disk(lens) * scene_.radius;
    const Vec3f through = has_target ? target : scene_.center + axes_.s * p.x + axes_.t * p.y;
    const float distance = 2 * scene_.radius + length(through - scene_.center);
    return {{through - axes_.n * distance, axes_.n}, {}, 0};
}

} // namespace lajolla
