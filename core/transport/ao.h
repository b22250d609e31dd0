#pragma once
// Ambient occlusion: the fraction of a uniform sky that is not hidden by nearby surfaces.

#include "base/sampler.h"
#include "base/warp.h"
#include "scene/scene.h"
#include "transport/shadow_catcher.h"

namespace lajolla {

struct AmbientOcclusion {
    static constexpr const char *name = "ao";
    static constexpr const char *doc =
        "Ambient occlusion: white where no surface is nearby; materials are ignored.";
    int shading_samples = 1;
    float ray_length = -1;

    static constexpr auto fields() {
        return std::tuple(
            field("shading_samples", &AmbientOcclusion::shading_samples, "rays per camera ray")
                .range(1, 65536),
            field("ray_length", &AmbientOcclusion::ray_length,
                  "surfaces farther away do not occlude; negative: half the radius of the scene")
                .range(-1)
                .unit("m"));
    }

    // The mean visibility under the cosine-weighted density of directions around the shading normal.
    Spectrum radiance(const Scene &scene, Tracer &tracer, const Sampler &sampler, PrimaryRay &primary) const {
        const Seen seen = look(scene, tracer, primary.camera(), primary.found(), first_surface, Vacuum(), {});
        if (!seen.surface) return Spectrum(1);
        if (!seen.object()) return Spectrum(0);
        const auto occluded = [&](const Ray<float> &ray) { return tracer.occluded(ray); };
        return Spectrum(visibility(scene, sampler, seen.surface->hit, occluded));
    }

    // The light of the sky on a shadow catcher.
    CaughtLight caught_light(const Scene &scene, Tracer &tracer, const Sampler &sampler,
                             PrimaryRay &primary) const {
        const Seen seen = look(scene, tracer, primary.camera(), primary.found(), first_surface, Vacuum(), {});
        if (seen.role != CameraRole::catcher) return {};
        const auto occluded = [&](const Ray<float> &ray) { return tracer.occluded(ray); };
        const auto by_photograph = [&](Ray<float> ray) {
            for (int passed = 0; passed <= max_ignored; ++passed) {
                const auto found = tracer.closest(ray);
                if (!found) return false;
                const Hit<float> hit = scene.hit(ray, *found);
                if (scene.is_in_photograph(hit)) return true;
                ray = {leave(hit, ray.direction), ray.direction, 0, ray.far - hit.distance};
            }
            return true;
        };
        return {true, visibility(scene, sampler, seen.surface->hit, occluded),
                visibility(scene, sampler, seen.surface->hit, by_photograph)};
    }

private:
    // The fraction of rays from a hit that are not occluded.
    float visibility(const Scene &scene, const Sampler &sampler, const Hit<float> &hit,
                     auto &&occluded) const {
        const Frame<float> frame = frame_around(hit.shading_normal);
        const float reach = ray_length < 0 ? scene.bounding_sphere().radius / 2 : ray_length;
        int visible = 0;
        for (int i = 1; i <= shading_samples; ++i) {
            const BounceSample<float> u = sampler.bounce(static_cast<std::uint32_t>(i));
            const Vec3f direction = frame.to_world(sample_cosine_hemisphere(u.bsdf_uv));
            if (!occluded(Ray<float>{leave(hit, direction), direction, 0, reach})) ++visible;
        }
        return static_cast<float>(visible) / static_cast<float>(shading_samples);
    }
};

} // namespace lajolla
