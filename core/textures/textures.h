#pragma once
// Textures, and their evaluation at a hit.

#include <memory>
#include <span>
#include <string>
#include <tuple>
#include <variant>

#include "base/fields.h"
#include "base/match.h"
#include "base/texture.h"
#include "base/transform.h"
#include "geometry/hit.h"
#include "geometry/shapes.h"
#include "images/bitmap.h"
#include "images/face_images.h"

namespace lajolla {

// The point at which a texture is evaluated.
template <class Float>
struct TexturePoint {
    Vec2<Float> uv;
    // With its shape, primitive, barycentrics and curvature; null: only uv is used.
    const Hit<Float> *hit = nullptr;
    const Shape *shapes = nullptr; // all of them: shapes[hit->shape] was hit
    Vec3<Float> wo;                // towards the viewer, if the texture is filtered
    bool filtered = false;         // over the pixel's footprint; otherwise full resolution
};

// Derivatives of a texture by u and v.
template <class Float>
struct UvGradient {
    Rgb<Float> by_u, by_v;
};

// One of two textures in each lane.
template <class Float>
Rgb<Float> read_either(const auto &read, BoolOf<Float> first, const Texture<Spectrum> &a,
                       const Texture<Spectrum> &b) {
    if (all(first)) return read(a);
    if (!any(first)) return read(b);
    return select(first, read(a), read(b));
}

// For textures without a SIMD version: calls evaluate(point) -> Spectrum for one lane after the other.
inline Spectrum lane_by_lane(const TexturePoint<float> &at, const auto &evaluate) { return evaluate(at); }
inline Rgb<WideFloat> lane_by_lane(const TexturePoint<WideFloat> &at, const auto &evaluate) {
    Rgb<WideFloat> result;
    for (int k = 0; k < lanes; ++k) {
        Hit<float> hit;
        if (at.hit) hit = lane_of(*at.hit, k);
        const Spectrum value = evaluate(TexturePoint<float>{{at.uv.x[k], at.uv.y[k]},
                                                            at.hit ? &hit : nullptr,
                                                            at.shapes,
                                                            {at.wo.x[k], at.wo.y[k], at.wo.z[k]},
                                                            at.filtered});
        result.x.v[k] = value.x, result.y.v[k] = value.y, result.z.v[k] = value.z;
    }
    return result;
}

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
            field("filter_type", &Bitmap::filter_type, "interpolation between pixels"),
            field("wrap_mode", &Bitmap::wrap_mode, "values outside the unit square"),
            field("to_uv", &Bitmap::to_uv, "transform of texture coordinates before the look-up"),
            field("max_anisotropy", &Bitmap::max_anisotropy,
                  "maximum ratio of length to width of ewa footprints; longer ones are widened")
                .range(1, 256));
    }
    void build();
    bool reads_footprints() const { return pixels.is_filtered(); }
    // The level of the MIP pyramid whose texels are as large as a hit's footprint: as wide as the cone, or of
    // the same area as the ellipse of differentials. Below 0 the image is magnified.
    template <class Float>
    Float level(const Hit<Float> &hit) const;
    template <class Float>
    Rgb<Float> evaluate(const TexturePoint<Float> &at, const auto &) const {
        return look_up(at);
    }
    template <class Float>
    UvGradient<Float> gradient(const TexturePoint<Float> &at, const auto &) const {
        return sharp_gradient(at.uv);
    }

private:
    template <class Float>
    Float level_of_cone(const Hit<Float> &hit) const;
    template <class Float>
    Rgb<Float> look_up(const TexturePoint<Float> &at) const;
    template <class Float>
    UvGradient<Float> sharp_gradient(Vec2<Float> uv) const;
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
    template <class Float>
    Rgb<Float> evaluate(const TexturePoint<Float> &at, const auto &read) const {
        const Vec3<Float> p = to_uv.point(Vec3<Float>{at.uv.x, at.uv.y, 1});
        const auto odd_half = [](Float x) { return x - floor(x) > 0.5f; };
        return read_either<Float>(read, odd_half(p.x) == odd_half(p.y), color0, color1);
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
    template <class Float>
    Rgb<Float> evaluate(const TexturePoint<Float> &at, const auto &read) const {
        const Vec3<Float> p = to_uv.point(Vec3<Float>{at.uv.x, at.uv.y, 1});
        const auto on_line = [&](Float x) { return abs(x - floor(x + 0.5f)) < line_width; };
        return read_either<Float>(read, on_line(p.x) || on_line(p.y), color1, color0);
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
    template <class Float>
    Rgb<Float> evaluate(const TexturePoint<Float> &, const auto &read) const {
        return read(texture) * read(scale);
    }
    template <class Float>
    UvGradient<Float> gradient(const TexturePoint<Float> &, const auto &read) const {
        const Rgb<Float> a = read(texture), b = read(scale);
        const UvGradient<Float> da = read.gradient(texture), db = read.gradient(scale);
        return {da.by_u * b + a * db.by_u, da.by_v * b + a * db.by_v};
    }
};

struct ClampedTexture {
    static constexpr const char *name = "clamped";
    static constexpr const char *doc = "A texture clamped to a range.";
    Texture<Spectrum> texture{Spectrum(1)};
    float low = 0, high = 1;

    static constexpr auto fields() {
        return std::tuple(field("texture", &ClampedTexture::texture, "what is clamped"),
                          field("low", &ClampedTexture::low, "the smallest value; also replaces NaN"),
                          field("high", &ClampedTexture::high, "the largest value"));
    }
    void build();
    template <class Float>
    Rgb<Float> evaluate(const TexturePoint<Float> &, const auto &read) const {
        const Rgb<Float> lowest = Spectrum(low), highest = Spectrum(high);
        return clamp_number(read(texture), lowest, highest);
    }
    template <class Float>
    UvGradient<Float> gradient(const TexturePoint<Float> &, const auto &read) const {
        const Rgb<Float> value = read(texture);
        const auto inside = [&](Float x) { return select(x > low && x < high, Float(1), Float(0)); };
        const Rgb<Float> kept{inside(value.x), inside(value.y), inside(value.z)};
        const UvGradient<Float> slope = read.gradient(texture);
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
    // Black if the shape has no such attribute.
    template <class Float>
    Rgb<Float> evaluate(const TexturePoint<Float> &at, const auto &) const {
        return lane_by_lane(at, [&](const auto &point) { return look_up(point); }) * Float(scale);
    }

private:
    Spectrum look_up(const TexturePoint<float> &at) const;
};

enum class FaceFilter { bilinear, nearest, trilinear };
constexpr auto choices(FaceFilter) { return std::array{"bilinear", "nearest", "trilinear"}; }

struct Ptex {
    static constexpr const char *name = "ptex";
    static constexpr const char *doc =
        "A picture for each face of a mesh of quads, which needs no texture coordinates.";
    std::shared_ptr<const FaceImages> images;
    FaceFilter filter_type = FaceFilter::bilinear;

    static constexpr auto fields() {
        return std::tuple(field("images", &Ptex::images, "the pictures"),
                          field("filter_type", &Ptex::filter_type,
                                "interpolation between texels, also across the edges of faces"));
    }
    void build();
    bool reads_footprints() const { return filter_type == FaceFilter::trilinear; }
    // Black if the shape has no faces, or more than there are pictures.
    template <class Float>
    Rgb<Float> evaluate(const TexturePoint<Float> &at, const auto &) const {
        return lane_by_lane(at, [&](const auto &point) { return look_up(point); });
    }
    template <class Float>
    UvGradient<Float> gradient(const TexturePoint<Float> &at, const auto &) const {
        return {lane_by_lane(at, [&](const auto &point) { return sharp_gradient(point).by_u; }),
                lane_by_lane(at, [&](const auto &point) { return sharp_gradient(point).by_v; })};
    }

private:
    Spectrum look_up(const TexturePoint<float> &at) const;
    UvGradient<float> sharp_gradient(const TexturePoint<float> &at) const;
    float level(const TexturePoint<float> &at) const;
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
    template <class Float>
    Rgb<Float> evaluate(const TexturePoint<Float> &at, const auto &read) const {
        const Rgb<Float> inside =
            lane_by_lane(at, [&](const auto &point) { return Spectrum(interior(point)); });
        return lerp(inside.x, read(edge_color), read(interior_color));
    }

private:
    float interior(const TexturePoint<float> &at) const; // 0 on an edge, 1 inside
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
    template <class Float>
    Rgb<Float> evaluate(const TexturePoint<Float> &at, const auto &) const {
        return lane_by_lane(at, [&](const auto &point) { return look_up(point); });
    }

private:
    Spectrum look_up(const TexturePoint<float> &at) const;
};

using TextureModel = std::variant<Bitmap, Checkerboard, GridTexture, ScaledTexture, ClampedTexture,
                                  MeshAttribute, Ptex, Wireframe, CurvatureTexture>;

// Reads texture handles at one point, or at one in each lane. This is the `read` that models prepare with.
template <class Float>
class TextureReader {
public:
    TextureReader(std::span<const TextureModel> textures, const TexturePoint<Float> &at)
        : textures_(textures), at_(at) {}

    Rgb<Float> operator()(const Texture<Spectrum> &texture) const {
        return texture.is_constant() ? Rgb<Float>(texture.constant) : evaluate(texture.id);
    }
    Float operator()(const Texture<float> &texture) const {
        return texture.is_constant() ? Float(texture.constant) : luminance(evaluate(texture.id));
    }

    // Zero for textures without derivatives: constant except at edges, or independent of u and v.
    UvGradient<Float> gradient(const Texture<Spectrum> &texture) const {
        return texture.is_constant() ? UvGradient<Float>{} : evaluate_gradient(texture.id);
    }
    Vec2<Float> gradient(const Texture<float> &texture) const {
        if (texture.is_constant()) return {};
        const UvGradient<Float> result = evaluate_gradient(texture.id);
        return {luminance(result.by_u), luminance(result.by_v)};
    }

private:
    Rgb<Float> evaluate(std::int32_t id) const {
        return match(textures_[static_cast<std::size_t>(id)],
                     [&](const auto &model) { return model.evaluate(at_, *this); });
    }
    UvGradient<Float> evaluate_gradient(std::int32_t id) const {
        return match(textures_[static_cast<std::size_t>(id)], [&](const auto &model) -> UvGradient<Float> {
            if constexpr (requires { model.gradient(at_, *this); }) return model.gradient(at_, *this);
            else return {};
        });
    }

    std::span<const TextureModel> textures_;
    TexturePoint<Float> at_;
};

} // namespace lajolla
