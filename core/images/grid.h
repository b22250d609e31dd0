#pragma once
// Dense voxel arrays, kept in the type they came in.

#include <cstdint>
#include <span>
#include <variant>
#include <vector>

#include "base/volume.h"
#include "images/image.h"

namespace lajolla {

struct Grid {
    using Half = Image::Half;

    std::uint32_t width = 0, height = 0, depth = 0; // voxels along x, y and z
    std::uint32_t channels = 1;                     // 1, 3 (linear sRGB) or 6 (a SymmetricMatrix)
    // ((z * height + y) * width + x) * channels + channel; bytes are fractions of 255
    std::variant<std::vector<std::uint8_t>, std::vector<Half>, std::vector<float>> values;

    std::size_t bytes() const;
    std::uint32_t size(std::size_t axis) const { return axis == 0 ? width : axis == 1 ? height : depth; }
};

// How values between the samples are found: a position in samples, where sample (i, j, k) is at (i, j, k).
enum class GridFilter { trilinear, nearest };
constexpr auto choices(GridFilter) { return std::array{"trilinear", "nearest"}; }

// The interpolated values of all channels, written to `result`; `one` and `zero` clamp.
void look_up(const Grid &grid, Vec3f position, GridFilter filter, WrapMode wrap, std::span<float> result);

// The largest value of any channel among the samples first ... last (clamped to the grid) on each axis.
float largest(const Grid &grid, const std::int32_t (&first)[3], const std::int32_t (&last)[3]);

// The largest sum of absolute values in a row of the matrices of a six-channel grid: no direction's quadratic
// form is larger (Gershgorin), between the samples neither.
float largest_row_sum(const Grid &grid);

} // namespace lajolla
