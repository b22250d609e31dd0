#pragma once
// Measured materials as Python objects.

#include <nanobind/nanobind.h>

namespace lajolla {

void bind_measurements(nanobind::module_ &m);

} // namespace lajolla
