#pragma once
// Ambient occlusion: the fraction of a uniform sky that is not hidden by nearby surfaces.

#include "base/sampler.h"
#include "base/warp.h"
#include "scene/scene.h"
#include "transport/coverage.h"

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
        const Hit<float> &hit = seen.surface->hit;
        const Frame<float> frame = frame_around(hit.shading_normal);
        const float reach = ray_length < 0 ? scene.bounding_sphere().radius / 2 : ray_length;
        int visible = 0;
        for (int i = 1; i <= shading_samples; ++i) {
            const BounceSample<float> u = sampler.bounce(static_cast<std::uint32_t>(i));
            const Vec3f direction = frame.to_world(sample_cosine_hemisphere(u.bsdf_uv));
            if (!tracer.occluded({leave(hit, direction), direction, 0, reach})) ++visible;
        }
        return Spectrum(static_cast<float>(visible) / static_cast<float>(shading_samples));
    }
};

} // namespace lajolla
