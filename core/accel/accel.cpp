#include "accel/accel.h"

#include <algorithm>
#include <cstring>
#include <new>
#include <span>
#include <stdexcept>
#include <type_traits>

#if __has_include(<embree4/rtcore.h>)
#include <embree4/rtcore.h>
#else
#include <embree3/rtcore.h>
#endif

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

// Shapes without triangles are Embree "user geometry", with callbacks to the shape or to one of its parts.
template <class T>
concept HasParts = requires(const T &shape) { shape.primitive_count(); };

template <class T>
float intersect_part(const void *shape, const Ray<float> &ray, std::uint32_t primitive) {
    if constexpr (HasParts<T>) return static_cast<const T *>(shape)->intersect(ray, primitive);
    else return static_cast<const T *>(shape)->intersect(ray);
}

template <class T>
void set_bounds(const RTCBoundsFunctionArguments *args) {
    const auto &shape = *static_cast<const T *>(args->geometryUserPtr);
    Bounds box;
    if constexpr (HasParts<T>) box = shape.bounds(args->primID);
    else box = shape.bounds();
    *args->bounds_o = {box.low.x, box.low.y, box.low.z, 0, box.high.x, box.high.y, box.high.z, 0};
}

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

Ray<float> ray_of(RTCRayN *rays, unsigned n, unsigned i) {
    return {{RTCRayN_org_x(rays, n, i), RTCRayN_org_y(rays, n, i), RTCRayN_org_z(rays, n, i)},
            {RTCRayN_dir_x(rays, n, i), RTCRayN_dir_y(rays, n, i), RTCRayN_dir_z(rays, n, i)},
            RTCRayN_tnear(rays, n, i),
            RTCRayN_tfar(rays, n, i)};
}

// A packet with as many rays as there are lanes stores them as arrays.
Ray<WideFloat> rays_of(RTCRayN *rays) {
    const auto n = static_cast<unsigned>(lanes);
    return {{load(&RTCRayN_org_x(rays, n, 0)), load(&RTCRayN_org_y(rays, n, 0)),
             load(&RTCRayN_org_z(rays, n, 0))},
            {load(&RTCRayN_dir_x(rays, n, 0)), load(&RTCRayN_dir_y(rays, n, 0)),
             load(&RTCRayN_dir_z(rays, n, 0))},
            load(&RTCRayN_tnear(rays, n, 0)),
            load(&RTCRayN_tfar(rays, n, 0))};
}

// Calls f(ray, distance) for each valid ray that hits a primitive; in lanes if the primitive supports them.
template <class T>
void for_each_meeting(const void *data, RTCRayN *rays, const int *valid, unsigned n, std::uint32_t primitive,
                      auto &&f) {
    if constexpr (std::is_same_v<T, SphereSet>)
        if (n == static_cast<unsigned>(lanes)) {
            const WideFloat t = static_cast<const T *>(data)->intersect(rays_of(rays), primitive);
            const WideBool meets = WideBool(load(valid).v) && t != WideFloat(infinity);
            return for_each_lane(meets, [&](int k) { f(static_cast<unsigned>(k), t[k]); });
        }
    for (unsigned i = 0; i < n; ++i) {
        if (!valid[i]) continue;
        const float t = intersect_part<T>(data, ray_of(rays, n, i), primitive);
        if (t != infinity) f(i, t);
    }
}

// Embree's callback for one ray, or for the valid rays of a packet.
template <class T>
void intersect_user(const RTCIntersectFunctionNArguments *args) {
    RTCRayN *rays = RTCRayHitN_RayN(args->rayhit, args->N);
    RTCHitN *hits = RTCRayHitN_HitN(args->rayhit, args->N);
    std::uint32_t shape = args->geomID, primitive = args->primID;
    if constexpr (std::is_same_v<T, SphereSet>) {
        shape = static_cast<const T *>(args->geometryUserPtr)->ids[primitive];
        primitive = 0;
    }
    for_each_meeting<T>(args->geometryUserPtr, rays, args->valid, args->N, args->primID,
                        [&](unsigned i, float t) {
                            RTCRayN_tfar(rays, args->N, i) = t;
                            RTCHitN_geomID(hits, args->N, i) = shape;
                            RTCHitN_primID(hits, args->N, i) = primitive;
                            RTCHitN_instID(hits, args->N, i, 0) = args->context->instID[0];
                            RTCHitN_u(hits, args->N, i) = RTCHitN_v(hits, args->N, i) = 0;
                        });
}

template <class T>
void occluded_user(const RTCOccludedFunctionNArguments *args) {
    for_each_meeting<T>(args->geometryUserPtr, args->ray, args->valid, args->N, args->primID,
                        [&](unsigned i, float) { RTCRayN_tfar(args->ray, args->N, i) = -infinity; });
}

template <class T>
RTCGeometry make_geometry(RTCDevice device, const T &shape) {
    RTCGeometry geometry = rtcNewGeometry(device, RTC_GEOMETRY_TYPE_USER);
    if constexpr (HasParts<T>) rtcSetGeometryUserPrimitiveCount(geometry, shape.primitive_count());
    else rtcSetGeometryUserPrimitiveCount(geometry, 1);
    rtcSetGeometryUserData(geometry, const_cast<T *>(&shape)); // never modified
    rtcSetGeometryBoundsFunction(geometry, set_bounds<T>, nullptr);
    rtcSetGeometryIntersectFunction(geometry, intersect_user<T>);
    rtcSetGeometryOccludedFunction(geometry, occluded_user<T>);
    return geometry;
}

RTCGeometry make_geometry(RTCDevice device, const TriangleMesh &shape) {
    RTCGeometry geometry = rtcNewGeometry(device, RTC_GEOMETRY_TYPE_TRIANGLE);
    // The arrays are shared with Embree, which reads 16 bytes at each position: a RoomyVector is padded
    // accordingly.
    const Mesh &mesh = *shape.mesh;
    rtcSetSharedGeometryBuffer(geometry, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3, mesh.positions.data(),
                               0, sizeof(Vec3f), mesh.positions.size());
    rtcSetSharedGeometryBuffer(geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3, mesh.triangles.data(), 0,
                               sizeof(Triangle), mesh.triangles.size());
    return geometry;
}

// Spatial splits, which high quality enables, make rays 8 % faster in a hall of 66 000 triangles, but up to
// 14 % slower in rooms of 200 000 to 400 000, and the build takes two to three times as long.
RTCBuildQuality build_quality(const SharedVector<Shape> &shapes) {
    std::size_t triangles = 0;
    for (const Shape &shape : shapes)
        if (const auto *mesh = std::get_if<TriangleMesh>(&shape)) triangles += mesh->mesh->triangles.size();
    return triangles < 100'000 ? RTC_BUILD_QUALITY_HIGH : RTC_BUILD_QUALITY_MEDIUM;
}

// Curves are hit from outside only, in every build of Embree: light that enters a hair leaves it in the same
// scattering event.
void cull_inside(const RTCFilterFunctionNArguments *args) {
    for (unsigned i = 0; i < args->N; ++i) {
        const Vec3f direction = ray_of(args->ray, args->N, i).direction;
        const Vec3f normal{RTCHitN_Ng_x(args->hit, args->N, i), RTCHitN_Ng_y(args->hit, args->N, i),
                           RTCHitN_Ng_z(args->hit, args->N, i)};
        if (args->valid[i] && dot(direction, normal) > 0) args->valid[i] = 0;
    }
}

RTCGeometry make_geometry(RTCDevice device, const Curves &shape) {
    RTCGeometry geometry =
        rtcNewGeometry(device, shape.basis == CurveBasis::linear ? RTC_GEOMETRY_TYPE_ROUND_LINEAR_CURVE
                                                                 : RTC_GEOMETRY_TYPE_ROUND_BSPLINE_CURVE);
    const CurveSet &curves = *shape.curves;
    rtcSetSharedGeometryBuffer(geometry, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT4, curves.points.data(),
                               0, sizeof(curves.points[0]), curves.points.size());
    rtcSetSharedGeometryBuffer(geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT, curves.segments.data(), 0,
                               sizeof(curves.segments[0]), curves.segments.size());
    rtcSetGeometryIntersectFilterFunction(geometry, cull_inside);
    rtcSetGeometryOccludedFilterFunction(geometry, cull_inside);
    return geometry;
}

RTCGeometry make_geometry(RTCDevice device, const Rectangle &shape) {
    RTCGeometry geometry = rtcNewGeometry(device, RTC_GEOMETRY_TYPE_TRIANGLE);
    const auto corners = shape.corners();
    const std::array<Triangle, 2> triangles{{{0, 1, 2}, {0, 2, 3}}};
    void *vertices = rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3,
                                             sizeof(Vec3f), corners.size());
    void *indices = rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3,
                                            sizeof(Triangle), triangles.size());
    std::copy(corners.begin(), corners.end(), static_cast<Vec3f *>(vertices));
    std::copy(triangles.begin(), triangles.end(), static_cast<Triangle *>(indices));
    return geometry;
}

// Whether Embree's geometry for one shape serves for the other too: it refers to arrays, not to the shape.
bool same_geometry(const Shape &a, const Shape &b) {
    const auto *mesh = std::get_if<TriangleMesh>(&a), *other_mesh = std::get_if<TriangleMesh>(&b);
    if (mesh && other_mesh) return mesh->mesh == other_mesh->mesh;
    const auto *curves = std::get_if<Curves>(&a), *other_curves = std::get_if<Curves>(&b);
    return curves && other_curves && curves->curves == other_curves->curves &&
           curves->basis == other_curves->basis;
}

void refuse_lack_of_memory(RTCError error) {
    if (error == RTC_ERROR_OUT_OF_MEMORY) throw std::bad_alloc();
}

void refuse_errors(RTCDevice device) {
    const RTCError error = rtcGetDeviceError(device);
    if (error == RTC_ERROR_NONE) return;
    refuse_lack_of_memory(error);
    throw std::runtime_error("Embree could not build the scene (error " + std::to_string(error) + ")");
}

using Device = std::shared_ptr<std::remove_pointer_t<RTCDevice>>;

Device new_device() {
    Device device(rtcNewDevice(nullptr), [](RTCDevice d) {
        if (d) rtcReleaseDevice(d);
    });
    if (device) return device;
    refuse_lack_of_memory(rtcGetDeviceError(nullptr)); // of this thread
    throw std::runtime_error("Embree could not start");
}

// A scene of Embree, and all that it has the addresses of.
class EmbreeScene {
public:
    EmbreeScene(Device device, RTCBuildQuality quality, SharedVector<Shape> shapes)
        : device_(std::move(device)), shapes_(std::move(shapes)), scene_(rtcNewScene(device_.get())) {
        if (!scene_) refuse_errors(device_.get());
        rtcSetSceneBuildQuality(scene_, quality);
    }
    EmbreeScene(const EmbreeScene &) = delete;
    EmbreeScene &operator=(const EmbreeScene &) = delete;
    ~EmbreeScene() { rtcReleaseScene(scene_); }

    RTCScene get() const { return scene_; }

    // The i-th has the geometry id i; null ones are left out. All spheres have the geometry id `last`.
    void attach_all(std::span<const Shape *const> shapes, std::uint32_t last) {
        for (std::uint32_t i = 0; i < shapes.size(); ++i) {
            if (!shapes[i]) continue;
            if (const auto *sphere = std::get_if<Sphere>(shapes[i])) spheres_.add(*sphere, i);
            else attach(match(*shapes[i], [&](const auto &s) { return make_geometry(device_.get(), s); }), i);
        }
        if (!spheres_.balls.empty()) attach(make_geometry(device_.get(), spheres_), last);
    }
    void attach(const Instance &instance, RTCScene group, std::uint32_t id) {
        RTCGeometry geometry = rtcNewGeometry(device_.get(), RTC_GEOMETRY_TYPE_INSTANCE);
        rtcSetGeometryInstancedScene(geometry, group);
        rtcSetGeometryTimeStepCount(geometry, 1);
        rtcSetGeometryTransform(geometry, 0, RTC_FORMAT_FLOAT3X4_ROW_MAJOR, instance.to_world.m.data());
        attach(geometry, id);
    }
    void commit() { rtcCommitScene(scene_); }

private:
    void attach(RTCGeometry geometry, std::uint32_t id) {
        rtcCommitGeometry(geometry);
        rtcAttachGeometryByID(scene_, geometry, id);
        rtcReleaseGeometry(geometry);
    }

    Device device_;
    SharedVector<Shape> shapes_;
    SphereSet spheres_;
    RTCScene scene_;
};

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
    Device device;
    RTCBuildQuality quality;
    EmbreeScene scene;
    std::vector<std::shared_ptr<const EmbreeScene>> groups;

    Embree(Device on, const SharedVector<Shape> &shapes)
        : device(std::move(on)), quality(build_quality(shapes)), scene(device, quality, shapes) {}

    void add_group(const Group &group, const SharedVector<Shape> &shapes) {
        const auto added = std::make_shared<EmbreeScene>(device, quality, shapes);
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
             const Accel *before)
    : shapes_(std::move(shapes)), shape_count_(static_cast<std::uint32_t>(shapes_.size())),
      groups_(std::move(groups)) {
    const auto embree = std::make_shared<Embree>(before ? before->embree_->device : new_device(), shapes_);
    const bool may_share = before && embree->quality == before->embree_->quality;
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
