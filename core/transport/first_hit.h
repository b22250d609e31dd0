#pragma once
// Properties of the first hit of a camera ray, for inspecting scenes, denoising and teaching.

#include <array>

#include "base/sampler.h"
#include "scene/faces.h"
#include "scene/scene.h"
#include "transport/coverage.h"

namespace lajolla {

// The first twelve are the variables of Mitsuba 3's `aov` integrator, in its order.
enum class Quantity {
    albedo,
    depth,
    position,
    uv,
    geo_normal,
    sh_normal,
    dp_du,
    dp_dv,
    duv_dx,
    duv_dy,
    prim_index,
    shape_index,
    rel_position,
    mean_curvature,
    ray_cone,
    mip_level
};
constexpr auto choices(Quantity) {
    return std::array{"albedo",       "depth",          "position", "uv",       "geo_normal", "sh_normal",
                      "dp_du",        "dp_dv",          "duv_dx",   "duv_dy",   "prim_index", "shape_index",
                      "rel_position", "mean_curvature", "ray_cone", "mip_level"};
}

struct FirstHit {
    static constexpr const char *name = "field";
    static constexpr const char *doc = "One property of the first hit of each camera ray.";
    Quantity quantity = Quantity::depth;
    Spectrum undefined{0};
    int first_shape = 1;
    bool see_through = false, through_lights = false;

    static constexpr auto fields() {
        return std::tuple(
            field("field", &FirstHit::quantity,
                  "ray_cone is the radius and the spread of the ray cone, duv_dx the change of uv from one "
                  "pixel to the next on the right"),
            field("undefined", &FirstHit::undefined, "the value if there is no hit"),
            field("first_shape", &FirstHit::first_shape, "the shape_index of the first shape").range(0),
            field("see_through", &FirstHit::see_through,
                  "looks through surfaces that the camera ray passes straight through, as alpha does"),
            field("through_lights", &FirstHit::through_lights, "with see_through: looks through lights too"));
    }

    Spectrum radiance(const Scene &scene, Tracer &tracer, const Sampler &, PrimaryRay &primary) const {
        const Sight sight = see_through ? Sight{through_lights, true} : first_surface;
        const auto &seen = seen_object(scene, tracer, primary, sight);
        return seen ? value(scene, primary.camera(), seen->hit, seen->u_event) : undefined;
    }

private:
    // The random number u selects a leaf of a blend.
    Spectrum value(const Scene &scene, const CameraRay<float> &camera, const Hit<float> &hit, float u) const;
};

inline Spectrum FirstHit::value(const Scene &scene, const CameraRay<float> &camera, const Hit<float> &hit,
                                float u) const {
    const auto pair = [](Vec2f v) { return Spectrum(v.x, v.y, 0); };
    // To where the ray of a neighbouring pixel meets the tangent plane.
    const auto difference = [&](Vec2f step) {
        const Film &film = scene.film();
        const Vec2f neighbour{camera.film.x + step.x / static_cast<float>(film.width),
                              camera.film.y + step.y / static_cast<float>(film.height)};
        const Ray<float> other = scene.camera_ray(neighbour, camera.lens).ray;
        const RayDifferentials<float> change{
            other.origin - camera.ray.origin, {}, other.direction - camera.ray.direction, {}};
        return pair(hit.to_uv()(change.at(other.direction, hit.distance, hit.normal).origin_dx));
    };
    switch (quantity) {
    case Quantity::albedo: return scene.albedo(hit, -camera.ray.direction, u);
    case Quantity::depth: return Spectrum(hit.distance);
    case Quantity::position: return Spectrum(scene.in_world(hit.position));
    case Quantity::uv: return pair(hit.uv);
    case Quantity::geo_normal: return Spectrum(hit.normal);
    case Quantity::sh_normal: return Spectrum(scene.mapped_normal(hit, -camera.ray.direction, u));
    case Quantity::dp_du: return Spectrum(hit.dp_du);
    case Quantity::dp_dv: return Spectrum(hit.dp_dv);
    case Quantity::duv_dx: return difference({1, 0});
    case Quantity::duv_dy: return difference({0, 1});
    case Quantity::prim_index: return Spectrum(static_cast<float>(face_of(scene, hit.shape, hit.primitive)));
    case Quantity::shape_index:
        return Spectrum(static_cast<float>(hit.shape) + static_cast<float>(first_shape));
    case Quantity::rel_position: return Spectrum(scene.camera_space(hit.position));
    case Quantity::mean_curvature: return Spectrum(hit.mean_curvature());
    case Quantity::ray_cone: return {hit.footprint.cone.radius, hit.footprint.cone.spread, 0};
    case Quantity::mip_level: {
        const Bitmap *bitmap = scene.first_bitmap(hit);
        return Spectrum(bitmap ? bitmap->level(hit) : 0);
    }
    }
    return undefined;
}

} // namespace lajolla
