#include "scene/textures.h"

#include <stdexcept>

namespace lajolla {

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
    const auto in = [&](const Image &pixels) {
        return Vec2f{p.x * static_cast<float>(pixels.width), p.y * static_cast<float>(pixels.height)};
    };
    if (filter_type == FilterType::nearest) return nearest(*image, in(*image), wrap_mode);
    const auto at = [&](std::size_t i) {
        const Image &pixels = i == 0 ? *image : levels[std::min(i, levels.size()) - 1];
        return bilinear(pixels, in(pixels), wrap_mode, wrap_mode);
    };
    if (levels.empty()) return at(0);
    const float fine = std::clamp(level(uv_footprint), 0.0f, static_cast<float>(levels.size()));
    const auto index = static_cast<std::size_t>(fine);
    const float between = fine - static_cast<float>(index);
    return between == 0 ? at(index) : lerp(between, at(index), at(index + 1));
}

} // namespace lajolla
