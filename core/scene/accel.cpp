#include "scene/accel.h"

#include <stdexcept>

#if __has_include(<embree4/rtcore.h>)
#include <embree4/rtcore.h>
#else
#include <embree3/rtcore.h>
#endif

namespace lajolla {

namespace {

void intersect1(RTCScene scene, RTCRayHit &query) {
#if RTC_VERSION_MAJOR >= 4
    rtcIntersect1(scene, &query, nullptr);
#else
    RTCIntersectContext context;
    rtcInitIntersectContext(&context);
    rtcIntersect1(scene, &context, &query);
#endif
}

void occluded1(RTCScene scene, RTCRay &query) {
#if RTC_VERSION_MAJOR >= 4
    rtcOccluded1(scene, &query, nullptr);
#else
    RTCIntersectContext context;
    rtcInitIntersectContext(&context);
    rtcOccluded1(scene, &context, &query);
#endif
}

// Embree asserts that rays are finite and below about 2e18, in groups too.
constexpr float largest_coordinate = 1e18f;

bool valid(const Ray &ray, float limit) {
    return dot(abs(ray.origin), Vec3f(1)) < limit && dot(abs(ray.direction), Vec3f(1)) < limit;
}

RTCRay to_embree(const Ray &ray) {
    RTCRay r;
    r.org_x = ray.origin.x, r.org_y = ray.origin.y, r.org_z = ray.origin.z;
    r.dir_x = ray.direction.x, r.dir_y = ray.direction.y, r.dir_z = ray.direction.z;
    r.tnear = ray.near, r.tfar = ray.far;
    r.time = 0;
    r.mask = ~0u;
    r.id = r.flags = 0;
    return r;
}

Ray from_embree(const RTCRay &r) {
    return {{r.org_x, r.org_y, r.org_z}, {r.dir_x, r.dir_y, r.dir_z}, r.tnear, r.tfar};
}

// Shapes without triangles are Embree "user geometry": callbacks that ask the shape itself, or one of its
// parts.
template <class T>
concept HasParts = requires(const T &shape) { shape.primitive_count(); };

template <class T>
std::optional<float> intersect_part(const void *shape, const RTCRay &ray, std::uint32_t primitive) {
    if constexpr (HasParts<T>) return static_cast<const T *>(shape)->intersect(from_embree(ray), primitive);
    else return static_cast<const T *>(shape)->intersect(from_embree(ray));
}

template <class T>
void set_bounds(const RTCBoundsFunctionArguments *args) {
    const auto &shape = *static_cast<const T *>(args->geometryUserPtr);
    Bounds box;
    if constexpr (HasParts<T>) box = shape.bounds(args->primID);
    else box = shape.bounds();
    *args->bounds_o = {box.low.x, box.low.y, box.low.z, 0, box.high.x, box.high.y, box.high.z, 0};
}

template <class T>
void intersect_user(const RTCIntersectFunctionNArguments *args) {
    if (!args->valid[0]) return;
    auto &query = *reinterpret_cast<RTCRayHit *>(args->rayhit);
    const auto t = intersect_part<T>(args->geometryUserPtr, query.ray, args->primID);
    if (!t) return;
    query.ray.tfar = *t;
    query.hit.geomID = args->geomID;
    query.hit.primID = args->primID;
    query.hit.instID[0] = args->context->instID[0];
    query.hit.u = query.hit.v = 0;
}

template <class T>
void occluded_user(const RTCOccludedFunctionNArguments *args) {
    if (!args->valid[0]) return;
    auto &ray = *reinterpret_cast<RTCRay *>(args->ray);
    if (intersect_part<T>(args->geometryUserPtr, ray, args->primID)) ray.tfar = -infinity;
}

template <class T>
RTCGeometry make_geometry(RTCDevice device, const T &shape) {
    RTCGeometry geometry = rtcNewGeometry(device, RTC_GEOMETRY_TYPE_USER);
    if constexpr (HasParts<T>) rtcSetGeometryUserPrimitiveCount(geometry, shape.primitive_count());
    else rtcSetGeometryUserPrimitiveCount(geometry, 1);
    rtcSetGeometryUserData(geometry, const_cast<T *>(&shape)); // only ever read
    rtcSetGeometryBoundsFunction(geometry, set_bounds<T>, nullptr);
    rtcSetGeometryIntersectFunction(geometry, intersect_user<T>);
    rtcSetGeometryOccludedFunction(geometry, occluded_user<T>);
    return geometry;
}

RTCGeometry make_geometry(RTCDevice device, const TriangleMesh &shape) {
    RTCGeometry geometry = rtcNewGeometry(device, RTC_GEOMETRY_TYPE_TRIANGLE);
    // The arrays are shared with Embree, which reads 16 bytes at each position: build() leaves room behind
    // the last.
    const Mesh &mesh = *shape.mesh;
    rtcSetSharedGeometryBuffer(geometry, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3, mesh.positions.data(),
                               0, sizeof(Vec3f), mesh.positions.size());
    rtcSetSharedGeometryBuffer(geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3, mesh.triangles.data(), 0,
                               sizeof(Triangle), mesh.triangles.size());
    return geometry;
}

// Curves are hit from outside only, whatever Embree was built for: light that enters a hair leaves it within
// the same scattering event.
void cull_inside(const RTCFilterFunctionNArguments *args) {
    const auto &ray = *reinterpret_cast<const RTCRay *>(args->ray);
    const auto &hit = *reinterpret_cast<const RTCHit *>(args->hit);
    if (ray.dir_x * hit.Ng_x + ray.dir_y * hit.Ng_y + ray.dir_z * hit.Ng_z > 0) args->valid[0] = 0;
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

} // namespace

struct Accel::Embree {
    RTCDevice device;
    RTCScene scene;
    std::vector<RTCScene> groups;

    Embree() : device(rtcNewDevice(nullptr)), scene(device ? rtcNewScene(device) : nullptr) {
        if (!scene) throw std::runtime_error("Embree could not start");
    }
    Embree(const Embree &) = delete;
    Embree &operator=(const Embree &) = delete;
    ~Embree() {
        rtcReleaseScene(scene);
        for (RTCScene group : groups) rtcReleaseScene(group);
        rtcReleaseDevice(device);
    }

    void attach(RTCScene to, RTCGeometry geometry, std::uint32_t id) const {
        rtcCommitGeometry(geometry);
        rtcAttachGeometryByID(to, geometry, id);
        rtcReleaseGeometry(geometry);
    }
    void attach(RTCScene to, const Shape &shape, std::uint32_t id) const {
        attach(to, match(shape, [&](const auto &s) { return make_geometry(device, s); }), id);
    }
    void attach(RTCScene to, const Instance &instance, std::uint32_t id) const {
        RTCGeometry geometry = rtcNewGeometry(device, RTC_GEOMETRY_TYPE_INSTANCE);
        rtcSetGeometryInstancedScene(geometry, groups[static_cast<std::size_t>(instance.group)]);
        rtcSetGeometryTimeStepCount(geometry, 1);
        rtcSetGeometryTransform(geometry, 0, RTC_FORMAT_FLOAT3X4_ROW_MAJOR, instance.to_world.m.data());
        attach(to, geometry, id);
    }
};

Accel::Accel(std::span<const Shape> shapes, std::span<const Group> groups,
             std::span<const Instance> instances)
    : shape_count_(static_cast<std::uint32_t>(shapes.size())), groups_(groups.begin(), groups.end()) {
    auto embree = std::make_shared<Embree>();
    std::vector<bool> is_member(shapes.size(), false);
    for (const Group &group : groups) {
        RTCScene scene = embree->groups.emplace_back(rtcNewScene(embree->device));
        rtcSetSceneBuildQuality(scene, RTC_BUILD_QUALITY_HIGH);
        for (std::uint32_t i = 0; i < group.size(); ++i) {
            embree->attach(scene, shapes[group[i]], i);
            is_member[group[i]] = true;
        }
        rtcCommitScene(scene);
    }
    rtcSetSceneBuildQuality(embree->scene, RTC_BUILD_QUALITY_HIGH);
    for (std::uint32_t id = 0; id < shape_count_; ++id)
        if (!is_member[id]) embree->attach(embree->scene, shapes[id], id);
    limit_ = largest_coordinate;
    for (const Instance &instance : instances) {
        for (std::size_t axis = 0; axis < 3; ++axis) // an instance's translation is small beside the limit
            limit_ = std::min(limit_,
                              0.5f * largest_coordinate / max_component(abs(instance.to_group.axis(axis))));
        embree->attach(embree->scene, instance,
                       shape_count_ + static_cast<std::uint32_t>(group_of_instance_.size()));
        group_of_instance_.push_back(static_cast<std::uint32_t>(instance.group));
    }
    rtcCommitScene(embree->scene);
    if (const RTCError error = rtcGetDeviceError(embree->device); error != RTC_ERROR_NONE)
        throw std::runtime_error("Embree could not build the scene (error " + std::to_string(error) + ")");
    scene_ = embree->scene;
    embree_ = std::move(embree);
}

std::optional<RayHit> Accel::closest(const Ray &ray) const {
    if (!valid(ray, limit_)) [[unlikely]]
        return std::nullopt;
    RTCRayHit query;
    query.ray = to_embree(ray);
    query.hit.geomID = RTC_INVALID_GEOMETRY_ID;
    query.hit.instID[0] = RTC_INVALID_GEOMETRY_ID;
    intersect1(static_cast<RTCScene>(scene_), query);
    if (query.hit.geomID == RTC_INVALID_GEOMETRY_ID) return std::nullopt;
    const RayHit found{query.ray.tfar, query.hit.u, query.hit.v, query.hit.geomID, query.hit.primID};
    if (query.hit.instID[0] != RTC_INVALID_GEOMETRY_ID) [[unlikely]]
        return in_instance(found, query.hit.instID[0]);
    return found;
}

RayHit Accel::in_instance(RayHit found, std::uint32_t geometry) const {
    found.instance = geometry - shape_count_;
    found.shape = groups_[group_of_instance_[found.instance]][found.shape];
    return found;
}

bool Accel::occluded(const Ray &ray) const {
    if (!valid(ray, limit_)) [[unlikely]]
        return true;
    RTCRay query = to_embree(ray);
    occluded1(static_cast<RTCScene>(scene_), query);
    return query.tfar < 0;
}

} // namespace lajolla
