#pragma once
// Scenes far from the origin, such as those in geographic coordinates: float32 cannot resolve details there,
// so the scene is moved to the origin while its transforms are still double.

#include <array>
#include <optional>

#include "engine/value.h"
#include "geometry/shape_sample.h"

namespace lajolla {

using Point = std::array<double, 3>;

// The new origin for a scene with these bounds, or nullopt if it need not move. It is a multiple of a power
// of two about as large as the scene, so that round coordinates stay round, and translating a scene by such a
// multiple does not change the image.
std::optional<Point> far_centre(const Bounds &scene);

// The same scene relative to `centre`: changes all transforms and positions in world space.
Dict recentred(const Dict &description, const Point &centre);

} // namespace lajolla
