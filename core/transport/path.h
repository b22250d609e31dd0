#pragma once
// Path tracing: emission is gathered along paths that grow from the camera, by sampling lights and by
// sampling BSDFs, combined with multiple importance sampling (Veach 1997, chapters 8 to 10).

#include <array>

#include "base/fields.h"
#include "base/sampler.h"
#include "scene/scene.h"
#include "transport/visibility.h"

namespace lajolla {

// Which estimators of direct light are used; all have the same mean.
enum class Strategy { mis, bsdf, light };
constexpr auto choices(Strategy) { return std::array{"mis", "bsdf", "light"}; }

// Where roulette sets in at the latest, so that no path lasts for ever.
inline constexpr int longest_without_roulette = 4096;

struct Path {
    static constexpr const char *name = "path";
    static constexpr const char *doc = "Path tracing with light sampling and BSDF sampling.";
    int max_depth = -1, rr_depth = 5;
    bool hide_emitters = false;
    Strategy strategy = Strategy::mis;

    static constexpr auto fields() {
        return std::tuple(
            field("max_depth", &Path::max_depth,
                  "longest path in segments: 1 shows lights only, 2 direct light; -1 for no limit")
                .range(-1),
            field("rr_depth", &Path::rr_depth, "bounces before Russian roulette may end a path, 4096 at most")
                .range(0),
            field("hide_emitters", &Path::hide_emitters, "the camera looks through lights"),
            field("strategy", &Path::strategy, "sample lights, BSDFs, or both weighted by their densities"));
    }

    Spectrum radiance(const Scene &scene, Tracer &tracer, const Sampler &sampler,
                      const CameraRay &camera) const;

private:
    // Where a ray came from: what the weight of a light that it hits depends on.
    struct Departure {
        Vec3f position;
        float pdf;
        bool delta; // light sampling had no chance to find this direction
    };

    // The weight of radiance found by hitting a light that light sampling picks with density `light_pdf`.
    float weight_of_hit(const Departure &from, float light_pdf) const;
    // The weight of radiance found by sampling a light towards which the BSDF scatters with density
    // `bsdf_pdf`.
    float weight_of_light(const DirectSample &light, float bsdf_pdf) const;

    // Light that arrives at the surface straight from a sampled point on a light, and is scattered towards
    // wo.
    Spectrum direct(const Scene &scene, Tracer &tracer, const Hit &hit, const Surface &surface,
                    const BounceSample &u) const;
};

// Veach 1997, equation 9.13 with beta = 2, for one sample of each strategy.
inline float power_heuristic(float pdf, float other_pdf) {
    const float ratio = other_pdf / pdf;
    return 1 / (1 + ratio * ratio);
}

inline float Path::weight_of_hit(const Departure &from, float light_pdf) const {
    if (from.delta || strategy == Strategy::bsdf) return 1;
    if (strategy == Strategy::light) return light_pdf > 0 ? 0 : 1;
    return power_heuristic(from.pdf, light_pdf);
}

inline float Path::weight_of_light(const DirectSample &light, float bsdf_pdf) const {
    if (light.delta || strategy == Strategy::light) return 1;
    return strategy == Strategy::bsdf ? 0 : power_heuristic(light.pdf, bsdf_pdf);
}

inline Spectrum Path::direct(const Scene &scene, Tracer &tracer, const Hit &hit, const Surface &surface,
                             const BounceSample &u) const {
    if (surface.sharp || scene.lights().empty()) return Spectrum(0);
    const DirectSample light = scene.lights().sample_direct(hit.position, u.light, u.light_uv);
    if (light.pdf == 0) return Spectrum(0);
    const BsdfEval bsdf = eval(surface.lobe, surface.wo, surface.frame.to_local(light.wi));
    const float weight = weight_of_light(light, bsdf.pdf);
    if (is_black(bsdf.f_cos) || weight == 0) return Spectrum(0);
    const float visible = transmittance(scene, tracer, hit, light);
    return bsdf.f_cos * light.radiance * (visible * weight / (light.pdf * sqr(bsdf.eta)));
}

inline Spectrum Path::radiance(const Scene &scene, Tracer &tracer, const Sampler &sampler,
                               const CameraRay &camera) const {
    Ray ray = camera.ray;
    RayCone cone = camera.cone;
    Spectrum radiance(0), throughput(1);
    Departure from{ray.origin, 1, true};
    float eta = 1;                // of the medium the ray is in, relative to the camera's
    float flight = camera.flight; // decides what happens between two vertices
    int passages = 0;             // surfaces that the path went straight through

    for (int depth = 1; depth <= max_depth || max_depth < 0;) {
        // Drawn before the ray is traced: the processor computes both at once.
        const BounceSample u = sampler.bounce(static_cast<std::uint32_t>(depth));
        const auto found = tracer.closest(ray);
        if (!found) {
            if (depth > 1 || !hide_emitters)
                radiance +=
                    throughput * scene.lights().environment(ray.direction) *
                    weight_of_hit(from, from.delta ? 0 : scene.lights().pdf_environment(ray.direction));
            break;
        }
        const Hit hit = scene.hit(ray, *found, cone);
        const Vec3f wo = -ray.direction;
        const bool hidden = hide_emitters && depth == 1 && hit.emitter >= 0;
        if (hit.emitter >= 0 && !hidden)
            radiance += throughput * scene.lights().emitted(hit, wo) *
                        weight_of_hit(
                            from, from.delta ? 0 : scene.lights().pdf_hit(from.position, hit, ray.direction));

        if (hidden || (scene.has_passages() && passes(scene.passage(hit), flight))) {
            if (++passages > max_passages) break;
            ray = {leave(hit, ray.direction), ray.direction, 0, ray.far - hit.distance};
            cone = hit.footprint;
            continue;
        }
        if (depth == max_depth) break;

        const Surface surface = scene.surface(hit, wo);
        if (surface.black) break;
        radiance += throughput * direct(scene, tracer, hit, surface, u);

        const auto scattered = sample(surface.lobe, surface.wo, u.lobe, u.bsdf_uv);
        if (!scattered) break;
        // Radiance over eta^2 is what stays constant along a ray that refracts (Veach 1997, section 5.2).
        throughput *= scattered->weight;
        if (scattered->eta != 1) {
            throughput /= sqr(scattered->eta);
            eta *= scattered->eta;
        }
        if (!is_finite(throughput)) [[unlikely]]
            return throughput; // whoever takes the sample counts it
        from.position = hit.position;
        from.pdf = scattered->pdf;
        from.delta = surface.sharp || scattered->is_delta();
        ray.direction = surface.frame.to_world(scattered->wi);
        ray.origin = leave(hit, ray.direction);
        ray.near = 0;
        ray.far = infinity;
        if (scene.reads_footprints())
            cone = scattered->kind == ScatterKind::null
                       ? hit.footprint
                       : hit.footprint.scattered(hit.mean_curvature, scattered->width(), scattered->eta);

        ++depth;
        flight = u.flight;
        // Roulette on the throughput without its eta^2, so that entering glass does not make paths die.
        const float survival = std::min(max_component(throughput) * sqr(eta), 0.95f);
        if (depth > std::min(rr_depth, longest_without_roulette)) {
            if (u.roulette >= survival) break;
            throughput /= survival;
        }
    }
    return radiance;
}

} // namespace lajolla
