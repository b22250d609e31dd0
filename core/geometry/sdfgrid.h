#pragma once
// Zero level sets of functions on voxel grids.

#include <array>
#include <cstdint>
#include <memory>
#include <optional>
#include <tuple>
#include <vector>

#include "base/fields.h"
#include "base/transform.h"
#include "geometry/hit.h"
#include "geometry/shape_sample.h"
#include "geometry/triangle.h"
#include "images/grid.h"

namespace lajolla {

enum class SdfNormals { analytic, smooth };
constexpr auto choices(SdfNormals) { return std::array{"analytic", "smooth"}; }

// Hansson-Söderlund, Evans and Akenine-Möller 2022, "Ray Tracing of Signed Distance Function Grids".
struct SdfGrid : NeverLight {
    static constexpr const char *name = "sdfgrid";
    static constexpr const char *doc =
        "Where the trilinear interpolant of values on the unit cube is zero; negative inside. Has no uv.";
    std::shared_ptr<const Grid> grid;
    SdfNormals normals = SdfNormals::smooth;
    Transform to_world;

    static constexpr auto fields() {
        return std::tuple(
            field("grid", &SdfGrid::grid, "signed distances at the corners of voxels"),
            field("normals", &SdfGrid::normals, "shading normals: of each voxel, or blended between voxels"),
            field("to_world", &SdfGrid::to_world, "placement of the unit cube in the scene"));
    }
    void build();
    Bounds bounds() const;
    std::size_t bytes() const {
        return grid->bytes() + values_.size() * sizeof(float) + voxels_.size() * sizeof(Corner);
    }
    void fill(const Ray<float> &ray, const RayHit &found, const HitNeeds &, Hit<float> &hit) const;

    // Primitives are the voxels that may contain the surface.
    std::uint32_t primitive_count() const { return static_cast<std::uint32_t>(voxels_.size()); }
    Bounds bounds(std::uint32_t voxel) const;
    float intersect(const Ray<float> &ray, std::uint32_t voxel) const;

private:
    using Corner = std::array<std::uint32_t, 3>;

    float value(std::uint32_t x, std::uint32_t y, std::uint32_t z) const {
        return values_[(static_cast<std::size_t>(z) * size_[1] + y) * size_[0] + x];
    }
    std::array<float, 8> corner_values(const Corner &corner) const; // x runs first
    float interpolated(Vec3f p) const;                              // p in voxels
    Vec3f difference(Vec3f p, Vec3f low) const; // between the faces of the voxel at `low`, beside p
    Vec3f smooth_gradient(Vec3f p) const;
    float mean_curvature(Vec3f p) const;

    Corner size_{}; // values per axis
    std::vector<float> values_;
    std::vector<Corner> voxels_;
    Transform voxels_to_world_, world_to_voxels_;
};

} // namespace lajolla
