#pragma once

#include <nanobind/nanobind.h>

namespace lajolla {

// Adds the calls that the statistical tests use.
void bind_statistics(nanobind::module_ &m);
void bind_scene_statistics(nanobind::module_ &m);
void bind_media_statistics(nanobind::module_ &m); // those of lights, filters and shapes

} // namespace lajolla
