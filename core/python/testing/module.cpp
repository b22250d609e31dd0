#include "python/testing/bindings.h"

NB_MODULE(_core_testing, m) {
    m.doc() = "What the tests and benchmarks ask of the renderer's core; no part of what is installed.";
    nanobind::module_::import_("lajolla._core"); // binds the scenes and the exceptions that these calls use
    lajolla::bind_statistics(m);
    lajolla::bind_scene_statistics(m);
    lajolla::bind_recording(m);
}
