#pragma once
// The alpha channel.

#include "transport/camera_sample.h"
#include "transport/media.h"
#include "transport/visibility.h"

namespace lajolla {

// Alpha as in Mitsuba 3: 1 where a camera ray scatters or sees a light that is not hidden, 0 where it leaves
// the scene. What lets a ray pass straight through is not there; the random numbers are those of the path,
// and so is `medium`, which is in its first state.
template <class Medium>
float coverage(const Scene &scene, Tracer &tracer, PrimaryRay &primary, bool hide_emitters, Medium medium) {
    if (!hide_emitters && scene.lights().has_environment()) return 1;
    Ray<float> ray = primary.camera().ray;
    RayCone<float> cone = primary.camera().cone;
    float flight = primary.camera().flight;
    auto found = primary.found();
    for (int passages = 0; passages <= max_null_transmissions; ++passages) {
        if constexpr (Medium::present)
            if (medium.current >= 0) {
                Ray<float> piece = ray;
                piece.near = 0; // as of paths: a camera's near plane hides surfaces, not the medium before it
                if (found) piece.far = found->distance;
                if (medium.fly(scene, piece, flight).collision) return 1;
            }
        if (!found) return 0;
        const Hit<float> hit = scene.hit(ray, *found, cone);
        if (hit.emitter >= 0 && !hide_emitters) return 1;
        const bool hidden = hit.emitter >= 0;
        if (!passes(null_transmission_at(scene, hit, ray.direction, hidden).probability, flight)) return 1;
        ray = {leave(hit, ray.direction), ray.direction, 0, ray.far - hit.distance};
        cone = hit.footprint;
        medium.cross(hit, ray.direction);
        found = tracer.closest(ray);
    }
    return 0;
}

} // namespace lajolla
