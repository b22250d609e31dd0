#pragma once
// Participating media: distance sampling along paths, and transmittance along shadow rays. docs/media.md
// derives the estimators with the same names.

#include <optional>
#include <utility>

#include "base/sampler.h"
#include "scene/scene.h"

namespace lajolla {

// Flights and shadow rays with more collisions are black, in case one voxel is a million times as dense as
// the rest of its cell of the majorant grid.
inline constexpr int max_collisions = 1 << 16;

// A sampled distance on a straight segment in a medium (free-flight sampling).
struct Flight {
    std::optional<Vec3f> collision;    // position of the scattering event; none if the end is reached
    std::optional<Hit<float>> surface; // the end, if it is not the hit of the path's ray
    Spectrum weight{1};                // multiplies the light from there
    Spectrum emitted{0};               // radiance of the medium along the segment, weighted
    float pdf = 1;                     // density of reaching the end
};

// A position near a surface, with more precision than world coordinates: light enters a dense medium only a
// few ulps deep. Here the surface is a plane, and the medium is homogeneous.
class NearSurface {
public:
    // A path at a hit, on the side of `direction`.
    NearSurface(const Hit<float> &hit, const Vec3f &direction, const Vec3f &offset = Vec3f(0))
        : hit_(hit), inwards_(hit.normal * copysign(1.0f, dot(hit.normal, direction))), offset_(offset) {}

    const Hit<float> &hit() const { return hit_; }
    void move(const Vec3f &step) { offset_ += step; }
    bool reaches(float distance) const { return distance < radius(); }
    float depth() const { return max(dot(offset_, inwards_), 0.0f); }

    // The point at which the medium is evaluated and rays start: as far away as rays that leave the surface.
    Vec3f inside() const { return hit_.position + inwards_ * hit_.position_error; }
    Vec3f position() const { return hit_.position + offset_ + inwards_ * lift(); }

    // The distance along a direction for which this approximation holds, and whether the surface is reached
    // there. Another surface is met at `far`.
    struct Way {
        float length;
        bool meets_surface;
    };
    Way way(const Vec3f &direction, float far = infinity) const {
        const float along = dot(offset_, direction);
        const float to_rim = safe_sqrt(sqr(along) + sqr(radius()) - length_squared(offset_)) - along;
        const float to_surface = depth() / -dot(inwards_, direction);
        // Rays often find this surface itself, at a distance with less precision.
        const bool meets =
            dot(inwards_, direction) < 0 && to_surface <= min(to_rim, far + hit_.position_error);
        return {meets ? to_surface : min(max(to_rim, 0.0f), far), meets};
    }

    // A ray from position(), moved to start at the true position, with the same end.
    Ray<float> lowered(Ray<float> ray) const {
        const float cosine = dot(inwards_, ray.direction);
        constexpr float least_cosine = 1.0f / 32; // at grazing angles the start would be too far back
        ray.far = max(ray.far + lift() / copysign(max(abs(cosine), least_cosine), cosine), ray.near);
        ray.origin = hit_.position + offset_;
        return ray;
    }

private:
    float radius() const { return 8 * hit_.position_error; }
    float lift() const { return max(hit_.position_error - depth(), 0.0f); }

    Hit<float> hit_;
    Vec3f inwards_; // the normal on the path's side
    Vec3f offset_;  // relative to the hit
};

// No media: the loop is compiled with this for scenes without them.
struct Vacuum {
    static constexpr bool present = false;

    // The transmittance along a shadow ray.
    struct Transmittance {
        Spectrum weight{1};
        float path_pdf = 1; // the probability that a path reaches this point
        const Spectrum &value() const { return weight; }
        void pass(const NullTransmission<float> &through) {
            weight *= through.transmittance;
            path_pdf *= through.probability;
        }
    };

    Vacuum() = default;
    Vacuum(const Scene &, const CameraRay<float> &, const Sampler &, bool) {}
    void next_flight(const Sampler &, std::uint32_t) {}
    const Vacuum &for_shadow_ray(const Sampler &, std::uint32_t) const { return *this; }
    void cross(const Hit<float> &, const Vec3f &) {}
    void cross(const Hit<float> &, const Vec3f &, const Departure<float> &) {}
    Flight fly(const Scene &, const Ray<float> &, const std::optional<RayHit> &, float &) { return {}; }
    void attenuate(const Scene &, const Ray<float> &, Transmittance &) {}
    float path_pdf(const Transmittance &light) const { return light.path_pdf; }
};

// The state of a path in media. Distances are sampled by the extinction of one channel. Any of the three
// could have been selected, so the estimate is weighted by the balance heuristic over them (Miller et al.
// 2019, "A null-scattering path integral formulation of light transport").
class InMedia {
public:
    static constexpr bool present = true;

    // The transmittance along a shadow ray.
    struct Transmittance {
        Spectrum weight{1};
        Spectrum path_pdf{1}; // density of a path reaching this point, for each channel: see Flight::pdf
        float survival = 1;   // the probability that the ray was followed to its end

        Spectrum value() const { return weight / survival; }
        void pass(const NullTransmission<float> &through) {
            weight *= through.transmittance;
            path_pdf *= through.probability;
        }
    };

    InMedia(const Scene &scene, const CameraRay<float> &camera, const Sampler &sampler, bool scatters)
        : current(scene.camera_medium()), scatters_(scatters),
          channel_(std::min(static_cast<std::size_t>(camera.u_channel * 3), std::size_t(2))),
          numbers_(sampler.stream(0)) {}

    std::int32_t current; // the medium that the ray is in, -1 for none

    // Starts the random numbers of the flight from a vertex, and of the shadow ray from there.
    void next_flight(const Sampler &sampler, std::uint32_t vertex) { numbers_ = sampler.stream(2 * vertex); }
    InMedia for_shadow_ray(const Sampler &sampler, std::uint32_t vertex) const {
        InMedia result = *this;
        result.numbers_ = sampler.stream(2 * vertex + 1);
        return result;
    }

    // The surface determines the medium of a ray that leaves it.
    void cross(const Hit<float> &hit, const Vec3f &direction) {
        if (hit.interior >= 0 || hit.exterior >= 0)
            current = dot(hit.normal, direction) > 0 ? hit.exterior : hit.interior;
        if (current >= 0) near_.emplace(hit, direction);
        else near_.reset();
    }
    // The same for a ray that is scattered there. On a smooth surface above the triangle, the medium begins
    // with the ray.
    void cross(const Hit<float> &hit, const Vec3f &direction, const Departure<float> &start) {
        if (start.vertex == hit.position) return cross(hit, direction);
        cross(hit, start.front ? hit.normal : -hit.normal);
        near_.reset();
    }

    // Samples a flight up to the hit of a path's ray. Consumes the uniform number `u`, and replaces it by one
    // that is independent of the flight.
    Flight fly(const Scene &scene, Ray<float> ray, const std::optional<RayHit> &found, float &u);

    // Multiplies the transmittance by that of the whole ray.
    void attenuate(const Scene &scene, const Ray<float> &ray, Transmittance &light);
    // The nearby surface that a shadow ray hits first, if any; multiplies the transmittance up to there.
    std::optional<Hit<float>> attenuate_to_surface(const Scene &scene, const Vec3f &direction,
                                                   Transmittance &light) const;
    // The density of a path reaching the light, averaged over the channels.
    float path_pdf(const Transmittance &light) const { return mean(density_ * light.path_pdf); }

private:
    // These add the next piece of a flight, on which the path collides when `thickness` is consumed, and
    // return the distance from the ray's origin to the collision, if any.
    std::optional<float> fly(const Coefficients &even, float length, float &thickness, Flight &flight);
    std::optional<float> fly(const Homogeneous &model, const Media &media, const Ray<float> &ray,
                             float thickness, Flight &flight, float &u);
    std::optional<float> fly(const Heterogeneous &model, const Media &media, const Ray<float> &ray,
                             float thickness, Flight &flight, float &u);
    void attenuate(const Coefficients &even, float length, Transmittance &light) const;
    void attenuate(const Homogeneous &model, const Media &media, const Ray<float> &ray, Transmittance &light);
    void attenuate(const Heterogeneous &model, const Media &media, const Ray<float> &ray,
                   Transmittance &light);

    Coefficients coefficients(const Media &media, const Vec3f &position, const Vec3f &direction) const {
        Coefficients result = media.coefficients(current, position, direction);
        if (!scatters_) result.sigma_s = Spectrum(0);
        return result;
    }

    // The path collides at a distance before what its ray found, and continues near that if nothing else is
    // nearer.
    void approach(const Scene &scene, const Ray<float> &ray, const RayHit &found, float remaining);

    float draw(float &u) { return std::exchange(u, numbers_.next()); }
    float event(const Spectrum &f, const Spectrum &p, Spectrum &weight);

    bool scatters_;       // otherwise media absorb and emit only
    std::size_t channel_; // the channel by which the whole path samples distances
    Spectrum density_{1}; // of the path so far, for each channel, divided by the mean of the three
    NumberStream numbers_;
    std::optional<NearSurface> near_; // where the path is, if it has just been at a surface
};

namespace detail {

inline Spectrum exp_minus(const Spectrum &sigma, float distance) {
    const auto one = [&](float s) { return s > 0 ? exp(-s * distance) : 1.0f; };
    return {one(sigma.x), one(sigma.y), one(sigma.z)};
}

// The integral of exp(-sigma s) over s from 0 to `distance`.
inline Spectrum mean_free_part(const Spectrum &sigma, float distance) {
    const auto one = [&](float s) { return s > 0 ? -expm1(-s * distance) / s : distance; };
    return {one(sigma.x), one(sigma.y), one(sigma.z)};
}

// The optical thickness until the next collision.
inline float sample_thickness(float u) { return -log1p(-u); }

} // namespace detail

// Multiplies the weight for an event with contribution f and probability (or density) p_c if channel c is
// selected: weight *= f / any. Returns any = mean(density p), its probability for an unknown channel.
inline float InMedia::event(const Spectrum &f, const Spectrum &p, Spectrum &weight) {
    density_ *= p;
    const float any = mean(density_);
    if (!(any > 0)) { // too improbable for a float
        weight = Spectrum(0);
        return 0;
    }
    density_ /= any;
    weight *= f / any;
    return any;
}

// In closed form. A medium that does not scatter has no collisions; its weight is exact.
inline std::optional<float> InMedia::fly(const Coefficients &even, float length, float &thickness,
                                         Flight &flight) {
    const Spectrum sigma_t = even.sigma_t();
    if (!is_black(even.emission))
        flight.emitted += flight.weight * even.emission * detail::mean_free_part(sigma_t, length);
    if (is_black(even.sigma_s)) {
        flight.weight *= detail::exp_minus(sigma_t, length);
        return std::nullopt;
    }
    const float distance = thickness / sigma_t[channel_];
    if (distance < length) {
        const Spectrum transmitted = detail::exp_minus(sigma_t, distance);
        event(transmitted * even.sigma_s, transmitted * sigma_t, flight.weight);
        return distance;
    }
    thickness = max(thickness - length * sigma_t[channel_], 0.0f);
    const Spectrum transmitted = detail::exp_minus(sigma_t, length);
    flight.pdf *= event(transmitted, transmitted, flight.weight);
    return std::nullopt;
}

inline std::optional<float> InMedia::fly(const Homogeneous &, const Media &media, const Ray<float> &ray,
                                         float thickness, Flight &flight, float &) {
    const Coefficients at = coefficients(media, ray.origin, ray.direction);
    const auto distance = fly(at, ray.far - ray.near, thickness, flight);
    return distance ? std::optional(ray.near + *distance) : std::nullopt;
}

// Delta tracking (Woodcock et al. 1965) with piecewise constant majorants. They are equal for all channels
// and for light sampling, so the densities of distances cancel, and only the types of the collisions count.
inline std::optional<float> InMedia::fly(const Heterogeneous &model, const Media &media,
                                         const Ray<float> &ray, float thickness, Flight &flight, float &u) {
    std::optional<float> collision;
    int collisions = 0;
    model.majorants.traverse(ray, [&](float t, float end, float majorant) {
        while (thickness < (end - t) * majorant) {
            if (++collisions > max_collisions) {
                flight.weight = Spectrum(0);
                return false;
            }
            t += thickness / majorant;
            thickness = detail::sample_thickness(draw(u));
            const Coefficients at = coefficients(media, ray.origin + ray.direction * t, ray.direction);
            flight.emitted += flight.weight * at.emission / majorant;
            const Spectrum real = min(at.sigma_t() / majorant, Spectrum(1));
            if (draw(u) < real[channel_]) {
                collision = t;
                event(at.sigma_s / majorant, real, flight.weight);
                return false;
            }
            const Spectrum null = Spectrum(1) - real;
            flight.pdf *= event(null, null, flight.weight);
        }
        thickness -= (end - t) * majorant;
        return true;
    });
    return collision;
}

// Closed form.
inline void InMedia::attenuate(const Coefficients &even, float length, Transmittance &light) const {
    const Spectrum transmitted = detail::exp_minus(even.sigma_t(), length);
    light.weight *= transmitted;
    if (!is_black(even.sigma_s)) light.path_pdf *= transmitted;
}

inline void InMedia::attenuate(const Homogeneous &, const Media &media, const Ray<float> &ray,
                               Transmittance &light) {
    attenuate(coefficients(media, ray.origin, ray.direction), ray.far - ray.near, light);
}

// Ratio tracking (Novák et al. 2014, "Residual ratio tracking for estimating attenuation in participating
// media"), with Russian roulette at low transmittance.
inline void InMedia::attenuate(const Heterogeneous &model, const Media &media, const Ray<float> &ray,
                               Transmittance &light) {
    float thickness = detail::sample_thickness(numbers_.next());
    int collisions = 0;
    model.majorants.traverse(ray, [&](float t, float end, float majorant) {
        while (thickness < (end - t) * majorant) {
            t += thickness / majorant;
            thickness = detail::sample_thickness(numbers_.next());
            const Coefficients at = coefficients(media, ray.origin + ray.direction * t, ray.direction);
            const Spectrum null = max(Spectrum(1) - at.sigma_t() / majorant, Spectrum(0));
            light.weight *= null;
            light.path_pdf *= null;
            if (max_component(light.weight) < 0.1f * light.survival) {
                light.survival *= 0.5f;
                if (numbers_.next() >= 0.5f) light.weight = Spectrum(0);
            }
            if (++collisions > max_collisions) light.weight = Spectrum(0);
            if (is_black(light.weight)) return false;
        }
        thickness -= (end - t) * majorant;
        return true;
    });
}

inline Flight InMedia::fly(const Scene &scene, Ray<float> ray, const std::optional<RayHit> &found, float &u) {
    if (current < 0) return {};
    const Media &media = scene.media();
    const Ray<float> given = ray;
    ray.near = 0; // a camera's near plane clips surfaces, not media
    if (found) ray.far = found->distance;

    Flight flight;
    const bool collides = match(media[current], [&](const auto &model) { return model.collides(scatters_); });
    float thickness = collides ? detail::sample_thickness(draw(u)) : infinity;
    if (near_) {
        ray = near_->lowered(ray);
        if (media.is_dense(current, near_->hit().position_error)) {
            const NearSurface::Way way = near_->way(ray.direction, ray.far);
            const Coefficients at = coefficients(media, near_->inside(), ray.direction);
            const auto distance = fly(at, way.length, thickness, flight);
            if (distance) {
                near_->move(ray.direction * *distance);
                if (found && !way.meets_surface) approach(scene, given, *found, ray.far - *distance);
                flight.collision = near_->position();
            } else if (way.meets_surface) {
                flight.surface = near_->hit();
            }
            if (distance || way.meets_surface || way.length == ray.far) return flight;
            ray.near = way.length;
        }
    }
    near_.reset();
    const auto distance = match(
        media[current], [&](const auto &model) { return fly(model, media, ray, thickness, flight, u); });
    if (!distance) return flight;
    flight.collision = ray.origin + ray.direction * *distance;
    if (found && media.is_dense(current, position_error(max_component(abs(*flight.collision))))) {
        approach(scene, given, *found, ray.far - *distance);
        if (near_) flight.collision = near_->position();
    }
    return flight;
}

inline void InMedia::approach(const Scene &scene, const Ray<float> &ray, const RayHit &found,
                              float remaining) {
    const Hit<float> hit = scene.hit(ray, found, scene.needs());
    const NearSurface ahead(hit, -ray.direction, ray.direction * -remaining);
    if (ahead.reaches(remaining) && (!near_ || ahead.depth() < near_->depth())) near_ = ahead;
}

inline void InMedia::attenuate(const Scene &scene, const Ray<float> &ray, Transmittance &light) {
    if (current < 0) return;
    const Ray<float> lowered = near_ ? near_->lowered(ray) : ray;
    match(scene.media()[current],
          [&](const auto &model) { attenuate(model, scene.media(), lowered, light); });
}

inline std::optional<Hit<float>> InMedia::attenuate_to_surface(const Scene &scene, const Vec3f &direction,
                                                               Transmittance &light) const {
    if (current < 0 || !near_) return std::nullopt;
    const NearSurface::Way way = near_->way(direction);
    if (!way.meets_surface) return std::nullopt;
    attenuate(coefficients(scene.media(), near_->inside(), direction), way.length, light);
    return near_->hit();
}

} // namespace lajolla
