#pragma once
// The position of a sample on the film, its camera ray, and the first hit of the ray.

#include <array>
#include <optional>

#include "base/sampler.h"
#include "scene/scene.h"

namespace lajolla {

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

// A camera ray and its first hit, which is computed on first use and shared by all channels of a sample.
// Keeps a reference to the ray.
class PrimaryRay {
public:
    PrimaryRay(const Scene &scene, Tracer &tracer, const CameraRay<float> &camera)
        : scene_(scene), tracer_(tracer), camera_(camera) {}

    const CameraRay<float> &camera() const { return camera_; }
    const std::optional<RayHit> &found() {
        if (!traced_) found_ = tracer_.closest(camera_.ray);
        traced_ = true;
        return found_;
    }
    // The first hit with all its properties.
    const std::optional<Hit<float>> &hit() {
        if (!hit_ && found()) hit_.emplace(scene_.hit(camera_.ray, *found_, camera_.cone));
        return hit_;
    }

    // The surface that it ends at, found by `find` on first use.
    template <class F>
    const std::optional<SeenSurface> &seen(bool through_lights, F &&find) {
        auto &known = seen_[through_lights];
        if (!known) known.emplace(find());
        return *known;
    }

private:
    const Scene &scene_;
    Tracer &tracer_;
    const CameraRay<float> &camera_;
    bool traced_ = false;
    std::optional<RayHit> found_;
    std::optional<Hit<float>> hit_;
    std::array<std::optional<std::optional<SeenSurface>>, 2> seen_; // not through lights, and through them
};

} // namespace lajolla
