#pragma once
// What a denoiser should know of a picture: albedo and normal at the first vertex that is not specular.
//
// The albedo is the material's diffuse colour, if it has one. Of other points it is the light that they
// scatter towards the camera where light of radiance 1 arrives from everywhere, the mean of the weight of
// BSDF samples. Camera rays are followed through mirrors, glass, masks and media as paths are, so that a
// pixel shows the albedo behind them, times their colours. The documentation of Open Image Denoise recommends
// all of this.

#include "transport/path.h"

namespace lajolla {

enum class Feature { albedo, normal };
constexpr auto choices(Feature) { return std::array{"albedo", "normal"}; }

struct Features {
    static constexpr const char *name = "features";
    static constexpr const char *doc =
        "Albedo or normal at the first point that is neither a mirror nor glass, for denoising.";
    Feature feature = Feature::albedo;
    bool media = true, hide_emitters = false;

    static constexpr auto fields() {
        return std::tuple(
            field("feature", &Features::feature, "what is shown; lights have their radiance as albedo"),
            field("media", &Features::media,
                  "camera rays scatter in media; their albedo there is that of the "
                  "medium, their normal 0"),
            field("hide_emitters", &Features::hide_emitters, "lights are invisible to the camera"));
    }

    void build() { path_.hide_emitters = hide_emitters; }

    Spectrum radiance(const Scene &scene, Tracer &tracer, const Sampler &sampler, PrimaryRay &primary) const {
        if (scene.media().empty() || !media) return trace<Vacuum>(scene, tracer, sampler, primary);
        return trace<InMedia>(scene, tracer, sampler, primary);
    }

private:
    // Rays between mirrors end after so many reflections and refractions.
    static constexpr int longest = 64;

    template <class Medium>
    Spectrum trace(const Scene &scene, Tracer &tracer, const Sampler &sampler, PrimaryRay &primary) const;

    // Scatters a path at a surface. Returns whether it is to be followed from there.
    template <class Medium>
    static bool follows(const Scene &scene, Tracer &tracer, const Sampler &sampler, Hit<float> hit,
                        Path::Walk<Medium> &walk);

    // The feature of a path that ends at a point with this normal, where it has been scattered.
    template <class Medium>
    Spectrum value(const Path::Walk<Medium> &walk, const Vec3f &normal) const {
        if (feature == Feature::normal) return Spectrum(normal);
        const PathState<float> &path = walk.path;
        return min(walk.radiance, Spectrum(1)) + path.throughput * sqr(path.eta);
    }

    Path path_; // for its estimators
};

template <class Medium>
bool Features::follows(const Scene &scene, Tracer &tracer, const Sampler &sampler, Hit<float> hit,
                       Path::Walk<Medium> &walk) {
    PathState<float> &path = walk.path;
    lower_lift(tracer, true, hit);
    const AnySurface surface = scene.surface(hit, -path.ray.direction, path.u_event);
    if (!surface.black && !surface.delta)
        if (const auto colour = scene.diffuse_colour(hit, -path.ray.direction, path.u_event)) {
            path.throughput *= *colour;
            return false;
        }
    const BounceSample<float> u = sampler.bounce(static_cast<std::uint32_t>(path.block));
    BsdfSample<float> sample;
    if (!surface.black) sample = surface.sample(u.lobe, u.bsdf_uv);
    if (surface.black || !sample.valid) {
        path.throughput = Spectrum(0);
        return false;
    }
    const Departure<float> start = surface.departure(hit, sample.wi);
    path = Path::scattered(scene, path, hit, start, sample, surface.delta);
    walk.medium.cross(hit, sample.wi, start);
    path.u_event = u.event;
    path.block += 1;
    walk.medium.next_flight(sampler, static_cast<std::uint32_t>(path.block));
    return path.delta && path.depth <= longest;
}

template <class Medium>
Spectrum Features::trace(const Scene &scene, Tracer &tracer, const Sampler &sampler,
                         PrimaryRay &primary) const {
    const CameraRay<float> &camera = primary.camera();
    Path::Walk<Medium> walk{Path::start(scene, camera, primary.footprint()),
                            Medium(scene, camera, sampler, true)};
    PathState<float> &path = walk.path;
    for (auto found = primary.found();; found = tracer.closest(path.ray)) {
        Flight flight;
        if constexpr (Medium::present) flight = Path::cross_medium(scene, found, walk);
        if (flight.collision) return value(walk, Vec3f(0));
        if (!found && !flight.surface) {
            path_.leave_scene(scene, walk);
            path.throughput = Spectrum(0);
            return value(walk, Vec3f(0));
        }
        const Hit<float> hit =
            flight.surface ? *flight.surface : scene.hit(path.ray, *found, path.footprint, scene.needs());
        const Path::Outcome outcome = path_.meet(scene, hit, walk);
        if (outcome == Path::Outcome::passed) continue;
        if (outcome == Path::Outcome::hole || outcome == Path::Outcome::catcher) {
            path.throughput = Spectrum(0);
            return value(walk, Vec3f(0));
        }
        const Vec3f wo = -path.ray.direction;
        const float u_event = path.u_event; // selects the leaf of a blend
        if (outcome == Path::Outcome::ended || !follows(scene, tracer, sampler, hit, walk))
            return value(walk, scene.mapped_normal(hit, wo, u_event));
    }
}

} // namespace lajolla
