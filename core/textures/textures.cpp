#include "textures/textures.h"

#include <optional>
#include <stdexcept>

namespace lajolla {

namespace {

template <class Float>
Vec2<Float> vector_in_uv(const Transform &to_uv, Vec2<Float> v) {
    const Vec3<Float> result = to_uv.vector(Vec3<Float>{v.x, v.y, 0});
    return {result.x, result.y};
}
template <class Float>
Vec2<Float> point_in_uv(const Transform &to_uv, Vec2<Float> p) {
    const Vec3<Float> result = to_uv.point(Vec3<Float>{p.x, p.y, 1});
    return {result.x, result.y};
}

const Shape *shape_at(const TexturePoint<float> &at) {
    return at.hit && at.shapes ? at.shapes + at.hit->shape : nullptr;
}
const TriangleMesh *mesh_at(const TexturePoint<float> &at) { return std::get_if<TriangleMesh>(shape_at(at)); }

} // namespace

void Bitmap::build() {
    if (!image || image->width == 0 || image->height == 0)
        throw std::invalid_argument("a bitmap needs an image");
    pixels = MipMap(image, filter_type, wrap_mode);
}

template <class Float>
Float Bitmap::level_of_cone(const Hit<Float> &hit) const {
    const Vec2f u = vector_in_uv(to_uv, Vec2f{1, 0}), v = vector_in_uv(to_uv, Vec2f{0, 1});
    const float size = static_cast<float>(std::max(image->width, image->height));
    return log2(max(size * max(hypot(u.x, u.y), hypot(v.x, v.y)) * hit.uv_radius(), Float(1e-8f)));
}

template <class Float>
Float Bitmap::level(const Hit<Float> &hit) const {
    const auto &differentials = hit.footprint.differentials;
    if (!differentials) return level_of_cone(hit);
    const auto texels = [&](Vec2<Float> radius) -> Vec2<Float> {
        const Vec2<Float> r = vector_in_uv(to_uv, radius);
        return {r.x * static_cast<float>(image->width), r.y * static_cast<float>(image->height)};
    };
    const UvEllipse<Float> ellipse = uv_ellipse(hit, *differentials);
    const Vec2<Float> a = texels(ellipse.first), b = texels(ellipse.second);
    const Float result = log2(max(round_radius(a, b), Float(1e-8f)));
    return all(differentials->followed) ? result
                                        : select(differentials->followed, result, level_of_cone(hit));
}
template float Bitmap::level(const Hit<float> &) const;
template WideFloat Bitmap::level(const Hit<WideFloat> &) const;

template <class Float>
Rgb<Float> Bitmap::look_up(const TexturePoint<Float> &at) const {
    const Vec2<Float> position = point_in_uv(to_uv, at.uv);
    if (!at.filtered || !pixels.is_filtered()) return pixels.unfiltered(position);
    const Hit<Float> &hit = *at.hit;
    if (!pixels.is_elliptical()) return pixels.trilinear(position, level(hit));

    const auto &differentials = hit.footprint.differentials;
    const BoolOf<Float> followed = differentials ? differentials->followed : BoolOf<Float>(false);
    const auto blurred = !followed && hit.footprint.cone.is_blurred();
    const Float round_level = any(blurred) ? level_of_cone(hit) : Float(0);
    if (all(blurred)) return pixels.trilinear(position, round_level);
    UvEllipse<Float> ellipse;
    if (!all(followed || blurred)) ellipse = uv_ellipse(hit, at.wo);
    if (any(followed)) {
        const UvEllipse<Float> exact = uv_ellipse(hit, *differentials);
        ellipse = {select(followed, exact.first, ellipse.first),
                   select(followed, exact.second, ellipse.second)};
    }
    return pixels.elliptical(position, vector_in_uv(to_uv, ellipse.first),
                             vector_in_uv(to_uv, ellipse.second), max_anisotropy, blurred, round_level);
}
template Rgb<float> Bitmap::look_up(const TexturePoint<float> &) const;
template Rgb<WideFloat> Bitmap::look_up(const TexturePoint<WideFloat> &) const;

template <class Float>
UvGradient<Float> Bitmap::sharp_gradient(Vec2<Float> uv) const {
    const auto [by_x, by_y] = pixels.gradient(point_in_uv(to_uv, uv));
    const Vec2f u = vector_in_uv(to_uv, Vec2f{1, 0}), v = vector_in_uv(to_uv, Vec2f{0, 1});
    return {by_x * Float(u.x) + by_y * Float(u.y), by_x * Float(v.x) + by_y * Float(v.y)};
}
template UvGradient<float> Bitmap::sharp_gradient(Vec2<float>) const;
template UvGradient<WideFloat> Bitmap::sharp_gradient(Vec2<WideFloat>) const;

void ClampedTexture::build() {
    if (low > high) throw std::invalid_argument("\"low\" must not be above \"high\"");
}

void MeshAttribute::build() {
    if (!attribute.starts_with("vertex_") && !attribute.starts_with("face_"))
        throw std::invalid_argument("the name of a mesh attribute begins with vertex_ or face_, not \"" +
                                    attribute + "\"");
}

Spectrum MeshAttribute::look_up(const TexturePoint<float> &at) const {
    const TriangleMesh *shape = mesh_at(at);
    if (!shape) return Spectrum(0);
    const auto found = shape->mesh->attributes.find(attribute);
    if (found == shape->mesh->attributes.end()) return Spectrum(0);
    const Mesh::Attribute &values = found->second;
    const auto value = [&](std::size_t element) {
        const float *first = values.values.data() + element * values.channels;
        return values.channels < 3 ? Spectrum(first[0]) : Spectrum(first[0], first[1], first[2]);
    };
    const auto primitive = static_cast<std::size_t>(at.hit->primitive);
    if (values.per_face) return value(primitive);
    const Triangle &t = shape->mesh->triangles[primitive];
    const Vec2f b = at.hit->barycentric;
    return value(t[0]) * (1 - b.x - b.y) + value(t[1]) * b.x + value(t[2]) * b.y;
}

// --- ptex ------------------------------------------------------------------------------------------------

namespace {

// A point of a triangle in the face that the triangle is a part of.
struct FacePoint {
    const TriangleMesh *shape;
    std::uint32_t face;
    Vec2f place, by_b1, by_b2; // and its derivatives by the barycentric coordinates
};

std::optional<FacePoint> face_point(const TexturePoint<float> &at, const FaceImages &images) {
    const TriangleMesh *shape = mesh_at(at);
    if (!shape || shape->mesh->face_coordinates.empty()) return std::nullopt;
    const FaceCoordinates &triangle =
        shape->mesh->face_coordinates[static_cast<std::size_t>(at.hit->primitive)];
    if (triangle.face >= images.faces().size()) return std::nullopt;
    const auto corner = [&](std::size_t k) { return FaceCoordinates::unpacked(triangle.corners[k]); };
    const Vec2f first = corner(0), by_b1 = corner(1) - first, by_b2 = corner(2) - first;
    const Vec2f b = at.hit->barycentric;
    return FacePoint{shape, triangle.face, first + by_b1 * b.x + by_b2 * b.y, by_b1, by_b2};
}

constexpr int sharpest_level = -static_cast<int>(FaceImages::most_log_size); // for every neighbour

} // namespace

void Ptex::build() {
    if (!images || images->faces().empty()) throw std::invalid_argument("a ptex needs images");
    if (filter_type == FaceFilter::trilinear) images->make_levels();
}

// log2 of the size of the footprint in texels.
float Ptex::level(const TexturePoint<float> &at) const {
    const FacePoint point = *face_point(at, *images);
    const Mesh &mesh = *point.shape->mesh;
    const Triangle &t = mesh.triangles[static_cast<std::size_t>(at.hit->primitive)];
    const EdgeCross<float> triangle(mesh.positions[t[1]] - mesh.positions[t[0]],
                                    mesh.positions[t[2]] - mesh.positions[t[0]]);
    const FaceImages::Face &face = images->faces()[point.face];
    const float area = abs(point.by_b1.x * point.by_b2.y - point.by_b1.y * point.by_b2.x);
    const float texels = area * static_cast<float>(1u << (face.log_width + face.log_height));
    const float size = at.hit->radius() * std::sqrt(texels / triangle.area());
    return std::isfinite(size) ? log2(max(size, 1e-8f)) : static_cast<float>(FaceImages::most_log_size);
}

Spectrum Ptex::look_up(const TexturePoint<float> &at) const {
    const std::optional<FacePoint> point = face_point(at, *images);
    if (!point) return Spectrum(0);
    if (filter_type == FaceFilter::nearest) return images->nearest(point->face, point->place);
    if (!at.filtered || filter_type == FaceFilter::bilinear)
        return images->smooth(point->face, point->place, sharpest_level);
    constexpr auto most = static_cast<float>(FaceImages::most_log_size);
    const float wanted = std::clamp(level(at), -most, most), below = std::floor(wanted);
    const auto at_level = [&](float l) {
        return images->smooth(point->face, point->place, static_cast<int>(l));
    };
    return lerp(wanted - below, at_level(below), at_level(below + 1));
}

UvGradient<float> Ptex::sharp_gradient(const TexturePoint<float> &at) const {
    const std::optional<FacePoint> point = face_point(at, *images);
    if (!point || filter_type == FaceFilter::nearest) return {};
    const FaceImages::Face &face = images->faces()[point->face];
    const auto slope = [&](Vec2f step) {
        const Vec2f p = point->place;
        const Vec2f from{max(p.x - step.x, 0.0f), max(p.y - step.y, 0.0f)},
            to{min(p.x + step.x, 1.0f), min(p.y + step.y, 1.0f)};
        const Spectrum change = images->smooth(point->face, to, sharpest_level) -
                                images->smooth(point->face, from, sharpest_level);
        return change * (1 / (to.x - from.x + to.y - from.y));
    };
    const Spectrum by_s = slope({0.25f / static_cast<float>(1u << face.log_width), 0}),
                   by_t = slope({0, 0.25f / static_cast<float>(1u << face.log_height)});
    const Spectrum by_b1 = by_s * point->by_b1.x + by_t * point->by_b1.y,
                   by_b2 = by_s * point->by_b2.x + by_t * point->by_b2.y;
    // As for dp_du and dp_dv, barycentric coordinates stand for texture coordinates that are not there.
    const Mesh &mesh = *point->shape->mesh;
    if (mesh.uvs.empty()) return {by_b1, by_b2};
    const Triangle &t = mesh.triangles[static_cast<std::size_t>(at.hit->primitive)];
    const Vec2f d1 = mesh.uvs[t[1]] - mesh.uvs[t[0]], d2 = mesh.uvs[t[2]] - mesh.uvs[t[0]];
    if (!spans_plane(d1, d2)) return {by_b1, by_b2};
    const float determinant = d1.x * d2.y - d1.y * d2.x;
    return {(by_b1 * d2.y - by_b2 * d1.y) * (1 / determinant),
            (by_b2 * d1.x - by_b1 * d2.x) * (1 / determinant)};
}

float Wireframe::interior(const TexturePoint<float> &at) const {
    const TriangleMesh *shape = mesh_at(at);
    if (!shape) return 1;
    const Mesh &mesh = *shape->mesh;
    const Triangle &t = mesh.triangles[static_cast<std::size_t>(at.hit->primitive)];
    const Vec3f a = mesh.positions[t[0]], b = mesh.positions[t[1]], c = mesh.positions[t[2]];
    const Vec2f bary = at.hit->barycentric;
    // Distance from an edge = barycentric coordinate of the opposite corner * height of the triangle.
    const float twice_area = EdgeCross<float>(b - a, c - a).area();
    const float nearest = twice_area * std::min({(1 - bary.x - bary.y) / length(c - b),
                                                 bary.x / length(c - a), bary.y / length(b - a)});
    const float width = line_width > 0 ? line_width : 0.1f * shape->mean_edge;
    const float from = width * (1 - step_width);
    if (nearest >= width) return 1;
    if (!(nearest > from)) return 0;
    const float x = (nearest - from) / (width - from);
    return x * x * (3 - 2 * x);
}

Spectrum CurvatureTexture::look_up(const TexturePoint<float> &at) const {
    if (!at.hit) return Spectrum(0);
    const float value =
        scale * (curvature == CurvatureKind::mean ? -at.hit->mean_curvature() : at.hit->gaussian_curvature());
    return {std::clamp(value, 0.0f, 1.0f), 0, std::clamp(-value, 0.0f, 1.0f)};
}

} // namespace lajolla
