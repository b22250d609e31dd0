#pragma once
// What a camera ray sees: the alpha channel, and the object at which the ray ends.

#include "transport/path.h"

namespace lajolla {

// The end of a camera ray. Without a surface, that is a collision in a medium, or nothing if the ray leaves
// the scene.
struct Seen {
    std::optional<SeenSurface> surface;
    bool collision = false;
};

// Follows a camera ray, which `found` its first hit, to where it scatters or hits a light that is not hidden.
// Surfaces that it passes straight through do not count. Random numbers and `medium`, in its initial state,
// are those of the path.
template <class Medium>
Seen look(const Scene &scene, Tracer &tracer, const CameraRay<float> &camera, std::optional<RayHit> found,
          bool hide_emitters, Medium medium, const HitNeeds &needs) {
    PathState<float> path = Path::start(camera);
    while (path.null_transmissions <= max_null_transmissions) {
        if (medium.fly(scene, path.ray, found, path.u_event).collision) return {{}, true};
        if (!found) break;
        Hit<float> hit = scene.hit(path.ray, *found, path.cone, needs);
        const bool shines = hit.emitter >= 0, passed = path.null_transmissions > 0;
        if ((shines && !hide_emitters) || !Path::passes_through(scene, hit, shines, path, medium)) {
            if (passed) hit.distance = length(hit.position - camera.ray.origin);
            return {SeenSurface{*found, hit, path.u_event}};
        }
        found = tracer.closest(path.ray);
    }
    return {};
}

// Alpha as in Mitsuba 3: 1 if a camera ray scatters or hits a light that is not hidden, 0 if it leaves the
// scene.
template <class Medium>
float coverage(const Scene &scene, Tracer &tracer, PrimaryRay &primary, bool hide_emitters, Medium medium) {
    if (!hide_emitters && scene.lights().has_environment()) return 1;
    const Seen seen =
        look(scene, tracer, primary.camera(), primary.found(), hide_emitters, medium, scene.needs());
    return seen.surface || seen.collision ? 1.0f : 0.0f;
}

} // namespace lajolla
