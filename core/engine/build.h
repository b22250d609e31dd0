#pragma once
// From a description, which docs/architecture.md specifies, to a scene.

#include <memory>

#include "engine/value.h"

namespace lajolla {

struct RenderableScene; // renderable.h; few need to look inside

// Throws DescriptionError.
std::shared_ptr<RenderableScene> build_scene(const Dict &description);

// Every model and its fields: {kind: {name: {"doc", "fields": [{"name", "type", "default", ...}, ...]}}}.
Dict schema();

// Whether light passes through a surface with the BSDF of a description, or with any where it holds columns.
bool transmissive(const Dict &bsdf);

// Counts of what is in a scene, and its size in bytes.
Dict summary(const RenderableScene &scene);

} // namespace lajolla
