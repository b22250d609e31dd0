#include "scene/textures.h"

#include <stdexcept>

namespace lajolla {

namespace {

// The pixel index that an index outside [0, size) stands for, or -1 where the mode has no pixels there.
std::int32_t wrap(std::int32_t i, std::int32_t size, WrapMode mode) {
    if (i >= 0 && i < size) return i;
    switch (mode) {
    case WrapMode::repeat: {
        const std::int32_t rest = i % size;
        return rest < 0 ? rest + size : rest;
    }
    case WrapMode::mirror: {
        const std::int32_t rest = ((i % (2 * size)) + 2 * size) % (2 * size);
        return rest < size ? rest : 2 * size - 1 - rest;
    }
    case WrapMode::clamp: return i < 0 ? 0 : size - 1;
    default: return -1;
    }
}

float decode(std::uint8_t value, const float *table) { return table[value]; }
float decode(Image::Half value, const float *) { return static_cast<float>(value); }
float decode(float value, const float *) { return value; }

template <class Texel>
Spectrum fetch(const Texel *texel, std::uint32_t channels, const float *table) {
    if (channels == 1) return Spectrum(decode(texel[0], table));
    return {decode(texel[0], table), decode(texel[1], table), decode(texel[2], table)};
}

template <class Texel>
Spectrum wrapped(const Image &image, const Texel *texels, std::int32_t x, std::int32_t y, WrapMode mode,
                 const float *table) {
    const std::int32_t i = wrap(x, static_cast<std::int32_t>(image.width), mode);
    const std::int32_t j = wrap(y, static_cast<std::int32_t>(image.height), mode);
    if (i < 0 || j < 0) return Spectrum(mode == WrapMode::one ? 1.0f : 0.0f);
    const auto index = static_cast<std::size_t>(j) * image.width + static_cast<std::size_t>(i);
    return fetch(texels + index * image.channels, image.channels, table);
}

// Positions far outside the unit square lose their fraction anyway; this keeps them within the integers.
float bounded(float x) { return std::isfinite(x) ? std::clamp(x, -1e9f, 1e9f) : 0; }

Spectrum nearest(const Image &image, Vec2f uv, WrapMode mode) {
    const float x = std::floor(bounded(uv.x * static_cast<float>(image.width)));
    const float y = std::floor(bounded(uv.y * static_cast<float>(image.height)));
    return match(image.texels, [&](const auto &texels) {
        return wrapped(image, texels.data(), static_cast<std::int32_t>(x), static_cast<std::int32_t>(y), mode,
                       byte_decoding(image.srgb));
    });
}

Spectrum bilinear(const Image &image, Vec2f uv, WrapMode mode) {
    const float x = bounded(uv.x * static_cast<float>(image.width) - 0.5f);
    const float y = bounded(uv.y * static_cast<float>(image.height) - 0.5f);
    const float floor_x = std::floor(x), floor_y = std::floor(y), dx = x - floor_x, dy = y - floor_y;
    const auto i = static_cast<std::int32_t>(floor_x), j = static_cast<std::int32_t>(floor_y);
    const float *table = byte_decoding(image.srgb);
    return match(image.texels, [&](const auto &texels) {
        const auto at = [&](std::int32_t column, std::int32_t row) {
            return wrapped(image, texels.data(), column, row, mode, table);
        };
        return lerp(dy, lerp(dx, at(i, j), at(i + 1, j)), lerp(dx, at(i, j + 1), at(i + 1, j + 1)));
    });
}

} // namespace

void Bitmap::build() {
    if (!image || image->width == 0 || image->height == 0)
        throw std::invalid_argument("a bitmap needs an image");
    levels.clear();
    if (filter_type != FilterType::trilinear) return;
    for (const Image *last = image.get(); last->width > 1 || last->height > 1; last = &levels.back())
        levels.push_back(downsample(*last));
}

float Bitmap::level(float uv_footprint) const {
    const Vec3f u = to_uv.vector({1, 0, 0}), v = to_uv.vector({0, 1, 0});
    const float scale = std::max(std::hypot(u.x, u.y), std::hypot(v.x, v.y));
    const float texels = static_cast<float>(std::max(image->width, image->height)) * scale * uv_footprint;
    return std::log2(std::max(texels, 1e-8f));
}

Spectrum Bitmap::look_up(Vec2f uv, float uv_footprint) const {
    const Vec3f p = to_uv.point({uv.x, uv.y, 1});
    const Vec2f position{p.x, p.y};
    if (filter_type == FilterType::nearest) return nearest(*image, position, wrap_mode);
    if (filter_type == FilterType::bilinear || levels.empty()) return bilinear(*image, position, wrap_mode);
    const float fine = std::clamp(level(uv_footprint), 0.0f, static_cast<float>(levels.size()));
    const auto index = static_cast<std::size_t>(fine);
    const auto at = [&](std::size_t i) {
        return bilinear(i == 0 ? *image : levels[std::min(i, levels.size()) - 1], position, wrap_mode);
    };
    const float between = fine - static_cast<float>(index);
    return between == 0 ? at(index) : lerp(between, at(index), at(index + 1));
}

} // namespace lajolla
