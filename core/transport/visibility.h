#pragma once
// Light between two vertices.

#include "scene/scene.h"

namespace lajolla {

// More surfaces in a row than any scene has a use for; a path that passes more is ended, so that none lasts
// forever.
inline constexpr int max_passages = 1024;

// Whether a ray passes straight through a surface that lets the fraction `passage` through, decided by a
// uniform number that stays uniform and fit for the next decision.
inline bool passes(float passage, float &u) {
    if (passage <= 0) return false;
    const bool result = u < passage;
    u = result ? u / passage : (u - passage) / (1 - passage);
    u = std::min(u, one_minus_ulp);
    return result;
}

// From a point towards a sampled light, ending before its surface. `light.target` clears the error of the
// light's own coordinates; the end clears those of a far away viewer's too.
inline Ray shadow_ray(const Vec3f &origin, float origin_error, const DirectSample &light) {
    if (light.distance == infinity) return {origin, light.wi, 0, infinity};
    return {origin, light.target - origin, 0, std::min(1 - origin_error / light.distance, one_minus_ulp)};
}

// The fraction of a sampled light that reaches a hit.
inline float transmittance(const Scene &scene, Tracer &tracer, const Hit &hit, const DirectSample &light) {
    Ray ray = shadow_ray(leave(hit, light.wi), hit.position_error, light);
    if (!scene.has_passages()) return tracer.occluded(ray) ? 0.0f : 1.0f;

    float result = 1;
    for (int passages = 0; passages < max_passages; ++passages) {
        const auto found = tracer.closest(ray);
        if (!found) return result;
        const Hit surface = scene.hit(ray, *found, {});
        result *= scene.passage(surface);
        if (result == 0) return 0;
        ray = shadow_ray(leave(surface, light.wi), hit.position_error, light);
        if (dot(ray.direction, light.wi) <= 0) return result;
    }
    return 0;
}

} // namespace lajolla
