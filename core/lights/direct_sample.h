#pragma once
// The result of sampling a light from a point.

#include "base/vec.h"

namespace lajolla {

// A direction to a light. If pdf is zero, there is no sample, and the rest is undefined.
template <class Float>
struct DirectSample {
    Vec3<Float> wi{0};      // unit length
    Float distance = 0;     // infinity for lights at infinity
    Vec3<Float> target{0};  // the point on the light, offset from its surface; undefined at infinite distance
    Rgb<Float> radiance{0}; // for lights without area: radiant intensity over squared distance, or irradiance
    Float pdf = 0;          // per solid angle; 1 for lights that no ray can hit
    BoolOf<Float> delta = false; // no ray can hit the light
};

template <class Float>
DirectSample<Float> select(BoolOf<Float> m, const DirectSample<Float> &a, const DirectSample<Float> &b) {
    return {select(m, a.wi, b.wi),         select(m, a.distance, b.distance),
            select(m, a.target, b.target), select(m, a.radiance, b.radiance),
            select(m, a.pdf, b.pdf),       select(m, a.delta, b.delta)};
}

inline DirectSample<float> lane_of(const DirectSample<WideFloat> &s, int k) {
    const auto vector = [&](const auto &v) { return Vec3f{v.x[k], v.y[k], v.z[k]}; };
    return {vector(s.wi), s.distance[k],    vector(s.target), Spectrum(vector(s.radiance)),
            s.pdf[k],     s.delta.v[k] != 0};
}

} // namespace lajolla
