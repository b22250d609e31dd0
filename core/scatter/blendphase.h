#pragma once

#include "scatter/phase.h"

namespace lajolla {

// Has no lobe of its own: prepare() in phases.h collects the lobes of its components.
struct BlendPhase {
    static constexpr const char *name = "blendphase";
    static constexpr const char *doc = "A mixture of two phase functions.";
    Volume<float> weight{0.5f};
    PhaseId phase_0, phase_1;

    static constexpr auto fields() {
        return std::tuple(
            field("weight", &BlendPhase::weight, "weight of the second phase function").range(0, 1),
            field("phase_0", &BlendPhase::phase_0, "the first one"),
            field("phase_1", &BlendPhase::phase_1, "the second one"));
    }
};

} // namespace lajolla
