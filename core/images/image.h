#pragma once
// Pixel arrays as textures keep them: 8-bit stays 8-bit, half stays half.

#include <array>
#include <cstdint>
#include <mutex>
#include <span>
#include <vector>

#include "base/vec.h"

namespace lajolla {

enum class TexelType { byte, half, real };

// The linear value of an 8-bit one.
float linear_byte(std::uint8_t value, bool srgb);

// An image, with room behind it for the levels of its MIP pyramid. All texels are in one array, so that lanes
// may read different levels at once; it consists of words of 32 bits, because such the processor gathers.
class Image {
public:
    using Half = _Float16;

    // Level i is width >> i texels wide and height >> i high, but one at least.
    struct Level {
        std::uint32_t width, height;
        std::int32_t first; // texel
    };

    // Values row by row from the top; T is std::uint8_t, Half or float. Throws std::invalid_argument where
    // there are more than lanes can count.
    template <class T>
    Image(std::uint32_t width, std::uint32_t height, std::uint32_t channels, bool srgb, const T *values);
    // Of the words of another image with these properties. Throws std::invalid_argument for another number of
    // them.
    Image(std::uint32_t width, std::uint32_t height, std::uint32_t channels, bool srgb, TexelType type,
          std::span<const std::int32_t> words);

    std::uint32_t width, height;
    std::uint32_t channels; // 1 (grey) or 3 (linear sRGB primaries)
    bool srgb;              // 8-bit values are sRGB encoded
    TexelType type;

    const std::vector<Level> &levels() const { return levels_; }
    // Fills in all levels: unfiltered lookups need only the first.
    void make_levels() const;
    // Of the first so many levels.
    std::size_t bytes(std::size_t level_count = 1) const;

    // Linear value of a texel; x < width, y < height.
    Spectrum texel(std::uint32_t x, std::uint32_t y) const;
    // The least and the largest value that any texel may have; both infinite where one is not a number.
    std::array<float, 2> bounds() const;

    // Texels of bytes and halves have four values in colour, the last of which counts for nothing; others as
    // many as channels. Values are packed in words from the lowest bits.
    const std::int32_t *words() const { return words_.data(); }
    // The first texel of each level.
    const std::int32_t *first_texels() const { return first_texels_.data(); }

private:
    Image(std::uint32_t width, std::uint32_t height, std::uint32_t channels, bool srgb, TexelType type);
    std::size_t words_before(std::size_t texel) const;
    template <class T>
    void put(std::size_t texel, std::size_t channel, T value) const; // where there is none yet
    void downsample(const Level &from, const Level &to) const;

    std::vector<Level> levels_;
    std::vector<std::int32_t> first_texels_;
    // The coarser levels are made on demand, once. None of this moves what is there already.
    mutable std::vector<std::int32_t> words_;
    mutable std::once_flag levels_made_;
};

enum class WrapMode { repeat, mirror, clamp, zero, one };
constexpr auto choices(WrapMode) { return std::array{"repeat", "mirror", "clamp", "zero", "one"}; }

// The part of an image's texels that is one level of it.
template <class Float>
struct Window {
    Float width, height;
    IntOf<Float> first;
};
template <class Float>
Window<Float> sharpest(const Image &image) {
    return {to_float(static_cast<std::int32_t>(image.width)),
            to_float(static_cast<std::int32_t>(image.height)), 0};
}
template <class Float>
Window<Float> window(const Image &image, IntOf<Float> level) {
    const auto [width, height, first] = sharpest<Float>(image);
    const Float shrink = as_float((127 - level) << 23); // 2^-level
    return {max(floor(width * shrink), Float(1)), max(floor(height * shrink), Float(1)),
            gather(image.first_texels(), level)};
}

// The value at a position in texels, where texel (i, j) covers the square from (i, j) to (i + 1, j + 1).
template <class Float>
Rgb<Float> nearest(const Image &image, Vec2<Float> position, WrapMode wrap);
// The same with values interpolated between the texels' centres; wraps may differ between the axes.
template <class Float>
Rgb<Float> bilinear(const Image &image, const Window<Float> &window, Vec2<Float> position, WrapMode wrap_x,
                    WrapMode wrap_y);
template <class Float>
Rgb<Float> bilinear(const Image &image, Vec2<Float> position, WrapMode wrap_x, WrapMode wrap_y) {
    return bilinear(image, sharpest<Float>(image), position, wrap_x, wrap_y);
}
// Its derivatives by x and y.
template <class Float>
std::array<Rgb<Float>, 2> bilinear_gradient(const Image &image, Vec2<Float> position, WrapMode wrap);

// The symmetric matrix M of an ellipse of offsets p with p^T M^-1 p < 1.
template <class Float>
struct Conic {
    Float xx, xy, yy;
};
// The mean over the texels whose centres are within an ellipse around a position, weighted by a Gaussian that
// vanishes at the rim. Zero in lanes that are not `active`.
template <class Float>
Rgb<Float> gaussian(const Image &image, const Window<Float> &window, Vec2<Float> position,
                    const Conic<Float> &ellipse, WrapMode wrap, BoolOf<Float> active);

} // namespace lajolla
