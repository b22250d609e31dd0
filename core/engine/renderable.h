#pragma once
// The content of a description: the scene, and its render settings.

#include <cstdint>
#include <memory>

#include "engine/build.h"
#include "transport/render.h"

namespace lajolla {

struct RenderableScene {
    std::shared_ptr<const Scene> scene; // other outputs may share it
    Output output;
    SequenceKind sequence;
    int sample_count;
    std::uint32_t seed;
};

} // namespace lajolla
