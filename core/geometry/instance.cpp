#include "geometry/instance.h"

#include <stdexcept>

namespace lajolla {

void Instance::build() {
    const auto inverted = inverse(to_world);
    if (!inverted) throw std::invalid_argument("to_world is singular: it flattens the group");
    to_group = *inverted;
    for (const Transform &t : {to_world, to_group})
        for (std::size_t axis = 0; axis < 4; ++axis)
            if (!(max_component(abs(t.axis(axis))) < largest_entry))
                throw std::invalid_argument("to_world is too large or too small for a group");
}

Bounds Instance::placed(const Bounds &group_bounds) const {
    Bounds box;
    if (group_bounds.empty()) return box;
    for (unsigned corner = 0; corner < 8; ++corner)
        box.extend(to_world.point({(corner & 1 ? group_bounds.high : group_bounds.low).x,
                                   (corner & 2 ? group_bounds.high : group_bounds.low).y,
                                   (corner & 4 ? group_bounds.high : group_bounds.low).z}));
    return box;
}

void Instance::place(Hit<float> &hit) const {
    const Vec3f scaled_normal = to_group.transposed_vector(hit.normal);
    const float stretch =
        length(scaled_normal); // of distances to the tangent plane, from the scene to the group
    const Vec3f position = to_world.point(hit.position);

    // Errors along the normal: in the group, and of the transforms to the group and back.
    const float error_in_group = hit.position_error + position_error(largest_term(to_group, position));
    hit.position_error = error_in_group / stretch + position_error(largest_term(to_world, hit.position));
    hit.position = position;
    hit.normal = scaled_normal / stretch;
    const Vec3f scaled_shading = to_group.transposed_vector(hit.shading_normal);
    const float inverse_length = 1 / length(scaled_shading);
    hit.shading_normal = scaled_shading * inverse_length;
    const auto change = [&](const Vec3f &in_group) { // of the vector divided by its length
        const Vec3f moved = to_group.transposed_vector(in_group) * inverse_length;
        return moved - hit.shading_normal * dot(hit.shading_normal, moved);
    };
    if (hit.dn) hit.dn = {change(hit.dn->du), change(hit.dn->dv)};
    hit.dp_du = to_world.vector(hit.dp_du);
    hit.dp_dv = to_world.vector(hit.dp_dv);
    if (hit.lift) {
        hit.lift->front = clear_lift(to_world.vector(hit.lift->front), hit.normal, hit.position_error);
        hit.lift->back = clear_lift(to_world.vector(hit.lift->back), -hit.normal, hit.position_error);
        if (!hit.lift->is_raised()) hit.lift.reset();
    }
}

} // namespace lajolla
