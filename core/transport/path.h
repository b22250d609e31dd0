#pragma once
// Path tracing: emission is gathered along paths that grow from the camera, by sampling lights and by
// sampling BSDFs and phase functions, combined with multiple importance sampling (Veach 1997, chapters 8 to
// 10). One loop serves surfaces and media; where a scene has no media, the compiler has left them out.

#include <array>

#include "base/fields.h"
#include "base/sampler.h"
#include "scene/scene.h"
#include "transport/media.h"
#include "transport/vertex.h"
#include "transport/visibility.h"

namespace lajolla {

// Which estimators of direct light are used; all have the same mean.
enum class Strategy { mis, bsdf, light };
constexpr auto choices(Strategy) { return std::array{"mis", "bsdf", "light"}; }

// Where roulette sets in at the latest, so that no path lasts for ever.
inline constexpr int longest_without_roulette = 4096;
// The highest chance of survival at surfaces. In media, where light is scattered by the thousand without
// losing much, it would be ruinous: paths that have lost nothing go on there.
inline constexpr float highest_survival = 0.95f;

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
                      const CameraRay &camera) const {
        return trace<Vacuum>(scene, tracer, sampler, camera);
    }

protected:
    // What the first steps of `volpath` leave out.
    bool surfaces_scatter = true, media_scatter = true;

    // The radiance along a camera ray; Medium is InMedia, or Vacuum.
    template <class Medium>
    Spectrum trace(const Scene &scene, Tracer &tracer, const Sampler &sampler, const CameraRay &camera) const;

private:
    // Where a ray came from: what the weight of a light that it hits depends on.
    struct Departure {
        Vec3f position;
        float pdf;  // of this direction, and of coming as far as the ray has
        bool delta; // light sampling had no chance to find this direction
    };

    // The weight of radiance found by hitting a light that light sampling picks with density `light_pdf`.
    float weight_of_hit(const Departure &from, float light_pdf) const;
    // The weight of radiance found by sampling a light that the path itself hits with density `path_pdf`.
    float weight_of_light(const DirectSample &light, float path_pdf) const;

    // Light that arrives at a vertex straight from a sampled point on a light, and is scattered along the
    // path.
    template <class Vertex, class Medium>
    Spectrum direct(const Scene &scene, Tracer &tracer, const Vertex &vertex, const BounceSample &u,
                    const Medium &medium) const;

    // A path on its way.
    template <class Medium>
    struct Walk {
        Ray ray;
        RayCone cone;
        Departure from;
        float flight; // decides what happens between two vertices
        Medium medium;
        Spectrum radiance{0}, throughput{1};
        float eta = 1;           // of the substance the ray is in, relative to the camera's
        int depth = 1;           // segments so far
        int passages = 0;        // surfaces that the path went straight through
        std::uint32_t block = 1; // of the sampler's numbers
    };

    // Follows the ray through the medium that it is in, up to what was found, and scatters the path where it
    // collides before.
    enum class Course { passed, scattered, ended };
    Course cross_medium(const Scene &scene, Tracer &tracer, const Sampler &sampler, const BounceSample &u,
                        const std::optional<RayHit> &found, Walk<InMedia> &walk) const;
    // Scatters the path at a surface; false where it ends.
    template <class Medium>
    bool scatter_at_surface(const Scene &scene, Tracer &tracer, const Sampler &sampler, const BounceSample &u,
                            const Hit &hit, Walk<Medium> &walk) const;
    // After scattering: the numbers for what follows, and Russian roulette on the throughput without its
    // eta^2, so that entering glass does not make paths die; `highest` chance of survival.
    template <class Medium>
    bool goes_on(const Sampler &sampler, const BounceSample &u, float highest, Walk<Medium> &walk) const;
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

inline float Path::weight_of_light(const DirectSample &light, float path_pdf) const {
    if (light.delta || strategy == Strategy::light) return 1;
    return strategy == Strategy::bsdf ? 0 : power_heuristic(light.pdf, path_pdf);
}

template <class Vertex, class Medium>
Spectrum Path::direct(const Scene &scene, Tracer &tracer, const Vertex &vertex, const BounceSample &u,
                      const Medium &medium) const {
    if (scene.lights().empty()) return Spectrum(0);
    const DirectSample light = scene.lights().sample_direct(vertex.position(), u.light, u.light_uv);
    if (light.pdf == 0 || (strategy == Strategy::bsdf && !light.delta)) return Spectrum(0);
    const BsdfEval f = vertex.eval(light.wi);
    if (is_black(f.f_cos)) return Spectrum(0);
    const auto arrived = arrival(scene, tracer, vertex, light, medium);
    if (!arrived) return Spectrum(0);
    const float weight = weight_of_light(light, f.pdf * medium.reach(*arrived));
    return f.f_cos * light.radiance * arrived->value() * (weight / (light.pdf * sqr(f.eta)));
}

template <class Medium>
bool Path::goes_on(const Sampler &sampler, const BounceSample &u, float highest, Walk<Medium> &walk) const {
    walk.flight = u.flight;
    walk.medium.next_flight(sampler, ++walk.block);
    if (walk.depth <= std::min(rr_depth, longest_without_roulette)) return true;
    if (walk.depth > longest_without_roulette) highest = std::min(highest, 0.999f);
    const float survival = std::min(max_component(walk.throughput) * sqr(walk.eta), highest);
    if (u.roulette >= survival) return false;
    walk.throughput /= survival;
    return true;
}

inline Path::Course Path::cross_medium(const Scene &scene, Tracer &tracer, const Sampler &sampler,
                                       const BounceSample &u, const std::optional<RayHit> &found,
                                       Walk<InMedia> &walk) const {
    Ray piece = walk.ray;
    piece.near = 0; // a camera's near plane hides surfaces, not the medium before it
    if (found) piece.far = found->distance;
    const Flight flight = walk.medium.fly(scene, piece, walk.flight);
    walk.radiance += walk.throughput * flight.emitted;
    walk.throughput *= flight.weight;
    walk.from.pdf *= flight.pdf;
    if (is_black(walk.throughput) || (flight.collision && walk.depth == max_depth)) return Course::ended;
    if (!flight.collision) return Course::passed;

    const MediumVertex vertex{*flight.collision, -piece.direction,
                              scene.media().phase(walk.medium.current, *flight.collision)};
    walk.radiance +=
        walk.throughput * direct(scene, tracer, vertex, u, walk.medium.for_shadow_ray(sampler, walk.block));
    const PhaseSample scattered = vertex.phase.sample(vertex.wo, u.lobe, u.bsdf_uv);
    walk.from = {vertex.point, scattered.pdf, false};
    walk.ray = {vertex.point, scattered.wi};
    walk.cone = walk.cone.at(length(vertex.point - piece.origin)).scattered(0, 1, 1);
    ++walk.depth;
    return Course::scattered;
}

template <class Medium>
bool Path::scatter_at_surface(const Scene &scene, Tracer &tracer, const Sampler &sampler,
                              const BounceSample &u, const Hit &hit, Walk<Medium> &walk) const {
    const Surface surface = scene.surface(hit, -walk.ray.direction, walk.flight);
    scene.for_each_surface(hit, -walk.ray.direction, surface, [&](const Surface &each, float share) {
        if (!each.black && !each.sharp)
            walk.radiance += walk.throughput * share *
                             direct(scene, tracer, SurfaceVertex{hit, each}, u,
                                    walk.medium.for_shadow_ray(sampler, walk.block));
    });
    if (surface.black) return false;

    const auto scattered = sample(surface, u.lobe, u.bsdf_uv);
    if (!scattered) return false;
    // Radiance over eta^2 is what stays constant along a ray that refracts (Veach 1997, section 5.2).
    walk.throughput *= scattered->weight;
    if (scattered->eta != 1) {
        walk.throughput /= sqr(scattered->eta);
        walk.eta *= scattered->eta;
    }
    walk.from = {hit.position, scattered->pdf, surface.sharp || scattered->is_delta()};
    walk.ray.direction = scattered->wi;
    walk.ray.origin = leave(hit, walk.ray.direction);
    walk.ray.near = 0;
    walk.ray.far = infinity;
    walk.medium.cross(hit, walk.ray.direction);
    if (scene.reads_footprints())
        walk.cone = hit.footprint.scattered(hit.mean_curvature, scattered->width(), scattered->eta);
    ++walk.depth;
    return true;
}

template <class Medium>
Spectrum Path::trace(const Scene &scene, Tracer &tracer, const Sampler &sampler,
                     const CameraRay &camera) const {
    Walk<Medium> walk{camera.ray,
                      camera.cone,
                      {camera.ray.origin, 1, true},
                      camera.flight,
                      Medium(scene, camera, sampler, media_scatter)};
    while (walk.depth <= max_depth || max_depth < 0) {
        // Drawn before the ray is traced: the processor computes both at once.
        const BounceSample u = sampler.bounce(walk.block);
        const auto found = tracer.closest(walk.ray);
        if constexpr (Medium::present)
            if (walk.medium.current >= 0) {
                const Course course = cross_medium(scene, tracer, sampler, u, found, walk);
                if (course == Course::scattered && goes_on(sampler, u, 1, walk)) continue;
                if (course != Course::passed) break;
            }
        if (!found) {
            if (walk.depth > 1 || !hide_emitters)
                walk.radiance +=
                    walk.throughput * scene.lights().environment(walk.ray.direction) *
                    weight_of_hit(walk.from,
                                  walk.from.delta ? 0 : scene.lights().pdf_environment(walk.ray.direction));
            break;
        }
        const Hit hit = scene.hit(walk.ray, *found, walk.cone);
        const bool hidden = hide_emitters && walk.depth == 1 && hit.emitter >= 0;
        if (hit.emitter >= 0 && !hidden)
            walk.radiance +=
                walk.throughput * scene.lights().emitted(hit, -walk.ray.direction) *
                weight_of_hit(walk.from, walk.from.delta ? 0
                                                         : scene.lights().pdf_hit(walk.from.position, hit,
                                                                                  walk.ray.direction));

        const Passage passage = passage_at(scene, hit, walk.ray.direction, hidden);
        if (passes(passage.probability, walk.flight)) {
            if (++walk.passages > max_passages) break;
            walk.throughput *= passage.transmitted / passage.probability;
            walk.from.pdf *= passage.probability;
            walk.ray = {leave(hit, walk.ray.direction), walk.ray.direction, 0, walk.ray.far - hit.distance};
            walk.cone = hit.footprint;
            walk.medium.cross(hit, walk.ray.direction);
            continue;
        }
        if (walk.depth == max_depth || !surfaces_scatter) break;
        if (!scatter_at_surface(scene, tracer, sampler, u, hit, walk)) break;
        if (!is_finite(walk.throughput)) [[unlikely]]
            return walk.throughput; // whoever takes the sample counts it
        if (!goes_on(sampler, u, highest_survival, walk)) break;
    }
    return walk.radiance;
}

} // namespace lajolla
