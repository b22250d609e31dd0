#pragma once
// Textures, and how a model reads them at a hit.

#include <array>
#include <memory>
#include <span>
#include <tuple>
#include <variant>
#include <vector>

#include "base/fields.h"
#include "base/match.h"
#include "base/texture.h"
#include "base/transform.h"
#include "scene/hit.h"
#include "scene/image.h"

namespace lajolla {

enum class FilterType { bilinear, nearest, trilinear };
constexpr auto choices(FilterType) { return std::array{"bilinear", "nearest", "trilinear"}; }

struct Bitmap {
    static constexpr const char *name = "bitmap";
    static constexpr const char *doc =
        "An image. Texture space runs from the top left to the bottom right pixel.";
    std::shared_ptr<const Image> image;
    FilterType filter_type = FilterType::bilinear;
    WrapMode wrap_mode = WrapMode::repeat;
    Transform to_uv;
    std::vector<Image> levels; // coarser levels of the MIP pyramid, for trilinear filtering

    static constexpr auto fields() {
        return std::tuple(
            field("image", &Bitmap::image, "the pixels"),
            field("filter_type", &Bitmap::filter_type, "how values between pixels are found"),
            field("wrap_mode", &Bitmap::wrap_mode, "what lies outside the unit square"),
            field("to_uv", &Bitmap::to_uv, "transform of texture coordinates before the look-up"));
    }
    void build();
    // The level of the MIP pyramid whose texels are as large as the footprint; below 0 the image is
    // magnified.
    float level(float uv_footprint) const;
    Spectrum evaluate(Vec2f uv, float uv_footprint, const auto &) const { return look_up(uv, uv_footprint); }

private:
    Spectrum look_up(Vec2f uv, float uv_footprint) const;
};

struct Checkerboard {
    static constexpr const char *name = "checkerboard";
    static constexpr const char *doc = "Two colours in alternating squares, two by two in the unit square.";
    Texture<Spectrum> color0{Spectrum(0.4f)}, color1{Spectrum(0.2f)};
    Transform to_uv;

    static constexpr auto fields() {
        return std::tuple(
            field("color0", &Checkerboard::color0, "colour of the squares on the diagonal").range(0),
            field("color1", &Checkerboard::color1, "colour of the other squares").range(0),
            field("to_uv", &Checkerboard::to_uv, "transform of texture coordinates before the look-up"));
    }
    Spectrum evaluate(Vec2f uv, float, const auto &read) const {
        const Vec3f p = to_uv.point({uv.x, uv.y, 1});
        const auto odd_half = [](float x) { return x - std::floor(x) > 0.5f; };
        return read(odd_half(p.x) == odd_half(p.y) ? color0 : color1);
    }
};

using TextureModel = std::variant<Bitmap, Checkerboard>;

// Reads texture handles at one hit. This is the `read` that models prepare with.
class TextureReader {
public:
    TextureReader(std::span<const TextureModel> textures, Vec2f uv, float uv_footprint)
        : textures_(textures), uv_(uv), uv_footprint_(uv_footprint) {}

    Spectrum operator()(const Texture<Spectrum> &texture) const {
        return texture.is_constant() ? texture.constant : evaluate(texture.id);
    }
    float operator()(const Texture<float> &texture) const {
        return texture.is_constant() ? texture.constant : luminance(evaluate(texture.id));
    }

private:
    Spectrum evaluate(std::int32_t id) const {
        return match(textures_[static_cast<std::size_t>(id)],
                     [&](const auto &model) { return model.evaluate(uv_, uv_footprint_, *this); });
    }

    std::span<const TextureModel> textures_;
    Vec2f uv_;
    float uv_footprint_;
};

} // namespace lajolla
