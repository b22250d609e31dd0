// Renders and their sums.

#include "python/bindings.h"

#include <nanobind/ndarray.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/pair.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/unique_ptr.h>
#include <nanobind/stl/vector.h>

#include <algorithm>
#include <memory>

#include "engine/accumulator.h"
#include "engine/renderable.h"
#include "python/arrays.h"

namespace lajolla {

namespace {

using namespace nb::literals;

template <class T>
using Array = nb::ndarray<const T, nb::c_contig, nb::device::cpu>;

// The sums of rows of pixels.
struct PixelSums {
    std::size_t rows, width, channels;
    Sums sums;
};

std::unique_ptr<PixelSums> make_sums(const Array<std::int64_t> &digits, const Array<std::int8_t> &places) {
    if (digits.ndim() != 4 || digits.shape(3) != 2 || places.ndim() != 3 ||
        !std::ranges::equal(std::span(places.shape_ptr(), 3), std::span(digits.shape_ptr(), 3)))
        throw std::invalid_argument(
            "digits must be (rows, width, channels, 2), places (rows, width, channels)");
    const std::span pairs(digits.data(), digits.size());
    std::vector<Sums::Digits> sums(places.size());
    for (std::size_t i = 0; i < sums.size(); ++i) sums[i] = {pairs[2 * i], pairs[2 * i + 1]};
    const std::span<const std::int8_t> given(places.data(), places.size());
    if (!std::ranges::all_of(given,
                             [](std::int8_t place) { return place >= 0 && place <= Sums::highest_place; }))
        throw std::invalid_argument("a place is out of range");
    return std::make_unique<PixelSums>(
        PixelSums{places.shape(0), places.shape(1), places.shape(2), Sums(sums, given)});
}

nb::object digits_of(const PixelSums &self) {
    std::vector<std::int64_t> pairs;
    pairs.reserve(2 * self.sums.size());
    for (const auto &[high, low] : self.sums.digits()) pairs.push_back(high), pairs.push_back(low);
    return array_of(std::move(pairs), {self.rows, self.width, self.channels, 2});
}

nb::object places_of(const PixelSums &self) {
    const auto places = self.sums.places();
    return array_of(std::vector<std::int8_t>(places.begin(), places.end()),
                    {self.rows, self.width, self.channels});
}

void add_sums(PixelSums &self, std::size_t first_row, const PixelSums &other) {
    if (other.width != self.width || other.channels != self.channels || first_row > self.rows ||
        other.rows > self.rows - first_row)
        throw std::invalid_argument("the sums are of a picture of another size");
    self.sums.add(first_row * self.width * self.channels, other.sums, 0, other.sums.size());
}

nb::object means_of(const PixelSums &self, const Array<std::uint32_t> &counts) {
    if (counts.ndim() != 2 || counts.shape(0) != self.rows || counts.shape(1) != self.width)
        throw std::invalid_argument("counts must be (rows, width)");
    return array_of(means(self.sums, self.channels, std::span(counts.data(), counts.size())),
                    {self.rows, self.width, self.channels});
}

std::unique_ptr<PixelSums> sums_of(const Accumulator &render, Sums sums) {
    return std::make_unique<PixelSums>(
        PixelSums{render.height(), render.width(), render.channels(), std::move(sums)});
}

nb::object image_of(const Accumulator &render) {
    return array_of(render.image(), {render.height(), render.width(), render.channels()});
}

nb::object counts_of(const Counts &counts) {
    const auto values = counts.values();
    return array_of(std::vector<std::uint32_t>(values.begin(), values.end()),
                    {counts.rows(), counts.columns(), 2});
}

nb::object rays_of(const Accumulator &render, std::vector<std::uint64_t> rays) {
    return array_of(std::move(rays), {render.tile_rows(), render.tile_columns()});
}

using SampleList = std::vector<std::tuple<std::uint32_t, std::uint32_t, std::uint32_t>>; // x, y, sample
SampleList tuples(const std::vector<SampleId> &samples) {
    SampleList result;
    for (const SampleId &id : samples) result.emplace_back(id.x, id.y, id.index);
    return result;
}

bool advance_halves(Accumulator &render, const Array<std::uint32_t> &samples, int threads, bool one_lane) {
    const nb::gil_scoped_release release;
    return render.advance(std::span(samples.data(), samples.size()), threads, one_lane);
}

RenderState make_state(const PixelSums &sums, Counts pixel_counts, const Array<std::uint32_t> &counts,
                       const Array<std::uint64_t> &rays, std::uint64_t nonfinite,
                       const SampleList &nonfinite_list) {
    RenderState state{
        sums.sums, std::move(pixel_counts), {rays.data(), rays.data() + rays.size()}, nonfinite, {}};
    if (counts.size() != state.counts.values().size())
        throw std::invalid_argument("the samples are of a picture of another size");
    std::copy_n(counts.data(), counts.size(), state.counts.values().begin());
    for (const auto &[x, y, index] : nonfinite_list) state.nonfinite_list.push_back({x, y, index});
    return state;
}

void restore(Accumulator &render, const PixelSums &sums, const Array<std::uint32_t> &counts,
             const Array<std::uint64_t> &rays, std::uint64_t nonfinite, const SampleList &nonfinite_list) {
    render.restore(
        make_state(sums, render.get(&RenderState::counts), counts, rays, nonfinite, nonfinite_list));
}

void add(Accumulator &render, std::size_t first_tile_row, const PixelSums &sums,
         const Array<std::uint32_t> &counts, const Array<std::uint64_t> &rays, std::uint64_t nonfinite,
         const SampleList &nonfinite_list) {
    if (sums.width != render.width() || sums.channels != render.channels())
        throw std::invalid_argument("the samples are of a picture of another size");
    Film part;
    part.crop_width = static_cast<int>(sums.width), part.crop_height = static_cast<int>(sums.rows);
    render.add(make_state(sums, Counts(part), counts, rays, nonfinite, nonfinite_list), first_tile_row);
}

std::unique_ptr<Accumulator> make_render(const RenderableScene &scene, std::optional<std::uint32_t> seed,
                                         std::uint32_t first_sample,
                                         std::optional<std::pair<std::size_t, std::size_t>> tile_rows) {
    std::optional<TileRows> rows;
    if (tile_rows) rows = TileRows{tile_rows->first, tile_rows->second};
    return std::make_unique<Accumulator>(scene, seed, first_sample, rows);
}

} // namespace

void bind_render(nb::module_ &m) {
    nb::class_<PixelSums>(
        m, "Sums",
        "Sums of samples, for the channels of rows of pixels. They do not depend on the order in "
        "which samples and other sums are added.")
        .def(nb::new_(&make_sums), "digits"_a, "places"_a,
             "digits int64 (rows, width, channels, 2) and places int8 (rows, width, channels) of other sums.")
        .def_prop_ro("digits", &digits_of, nb::sig("def digits(self) -> numpy.typing.NDArray[numpy.int64]"))
        .def_prop_ro("places", &places_of, nb::sig("def places(self) -> numpy.typing.NDArray[numpy.int8]"))
        .def("add", &add_sums, "first_row"_a, "other"_a, "Adds other sums to the rows from first_row on.")
        .def("means", &means_of, "counts"_a,
             nb::sig("def means(self, counts: numpy.typing.NDArray[numpy.uint32]) -> "
                     "numpy.typing.NDArray[numpy.float32]"),
             "Means: float32 (rows, width, channels), of sums of counts (rows, width) samples.");

    nb::class_<Accumulator>(m, "Render", "The running mean of a scene's samples.")
        .def(nb::new_(&make_render), "scene"_a, "seed"_a = nb::none(), "first_sample"_a = 0,
             "tile_rows"_a = nb::none(), nb::keep_alive<0, 2>(),
             "Each pixel takes its samples in order, beginning with `first_sample`. With tile_rows = (first, "
             "end), this is a render of these rows of tiles, and its arrays have only their pixels.")
        .def("advance", nb::overload_cast<std::uint32_t, int, bool>(&Accumulator::advance), "samples"_a,
             "threads"_a = 0, "one_lane"_a = false, nb::call_guard<nb::gil_scoped_release>(),
             "Adds samples until every pixel has at least `samples`. threads = 0 uses them all; one_lane "
             "follows "
             "one path after the other, for the same bits. Returns False if cancel() was called meanwhile: "
             "tiles "
             "that were not finished are then as before.")
        .def("advance", &advance_halves, "samples"_a, "threads"_a = 0, "one_lane"_a = false,
             "The same, with a number for each half of each cell: uint32 like `counts`.")
        .def("cancel", &Accumulator::cancel,
             "Stops advance(), from another thread; or the next one, if none is running.")
        .def("resume", &Accumulator::resume, "Withdraws a cancel() that came after the end of advance().")
        .def_prop_ro("progress", &Accumulator::progress, "Finished fraction of the running advance().")
        .def("image", &image_of, nb::sig("def image(self) -> numpy.typing.NDArray[numpy.float32]"),
             "Mean of the samples: float32 (height, width, 3 + number of channels); the first three are "
             "linear "
             "sRGB.")
        .def(
            "sums", [](const Accumulator &self) { return sums_of(self, self.get(&RenderState::sums)); },
            "A copy of the sums of the samples.")
        .def(
            "state",
            [](const Accumulator &self) {
                RenderState state = self.state();
                return std::tuple(sums_of(self, std::move(state.sums)), counts_of(state.counts),
                                  rays_of(self, std::move(state.rays)), state.nonfinite,
                                  tuples(state.nonfinite_list));
            },
            nb::sig("def state(self) -> tuple[Sums, numpy.typing.NDArray[numpy.uint32], "
                    "numpy.typing.NDArray[numpy.uint64], int, list[tuple[int, int, int]]]"),
            "Sums, counts, rays, nonfinite and nonfinite_list of one moment; for restore().")
        .def_prop_ro(
            "counts", [](const Accumulator &self) { return counts_of(self.get(&RenderState::counts)); },
            nb::sig("def counts(self) -> numpy.typing.NDArray[numpy.uint32]"),
            "Samples of each pixel in the halves of cells: uint32 (cell rows, cell columns, 2). Cells are 8 "
            "pixels wide "
            "and high; pixels whose x + y on the film is even belong to the first half.")
        .def(
            "pixel_counts",
            [](const Accumulator &self) {
                return array_of(self.pixel_counts(), {self.height(), self.width()});
            },
            nb::sig("def pixel_counts(self) -> numpy.typing.NDArray[numpy.uint32]"),
            "Samples of each pixel: uint32 (height, width).")
        .def("restore", &restore, "sums"_a, "counts"_a, "rays"_a, "nonfinite"_a, "nonfinite_list"_a,
             "Replaces all samples by those of another render of this scene.")
        .def("add", &add, "first_tile_row"_a, "sums"_a, "counts"_a, "rays"_a, "nonfinite"_a,
             "nonfinite_list"_a,
             "Adds samples of some rows of tiles, by another render of this scene: `counts` for each half of "
             "a cell, which come after those that it has.")
        .def_prop_ro("samples", &Accumulator::samples, "Samples that every pixel has, at least.")
        .def_prop_ro(
            "rays", [](const Accumulator &self) { return rays_of(self, self.get(&RenderState::rays)); },
            nb::sig("def rays(self) -> numpy.typing.NDArray[numpy.uint64]"),
            "Rays traced so far, in tiles of 16 x 16 pixels: uint64 (tile rows, tile columns).")
        .def_prop_ro(
            "nonfinite", [](const Accumulator &self) { return self.get(&RenderState::nonfinite); },
            "Samples that were NaN or infinite; they count as black.")
        .def_prop_ro(
            "nonfinite_list",
            [](const Accumulator &self) { return tuples(self.get(&RenderState::nonfinite_list)); },
            "(x, y, sample) of the first of them.");
}

} // namespace lajolla
