#pragma once
// The list of lights. All densities are per solid angle: a light is sampled from a point, and returns
// the density of sampling a direction; integrators do not depend on the kind of light.

#include <algorithm>
#include <span>
#include <variant>
#include <vector>

#include "base/distribution.h"
#include "base/match.h"
#include "geometry/hit.h"
#include "lights/area_light.h"
#include "lights/direct_sample.h"
#include "lights/environments.h"
#include "lights/point_lights.h"

namespace lajolla {

using Light = std::variant<AreaLight, ConstantLight, EnvironmentMap, DistantDisk, PointLight,
                           DirectionalLight, SpotLight, Projector>;

// Lights that have no area and subtend no solid angle.
template <class T>
concept IsDeltaLight = std::is_same_v<T, PointLight> || std::is_same_v<T, DirectionalLight> ||
                       std::is_same_v<T, SpotLight> || std::is_same_v<T, Projector>;

// How a light is sampled in lanes, which may have selected different lights.
enum class LightKind : std::int32_t {
    triangles, // with constant radiance, like the next two
    parallelogram,
    sphere,
    around,   // environment light
    textured, // evaluated by the light itself, one lane at a time: shapes with textured radiance
    other,    // other shapes, and lights that no ray can hit, likewise
};

// The data of a light for lanes, in one cache line.
template <class Float>
struct alignas(64) LightRecord {
    Rgb<Float> radiance;                // of shapes without a texture
    IntOf<Float> kind;                  // a LightKind
    Vec3<Float> center;                 // of a sphere
    Float radius = 0;                   // the same
    Float position_error = 0, side = 1; // the same; side is -1 if it emits inwards
    Float probability = 0;              // of selecting the light
    Float area_pdf = 0;                 // of a point of its shape, per area, times `probability`
    Float primitive_count = 1;          // of triangles or a parallelogram
    IntOf<Float> first_primitive = 0;   // in the list of all lights' primitives
    IntOf<Float> first_sum = 0;         // of the primitives' areas
    IntOf<Float> unused = 0;

    BoolOf<Float> is(LightKind k) const { return kind == static_cast<std::int32_t>(k); }
};

// An emitting triangle or parallelogram, also in one cache line.
template <class Float>
struct alignas(64) LightPrimitive {
    Vec3<Float> corner;
    Float position_error;
    Vec3<Float> edge1;
    Float unused1 = 0;
    Vec3<Float> edge2;
    Float unused2 = 0;
    Vec3<Float> normal; // on the emitting side
    Float unused3 = 0;
};

// All lights of a scene, selected by power and uniformly.
class LightPicker {
public:
    LightPicker() = default;
    LightPicker(std::span<const Light> lights, std::span<const TextureModel> textures,
                const BoundingSphere &scene);

    // No light has any power.
    bool empty() const { return !(picks_.sum() > 0); }
    // Whether there is an environment light.
    bool has_environment() const { return !environments_.empty(); }
    // Whether the camera sees any, or does not see some.
    bool shows_environment() const { return !shown_environments_.empty(); }
    bool hides_environments() const { return shown_environments_.size() < environments_.size(); }
    // Whether some light can only be sampled, because no ray can hit it.
    bool has_delta_lights() const { return has_delta_lights_; }
    // `u_pick` selects the light and a part of it; densities include the probability of this selection.
    template <class Float>
    DirectSample<Float> sample_direct(const Vec3<Float> &p, Float u_pick, const Vec2<Float> &u) const;
    // The light that sample_direct() selects.
    template <class Float>
    IntOf<Float> picked(Float u_pick) const {
        return picks_.sample(u_pick).index;
    }
    // The first environment light, -1 if there is none. It stands for all of them.
    std::int32_t environment_light() const {
        return environments_.empty() ? -1 : static_cast<std::int32_t>(environments_.front());
    }
    // Calls f(light, share) for the lights whose radiance is that of a light in a direction: environment
    // lights are added up, and share it. If the radiance is that of a camera ray, they are those that the
    // camera sees.
    template <class F>
    void for_each_share(std::int32_t light, const Vec3f &direction, bool from_camera, F &&f) const {
        if (environments_.size() < 2 || std::ranges::find(environments_, light) == environments_.end())
            return f(light, Spectrum(1));
        const Spectrum sum = environment(direction, from_camera);
        for (const std::int32_t index : environments(from_camera)) f(index, share_of(index, direction, sum));
    }
    // Density of sampling a hit on a light, or a direction that leaves the scene, from p; 0 for hits on other
    // shapes.
    template <class Float>
    Float pdf_hit(const Vec3<Float> &p, const Hit<Float> &hit, const Vec3<Float> &wi) const;
    template <class Float>
    Float pdf_environment(const Vec3<Float> &wi) const;
    // Radiance along a ray from the light that it hits, or from the sum of environment lights.
    template <class Float>
    Rgb<Float> emitted(const Hit<Float> &hit, const Vec3<Float> &wo) const;
    template <class Float>
    Rgb<Float> environment(const Vec3<Float> &direction, bool from_camera = false) const;

private:
    const std::vector<std::int32_t> &environments(bool from_camera) const {
        return from_camera ? shown_environments_ : environments_;
    }
    Spectrum share_of(std::int32_t environment, const Vec3f &direction, const Spectrum &sum) const;
    void add_record(const AreaLight &light, LightRecord<float> &record);
    template <class Float>
    DirectSample<Float> sample_primitive(const LightRecord<Float> &light, const Vec3<Float> &p,
                                         Float u_primitive, const Vec2<Float> &u) const;

    std::span<const Light> lights_;
    std::span<const TextureModel> textures_;
    std::vector<std::int32_t> environments_, shown_environments_; // all, and those that the camera sees
    bool has_delta_lights_ = false;
    Distribution picks_;
    std::vector<LightRecord<float>> records_; // one for each light
    std::vector<LightPrimitive<float>> primitives_;
    CumulativeSums areas_; // of each mesh's triangles; at first, for lights of one primitive, a single 1
};

} // namespace lajolla
