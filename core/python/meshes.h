#pragma once
// Meshes, curves and images as Python objects.

#include <nanobind/nanobind.h>
#include <nanobind/stl/shared_ptr.h>

#include "python/values.h"
#include "scene/curves.h"
#include "scene/image.h"
#include "scene/mesh.h"

namespace lajolla {

void bind_meshes(nb::module_ &m);

} // namespace lajolla
