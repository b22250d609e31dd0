// Rays without shading: recorded ones for bench/limit, and given ones for bench/rays.

#include "python/testing/bindings.h"

#include <nanobind/stl/unique_ptr.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <memory>

#include "engine/renderable.h"
#include "python/arrays.h"
#include "transport/tiles.h"

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

// Seconds that Embree takes for rays one by one, without any more work.
double trace_seconds(const RenderableScene &self, const Rows<3> &origins, const Rows<3> &directions,
                     bool occlusion, int threads) {
    require_one_or(origins.shape(0), directions.shape(0), "origins");
    const nb::gil_scoped_release release;
    const Scene &scene = *self.scene;
    const std::size_t count = directions.shape(0);
    constexpr std::size_t block = 1024;
    const auto start = std::chrono::steady_clock::now();
    std::atomic<std::uint64_t> hits{0}; // so that no query can be left out
    for_each_index((count + block - 1) / block, threads, [&](std::size_t task) {
        std::uint64_t found = 0;
        for (std::size_t i = task * block; i < std::min((task + 1) * block, count); ++i) {
            const Ray<float> ray{triple(origins, i), triple(directions, i)};
            found += occlusion ? scene.accel().occluded(ray) : scene.accel().closest(ray).has_value();
        }
        hits += found;
    });
    return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
}

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
    m.def("trace_seconds", &trace_seconds, "scene"_a, "origins"_a, "directions"_a, "occlusion"_a,
          "threads"_a = 0,
          "Seconds that the ray tracer alone takes for rays (1 or N, 3), (N, 3), for bench/rays.");
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
