#pragma once
// Lights that have no area and subtend no solid angle: no ray can hit them.

#include <span>
#include <tuple>

#include "base/fields.h"
#include "base/texture.h"
#include "base/transform.h"
#include "lights/direct_sample.h"
#include "textures/textures.h"

namespace lajolla {

struct PointLight {
    static constexpr const char *name = "point";
    static constexpr const char *doc = "An isotropic point light.";
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
    DirectSample<float> sample_direct(const Vec3f &p, float, Vec2f, std::span<const TextureModel>) const;
};

struct DirectionalLight {
    static constexpr const char *name = "directional";
    static constexpr const char *doc = "A directional light, infinitely far away.";
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
    DirectSample<float> sample_direct(const Vec3f &, float, Vec2f, std::span<const TextureModel>) const {
        return DirectSample<float>{-direction, infinity, {}, irradiance, 1, true};
    }
};

struct SpotLight {
    static constexpr const char *name = "spot";
    static constexpr const char *doc = "A spot light along +z, before to_world.";
    Spectrum intensity{1};
    Texture<Spectrum> texture{Spectrum(1)};
    float cutoff_angle = 20, beam_width = -1;
    Transform to_world;

    static constexpr auto fields() {
        return std::tuple(
            field("intensity", &SpotLight::intensity, "radiant intensity along the axis")
                .range(0)
                .unit("W/sr"),
            field("texture", &SpotLight::texture, "factor on the intensity, over the square around the cone")
                .range(0),
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
    float power(std::span<const TextureModel> textures, const BoundingSphere &) const;
    DirectSample<float> sample_direct(const Vec3f &p, float, Vec2f,
                                      std::span<const TextureModel> textures) const;

private:
    // Radiant intensity in the direction of emission.
    Spectrum shine(const Vec3f &direction, std::span<const TextureModel> textures) const;
    float falloff(float cos_angle) const;

    Frame<float> axes_;
    Transform to_local_;
    float square_ = 0; // half the side of the texture's square at z = 1
};

struct Projector {
    static constexpr const char *name = "projector";
    static constexpr const char *doc =
        "A camera turned into a lamp: a point that throws a picture along +z, with +y up, before to_world.";
    Texture<Spectrum> irradiance{Spectrum(1)};
    float scale = 1, fov = 50, aspect = 1;
    Transform to_world;

    static constexpr auto fields() {
        return std::tuple(
            field("irradiance", &Projector::irradiance, "the picture; over pi, on a screen at z = 1")
                .range(0)
                .unit("W/m^2"),
            field("scale", &Projector::scale, "factor on the picture").range(0),
            field("fov", &Projector::fov, "width of the picture").range(1e-3, 179.999).unit("degrees"),
            field("aspect", &Projector::aspect, "width of the picture over its height").range(1e-6, 1e6),
            field("to_world", &Projector::to_world, "placement in the scene"));
    }
    void build();
    float power(std::span<const TextureModel> textures, const BoundingSphere &) const;
    DirectSample<float> sample_direct(const Vec3f &p, float, Vec2f,
                                      std::span<const TextureModel> textures) const;

private:
    Transform to_local_;
    Vec3f axis_;
    float half_width_ = 0, half_height_ = 0; // at z = 1
};

} // namespace lajolla
