#pragma once
// The faces that primitives are parts of.

#include "scene/scene.h"

namespace lajolla {

// The face of the mesh that a shape was made from; for shapes that do not know their faces, the primitive.
inline std::int32_t face_of(const Scene &scene, std::int32_t shape, std::int32_t primitive) {
    const auto *mesh = std::get_if<TriangleMesh>(&scene.parts().shapes[static_cast<std::size_t>(shape)]);
    if (!mesh || mesh->mesh->face_coordinates.empty()) return primitive;
    const auto &triangle = mesh->mesh->face_coordinates[static_cast<std::size_t>(primitive)];
    return static_cast<std::int32_t>(triangle.face);
}

} // namespace lajolla
