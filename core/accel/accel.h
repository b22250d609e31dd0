#pragma once
// Ray queries. accel.cpp is the only file that uses Embree.

#include <bit>
#include <cstdint>
#include <memory>
#include <optional>
#include <vector>

#include "base/shared_vector.h"
#include "geometry/hit.h"
#include "geometry/instance.h"
#include "geometry/shapes.h"

namespace lajolla {

// A spatial index over shapes; shape ids are positions in the list. Shapes in groups exist only through
// instances.
class Accel {
public:
    // `robust`: no ray passes between neighbouring triangles; absent: only where it matters most, in meshes
    // made of faces. Groups are shared with another index as far as their shapes are the same.
    explicit Accel(SharedVector<Shape> shapes, SharedVector<Group> groups = {},
                   const SharedVector<Instance> &instances = {}, std::optional<bool> robust = {},
                   const Accel *before = nullptr);

    // Rays with NaN or extremely large numbers, which a broken texture can cause, have no hits, and no light
    // comes along them: they are occluded. The same holds for rays that end before they begin.
    std::optional<RayHit> closest(const Ray<float> &ray) const;
    bool occluded(const Ray<float> &ray) const;
    // The same for the `active` rays, with the same bits: Embree's results do not depend on packets.
    RayHits closest(const Ray<WideFloat> &rays, WideBool active) const;
    WideBool occluded(const Ray<WideFloat> &rays, WideBool active) const;
    // Which rays are none of those.
    WideBool traceable(const Ray<WideFloat> &rays) const;

private:
    RayHit in_instance(RayHit found, std::uint32_t geometry) const;
    // Embree would need a second tree for spheres, and a callback for each test; a few spheres are
    // intersected in lanes instead.
    static constexpr std::size_t most_loose_spheres = 8;
    struct LooseSphere {
        const Sphere *sphere;
        std::int32_t id;
    };
    static std::vector<LooseSphere> few_spheres(const SharedVector<Shape> &shapes,
                                                const std::vector<bool> &is_member);

    struct Embree;
    SharedVector<Shape> shapes_; // Embree has their addresses
    std::shared_ptr<const Embree> embree_;
    float limit_ = 0;               // largest coordinate of a ray
    std::uint32_t shape_count_ = 0; // geometries from here on are instances
    SharedVector<Group> groups_;
    std::vector<std::uint32_t> group_of_instance_;
    std::vector<LooseSphere> loose_spheres_;
    bool has_curves_ = false;
    void *scene_ = nullptr; // embree_'s scene, one indirection closer
};

// One query, recorded for the replay of bench/limit.
struct RecordedRay {
    Ray<float> ray;
    bool occlusion;
};

// Ray queries of one thread: counts rays, and optionally records them.
class Tracer {
public:
    explicit Tracer(const Accel &accel, std::vector<RecordedRay> *record = nullptr)
        : accel_(accel), record_(record) {}

    std::optional<RayHit> closest(const Ray<float> &ray) {
        note(ray, false);
        return accel_.closest(ray);
    }
    bool occluded(const Ray<float> &ray) {
        note(ray, true);
        return accel_.occluded(ray);
    }
    RayHits closest(const Ray<WideFloat> &rays, WideBool active) {
        note(rays, active, false);
        return accel_.closest(rays, active);
    }
    WideBool occluded(const Ray<WideFloat> &rays, WideBool active) {
        note(rays, active, true);
        return accel_.occluded(rays, active);
    }
    std::uint64_t rays() const { return rays_; }

private:
    void note(const Ray<float> &ray, bool occlusion) {
        ++rays_;
        if (record_) [[unlikely]]
            record_->push_back({ray, occlusion});
    }
    void note(const Ray<WideFloat> &rays, WideBool active, bool occlusion) {
        rays_ += static_cast<unsigned>(std::popcount(bits(active)));
        if (record_) [[unlikely]]
            for_each_lane(active, [&](int k) { record_->push_back({lane_of(rays, k), occlusion}); });
    }

    const Accel &accel_;
    std::vector<RecordedRay> *record_;
    std::uint64_t rays_ = 0;
};

} // namespace lajolla
