#include "lights/point_lights.h"

#include <stdexcept>
#include <string>

namespace lajolla {

namespace {

constexpr float degrees = pi / 180;

Transform inverse_of(const Transform &to_world, const char *light) {
    const auto inverted = inverse(to_world);
    if (!inverted)
        throw std::invalid_argument(std::string("to_world of a ") + light +
                                    " is singular: it shines nowhere");
    return *inverted;
}

Spectrum read_at(const Texture<Spectrum> &texture, Vec2f uv, std::span<const TextureModel> textures) {
    if (texture.is_constant()) return texture.constant;
    return TextureReader<float>(textures, {uv, nullptr, nullptr, {}, false})(texture);
}

} // namespace

DirectSample<float> PointLight::sample_direct(const Vec3f &p, float, Vec2f,
                                              std::span<const TextureModel>) const {
    const Vec3f to_light = position - p;
    const float squared = length_squared(to_light), distance = std::sqrt(squared);
    if (!(squared > 0)) return {};
    return DirectSample<float>{to_light / distance, distance, position, intensity / squared, 1, true};
}

void DirectionalLight::build() {
    if (!(length(direction) > 0))
        throw std::invalid_argument("direction of a directional light has no length");
    direction = normalize(direction);
}

void SpotLight::build() {
    to_local_ = inverse_of(to_world, "spot light");
    if (beam_width < 0) beam_width = 0.75f * cutoff_angle;
    if (beam_width > cutoff_angle) throw std::invalid_argument("beam_width is larger than cutoff_angle");
    axes_ = frame_around(normalize(to_world.vector({0, 0, 1})));
    square_ = tan(cutoff_angle * degrees);
}

float SpotLight::falloff(float cos_angle) const {
    const float angle = acos(std::clamp(cos_angle, -1.0f, 1.0f)) / degrees;
    if (angle <= beam_width) return 1;
    return angle >= cutoff_angle ? 0 : (cutoff_angle - angle) / (cutoff_angle - beam_width);
}

Spectrum SpotLight::shine(const Vec3f &direction, std::span<const TextureModel> textures) const {
    const Spectrum plain = intensity * falloff(dot(direction, axes_.n));
    if (texture.is_constant() || is_black(plain)) return plain * texture.constant;
    const Vec3f local = to_local_.vector(direction);
    const float scale = 0.5f / (local.z * square_);
    return plain * read_at(texture, {0.5f + local.x * scale, 0.5f + local.y * scale}, textures);
}

float SpotLight::power(std::span<const TextureModel> textures, const BoundingSphere &) const {
    const int steps = 256, turns = texture.is_constant() ? 1 : 256; // midpoint rule over the cone
    const float last = cutoff_angle * degrees;
    double sum = 0;
    for (int i = 0; i < steps; ++i)
        for (int j = 0; j < turns; ++j) {
            const float angle = (static_cast<float>(i) + 0.5f) * last / static_cast<float>(steps);
            const float phi = 2 * pi * (static_cast<float>(j) + 0.5f) / static_cast<float>(turns);
            const Vec3f local{sin(angle) * cos(phi), sin(angle) * sin(phi), cos(angle)};
            sum += luminance(shine(axes_.to_world(local), textures)) * sin(angle);
        }
    return 2 * pi * last * static_cast<float>(sum / (steps * turns));
}

DirectSample<float> SpotLight::sample_direct(const Vec3f &p, float, Vec2f,
                                             std::span<const TextureModel> textures) const {
    const Vec3f to_light = to_world.origin() - p;
    const float squared = length_squared(to_light), distance = std::sqrt(squared);
    if (!(squared > 0)) return {};
    const Vec3f wi = to_light / distance;
    const Spectrum arriving = shine(-wi, textures) / squared;
    if (is_black(arriving)) return {};
    return DirectSample<float>{wi, distance, to_world.origin(), arriving, 1, true};
}

void Projector::build() {
    to_local_ = inverse_of(to_world, "projector");
    axis_ = normalize(to_world.vector({0, 0, 1}));
    half_width_ = tan(fov * degrees / 2);
    half_height_ = half_width_ / aspect;
}

float Projector::power(std::span<const TextureModel> textures, const BoundingSphere &) const {
    // Intensity is picture / cos^3, and a step on a screen at z = 1 covers cos^3 of its area in solid angle.
    constexpr int grid = 128;
    double sum = 0;
    for (int j = 0; j < grid; ++j)
        for (int i = 0; i < grid; ++i) {
            const Vec2f uv{(static_cast<float>(i) + 0.5f) / grid, (static_cast<float>(j) + 0.5f) / grid};
            sum += luminance(read_at(irradiance, uv, textures));
        }
    return 4 * half_width_ * half_height_ * pi * scale * static_cast<float>(sum / (grid * grid));
}

// The factor pi is as in Mitsuba 3, where the picture is the radiance of a white diffuse screen.
DirectSample<float> Projector::sample_direct(const Vec3f &p, float, Vec2f,
                                             std::span<const TextureModel> textures) const {
    const Vec3f local = to_local_.point(p);
    const Vec3f to_light = to_world.origin() - p;
    const float distance = length(to_light);
    if (!(local.z > 0) || !(distance > 0)) return {};
    // As for cameras: +x to the left of the picture, +y up.
    const Vec2f uv{0.5f - local.x / (2 * local.z * half_width_),
                   0.5f - local.y / (2 * local.z * half_height_)};
    if (!(uv.x >= 0 && uv.x <= 1 && uv.y >= 0 && uv.y <= 1)) return {};
    const Vec3f wi = to_light / distance;
    const float cosine = -dot(wi, axis_);
    if (!(cosine > 0)) return {};
    const Spectrum arriving = read_at(irradiance, uv, textures) * (pi * scale / (sqr(local.z) * cosine));
    return DirectSample<float>{wi, distance, to_world.origin(), arriving, 1, true};
}

} // namespace lajolla
