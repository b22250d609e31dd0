#pragma once
// Scenes and renders as Python objects.

#include <nanobind/nanobind.h>

#include <cstdint>
#include <memory>

#include "transport/render.h"

namespace lajolla {

// What a description says: the scene, and how it wants to be rendered.
struct RenderableScene {
    std::unique_ptr<const Scene> scene;
    Output output;
    SequenceKind sequence;
    int sample_count;
    std::uint32_t seed;
};

nanobind::dict schema();
void bind_scene(nanobind::module_ &m);

} // namespace lajolla
