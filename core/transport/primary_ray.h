#pragma once
// The position of a sample on the film, its camera ray, and the first hit of the ray.

#include <array>
#include <optional>

#include "base/sampler.h"
#include "scene/scene.h"

namespace lajolla {

// How the footprint of a pixel is followed, over which textures are filtered.
enum class FootprintKind { differentials, cone };
constexpr auto choices(FootprintKind) { return std::array{"differentials", "cone"}; }

// One sample of one pixel; x and y are pixels of the whole film, not of the crop window.
struct SampleId {
    std::uint32_t x, y, index;
};

template <class Float>
struct FilmSample {
    CameraRay<Float> camera;
    Float weight; // the pixel filter's weight of its position
};

// `x` and `y` are pixels of the whole film.
template <class Float>
FilmSample<Float> sample_film(const Scene &scene, const CameraSample<Float> &u, Float x, Float y) {
    const Film &film = scene.film();
    const auto place = scene.filter().sample(u.film);
    const Vec2<Float> position{(x + 0.5f + place.offset.x) / static_cast<float>(film.width),
                               (y + 0.5f + place.offset.y) / static_cast<float>(film.height)};
    FilmSample<Float> result{scene.camera_ray(position, u.lens), place.weight};
    result.camera.u_event = u.event;
    result.camera.u_channel = u.channel;
    result.camera.film = position;
    result.camera.lens = u.lens;
    return result;
}

// The surface that a camera ray ends at.
struct SeenSurface {
    RayHit found;   // its ids
    Hit<float> hit; // `distance` is measured from the camera
    float u_event;  // the random number that is left for selecting a leaf of a blend
};

// What a camera ray passes through, beside shapes that are not visible to the camera.
struct Sight {
    bool through_lights = false;
    bool through_surfaces = true; // that let light pass straight through
};
inline constexpr Sight first_surface{false, false};

// A camera ray and its first hit, which is computed on first use and shared by all channels of a sample.
// Keeps a reference to the ray. `footprint` is the choice of the picture's integrator, for all channels.
class PrimaryRay {
public:
    PrimaryRay(Tracer &tracer, const CameraRay<float> &camera, FootprintKind footprint)
        : tracer_(tracer), camera_(camera), footprint_(footprint) {}

    FootprintKind footprint() const { return footprint_; }
    const CameraRay<float> &camera() const { return camera_; }
    const std::optional<RayHit> &found() {
        if (!traced_) found_ = tracer_.closest(camera_.ray);
        traced_ = true;
        return found_;
    }
    // The object that it ends at, found by `find` on first use.
    template <class F>
    const std::optional<SeenSurface> &seen(const Sight &sight, F &&find) {
        auto &known = seen_[2 * sight.through_lights + sight.through_surfaces];
        if (!known) known.emplace(find());
        return *known;
    }

private:
    Tracer &tracer_;
    const CameraRay<float> &camera_;
    FootprintKind footprint_;
    bool traced_ = false;
    std::optional<RayHit> found_;
    std::array<std::optional<std::optional<SeenSurface>>, 4> seen_; // for each Sight
};

} // namespace lajolla
