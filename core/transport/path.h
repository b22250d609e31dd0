#pragma once
// Path tracing. The radiance that leaves x_1 towards the camera is (Kajiya 1986; Veach 1997, chapters 8 to
// 10)
//
//     L(x_1, wo) = Le(x_1, wo) + integral of f(wo, wi) L(x_2, -wi) |cos wi| dwi,
//
// where x_2 is the first point that the ray from x_1 along wi hits. A path is extended from the camera vertex
// by vertex: `emitted` adds Le if the path hits a light, `direct` estimates direct illumination by sampling
// lights, and `scattered` continues the path along a sampled wi. Light found by both techniques is weighted
// by multiple importance sampling.
//
// The functions are templates over the number type. Here, they follow one path to its end (depth first)
// through surfaces and media; transport/wavefront.h calls them for one vertex of many paths at once, with the
// same bits.

#include <array>

#include "base/fields.h"
#include "base/sampler.h"
#include "scene/scene.h"
#include "transport/light_groups.h"
#include "transport/media.h"
#include "transport/primary_ray.h"
#include "transport/vertex.h"
#include "transport/visibility.h"

namespace lajolla {

// The estimators of direct light that are used; all have the same mean.
enum class Strategy { mis, bsdf, light };
constexpr auto choices(Strategy) { return std::array{"mis", "bsdf", "light"}; }

// How multiple importance sampling weights them: by their densities (balance), by the squares of these
// (power), or only the one with the higher density (maximum).
enum class Heuristic { power, balance, maximum };
constexpr auto choices(Heuristic) { return std::array{"power", "balance", "maximum"}; }

// The depth from which Russian roulette always applies, so that every path ends.
inline constexpr int longest_without_roulette = 4096;
// The highest survival probability at surfaces. It does not apply in media: light that is scattered thousands
// of times without losing energy would have a high variance.
inline constexpr float highest_survival = 0.95f;

// The state of a path, or of one in each lane. It is filled in member by member: as one expression, g++ first
// clears all of it, also the differentials of ordinary scenes.
template <class Float>
struct PathState {
    Ray<Float> ray;
    Footprint<Float> footprint;
    Vec3<Float> from;           // the last vertex, or the camera
    Float pdf = 1;              // of the ray's direction, and of reaching the current distance
    BoolOf<Float> delta = true; // light sampling cannot produce this direction
    Rgb<Float> throughput{1};
    Float eta = 1; // index of refraction at the ray, relative to the camera's
    // A uniform number for the next events along the ray: collision in a medium, null transmission, selection
    // of a leaf of a blend. Each decision replaces it by a new uniform number.
    Float u_event = 0;
    IntOf<Float> depth = 1;              // segments so far
    IntOf<Float> block = 1;              // of the sampler's numbers
    IntOf<Float> null_transmissions = 0; // number of surfaces that the path passed straight through

    BoolOf<Float> is_camera_ray() const { return depth == 1; }
};

struct Path {
    static constexpr const char *name = "path";
    static constexpr const char *doc = "Path tracing with light sampling and BSDF sampling.";
    int max_depth = -1, rr_depth = 5;
    bool hide_emitters = false;
    Strategy strategy = Strategy::mis;
    Heuristic heuristic = Heuristic::power;
    FootprintKind footprint = FootprintKind::differentials;

    static constexpr auto fields() {
        return std::tuple(
            field("max_depth", &Path::max_depth,
                  "longest path in segments: 1 shows lights only, 2 direct light; -1 for no limit")
                .range(-1),
            field("rr_depth", &Path::rr_depth, "bounces before Russian roulette may end a path, 4096 at most")
                .range(0),
            field("hide_emitters", &Path::hide_emitters, "lights are invisible to the camera"),
            field("strategy", &Path::strategy, "sample lights, BSDFs, or both weighted by their densities"),
            field("heuristic", &Path::heuristic, "how both are weighted (Veach and Guibas 1995)"),
            field("footprint", &Path::footprint,
                  "how the area that a pixel covers is followed, over which textures are filtered: by the "
                  "derivatives of rays (Igehy 1999), or as a cone (Akenine-Möller et al. 2021)"));
    }

    Spectrum radiance(const Scene &scene, Tracer &tracer, const Sampler &sampler, PrimaryRay &primary,
                      const LightGroups &groups = {}) const {
        return trace<Vacuum>(scene, tracer, sampler, primary, groups);
    }
    // Whether radiance() ignores media.
    bool is_vacuum(const Scene &) const { return true; }

    bool follows_differentials(const Scene &scene) const {
        return footprint == FootprintKind::differentials && scene.reads_footprints();
    }
    template <class Float>
    PathState<Float> start(const Scene &scene, const CameraRay<Float> &camera) const {
        return start(scene, camera, footprint);
    }
    template <class Float>
    static PathState<Float> start(const Scene &scene, const CameraRay<Float> &camera, FootprintKind kind) {
        PathState<Float> path;
        path.ray = camera.ray;
        path.footprint.cone = camera.cone;
        path.from = camera.ray.origin;
        path.u_event = camera.u_event;
        if (kind == FootprintKind::differentials && scene.reads_footprints())
            path.footprint.differentials = scene.camera_differentials(camera.film, camera.lens);
        return path;
    }

    // Le at the ray's hit, with its MIS weight against light sampling.
    template <class Float>
    Rgb<Float> emitted(const Scene &scene, const PathState<Float> &path, const Hit<Float> &hit) const {
        const Rgb<Float> radiance = scene.lights().emitted(hit, -path.ray.direction);
        Float light_pdf = 0;
        if (!all(path.delta)) light_pdf = scene.lights().pdf_hit(path.from, hit, path.ray.direction);
        return radiance * weight_of_hit(path, light_pdf);
    }
    // The same for environment light, for a ray without a hit.
    template <class Float>
    Rgb<Float> environment(const Scene &scene, const PathState<Float> &path, bool from_camera = false) const {
        const Rgb<Float> radiance = scene.lights().environment(path.ray.direction, from_camera);
        Float light_pdf = 0;
        if (!all(path.delta)) light_pdf = scene.lights().pdf_environment(path.ray.direction);
        return radiance * weight_of_hit(path, light_pdf);
    }

    // Whether a hit shows the light of an emitter: the camera sees none in holes.
    static bool shines(const Hit<float> &hit, CameraRole seen) {
        return hit.emitter >= 0 && seen == CameraRole::object;
    }

    // Whether light samples can contribute to a path.
    template <class Float>
    BoolOf<Float> counts(const DirectSample<Float> &light) const {
        return light.pdf != 0.0f && (light.delta || BoolOf<Float>(strategy != Strategy::bsdf));
    }
    // The contribution of a light sample to the scattered radiance of a vertex, without occlusion:
    // f Le |cos| / pdf, with its MIS weight against hitting the light by a path, which reaches that distance
    // with probability `path_pdf`.
    template <class Float>
    Rgb<Float> direct(const DirectSample<Float> &light, const BsdfEval<Float> &bsdf, Float path_pdf) const {
        const Float weight = weight_of_light(light, bsdf.pdf * path_pdf);
        return bsdf.f_cos * light.radiance * (weight / (light.pdf * sqr(bsdf.eta)));
    }

    // The path that continues from a surface in a sampled direction. Refraction does not change L / eta^2
    // (Veach 1997, section 5.2).
    template <class Float>
    static PathState<Float> scattered(const Scene &scene, const PathState<Float> &path, const Hit<Float> &hit,
                                      const Departure<Float> &start, const BsdfSample<Float> &sample,
                                      BoolOf<Float> delta) {
        PathState<Float> next;
        next.throughput = path.throughput * sample.weight * (1 / sqr(sample.eta));
        next.eta = path.eta * sample.eta;
        next.from = start.vertex;
        next.pdf = sample.pdf;
        next.delta = delta || sample.delta;
        next.ray = {start.origin, sample.wi};
        next.depth = path.depth + 1;
        next.block = path.block;
        next.u_event = path.u_event;
        if (scene.reads_footprints())
            next.footprint =
                scattered_footprint(hit, path.ray.direction, sample.wi, sample.width, sample.eta);
        return next;
    }
    // Russian roulette on the throughput without eta^2, so that paths entering glass are not terminated.
    // `highest` bounds the survival probability. Returns false if the path ends.
    template <class Float>
    BoolOf<Float> survives(const BounceSample<Float> &u, float highest, PathState<Float> &path) const {
        path.u_event = u.event;
        path.block += 1;
        const auto plays = path.depth > std::min(rr_depth, longest_without_roulette);
        if (!any(plays)) return true;
        const auto late = path.depth > longest_without_roulette;
        const Float limit = select(late, Float(std::min(highest, 0.999f)), Float(highest));
        const Float survival = min(max_component(path.throughput) * sqr(path.eta), limit);
        path.throughput = select(plays, path.throughput / survival, path.throughput);
        return !plays || u.roulette < survival;
    }

    // Continues a path straight through a surface.
    template <class Float>
    static void pass_through(const Hit<Float> &hit, const NullTransmission<Float> &through,
                             PathState<Float> &path) {
        const Vec3<Float> direction = path.ray.direction;
        path.throughput *= through.transmittance / through.probability;
        path.pdf *= through.probability;
        path.ray = {leave(hit, direction), direction, 0, path.ray.far - hit.distance};
        path.footprint = hit.footprint;
        path.null_transmissions += 1;
    }

    // Decides whether a path passes straight through the surface it hit, always if that is `hidden`, and
    // continues it there.
    template <class Medium>
    static bool passes_through(const Scene &scene, const Hit<float> &hit, bool hidden, PathState<float> &path,
                               Medium &medium) {
        NullTransmission<float> through;
        if (hidden) through = {Spectrum(1), 1};
        else if (scene.has_null_transmission()) through = scene.null_transmission(hit, -path.ray.direction);
        if (!passes(through.probability, path.u_event)) return false;
        pass_through(hit, through, path);
        medium.cross(hit, path.ray.direction);
        return true;
    }

    // A path followed depth first; Medium is InMedia or Vacuum.
    template <class Medium>
    struct Walk {
        PathState<float> path;
        Medium medium;
        Spectrum radiance{0};
        LightGroups groups{};
        // Whether its last vertex is on a shadow catcher that the camera sees. Of the light there, that which
        // objects have scattered counts: the rest is in the photograph, or in alpha (shadow_catcher.h).
        bool from_catcher = false;

        // What it sees in a hit.
        CameraRole role(const Scene &scene, const Hit<float> &hit, bool hide_emitters) const {
            if (path.is_camera_ray()) return scene.camera_role(hit.shape, hit.instance, hide_emitters);
            return from_catcher && scene.is_in_photograph(hit) ? CameraRole::hole : CameraRole::object;
        }

        // Adds light that is emitted by a light, or by a medium (-1), towards the path.
        void add(std::int32_t light, const Spectrum &value) {
            radiance += value;
            groups.add(light, path.ray.direction, value, path.is_camera_ray());
        }
    };
    // Follows a path along its ray to its hit, and continues it; returns false if it ends.
    template <class Medium>
    bool step(const Scene &scene, Tracer &tracer, const Sampler &sampler, const std::optional<RayHit> &found,
              Walk<Medium> &walk) const;

    // Follows the ray through its medium to the hit, or to a collision before it.
    static Flight cross_medium(const Scene &scene, const std::optional<RayHit> &found, Walk<InMedia> &walk);

    // Processes the surface that a path hit, and adds its emission.
    enum class Outcome { passed, stopped, ended, hole, catcher };
    template <class Medium>
    Outcome meet(const Scene &scene, const Hit<float> &hit, Walk<Medium> &walk) const;
    // Adds environment light for a ray without a hit.
    template <class Medium>
    void leave_scene(const Scene &scene, Walk<Medium> &walk) const;

    // The scattered radiance of a light sample at a vertex; it is added to `groups` too. For each light
    // sample there are `directions` samples of the BSDF.
    template <class Vertex, class Medium>
    Spectrum direct_light(const Scene &scene, Tracer &tracer, const Vertex &vertex,
                          const BounceSample<float> &u, const Medium &medium, const LightGroups &groups,
                          float directions = 1) const;

protected:
    // Settings for the lower versions of `volpath`.
    bool surfaces_scatter = true, media_scatter = true;

    // The radiance along a camera ray.
    template <class Medium>
    Spectrum trace(const Scene &scene, Tracer &tracer, const Sampler &sampler, PrimaryRay &primary,
                   const LightGroups &groups) const;

private:
    // The MIS weight of one sample with density `pdf` against another technique.
    template <class Float>
    Float mis_weight(Float pdf, Float other_pdf) const;
    // The MIS weight of hitting a light that light sampling samples with density `light_pdf`.
    template <class Float>
    Float weight_of_hit(const PathState<Float> &path, Float light_pdf) const;
    // The MIS weight of sampling a light that the path hits with density `path_pdf`.
    template <class Float>
    Float weight_of_light(const DirectSample<Float> &light, Float path_pdf) const;

    void scatter_in_medium(const Scene &scene, Tracer &tracer, const Sampler &sampler,
                           const BounceSample<float> &u, const Vec3f &collision, Walk<InMedia> &walk) const;
    // Scatters the path at a surface; returns false if it ends.
    template <class Medium>
    bool scatter_at_surface(const Scene &scene, Tracer &tracer, const Sampler &sampler,
                            const BounceSample<float> &u, const Hit<float> &hit, Walk<Medium> &walk) const;
    template <class Medium>
    bool goes_on(const Sampler &sampler, const BounceSample<float> &u, float highest,
                 Walk<Medium> &walk) const;
};

// Veach 1997, equations 9.8 to 9.13; the power heuristic with beta = 2.
template <class Float>
Float Path::mis_weight(Float pdf, Float other_pdf) const {
    const Float ratio = other_pdf / pdf;
    if (heuristic == Heuristic::power) return 1 / (1 + ratio * ratio);
    if (heuristic == Heuristic::balance) return 1 / (1 + ratio);
    return select(pdf > other_pdf, Float(1), select(pdf == other_pdf, Float(0.5f), Float(0)));
}

template <class Float>
Float Path::weight_of_hit(const PathState<Float> &path, Float light_pdf) const {
    if (strategy == Strategy::bsdf) return 1;
    const Float shared = strategy == Strategy::light ? select(light_pdf > 0.0f, Float(0), Float(1))
                                                     : mis_weight(path.pdf, light_pdf);
    return select(path.delta, Float(1), shared);
}

template <class Float>
Float Path::weight_of_light(const DirectSample<Float> &light, Float path_pdf) const {
    if (strategy == Strategy::light) return 1;
    const Float shared = strategy == Strategy::bsdf ? Float(0) : mis_weight(light.pdf, path_pdf);
    return select(light.delta, Float(1), shared);
}

template <class Vertex, class Medium>
Spectrum Path::direct_light(const Scene &scene, Tracer &tracer, const Vertex &vertex,
                            const BounceSample<float> &u, const Medium &medium, const LightGroups &groups,
                            float directions) const {
    if (scene.lights().empty()) return Spectrum(0);
    const DirectSample<float> light = scene.lights().sample_direct(vertex.position(), u.light, u.light_uv);
    if (!counts(light) || !vertex.gathers(light.wi)) return Spectrum(0);
    const BsdfEval<float> f = vertex.eval(light.wi);
    if (is_black(f.f_cos)) return Spectrum(0);
    const auto arriving = transmittance(scene, tracer, vertex, light, medium);
    if (!arriving) return Spectrum(0);
    const Spectrum result = direct(light, f, directions * medium.path_pdf(*arriving)) * arriving->value();
    groups.add_picked(u.light, light.wi, result);
    return result;
}

template <class Medium>
bool Path::goes_on(const Sampler &sampler, const BounceSample<float> &u, float highest,
                   Walk<Medium> &walk) const {
    const bool result = survives(u, highest, walk.path);
    walk.medium.next_flight(sampler, static_cast<std::uint32_t>(walk.path.block));
    return result;
}

inline Flight Path::cross_medium(const Scene &scene, const std::optional<RayHit> &found,
                                 Walk<InMedia> &walk) {
    PathState<float> &path = walk.path;
    Flight flight = walk.medium.fly(scene, path.ray, found, path.u_event);
    walk.add(-1, path.throughput * flight.emitted);
    path.throughput *= flight.weight;
    path.pdf *= flight.pdf;
    if (flight.surface && scene.reads_footprints()) {
        Hit<float> &hit = *flight.surface;
        const Vec3f &direction = path.ray.direction;
        hit.footprint.move(path.footprint, direction, dot(hit.position - path.ray.origin, direction),
                           hit.normal);
    }
    return flight;
}

inline void Path::scatter_in_medium(const Scene &scene, Tracer &tracer, const Sampler &sampler,
                                    const BounceSample<float> &u, const Vec3f &collision,
                                    Walk<InMedia> &walk) const {
    PathState<float> &path = walk.path;
    const MediumVertex vertex{collision, -path.ray.direction,
                              scene.media().phase(walk.medium.current, collision)};
    walk.radiance += path.throughput *
                     direct_light(scene, tracer, vertex, u,
                                  walk.medium.for_shadow_ray(sampler, static_cast<std::uint32_t>(path.block)),
                                  walk.groups.times(path.throughput));
    const PhaseSample scattered = vertex.phase.sample(vertex.wo, u.lobe, u.bsdf_uv);
    const float distance = length(vertex.point - path.ray.origin);
    path.footprint.cone = path.footprint.cone.at(distance).scattered(0, 1, 1);
    path.footprint.differentials.reset();
    path.from = vertex.point;
    path.pdf = scattered.pdf;
    path.delta = false;
    path.ray = {vertex.point, scattered.wi};
    ++path.depth;
    walk.from_catcher = false;
    path.null_transmissions = 0;
}

template <class Medium>
bool Path::scatter_at_surface(const Scene &scene, Tracer &tracer, const Sampler &sampler,
                              const BounceSample<float> &u, const Hit<float> &hit, Walk<Medium> &walk) const {
    PathState<float> &path = walk.path;
    const Vec3f wo = -path.ray.direction;
    const AnySurface surface = scene.surface(hit, wo, path.u_event);
    scene.for_each_surface(hit, wo, surface, [&](const AnySurface &each, float share) {
        if (each.black || each.delta || walk.from_catcher) return;
        for_each_vertex(hit, each, [&](const auto &vertex) {
            walk.radiance +=
                path.throughput * share *
                direct_light(scene, tracer, vertex, u,
                             walk.medium.for_shadow_ray(sampler, static_cast<std::uint32_t>(path.block)),
                             walk.groups.times(path.throughput * share));
        });
    });
    if (surface.black) return false;

    const BsdfSample<float> sample = surface.sample(u.lobe, u.bsdf_uv);
    if (!sample.valid) return false;
    const Departure<float> start = surface.departure(hit, sample.wi);
    path = scattered(scene, path, hit, start, sample, surface.delta);
    walk.medium.cross(hit, sample.wi, start);
    return true;
}

template <class Medium>
Path::Outcome Path::meet(const Scene &scene, const Hit<float> &hit, Walk<Medium> &walk) const {
    PathState<float> &path = walk.path;
    const CameraRole seen = walk.role(scene, hit, hide_emitters);
    if (shines(hit, seen)) walk.add(hit.emitter, path.throughput * emitted(scene, path, hit));
    if (!passes_through(scene, hit, seen == CameraRole::nothing, path, walk.medium))
        return seen == CameraRole::hole      ? Outcome::hole
               : seen == CameraRole::catcher ? Outcome::catcher
                                             : Outcome::stopped;
    return path.null_transmissions > max_null_transmissions ? Outcome::ended : Outcome::passed;
}

template <class Medium>
void Path::leave_scene(const Scene &scene, Walk<Medium> &walk) const {
    const bool from_camera = walk.path.is_camera_ray();
    if (scene.lights().has_environment() && !(from_camera && hide_emitters) && !walk.from_catcher)
        walk.add(scene.lights().environment_light(),
                 walk.path.throughput * environment(scene, walk.path, from_camera));
}

template <class Medium>
bool Path::step(const Scene &scene, Tracer &tracer, const Sampler &sampler,
                const std::optional<RayHit> &found, Walk<Medium> &walk) const {
    PathState<float> &path = walk.path;
    const BounceSample<float> u = sampler.bounce(static_cast<std::uint32_t>(path.block));
    Flight flight;
    if constexpr (Medium::present)
        if (walk.medium.current >= 0) {
            flight = cross_medium(scene, found, walk);
            if (is_black(path.throughput) || (flight.collision && path.depth == max_depth)) return false;
            if (flight.collision) {
                scatter_in_medium(scene, tracer, sampler, u, *flight.collision, walk);
                return goes_on(sampler, u, 1, walk);
            }
        }
    if (!found && !flight.surface) {
        leave_scene(scene, walk);
        return false;
    }
    Hit<float> hit =
        flight.surface ? *flight.surface : scene.hit(path.ray, *found, path.footprint, scene.needs());
    const Outcome outcome = meet(scene, hit, walk);
    walk.from_catcher = outcome == Outcome::catcher || (walk.from_catcher && outcome == Outcome::passed);
    if (outcome != Outcome::stopped && outcome != Outcome::catcher) return outcome == Outcome::passed;
    if (path.depth == max_depth || !surfaces_scatter) return false;
    lower_lift(tracer, true, hit);
    if (!scatter_at_surface(scene, tracer, sampler, u, hit, walk)) return false;
    if (!is_finite(path.throughput)) [[unlikely]] {
        walk.radiance = path.throughput; // the caller counts it
        return false;
    }
    return goes_on(sampler, u, highest_survival, walk);
}

template <class Medium>
Spectrum Path::trace(const Scene &scene, Tracer &tracer, const Sampler &sampler, PrimaryRay &primary,
                     const LightGroups &groups) const {
    if (max_depth == 0) return Spectrum(0);
    const CameraRay<float> &camera = primary.camera();
    Walk<Medium> walk{start(scene, camera), Medium(scene, camera, sampler, media_scatter), Spectrum(0),
                      groups};
    auto found = primary.found();
    while (step(scene, tracer, sampler, found, walk)) found = tracer.closest(walk.path.ray);
    return walk.radiance;
}

} // namespace lajolla
