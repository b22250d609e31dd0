#pragma once
// The alpha channel.

#include "transport/path.h"

namespace lajolla {

// Alpha as in Mitsuba 3: 1 if a camera ray scatters or hits a light that is not hidden, 0 if it leaves the
// scene. Surfaces that it passes straight through do not count. Random numbers and `medium`, in its initial
// state, are those of the path.
template <class Medium>
float coverage(const Scene &scene, Tracer &tracer, PrimaryRay &primary, bool hide_emitters, Medium medium) {
    if (!hide_emitters && scene.lights().has_environment()) return 1;
    PathState<float> path = Path::start(primary.camera());
    auto found = primary.found();
    while (path.null_transmissions <= max_null_transmissions) {
        if (medium.fly(scene, path.ray, found, path.u_event).collision) return 1;
        if (!found) return 0;
        const Hit<float> hit = scene.hit(path.ray, *found, path.cone, scene.needs());
        const bool shines = hit.emitter >= 0;
        if (shines && !hide_emitters) return 1;
        if (!Path::passes_through(scene, hit, shines, path, medium)) return 1;
        found = tracer.closest(path.ray);
    }
    return 0;
}

} // namespace lajolla
