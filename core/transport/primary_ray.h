#pragma once
// Where a sample lies on the film, the camera's ray through it, and what the ray meets.

#include <optional>

#include "base/sampler.h"
#include "scene/scene.h"

namespace lajolla {

// One sample of one pixel; pixels count over the whole film.
struct SampleId {
    std::uint32_t x, y, index;
};

template <class Float>
struct FilmSample {
    CameraRay<Float> camera;
    Float weight; // what its place under the pixel filter counts
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

// A camera ray, which has to stay, and what it meets first: found when somebody asks, and once for all that
// is recorded of a sample.
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
    // Everything about it.
    const std::optional<Hit<float>> &hit() {
        if (!hit_ && found()) hit_.emplace(scene_.hit(camera_.ray, *found_, camera_.cone));
        return hit_;
    }

private:
    const Scene &scene_;
    Tracer &tracer_;
    const CameraRay<float> &camera_;
    bool traced_ = false;
    std::optional<RayHit> found_;
    std::optional<Hit<float>> hit_;
};

} // namespace lajolla
