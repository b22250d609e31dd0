#pragma once
// Light between two vertices.

#include "scene/scene.h"
#include "transport/media.h"

namespace lajolla {

// More surfaces than any scene has a use for; a path or shadow ray that goes straight through more is ended,
// so that none lasts forever.
inline constexpr int max_null_transmissions = 1024;

// What passes straight through a surface that a path hits, all of it through a light that it shall not see.
inline NullTransmission<float> null_transmission_at(const Scene &scene, const Hit<float> &hit,
                                                    const Vec3f &direction, bool hidden) {
    if (hidden) return {Spectrum(1), 1};
    return scene.has_null_transmission() ? scene.null_transmission(hit, -direction)
                                         : NullTransmission<float>{};
}

// From a point towards a sampled light, ending before its surface. `light.target` clears the error of the
// light's own coordinates; the end clears those of a far away viewer's too.
template <class Float>
Ray<Float> shadow_ray(const Vec3<Float> &origin, Float origin_error, const DirectSample<Float> &light) {
    const auto distant = light.distance == infinity;
    const Float far = min(1 - origin_error / light.distance, Float(one_minus_ulp));
    return {origin, select(distant, light.wi, light.target - origin), 0,
            select(distant, Float(infinity), far)};
}

// What remains of a sampled light at a vertex; nothing where something opaque is in between. `medium` draws
// its numbers for this ray.
template <class Vertex, class Medium>
std::optional<typename Medium::Light> arrival(const Scene &scene, Tracer &tracer, const Vertex &vertex,
                                              const DirectSample<float> &light, Medium medium) {
    typename Medium::Light result;
    const auto attenuate = [&](const Ray<float> &ray, float t) {
        medium.attenuate(scene, {ray.origin, light.wi, 0, t * length(ray.direction)}, result);
    };
    vertex.enter(medium, light.wi);
    Ray<float> ray = shadow_ray(vertex.leave(light.wi), vertex.position_error(), light);
    if (!scene.has_null_transmission()) {
        if (tracer.occluded(ray)) return std::nullopt;
        attenuate(ray, ray.far);
        return result;
    }
    for (int count = 0; count < max_null_transmissions; ++count) {
        const auto found = tracer.closest(ray);
        if (!found) {
            attenuate(ray, ray.far);
            return result;
        }
        const Hit<float> surface = scene.hit(ray, *found, {}, scene.needs());
        const NullTransmission<float> through = scene.null_transmission(surface, -light.wi);
        if (through.probability == 0) break;
        attenuate(ray, found->distance);
        result.pass(through);
        medium.cross(surface, light.wi);
        ray = shadow_ray(leave(surface, light.wi), vertex.position_error(), light);
        if (dot(ray.direction, light.wi) <= 0) return result;
    }
    return std::nullopt;
}

} // namespace lajolla
