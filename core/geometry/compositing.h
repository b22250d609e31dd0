#pragma once
// How the camera sees shapes, for compositing: other rays see all of them alike. Camera rays are those from
// the camera to the first vertex at which a path is scattered.

#include <algorithm>
#include <cstdint>
#include <tuple>

#include "base/fields.h"

namespace lajolla {

// What camera rays see in a shape, in the order of precedence if a shape and its instance differ.
enum class CameraRole : std::uint8_t {
    object,  // what it is
    catcher, // the shadows on it, and light that it reflects from objects
    hole,    // black with alpha 0, which hides what is behind
    nothing  // they pass through
};

// Properties that all shapes and instances have.
struct Compositing {
    bool visible_to_camera = true, holdout = false, shadow_catcher = false;

    static constexpr auto fields() {
        return std::tuple(
            field("visible_to_camera", &Compositing::visible_to_camera,
                  "if not, camera rays pass through; it lights, casts shadows and is reflected all the same"),
            field("holdout", &Compositing::holdout,
                  "the camera sees a hole in its place: black with alpha 0"),
            field("shadow_catcher", &Compositing::shadow_catcher,
                  "the camera sees the shadows on it alone, as alpha, to be composed over a photograph"));
    }
    CameraRole role() const {
        if (!visible_to_camera) return CameraRole::nothing;
        if (holdout) return CameraRole::hole;
        return shadow_catcher ? CameraRole::catcher : CameraRole::object;
    }
};

} // namespace lajolla
