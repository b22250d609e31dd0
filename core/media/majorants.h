#pragma once
// A coarse grid of upper bounds of a medium's extinction, and its traversal by rays.

#include <vector>

#include "base/transform.h"
#include "geometry/hit.h"
#include "media/volumes.h"

namespace lajolla {

class MajorantGrid {
public:
    // The same bound everywhere.
    explicit MajorantGrid(float bound) : bounds_{bound}, everywhere_(true) {}
    MajorantGrid() : MajorantGrid(0.0f) {}
    // Bounds of `scale` times the largest channel of a volume; zero outside of the volume.
    MajorantGrid(const GridVolume &volume, float scale);

    // Calls f(t0, t1, majorant) -> bool for the pieces of the ray between near and far, in order, until f
    // returns false. Pieces are adjacent and inside the volume. Returns whether f always returned true.
    template <class F>
    bool traverse(const Ray<float> &ray, F &&f) const;

    float maximum() const;
    std::size_t bytes() const { return bounds_.size() * sizeof(float); }

private:
    static constexpr std::int32_t most_cells = 64, least_voxels = 4; // along an axis; of a cell

    float bound(const std::int32_t (&cell)[3]) const {
        return bounds_[static_cast<std::size_t>((cell[2] * cells_[1] + cell[1]) * cells_[0] + cell[0])];
    }

    std::vector<float> bounds_;
    std::int32_t cells_[3] = {1, 1, 1};
    Vec3f extent_{1}; // of the volume, in cells: the last ones may extend beyond it
    Transform world_to_cells_;
    bool everywhere_ = false;
};

// Amanatides and Woo 1987, "A Fast Voxel Traversal Algorithm for Ray Tracing"; crossings are computed afresh
// from the cell's index, so that errors do not add up.
template <class F>
bool MajorantGrid::traverse(const Ray<float> &ray, F &&f) const {
    if (everywhere_) return !(ray.near < ray.far) || f(ray.near, ray.far, bounds_[0]);
    const Vec3f origin = world_to_cells_.point(ray.origin), direction = world_to_cells_.vector(ray.direction);
    const Vec3f inverse = Vec3f(1) / direction; // not used where it is infinite
    float t = ray.near, far = ray.far;
    for (std::size_t axis = 0; axis < 3; ++axis) {
        const float a = -origin[axis] * inverse[axis], b = (extent_[axis] - origin[axis]) * inverse[axis];
        if (direction[axis] != 0) t = std::max(t, std::min(a, b)), far = std::min(far, std::max(a, b));
        else if (origin[axis] < 0 || origin[axis] > extent_[axis]) return true;
    }
    if (!(t < far)) return true;
    std::int32_t cell[3];
    for (std::size_t axis = 0; axis < 3; ++axis) {
        const float x = origin[axis] + t * direction[axis]; // may be NaN
        cell[axis] = x > 0 ? static_cast<std::int32_t>(std::min(x, static_cast<float>(cells_[axis] - 1))) : 0;
    }
    while (true) {
        float next = far;
        std::size_t crossed = 3;
        for (std::size_t axis = 0; axis < 3; ++axis) {
            if (direction[axis] == 0) continue;
            const float wall = static_cast<float>(cell[axis] + (direction[axis] > 0 ? 1 : 0));
            const float at = (wall - origin[axis]) * inverse[axis];
            if (at < next) next = at, crossed = axis;
        }
        if (next > t) { // rounding may place a crossing before the previous one
            if (!f(t, next, bound(cell))) return false;
            t = next;
        }
        if (crossed == 3) return true;
        cell[crossed] += direction[crossed] > 0 ? 1 : -1;
        if (cell[crossed] < 0 || cell[crossed] >= cells_[crossed]) return true;
    }
}

} // namespace lajolla
