#include "lights/area_light.h"

#include <algorithm>

namespace lajolla {

// Textured rectangles are sampled by a table of their luminance. It need not be exact, but must not be zero
// where the texture is not.
void AreaLight::prepare_sampling(std::span<const TextureModel> textures) {
    table_ = {};
    const auto *rectangle = std::get_if<Rectangle>(shape);
    if (!rectangle || radiance.is_constant()) return;
    const auto *bitmap = std::get_if<Bitmap>(&textures[static_cast<std::size_t>(radiance.id)]);
    constexpr std::uint32_t finest = 512;
    const std::uint32_t width = std::min(bitmap ? bitmap->image->width : finest, finest),
                        height = std::min(bitmap ? bitmap->image->height : finest, finest);
    constexpr int probes = 2; // along each side of a cell
    std::vector<float> weights(static_cast<std::size_t>(width) * height);
    double sum = 0;
    for (std::uint32_t y = 0; y < height * probes; ++y)
        for (std::uint32_t x = 0; x < width * probes; ++x) {
            const Vec2f u{(static_cast<float>(x) + 0.5f) / static_cast<float>(width * probes),
                          (static_cast<float>(y) + 0.5f) / static_cast<float>(height * probes)};
            const float value = luminance(radiance_at(rectangle->sample(0, u), textures));
            weights[static_cast<std::size_t>(y / probes) * width + x / probes] += std::max(value, 0.0f);
            sum += value;
        }
    constexpr float uniform_share = 0.1f;
    const auto least = uniform_share * static_cast<float>(sum / static_cast<double>(weights.size()));
    for (float &weight : weights) weight += least;
    if (sum > 0) table_ = Distribution2D(weights, width, height);
}

float AreaLight::area() const {
    return match(*shape, [](const auto &s) { return s.area(); });
}

float AreaLight::power(std::span<const TextureModel> textures, const BoundingSphere &) const {
    return pi * area() * (radiance.is_constant() ? luminance(radiance.constant) : mean_luminance(textures));
}

float AreaLight::mean_luminance(std::span<const TextureModel> textures) const {
    constexpr int grid = 32; // of points: power is only used to select lights
    float sum = 0;
    for (int j = 0; j < grid; ++j)
        for (int i = 0; i < grid; ++i) {
            const Vec2f u{(static_cast<float>(i) + 0.5f) / grid, (static_cast<float>(j) + 0.5f) / grid};
            const float which = (static_cast<float>((j * 13 + i * 7) % grid) + 0.5f) / grid;
            const SurfaceSample point = match(*shape, [&](const auto &s) { return s.sample(which, u); });
            sum += luminance(radiance_at(point, textures));
        }
    return sum / (grid * grid);
}

DirectSample<float> AreaLight::sample_direct(const Vec3f &p, float u_primitive, Vec2f u,
                                             std::span<const TextureModel> textures) const {
    float density = 1; // over the rectangle's own coordinates
    if (!table_.empty()) {
        const auto chosen = table_.sample(u);
        u = chosen.position;
        density = chosen.pdf;
    }
    const auto *sphere = std::get_if<Sphere>(shape);
    const auto cone = sphere ? cone_towards(sphere->center, sphere->radius, p) : SphereCone<float>{};
    const SurfaceSample point = sphere
                                    ? sphere->at(sample_seen_side(cone, sphere->radius, u))
                                    : match(*shape, [&](const auto &s) { return s.sample(u_primitive, u); });
    DirectSample<float> sample =
        sample_towards(p, point.position, point.normal, point.position_error, density * point.area_pdf);
    if (!(sample.pdf > 0)) return {};
    if (cone.exists) sample.pdf = cone_pdf(cone.height);
    sample.radiance = radiance.is_constant() ? radiance.constant : radiance_at(point, textures);
    return sample;
}

Spectrum AreaLight::radiance_at(const SurfaceSample &point, std::span<const TextureModel> textures) const {
    // For a ray at normal incidence from the front.
    const float distance = std::max(point.position_error, 1e-20f);
    const RayHit found{distance, point.b1, point.b2, 0, point.primitive};
    Hit<float> hit{};
    hit.primitive = static_cast<std::int32_t>(point.primitive);
    match(*shape, [&](const auto &s) {
        s.fill({point.position + point.normal * distance, -point.normal}, found, HitNeeds{}, hit);
    });
    return read_radiance(hit, textures);
}

Spectrum AreaLight::read_radiance(Hit<float> hit, std::span<const TextureModel> textures) const {
    hit.shape = 0; // index in the light's shapes: it has one
    return TextureReader<float>(textures, {hit.uv, &hit, shape, {}, false})(radiance);
}

Spectrum AreaLight::emitted(const Hit<float> &hit, const Vec3f &wo,
                            std::span<const TextureModel> textures) const {
    if (!(dot(hit.normal, wo) > 0)) return Spectrum(0);
    return radiance.is_constant() ? radiance.constant : read_radiance(hit, textures); // as sampling reads it
}

float AreaLight::pdf_hit(const Vec3f &p, const Hit<float> &hit, const Vec3f &wi) const {
    if (const auto *sphere = std::get_if<Sphere>(shape))
        if (const auto cone = cone_towards(sphere->center, sphere->radius, p); cone.exists)
            return cone_pdf(cone.height);
    const float density = table_.empty() ? 1 : table_.pdf(hit.uv);
    return solid_angle_pdf(p, hit.position, hit.normal, wi, density / area());
}

} // namespace lajolla
