#pragma once
// What a pixel covers around a ray and at its hit: textures are filtered over it.

#include <optional>

#include "base/vec.h"

namespace lajolla {

// The footprint of a pixel's beam, followed as a cone (Akenine-Möller et al. 2021, "Improved Shader and
// Texture Level of Detail Using Ray Cones").
template <class Float>
struct RayCone {
    Float radius = 0; // at the ray's origin
    Float spread = 0; // growth of the radius per unit of distance

    RayCone at(Float distance) const { return {abs(radius + spread * distance), spread}; }

    // The cone after reflection or refraction by a surface of this curvature; width and eta as in BsdfSample.
    // A diffuse surface widens the cone to about 0.2 radians.
    static constexpr float diffuse_spread = 0.2f;
    RayCone scattered(Float mean_curvature, Float width, Float eta) const {
        const Float turned = 2 * mean_curvature * radius;
        const Float mirror =
            select(eta == 1.0f, spread + turned, spread / eta + turned * (1 / eta - 1) * 0.5f);
        return {radius, lerp(width, mirror, Float(diffuse_spread))};
    }

    // A cone widened by a rough surface is blurred in all directions: the shape of its footprint has no
    // visible effect.
    static constexpr float blurred_spread = 0.05f;
    BoolOf<Float> is_blurred() const { return !(spread < blurred_spread); }
};

// The cosine of a ray's angle to the normal below which its footprint does not become longer: no filter uses
// more than a thousand times its width.
template <class Float>
Float bounded_cosine(Float cosine) {
    return copysign(max(abs(cosine), Float(1e-3f)), cosine);
}

// How a ray changes from one pixel to the next, along x and along y of the film (Igehy 1999, "Tracing Ray
// Differentials").
template <class Float>
struct RayDifferentials {
    Vec3<Float> origin_dx, origin_dy, direction_dx, direction_dy;
    // Otherwise the rest is undefined: the cone takes its place.
    BoolOf<Float> followed = true;

    // Those at a hit: of its position on the tangent plane, and of the direction of the ray that arrives.
    RayDifferentials at(const Vec3<Float> &direction, Float distance, const Vec3<Float> &normal) const {
        const Float inverse = 1 / bounded_cosine(dot(direction, normal));
        const auto meets = [&](const Vec3<Float> &origin_change, const Vec3<Float> &change) {
            const Vec3<Float> moved = origin_change + change * distance;
            return moved - direction * (dot(moved, normal) * inverse);
        };
        return {meets(origin_dx, direction_dx), meets(origin_dy, direction_dy), direction_dx, direction_dy,
                followed};
    }
};

// The cone of a ray, and its differentials if any lane follows them.
template <class Float>
struct Footprint {
    RayCone<Float> cone;
    std::optional<RayDifferentials<Float>> differentials;

    // Moves that of a ray to its hit.
    void move(const Footprint &from, const Vec3<Float> &direction, Float distance,
              const Vec3<Float> &normal) {
        cone = from.cone.at(distance);
        if (from.differentials) differentials = from.differentials->at(direction, distance, normal);
    }
};

} // namespace lajolla
