#pragma once
// Shadow catchers stand for surfaces of a photograph, behind the picture when both are composed. Of each
// camera ray that ends at one, the direct light that it scatters to the camera is estimated twice from the
// same light samples: with all shapes and media, and with catchers and lights alone, as when the photograph
// was taken. The ratio of the sums over a pixel is what shadows leave of the photograph there (Debevec 1998,
// "Rendering Synthetic Objects into Real Scenes", section 6, which adds the difference instead). The noise of
// both cancels where there is no shadow.

#include "transport/coverage.h"

namespace lajolla {

// Of a sample.
struct CaughtLight {
    bool seen = false;                  // whether the camera ray ends at a catcher
    float shadowed = 0, unshadowed = 0; // luminance with all shapes, and with those of the photograph
};

// The transmittance of a shadow ray on which only surfaces of the photograph are.
template <class Vertex>
Spectrum transmittance_in_photograph(const Scene &scene, Tracer &tracer, const Vertex &vertex,
                                     const DirectSample<float> &light) {
    const float error = vertex.position_error();
    const Ray<float> ray = shadow_ray(vertex.leave(light.wi), error, light);
    const auto arriving = transmittance(scene, tracer, ray, tracer.closest(ray), error, light, Vacuum(), {},
                                        [&](const Hit<float> &hit) { return !scene.is_in_photograph(hit); });
    return arriving ? arriving->value() : Spectrum(0);
}

// By one light sample, with the random numbers of the path's first vertex; `medium` is that of the camera.
template <class Medium>
CaughtLight caught_light(const Scene &scene, Tracer &tracer, const Sampler &sampler, PrimaryRay &primary,
                         bool hide_emitters, Medium medium) {
    const Seen seen = look(scene, tracer, primary.camera(), primary.found(), {hide_emitters}, medium,
                           scene.needs(), primary.footprint());
    if (seen.role != CameraRole::catcher) return {};
    CaughtLight result{true};
    if (scene.lights().empty()) return result;

    Path by_lights;
    by_lights.strategy = Strategy::light;
    const auto &[found, seen_hit, u_event] = *seen.surface;
    Hit<float> hit = seen_hit;
    lower_lift(tracer, true, hit);
    const Vec3f wo = -primary.camera().ray.direction;
    const BounceSample<float> u = sampler.bounce(1);
    const auto add = [&](const AnySurface &each, float share) {
        if (each.black || each.delta) return;
        for_each_vertex(hit, each, [&](const auto &vertex) {
            const DirectSample<float> light =
                scene.lights().sample_direct(vertex.position(), u.light, u.light_uv);
            if (!by_lights.counts(light) || !vertex.gathers(light.wi)) return;
            const Spectrum value = share * by_lights.direct(light, vertex.eval(light.wi), 1.0f);
            if (is_black(value)) return;
            result.unshadowed += luminance(value * transmittance_in_photograph(scene, tracer, vertex, light));
            const auto arriving =
                transmittance(scene, tracer, vertex, light, medium.for_shadow_ray(sampler, 1));
            if (arriving) result.shadowed += luminance(value * arriving->value());
        });
    };
    scene.for_each_surface(hit, wo, scene.surface(hit, wo, u_event), add);
    return result;
}

} // namespace lajolla
