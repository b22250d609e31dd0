#pragma once
// Integrators that show what a path sees first: for inspecting scenes and for teaching.

#include "base/sampler.h"
#include "scene/scene.h"

namespace lajolla {

namespace detail {

// f(hit) for the first surface along a camera ray, black where there is none.
template <class F>
Spectrum at_first_hit(const Scene &scene, Tracer &tracer, const CameraRay &camera, F &&f) {
    const auto found = tracer.closest(camera.ray);
    return found ? f(scene.hit(camera.ray, *found, camera.cone)) : Spectrum(0);
}

} // namespace detail

struct Depth {
    static constexpr const char *name = "depth";
    static constexpr const char *doc = "Distance from the camera, 0 where nothing is seen.";
    static constexpr auto fields() { return std::tuple(); }
    Spectrum radiance(const Scene &scene, Tracer &tracer, const Sampler &, const CameraRay &camera) const {
        return detail::at_first_hit(scene, tracer, camera,
                                    [](const Hit &hit) { return Spectrum(hit.distance); });
    }
};

struct ShadingNormal {
    static constexpr const char *name = "shadingNormal";
    static constexpr const char *doc = "Shading normals in world space.";
    static constexpr auto fields() { return std::tuple(); }
    Spectrum radiance(const Scene &scene, Tracer &tracer, const Sampler &, const CameraRay &camera) const {
        return detail::at_first_hit(scene, tracer, camera,
                                    [](const Hit &hit) { return Spectrum(hit.shading_normal); });
    }
};

struct MeanCurvature {
    static constexpr const char *name = "meanCurvature";
    static constexpr const char *doc =
        "Mean curvature of the smooth surface that shading normals describe; 1/r on a sphere.";
    static constexpr auto fields() { return std::tuple(); }
    Spectrum radiance(const Scene &scene, Tracer &tracer, const Sampler &, const CameraRay &camera) const {
        return detail::at_first_hit(scene, tracer, camera,
                                    [](const Hit &hit) { return Spectrum(hit.mean_curvature); });
    }
};

struct RayDifferentialView {
    static constexpr const char *name = "rayDifferential";
    static constexpr const char *doc =
        "Radius (red) and spread (green) of the pixel's ray cone where it meets a surface.";
    static constexpr auto fields() { return std::tuple(); }
    Spectrum radiance(const Scene &scene, Tracer &tracer, const Sampler &, const CameraRay &camera) const {
        return detail::at_first_hit(scene, tracer, camera, [](const Hit &hit) {
            return Spectrum(hit.footprint.radius, hit.footprint.spread, 0);
        });
    }
};

struct MipmapLevel {
    static constexpr const char *name = "mipmapLevel";
    static constexpr const char *doc =
        "MIP level at which the surface's bitmap would be read; 0 where it has none.";
    static constexpr auto fields() { return std::tuple(); }
    Spectrum radiance(const Scene &scene, Tracer &tracer, const Sampler &, const CameraRay &camera) const {
        return detail::at_first_hit(scene, tracer, camera, [&](const Hit &hit) {
            const Bitmap *bitmap = scene.first_bitmap(hit);
            return Spectrum(bitmap ? bitmap->level(hit.uv_footprint()) : 0);
        });
    }
};

} // namespace lajolla
