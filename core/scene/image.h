#pragma once
// Pixel arrays as textures keep them: 8-bit stays 8-bit, half stays half.

#include <cstdint>
#include <memory>
#include <variant>
#include <vector>

#include "base/vec.h"

namespace lajolla {

// Linear value of each sRGB-encoded byte (IEC 61966-2-1), then of each byte taken as it is.
const float *byte_decoding(bool srgb);

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
};

// Halves the resolution by averaging linear values, each texel by the share of its area.
Image downsample(const Image &image);

} // namespace lajolla
