#pragma once
// The list of lights. Everything is measured in solid angle: a light is sampled towards a point, and answers
// with which density it would have sampled a direction; no integrator asks what kind of light it is.

#include <memory>
#include <tuple>
#include <variant>
#include <vector>

#include "base/distribution.h"
#include "base/fields.h"
#include "base/match.h"
#include "base/texture.h"
#include "base/transform.h"
#include "base/warp.h"
#include "scene/direct_sample.h"
#include "scene/hit.h"
#include "scene/image.h"
#include "scene/point_lights.h"
#include "scene/shapes.h"
#include "scene/textures.h"

namespace lajolla {

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
    // Once the shape is known.
    void prepare_sampling(std::span<const TextureModel> textures);
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
    float mean_luminance(std::span<const TextureModel> textures) const;

    Distribution2D table_; // of textured rectangles, over texture space
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

struct DistantDisk {
    static constexpr const char *name = "distantdisk";
    static constexpr const char *doc =
        "A round light infinitely far away, equally bright all over, such as the sun.";
    Vec3f direction{0, 0, 1};
    Spectrum irradiance{1};
    float angle = 0.5358f;

    static constexpr auto fields() {
        return std::tuple(
            field("direction", &DistantDisk::direction, "in which the light of its centre travels"),
            field("irradiance", &DistantDisk::irradiance, "on a surface facing the light")
                .range(0)
                .unit("W/m^2"),
            field("angle", &DistantDisk::angle, "that its diameter covers").range(1e-2, 180).unit("degrees"));
    }
    void build();
    float power(std::span<const TextureModel>, const BoundingSphere &scene) const {
        return pi * sqr(scene.radius) * 2 * pi * height_ * luminance(radiance_);
    }
    DirectSample sample_direct(const Vec3f &, float, Vec2f u, std::span<const TextureModel>) const;
    Spectrum emitted(const Vec3f &direction) const { return covers(direction) ? radiance_ : Spectrum(0); }
    float pdf_direction(const Vec3f &wi) const { return covers(wi) ? cone_pdf(height_) : 0; }

private:
    // By the squared distance of unit vectors, 2 (1 - cos), which does not cancel.
    bool covers(const Vec3f &wi) const { return length_squared(wi - axes_.n) <= 2 * height_; }

    Frame axes_;       // n towards the light
    float height_ = 0; // 1 - cos of half the angle
    Spectrum radiance_{0};
};

using Light = std::variant<AreaLight, ConstantLight, EnvironmentMap, DistantDisk, PointLight,
                           DirectionalLight, SpotLight, Projector>;

// Lights around the scene, which rays find by missing everything.
template <class T>
concept IsEnvironment = requires(const T &light, Vec3f w) { light.pdf_direction(w); };

// Lights that have no area and no extent in solid angle.
template <class T>
concept IsDeltaLight = std::is_same_v<T, PointLight> || std::is_same_v<T, DirectionalLight> ||
                       std::is_same_v<T, SpotLight> || std::is_same_v<T, Projector>;

// All lights of a scene, picked by power and evenly.
class LightPicker {
public:
    LightPicker() = default;
    LightPicker(std::span<const Light> lights, std::span<const TextureModel> textures,
                const BoundingSphere &scene);

    // No light has any power: there is nothing to sample.
    bool empty() const { return !(picks_.sum() > 0); }
    // Whether rays that leave the scene find a light.
    bool has_environment() const { return !environments_.empty(); }
    // Whether some light can be found by sampling it alone.
    bool has_delta_lights() const { return has_delta_lights_; }
    // `u_pick` also chooses within a light; densities include the pick.
    DirectSample sample_direct(const Vec3f &p, float u_pick, Vec2f u) const;
    // Density of sampling a hit on a light, or a direction that leaves the scene, from p.
    float pdf_hit(const Vec3f &p, const Hit &hit, const Vec3f &wi) const;
    float pdf_environment(const Vec3f &wi) const;
    // Radiance that a ray carries from a light it hits, or from around the scene. Lights around the scene
    // add up.
    Spectrum emitted(const Hit &hit, const Vec3f &wo) const;
    Spectrum environment(const Vec3f &direction) const;

private:
    std::span<const Light> lights_;
    std::span<const TextureModel> textures_;
    std::vector<std::uint32_t> environments_;
    bool has_delta_lights_ = false;
    Distribution picks_;
};

} // namespace lajolla
