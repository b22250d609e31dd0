#pragma once
// The scene: immutable after building, flat arrays and 32-bit ids. How it is to be rendered is not part of
// it.

#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "scatter/bsdfs.h"
#include "scene/accel.h"
#include "scene/camera.h"
#include "scene/film.h"
#include "scene/instance.h"
#include "scene/lights.h"
#include "scene/material.h"
#include "scene/medium.h"
#include "scene/shapes.h"
#include "scene/textures.h"

namespace lajolla {

// What a shape refers to; -1 for none.
struct ShapeSlot {
    std::int32_t material = -1, emitter = -1, interior = -1, exterior = -1;
};

struct SceneParts {
    std::vector<TextureModel> textures;
    std::vector<Bsdf> bsdfs;
    std::vector<Adapter> adapters;
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

// How a shading normal differs from the geometric one. Directions are in the shading frame.
struct Bend {
    bool bent = false; // else the rest is meaningless
    float bump = 0;    // tangent^2 of the angle by which maps turned the normal, where that casts shadows
    Vec3f normal{0};   // geometric
    Vec3f smooth{0};   // before maps turned it

    // How much of the light that is scattered between wo and wi there is: none that is reflected into the
    // solid, and less where bumps stand in its way.
    float visible(Vec3f wo, Vec3f wi) const {
        if (wi.z * wo.z > 0 && dot(normal, wi) * dot(normal, wo) <= 0) return 0;
        return bump == 0 ? 1 : bump_shadowing(bump, tangent_squared(dot(smooth, wi)));
    }
};

// A surface point made ready to scatter: the lobe and the frame it lives in. It is made in one go, as copying
// it would cost more than what is in it.
struct Surface {
    bool black = true;  // nothing is scattered: the rest is meaningless
    bool sharp = false; // sampling lights is of no use: only sampling the lobe finds where it scatters
    float stopped = 1;  // the probability of not passing straight through
    Frame frame;
    Vec3f wo{0}; // local
    Lobe lobe;
    Bend bend;

    Surface() = default;
    // Lobes of less than this roughness are sharp, too.
    Surface(const Bsdf &bsdf, const auto &read, bool delta, bool lets_pass, float sharpest,
            const Frame &frame, const Vec3f &wo, const Bend &bend)
        : black(false), frame(frame), wo(frame.to_local(wo)), lobe(prepare(bsdf, read)), bend(bend) {
        sharp = delta || roughness(lobe) < sharpest;
        if (lets_pass) stopped = 1 - passage(lobe, this->wo).probability;
    }
};

// The same as of lobes, along directions in world space. What passes straight through is left out: paths
// have not.
inline BsdfEval eval(const Surface &surface, const Vec3f &direction) {
    const Vec3f wi = surface.frame.to_local(direction);
    if (!surface.bend.bent) return eval(surface.lobe, surface.wo, wi);
    const float visible = surface.bend.visible(surface.wo, wi);
    if (visible == 0) return {};
    BsdfEval result = eval(surface.lobe, surface.wo, wi);
    result.f_cos *= visible;
    return result;
}
inline std::optional<BsdfSample> sample(const Surface &surface, float u_lobe, const Vec2f &u) {
    auto result = sample(surface.lobe, surface.wo, u_lobe * surface.stopped, u);
    if (!result) return result;
    if (surface.bend.bent) {
        const float visible = surface.bend.visible(surface.wo, result->wi);
        result->weight *= visible;
        if (visible == 0) {
            result.reset();
            return result;
        }
    }
    result->wi = surface.frame.to_world(result->wi);
    return result;
}

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

    // The lobe at a hit, seen from `wo` (world space), of a path that does not pass straight through. Of a
    // blend it is one, chosen by the uniform number u.
    Surface surface(const Hit &hit, const Vec3f &wo, float u) const;

    // f(surface, share) for what surface() may choose, with its probability, where that is a small blend;
    // else f(chosen, 1). Sampling lights for each of them takes the noise of choosing out of direct light.
    template <class F>
    void for_each_surface(const Hit &hit, const Vec3f &wo, const Surface &chosen, F &&f) const {
        if (!has_blends_) return f(chosen, 1.0f);
        const Side seen = side(hit, wo);
        if (!materials_.is_small_blend(seen.root)) return f(chosen, 1.0f);
        const SmallBlend leaves = materials_.leaves(seen.root, sharp_reader(hit), hit, wo, seen.normal);
        for (const auto &leaf : std::span(leaves.leaf).first(static_cast<std::size_t>(leaves.count)))
            f(surface({leaf.bsdf, seen.turned, leaf.normal}, hit, wo), leaf.share);
    }

    // The diffuse colour at a hit: a parameter of materials that have one; of others pi times their value
    // between `wo` and the normal, which is that of a diffuse surface as bright. Of a blend as surface().
    Spectrum albedo(const Hit &hit, const Vec3f &wo, float u) const;
    // The shading normal as the material's maps turn it.
    Vec3f mapped_normal(const Hit &hit, const Vec3f &wo, float u) const;

    // The light that passes straight through a hit, seen from `wo`: 1 - opacity, all of it at a `null`
    // surface, and what a pane of thin glass does not reflect.
    Passage passage(const Hit &hit, const Vec3f &wo) const;
    // Whether any surface lets light pass, so that shadow rays must look at what they meet.
    bool has_passages() const { return materials_.has_passages(); }

    // Whether any texture depends on the size of what a pixel sees.
    bool reads_footprints() const { return reads_footprints_; }

    // The bitmap that the front BSDF of a hit's material reads first, if any.
    const Bitmap *first_bitmap(const Hit &hit) const;

    Vec3f camera_space(Vec3f p) const { return to_camera_.point(p); }
    const BoundingSphere &bounding_sphere() const { return bounding_sphere_; } // of all shapes

    std::size_t bytes() const;

private:
    // The BSDF at a hit, -1 for black; whether it is that of the back, and the normal then looks there.
    struct Choice {
        std::int32_t bsdf;
        bool turned;
        MappedNormal normal;
    };
    Choice choose(const Hit &hit, const Vec3f &wo, float u) const;
    Surface surface(const Choice &choice, const Hit &hit, const Vec3f &wo) const;
    // Which of a material's sides is seen, and the normal before maps turn it.
    struct Side {
        MaterialId root;
        bool turned;
        MappedNormal normal;
    };
    Side side(const Hit &hit, const Vec3f &wo) const;
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
        bool transmissive, isotropic, delta, lambertian, lets_pass;
    };
    std::vector<BsdfTraits> bsdf_traits_;
    Materials materials_;
    std::optional<Accel> accel_;
    LightPicker picker_;
    FilterSampler filter_;
    bool reads_footprints_ = false, has_blends_ = false;
    Transform to_camera_;
    BoundingSphere bounding_sphere_;
};

} // namespace lajolla
