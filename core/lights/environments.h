#pragma once
// Lights at infinity, which rays without a hit reach. They look the same from every point.

#include <array>
#include <memory>
#include <span>
#include <tuple>

#include "base/distribution.h"
#include "base/fields.h"
#include "base/transform.h"
#include "base/warp.h"
#include "images/image.h"
#include "lights/direct_sample.h"
#include "textures/textures.h"

namespace lajolla {

// What all of them have.
struct EnvironmentLight {
    bool visible_to_camera = true;

    static constexpr auto fields() {
        return std::tuple(field("visible_to_camera", &EnvironmentLight::visible_to_camera,
                                "if not, it lights and is reflected, but is no background"));
    }
};

struct ConstantLight : EnvironmentLight {
    static constexpr const char *name = "constant";
    static constexpr const char *doc = "A constant environment light.";
    Spectrum radiance{1};

    static constexpr auto fields() {
        return std::tuple_cat(
            std::tuple(field("radiance", &ConstantLight::radiance, "radiance from every direction")
                           .range(0)
                           .unit("W/(m^2 sr)")),
            EnvironmentLight::fields());
    }
    float power(std::span<const TextureModel>, const BoundingSphere &scene) const {
        return 4 * pi * pi * sqr(scene.radius) * luminance(radiance);
    }
    template <class Float>
    DirectSample<Float> sample_direct(const Vec3<Float> &, Float, const Vec2<Float> &u,
                                      std::span<const TextureModel>) const {
        return {sample_sphere(u), infinity, {}, radiance, sphere_pdf};
    }
    template <class Float>
    Rgb<Float> emitted(const Vec3<Float> &) const {
        return radiance;
    }
    template <class Float>
    Float pdf_direction(const Vec3<Float> &) const {
        return sphere_pdf;
    }
};

// How directions towards an environment map are sampled: by its radiance; mostly by what exceeds the mean
// radiance, because sampling BSDFs finds the rest (MIS compensation; Karlik et al. 2019); or uniformly.
enum class MapSampling { radiance, compensated, uniform };
constexpr auto choices(MapSampling) { return std::array{"radiance", "compensated", "uniform"}; }

struct EnvironmentMap : EnvironmentLight {
    static constexpr const char *name = "envmap";
    static constexpr const char *doc =
        "Light from all around, from an image in latitude and longitude; +y is up.";
    std::shared_ptr<const Image> image;
    float theta_max = 180;
    float scale = 1;
    Transform to_world;
    MapSampling sampling = MapSampling::compensated;

    static constexpr auto fields() {
        return std::tuple_cat(
            std::tuple(field("image", &EnvironmentMap::image, "radiance, twice as wide as high"),
                       field("theta_max", &EnvironmentMap::theta_max,
                             "angle from +y at which the image ends; beyond it is black")
                           .range(1, 180)
                           .unit("degrees"),
                       field("scale", &EnvironmentMap::scale, "factor on the image").range(0),
                       field("to_world", &EnvironmentMap::to_world, "orientation in the scene"),
                       field("sampling", &EnvironmentMap::sampling,
                             "of directions: by radiance, mostly by what exceeds the mean, or uniformly")),
            EnvironmentLight::fields());
    }
    void build();
    float power(std::span<const TextureModel>, const BoundingSphere &scene) const;
    template <class Float>
    DirectSample<Float> sample_direct(const Vec3<Float> &p, Float, const Vec2<Float> &u,
                                      std::span<const TextureModel>) const;
    template <class Float>
    Rgb<Float> emitted(const Vec3<Float> &direction) const; // radiance along a direction
    template <class Float>
    Float pdf_direction(const Vec3<Float> &wi) const;

private:
    // The image position of a direction; square.y > 1 is outside of the image.
    template <class Float>
    struct Place {
        Vec2<Float> square;
        Float sin_theta;
    };
    template <class Float>
    Place<Float> place_of(const Vec3<Float> &direction) const;
    template <class Float>
    Rgb<Float> look_up(const Vec2<Float> &square) const;

    Transform to_local_;
    Distribution2D distribution_; // over cells between texel centres, as `sampling` says
    float mean_radiance_ = 0;
    float half_texel_ = 0; // of the square's width
    float height_ = pi;    // of the image: theta_max in radians
};

// The square is (phi / 2 pi, theta / height), phi counted from the centre of the first column. It covers the
// sphere's solid angle with d omega = sin(theta) d theta d phi = 2 pi height sin(theta) d square: densities
// over the square are divided by that, and sin(theta) comes from the direction itself.
template <class Float>
EnvironmentMap::Place<Float> EnvironmentMap::place_of(const Vec3<Float> &direction) const {
    const Vec3<Float> d = to_local_.vector(direction); // its length is one over to_world's scale
    const Float turn = atan2(d.x, -d.z) * (0.5f * inv_pi) - half_texel_;
    const Float r_squared = d.x * d.x + d.z * d.z, r = sqrt(r_squared);
    return {{turn - floor(turn), atan2(r, d.y) / height_}, r / sqrt(r_squared + d.y * d.y)};
}

template <class Float>
Rgb<Float> EnvironmentMap::look_up(const Vec2<Float> &square) const {
    const Vec2<Float> size{static_cast<float>(image->width), static_cast<float>(image->height - 1)};
    return bilinear(*image, square * size + Vec2<Float>{0.5f, 0.5f}, WrapMode::repeat, WrapMode::clamp) *
           Float(scale);
}

template <class Float>
Rgb<Float> EnvironmentMap::emitted(const Vec3<Float> &direction) const {
    const Vec2<Float> square = place_of(direction).square;
    return select(square.y <= 1.0f, look_up(square), Rgb<Float>(0));
}

template <class Float>
DirectSample<Float> EnvironmentMap::sample_direct(const Vec3<Float> &, Float, const Vec2<Float> &u,
                                                  std::span<const TextureModel>) const {
    const auto [square, density] = distribution_.sample(u);
    const auto [sin_theta, cos_theta] = sine_cosine(height_ * square.y);
    const auto [sin_phi, cos_phi] = sine_cosine(2 * pi * (square.x + half_texel_));
    const Vec3<Float> local{sin_phi * sin_theta, cos_theta, -cos_phi * sin_theta};
    const Float pdf = density / (2 * pi * height_ * sin_theta);
    return {normalize(to_world.vector(local)),
            infinity,
            {},
            look_up(square),
            select(sin_theta > 0.0f && density > 0.0f, pdf, Float(0))};
}

template <class Float>
Float EnvironmentMap::pdf_direction(const Vec3<Float> &wi) const {
    const auto [square, sin_theta] = place_of(wi);
    const Float pdf = distribution_.pdf(square) / (2 * pi * height_ * sin_theta);
    return select(sin_theta > 0.0f && square.y <= 1.0f, pdf, Float(0));
}

struct DistantDisk : EnvironmentLight {
    static constexpr const char *name = "distantdisk";
    static constexpr const char *doc =
        "A round light infinitely far away, equally bright all over, such as the sun.";
    Vec3f direction{0, 0, 1};
    Spectrum irradiance{1};
    float angle = 0.5358f;

    static constexpr auto fields() {
        return std::tuple_cat(
            std::tuple(
                field("direction", &DistantDisk::direction, "in which the light of its centre travels"),
                field("irradiance", &DistantDisk::irradiance, "on a surface facing the light")
                    .range(0)
                    .unit("W/m^2"),
                field("angle", &DistantDisk::angle, "that its diameter covers")
                    .range(1e-2, 180)
                    .unit("degrees")),
            EnvironmentLight::fields());
    }
    void build();
    float power(std::span<const TextureModel>, const BoundingSphere &scene) const {
        return pi * sqr(scene.radius) * 2 * pi * height_ * luminance(radiance_);
    }
    template <class Float>
    DirectSample<Float> sample_direct(const Vec3<Float> &, Float, const Vec2<Float> &u,
                                      std::span<const TextureModel>) const {
        const Frame<Float> axes{axes_.s, axes_.t, axes_.n};
        const Vec3<Float> wi = normalize(axes.to_world(sample_cone(u, Float(height_))));
        return {wi, infinity, {}, radiance_, cone_pdf(height_)};
    }
    template <class Float>
    Rgb<Float> emitted(const Vec3<Float> &wi) const {
        return select(covers(wi), Rgb<Float>(radiance_), Rgb<Float>(0));
    }
    template <class Float>
    Float pdf_direction(const Vec3<Float> &wi) const {
        return select(covers(wi), Float(cone_pdf(height_)), Float(0));
    }

private:
    // By the squared distance of unit vectors, 2 (1 - cos), which does not cancel.
    template <class Float>
    BoolOf<Float> covers(const Vec3<Float> &wi) const {
        return length_squared(wi - Vec3<Float>(axes_.n)) <= 2 * height_;
    }

    Frame<float> axes_; // n towards the light
    float height_ = 0;  // 1 - cos of half the angle
    Spectrum radiance_{0};
};

// Lights at infinity that rays can reach.
template <class T>
concept IsEnvironment = requires(const T &light, Vec3f w) { light.pdf_direction(w); };

} // namespace lajolla
