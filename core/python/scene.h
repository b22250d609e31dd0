#pragma once
// Scenes and renders as Python objects.

#include <nanobind/nanobind.h>

namespace lajolla {

void bind_scene(nanobind::module_ &m);

} // namespace lajolla
