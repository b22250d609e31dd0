#pragma once
// Images filtered over a pixel's footprint: a MIP pyramid, and elliptical averages over its levels.

#include <array>
#include <memory>

#include "images/image.h"

namespace lajolla {

enum class FilterType { bilinear, nearest, trilinear, ewa };
constexpr auto choices(FilterType) { return std::array{"bilinear", "nearest", "trilinear", "ewa"}; }

// Positions and radii are in units of the image, at all levels.
class MipMap {
public:
    MipMap() = default;
    // The coarser levels are made for the filters that read them.
    MipMap(std::shared_ptr<const Image> image, FilterType filter, WrapMode wrap);

    bool is_filtered() const { return filter_ == FilterType::trilinear || filter_ == FilterType::ewa; }
    bool is_elliptical() const { return filter_ == FilterType::ewa; }
    std::size_t bytes() const; // of all levels

    // Of the full resolution.
    template <class Float>
    Rgb<Float> unfiltered(Vec2<Float> position) const;
    // The derivatives of that by the position.
    template <class Float>
    std::array<Rgb<Float>, 2> gradient(Vec2<Float> position) const;
    // Over a circle; `level` is log2 of its radius in texels.
    template <class Float>
    Rgb<Float> trilinear(Vec2<Float> position, Float level) const;
    // The elliptical weighted average (Greene and Heckbert 1986; Heckbert 1989, "Fundamentals of Texture
    // Mapping and Image Warping", section 3.5.8) over the ellipse that has these two conjugate radii, such as
    // half of the way to the next pixel along each axis of the film; but where a footprint is `round`,
    // trilinear() of `level`.
    template <class Float>
    Rgb<Float> elliptical(Vec2<Float> position, Vec2<Float> radius0, Vec2<Float> radius1,
                          float max_anisotropy, BoolOf<Float> round, Float level) const;

private:
    template <class Float>
    Rgb<Float> bilinear_at(const Window<Float> &level, Vec2<Float> position) const {
        return bilinear(*image_, level, in_texels(level, position), wrap_, wrap_);
    }
    template <class Float>
    static Vec2<Float> in_texels(const Window<Float> &level, Vec2<Float> v) {
        return {v.x * level.width, v.y * level.height};
    }
    float coarsest() const { return static_cast<float>(image_->levels().size() - 1); }

    std::shared_ptr<const Image> image_;
    FilterType filter_ = FilterType::bilinear;
    WrapMode wrap_ = WrapMode::repeat;
};

// Of x > 0.
template <class Float>
Float log2(Float x) {
    return log(x) * 1.44269504088896341f;
}

} // namespace lajolla
