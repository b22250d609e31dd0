#include "media/majorants.h"

#include <algorithm>

namespace lajolla {

namespace {

// A transform followed by a scale along the axes.
Transform scaled(Vec3f scale, const Transform &t) {
    Transform result = t;
    for (std::size_t row = 0; row < 3; ++row)
        for (float &value : result.m[row]) value *= scale[row];
    return result;
}

} // namespace

MajorantGrid::MajorantGrid(const GridVolume &volume, float scale) {
    const Vec3f intervals = volume.intervals();
    std::int32_t voxels[3]; // of a cell
    for (std::size_t axis = 0; axis < 3; ++axis) {
        const auto n = static_cast<std::int32_t>(intervals[axis]);
        voxels[axis] = std::max((n + most_cells - 1) / most_cells, least_voxels);
        cells_[axis] = (n + voxels[axis] - 1) / voxels[axis];
        extent_[axis] = intervals[axis] / static_cast<float>(voxels[axis]);
    }
    world_to_cells_ = scaled(extent_, volume.world_to_cube());
    bounds_.reserve(static_cast<std::size_t>(cells_[0]) * static_cast<std::size_t>(cells_[1]) *
                    static_cast<std::size_t>(cells_[2]));
    for (std::int32_t z = 0; z < cells_[2]; ++z)
        for (std::int32_t y = 0; y < cells_[1]; ++y)
            for (std::int32_t x = 0; x < cells_[0]; ++x) {
                // One voxel more on each side, because interpolation uses it.
                const std::int32_t first[3] = {x * voxels[0] - 1, y * voxels[1] - 1, z * voxels[2] - 1};
                const std::int32_t last[3] = {(x + 1) * voxels[0], (y + 1) * voxels[1], (z + 1) * voxels[2]};
                bounds_.push_back(scale * largest(*volume.grid, first, last));
            }
}

float MajorantGrid::maximum() const { return *std::max_element(bounds_.begin(), bounds_.end()); }

} // namespace lajolla
