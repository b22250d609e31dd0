#include "lights/environments.h"

#include <stdexcept>

namespace lajolla {

namespace {

// The weight of a cell by its luminance times its solid angle, and by that angle alone. Compensated, it is
// what exceeds the mean luminance (Karlik et al. 2019, equation 14), but at least a quarter: light that no
// BSDF sample looks for, as of shadow catchers, must be found too.
float weight_for(MapSampling sampling, float light, float solid_angle, float mean) {
    if (sampling == MapSampling::radiance) return light;
    if (sampling == MapSampling::uniform) return solid_angle;
    return std::max(light - mean * solid_angle, 0.25f * light);
}

} // namespace

// The image's first row is at the upper pole, and its last row at the lower one, as in Mitsuba 3, or at
// theta_max; each column is in the centre of its range of azimuths.

void EnvironmentMap::build() {
    if (!image || image->width == 0 || image->height == 0)
        throw std::invalid_argument("an envmap needs an image");
    const auto inverted = inverse(to_world);
    if (!inverted || !uniform_scale(to_world))
        throw std::invalid_argument(
            "to_world of an envmap must be a rotation, without shear or uneven scaling");
    to_local_ = *inverted;
    height_ = theta_max / 180 * pi;
    half_texel_ = 0.5f / static_cast<float>(image->width);
    // The corners of a cell are texel centres, so that its weight is zero only if all its values are.
    const std::uint32_t width = image->width, rows = std::max(image->height, 2u) - 1;
    std::vector<float> weights(static_cast<std::size_t>(width) * rows), bands(rows);
    double sum = 0, solid_angle = 0;
    for (std::uint32_t y = 0; y < rows; ++y) {
        const float low = height_ * static_cast<float>(y) / static_cast<float>(rows);
        const float high = height_ * static_cast<float>(y + 1) / static_cast<float>(rows);
        const float band = bands[y] = cos(low) - cos(high); // solid angle of the row over 2 pi
        const std::uint32_t below = std::min(y + 1, image->height - 1);
        for (std::uint32_t x = 0; x < width; ++x) {
            const std::uint32_t right = (x + 1) % width;
            const Spectrum corners = image->texel(x, y) + image->texel(right, y) + image->texel(x, below) +
                                     image->texel(right, below);
            const std::size_t cell = static_cast<std::size_t>(y) * width + x;
            weights[cell] = std::max(luminance(corners) / 4, 0.0f) * band;
            sum += weights[cell], solid_angle += band;
        }
    }
    mean_radiance_ = static_cast<float>(sum / (2.0 * width));
    const auto mean = static_cast<float>(sum / solid_angle);
    for (std::size_t cell = 0; cell < weights.size(); ++cell)
        weights[cell] = weight_for(sampling, weights[cell], bands[cell / width], mean);
    distribution_ = Distribution2D(weights, width, rows);
}

float EnvironmentMap::power(std::span<const TextureModel>, const BoundingSphere &scene) const {
    return 4 * pi * pi * sqr(scene.radius) * scale * mean_radiance_;
}

void DistantDisk::build() {
    if (!(length(direction) > 0)) throw std::invalid_argument("direction of a distant disk has no length");
    direction = normalize(direction);
    axes_ = frame_around(-direction);
    const float half = angle * (pi / 180) / 2;
    height_ = 2 * sqr(sin(half / 2));
    radiance_ = irradiance / (pi * sqr(sin(half))); // the integral of the cosine over the disk
}

} // namespace lajolla
