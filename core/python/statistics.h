#pragma once

#include <nanobind/nanobind.h>

namespace lajolla {

// Adds the calls that the statistical tests use.
void bind_statistics(nanobind::module_ &m);

} // namespace lajolla
