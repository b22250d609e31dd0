#pragma once
// Light between two vertices.

#include "scene/scene.h"
#include "transport/media.h"

namespace lajolla {

// The maximum number of surfaces that a path or shadow ray passes straight through, so that all end.
inline constexpr int max_null_transmissions = 1024;
// The same for shadow rays that ignore some surfaces.
inline constexpr int max_ignored = 1 << 16;

// A ray from a point to a sampled light, ending before its surface. `light.target` is beyond the rounding
// error of the light's coordinates; the ray's end also beyond that of a distant point's coordinates.
template <class Float>
Ray<Float> shadow_ray(const Vec3<Float> &origin, Float origin_error, const DirectSample<Float> &light) {
    const auto distant = light.distance == infinity;
    const Float far = min(1 - origin_error / light.distance, Float(one_minus_ulp));
    return {origin, select(distant, light.wi, light.target - origin), 0,
            select(distant, Float(infinity), far)};
}

// Multiplies a shadow ray's transmittance by that of a surface; returns false if it is opaque.
template <class Medium>
bool pass(const Scene &scene, const Hit<float> &hit, const DirectSample<float> &light, auto &&attenuate,
          Medium &medium, typename Medium::Transmittance &result) {
    const NullTransmission<float> through = scene.null_transmission(hit, -light.wi);
    if (through.probability == 0) return false;
    attenuate();
    result.pass(through);
    medium.cross(hit, light.wi);
    return true;
}

inline constexpr auto no_surface = [](const Hit<float> &) { return false; };

// The transmittance of a shadow ray to a sampled light, starting with its first hit `found`; nullopt if an
// opaque surface is in between, of those that are not ignored. `error` is the position error of the vertex:
// each part of the ray ends before the light by at least this.
template <class Medium, class Ignored = decltype(no_surface)>
std::optional<typename Medium::Transmittance>
transmittance(const Scene &scene, Tracer &tracer, Ray<float> ray, std::optional<RayHit> found, float error,
              const DirectSample<float> &light, Medium medium, typename Medium::Transmittance result = {},
              Ignored ignored = no_surface) {
    const auto attenuate = [&](float t) {
        medium.attenuate(scene, {ray.origin, light.wi, 0, t * length(ray.direction)}, result);
    };
    for (int passed = 0, met = 0; found; ++met) {
        const Hit<float> hit = scene.hit(ray, *found, scene.needs());
        if (met == max_ignored) return std::nullopt;
        if (!ignored(hit)) {
            const bool passes = passed++ < max_null_transmissions &&
                                pass(
                                    scene, hit, light, [&] { attenuate(found->distance); }, medium, result);
            if (!passes) return std::nullopt;
        }
        ray = shadow_ray(leave(hit, light.wi), error, light);
        if (dot(ray.direction, light.wi) <= 0) return result;
        found = tracer.closest(ray);
    }
    attenuate(ray.far);
    return result;
}

// The same for the shadow ray from a vertex. `medium` provides the random numbers for this ray.
template <class Vertex, class Medium>
std::optional<typename Medium::Transmittance> transmittance(const Scene &scene, Tracer &tracer,
                                                            const Vertex &vertex,
                                                            const DirectSample<float> &light, Medium medium) {
    vertex.enter(medium, light.wi);
    const float error = vertex.position_error();
    Vec3f origin = vertex.leave(light.wi);
    typename Medium::Transmittance result;
    if constexpr (Medium::present)
        if (const auto surface = medium.attenuate_to_surface(scene, light.wi, result)) {
            if (!pass(
                    scene, *surface, light, [] {}, medium, result))
                return std::nullopt;
            origin = leave(*surface, light.wi);
        }
    const Ray<float> ray = shadow_ray(origin, error, light);
    std::optional<RayHit> found;
    if (scene.has_null_transmission()) found = tracer.closest(ray);
    else if (tracer.occluded(ray)) return std::nullopt;
    return transmittance(scene, tracer, ray, found, error, light, medium, result);
}

} // namespace lajolla
