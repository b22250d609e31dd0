#pragma once
// Scenes of Embree, which are made of shapes.

#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <type_traits>
#include <vector>

#if __has_include(<embree4/rtcore.h>)
#include <embree4/rtcore.h>
#else
#include <embree3/rtcore.h>
#endif

#include "base/shared_vector.h"
#include "geometry/instance.h"
#include "geometry/shapes.h"

namespace lajolla {

using EmbreeDevice = std::shared_ptr<std::remove_pointer_t<RTCDevice>>;
EmbreeDevice new_embree_device(); // throws std::bad_alloc or std::runtime_error

void refuse_errors(RTCDevice device); // throws the same if a function of the device has failed

// How Embree builds its scenes.
struct BuildOptions {
    RTCBuildQuality quality;
    std::optional<bool> robust; // absent: where it has meshes made of faces
    friend bool operator==(const BuildOptions &, const BuildOptions &) = default;
};
RTCBuildQuality build_quality(const SharedVector<Shape> &shapes);

// Whether Embree's geometry for one shape serves for the other too: it refers to arrays, not to the shape.
bool same_geometry(const Shape &a, const Shape &b);

// All spheres of an Embree scene, as one geometry, because a geometry for each would take a kilobyte.
struct SphereSet {
    struct Ball {
        Vec3f center;
        float radius;
    };
    std::vector<Ball> balls;
    std::vector<std::uint32_t> ids; // shape ids for hits

    void add(const Sphere &sphere, std::uint32_t id) {
        balls.push_back({sphere.center, sphere.radius});
        ids.push_back(id);
    }
    std::uint32_t primitive_count() const { return static_cast<std::uint32_t>(balls.size()); }
    Bounds bounds(std::uint32_t i) const {
        return {balls[i].center - Vec3f(balls[i].radius), balls[i].center + Vec3f(balls[i].radius)};
    }
    template <class Float>
    Float intersect(const Ray<Float> &ray, std::uint32_t i) const {
        return intersect_sphere(balls[i].center, balls[i].radius, ray);
    }
};

// A scene of Embree, and all that it has the addresses of.
class EmbreeScene {
public:
    EmbreeScene(EmbreeDevice device, const BuildOptions &options, SharedVector<Shape> shapes);
    EmbreeScene(const EmbreeScene &) = delete;
    EmbreeScene &operator=(const EmbreeScene &) = delete;
    ~EmbreeScene() { rtcReleaseScene(scene_); }

    RTCScene get() const { return scene_; }

    // The i-th has the geometry id i; null ones are left out. All spheres have the geometry id `last`.
    void attach_all(std::span<const Shape *const> shapes, std::uint32_t last);
    void attach(const Instance &instance, RTCScene group, std::uint32_t id);
    void commit() { rtcCommitScene(scene_); }

private:
    void attach(RTCGeometry geometry, std::uint32_t id);

    EmbreeDevice device_;
    std::optional<bool> robust_;
    SharedVector<Shape> shapes_;
    SphereSet spheres_;
    RTCScene scene_;
};

} // namespace lajolla
