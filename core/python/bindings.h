#pragma once
// What the module `lajolla._core` is made of; each file adds its classes and calls.

#include <nanobind/nanobind.h>

namespace lajolla {

namespace nb = nanobind;

void bind_meshes(nb::module_ &m);
void bind_grids(nb::module_ &m);
void bind_face_images(nb::module_ &m);
void bind_measurements(nb::module_ &m);
void bind_scene(nb::module_ &m);
void bind_object_ids(nb::module_ &m);
void bind_render(nb::module_ &m);
void bind_queries(nb::module_ &m);
void bind_bsdfs(nb::module_ &m);
void bind_lights(nb::module_ &m);
void bind_media(nb::module_ &m);

} // namespace lajolla
