#pragma once
// Voxel grids as Python objects.

#include <nanobind/nanobind.h>

namespace lajolla {

void bind_grids(nanobind::module_ &m);

} // namespace lajolla
