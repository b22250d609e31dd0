#pragma once
// Images filtered over what a pixel sees of them: a MIP pyramid, and elliptical averages over its levels.

#include <array>
#include <memory>
#include <vector>

#include "scene/image.h"

namespace lajolla {

enum class FilterType { bilinear, nearest, trilinear, ewa };
constexpr auto choices(FilterType) { return std::array{"bilinear", "nearest", "trilinear", "ewa"}; }

// Positions and radii are in units of the image, whatever the level.
class MipMap {
public:
    MipMap() = default;
    // The coarser levels are made for the filters that read them.
    MipMap(std::shared_ptr<const Image> image, FilterType filter, WrapMode wrap);

    bool is_filtered() const { return filter_ == FilterType::trilinear || filter_ == FilterType::ewa; }
    bool is_elliptical() const { return filter_ == FilterType::ewa; }
    std::size_t bytes() const; // of all levels

    // As sharp as the image is.
    Spectrum sharp(Vec2f position) const;
    // The derivatives of that by the position.
    std::array<Spectrum, 2> gradient(Vec2f position) const;
    // Over a circle; `level` is log2 of its radius in texels.
    Spectrum trilinear(Vec2f position, float level) const;
    // The elliptical weighted average (Greene and Heckbert 1986; Heckbert 1989, "Fundamentals of Texture
    // Mapping and Image Warping", section 3.5.8) over the ellipse that has these two conjugate radii.
    Spectrum elliptical(Vec2f position, Vec2f radius0, Vec2f radius1, float max_anisotropy) const;

private:
    const Image &level(std::size_t i) const { return i == 0 ? *image_ : coarser_[i - 1]; }
    Spectrum bilinear_at(std::size_t i, Vec2f position) const;

    std::shared_ptr<const Image> image_;
    std::vector<Image> coarser_;
    FilterType filter_ = FilterType::bilinear;
    WrapMode wrap_ = WrapMode::repeat;
};

} // namespace lajolla
