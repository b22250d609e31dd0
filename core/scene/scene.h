#pragma once
// The scene: immutable after building, flat arrays and 32-bit ids. How it is to be rendered is not part of
// it.

#include <array>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "accel/accel.h"
#include "base/shared_vector.h"
#include "geometry/compositing.h"
#include "geometry/instance.h"
#include "geometry/shapes.h"
#include "lights/lights.h"
#include "materials/material.h"
#include "materials/surface.h"
#include "media/medium.h"
#include "scatter/bsdfs.h"
#include "sensors/camera.h"
#include "sensors/film.h"
#include "textures/textures.h"

namespace lajolla {

// The ids that a shape refers to; -1 for none.
struct ShapeSlot {
    std::int32_t material = -1, emitter = -1, interior = -1, exterior = -1;
};

struct SceneParts {
    SharedVector<TextureModel> textures;
    SharedVector<Bsdf> bsdfs;
    SharedVector<Adapter> adapters;
    SharedVector<Material> materials;
    SharedVector<Light> lights;
    SharedVector<std::int32_t> light_groups; // of each light, from 1; 0 for none
    SharedVector<Shape> shapes;
    SharedVector<ShapeSlot> slots;         // one per shape
    SharedVector<Compositing> compositing; // one per shape
    SharedVector<Group> groups;
    SharedVector<Instance> instances;
    std::shared_ptr<const Media> media = std::make_shared<const Media>();
    Camera camera;
    std::int32_t camera_medium = -1; // -1 for none
    Film film;
    PixelFilter filter;
    std::optional<bool> robust;     // ray queries: see Accel
    std::array<double, 3> origin{}; // the origin of these coordinates in the world
};

// The bounds of all shapes outside of groups, and of the instances.
Bounds bounds_of(const SceneParts &parts);

// A surface whose lobe is of any model.
using AnySurface = Surface<float, Lobe>;

// Pointers to the arrays of a mesh.
struct MeshArrays {
    const Triangle *triangles = nullptr; // null: the shape is not a mesh
    const Vec3f *positions = nullptr, *normals = nullptr;
    const Vec2f *uvs = nullptr;
    bool flip_normals = false;
};

class Scene {
public:
    // Models are built already; ids are in range. With the scene that the parts were copied from before they
    // were edited, tables of what was not edited are shared with it; a shape must not become a light then, or
    // stop being one. Throws std::invalid_argument for what does not fit together.
    explicit Scene(SceneParts parts, const Scene *before = nullptr);
    Scene(const Scene &) = delete;
    Scene &operator=(const Scene &) = delete;

    const Accel &accel() const { return *accel_; }
    const LightPicker &lights() const { return *picker_; }
    // The light group of a light; 0 for lights without one, and for -1, the emission of media.
    std::int32_t light_group(std::int32_t light) const {
        return light < 0 ? 0 : parts_.light_groups[static_cast<std::size_t>(light)];
    }
    std::size_t light_group_count() const; // with 0
    const Media &media() const { return *parts_.media; }
    std::int32_t camera_medium() const { return parts_.camera_medium; }
    const Film &film() const { return parts_.film; }
    const FilterSampler &filter() const { return filter_; }
    const SceneParts &parts() const { return parts_; }

    template <class Float>
    CameraRay<Float> camera_ray(const Vec2<Float> &film, const Vec2<Float> &lens) const {
        return match(parts_.camera, [&](const auto &camera) { return camera.generate(film, lens); });
    }
    // The differentials of a camera ray by the positions of pixels.
    template <class Float>
    RayDifferentials<Float> camera_differentials(const Vec2<Float> &film, const Vec2<Float> &lens) const {
        return match(parts_.camera, [&](const auto &camera) { return camera.differentials(film, lens); });
    }

    // Whether the camera sees any shape as anything but an object.
    bool has_camera_roles() const { return has_camera_roles_; }
    // What a camera ray sees in a shape; lights are nothing to integrators that hide them.
    CameraRole camera_role(std::int32_t shape, std::int32_t instance, bool hide_emitters) const {
        const auto index = static_cast<std::size_t>(shape);
        if (hide_emitters && parts_.slots[index].emitter >= 0) return CameraRole::nothing;
        if (!has_camera_roles_) return CameraRole::object;
        const CameraRole own = parts_.compositing[index].role();
        return instance < 0 ? own
                            : std::max(own, parts_.instances[static_cast<std::size_t>(instance)].role());
    }

    bool has_catchers() const { return has_catchers_; }
    // Whether a surface belongs to the place of the photograph that catchers stand for: catchers and lights,
    // if they are not black.
    bool is_in_photograph(const Hit<float> &hit) const {
        if (camera_role(hit.shape, hit.instance, false) == CameraRole::catcher) return true;
        if (hit.emitter < 0) return false;
        const auto *light = std::get_if<AreaLight>(&parts_.lights[static_cast<std::size_t>(hit.emitter)]);
        return light && !(light->radiance.is_constant() && is_black(light->radiance.constant));
    }

    // Everything about a hit that the ray tracer found, but for its footprint.
    Hit<float> hit(const Ray<float> &ray, const RayHit &found, const HitNeeds &needs = {}) const;
    // The same with its footprint, from that of the ray.
    Hit<float> hit(const Ray<float> &ray, const RayHit &found, const Footprint<float> &footprint,
                   const HitNeeds &needs) const;
    // The same for several rays. Inactive lanes contain valid ids of other hits, and undefined numbers.
    Hit<WideFloat> hit(const Ray<WideFloat> &rays, const RayHits &found, WideBool active,
                       const Footprint<WideFloat> &footprints, const HitNeeds &needs) const;
    // The properties of hits that scattering needs in this scene.
    const HitNeeds &needs() const { return needs_; }

    // The lobe at a hit, seen from `wo` (world space), for a path that does not pass straight through. In a
    // blend, the uniform number u selects it.
    AnySurface surface(const Hit<float> &hit, const Vec3f &wo, float u) const;

    // In a small blend, calls f(surface, share) for each lobe that surface() may select, with its
    // probability; else f(chosen, 1). Sampling lights for each lobe removes the noise of the selection from
    // direct light.
    template <class F>
    void for_each_surface(const Hit<float> &hit, const Vec3f &wo, const AnySurface &chosen, F &&f) const {
        if (!has_blends_) return f(chosen, 1.0f);
        const Side seen = side(hit, wo);
        if (!materials_->is_small_blend(seen.root)) return f(chosen, 1.0f);
        materials_->for_each_leaf(seen.root, unfiltered_reader(hit), hit, wo, seen.normal, 1.0f,
                                  [&](std::int32_t bsdf, const MappedNormal<float> &normal, float share) {
                                      f(surface({bsdf, seen.turned, normal}, hit, wo), share);
                                  });
    }

    // The diffuse colour at a hit, if it is a parameter of the material. Of a blend as surface().
    std::optional<Spectrum> diffuse_colour(const Hit<float> &hit, const Vec3f &wo, float u) const;
    // The same; of other materials pi times their value between `wo` and the normal, which is that of a
    // diffuse surface as bright.
    Spectrum albedo(const Hit<float> &hit, const Vec3f &wo, float u) const;
    // The shading normal as the material's maps turn it.
    Vec3f mapped_normal(const Hit<float> &hit, const Vec3f &wo, float u) const;

    // The light that passes straight through a hit, seen from `wo`: 1 - opacity, all of it at a `null`
    // surface, and what thin glass does not reflect.
    NullTransmission<float> null_transmission(const Hit<float> &hit, const Vec3f &wo) const;
    // Whether any surface lets light pass, so that shadow rays must look at what they meet.
    bool has_null_transmission() const { return materials_->has_null_transmission(); }

    // Whether any texture depends on the size of what a pixel sees.
    bool reads_footprints() const { return reads_footprints_; }

    // The bitmap that the front BSDF of a hit's material reads first, if any.
    const Bitmap *first_bitmap(const Hit<float> &hit) const;

    // World coordinates of a point, also as float32, which far from the origin says little; and back.
    std::array<double, 3> world_position(const Vec3f &p) const;
    Vec3f in_world(const Vec3f &p) const;
    Vec3f from_world(const std::array<double, 3> &p) const;
    Vec3f from_world(const Vec3f &p) const { return from_world(std::array<double, 3>{p.x, p.y, p.z}); }
    Vec3f camera_space(Vec3f p) const { return to_camera_.point(p); }
    const BoundingSphere &bounding_sphere() const { return bounding_sphere_; } // of all shapes

    std::size_t bytes() const;

    // Textures at a hit: over its footprint, seen from `wo`; or at a point, alike for all rays.
    template <class Float>
    TextureReader<Float> filtered_reader(const Hit<Float> &hit, const Vec3<Float> &wo) const {
        return {parts_.textures, {hit.uv, &hit, parts_.shapes.data(), wo, true}};
    }
    template <class Float>
    TextureReader<Float> unfiltered_reader(const Hit<Float> &hit) const {
        return {parts_.textures, {hit.uv, &hit, parts_.shapes.data(), Vec3<Float>(0), false}};
    }
    // For the parameters of a BSDF. Whether light passes straight through is decided with what a point has,
    // and the rest of that BSDF has to go with it.
    template <class Float>
    TextureReader<Float> bsdf_reader(const BsdfTraits &traits, const Hit<Float> &hit,
                                     const Vec3<Float> &wo) const {
        return traits.null_transmission ? unfiltered_reader(hit) : filtered_reader(hit, wo);
    }
    const Materials &materials() const { return *materials_; }

    // The plain BSDFs of a material's two sides, -1 for black: nothing where there are adapters, or where
    // light passes straight through.
    struct PlainMaterial {
        std::int32_t front = -1, back = -1;
    };
    std::optional<PlainMaterial> plain_material(std::int32_t material) const;
    const BsdfTraits &traits_of(std::int32_t bsdf) const {
        return bsdf_traits_[static_cast<std::size_t>(bsdf)];
    }
    // Scenes write alpha = 0.0001 for a mirror. A lobe below this roughness is narrower than any light that
    // has an area, so that samples of lights would only cost time; lights without area need them still.
    float least_roughness() const { return picker_->has_delta_lights() ? 0 : 5e-4f; }

private:
    // The BSDF at a hit, -1 for black; whether it is that of the back, and the normal then looks there.
    struct Choice {
        std::int32_t bsdf;
        bool turned;
        MappedNormal<float> normal;
    };
    Choice choose(const Hit<float> &hit, const Vec3f &wo, float u) const;
    AnySurface surface(const Choice &choice, const Hit<float> &hit, const Vec3f &wo) const;
    // Which of a material's sides is seen, and the normal before maps turn it.
    struct Side {
        MaterialId root;
        bool turned;
        MappedNormal<float> normal;
    };
    Side side(const Hit<float> &hit, const Vec3f &wo) const;
    const MeshArrays &mesh_of(std::int32_t shape) const { return meshes_[static_cast<std::size_t>(shape)]; }
    void fill_in_instance(const Ray<float> &ray, const RayHit &found, const HitNeeds &needs,
                          Hit<float> &hit) const;
    void fill_triangles(const RayHits &hits, WideBool filled, const HitNeeds &needs,
                        Hit<WideFloat> &result) const;
    void connect_lights(bool prepare_shapes);
    void describe_looks();

    SceneParts parts_;
    SharedVector<BsdfTraits> bsdf_traits_;
    SharedVector<MeshArrays> meshes_; // of each shape that is a mesh
    HitNeeds needs_;
    std::shared_ptr<const Materials> materials_;
    std::shared_ptr<const Accel> accel_;
    std::shared_ptr<const LightPicker> picker_;
    FilterSampler filter_;
    bool reads_footprints_ = false, has_blends_ = false, has_camera_roles_ = false, has_catchers_ = false;
    Transform to_camera_;
    BoundingSphere bounding_sphere_;
};

} // namespace lajolla
