#pragma once
// Pixel arrays as textures keep them: 8-bit stays 8-bit, half stays half.

#include <array>
#include <cstdint>
#include <memory>
#include <variant>
#include <vector>

#include "base/vec.h"

namespace lajolla {

struct Image {
    using Half = _Float16;

    std::uint32_t width = 0, height = 0;
    std::uint32_t channels = 1; // 1 (grey) or 3 (linear sRGB primaries)
    bool srgb = false;          // 8-bit values are sRGB encoded
    std::variant<std::vector<std::uint8_t>, std::vector<Half>, std::vector<float>>
        texels; // row by row from the top

    std::size_t bytes() const;
    // Linear value of a texel; x < width, y < height.
    Spectrum texel(std::uint32_t x, std::uint32_t y) const;
    // The least and the largest value that any texel may have; both infinite where one is not a number.
    std::array<float, 2> bounds() const;
};

enum class WrapMode { repeat, mirror, clamp, zero, one };
constexpr auto choices(WrapMode) { return std::array{"repeat", "mirror", "clamp", "zero", "one"}; }

// The value at a position in texels, where texel (i, j) covers the square from (i, j) to (i + 1, j + 1).
Spectrum nearest(const Image &image, Vec2f position, WrapMode wrap);
// The same with values interpolated between the texels' centres; wraps may differ between the axes.
Spectrum bilinear(const Image &image, Vec2f position, WrapMode wrap_x, WrapMode wrap_y);
// Its derivatives by x and y.
std::array<Spectrum, 2> bilinear_gradient(const Image &image, Vec2f position, WrapMode wrap);

// The symmetric matrix M of an ellipse of offsets p with p^T M^-1 p < 1.
struct Conic {
    float xx, xy, yy;
};
// The mean over the texels whose centres are within an ellipse around a position, weighted by a Gaussian that
// vanishes at the rim.
Spectrum gaussian(const Image &image, Vec2f position, const Conic &ellipse, WrapMode wrap);

// Halves the resolution by averaging linear values, each texel by the share of its area.
Image downsample(const Image &image);

} // namespace lajolla
