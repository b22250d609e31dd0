#pragma once
// Groups of shapes that are visible only through instances, their transformed copies.

#include <cstdint>
#include <tuple>
#include <vector>

#include "base/fields.h"
#include "base/transform.h"
#include "geometry/compositing.h"
#include "geometry/hit.h"
#include "geometry/shapes.h"

namespace lajolla {

// Shape ids; the shapes are not part of the scene themselves.
using Group = std::vector<std::uint32_t>;

struct Instance : Compositing {
    static constexpr const char *name = "instance";
    static constexpr const char *doc = "A transformed copy of a group of shapes.";
    std::int32_t group = 0;
    Transform to_world;
    Transform to_group;

    static constexpr auto fields() {
        return std::tuple_cat(
            std::tuple(field("group", &Instance::group, "index of the group").range(0),
                       field("to_world", &Instance::to_world, "placement of the group in the scene")),
            Compositing::fields());
    }
    static constexpr float largest_entry = 1e12f; // of the transforms: rays in groups must stay finite
    void build();
    // A ray in the group's space; distances stay the same, so its direction does not have unit length.
    Ray<float> in_group(const Ray<float> &ray) const {
        return {to_group.point(ray.origin), to_group.vector(ray.direction), ray.near, ray.far};
    }
    Bounds placed(const Bounds &group_bounds) const;
    // Transforms a hit from the group's space to world space.
    void place(Hit<float> &hit) const;
};

} // namespace lajolla
