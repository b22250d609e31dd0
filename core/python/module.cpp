#include <nanobind/nanobind.h>

#include "python/describe.h"
#include "python/statistics.h"
#include "scatter/bsdfs.h"

namespace nb = nanobind;

namespace {

nb::dict schema() {
    nb::dict kinds;
    kinds["bsdf"] = lajolla::schema_of_list<lajolla::Bsdf>();
    return kinds;
}

} // namespace

NB_MODULE(_core, m) {
    m.doc() = "The renderer's core.";
    nb::exception<lajolla::DescriptionError>(m, "DescriptionError", PyExc_ValueError).doc() =
        "A description that does not fit its model.";
    m.def("schema", &schema,
          "Every model and its fields: {kind: {name: {'doc': str, 'fields': [{'name', 'type', 'default', "
          "'minimum', "
          "'maximum', 'unit', 'choices', 'doc'}]}}}.");
    lajolla::bind_statistics(m);
}
