#pragma once
// The two kinds of vertices at which a path is scattered, with the same interface for light sampling. eval()
// is for light from wi that continues along the path.

#include "scene/scene.h"

namespace lajolla {

struct SurfaceVertex {
    const Hit<float> &hit;
    const AnySurface &surface;

    const Vec3f &position() const { return hit.position; }
    float position_error() const { return hit.position_error; }
    Vec3f leave(const Vec3f &wi) const { return lajolla::leave(hit, wi); }
    void enter(auto &medium, const Vec3f &wi) const { medium.cross(hit, wi); }
    BsdfEval<float> eval(const Vec3f &wi) const { return surface.eval(wi); }
};

struct MediumVertex {
    Vec3f point, wo;
    PhaseLobe phase;

    const Vec3f &position() const { return point; }
    float position_error() const { return lajolla::position_error(max_component(abs(point))); }
    const Vec3f &leave(const Vec3f &) const { return point; }
    void enter(const auto &, const Vec3f &) const {}
    BsdfEval<float> eval(const Vec3f &wi) const {
        const float value = phase.eval(wo, wi);
        return {Spectrum(value), value};
    }
};

} // namespace lajolla
