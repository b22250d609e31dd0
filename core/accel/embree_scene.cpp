#include "accel/embree_scene.h"

#include <algorithm>
#include <cstring>
#include <new>
#include <stdexcept>
#include <string>
#include <variant>

#include "base/match.h"

namespace lajolla {

namespace {

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

void refuse_lack_of_memory(RTCError error) {
    if (error == RTC_ERROR_OUT_OF_MEMORY) throw std::bad_alloc();
}

} // namespace

EmbreeDevice new_embree_device() {
    EmbreeDevice device(rtcNewDevice(nullptr), [](RTCDevice d) {
        if (d) rtcReleaseDevice(d);
    });
    if (device) return device;
    refuse_lack_of_memory(rtcGetDeviceError(nullptr)); // of this thread
    throw std::runtime_error("Embree could not start");
}

void refuse_errors(RTCDevice device) {
    const RTCError error = rtcGetDeviceError(device);
    if (error == RTC_ERROR_NONE) return;
    refuse_lack_of_memory(error);
    throw std::runtime_error("Embree could not build the scene (error " + std::to_string(error) + ")");
}

// Spatial splits, which high quality enables, make rays 8 % faster in a hall of 66 000 triangles, but up to
// 14 % slower in rooms of 200 000 to 400 000, and the build takes two to three times as long.
RTCBuildQuality build_quality(const SharedVector<Shape> &shapes) {
    std::size_t triangles = 0;
    for (const Shape &shape : shapes)
        if (const auto *mesh = std::get_if<TriangleMesh>(&shape)) triangles += mesh->mesh->triangles.size();
    return triangles < 100'000 ? RTC_BUILD_QUALITY_HIGH : RTC_BUILD_QUALITY_MEDIUM;
}

bool same_geometry(const Shape &a, const Shape &b) {
    const auto *mesh = std::get_if<TriangleMesh>(&a), *other_mesh = std::get_if<TriangleMesh>(&b);
    if (mesh && other_mesh) return mesh->mesh == other_mesh->mesh;
    const auto *curves = std::get_if<Curves>(&a), *other_curves = std::get_if<Curves>(&b);
    return curves && other_curves && curves->curves == other_curves->curves &&
           curves->basis == other_curves->basis;
}

EmbreeScene::EmbreeScene(EmbreeDevice device, const BuildOptions &options, SharedVector<Shape> shapes)
    : device_(std::move(device)), robust_(options.robust), shapes_(std::move(shapes)),
      scene_(rtcNewScene(device_.get())) {
    if (!scene_) refuse_errors(device_.get());
    rtcSetSceneBuildQuality(scene_, options.quality);
}

// Embree's fast tests let one ray in a million pass between the triangles of a closed mesh, and many of those
// that are aimed at an edge or a vertex. Surfaces made of faces are closed: they take the tests that do not.
void EmbreeScene::attach_all(std::span<const Shape *const> shapes, std::uint32_t last) {
    const auto has_faces = [](const Shape *shape) {
        const auto *mesh = shape ? std::get_if<TriangleMesh>(shape) : nullptr;
        return mesh && !mesh->mesh->face_coordinates.empty();
    };
    if (robust_.value_or(std::ranges::any_of(shapes, has_faces)))
        rtcSetSceneFlags(scene_, RTC_SCENE_FLAG_ROBUST);
    for (std::uint32_t i = 0; i < shapes.size(); ++i) {
        if (!shapes[i]) continue;
        if (const auto *sphere = std::get_if<Sphere>(shapes[i])) spheres_.add(*sphere, i);
        else attach(match(*shapes[i], [&](const auto &s) { return make_geometry(device_.get(), s); }), i);
    }
    if (!spheres_.balls.empty()) attach(make_geometry(device_.get(), spheres_), last);
}

void EmbreeScene::attach(const Instance &instance, RTCScene group, std::uint32_t id) {
    RTCGeometry geometry = rtcNewGeometry(device_.get(), RTC_GEOMETRY_TYPE_INSTANCE);
    rtcSetGeometryInstancedScene(geometry, group);
    rtcSetGeometryTimeStepCount(geometry, 1);
    rtcSetGeometryTransform(geometry, 0, RTC_FORMAT_FLOAT3X4_ROW_MAJOR, instance.to_world.m.data());
    attach(geometry, id);
}

void EmbreeScene::attach(RTCGeometry geometry, std::uint32_t id) {
    rtcCommitGeometry(geometry);
    rtcAttachGeometryByID(scene_, geometry, id);
    rtcReleaseGeometry(geometry);
}

} // namespace lajolla
