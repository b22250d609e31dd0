#pragma once
// The list of cameras. As in Mitsuba they look along +z with +y up and +x to the left of the picture.

#include <array>
#include <tuple>
#include <variant>

#include "base/fields.h"
#include "base/match.h"
#include "base/transform.h"
#include "base/warp.h"
#include "geometry/hit.h"
#include "geometry/shape_sample.h"

namespace lajolla {

enum class FovAxis { x, y, diagonal, smaller, larger };
constexpr auto choices(FovAxis) { return std::array{"x", "y", "diagonal", "smaller", "larger"}; }

template <class Float>
struct CameraRay {
    Ray<Float> ray;
    RayCone<Float> cone;
    // Uniform numbers for the first event along the ray, and for the channel by which the path samples media.
    Float u_event = 0, u_channel = 0;
    Vec2<Float> film{}, lens{}; // what it was generated from
};

// Properties of the film that cameras need.
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
            field("fov_axis", &Perspective::fov_axis, "side of the picture to which fov applies"),
            field("near_clip", &Perspective::near_clip, "surfaces nearer than this along +z are invisible")
                .range(0),
            field("far_clip", &Perspective::far_clip, "surfaces farther than this along +z are invisible")
                .range(0),
            field("principal_point_offset_x", &Perspective::principal_point_offset_x,
                  "shift of the picture, in widths of the film"),
            field("principal_point_offset_y", &Perspective::principal_point_offset_y,
                  "shift of the picture, in heights of the film"));
    }
    void build(const CameraFit &fit);
    // `film` in [0,1]^2 from the top left corner, `lens` for apertures.
    template <class Float>
    CameraRay<Float> generate(const Vec2<Float> &film, const Vec2<Float> &lens) const;

    // The point at z = 1 of a film position, in camera space.
    template <class Float>
    Vec3<Float> through(const Vec2<Float> &film) const {
        return {(1 - 2 * (film.x + principal_point_offset_x)) * half_width,
                (1 - 2 * (film.y + principal_point_offset_y)) * half_height, 1};
    }
    template <class Float>
    CameraRay<Float> leave(const Vec3<Float> &origin,
                           const Vec3<Float> &direction) const; // from camera to world space
    // Of rays along `direction` in camera space, which has z = 1.
    template <class Float>
    RayDifferentials<Float> differentials_along(const Vec3<Float> &direction) const;
    template <class Float>
    RayDifferentials<Float> differentials(const Vec2<Float> &film, const Vec2<Float> &) const {
        return differentials_along(through(film));
    }
    float half_width = 0, half_height = 0, pixel = 0; // at z = 1
};

struct ThinLens : Perspective {
    static constexpr const char *name = "thinlens";
    static constexpr const char *doc = "A camera with a round aperture and depth of field.";
    float aperture_radius = 0, focus_distance = 1e4f;

    static constexpr auto fields() {
        return std::tuple_cat(
            Perspective::fields(),
            std::tuple(
                field("aperture_radius", &ThinLens::aperture_radius, "radius of the lens").range(0, 1e12),
                field("focus_distance", &ThinLens::focus_distance, "distance along +z that is in focus")
                    .range(1e-6, 1e12)));
    }
    template <class Float>
    CameraRay<Float> generate(const Vec2<Float> &film, const Vec2<Float> &lens) const;
    template <class Float>
    RayDifferentials<Float> differentials(const Vec2<Float> &film, const Vec2<Float> &lens) const {
        return differentials_along(towards_focus(film, on_lens(lens)));
    }

private:
    template <class Float>
    Vec3<Float> on_lens(const Vec2<Float> &lens) const {
        const Vec2<Float> p = sample_disk(lens) * Float(aperture_radius);
        return {p.x, p.y, 0};
    }
    template <class Float>
    Vec3<Float> towards_focus(const Vec2<Float> &film, const Vec3<Float> &origin) const {
        return (through(film) * Float(focus_distance) - origin) / focus_distance;
    }
};

struct Orthographic {
    static constexpr const char *name = "orthographic";
    static constexpr const char *doc = "Parallel rays; the picture is two units wide before to_world.";
    Transform to_world;
    float near_clip = 0.01f, far_clip = 1e4f;

    static constexpr auto fields() {
        return std::tuple(
            field("to_world", &Orthographic::to_world, "placement in the scene"),
            field("near_clip", &Orthographic::near_clip, "surfaces nearer than this along +z are invisible")
                .range(0),
            field("far_clip", &Orthographic::far_clip, "surfaces farther than this along +z are invisible")
                .range(0));
    }
    void build(const CameraFit &fit);
    template <class Float>
    CameraRay<Float> generate(const Vec2<Float> &film, const Vec2<Float> &lens) const;
    // The rays are parallel, also those of telecentric cameras through one point of the lens.
    template <class Float>
    RayDifferentials<Float> differentials(const Vec2<Float> &, const Vec2<Float> &) const {
        const Vec3<Float> x = step_x_, y = step_y_;
        return {x, y, {}, {}};
    }

private:
    float aspect_ = 1, pixel_ = 0;
    Vec3f step_x_, step_y_; // from one pixel to the next
};

struct Telecentric : Orthographic {
    static constexpr const char *name = "telecentric";
    static constexpr const char *doc = "An orthographic camera with a round aperture and depth of field.";
    float aperture_radius = 0, focus_distance = 1e4f;

    static constexpr auto fields() {
        return std::tuple_cat(
            Orthographic::fields(),
            std::tuple(
                field("aperture_radius", &Telecentric::aperture_radius, "radius of the lens").range(0, 1e12),
                field("focus_distance", &Telecentric::focus_distance, "distance along +z that is in focus")
                    .range(1e-6, 1e12)));
    }
    template <class Float>
    CameraRay<Float> generate(const Vec2<Float> &film, const Vec2<Float> &lens) const;
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
    template <class Float>
    CameraRay<Float> generate(const Vec2<Float> &film, const Vec2<Float> &lens) const;
    template <class Float>
    RayDifferentials<Float> differentials(const Vec2<Float> &film, const Vec2<Float> &) const;

private:
    float pixel_ = 0, pixel_height_ = 0; // half a pixel's width, and its height, as angles
};

struct RadianceMeter {
    static constexpr const char *name = "radiancemeter";
    static constexpr const char *doc = "Radiance along one ray in the direction +z.";
    Transform to_world;

    static constexpr auto fields() {
        return std::tuple(field("to_world", &RadianceMeter::to_world, "placement in the scene"));
    }
    void build(const CameraFit &fit);
    template <class Float>
    CameraRay<Float> generate(const Vec2<Float> &film, const Vec2<Float> &lens) const;
    template <class Float>
    RayDifferentials<Float> differentials(const Vec2<Float> &, const Vec2<Float> &) const {
        return {}; // the picture is one ray
    }
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
            field("to_world", &Distant::to_world, "placement in the scene; only directions are used"),
            field("target", &Distant::target, "the point that is looked at"),
            field("has_target", &Distant::has_target,
                  "look at the target alone, not at all of the scene's bounding sphere"));
    }
    void build(const CameraFit &fit);
    template <class Float>
    CameraRay<Float> generate(const Vec2<Float> &film, const Vec2<Float> &lens) const;
    template <class Float>
    RayDifferentials<Float> differentials(const Vec2<Float> &, const Vec2<Float> &) const {
        return {}; // each pixel sees the same
    }

private:
    BoundingSphere scene_;
    Frame<float> axes_;
};

using Camera =
    std::variant<Perspective, ThinLens, Orthographic, Telecentric, Spherical, RadianceMeter, Distant>;

// A unit-length world ray whose clipping distances were given along camera space directions of length
// `stretch`.
template <class Float>
Ray<Float> world_ray(const Transform &to_world, const Vec3<Float> &origin, const Vec3<Float> &direction,
                     float near, float far) {
    const Vec3<Float> d = to_world.vector(direction);
    const Float stretch = length(d);
    return {to_world.point(origin), d / stretch, near * stretch, far * stretch};
}

template <class Float>
CameraRay<Float> Perspective::leave(const Vec3<Float> &origin, const Vec3<Float> &direction) const {
    // `direction` has z = 1, so that the clipping distances are along z. Cones are in units of a unit-length
    // ray.
    return {world_ray(to_world, origin, direction, near_clip, far_clip),
            {Float(0), pixel / length(direction)}};
}

// The change of a vector divided by its length, if the vector changes by `change`.
template <class Float>
Vec3<Float> change_of_unit(const Vec3<Float> &vector, const Vec3<Float> &change) {
    const Float squared = length_squared(vector);
    return (change - vector * (dot(vector, change) / squared)) / sqrt(squared);
}

template <class Float>
RayDifferentials<Float> Perspective::differentials_along(const Vec3<Float> &direction) const {
    const Vec3<Float> d = to_world.vector(direction), x = to_world.axis(0) * (-2 * pixel),
                      y = to_world.axis(1) * (-2 * pixel);
    return {{}, {}, change_of_unit(d, x), change_of_unit(d, y)};
}

template <class Float>
CameraRay<Float> Perspective::generate(const Vec2<Float> &film, const Vec2<Float> &) const {
    return leave(Vec3<Float>(0), through(film));
}

template <class Float>
CameraRay<Float> ThinLens::generate(const Vec2<Float> &film, const Vec2<Float> &lens) const {
    const Vec3<Float> origin = on_lens(lens);
    return leave(origin, towards_focus(film, origin));
}

template <class Float>
CameraRay<Float> Orthographic::generate(const Vec2<Float> &film, const Vec2<Float> &) const {
    const Vec3<Float> origin{1 - 2 * film.x, (1 - 2 * film.y) / aspect_, 0};
    CameraRay<Float> camera{world_ray(to_world, origin, Vec3<Float>{0, 0, 1}, near_clip, far_clip),
                            {pixel_, 0}};
    // Orthographic cameras are zoomed by their scale, which must not change the distance of the far plane.
    camera.ray.far = camera.ray.near + (far_clip - near_clip);
    return camera;
}

// The lens is a disk in world space, and the focus distance is measured there, for any scale of the camera.
template <class Float>
CameraRay<Float> Telecentric::generate(const Vec2<Float> &film, const Vec2<Float> &lens) const {
    CameraRay<Float> camera = Orthographic::generate(film, lens);
    const Vec2<Float> p = sample_disk(lens) * aperture_radius;
    const Vec3<Float> s = normalize(to_world.axis(0)), t = normalize(to_world.axis(1));
    const Vec3<Float> offset = s * p.x + t * p.y;
    camera.ray.direction = normalize(camera.ray.direction * focus_distance - offset);
    camera.ray.origin += offset;
    return camera;
}

template <class Float>
CameraRay<Float> Spherical::generate(const Vec2<Float> &film, const Vec2<Float> &) const {
    const auto [sin_phi, cos_phi] = sine_cosine(2 * pi * film.x);
    const auto [sin_theta, cos_theta] = sine_cosine(pi * film.y);
    const Vec3<Float> local{sin_phi * sin_theta, cos_theta, -cos_phi * sin_theta};
    return {{Vec3<Float>(to_world.origin()), normalize(to_world.vector(local))}, {0, pixel_}};
}

template <class Float>
RayDifferentials<Float> Spherical::differentials(const Vec2<Float> &film, const Vec2<Float> &) const {
    const auto [sin_phi, cos_phi] = sine_cosine(2 * pi * film.x);
    const auto [sin_theta, cos_theta] = sine_cosine(pi * film.y);
    const Vec3<Float> d = to_world.vector(Vec3<Float>{sin_phi * sin_theta, cos_theta, -cos_phi * sin_theta}),
                      by_phi = to_world.vector(Vec3<Float>{cos_phi * sin_theta, 0, sin_phi * sin_theta}),
                      by_theta =
                          to_world.vector(Vec3<Float>{sin_phi * cos_theta, -sin_theta, -cos_phi * cos_theta});
    return {{},
            {},
            change_of_unit(d, by_phi * Float(2 * pixel_)),
            change_of_unit(d, by_theta * Float(pixel_height_))};
}

template <class Float>
CameraRay<Float> RadianceMeter::generate(const Vec2<Float> &, const Vec2<Float> &) const {
    return {{Vec3<Float>(to_world.origin()), Vec3<Float>(normalize(to_world.axis(2)))}, {}};
}

template <class Float>
CameraRay<Float> Distant::generate(const Vec2<Float> &, const Vec2<Float> &lens) const {
    const Vec2<Float> p = sample_disk(lens) * scene_.radius;
    const Vec3<Float> s = axes_.s, t = axes_.t, n = axes_.n, centre = scene_.center;
    const Vec3<Float> through = has_target ? Vec3<Float>(target) : centre + s * p.x + t * p.y;
    const Float distance = 2 * scene_.radius + length(through - centre);
    return {{through - n * distance, n}, {}};
}

} // namespace lajolla
