#pragma once
// Scenes far from the origin, such as those in geographic coordinates: float32 cannot resolve details there,
// so the scene is moved to the origin while its transforms are still double, and so are the contents of
// groups.

#include <array>
#include <vector>

#include "engine/value.h"
#include "scene/scene.h"

namespace lajolla {

using Point = std::array<double, 3>;

// The origins of a scene and of each group in its own space.
struct Origins {
    static constexpr std::size_t no_group = ~std::size_t(0);

    Point scene{};
    std::vector<Point> groups;
    std::vector<std::size_t> group_of; // of each shape

    // Moves the origins to shapes that are far from them; returns whether any moved. `parts` are relative to
    // the origins.
    bool move(const SceneParts &parts);
    bool any_moved() const; // ever
};

// The same scene relative to other origins: changes all transforms and positions in world space. `parts` were
// read from the description before.
Dict recentred(const Dict &description, const SceneParts &parts, const Origins &origins);

} // namespace lajolla
