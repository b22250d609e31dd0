#pragma once
// Emitting shapes. Points are sampled by area; their density is converted to solid angle, like all densities
// of lights: pdf_solid_angle = pdf_area * distance^2 / cosine. Spheres are sampled by the cone they subtend.

#include <span>
#include <tuple>

#include "base/distribution.h"
#include "base/fields.h"
#include "base/frame.h"
#include "base/texture.h"
#include "base/warp.h"
#include "geometry/hit.h"
#include "geometry/shapes.h"
#include "lights/direct_sample.h"
#include "textures/textures.h"

namespace lajolla {

struct AreaLight {
    static constexpr const char *name = "area";
    static constexpr const char *doc =
        "A shape that shines from its front side, equally bright in all directions.";
    Texture<Spectrum> radiance{Spectrum(1)};
    const Shape *shape = nullptr; // set by the scene

    static constexpr auto fields() {
        return std::tuple(
            field("radiance", &AreaLight::radiance, "emitted radiance").range(0).unit("W/(m^2 sr)"));
    }
    // Called when the shape is set.
    void prepare_sampling(std::span<const TextureModel> textures);
    float area() const;
    float power(std::span<const TextureModel> textures, const BoundingSphere &) const;
    DirectSample<float> sample_direct(const Vec3f &p, float u_primitive, Vec2f u,
                                      std::span<const TextureModel> textures) const;
    float pdf_hit(const Vec3f &p, const Hit<float> &hit,
                  const Vec3f &wi) const; // density of sampling this hit from p
    Spectrum emitted(const Hit<float> &hit, const Vec3f &wo, std::span<const TextureModel> textures) const;

private:
    Spectrum radiance_at(const SurfaceSample &point, std::span<const TextureModel> textures) const;
    Spectrum read_radiance(Hit<float> hit, std::span<const TextureModel> textures) const;
    float mean_luminance(std::span<const TextureModel> textures) const;

    Distribution2D table_; // of textured rectangles, over texture space
};

// The direction from p to a point of a light that is sampled with this density per area, and the density per
// solid angle, which is zero if the light faces away.
template <class Float>
DirectSample<Float> sample_towards(const Vec3<Float> &p, const Vec3<Float> &position,
                                   const Vec3<Float> &normal, Float position_error, Float area_pdf) {
    const Vec3<Float> to_light = position - p;
    const Float squared = length_squared(to_light), distance = sqrt(squared);
    const Vec3<Float> wi = to_light / distance;
    const Float cosine = -dot(wi, normal);
    const Vec3<Float> target = position + normal * copysign(position_error, cosine);
    // Conversion from area to solid angle.
    const Float pdf = select(cosine > 0.0f, area_pdf * squared / cosine, Float(0));
    return {wi, distance, target, Rgb<Float>(0), pdf};
}
// The same density for a point that was not sampled by this.
template <class Float>
Float solid_angle_pdf(const Vec3<Float> &p, const Vec3<Float> &position, const Vec3<Float> &normal,
                      const Vec3<Float> &wi, Float area_pdf) {
    const Float cosine = abs(dot(wi, normal));
    return select(cosine > 0.0f, area_pdf * length_squared(position - p) / cosine, Float(0));
}

// The cone that a sphere subtends at a point outside (Shirley, Wang and Zimmerman 1996). Its height 1 - cos
// is computed from the sine, because the cosine of a distant sphere rounds to one.
template <class Float>
struct SphereCone {
    BoolOf<Float> exists = false; // not inside, nor so near that it is a half-space
    Vec3<Float> axis;
    Float distance, height;
};
template <class Float>
SphereCone<Float> cone_towards(const Vec3<Float> &center, Float radius, const Vec3<Float> &p) {
    const Vec3<Float> to_center = center - p;
    const Float squared = length_squared(to_center), sin_squared = sqr(radius) / squared;
    const Float distance = sqrt(squared);
    return {sin_squared < 1 - 1e-5f, to_center / distance, distance,
            sin_squared / (1 + safe_sqrt(1 - sin_squared))};
}

// A sampled point on a sphere, as a direction from its centre: uniform in the cone, or on the whole sphere if
// there is no cone.
template <class Float>
Vec3<Float> sample_seen_side(const SphereCone<Float> &cone, Float radius, const Vec2<Float> &u) {
    const Vec3<Float> local = sample_cone(u, cone.height);
    // The triangle of the viewer, the sphere's centre and the near intersection, whose angle at the viewer is
    // theta: `along` from the viewer by the roots' product, which does not cancel near the surface, then the
    // angle alpha at the centre by the law of sines.
    const Float r = radius, d = cone.distance, cos_theta = local.z;
    const Float sin_theta_squared = sqr(local.x) + sqr(local.y);
    const Float along = (d - r) * (d + r) / (d * cos_theta + safe_sqrt(sqr(r) - sqr(d) * sin_theta_squared));
    const Float sin_ratio = along / r, cos_alpha = (d - along * cos_theta) / r;
    const Frame<Float> frame = frame_around(-cone.axis);
    const Vec3<Float> in_cone =
        normalize(frame.to_world({sin_ratio * local.x, sin_ratio * local.y, cos_alpha}));
    return all(cone.exists) ? in_cone : select(cone.exists, in_cone, sample_sphere(u));
}

} // namespace lajolla
