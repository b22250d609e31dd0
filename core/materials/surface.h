#pragma once
// A surface point that scatters light: a lobe and its frame.

#include "geometry/hit.h"
#include "materials/normals.h"
#include "scatter/bsdfs.h"

namespace lajolla {

// How a shading normal differs from the geometric one. Directions are in the shading frame.
template <class Float>
struct ShadingNormal {
    BoolOf<Float> differs = false; // otherwise the rest is undefined
    BoolOf<Float> lifted = false;  // reflected rays start above the triangle, which may shadow them itself
    Float bump = 0;                // tan^2 of the rotation of the normal by maps, if it casts shadows
    Vec3<Float> geometric{};       // normal
    Vec3<Float> smooth{};          // normal without maps
    bool softened = false;         // the terminator

    // A factor of light scattered between wo and wi: 0 for reflection into the surface, less than 1 if bumps
    // cast shadows, or before the terminator, which mirrors do not have.
    Float visible(const Vec3<Float> &wo, const Vec3<Float> &wi, BoolOf<Float> mirror = false) const {
        const auto reflected = wi.z * wo.z > 0.0f;
        const auto into_solid = reflected && !lifted && dot(geometric, wi) * dot(geometric, wo) <= 0.0f;
        Float shadowing = 1;
        if (any(differs && bump != 0.0f))
            shadowing =
                select(bump == 0.0f, Float(1), bump_shadowing(bump, tangent_squared(dot(smooth, wi))));
        if (softened)
            shadowing *= select(reflected && !mirror, terminator_shadowing(geometric, smooth, wi), Float(1));
        return select(differs, select(into_solid, Float(0), shadowing), Float(1));
    }
};

// LobeType is a model's lobe, or the variant of all lobes.
template <class Float, class LobeType>
struct Surface {
    BoolOf<Float> black = true;       // nothing is scattered: the rest is undefined
    BoolOf<Float> delta = false;      // delta or almost: lights are not sampled
    Float scattering_probability = 1; // probability that a path does not pass straight through
    Frame<Float> frame;
    Vec3<Float> wo; // local
    LobeType lobe;
    ShadingNormal<Float> normal;
    BoolOf<Float> behind = false; // the viewer is on the back of the shape
    bool transmissive = false;

    Surface() = default;
    explicit Surface(const LobeType &scatterer) : black(false), lobe(scatterer) {}

    Float roughness() const {
        if constexpr (std::is_same_v<LobeType, Lobe>) return lajolla::roughness(lobe);
        else return lobe.roughness();
    }
    // Of paths that pass straight through.
    NullTransmission<Float> null_transmission() const {
        if constexpr (std::is_same_v<LobeType, Lobe>) return lajolla::null_transmission(lobe, wo);
        else if constexpr (requires { lobe.null_transmission(wo); }) return lobe.null_transmission(wo);
        else return {};
    }

    // The start of a ray that is scattered at the hit. If the smooth surface is above the triangle on one of
    // its sides, what is reflected or refracted there starts on it, and the triangle may be in its way. Other
    // rays start on the side to which they go.
    Departure<Float> departure(const Hit<Float> &hit, const Vec3<Float> &direction) const {
        return hit.lift ? lifted_departure(hit, direction) : depart(hit, direction);
    }

    // The BSDF times |cos| and the density for light from a direction in world space, for paths that do not
    // pass straight through.
    BsdfEval<Float> eval(const Vec3<Float> &direction) const {
        const Vec3<Float> wi = frame.to_local(direction);
        BsdfEval<Float> result = eval_lobe(wi);
        if (!any(normal.differs)) return result;
        const Float visible = normal.visible(wo, wi);
        result.f_cos *= visible;
        result.pdf = select(visible == 0.0f, Float(0), result.pdf);
        return result;
    }
    BsdfSample<Float> sample(Float u_lobe, const Vec2<Float> &u) const {
        BsdfSample<Float> result = sample_lobe(u_lobe * scattering_probability, u);
        if (any(normal.differs)) {
            const Float visible = normal.visible(wo, result.wi, delta || result.delta);
            result.weight *= visible;
            result.valid = result.valid && visible != 0.0f;
        }
        result.wi = frame.to_world(result.wi);
        return result;
    }

private:
    // Not inlined, because few surfaces have lifts.
    [[gnu::noinline]] Departure<Float> lifted_departure(const Hit<Float> &hit,
                                                        const Vec3<Float> &direction) const {
        const auto reflected = frame.to_local(direction).z * wo.z > 0.0f;
        const auto front = (reflected && !behind) || (!reflected && behind);
        const auto raised = Lift<Float>::is_raised(select(front, hit.lift->front, hit.lift->back));
        const auto ahead = dot(hit.normal, direction) >= 0.0f;
        return depart_lifted(hit, (raised && front) || (!raised && ahead));
    }

    BsdfEval<Float> eval_lobe(const Vec3<Float> &wi) const {
        if constexpr (std::is_same_v<LobeType, Lobe>) return lajolla::eval(lobe, wo, wi);
        else return lobe.eval(wo, wi);
    }
    BsdfSample<Float> sample_lobe(Float u_lobe, const Vec2<Float> &u) const {
        if constexpr (std::is_same_v<LobeType, Lobe>) return lajolla::sample(lobe, wo, u_lobe, u);
        else return lobe.sample(wo, u_lobe, u);
    }
};

// Whether the side of a hit that the viewer `wo` (world space) sees has no BSDF; `turned` if this is that of
// the back, whose frame is flipped.
template <class Float>
BoolOf<Float> sees_black(const BsdfTraits &traits, const Hit<Float> &hit, const Vec3<Float> &wo,
                         BoolOf<Float> turned) {
    return dot(hit.normal, wo) < 0.0f && !turned && !BoolOf<Float>(traits.transmissive);
}

// The surface that the viewer sees in a hit, where that is not black. What is less rough than
// `least_roughness` counts as delta.
template <class Float, class LobeType>
Surface<Float, LobeType> surface_of(const BsdfTraits &traits, const LobeType &lobe, const Hit<Float> &hit,
                                    const Vec3<Float> &wo, const MappedNormal<Float> &normal,
                                    float least_roughness) {
    const SeenNormals<Float> seen = seen_from(wo, hit.normal, normal);
    // Towards the viewer, until it is known whether the lobe distinguishes both sides.
    Vec3<Float> n = seen.shading;
    const auto differs = !(n == seen.geometric);
    if (any(differs))
        n = select(differs,
                   traits.lambertian ? seen_from_above(n, seen.geometric, wo)
                                     : with_mirror_image_above(n, seen.geometric, wo),
                   n);
    if (traits.transmissive) n = select(seen.behind, -n, n);
    Surface<Float, LobeType> result(lobe);
    result.delta = BoolOf<Float>(traits.delta) || result.roughness() < least_roughness;
    result.transmissive = traits.transmissive;
    result.behind = seen.behind;
    result.frame = traits.anisotropic ? frame_along(n, normal.tangent) : frame_around(n);
    result.wo = result.frame.to_local(wo);
    if (traits.null_transmission) result.scattering_probability = 1 - result.null_transmission().probability;
    result.normal.differs = differs;
    if (any(differs)) {
        result.normal.geometric = result.frame.to_local(hit.normal);
        result.normal.softened = normal.softened;
        if (normal.shadowed || normal.softened)
            result.normal.smooth = result.frame.to_local(hit.shading_normal);
        if (normal.shadowed) result.normal.bump = tangent_squared(result.normal.smooth.z);
        if (hit.lift)
            result.normal.lifted =
                Lift<Float>::is_raised(select(seen.behind, hit.lift->back, hit.lift->front));
    }
    return result;
}

} // namespace lajolla
