#pragma once
// Light that was scattered at most once, with any number of samples of lights and of the BSDF per camera ray.

#include <stdexcept>

#include "transport/path.h"

namespace lajolla {

struct Direct {
    static constexpr const char *name = "direct";
    static constexpr const char *doc =
        "Light that was scattered at most once; several samples per camera ray, if wanted.";
    int emitter_samples = 1, bsdf_samples = 1;
    bool hide_emitters = false;

    static constexpr auto fields() {
        return std::tuple(
            field("emitter_samples", &Direct::emitter_samples, "samples of lights per camera ray; 0 for none")
                .range(0, 65536),
            field("bsdf_samples", &Direct::bsdf_samples, "samples of the BSDF per camera ray; 0 for none")
                .range(0, 65536),
            field("hide_emitters", &Direct::hide_emitters, "the camera looks through lights"));
    }

    void build() const {
        if (emitter_samples + bsdf_samples == 0)
            throw std::invalid_argument("emitter_samples and bsdf_samples are both 0");
    }

    Spectrum radiance(const Scene &scene, Tracer &tracer, const Sampler &sampler, PrimaryRay &primary) const;

private:
    // The power heuristic for several samples of each strategy (Veach 1997, section 9.2.2): what one of
    // `count` samples counts, shared between all of them.
    static float share(int count, float pdf, int other_count, float other_pdf) {
        const float n = static_cast<float>(count);
        return power_heuristic(n * pdf, static_cast<float>(other_count) * other_pdf) / n;
    }

    Spectrum sample_light(const Scene &scene, Tracer &tracer, const Hit<float> &hit,
                          const AnySurface &surface, const BounceSample<float> &u) const;
    Spectrum sample_bsdf(const Scene &scene, Tracer &tracer, const Hit<float> &hit, const AnySurface &surface,
                         const BounceSample<float> &u) const;
};

namespace detail {

// A ray's way to the first surface that does not let it pass, and the light met until then.
struct Sight {
    std::optional<Hit<float>> hit;
    Spectrum light{0}, throughput{1};
    float u; // what is left of the random number that decided about passing
};

// Light counts weight(reach, pdf()) times: `reach` is the chance of coming that far through what lets
// rays pass, `pdf` the density of sampling the light from `origin`.
template <class Weight>
Sight look(const Scene &scene, Tracer &tracer, const Vec3f &origin, Ray<float> ray, RayCone<float> cone,
           std::optional<RayHit> found, float flight, bool hide_emitters, Weight &&weight) {
    Sight sight{std::nullopt, Spectrum(0), Spectrum(1), flight};
    float reach = 1;
    for (int passages = 0; passages <= max_null_transmissions; ++passages) {
        if (!found) {
            if (!hide_emitters)
                sight.light += sight.throughput * scene.lights().environment(ray.direction) *
                               weight(reach, [&] { return scene.lights().pdf_environment(ray.direction); });
            break;
        }
        const Hit<float> hit = scene.hit(ray, *found, cone);
        const bool hidden = hide_emitters && hit.emitter >= 0;
        if (hit.emitter >= 0 && !hidden)
            sight.light += sight.throughput * scene.lights().emitted(hit, -ray.direction) *
                           weight(reach, [&] { return scene.lights().pdf_hit(origin, hit, ray.direction); });
        const NullTransmission<float> through = null_transmission_at(scene, hit, ray.direction, hidden);
        if (!passes(through.probability, sight.u)) {
            sight.hit = hit;
            break;
        }
        sight.throughput *= through.transmittance / through.probability;
        reach *= through.probability;
        ray = {leave(hit, ray.direction), ray.direction, 0, ray.far - hit.distance};
        cone = hit.footprint;
        found = tracer.closest(ray);
    }
    return sight;
}

} // namespace detail

inline Spectrum Direct::sample_light(const Scene &scene, Tracer &tracer, const Hit<float> &hit,
                                     const AnySurface &surface, const BounceSample<float> &u) const {
    const DirectSample<float> light = scene.lights().sample_direct(hit.position, u.light, u.light_uv);
    if (light.pdf == 0) return Spectrum(0);
    const SurfaceVertex vertex{hit, surface};
    const BsdfEval<float> bsdf = vertex.eval(light.wi);
    if (is_black(bsdf.f_cos)) return Spectrum(0);
    const auto arrived = arrival(scene, tracer, vertex, light, Vacuum());
    if (!arrived) return Spectrum(0);
    const float bsdf_pdf = light.delta ? 0 : bsdf.pdf * arrived->reach;
    const float weight = share(emitter_samples, light.pdf, bsdf_samples, bsdf_pdf);
    return bsdf.f_cos * light.radiance * arrived->fraction * (weight / (light.pdf * sqr(bsdf.eta)));
}

inline Spectrum Direct::sample_bsdf(const Scene &scene, Tracer &tracer, const Hit<float> &hit,
                                    const AnySurface &surface, const BounceSample<float> &u) const {
    const BsdfSample<float> scattered = surface.sample(u.lobe, u.bsdf_uv);
    if (!scattered.valid) return Spectrum(0);
    const bool alone = surface.sharp || scattered.delta; // light sampling cannot find this direction
    const Vec3f direction = scattered.wi;
    const auto weight = [&](float reach, auto &&light_pdf) {
        return share(bsdf_samples, scattered.pdf * reach, emitter_samples, alone ? 0 : light_pdf());
    };
    const Ray<float> ray{leave(hit, direction), direction, 0, infinity};
    const auto sight = detail::look(scene, tracer, hit.position, ray, hit.footprint, tracer.closest(ray),
                                    u.flight, false, weight);
    return scattered.weight * sight.light / sqr(scattered.eta);
}

inline Spectrum Direct::radiance(const Scene &scene, Tracer &tracer, const Sampler &sampler,
                                 PrimaryRay &primary) const {
    const CameraRay<float> &camera = primary.camera();
    const auto sight =
        detail::look(scene, tracer, camera.ray.origin, camera.ray, camera.cone, primary.found(),
                     camera.flight, hide_emitters, [](float, auto &&) { return 1.0f; });
    if (!sight.hit) return sight.light;
    const Vec3f wo = -camera.ray.direction;
    const AnySurface chosen = scene.surface(*sight.hit, wo, sight.u);
    Spectrum scattered{0};
    const int lights = scene.lights().empty() ? 0 : emitter_samples;
    scene.for_each_surface(*sight.hit, wo, chosen, [&](const AnySurface &surface, float share) {
        if (surface.black || surface.sharp) return;
        for (int i = 1; i <= lights; ++i) {
            const BounceSample<float> u = sampler.bounce(static_cast<std::uint32_t>(i));
            scattered += share * sample_light(scene, tracer, *sight.hit, surface, u);
        }
    });
    for (int i = 1; i <= bsdf_samples && !chosen.black; ++i) {
        const BounceSample<float> u = sampler.bounce(static_cast<std::uint32_t>(i));
        scattered += sample_bsdf(scene, tracer, *sight.hit, chosen, u);
    }
    return sight.light + sight.throughput * scattered;
}

} // namespace lajolla
