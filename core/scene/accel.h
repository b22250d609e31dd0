#pragma once
// Ray queries. accel.cpp is the only file that knows Embree.

#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "scene/hit.h"
#include "scene/instance.h"
#include "scene/shapes.h"

namespace lajolla {

// A spatial index over shapes; shape ids are positions in the span, which must outlive it. Shapes that are
// members of a group are there where instances place them, and nowhere else.
class Accel {
public:
    explicit Accel(std::span<const Shape> shapes, std::span<const Group> groups = {},
                   std::span<const Instance> instances = {});

    // Rays with NaN or absurdly large numbers, which a broken texture can cause, hit nothing and see nothing.
    std::optional<RayHit> closest(const Ray &ray) const;
    bool occluded(const Ray &ray) const;

private:
    RayHit in_instance(RayHit found, std::uint32_t geometry) const;

    struct Embree;
    std::shared_ptr<const Embree> embree_;
    float limit_ = 0;               // of rays' coordinates
    std::uint32_t shape_count_ = 0; // instances are the geometries from here on
    std::vector<Group> groups_;
    std::vector<std::uint32_t> group_of_instance_;
    void *scene_ = nullptr; // embree_'s scene, one indirection closer
};

// One query, as the replay of bench/limit asks it again.
struct RecordedRay {
    Ray ray;
    bool occlusion;
};

// One thread's view of the scene's geometry: counts rays, and records them where asked to.
class Tracer {
public:
    explicit Tracer(const Accel &accel, std::vector<RecordedRay> *record = nullptr)
        : accel_(accel), record_(record) {}

    std::optional<RayHit> closest(const Ray &ray) {
        note(ray, false);
        return accel_.closest(ray);
    }
    bool occluded(const Ray &ray) {
        note(ray, true);
        return accel_.occluded(ray);
    }
    std::uint64_t rays() const { return rays_; }

private:
    void note(const Ray &ray, bool occlusion) {
        ++rays_;
        if (record_) [[unlikely]]
            record_->push_back({ray, occlusion});
    }

    const Accel &accel_;
    std::vector<RecordedRay> *record_;
    std::uint64_t rays_ = 0;
};

} // namespace lajolla
