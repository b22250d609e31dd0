#include "scene/bitmap.h"

namespace lajolla {

namespace {

Vec2f in_texels(const Image &image, Vec2f v) {
    return {v.x * static_cast<float>(image.width), v.y * static_cast<float>(image.height)};
}

// M = radius0 radius0^T + radius1 radius1^T: its eigenvalues are the squared principal radii.
Conic conic_of(Vec2f radius0, Vec2f radius1) {
    return {sqr(radius0.x) + sqr(radius1.x), radius0.x * radius0.y + radius1.x * radius1.y,
            sqr(radius0.y) + sqr(radius1.y)};
}

struct Radii {
    float major, minor; // squared
};

Radii squared_radii(const Conic &m) {
    const float middle = (m.xx + m.yy) / 2, root = std::hypot((m.xx - m.yy) / 2, m.xy);
    return {middle + root, std::max(middle - root, 0.0f)};
}

// The ellipse along the same axes with other radii.
Conic with_radii(const Conic &m, Radii radii) {
    const float half_difference = (m.xx - m.yy) / 2, root = std::hypot(half_difference, m.xy);
    const float cos = root > 0 ? half_difference / root : 1, sin = root > 0 ? m.xy / root : 0; // of 2 theta
    const float middle = (radii.major + radii.minor) / 2, half = (radii.major - radii.minor) / 2;
    return {middle + half * cos, half * sin, middle - half * cos};
}

} // namespace

MipMap::MipMap(std::shared_ptr<const Image> image, FilterType filter, WrapMode wrap)
    : image_(std::move(image)), filter_(filter), wrap_(wrap) {
    if (!is_filtered()) return;
    for (const Image *last = image_.get(); last->width > 1 || last->height > 1; last = &coarser_.back())
        coarser_.push_back(downsample(*last));
}

std::size_t MipMap::bytes() const {
    std::size_t sum = image_->bytes();
    for (const Image &image : coarser_) sum += image.bytes();
    return sum;
}

Spectrum MipMap::bilinear_at(std::size_t i, Vec2f position) const {
    return bilinear(level(i), in_texels(level(i), position), wrap_, wrap_);
}

Spectrum MipMap::sharp(Vec2f position) const {
    return filter_ == FilterType::nearest ? nearest(*image_, in_texels(*image_, position), wrap_)
                                          : bilinear_at(0, position);
}

std::array<Spectrum, 2> MipMap::gradient(Vec2f position) const {
    if (filter_ == FilterType::nearest) return {Spectrum(0), Spectrum(0)};
    const auto [by_x, by_y] = bilinear_gradient(*image_, in_texels(*image_, position), wrap_);
    return {by_x * static_cast<float>(image_->width), by_y * static_cast<float>(image_->height)};
}

Spectrum MipMap::trilinear(Vec2f position, float level) const {
    const float fine = std::clamp(level, 0.0f, static_cast<float>(coarser_.size()));
    const auto index = static_cast<std::size_t>(fine);
    const float between = fine - static_cast<float>(index);
    return between == 0 ? bilinear_at(index, position)
                        : lerp(between, bilinear_at(index, position), bilinear_at(index + 1, position));
}

Spectrum MipMap::elliptical(Vec2f position, Vec2f radius0, Vec2f radius1, float max_anisotropy) const {
    const Radii finest = squared_radii(conic_of(in_texels(*image_, radius0), in_texels(*image_, radius1)));
    if (!(finest.major > 1)) return bilinear_at(0, position); // magnified
    const float minor = std::max(finest.minor, finest.major / sqr(max_anisotropy));
    const float fine = std::log2(std::max(minor, 1.0f)) / 2; // the shorter radius covers one texel or two
    if (!(fine < static_cast<float>(coarser_.size()))) return bilinear_at(coarser_.size(), position);
    const auto average = [&](std::size_t i) {
        const Image &texels = level(i);
        const Conic conic = conic_of(in_texels(texels, radius0), in_texels(texels, radius1));
        Radii radii = squared_radii(conic); // at least a texel, else there might be none inside
        radii.major = std::max(radii.major, 1.0f);
        radii.minor = std::max({radii.minor, radii.major / sqr(max_anisotropy), 1.0f});
        return gaussian(texels, in_texels(texels, position), with_radii(conic, radii), wrap_);
    };
    const auto index = static_cast<std::size_t>(fine);
    const float between = fine - static_cast<float>(index);
    return between == 0 ? average(index) : lerp(between, average(index), average(index + 1));
}

} // namespace lajolla
