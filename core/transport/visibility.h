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

// The fraction of a sampled light that reaches a hit.
inline float transmittance(const Scene &scene, Tracer &tracer, const Hit &hit, const DirectSample &light) {
    const Vec3f origin = leave(hit, light.wi);
    const bool distant = light.distance == infinity;
    Ray ray{origin, distant ? light.wi : light.target - origin, 0, distant ? infinity : one_minus_ulp};
    if (!scene.has_passages()) return tracer.occluded(ray) ? 0.0f : 1.0f;

    float result = 1;
    for (int passages = 0; passages < max_passages; ++passages) {
        const auto found = tracer.closest(ray);
        if (!found) return result;
        const Hit surface = scene.hit(ray, *found, {});
        result *= scene.passage(surface);
        if (result == 0) return 0;
        const Vec3f next = leave(surface, light.wi);
        ray = {next, distant ? light.wi : light.target - next, 0, ray.far};
        if (!distant && dot(ray.direction, light.wi) <= 0) return result;
    }
    return 0;
}

} // namespace lajolla
