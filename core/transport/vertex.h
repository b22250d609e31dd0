#pragma once
// The two kinds of vertices at which a path is scattered, with the same interface for light sampling. eval()
// is for light from wi that continues along the path.

#include "scene/scene.h"

namespace lajolla {

// On one side of a hit, if rays start at other points on each: light is then gathered at both.
template <class Float, class LobeType>
struct SurfaceVertex {
    const Hit<Float> &hit;
    const Surface<Float, LobeType> &surface;
    BoolOf<Float> front = true; // the side, if the hit has a lift

    Vec3<Float> position() const { return hit.lift ? depart_lifted(hit, front).vertex : hit.position; }
    Float position_error() const { return hit.position_error; }
    // Whether light from wi is gathered here.
    BoolOf<Float> gathers(const Vec3<Float> &wi) const {
        if (!hit.lift) return true;
        const auto there = surface.departure(hit, wi).front;
        return (there && front) || (!there && !front);
    }
    Vec3<Float> leave(const Vec3<Float> &wi) const { return surface.departure(hit, wi).origin; }
    void enter(auto &medium, const Vec3<Float> &wi) const {
        medium.cross(hit, wi, surface.departure(hit, wi));
    }
    BsdfEval<Float> eval(const Vec3<Float> &wi) const { return surface.eval(wi); }
};

// Calls f(vertex) for the vertices at which a surface gathers light.
template <class Float, class LobeType, class F>
void for_each_vertex(const Hit<Float> &hit, const Surface<Float, LobeType> &surface, F &&f) {
    const int count = hit.lift && surface.transmissive ? 2 : 1;
    for (int i = 0; i < count; ++i)
        f(SurfaceVertex<Float, LobeType>{hit, surface, i == 0 ? !surface.behind : surface.behind});
}

struct MediumVertex {
    Vec3f point, wo;
    PhaseLobe phase;

    const Vec3f &position() const { return point; }
    float position_error() const { return lajolla::position_error(max_component(abs(point))); }
    bool gathers(const Vec3f &) const { return true; }
    const Vec3f &leave(const Vec3f &) const { return point; }
    void enter(const auto &, const Vec3f &) const {}
    BsdfEval<float> eval(const Vec3f &wi) const {
        const float value = phase.eval(wo, wi);
        return {Spectrum(value), value};
    }
};

// How far rays get, at most to their end.
inline float free_distance(Tracer &tracer, const Ray<float> &ray, bool) {
    const auto found = tracer.closest(ray);
    return found ? found->distance : ray.far;
}
inline WideFloat free_distance(Tracer &tracer, const Ray<WideFloat> &rays, WideBool active) {
    const RayHits found = tracer.closest(rays, active);
    return select(found.shape >= 0, found.distance, rays.far);
}

// Lowers the lifts of hits where something is in the way, so that no ray starts behind it: they reach at most
// half of the way to there.
template <class Float>
void lower_lift(Tracer &tracer, BoolOf<Float> active, Hit<Float> &hit) {
    if (!hit.lift) [[likely]]
        return;
    const auto lower = [&](Vec3<Float> &lift) {
        const auto raised = active && Lift<Float>::is_raised(lift);
        if (!any(raised)) return;
        const Float height = length(lift);
        const Vec3<Float> direction = lift / height;
        const Float free =
            free_distance(tracer, Ray<Float>{leave(hit, direction), direction, 0, 2 * height}, raised);
        const Vec3<Float> outwards = hit.normal * copysign(Float(1), dot(hit.normal, direction));
        const Vec3<Float> lowered = lift * min(free / (2 * height), Float(1));
        lift = select(raised, clear_lift(lowered, outwards, hit.position_error), lift);
    };
    lower(hit.lift->front);
    lower(hit.lift->back);
    if (!any(hit.lift->is_raised())) hit.lift.reset();
}

} // namespace lajolla
