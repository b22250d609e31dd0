#include "sensors/camera.h"

#include <stdexcept>

namespace lajolla {

namespace {

constexpr float degrees = pi / 180;

// Half the width of the picture at unit distance.
float half_width_of(float fov, FovAxis axis, float aspect) {
    const float half = tan(fov * degrees / 2);
    switch (axis) {
    case FovAxis::y: return half * aspect;
    case FovAxis::diagonal: return half / std::sqrt(1 + 1 / sqr(aspect));
    case FovAxis::smaller: return aspect > 1 ? half * aspect : half;
    case FovAxis::larger: return aspect > 1 ? half : half * aspect;
    default: return half;
    }
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

void Orthographic::build(const CameraFit &fit) {
    require_clip_range(near_clip, far_clip);
    require_invertible(to_world);
    aspect_ = fit.aspect;
    pixel_ = length(to_world.axis(0)) / fit.width;
    step_x_ = to_world.axis(0) * (-2 / fit.width), step_y_ = to_world.axis(1) * (-2 / fit.width);
}

void Spherical::build(const CameraFit &fit) {
    require_invertible(to_world);
    pixel_ = pi / fit.width; // half of the angle at the horizon
    pixel_height_ = pi * fit.aspect / fit.width;
}

void RadianceMeter::build(const CameraFit &) { require_invertible(to_world); }

void Distant::build(const CameraFit &fit) {
    require_invertible(to_world);
    scene_ = fit.scene;
    axes_ = frame_around(normalize(to_world.axis(2)));
}

} // namespace lajolla
