#include "scene/textures.h"

#include <stdexcept>

namespace lajolla {

namespace {

Vec2f vector_in_uv(const Transform &to_uv, Vec2f v) {
    const Vec3f result = to_uv.vector({v.x, v.y, 0});
    return {result.x, result.y};
}

const TriangleMesh *mesh_at(const TexturePoint &at) {
    return at.hit && at.shape ? std::get_if<TriangleMesh>(at.shape) : nullptr;
}

// The product of the principal curvatures of the surface that a mesh's vertex normals describe: the
// determinant of the map from steps on the triangle to changes of the normal.
float gaussian_curvature(const TriangleMesh &shape, const Hit &hit) {
    const Mesh &mesh = *shape.mesh;
    if (shape.face_normals || mesh.normals.empty()) return 0;
    const Triangle &t = mesh.triangles[hit.primitive];
    const Vec3f e1 = mesh.positions[t[1]] - mesh.positions[t[0]],
                e2 = mesh.positions[t[2]] - mesh.positions[t[0]];
    const Vec3f n0 = mesh.normals[t[0]], d1 = mesh.normals[t[1]] - n0, d2 = mesh.normals[t[2]] - n0;
    const Vec3f sum = n0 + d1 * hit.barycentric.x + d2 * hit.barycentric.y, scaled_normal = cross(e1, e2);
    const Vec3f dual1 = cross(e2, scaled_normal), dual2 = cross(scaled_normal, e1);
    const float scale = length(sum) * length_squared(scaled_normal);
    const float determinant = dot(d1, dual1) * dot(d2, dual2) - dot(d2, dual1) * dot(d1, dual2);
    return scale > 0 ? determinant / sqr(scale) : 0;
}

float gaussian_curvature(const TexturePoint &at) {
    if (const TriangleMesh *mesh = mesh_at(at)) return gaussian_curvature(*mesh, *at.hit);
    const bool is_sphere = at.shape && std::holds_alternative<Sphere>(*at.shape);
    return is_sphere ? sqr(at.hit->mean_curvature) : 0; // the others can be unrolled
}

} // namespace

void Bitmap::build() {
    if (!image || image->width == 0 || image->height == 0)
        throw std::invalid_argument("a bitmap needs an image");
    pixels = MipMap(image, filter_type, wrap_mode);
}

float Bitmap::level(float uv_footprint) const {
    const Vec2f u = vector_in_uv(to_uv, {1, 0}), v = vector_in_uv(to_uv, {0, 1});
    const float scale = std::max(std::hypot(u.x, u.y), std::hypot(v.x, v.y));
    const float texels = static_cast<float>(std::max(image->width, image->height)) * scale * uv_footprint;
    return std::log2(std::max(texels, 1e-8f));
}

Spectrum Bitmap::look_up(const TexturePoint &at) const {
    const Vec3f transformed = to_uv.point({at.uv.x, at.uv.y, 1});
    const Vec2f position{transformed.x, transformed.y};
    if (!at.filtered || !pixels.is_filtered()) return pixels.sharp(position);
    // A beam that a rough surface opened is blurred in every direction: its ellipse would cost and show
    // nothing.
    const bool sharp_beam = at.hit->footprint.spread < 0.05f;
    if (!pixels.is_elliptical() || !sharp_beam)
        return pixels.trilinear(position, level(at.hit->uv_footprint()));
    const UvEllipse ellipse = uv_ellipse(*at.hit, at.wo);
    return pixels.elliptical(position, vector_in_uv(to_uv, ellipse.across),
                             vector_in_uv(to_uv, ellipse.along), max_anisotropy);
}

UvGradient Bitmap::sharp_gradient(Vec2f uv) const {
    const Vec3f position = to_uv.point({uv.x, uv.y, 1});
    const auto [by_x, by_y] = pixels.gradient({position.x, position.y});
    const Vec2f u = vector_in_uv(to_uv, {1, 0}), v = vector_in_uv(to_uv, {0, 1});
    return {by_x * u.x + by_y * u.y, by_x * v.x + by_y * v.y};
}

void ClampedTexture::build() {
    if (low > high) throw std::invalid_argument("\"low\" must not be above \"high\"");
}

void MeshAttribute::build() {
    if (!attribute.starts_with("vertex_") && !attribute.starts_with("face_"))
        throw std::invalid_argument("the name of a mesh attribute begins with vertex_ or face_, not \"" +
                                    attribute + "\"");
}

Spectrum MeshAttribute::look_up(const TexturePoint &at) const {
    const TriangleMesh *shape = mesh_at(at);
    if (!shape) return Spectrum(0);
    const auto found = shape->mesh->attributes.find(attribute);
    if (found == shape->mesh->attributes.end()) return Spectrum(0);
    const Mesh::Attribute &values = found->second;
    const auto value = [&](std::uint32_t element) {
        const float *first = values.values.data() + static_cast<std::size_t>(element) * values.channels;
        return values.channels < 3 ? Spectrum(first[0]) : Spectrum(first[0], first[1], first[2]);
    };
    if (values.per_face) return value(at.hit->primitive);
    const Triangle &t = shape->mesh->triangles[at.hit->primitive];
    const Vec2f b = at.hit->barycentric;
    return value(t[0]) * (1 - b.x - b.y) + value(t[1]) * b.x + value(t[2]) * b.y;
}

float Wireframe::interior(const TexturePoint &at) const {
    const TriangleMesh *shape = mesh_at(at);
    if (!shape) return 1;
    const Mesh &mesh = *shape->mesh;
    const Triangle &t = mesh.triangles[at.hit->primitive];
    const Vec3f a = mesh.positions[t[0]], b = mesh.positions[t[1]], c = mesh.positions[t[2]];
    const Vec2f bary = at.hit->barycentric;
    // The height over an edge is the barycentric coordinate of the corner opposite times the whole height.
    const float twice_area = length(cross(b - a, c - a));
    const float nearest = twice_area * std::min({(1 - bary.x - bary.y) / length(c - b),
                                                 bary.x / length(c - a), bary.y / length(b - a)});
    const float width = line_width > 0 ? line_width : 0.1f * shape->mean_edge;
    const float from = width * (1 - step_width);
    if (nearest >= width) return 1;
    if (!(nearest > from)) return 0;
    const float x = (nearest - from) / (width - from);
    return x * x * (3 - 2 * x);
}

Spectrum CurvatureTexture::look_up(const TexturePoint &at) const {
    if (!at.hit) return Spectrum(0);
    const float value =
        scale * (curvature == CurvatureKind::mean ? -at.hit->mean_curvature : gaussian_curvature(at));
    return {std::clamp(value, 0.0f, 1.0f), 0, std::clamp(-value, 0.0f, 1.0f)};
}

} // namespace lajolla
