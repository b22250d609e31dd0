#pragma once
// The list of cameras. As in Mitsuba they look along +z with +y up and +x to the left of the picture.

#include <array>
#include <tuple>
#include <variant>

#include "base/fields.h"
#include "base/match.h"
#include "base/transform.h"
#include "base/warp.h"
#include "scene/direct_sample.h"
#include "scene/hit.h"

namespace lajolla {

enum class FovAxis { x, y, diagonal, smaller, larger };
constexpr auto choices(FovAxis) { return std::array{"x", "y", "diagonal", "smaller", "larger"}; }

struct CameraRay {
    Ray ray;
    RayCone cone;
    // Uniform numbers: what happens on the way to the first vertex, and by which channel the path samples
    // media.
    float flight = 0, channel = 0;
    Vec2f film{}, lens{}; // what it was generated from
};

// What a camera is made for: known once the scene is.
struct CameraFit {
    float aspect, width; // of the film: its width over its height, and its width in pixels
    BoundingSphere scene;
};

struct Perspective {
    static constexpr const char *name = "perspective";
    static constexpr const char *doc = "A pinhole camera.";
    Transform to_world;
    float fov = 50;
    FovAxis fov_axis = FovAxis::x;
    float near_clip = 0.01f, far_clip = 1e4f;
    float principal_point_offset_x = 0, principal_point_offset_y = 0;

    static constexpr auto fields() {
        return std::tuple(
            field("to_world", &Perspective::to_world, "placement in the scene"),
            field("fov", &Perspective::fov, "field of view").range(1e-3, 179.999).unit("degrees"),
            field("fov_axis", &Perspective::fov_axis, "which side of the picture the field of view spans"),
            field("near_clip", &Perspective::near_clip, "nothing nearer than this along +z is seen").range(0),
            field("far_clip", &Perspective::far_clip, "nothing farther than this along +z is seen").range(0),
            field("principal_point_offset_x", &Perspective::principal_point_offset_x,
                  "shift of the picture, in widths of the film"),
            field("principal_point_offset_y", &Perspective::principal_point_offset_y,
                  "shift of the picture, in heights of the film"));
    }
    void build(const CameraFit &fit);
    // `film` in [0,1]^2 from the top left corner, `lens` for apertures.
    CameraRay generate(Vec2f film, Vec2f lens) const;

    // The point at z = 1 that a film position stands for, in camera space.
    Vec3f through(Vec2f film) const {
        return {(1 - 2 * (film.x + principal_point_offset_x)) * half_width,
                (1 - 2 * (film.y + principal_point_offset_y)) * half_height, 1};
    }
    CameraRay leave(Vec3f origin, Vec3f direction) const; // from camera to world space
    float half_width = 0, half_height = 0, pixel = 0;     // at z = 1
};

struct ThinLens : Perspective {
    static constexpr const char *name = "thinlens";
    static constexpr const char *doc =
        "A camera with a round aperture: what is not at the focus distance is blurred.";
    float aperture_radius = 0, focus_distance = 1e4f;

    static constexpr auto fields() {
        return std::tuple_cat(
            Perspective::fields(),
            std::tuple(
                field("aperture_radius", &ThinLens::aperture_radius, "radius of the lens").range(0, 1e12),
                field("focus_distance", &ThinLens::focus_distance, "distance along +z that is sharp")
                    .range(1e-6, 1e12)));
    }
    CameraRay generate(Vec2f film, Vec2f lens) const;
};

struct Orthographic {
    static constexpr const char *name = "orthographic";
    static constexpr const char *doc = "Parallel rays; the picture is two units wide before to_world.";
    Transform to_world;
    float near_clip = 0.01f, far_clip = 1e4f;

    static constexpr auto fields() {
        return std::tuple(
            field("to_world", &Orthographic::to_world, "placement in the scene"),
            field("near_clip", &Orthographic::near_clip, "nothing nearer than this along +z is seen")
                .range(0),
            field("far_clip", &Orthographic::far_clip, "nothing farther than this along +z is seen")
                .range(0));
    }
    void build(const CameraFit &fit);
    CameraRay generate(Vec2f film, Vec2f lens) const;

private:
    float aspect_ = 1, pixel_ = 0;
};

struct Telecentric : Orthographic {
    static constexpr const char *name = "telecentric";
    static constexpr const char *doc =
        "Parallel views through a round aperture: what is not at the focus distance is blurred.";
    float aperture_radius = 0, focus_distance = 1e4f;

    static constexpr auto fields() {
        return std::tuple_cat(
            Orthographic::fields(),
            std::tuple(
                field("aperture_radius", &Telecentric::aperture_radius, "radius of the lens").range(0, 1e12),
                field("focus_distance", &Telecentric::focus_distance, "distance along +z that is sharp")
                    .range(1e-6, 1e12)));
    }
    CameraRay generate(Vec2f film, Vec2f lens) const;
};

struct Spherical {
    static constexpr const char *name = "spherical";
    static constexpr const char *doc =
        "All around in latitude and longitude, +y at the top and +z in the middle, as environment maps are.";
    Transform to_world;

    static constexpr auto fields() {
        return std::tuple(field("to_world", &Spherical::to_world, "placement in the scene"));
    }
    void build(const CameraFit &fit);
    CameraRay generate(Vec2f film, Vec2f lens) const;

private:
    float pixel_ = 0;
};

struct RadianceMeter {
    static constexpr const char *name = "radiancemeter";
    static constexpr const char *doc = "One ray, along +z: every pixel shows what it carries.";
    Transform to_world;

    static constexpr auto fields() {
        return std::tuple(field("to_world", &RadianceMeter::to_world, "placement in the scene"));
    }
    void build(const CameraFit &fit);
    CameraRay generate(Vec2f film, Vec2f lens) const;
};

struct Distant {
    static constexpr const char *name = "distant";
    static constexpr const char *doc =
        "What leaves the scene, or passes one point of it, in one direction: seen from far away along +z.";
    Transform to_world;
    Vec3f target{0};
    bool has_target = false;

    static constexpr auto fields() {
        return std::tuple(
            field("to_world", &Distant::to_world, "placement in the scene; only directions count"),
            field("target", &Distant::target, "the point that is looked at"),
            field("has_target", &Distant::has_target,
                  "look at the target alone, not at all of the scene's bounding sphere"));
    }
    void build(const CameraFit &fit);
    CameraRay generate(Vec2f film, Vec2f lens) const;

private:
    BoundingSphere scene_;
    Frame axes_;
};

using Camera =
    std::variant<Perspective, ThinLens, Orthographic, Telecentric, Spherical, RadianceMeter, Distant>;

} // namespace lajolla
