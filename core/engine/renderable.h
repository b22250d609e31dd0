#pragma once
// The content of a description: the scene, and its render settings.

#include <cstdint>
#include <memory>

#include "engine/build.h"
#include "engine/recentre.h"
#include "transport/render.h"

namespace lajolla {

struct RenderableScene {
    std::shared_ptr<const Scene> scene;     // other outputs may share it
    std::shared_ptr<const Origins> origins; // null: where the description has them
    Output output;
    SequenceKind sequence;
    int sample_count;
    std::uint32_t seed;

    void set_sampler(const SamplerModel &model) {
        match(model, [&](const auto &sampler) {
            sequence = sampler.kind;
            sample_count = sampler.sample_count;
            seed = sampler.seed;
        });
    }
};

// If the scene has shadow catchers, adds to each alpha channel those from which its shadows follow: its label
// with ".catcher", ".shadowed" and ".unshadowed". Removes them if it has none.
void match_channels(RenderableScene &scene);

} // namespace lajolla
