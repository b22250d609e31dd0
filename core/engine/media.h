#pragma once
// The media of a description.

#include <map>

#include "engine/value.h"
#include "media/medium.h"

namespace lajolla {

// Its lists "volumes", "phases" and "media". Throws DescriptionError.
Media read_media(const Dict &description);

// Other entries of these lists, by index.
struct MediaChanges {
    std::map<std::size_t, Dict> volumes, phases, media;

    bool empty() const { return volumes.empty() && phases.empty() && media.empty(); }
};
Media changed_media(const Media &before, const MediaChanges &changes);

} // namespace lajolla
