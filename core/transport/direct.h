#pragma once
// Light scattered at most once, with any number of light samples and BSDF samples per camera ray.

#include <algorithm>
#include <stdexcept>

#include "transport/path.h"

namespace lajolla {

struct Direct {
    static constexpr const char *name = "direct";
    static constexpr const char *doc =
        "Light that is scattered at most once, with one or more samples per camera ray.";
    int emitter_samples = 1, bsdf_samples = 1;
    bool hide_emitters = false;

    static constexpr auto fields() {
        return std::tuple(
            field("emitter_samples", &Direct::emitter_samples, "samples of lights per camera ray; 0 for none")
                .range(0, 65536),
            field("bsdf_samples", &Direct::bsdf_samples, "samples of the BSDF per camera ray; 0 for none")
                .range(0, 65536),
            field("hide_emitters", &Direct::hide_emitters, "lights are invisible to the camera"));
    }

    void build() {
        if (emitter_samples + bsdf_samples == 0)
            throw std::invalid_argument("emitter_samples and bsdf_samples are both 0");
        path_.hide_emitters = hide_emitters;
        path_.strategy = emitter_samples == 0 ? Strategy::bsdf
                         : bsdf_samples == 0  ? Strategy::light
                                              : Strategy::mis;
    }

    Spectrum radiance(const Scene &scene, Tracer &tracer, const Sampler &sampler, PrimaryRay &primary,
                      const LightGroups &groups = {}) const;

private:
    // n samples of a strategy are weighted as if its density were n times as high (Veach 1997, section
    // 9.2.2). Only the ratio of the two counts matters: it is a factor of the density of paths.
    float directions_per_light() const {
        return static_cast<float>(bsdf_samples) / static_cast<float>(emitter_samples);
    }
    // Follows a path through transparent surfaces, and calls scatter_at(hit) at the first other one.
    template <class F>
    void follow(const Scene &scene, Tracer &tracer, std::optional<RayHit> found, Path::Walk<Vacuum> &walk,
                F &&scatter_at) const;
    Spectrum scattered_at(const Scene &scene, Tracer &tracer, const Sampler &sampler,
                          const PathState<float> &path, const Hit<float> &hit,
                          const LightGroups &groups) const;
    Spectrum sample_bsdf(const Scene &scene, Tracer &tracer, const Hit<float> &hit, const AnySurface &surface,
                         const BounceSample<float> &u, const LightGroups &groups) const;

    Path path_; // for its estimators
};

template <class F>
void Direct::follow(const Scene &scene, Tracer &tracer, std::optional<RayHit> found, Path::Walk<Vacuum> &walk,
                    F &&scatter_at) const {
    for (; found; found = tracer.closest(walk.path.ray)) {
        const Hit<float> hit = scene.hit(walk.path.ray, *found, walk.path.footprint, scene.needs());
        const Path::Outcome outcome = path_.meet(scene, hit, walk);
        if (outcome == Path::Outcome::stopped) return scatter_at(hit);
        if (outcome != Path::Outcome::passed) return;
    }
    path_.leave_scene(scene, walk);
}

inline Spectrum Direct::sample_bsdf(const Scene &scene, Tracer &tracer, const Hit<float> &hit,
                                    const AnySurface &surface, const BounceSample<float> &u,
                                    const LightGroups &groups) const {
    const BsdfSample<float> sample = surface.sample(u.lobe, u.bsdf_uv);
    if (!sample.valid) return Spectrum(0);
    Path::Walk<Vacuum> walk{{}, {}, Spectrum(0), groups};
    walk.path =
        Path::scattered(scene, walk.path, hit, surface.departure(hit, sample.wi), sample, surface.delta);
    walk.path.pdf *= directions_per_light();
    walk.path.u_event = u.event;
    follow(scene, tracer, tracer.closest(walk.path.ray), walk, [](const Hit<float> &) {});
    return walk.radiance;
}

inline Spectrum Direct::scattered_at(const Scene &scene, Tracer &tracer, const Sampler &sampler,
                                     const PathState<float> &path, const Hit<float> &found,
                                     const LightGroups &groups) const {
    const Vec3f wo = -path.ray.direction;
    Hit<float> hit = found;
    lower_lift(tracer, true, hit);
    const AnySurface chosen = scene.surface(hit, wo, path.u_event);
    const auto number = [&](int i) { return sampler.bounce(static_cast<std::uint32_t>(i)); };
    const float light_share = 1 / static_cast<float>(std::max(emitter_samples, 1)),
                direction_share = 1 / static_cast<float>(std::max(bsdf_samples, 1));
    Spectrum lights{0}, directions{0};
    scene.for_each_surface(hit, wo, chosen, [&](const AnySurface &surface, float share) {
        if (surface.black || surface.delta) return;
        for (int i = 1; i <= emitter_samples; ++i)
            for_each_vertex(hit, surface, [&](const auto &vertex) {
                lights += share * path_.direct_light(scene, tracer, vertex, number(i), Vacuum(),
                                                     groups.times(Spectrum(share * light_share)),
                                                     directions_per_light());
            });
    });
    for (int i = 1; i <= bsdf_samples && !chosen.black; ++i)
        directions +=
            sample_bsdf(scene, tracer, hit, chosen, number(i), groups.times(Spectrum(direction_share)));
    return lights * light_share + directions * direction_share;
}

inline Spectrum Direct::radiance(const Scene &scene, Tracer &tracer, const Sampler &sampler,
                                 PrimaryRay &primary, const LightGroups &groups) const {
    Path::Walk<Vacuum> walk{Path::start(scene, primary.camera(), primary.footprint()), Vacuum(), Spectrum(0),
                            groups};
    follow(scene, tracer, primary.found(), walk, [&](const Hit<float> &hit) {
        const Spectrum &throughput = walk.path.throughput;
        walk.radiance +=
            throughput * scattered_at(scene, tracer, sampler, walk.path, hit, walk.groups.times(throughput));
    });
    return walk.radiance;
}

} // namespace lajolla
