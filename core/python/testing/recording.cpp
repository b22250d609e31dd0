// Recorded rays, for bench/limit.

#include "python/testing/bindings.h"

#include <nanobind/stl/unique_ptr.h>

#include <memory>

#include "engine/renderable.h"

namespace lajolla {

namespace {

using namespace nb::literals;

struct RayRecording {
    const RenderableScene &scene;
    Recording rays;
    std::size_t size() const {
        std::size_t sum = 0;
        for (const auto &tile : rays) sum += tile.size();
        return sum;
    }
};

} // namespace

void bind_recording(nb::module_ &m) {
    nb::class_<RayRecording>(m, "RayRecording", "The rays of a render, to be traced again without shading.")
        .def("__len__", &RayRecording::size)
        .def(
            "replay",
            [](const RayRecording &self, int threads) {
                return replay_seconds(*self.scene.scene, self.rays, threads);
            },
            "threads"_a = 0, nb::call_guard<nb::gil_scoped_release>(),
            "Seconds that the ray tracer alone takes.");
    m.def(
        "record_rays",
        [](const RenderableScene &scene, std::uint32_t count, int threads) {
            const SampleRanges ranges(scene.scene->film(), {0, count});
            return std::make_unique<RayRecording>(
                scene, record(*scene.scene, scene.output, {scene.sequence, scene.seed, ranges, threads}));
        },
        "scene"_a, "count"_a, "threads"_a = 0, nb::keep_alive<0, 1>(),
        nb::call_guard<nb::gil_scoped_release>(), "Renders `count` samples per pixel and keeps every ray.");
}

} // namespace lajolla
