#pragma once
// The scene: immutable after building, flat arrays and 32-bit ids. How it is to be rendered is not part of
// it.

#include <memory>
#include <optional>
#include <vector>

#include "scatter/bsdfs.h"
#include "scene/accel.h"
#include "scene/camera.h"
#include "scene/film.h"
#include "scene/instance.h"
#include "scene/lights.h"
#include "scene/medium.h"
#include "scene/shapes.h"
#include "scene/textures.h"

namespace lajolla {

// The material slot of a shape. Two-sidedness and opacity are fields, not BSDFs around BSDFs.
struct Material {
    std::int32_t front = -1;   // a BSDF; light-transmitting ones serve both sides
    std::int32_t back = -1;    // a BSDF seen from behind, as if the surface were turned over; -1: black
    Texture<float> opacity{1}; // the rest passes straight through
};

// What a shape refers to; -1 for none.
struct ShapeSlot {
    std::int32_t material = -1, emitter = -1, interior = -1, exterior = -1;
};

struct SceneParts {
    std::vector<TextureModel> textures;
    std::vector<Bsdf> bsdfs;
    std::vector<Material> materials;
    std::vector<Light> lights;
    std::vector<Shape> shapes;
    std::vector<ShapeSlot> slots; // one per shape
    std::vector<Group> groups;
    std::vector<Instance> instances;
    Media media;
    Camera camera;
    std::int32_t camera_medium = -1; // -1 for none
    Film film;
    PixelFilter filter;
};

// A surface point made ready to scatter: the lobe and the frame it lives in.
struct Surface {
    bool black; // nothing is scattered: the rest is meaningless
    bool sharp; // sampling lights is of no use: only sampling the lobe finds where it scatters
    Frame frame;
    Vec3f wo; // local
    Lobe lobe;
};

class Scene {
public:
    // Models are built already; ids are in range. Throws std::invalid_argument for what does not fit
    // together.
    explicit Scene(SceneParts parts);
    Scene(const Scene &) = delete;
    Scene &operator=(const Scene &) = delete;

    const Accel &accel() const { return *accel_; }
    const LightPicker &lights() const { return picker_; }
    const Media &media() const { return parts_.media; }
    std::int32_t camera_medium() const { return parts_.camera_medium; }
    const Film &film() const { return parts_.film; }
    const FilterSampler &filter() const { return filter_; }
    const SceneParts &parts() const { return parts_; }

    CameraRay camera_ray(Vec2f film, Vec2f lens) const {
        return match(parts_.camera, [&](const auto &camera) { return camera.generate(film, lens); });
    }

    // Everything about a hit that the ray tracer found.
    Hit hit(const Ray &ray, const RayHit &found, const RayCone &cone) const;

    // The lobe at a hit, seen from `wo` (world space).
    Surface surface(const Hit &hit, const Vec3f &wo) const;

    // The fraction of light that passes straight through a hit: 1 - opacity, and all of it at a `null`
    // surface.
    float passage(const Hit &hit) const;
    // Whether any surface lets light pass, so that shadow rays must look at what they meet.
    bool has_passages() const { return has_passages_; }

    // Whether any texture depends on the size of what a pixel sees.
    bool reads_footprints() const { return reads_footprints_; }

    // The bitmap that the front BSDF of a hit's material reads first, if any.
    const Bitmap *first_bitmap(const Hit &hit) const;

    std::size_t bytes() const;

private:
    void fill_in_instance(const Ray &ray, const RayHit &found, Hit &hit) const;
    // Textures at a hit: over its footprint, seen from `wo`; or as sharp as they are, alike for all rays.
    TextureReader filtered_reader(const Hit &hit, const Vec3f &wo) const {
        return {parts_.textures, {hit.uv, &hit, &parts_.shapes[hit.shape], wo, true}};
    }
    TextureReader sharp_reader(const Hit &hit) const {
        return {parts_.textures, {hit.uv, &hit, &parts_.shapes[hit.shape], Vec3f(0), false}};
    }

    SceneParts parts_;
    struct BsdfTraits {
        bool transmissive, isotropic, delta;
    };
    std::vector<BsdfTraits> bsdf_traits_;
    std::optional<Accel> accel_;
    LightPicker picker_;
    FilterSampler filter_;
    bool has_passages_ = false, reads_footprints_ = false;
};

} // namespace lajolla
