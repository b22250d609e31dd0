#pragma once
// Ray queries. accel.cpp is the only file that knows Embree.

#include <bit>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "geometry/hit.h"
#include "geometry/instance.h"
#include "geometry/shapes.h"

namespace lajolla {

// A spatial index over shapes; shape ids are positions in the span, which must outlive it. Shapes that are
// members of a group are there where instances place them, and nowhere else.
class Accel {
public:
    explicit Accel(std::span<const Shape> shapes, std::span<const Group> groups = {},
                   std::span<const Instance> instances = {});

    // Rays with NaN or absurdly large numbers, which a broken texture can cause, hit nothing and see nothing.
    std::optional<RayHit> closest(const Ray<float> &ray) const;
    bool occluded(const Ray<float> &ray) const;
    // The same of the rays where `active`, with the same answers: Embree gives single rays and packets the
    // same bits.
    RayHits closest(const Ray<WideFloat> &rays, WideBool active) const;
    WideBool occluded(const Ray<WideFloat> &rays, WideBool active) const;

private:
    RayHit in_instance(RayHit found, std::uint32_t geometry) const;
    // Spheres cost Embree a tree of its own and a call for each that a ray comes near; a few of them are
    // tested for all lanes at once instead.
    static constexpr std::size_t most_loose_spheres = 8;
    struct LooseSphere {
        const Sphere *sphere;
        std::int32_t id;
    };
    static std::vector<LooseSphere> few_spheres(std::span<const Shape> shapes,
                                                const std::vector<bool> &is_member);

    struct Embree;
    std::shared_ptr<const Embree> embree_;
    float limit_ = 0;               // of rays' coordinates
    std::uint32_t shape_count_ = 0; // instances are the geometries from here on
    std::vector<Group> groups_;
    std::vector<std::uint32_t> group_of_instance_;
    std::vector<LooseSphere> loose_spheres_;
    bool has_curves_ = false;
    void *scene_ = nullptr; // embree_'s scene, one indirection closer
};

// One query, as the replay of bench/limit asks it again.
struct RecordedRay {
    Ray<float> ray;
    bool occlusion;
};

// One thread's view of the scene's geometry: counts rays, and records them where asked to.
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
