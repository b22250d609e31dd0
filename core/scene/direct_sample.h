#pragma once
// What sampling a light towards a point gives.

#include "base/vec.h"

namespace lajolla {

struct BoundingSphere {
    Vec3f center{0};
    float radius = 1;
};

// A direction towards a light; none where pdf is zero.
struct DirectSample {
    Vec3f wi{0};          // unit length
    float distance = 0;   // infinity for lights around the scene
    Vec3f target{0};      // where the light is, moved off its surface; meaningless at infinite distance
    Spectrum radiance{0}; // for lights without area: radiant intensity over squared distance, or irradiance
    float pdf = 0;        // per solid angle; 1 for lights that no ray can hit
    bool delta = false;   // no ray can hit the light, only sampling finds it
};

} // namespace lajolla
