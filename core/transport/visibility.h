#pragma once
// Light between two vertices.

#include "scene/scene.h"
#include "transport/media.h"

namespace lajolla {

// More surfaces in a row than any scene has a use for; a path that passes more is ended, so that none lasts
// forever.
inline constexpr int max_passages = 1024;

// What passes straight through a surface that a path hits, all of it through a light that it shall not see.
inline Passage passage_at(const Scene &scene, const Hit &hit, const Vec3f &direction, bool hidden) {
    if (hidden) return {Spectrum(1), 1};
    return scene.has_passages() ? scene.passage(hit, -direction) : Passage{};
}

// From a point towards a sampled light, ending before its surface. `light.target` clears the error of the
// light's own coordinates; the end clears those of a far away viewer's too.
inline Ray shadow_ray(const Vec3f &origin, float origin_error, const DirectSample &light) {
    if (light.distance == infinity) return {origin, light.wi, 0, infinity};
    return {origin, light.target - origin, 0, std::min(1 - origin_error / light.distance, one_minus_ulp)};
}

// What remains of a sampled light at a vertex; nothing where something opaque is in between. `medium` draws
// its numbers for this ray.
template <class Vertex, class Medium>
std::optional<typename Medium::Light> arrival(const Scene &scene, Tracer &tracer, const Vertex &vertex,
                                              const DirectSample &light, Medium medium) {
    typename Medium::Light result;
    const auto attenuate = [&](const Ray &ray, float t) {
        medium.attenuate(scene, {ray.origin, light.wi, 0, t * length(ray.direction)}, result);
    };
    vertex.enter(medium, light.wi);
    Ray ray = shadow_ray(vertex.leave(light.wi), vertex.position_error(), light);
    if (!scene.has_passages()) {
        if (tracer.occluded(ray)) return std::nullopt;
        attenuate(ray, ray.far);
        return result;
    }
    for (int passages = 0; passages < max_passages; ++passages) {
        const auto found = tracer.closest(ray);
        if (!found) {
            attenuate(ray, ray.far);
            return result;
        }
        const Hit surface = scene.hit(ray, *found, {});
        const Passage passage = scene.passage(surface, -light.wi);
        if (passage.probability == 0) break;
        attenuate(ray, found->distance);
        result.pass(passage);
        medium.cross(surface, light.wi);
        ray = shadow_ray(leave(surface, light.wi), vertex.position_error(), light);
        if (dot(ray.direction, light.wi) <= 0) return result;
    }
    return std::nullopt;
}

} // namespace lajolla
