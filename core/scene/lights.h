#pragma once
// The list of lights. Everything is measured in solid angle: a light is sampled towards a point, and answers
// with which density it would have sampled a direction; no integrator asks what kind of light it is.

#include <memory>
#include <tuple>
#include <variant>

#include "base/distribution.h"
#include "base/fields.h"
#include "base/match.h"
#include "base/texture.h"
#include "base/transform.h"
#include "scene/hit.h"
#include "scene/image.h"
#include "scene/shapes.h"
#include "scene/textures.h"

namespace lajolla {

struct BoundingSphere {
    Vec3f center{0};
    float radius = 1;
};

// A direction towards a light; none where pdf is zero.
struct DirectSample {
    Vec3f wi{0};          // unit length
    float distance = 0;   // infinity for lights around the scene
    Vec3f target{0};      // where the light is, moved off its surface; meaningless at infinite distance
    Spectrum radiance{0}; // for lights without area: radiant intensity over squared distance, or irradiance
    float pdf = 0;        // per solid angle; 1 for lights that no ray can hit
    bool delta = false;   // no ray can hit the light, only sampling finds it
};

struct AreaLight {
    static constexpr const char *name = "area";
    static constexpr const char *doc =
        "A shape that shines from its front side, equally bright in all directions.";
    Texture<Spectrum> radiance{Spectrum(1)};
    const Shape *shape = nullptr; // set by the scene

    static constexpr auto fields() {
        return std::tuple(
            field("radiance", &AreaLight::radiance, "emitted radiance").range(0).unit("W/(m^2 sr)"));
    }
    float power(std::span<const TextureModel> textures, const BoundingSphere &) const;
    DirectSample sample_direct(const Vec3f &p, float u_primitive, Vec2f u,
                               std::span<const TextureModel> textures) const;
    float pdf_hit(const Vec3f &p, const Hit &hit, const Vec3f &wi) const; // of sampling this hit from p
    Spectrum emitted(const Hit &hit, const Vec3f &wo, std::span<const TextureModel> textures) const {
        if (dot(hit.normal, wo) <= 0) return Spectrum(0);
        return TextureReader(textures, {hit.uv, &hit, shape})(radiance); // as sampling reads it
    }

private:
    Spectrum radiance_at(const SurfaceSample &point, std::span<const TextureModel> textures) const;
};

struct ConstantLight {
    static constexpr const char *name = "constant";
    static constexpr const char *doc = "Light of the same radiance from all around the scene.";
    Spectrum radiance{1};

    static constexpr auto fields() {
        return std::tuple(field("radiance", &ConstantLight::radiance, "radiance from every direction")
                              .range(0)
                              .unit("W/(m^2 sr)"));
    }
    float power(std::span<const TextureModel>, const BoundingSphere &scene) const {
        return 4 * pi * pi * sqr(scene.radius) * luminance(radiance);
    }
    DirectSample sample_direct(const Vec3f &, float, Vec2f u, std::span<const TextureModel>) const {
        return DirectSample{sample_sphere(u), infinity, {}, radiance, sphere_pdf};
    }
    Spectrum emitted(const Vec3f &) const { return radiance; }
    float pdf_direction(const Vec3f &) const { return sphere_pdf; }
};

struct EnvironmentMap {
    static constexpr const char *name = "envmap";
    static constexpr const char *doc =
        "Light from all around, from an image in latitude and longitude; +y is up.";
    std::shared_ptr<const Image> image;
    float scale = 1;
    Transform to_world;

    static constexpr auto fields() {
        return std::tuple(field("image", &EnvironmentMap::image, "radiance, twice as wide as high"),
                          field("scale", &EnvironmentMap::scale, "factor on the image").range(0),
                          field("to_world", &EnvironmentMap::to_world, "orientation in the scene"));
    }
    void build();
    float power(std::span<const TextureModel>, const BoundingSphere &scene) const;
    DirectSample sample_direct(const Vec3f &p, float, Vec2f u, std::span<const TextureModel>) const;
    Spectrum emitted(const Vec3f &direction) const; // seen along a direction
    float pdf_direction(const Vec3f &wi) const;

private:
    Vec2f to_square(const Vec3f &direction) const;
    Spectrum look_up(Vec2f square) const;

    Transform to_local_;
    Distribution2D distribution_; // over cells between texel centres, by luminance and solid angle
    float mean_radiance_ = 0;
};

struct PointLight {
    static constexpr const char *name = "point";
    static constexpr const char *doc = "A point that shines equally in all directions.";
    Vec3f position{0};
    Spectrum intensity{1};

    static constexpr auto fields() {
        return std::tuple(
            field("position", &PointLight::position, "where it stands"),
            field("intensity", &PointLight::intensity, "radiant intensity").range(0).unit("W/sr"));
    }
    float power(std::span<const TextureModel>, const BoundingSphere &) const {
        return 4 * pi * luminance(intensity);
    }
    DirectSample sample_direct(const Vec3f &p, float, Vec2f, std::span<const TextureModel>) const;
};

struct DirectionalLight {
    static constexpr const char *name = "directional";
    static constexpr const char *doc = "Parallel light from infinitely far away.";
    Vec3f direction{0, 0, 1};
    Spectrum irradiance{1};

    static constexpr auto fields() {
        return std::tuple(field("direction", &DirectionalLight::direction, "in which the light travels"),
                          field("irradiance", &DirectionalLight::irradiance, "on a surface facing the light")
                              .range(0)
                              .unit("W/m^2"));
    }
    void build();
    float power(std::span<const TextureModel>, const BoundingSphere &scene) const {
        return pi * sqr(scene.radius) * luminance(irradiance);
    }
    DirectSample sample_direct(const Vec3f &, float, Vec2f, std::span<const TextureModel>) const {
        return DirectSample{-direction, infinity, {}, irradiance, 1, true};
    }
};

struct SpotLight {
    static constexpr const char *name = "spot";
    static constexpr const char *doc = "A point that shines in a cone around +z, before to_world.";
    Spectrum intensity{1};
    float cutoff_angle = 20, beam_width = -1;
    Transform to_world;
    Frame axes;

    static constexpr auto fields() {
        return std::tuple(
            field("intensity", &SpotLight::intensity, "radiant intensity along the axis")
                .range(0)
                .unit("W/sr"),
            field("cutoff_angle", &SpotLight::cutoff_angle, "between the axis and darkness")
                .range(0, 180)
                .unit("degrees"),
            field("beam_width", &SpotLight::beam_width,
                  "between the axis and where the light begins to fall off; negative: 3/4 of cutoff_angle")
                .range(-1, 180)
                .unit("degrees"),
            field("to_world", &SpotLight::to_world, "placement in the scene"));
    }
    void build();
    float power(std::span<const TextureModel>, const BoundingSphere &) const;
    DirectSample sample_direct(const Vec3f &p, float, Vec2f, std::span<const TextureModel>) const;

private:
    float falloff(float cos_angle) const;
};

using Light = std::variant<AreaLight, ConstantLight, EnvironmentMap, PointLight, DirectionalLight, SpotLight>;

// Lights around the scene, which rays find by missing everything.
template <class T>
concept IsEnvironment = requires(const T &light, Vec3f w) { light.pdf_direction(w); };

// Lights that have no area and no extent in solid angle.
template <class T>
concept IsDeltaLight =
    std::is_same_v<T, PointLight> || std::is_same_v<T, DirectionalLight> || std::is_same_v<T, SpotLight>;

// All lights of a scene, picked by power.
class LightPicker {
public:
    LightPicker() = default;
    LightPicker(std::span<const Light> lights, std::span<const TextureModel> textures,
                const BoundingSphere &scene);

    // No light has any power: there is nothing to sample.
    bool empty() const { return !(powers_.sum() > 0); }
    // Whether some light can be found by sampling it alone.
    bool has_delta_lights() const { return has_delta_lights_; }
    // `u_pick` also chooses within a light; densities include the pick.
    DirectSample sample_direct(const Vec3f &p, float u_pick, Vec2f u) const;
    // Density of sampling a hit on a light, or a direction that leaves the scene, from p.
    float pdf_hit(const Vec3f &p, const Hit &hit, const Vec3f &wi) const;
    float pdf_environment(const Vec3f &wi) const;
    // Radiance that a ray carries from a light it hits, or from around the scene.
    Spectrum emitted(const Hit &hit, const Vec3f &wo) const;
    Spectrum environment(const Vec3f &direction) const;

private:
    std::span<const Light> lights_;
    std::span<const TextureModel> textures_;
    std::int32_t environment_ = -1;
    bool has_delta_lights_ = false;
    Distribution powers_;
};

} // namespace lajolla
