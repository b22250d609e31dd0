#pragma once
// What the module `lajolla._core_testing` is made of; each file adds its classes and calls.

#include <nanobind/nanobind.h>

namespace lajolla {

namespace nb = nanobind;

void bind_statistics(nb::module_ &m);
void bind_scene_statistics(nb::module_ &m);
void bind_recording(nb::module_ &m);

} // namespace lajolla
