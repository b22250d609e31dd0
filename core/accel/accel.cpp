#include "accel/accel.h"

#include <algorithm>
#include <cstring>

#include "accel/embree_scene.h"

namespace lajolla {

namespace {

// Embree 3 takes a context with each query, Embree 4 optional arguments behind it.
template <class Function, class Query>
void ask(Function *function, RTCScene scene, Query &query) {
#if RTC_VERSION_MAJOR >= 4
    function(scene, &query, nullptr);
#else
    RTCIntersectContext context;
    rtcInitIntersectContext(&context);
    function(scene, &context, &query);
#endif
}
template <class Function, class Query>
void ask(Function *function, const WideInt &valid, RTCScene scene, Query &query) {
    alignas(64) std::int32_t lanes_asked[lanes];
    store(lanes_asked, valid);
#if RTC_VERSION_MAJOR >= 4
    function(lanes_asked, scene, &query, nullptr);
#else
    RTCIntersectContext context;
    rtcInitIntersectContext(&context);
    function(lanes_asked, scene, &context, &query);
#endif
}

// A packet of as many rays as there are lanes.
using RayPacket = std::conditional_t<lanes == 16, RTCRay16, RTCRay8>;
using HitPacket = std::conditional_t<lanes == 16, RTCRayHit16, RTCRayHit8>;
void intersect_packet(const WideInt &valid, RTCScene scene, HitPacket &query) {
    if constexpr (lanes == 16) ask(rtcIntersect16, valid, scene, query);
    else ask(rtcIntersect8, valid, scene, query);
}
void occlude_packet(const WideInt &valid, RTCScene scene, RayPacket &query) {
    if constexpr (lanes == 16) ask(rtcOccluded16, valid, scene, query);
    else ask(rtcOccluded8, valid, scene, query);
}

// Embree asserts that rays are finite and below about 2e18, in groups too, and that their ends are numbers.
// Of a ray that ends behind its origin it would say that it is occluded.
constexpr float largest_coordinate = 1e18f;

template <class Float>
BoolOf<Float> valid(const Ray<Float> &ray, float limit) {
    const auto sum = [](const Vec3<Float> &v) { return abs(v.x) + abs(v.y) + abs(v.z); };
    return sum(ray.origin) < limit && sum(ray.direction) < limit && ray.near <= ray.far;
}

void fill(RayPacket &packet, const Ray<WideFloat> &rays) {
    store(packet.org_x, rays.origin.x), store(packet.org_y, rays.origin.y),
        store(packet.org_z, rays.origin.z);
    store(packet.dir_x, rays.direction.x), store(packet.dir_y, rays.direction.y);
    store(packet.dir_z, rays.direction.z);
    store(packet.tnear, rays.near), store(packet.tfar, rays.far);
    store(packet.time, WideFloat(0));
    std::memset(packet.mask, 0xff, sizeof packet.mask);
    std::memset(packet.id, 0, sizeof packet.id);
    std::memset(packet.flags, 0, sizeof packet.flags);
}

RTCRay to_embree(const Ray<float> &ray) {
    RTCRay r;
    r.org_x = ray.origin.x, r.org_y = ray.origin.y, r.org_z = ray.origin.z;
    r.dir_x = ray.direction.x, r.dir_y = ray.direction.y, r.dir_z = ray.direction.z;
    r.tnear = ray.near, r.tfar = ray.far;
    r.time = 0;
    r.mask = ~0u;
    r.id = r.flags = 0;
    return r;
}

} // namespace

// The spheres outside of groups, if they are few.
std::vector<Accel::LooseSphere> Accel::few_spheres(const SharedVector<Shape> &shapes,
                                                   const std::vector<bool> &is_member) {
    std::vector<LooseSphere> result;
    for (std::size_t id = 0; id < shapes.size(); ++id)
        if (const auto *sphere = std::get_if<Sphere>(&shapes[id]); sphere && !is_member[id])
            result.push_back({sphere, static_cast<std::int32_t>(id)});
    if (result.size() > most_loose_spheres) result.clear();
    return result;
}

struct Accel::Embree {
    EmbreeDevice device;
    BuildOptions options;
    EmbreeScene scene;
    std::vector<std::shared_ptr<const EmbreeScene>> groups;

    Embree(EmbreeDevice on, const SharedVector<Shape> &shapes, std::optional<bool> robust)
        : device(std::move(on)), options{build_quality(shapes), robust}, scene(device, options, shapes) {}

    void add_group(const Group &group, const SharedVector<Shape> &shapes) {
        const auto added = std::make_shared<EmbreeScene>(device, options, shapes);
        std::vector<const Shape *> members;
        for (const std::uint32_t id : group) members.push_back(&shapes[id]);
        added->attach_all(members, static_cast<std::uint32_t>(members.size()));
        added->commit();
        groups.push_back(added);
    }
};

// Whether a group of an earlier index serves for this one.
static bool is_same_group(const Group &group, const SharedVector<Shape> &shapes, const Group &before,
                          const SharedVector<Shape> &shapes_before) {
    return group == before &&
           (shapes.shares(shapes_before) || std::ranges::all_of(group, [&](std::uint32_t id) {
                return same_geometry(shapes[id], shapes_before[id]);
            }));
}

Accel::Accel(SharedVector<Shape> shapes, SharedVector<Group> groups, const SharedVector<Instance> &instances,
             std::optional<bool> robust, const Accel *before)
    : shapes_(std::move(shapes)), shape_count_(static_cast<std::uint32_t>(shapes_.size())),
      groups_(std::move(groups)) {
    const auto embree =
        std::make_shared<Embree>(before ? before->embree_->device : new_embree_device(), shapes_, robust);
    const bool may_share = before && embree->options == before->embree_->options;
    std::vector<bool> is_member(shapes_.size(), false);
    for (std::size_t i = 0; i < groups_.size(); ++i) {
        for (const std::uint32_t id : groups_[i]) is_member[id] = true;
        if (may_share && is_same_group(groups_[i], shapes_, before->groups_[i], before->shapes_))
            embree->groups.push_back(before->embree_->groups[i]);
        else embree->add_group(groups_[i], shapes_);
    }
    loose_spheres_ = few_spheres(shapes_, is_member);
    std::vector<const Shape *> seen(shapes_.size()); // null for shapes in groups, loose spheres
    for (std::uint32_t id = 0; id < shape_count_; ++id) {
        has_curves_ |= std::holds_alternative<Curves>(shapes_[id]);
        if (!is_member[id] && !(std::holds_alternative<Sphere>(shapes_[id]) && !loose_spheres_.empty()))
            seen[id] = &shapes_[id];
    }
    embree->scene.attach_all(seen, shape_count_ + static_cast<std::uint32_t>(instances.size()));
    limit_ = largest_coordinate;
    for (const Instance &instance : instances) {
        for (std::size_t axis = 0; axis < 3;
             ++axis) // an instance's translation is small compared with the limit
            limit_ = std::min(limit_,
                              0.5f * largest_coordinate / max_component(abs(instance.to_group.axis(axis))));
        embree->scene.attach(instance, embree->groups[static_cast<std::size_t>(instance.group)]->get(),
                             shape_count_ + static_cast<std::uint32_t>(group_of_instance_.size()));
        group_of_instance_.push_back(static_cast<std::uint32_t>(instance.group));
    }
    embree->scene.commit();
    refuse_errors(embree->device.get());
    scene_ = embree->scene.get();
    embree_ = embree;
}

std::optional<RayHit> Accel::closest(const Ray<float> &ray) const {
    if (!valid(ray, limit_)) [[unlikely]]
        return std::nullopt;
    RTCRayHit query;
    query.ray = to_embree(ray);
    query.hit.geomID = RTC_INVALID_GEOMETRY_ID;
    query.hit.instID[0] = RTC_INVALID_GEOMETRY_ID;
    ask(rtcIntersect1, static_cast<RTCScene>(scene_), query);
    RayHit found{query.ray.tfar, query.hit.u, query.hit.v, query.hit.geomID, query.hit.primID};
    if (query.hit.instID[0] != RTC_INVALID_GEOMETRY_ID) [[unlikely]]
        found = in_instance(found, query.hit.instID[0]);
    bool any_sphere = false;
    Ray<float> rest = ray;
    rest.far = found.distance;
    for (const auto &[sphere, id] : loose_spheres_)
        if (const float t = sphere->intersect(rest); t != infinity) {
            found = {t, 0, 0, static_cast<std::uint32_t>(id), 0};
            rest.far = t;
            any_sphere = true;
        }
    if (query.hit.geomID == RTC_INVALID_GEOMETRY_ID && !any_sphere) return std::nullopt;
    return found;
}

RayHit Accel::in_instance(RayHit found, std::uint32_t geometry) const {
    found.instance = geometry - shape_count_;
    found.shape = groups_[group_of_instance_[found.instance]][found.shape];
    return found;
}

bool Accel::occluded(const Ray<float> &ray) const {
    if (!valid(ray, limit_)) [[unlikely]]
        return true;
    for (const auto &[sphere, id] : loose_spheres_)
        if (sphere->intersect(ray) != infinity) return true;
    RTCRay query = to_embree(ray);
    ask(rtcOccluded1, static_cast<RTCScene>(scene_), query);
    return query.tfar < 0;
}

RayHits Accel::closest(const Ray<WideFloat> &rays, WideBool active) const {
    if (has_curves_) [[unlikely]] {
        RayHits hits{rays.far, 0, 0, -1, -1, -1};
        for_each_lane(active, [&](int k) {
            if (const auto found = closest(lane_of(rays, k))) set_lane(hits, k, *found);
        });
        return hits;
    }
    const WideBool asked = active && valid(rays, limit_);
    HitPacket query;
    fill(query.ray, rays);
    std::memset(query.hit.geomID, 0xff, sizeof query.hit.geomID);
    std::memset(query.hit.instID[0], 0xff, sizeof query.hit.instID[0]);
    intersect_packet(WideInt(asked.v), static_cast<RTCScene>(scene_), query);
    const auto integers = [](const unsigned *p) { return load(reinterpret_cast<const std::int32_t *>(p)); };
    RayHits hits{load(query.ray.tfar),       load(query.hit.u),          load(query.hit.v),
                 integers(query.hit.geomID), integers(query.hit.primID), integers(query.hit.instID[0])};
    const WideBool found = asked && hits.shape != -1;
    hits.shape = select(found, hits.shape, WideInt(-1));
    for_each_lane(found && hits.instance != -1, [&](int k) {
        const RayHit one = in_instance(hits[k], static_cast<std::uint32_t>(hits.instance[k]));
        hits.shape.v[k] = static_cast<std::int32_t>(one.shape);
        hits.instance.v[k] = static_cast<std::int32_t>(one.instance);
    });
    Ray<WideFloat> rest = rays;
    rest.far = hits.distance;
    for (const auto &[sphere, id] : loose_spheres_) {
        const WideFloat t = sphere->intersect(rest);
        const WideBool nearer = asked && t != WideFloat(infinity);
        if (!any(nearer)) continue;
        rest.far = select(nearer, t, rest.far);
        hits = {rest.far,
                select(nearer, WideFloat(0), hits.b1),
                select(nearer, WideFloat(0), hits.b2),
                select(nearer, WideInt(id), hits.shape),
                select(nearer, WideInt(0), hits.primitive),
                select(nearer, WideInt(-1), hits.instance)};
    }
    return hits;
}

WideBool Accel::traceable(const Ray<WideFloat> &rays) const { return valid(rays, limit_); }

WideBool Accel::occluded(const Ray<WideFloat> &rays, WideBool active) const {
    if (has_curves_) [[unlikely]] {
        unsigned found = 0;
        for_each_lane(active, [&](int k) { found |= occluded(lane_of(rays, k)) ? 1u << k : 0; });
        return mask_of(found);
    }
    WideBool asked = active && valid(rays, limit_), result = !asked;
    for (const auto &[sphere, id] : loose_spheres_)
        result = result || sphere->intersect(rays) != WideFloat(infinity);
    asked = asked && !result;
    if (!any(asked)) return result;
    RayPacket query;
    fill(query, rays);
    occlude_packet(WideInt(asked.v), static_cast<RTCScene>(scene_), query);
    return result || load(query.tfar) < 0.0f;
}

} // namespace lajolla
