#pragma once
// The media of a description.

#include "engine/value.h"
#include "media/medium.h"

namespace lajolla {

// Its lists "volumes", "phases" and "media". Throws DescriptionError.
Media read_media(const Dict &description);

} // namespace lajolla
