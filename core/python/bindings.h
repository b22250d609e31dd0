#pragma once
// What the module is made of; each file adds its classes and calls.

#include <nanobind/nanobind.h>

namespace lajolla {

namespace nb = nanobind;

void bind_meshes(nb::module_ &m);
void bind_grids(nb::module_ &m);
void bind_measurements(nb::module_ &m);
void bind_scene(nb::module_ &m);
void bind_statistics(nb::module_ &m); // what the statistical tests call
void bind_scene_statistics(nb::module_ &m);
void bind_media_statistics(nb::module_ &m);

} // namespace lajolla
