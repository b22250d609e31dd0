#pragma once
// The content of a description: the scene, and its render settings.

#include <cstdint>
#include <memory>

#include "engine/build.h"
#include "transport/render.h"

namespace lajolla {

struct RenderableScene {
    std::unique_ptr<const Scene> scene;
    Output output;
    SequenceKind sequence;
    int sample_count;
    std::uint32_t seed;
};

} // namespace lajolla
