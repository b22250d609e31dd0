#pragma once
// Scenes far from the origin, such as those in geographic coordinates: float32 has no digits left there, so
// they are moved to the origin while their transforms are still double.

#include <array>
#include <optional>

#include "engine/value.h"
#include "geometry/shape_sample.h"

namespace lajolla {

using Point = std::array<double, 3>;

// Where a scene with these bounds should have its origin; nothing where that can stay. It is a multiple of a
// power of two about as large as the scene, so that round coordinates stay round, and a scene that is placed
// by a round translation is the one that was not.
std::optional<Point> far_centre(const Bounds &scene);

// The same scene as seen from `centre`: with other transforms and positions in the world.
Dict recentred(const Dict &description, const Point &centre);

} // namespace lajolla
