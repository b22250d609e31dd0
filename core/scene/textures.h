#pragma once
// Textures, and how a model reads them at a hit.

#include <memory>
#include <span>
#include <string>
#include <tuple>
#include <variant>

#include "base/fields.h"
#include "base/match.h"
#include "base/texture.h"
#include "base/transform.h"
#include "scene/bitmap.h"
#include "scene/hit.h"
#include "scene/shapes.h"

namespace lajolla {

// Where a texture is evaluated.
struct TexturePoint {
    Vec2f uv;
    const Hit *hit = nullptr; // with its primitive, barycentrics and curvature; none: uv is all that counts
    const Shape *shape = nullptr; // that was hit
    Vec3f wo{0};                  // towards the viewer, where the texture is filtered
    bool filtered = false;        // over the pixel's footprint; else as sharp as it is
};

// Derivatives of a texture by u and v.
struct UvGradient {
    Spectrum by_u{0}, by_v{0};
};

struct Bitmap {
    static constexpr const char *name = "bitmap";
    static constexpr const char *doc =
        "An image. Texture space runs from the top left to the bottom right pixel.";
    std::shared_ptr<const Image> image;
    FilterType filter_type = FilterType::bilinear;
    WrapMode wrap_mode = WrapMode::repeat;
    Transform to_uv;
    float max_anisotropy = 20;
    MipMap pixels;

    static constexpr auto fields() {
        return std::tuple(
            field("image", &Bitmap::image, "the pixels"),
            field("filter_type", &Bitmap::filter_type, "how values between pixels are found"),
            field("wrap_mode", &Bitmap::wrap_mode, "what lies outside the unit square"),
            field("to_uv", &Bitmap::to_uv, "transform of texture coordinates before the look-up"),
            field("max_anisotropy", &Bitmap::max_anisotropy,
                  "longest footprint of ewa filtering over its width; longer ones are widened")
                .range(1, 256));
    }
    void build();
    bool reads_footprints() const { return pixels.is_filtered(); }
    // The level of the MIP pyramid whose texels are as large as the footprint; below 0 the image is
    // magnified.
    float level(float uv_footprint) const;
    Spectrum evaluate(const TexturePoint &at, const auto &) const { return look_up(at); }
    UvGradient gradient(const TexturePoint &at, const auto &) const { return sharp_gradient(at.uv); }

private:
    Spectrum look_up(const TexturePoint &at) const;
    UvGradient sharp_gradient(Vec2f uv) const;
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
    Spectrum evaluate(const TexturePoint &at, const auto &read) const {
        const Vec3f p = to_uv.point({at.uv.x, at.uv.y, 1});
        const auto odd_half = [](float x) { return x - std::floor(x) > 0.5f; };
        return read(odd_half(p.x) == odd_half(p.y) ? color0 : color1);
    }
};

struct GridTexture {
    static constexpr const char *name = "gridtexture";
    static constexpr const char *doc = "Lines along the edges of the unit square, and its repetitions.";
    Texture<Spectrum> color0{Spectrum(0.2f)}, color1{Spectrum(0.4f)};
    float line_width = 0.01f;
    Transform to_uv;

    static constexpr auto fields() {
        return std::tuple(
            field("color0", &GridTexture::color0, "colour between the lines").range(0),
            field("color1", &GridTexture::color1, "colour of the lines").range(0),
            field("line_width", &GridTexture::line_width, "of half a line, in squares").range(0),
            field("to_uv", &GridTexture::to_uv, "transform of texture coordinates before the look-up"));
    }
    Spectrum evaluate(const TexturePoint &at, const auto &read) const {
        const Vec3f p = to_uv.point({at.uv.x, at.uv.y, 1});
        const auto on_line = [&](float x) { return std::abs(x - std::round(x)) < line_width; };
        return read(on_line(p.x) || on_line(p.y) ? color1 : color0);
    }
};

struct ScaledTexture {
    static constexpr const char *name = "scale";
    static constexpr const char *doc = "A texture times a number, a colour or another texture.";
    Texture<Spectrum> texture{Spectrum(1)}, scale{Spectrum(1)};

    static constexpr auto fields() {
        return std::tuple(field("texture", &ScaledTexture::texture, "what is scaled"),
                          field("scale", &ScaledTexture::scale, "the factor"));
    }
    Spectrum evaluate(const TexturePoint &, const auto &read) const { return read(texture) * read(scale); }
    UvGradient gradient(const TexturePoint &, const auto &read) const {
        const Spectrum a = read(texture), b = read(scale);
        const UvGradient da = read.gradient(texture), db = read.gradient(scale);
        return {da.by_u * b + a * db.by_u, da.by_v * b + a * db.by_v};
    }
};

struct ClampedTexture {
    static constexpr const char *name = "clamped";
    static constexpr const char *doc = "A texture whose values are brought between two limits.";
    Texture<Spectrum> texture{Spectrum(1)};
    float low = 0, high = 1;

    static constexpr auto fields() {
        return std::tuple(field("texture", &ClampedTexture::texture, "what is clamped"),
                          field("low", &ClampedTexture::low, "the smallest value, also of what is no number"),
                          field("high", &ClampedTexture::high, "the largest value"));
    }
    void build();
    Spectrum evaluate(const TexturePoint &, const auto &read) const {
        return min(max(Spectrum(low), read(texture)), Spectrum(high)); // this order takes NaN to `low`
    }
    UvGradient gradient(const TexturePoint &, const auto &read) const {
        const Spectrum value = read(texture);
        const auto inside = [&](float x) { return x > low && x < high ? 1.0f : 0.0f; };
        const Spectrum kept{inside(value.x), inside(value.y), inside(value.z)};
        const UvGradient slope = read.gradient(texture);
        return {slope.by_u * kept, slope.by_v * kept};
    }
};

struct MeshAttribute {
    static constexpr const char *name = "mesh_attribute";
    static constexpr const char *doc = "Numbers or colours that a mesh carries at its vertices or faces.";
    std::string attribute = "vertex_color";
    float scale = 1;

    static constexpr auto fields() {
        return std::tuple(
            field("name", &MeshAttribute::attribute, "which attribute; begins with vertex_ or face_"),
            field("scale", &MeshAttribute::scale, "factor on the values"));
    }
    void build();
    // Black where the shape has no such attribute.
    Spectrum evaluate(const TexturePoint &at, const auto &) const { return look_up(at) * scale; }

private:
    Spectrum look_up(const TexturePoint &at) const;
};

struct Wireframe {
    static constexpr const char *name = "wireframe";
    static constexpr const char *doc = "The edges of a mesh's triangles.";
    Texture<Spectrum> interior_color{Spectrum(0.5f)}, edge_color{Spectrum(0.1f)};
    float line_width = 0, step_width = 0.5f;

    static constexpr auto fields() {
        return std::tuple(
            field("interior_color", &Wireframe::interior_color, "of the triangles").range(0),
            field("edge_color", &Wireframe::edge_color, "of their edges").range(0),
            field("line_width", &Wireframe::line_width,
                  "of half an edge, in the scene's units; 0 is a tenth of the mesh's mean edge")
                .range(0),
            field("step_width", &Wireframe::step_width, "the fraction of line_width that is blurred")
                .range(0, 1));
    }
    Spectrum evaluate(const TexturePoint &at, const auto &read) const {
        const float inside = interior(at);
        return lerp(inside, read(edge_color), read(interior_color));
    }

private:
    float interior(const TexturePoint &at) const; // 0 on an edge, 1 inside
};

enum class CurvatureKind { gaussian, mean };
constexpr auto choices(CurvatureKind) { return std::array{"gaussian", "mean"}; }

struct CurvatureTexture {
    static constexpr const char *name = "curvature";
    static constexpr const char *doc = "Curvature in colours: red where it is positive, blue where negative.";
    CurvatureKind curvature = CurvatureKind::gaussian;
    float scale = 1;

    static constexpr auto fields() {
        return std::tuple(
            field("curvature", &CurvatureTexture::curvature,
                  "gaussian, positive on domes and bowls; or mean, positive where the normal is inside"),
            field("scale", &CurvatureTexture::scale, "curvature times scale is the brightness, 1 at most")
                .range(0));
    }
    Spectrum evaluate(const TexturePoint &at, const auto &) const { return look_up(at); }

private:
    Spectrum look_up(const TexturePoint &at) const;
};

using TextureModel = std::variant<Bitmap, Checkerboard, GridTexture, ScaledTexture, ClampedTexture,
                                  MeshAttribute, Wireframe, CurvatureTexture>;

// Reads texture handles at one point. This is the `read` that models prepare with.
class TextureReader {
public:
    TextureReader(std::span<const TextureModel> textures, const TexturePoint &at)
        : textures_(textures), at_(at) {}

    Spectrum operator()(const Texture<Spectrum> &texture) const {
        return texture.is_constant() ? texture.constant : evaluate(texture.id);
    }
    float operator()(const Texture<float> &texture) const {
        return texture.is_constant() ? texture.constant : luminance(evaluate(texture.id));
    }

    // Zero for textures that do not tell: they are flat but for edges, or do not depend on u and v.
    UvGradient gradient(const Texture<Spectrum> &texture) const {
        return texture.is_constant() ? UvGradient{} : evaluate_gradient(texture.id);
    }
    Vec2f gradient(const Texture<float> &texture) const {
        if (texture.is_constant()) return {0, 0};
        const UvGradient result = evaluate_gradient(texture.id);
        return {luminance(result.by_u), luminance(result.by_v)};
    }

private:
    Spectrum evaluate(std::int32_t id) const {
        return match(textures_[static_cast<std::size_t>(id)],
                     [&](const auto &model) { return model.evaluate(at_, *this); });
    }
    UvGradient evaluate_gradient(std::int32_t id) const {
        return match(textures_[static_cast<std::size_t>(id)], [&](const auto &model) -> UvGradient {
            if constexpr (requires { model.gradient(at_, *this); }) return model.gradient(at_, *this);
            else return {};
        });
    }

    std::span<const TextureModel> textures_;
    TexturePoint at_;
};

} // namespace lajolla
