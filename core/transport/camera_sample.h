#pragma once
// Where a sample lies on the film, and the camera's ray through it.

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
    result.camera.flight = u.flight;
    result.camera.channel = u.channel;
    result.camera.film = position;
    result.camera.lens = u.lens;
    return result;
}

} // namespace lajolla
