#include "geometry/shapes.h"

#include <cmath>
#include <stdexcept>

namespace lajolla {

namespace {

float largest(Vec3f v) { return max_component(abs(v)); }

float similarity_scale(const Transform &t, const char *shape) {
    const auto scale = uniform_scale(t);
    if (!scale)
        throw std::invalid_argument(std::string("to_world of a ") + shape +
                                    " must scale alike in all directions, without shear");
    return *scale;
}

float turns(float y, float x) { // the angle of (x, y), where a full turn is one
    const float turn = atan2(y, x) * (0.5f * inv_pi);
    return turn < 0 ? turn + 1 : turn;
}

// The normal of a flat shape whose plane is z = 0 before to_world.
Vec3f plane_normal(const Transform &to_object, bool flip) {
    const Vec3f n = normalize(to_object.transposed_vector({0, 0, 1}));
    return flip ? -n : n;
}

float plane_error(const Transform &t) {
    return position_error(largest(t.origin()) + largest(t.axis(0)) + largest(t.axis(1)));
}

Transform invertible(const Transform &t) {
    const auto result = inverse(t);
    if (!result) throw std::invalid_argument("to_world is singular: it flattens the shape");
    return *result;
}

} // namespace

// Mesh

void TriangleMesh::build() {
    if (!mesh) throw std::invalid_argument("a mesh shape needs a mesh");
    validate(*mesh);
    if (!(to_world == Transform{})) {
        mesh = std::make_shared<const Mesh>(transformed(*mesh, to_world));
        to_world = Transform{};
    }
    for (const Vec3f &p : mesh->positions) box.extend(p);
    double edges = 0;
    for (const Triangle &t : mesh->triangles)
        for (std::size_t k = 0; k < 3; ++k)
            edges += length(mesh->positions[t[(k + 1) % 3]] - mesh->positions[t[k]]);
    if (!mesh->triangles.empty())
        mean_edge = static_cast<float>(edges / (3 * static_cast<double>(mesh->triangles.size())));
}

void TriangleMesh::prepare_sampling() {
    std::vector<float> weights;
    light_triangles.clear();
    for (const Triangle &t : mesh->triangles) {
        const Vec3f a = mesh->positions[t[0]], b = mesh->positions[t[1]], c = mesh->positions[t[2]];
        const EdgeCross<float> face(b - a, c - a);
        const float length = sqrt(face.squared);
        const Vec3f shading =
            has_normals() ? mesh->normals[t[0]] + mesh->normals[t[1]] + mesh->normals[t[2]] : face.normal;
        const bool turned = (dot(face.normal, shading) < 0) != flip_normals;
        const Vec3f normal = length > 0 ? face.normal / (turned ? -length : length) : Vec3f(0);
        light_triangles.push_back(
            {a, b - a, c - a, normal, position_error(std::max({largest(a), largest(b), largest(c)}))});
        weights.push_back(face.area() / 2);
    }
    areas = Distribution(weights);
}

void TriangleMesh::fill(const Ray<float> &, const RayHit &found, const HitNeeds &needs,
                        Hit<float> &hit) const {
    const Triangle &t = mesh->triangles[found.primitive];
    const TriangleCorners<float> corners{mesh->positions[t[0]], mesh->positions[t[1]], mesh->positions[t[2]]};
    TriangleNormals<float> normals;
    if (has_normals()) normals = {true, mesh->normals[t[0]], mesh->normals[t[1]], mesh->normals[t[2]]};
    TriangleUvs<float> uvs;
    if (!mesh->uvs.empty()) uvs = {true, mesh->uvs[t[0]], mesh->uvs[t[1]], mesh->uvs[t[2]]};
    fill_triangle(corners, normals, uvs, flip_normals, found.b1, found.b2, needs, hit);
}

SurfaceSample TriangleMesh::sample(float u_triangle, Vec2f u) const {
    const auto index = static_cast<std::uint32_t>(areas.sample(u_triangle).index);
    const LightTriangle &t = light_triangles[index];
    const Vec2f b = sample_triangle(u);
    return {t.corner + t.edge1 * b.x + t.edge2 * b.y,
            t.normal,
            t.position_error,
            1 / areas.sum(),
            index,
            b.x,
            b.y};
}

// Sphere

void Sphere::build() {
    radius *= similarity_scale(to_world, "sphere");
    if (!(radius > 0)) throw std::invalid_argument("a sphere needs a radius above zero");
    center = to_world.point(center);
    axes = {normalize(to_world.axis(0)), normalize(to_world.axis(1)), normalize(to_world.axis(2))};
    to_world = Transform{};
}

void Sphere::fill(const Ray<float> &ray, const RayHit &found, const HitNeeds &needs, Hit<float> &hit) const {
    // In double precision, the point is as exact as its own coordinates, not only as those of the centre.
    const auto along = [&](float origin, float direction, float from) {
        return double{origin} + double{direction} * double{found.distance} - double{from};
    };
    const double x = along(ray.origin.x, ray.direction.x, center.x),
                 y = along(ray.origin.y, ray.direction.y, center.y),
                 z = along(ray.origin.z, ray.direction.z, center.z),
                 scale = 1 / std::sqrt(x * x + y * y + z * z);
    const Vec3f outward{to_float(x * scale), to_float(y * scale), to_float(z * scale)};
    const auto on_sphere = [&](float from, double offset) {
        return to_float(double{from} + offset * scale * double{radius});
    };
    hit.position = {on_sphere(center.x, x), on_sphere(center.y, y), on_sphere(center.z, z)};
    hit.position_error = position_error(max_component(abs(hit.position))) + size() * 0x1p-42f;
    hit.normal = hit.shading_normal = flip_normals ? -outward : outward;
    if (!needs.uvs && !needs.tangents) return;
    // uv = (phi / 2 pi, theta / pi) in spherical coordinates around the third axis; atan2 keeps its precision
    // at the poles, where acos loses half the digits
    const Vec3f local = axes.to_local(outward);
    const float r = std::sqrt(local.x * local.x + local.y * local.y);
    const float cos_phi = r > 0 ? local.x / r : 1, sin_phi = r > 0 ? local.y / r : 0;
    hit.uv = hit.barycentric = {turns(local.y, local.x), atan2(r, local.z) * inv_pi};
    hit.dp_du = axes.to_world(Vec3f{-sin_phi * r, cos_phi * r, 0} * (2 * pi * radius));
    hit.dp_dv = axes.to_world(Vec3f{local.z * cos_phi, local.z * sin_phi, -r} * (pi * radius));
    const float curvature = (flip_normals ? -1 : 1) / radius;
    hit.dn = {hit.dp_du * curvature, hit.dp_dv * curvature};
}

SurfaceSample Sphere::at(const Vec3f &direction) const {
    const float error = position_error(size()) / 8; // direction, product and sum: a few ulps
    return {center + direction * radius, flip_normals ? -direction : direction, error, 1 / area()};
}

// Rectangle

void Rectangle::build() { normal = plane_normal(invertible(to_world), flip_normals); }

std::array<Vec3f, 4> Rectangle::corners() const {
    return {to_world.point({-1, -1, 0}), to_world.point({1, -1, 0}), to_world.point({1, 1, 0}),
            to_world.point({-1, 1, 0})};
}

Bounds Rectangle::bounds() const {
    Bounds box;
    for (const Vec3f &corner : corners()) box.extend(corner);
    return box;
}

float Rectangle::error() const { return plane_error(to_world); }

void Rectangle::fill(const Ray<float> &, const RayHit &found, const HitNeeds &, Hit<float> &hit) const {
    // Triangles (0, 1, 2) and (0, 2, 3) of corners().
    hit.uv =
        found.primitive == 0 ? Vec2f{found.b1 + found.b2, found.b2} : Vec2f{found.b1, found.b1 + found.b2};
    hit.barycentric = {found.b1, found.b2};
    hit.position = to_world.point({2 * hit.uv.x - 1, 2 * hit.uv.y - 1, 0});
    hit.position_error = error();
    hit.normal = normal;
    hit.dp_du = to_world.axis(0) * 2;
    hit.dp_dv = to_world.axis(1) * 2;
    hit.shading_normal = hit.normal;
}

SurfaceSample Rectangle::sample(float, Vec2f u) const {
    const bool first = u.x >= u.y;
    return {to_world.point({2 * u.x - 1, 2 * u.y - 1, 0}),
            normal,
            error(),
            1 / area(),
            first ? 0u : 1u,
            first ? u.x - u.y : u.x,
            first ? u.y : u.y - u.x};
}

// Disk

void Disk::build() {
    to_object = invertible(to_world);
    normal = plane_normal(to_object, flip_normals);
}

Bounds Disk::bounds() const {
    const auto reach = [&](std::size_t row) { return std::hypot(to_world.m[row][0], to_world.m[row][1]); };
    const Vec3f extent{reach(0), reach(1), reach(2)};
    return {to_world.origin() - extent, to_world.origin() + extent};
}

float Disk::error() const { return plane_error(to_world); }

float Disk::intersect(const Ray<float> &ray) const {
    const Vec3f o = to_object.point(ray.origin), d = to_object.vector(ray.direction);
    const float t = -o.z / d.z;
    const float x = o.x + t * d.x, y = o.y + t * d.y;
    if (!(t > ray.near && t < ray.far) || !(x * x + y * y <= 1)) return infinity;
    return t;
}

void Disk::fill(const Ray<float> &ray, const RayHit &found, const HitNeeds &, Hit<float> &hit) const {
    const Vec3f p = to_object.point(ray.origin + ray.direction * found.distance);
    const float r = std::hypot(p.x, p.y);
    const float cos_phi = r > 0 ? p.x / r : 1, sin_phi = r > 0 ? p.y / r : 0;
    hit.position = to_world.point({p.x, p.y, 0});
    hit.position_error = error();
    hit.normal = normal;
    hit.uv = hit.barycentric = {r, turns(p.y, p.x)};
    hit.dp_du = to_world.vector({cos_phi, sin_phi, 0});
    hit.dp_dv = to_world.vector(Vec3f{-sin_phi, cos_phi, 0} * (2 * pi * r));
    hit.shading_normal = hit.normal;
}

SurfaceSample Disk::sample(float, Vec2f u) const {
    const Vec2f p = sample_disk(u);
    return {to_world.point({p.x, p.y, 0}), normal, error(), 1 / area()};
}

// Cylinder

void Cylinder::build() {
    const float scale = similarity_scale(to_world, "cylinder");
    height = length(p1 - p0);
    if (!(height > 0) || !(radius > 0))
        throw std::invalid_argument("a cylinder needs a height and a radius above zero");
    const Frame<float> local = frame_around((p1 - p0) / height);
    axes = {to_world.vector(local.s) / scale, to_world.vector(local.t) / scale,
            to_world.vector(local.n) / scale};
    p0 = to_world.point(p0), p1 = to_world.point(p1);
    radius *= scale, height *= scale;
    to_world = Transform{};
}

Bounds Cylinder::bounds() const {
    const auto reach = [&](float n) { return radius * safe_sqrt(1 - n * n); };
    const Vec3f extent{reach(axes.n.x), reach(axes.n.y), reach(axes.n.z)};
    return {min(p0, p1) - extent, max(p0, p1) + extent};
}

float Cylinder::intersect(const Ray<float> &ray) const {
    const Vec3f o = axes.to_local(ray.origin - p0), d = axes.to_local(ray.direction);
    const float a = d.x * d.x + d.y * d.y;
    if (a == 0) return infinity;
    // as for the sphere, in the plane perpendicular to the axis
    const float b = -(o.x * d.x + o.y * d.y), x = o.x + d.x * (b / a), y = o.y + d.y * (b / a);
    const float discriminant = radius * radius - (x * x + y * y);
    if (discriminant < 0) return infinity;
    const float distance = std::hypot(o.x, o.y), c = (distance - radius) * (distance + radius);
    const float q = b + std::copysign(std::sqrt(a * discriminant), b);
    const auto on_tube = [&](float t) {
        const float z = o.z + t * d.z;
        return t > ray.near && t < ray.far && z >= 0 && z <= height;
    };
    const float t0 = std::min(c / q, q / a), t1 = std::max(c / q, q / a);
    if (on_tube(t0)) return t0;
    if (on_tube(t1)) return t1;
    return infinity;
}

SurfaceSample Cylinder::at(Vec2f around, float z) const {
    const Vec3f outward = axes.to_world({around.x, around.y, 0});
    return {p0 + outward * radius + axes.n * z, flip_normals ? -outward : outward,
            position_error(std::max(largest(p0), largest(p1)) + radius), 1 / area()};
}

void Cylinder::fill(const Ray<float> &ray, const RayHit &found, const HitNeeds &, Hit<float> &hit) const {
    const Vec3f local = axes.to_local(ray.origin + ray.direction * found.distance - p0);
    const float r = std::hypot(local.x, local.y), z = std::clamp(local.z, 0.0f, height);
    const Vec2f around{local.x / r, local.y / r};
    const SurfaceSample point = at(around, z);
    hit.position = point.position;
    hit.position_error = point.position_error;
    hit.normal = hit.shading_normal = point.normal;
    hit.uv = hit.barycentric = {turns(around.y, around.x), z / height};
    hit.dp_du = axes.to_world({-around.y, around.x, 0}) * (2 * pi * radius);
    hit.dp_dv = axes.n * height;
    hit.dn = {hit.dp_du * ((flip_normals ? -1 : 1) / radius), Vec3f(0)};
}

SurfaceSample Cylinder::sample(float, Vec2f u) const {
    const auto [sine, cosine] = sine_cosine(2 * pi * u.x);
    return at({cosine, sine}, u.y * height);
}

} // namespace lajolla
