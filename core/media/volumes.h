#pragma once
// Volumes: values that vary in space, and how models read them at a point.

#include <array>
#include <memory>
#include <optional>
#include <span>
#include <tuple>
#include <variant>
#include <vector>

#include "base/fields.h"
#include "base/match.h"
#include "base/transform.h"
#include "base/volume.h"
#include "images/grid.h"

namespace lajolla {

struct GridVolume {
    static constexpr const char *name = "gridvolume";
    static constexpr const char *doc = "Samples on a regular grid that fills the unit cube.";
    std::shared_ptr<const Grid> grid;
    GridFilter filter_type = GridFilter::trilinear;
    WrapMode wrap_mode = WrapMode::clamp;
    bool align_corners = false;
    Transform to_world;

    static constexpr auto fields() {
        return std::tuple(
            field("grid", &GridVolume::grid, "the samples"),
            field("filter_type", &GridVolume::filter_type, "interpolation between samples"),
            field("wrap_mode", &GridVolume::wrap_mode, "values outside the cube; densities are zero there"),
            field("align_corners", &GridVolume::align_corners,
                  "the outermost samples lie on the cube's faces, not half a voxel within"),
            field("to_world", &GridVolume::to_world, "places the cube"));
    }

    void build();

    const Transform &world_to_cube() const { return world_to_cube_; }
    // Number of intervals between samples, or of voxels, along each axis of the cube.
    Vec3f intervals() const;

    // At points in world space.
    Spectrum evaluate(Vec3f p) const;
    Spectrum evaluate_inside(Vec3f p) const; // zero outside of the cube
    float evaluate_mean(Vec3f p) const;
    SymmetricMatrix evaluate_matrix(Vec3f p) const;

private:
    Spectrum at(Vec3f q) const; // in the cube's coordinates
    void look_up(Vec3f q, std::span<float> result) const;

    Transform world_to_cube_;
};

using VolumeModel = std::variant<GridVolume>;

// Reads volume handles at a point in world space. This is the `read` that media and phase functions prepare
// with.
class VolumeReader {
public:
    VolumeReader(std::span<const VolumeModel> volumes, Vec3f position)
        : volumes_(volumes), position_(position) {}

    Spectrum operator()(const Volume<Spectrum> &volume) const {
        if (volume.is_constant()) return volume.constant;
        return match(at(volume.id), [&](const auto &model) { return model.evaluate(position_); });
    }
    float operator()(const Volume<float> &volume) const {
        if (volume.is_constant()) return volume.constant;
        return match(at(volume.id), [&](const auto &model) { return model.evaluate_mean(position_); });
    }
    SymmetricMatrix operator()(const Volume<SymmetricMatrix> &volume) const {
        if (volume.is_constant()) return volume.constant;
        return match(at(volume.id), [&](const auto &model) { return model.evaluate_matrix(position_); });
    }
    // Zero outside of the volume; constants have no bounds.
    Spectrum inside(const Volume<Spectrum> &volume) const {
        if (volume.is_constant()) return volume.constant;
        return match(at(volume.id), [&](const auto &model) { return model.evaluate_inside(position_); });
    }

private:
    const VolumeModel &at(std::int32_t id) const { return volumes_[static_cast<std::size_t>(id)]; }

    std::span<const VolumeModel> volumes_;
    Vec3f position_;
};

} // namespace lajolla
