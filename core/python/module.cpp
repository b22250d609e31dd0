#include <nanobind/nanobind.h>

#include "engine/build.h"
#include "python/bindings.h"
#include "python/values.h"

NB_MODULE(_core, m) {
    m.doc() = "The renderer's core.";
    m.attr("isa") = LAJOLLA_ISA; // the build's instruction set
    nanobind::exception<lajolla::DescriptionError>(m, "DescriptionError", PyExc_ValueError).doc() =
        "A description that does not fit its model.";
    m.def(
        "schema", [] { return lajolla::object_of(lajolla::schema()); },
        "Every model and its fields: {kind: {name: {'doc': str, 'fields': [{'name', 'type', 'default', "
        "'minimum', "
        "'maximum', 'unit', 'choices', 'doc'}]}}}.");
    lajolla::bind_meshes(m);
    lajolla::bind_grids(m);
    lajolla::bind_face_images(m);
    lajolla::bind_measurements(m);
    lajolla::bind_scene(m);
    lajolla::bind_object_ids(m);
    lajolla::bind_render(m);
    lajolla::bind_queries(m);
    lajolla::bind_bsdfs(m);
    lajolla::bind_lights(m);
    lajolla::bind_media(m);
}
