#pragma once
// Scenes far from the origin, such as those in geographic coordinates: float32 has no digits left there, so
// they are moved to the origin while their transforms are still double. So are the contents of groups.

#include <array>
#include <vector>

#include "engine/value.h"
#include "scene/scene.h"

namespace lajolla {

using Point = std::array<double, 3>;

// Where a scene, and each group in its own space, has its origin.
struct Origins {
    static constexpr std::size_t no_group = ~std::size_t(0);

    Point scene{};
    std::vector<Point> groups;
    std::vector<std::size_t> group_of; // of each shape

    // Moves the origins to what is far from them; false where nothing is. `parts` are relative to them.
    bool move(const SceneParts &parts);
};

// The same scene as seen from other origins: with other transforms and positions in the world. `parts` were
// read from the description before.
Dict recentred(const Dict &description, const SceneParts &parts, const Origins &origins);

} // namespace lajolla
