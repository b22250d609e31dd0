#include "python/bindings.h"

#include <nanobind/ndarray.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/shared_ptr.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/vector.h>

#include <memory>

#include "engine/renderable.h"
#include "python/values.h"

namespace lajolla {

namespace {

using namespace nb::literals;

using Numbers = nb::ndarray<nb::ro, nb::c_contig, nb::device::cpu>;

std::shared_ptr<EntryColumn> make_column(const Numbers &rows) {
    if (rows.ndim() == 0 || rows.size() == 0) throw std::invalid_argument("a column needs rows");
    auto column = std::make_shared<EntryColumn>();
    column->rows = rows.shape(0);
    for (std::size_t axis = 1; axis < rows.ndim(); ++axis) column->shape.push_back(rows.shape(axis));
    const auto copy = [&]<class T>(T) {
        if (rows.dtype() != nb::dtype<T>()) return false;
        const auto *first = static_cast<const T *>(rows.data());
        column->numbers.assign(first, first + rows.size());
        return true;
    };
    column->integer = copy(std::int64_t{});
    if (!column->integer && !copy(double{}))
        throw std::invalid_argument("the numbers of a column must be float64 or int64");
    return column;
}

// Its rows, as a view of the column's memory, and whether they are whole numbers.
nb::tuple column_state(nb::handle self) {
    const auto &column = nb::cast<const EntryColumn &>(self);
    std::vector<std::size_t> shape{column.rows};
    shape.insert(shape.end(), column.shape.begin(), column.shape.end());
    const nb::ndarray<nb::numpy, const double> rows(column.numbers.data(), shape.size(), shape.data(), self);
    return nb::make_tuple(nb::cast(rows, nb::rv_policy::reference), column.integer);
}

std::shared_ptr<RenderableScene> make_scene(const nb::dict &description) {
    return with_dict(description, [](const Dict &dict) {
        const nb::gil_scoped_release release;
        return build_scene(dict);
    });
}

std::tuple<float, float, float> replay_sample(const RenderableScene &self, std::uint32_t seed,
                                              std::uint32_t x, std::uint32_t y, std::uint32_t sample) {
    Tracer tracer(self.scene->accel());
    const Spectrum value =
        sample_radiance(*self.scene, self.output.integrator, self.sequence, seed, {x, y, sample}, tracer);
    return {value.x, value.y, value.z};
}

} // namespace

void bind_scene(nb::module_ &m) {
    m.def(
        "transmissive", [](const nb::dict &bsdf) { return with_dict(bsdf, transmissive); }, "bsdf"_a,
        "Whether light passes through a surface with the BSDF of a description; with columns, through any.");
    nb::class_<EntryColumn>(
        m, "Column",
        "Numbers of several entries of a description's list: one that holds columns stands "
        "for as many entries as these have rows.")
        .def(nb::new_(&make_column), "rows"_a,
             "rows (count, ...) of float64 or int64: numbers, triples or matrices; they are copied.")
        .def("__len__", [](const EntryColumn &column) { return column.rows; })
        .def(
            "row",
            [](const EntryColumn &column, std::size_t i) {
                if (i >= column.rows) throw nb::index_error("there is no such row");
                return object_of(column.row(i));
            },
            "index"_a, "The value of one of the entries.")
        .def("__getstate__", &column_state)
        .def("__setstate__", [](EntryColumn &column, const std::tuple<Numbers, bool> &state) {
            const auto &[rows, integer] = state;
            new (&column) EntryColumn(std::move(*make_column(rows)));
            column.integer = integer;
        });
    nb::class_<RenderableScene>(m, "Scene", "A scene that can be rendered; it never changes.")
        .def(nb::new_(&make_scene), "description"_a,
             "Builds the scene that a description holds. Raises DescriptionError.")
        .def(
            "with_output",
            [](const RenderableScene &self, const nb::dict &description) {
                return with_dict(description, [&](const Dict &dict) { return with_output(self, dict); });
            },
            "description"_a,
            "The same scene with another output, which costs nothing: the entries integrator, "
            "other_integrators and channels of a description. Raises DescriptionError.")
        .def(
            "with_changes",
            [](const RenderableScene &self, const nb::dict &changes) {
                return with_dict(changes, [&](const Dict &dict) {
                    const nb::gil_scoped_release release;
                    return with_changes(self, dict);
                });
            },
            "changes"_a,
            "The same scene with other entries, {\"bsdfs[3]\": {...}, \"sensor\": {...}}; all that does not "
            "depend on them is shared. Textures, bsdfs, adapters and materials can be added as the entry "
            "after the last. The entry of a shape without \"type\" changes only what the shape refers to. "
            "None: the scene has to be built anew, because it moves to another origin. Raises "
            "DescriptionError.")
        .def_prop_ro(
            "width", [](const RenderableScene &s) { return s.scene->film().crop_width; },
            "of the crop window")
        .def_prop_ro(
            "height", [](const RenderableScene &s) { return s.scene->film().crop_height; },
            "of the crop window")
        .def_prop_ro(
            "crop_offset",
            [](const RenderableScene &s) {
                return std::tuple(s.scene->film().crop_offset_x, s.scene->film().crop_offset_y);
            },
            "position (x, y) of the crop window on the film")
        .def_prop_ro(
            "channels",
            [](const RenderableScene &s) {
                std::vector<std::string> labels;
                for (const Channel &channel : s.output.channels) labels.push_back(channel.label);
                return labels;
            },
            "labels of the channels that are rendered beside red, green and blue")
        .def_ro("sample_count", &RenderableScene::sample_count, "samples per pixel that the scene asks for")
        .def_ro("seed", &RenderableScene::seed, "seed that the scene asks for")
        .def(
            "summary", [](const RenderableScene &s) { return object_of(summary(s)); },
            "Counts of what is in it, and its size in bytes.");

    m.def("sample_radiance", &replay_sample, "scene"_a, "seed"_a, "x"_a, "y"_a, "sample"_a,
          "Radiance (r, g, b) of one sample of one pixel; x and y count over the whole film.");
}

} // namespace lajolla
