#pragma once
// What a camera ray sees: the alpha channel, and the object at which the ray ends.

#include "transport/path.h"

namespace lajolla {

// The end of a camera ray. Without a surface, that is a collision in a medium, or nothing if the ray leaves
// the scene.
struct Seen {
    std::optional<SeenSurface> surface;
    CameraRole role = CameraRole::object; // of the surface
    bool collision = false;

    // The surface, if it is not a hole.
    std::optional<SeenSurface> object() const { return role == CameraRole::object ? surface : std::nullopt; }
};

// Follows a camera ray, which `found` its first hit, to where it scatters or hits a light that is not hidden.
// Surfaces that it passes straight through do not count. Random numbers and `medium`, in its initial state,
// are those of the path; in the end, `medium` is where the ray ends. `footprint` matters if filtered textures
// are read there.
template <class Medium>
Seen look(const Scene &scene, Tracer &tracer, const CameraRay<float> &camera, std::optional<RayHit> found,
          const Sight &sight, Medium &&medium, const HitNeeds &needs,
          FootprintKind footprint = FootprintKind::cone) {
    PathState<float> path = Path::start(scene, camera, footprint);
    while (path.null_transmissions <= max_null_transmissions) {
        if (medium.fly(scene, path.ray, found, path.u_event).collision) return {{}, {}, true};
        if (!found) break;
        Hit<float> hit = scene.hit(path.ray, *found, path.footprint, needs);
        const CameraRole role = scene.camera_role(hit.shape, hit.instance, sight.through_lights);
        const bool hidden = role == CameraRole::nothing, passed = path.null_transmissions > 0;
        const bool stops = !hidden && (!sight.through_surfaces || Path::shines(hit, role));
        if (stops || !Path::passes_through(scene, hit, hidden, path, medium)) {
            if (passed) hit.distance = length(hit.position - camera.ray.origin);
            return {SeenSurface{*found, hit, path.u_event}, role};
        }
        found = tracer.closest(path.ray);
    }
    return {};
}

// The object that a camera ray ends at, shared by all that ask for it with the same sight.
inline const std::optional<SeenSurface> &seen_object(const Scene &scene, Tracer &tracer, PrimaryRay &primary,
                                                     const Sight &sight) {
    return primary.seen(sight, [&] {
        return look(scene, tracer, primary.camera(), primary.found(), sight, Vacuum(), HitNeeds{},
                    primary.footprint())
            .object();
    });
}

// Alpha as in Mitsuba 3: 1 if a camera ray scatters or hits a light that is not hidden, 0 if it leaves the
// scene without seeing environment light; and 0 in holes.
template <class Medium>
float coverage(const Scene &scene, Tracer &tracer, PrimaryRay &primary, bool hide_emitters, Medium medium) {
    const bool backdrop = !hide_emitters && scene.lights().shows_environment();
    if (backdrop && !scene.has_camera_roles()) return 1;
    const Seen seen =
        look(scene, tracer, primary.camera(), primary.found(), {hide_emitters}, medium, scene.needs());
    const bool covered = seen.surface ? seen.role == CameraRole::object : seen.collision || backdrop;
    return covered ? 1.0f : 0.0f;
}

} // namespace lajolla
