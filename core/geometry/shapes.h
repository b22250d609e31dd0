#pragma once
// The list of shapes. A shape implements bounds(), fill() (computes a hit), sample() with its area, and, if
// it does not consist of triangles, intersect() (the distance of a ray's hit; infinity if there is none). All
// are in world space after build().

#include <memory>
#include <optional>
#include <tuple>
#include <variant>

#include "base/distribution.h"
#include "base/fields.h"
#include "base/match.h"
#include "base/warp.h"
#include "geometry/curves.h"
#include "geometry/hit.h"
#include "geometry/mesh.h"
#include "geometry/sdfgrid.h"
#include "geometry/shape_sample.h"
#include "geometry/triangle.h"

namespace lajolla {

struct TriangleMesh {
    static constexpr const char *name = "mesh";
    static constexpr const char *doc = "Triangles from arrays or from a file.";
    std::shared_ptr<const Mesh> mesh;
    Transform to_world;
    bool face_normals = false, flip_normals = false;
    NormalWeights normal_weights = NormalWeights::angle; // by which the mesh got its normals, if it had none
    // Data of each triangle for sampling, if the mesh is a light.
    struct LightTriangle {
        Vec3f corner, edge1, edge2, normal;
        float position_error;
    };
    std::vector<LightTriangle> light_triangles;
    Distribution areas;
    Bounds box;
    float mean_edge = 0; // length

    static constexpr auto fields() {
        return std::tuple(
            field("mesh", &TriangleMesh::mesh, "vertices and triangles"),
            field("to_world", &TriangleMesh::to_world, "placement in the scene"),
            field("face_normals", &TriangleMesh::face_normals, "flat faces: ignore vertex normals"),
            field("flip_normals", &TriangleMesh::flip_normals, "flip the normals"),
            field("normal_weights", &TriangleMesh::normal_weights,
                  "how faces count in vertex normals that are computed: max is exact on spheres"));
    }
    void build();
    void prepare_sampling();
    Bounds bounds() const { return box; }
    float area() const { return areas.sum(); }
    void fill(const Ray<float> &ray, const RayHit &found, const HitNeeds &, Hit<float> &hit) const;
    SurfaceSample sample(float u_triangle, Vec2f u) const;
    bool has_normals() const { return !face_normals && !mesh->normals.empty(); }
};

// The distance at which a ray hits a sphere. Rays that miss it are found in float32; hits are computed in
// double precision, because a sphere may be so large that walls of a room are parts of it: float32 would put
// them anywhere within radius * 2^-20.
template <class Float>
Float intersect_sphere(const Vec3f &center, float radius, const Ray<Float> &ray) {
    // From the distance between centre and ray, which does not cancel for distant spheres (Haines et al.
    // 2019, "Precision Improvements for Ray/Sphere Intersection").
    const Vec3<Float> f = ray.origin - Vec3<Float>(center);
    const Vec3<Float> nearest = f - ray.direction * (dot(f, ray.direction) / length_squared(ray.direction));
    const Float rounding = 0x1p-18f * (radius + max_component(abs(f)));
    if (!any(length_squared(nearest) <= radius * (radius + rounding))) return infinity;

    using Double = DoubleOf<Float>;
    const auto in_double = [](const Vec3<Float> &v) {
        return Vec3<Double>{to_double(v.x), to_double(v.y), to_double(v.z)};
    };
    const Vec3<Double> d = in_double(ray.direction),
                       p = in_double(ray.origin) - Vec3<Double>{center.x, center.y, center.z};
    const Double squared = dot(d, d), middle = -(dot(p, d) / squared);
    const Vec3<Double> chord_centre = p + d * middle;
    const Double height = Double(radius) * Double(radius) - dot(chord_centre, chord_centre);
    const Double length = root_in_double(squared), half = root_in_double(height) / length;
    const Float t0 = to_float(middle - half), t1 = to_float(middle + half);
    // Origins are rounded, so that those on a sphere may be on either side of it.
    const Float least = max(ray.near, 0x1p-22f * max_component(abs(ray.origin)) / to_float(length));
    const auto within = [&](const Float &t) { return to_float(height) >= 0.0f && t > least && t < ray.far; };
    return select(within(t0), t0, select(within(t1), t1, Float(infinity)));
}

struct Sphere {
    static constexpr const char *name = "sphere";
    static constexpr const char *doc = "A sphere; to_world must scale uniformly.";
    Vec3f center{0};
    float radius = 1;
    Transform to_world;
    bool flip_normals = false;
    Frame<float> axes; // world directions of the texture's axes

    static constexpr auto fields() {
        return std::tuple(field("center", &Sphere::center, "before to_world"),
                          field("radius", &Sphere::radius, "before to_world").range(0),
                          field("to_world", &Sphere::to_world, "placement in the scene"),
                          field("flip_normals", &Sphere::flip_normals, "flip the normals"));
    }
    void build();
    void prepare_sampling() {}
    Bounds bounds() const { return {center - Vec3f(radius), center + Vec3f(radius)}; }
    float area() const { return 4 * pi * radius * radius; }
    template <class Float>
    Float intersect(const Ray<Float> &ray) const {
        return intersect_sphere(center, radius, ray);
    }
    void fill(const Ray<float> &ray, const RayHit &found, const HitNeeds &, Hit<float> &hit) const;
    SurfaceSample sample(float, Vec2f u) const { return at(sample_sphere(u)); }
    // The point in a direction from the centre.
    SurfaceSample at(const Vec3f &direction) const;

private:
    float size() const { return max_component(abs(center)) + radius; }
};

struct Rectangle {
    static constexpr const char *name = "rectangle";
    static constexpr const char *doc =
        "The square from (-1, -1, 0) to (1, 1, 0), facing +z, before to_world.";
    Transform to_world;
    bool flip_normals = false;
    Vec3f normal;

    static constexpr auto fields() {
        return std::tuple(field("to_world", &Rectangle::to_world, "placement in the scene"),
                          field("flip_normals", &Rectangle::flip_normals, "flip the normal"));
    }
    void build();
    void prepare_sampling() {}
    Bounds bounds() const;
    float area() const { return 4 * EdgeCross<float>(to_world.axis(0), to_world.axis(1)).area(); }
    std::array<Vec3f, 4> corners() const;
    void fill(const Ray<float> &ray, const RayHit &found, const HitNeeds &, Hit<float> &hit) const;
    SurfaceSample sample(float, Vec2f u) const;

private:
    float error() const;
};

struct Disk {
    static constexpr const char *name = "disk";
    static constexpr const char *doc = "The unit disk around the origin, facing +z, before to_world.";
    Transform to_world;
    bool flip_normals = false;
    Transform to_object;
    Vec3f normal;

    static constexpr auto fields() {
        return std::tuple(field("to_world", &Disk::to_world, "placement in the scene"),
                          field("flip_normals", &Disk::flip_normals, "flip the normal"));
    }
    void build();
    void prepare_sampling() {}
    Bounds bounds() const;
    float area() const { return pi * EdgeCross<float>(to_world.axis(0), to_world.axis(1)).area(); }
    float intersect(const Ray<float> &ray) const;
    void fill(const Ray<float> &ray, const RayHit &found, const HitNeeds &, Hit<float> &hit) const;
    SurfaceSample sample(float, Vec2f u) const;

private:
    float error() const;
};

struct Cylinder {
    static constexpr const char *name = "cylinder";
    static constexpr const char *doc =
        "An open tube around the axis from p0 to p1; to_world must scale alike in all directions.";
    Vec3f p0{0, 0, 0}, p1{0, 0, 1};
    float radius = 1;
    Transform to_world;
    bool flip_normals = false;
    Frame<float> axes; // n along the axis
    float height = 1;

    static constexpr auto fields() {
        return std::tuple(field("p0", &Cylinder::p0, "one end of the axis, before to_world"),
                          field("p1", &Cylinder::p1, "other end of the axis, before to_world"),
                          field("radius", &Cylinder::radius, "before to_world").range(0),
                          field("to_world", &Cylinder::to_world, "placement in the scene"),
                          field("flip_normals", &Cylinder::flip_normals, "normals point inwards"));
    }
    void build();
    void prepare_sampling() {}
    Bounds bounds() const;
    float area() const { return 2 * pi * radius * height; }
    float intersect(const Ray<float> &ray) const;
    void fill(const Ray<float> &ray, const RayHit &found, const HitNeeds &, Hit<float> &hit) const;
    SurfaceSample sample(float, Vec2f u) const;

private:
    SurfaceSample at(Vec2f around, float z) const; // a unit vector across the axis, z in [0, height]
};

using Shape = std::variant<TriangleMesh, Sphere, Rectangle, Disk, Cylinder, Curves, SdfGrid>;

} // namespace lajolla
