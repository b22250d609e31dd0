#pragma once
// From a description, which docs/architecture.md specifies, to a scene.

#include <memory>

#include "engine/value.h"

namespace lajolla {

struct RenderableScene; // renderable.h; few need to look inside

// Throws DescriptionError.
std::shared_ptr<RenderableScene> build_scene(const Dict &description);

// The same scene with another output: the entries "integrator", "other_integrators" and "channels" of a
// description. Throws DescriptionError.
std::shared_ptr<RenderableScene> with_output(const RenderableScene &scene, const Dict &description);

// The same scene with other entries, which have the names that messages use: {"bsdfs[3]": {...}, "sensor":
// {...}}. Textures, BSDFs, adapters and materials can be added as the entry after the last. A shape's entry
// without "type" changes only what the shape refers to and how the camera sees it; its emitter stays. All
// that does not depend on the changes is shared with the other scene. Null if the scene has to be built anew
// because it moves to another origin (recentre.h). Throws DescriptionError.
std::shared_ptr<RenderableScene> with_changes(const RenderableScene &scene, const Dict &changes);

// Every model and its fields: {kind: {name: {"doc", "fields": [{"name", "type", "default", ...}, ...]}}}.
Dict schema();

// Whether a BSDF of a description is transmissive; with columns, whether any of them is.
bool transmissive(const Dict &bsdf);

// Counts of what is in a scene, and its size in bytes.
Dict summary(const RenderableScene &scene);

} // namespace lajolla
