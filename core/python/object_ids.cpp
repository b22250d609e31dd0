#include "python/bindings.h"

#include <nanobind/ndarray.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/vector.h>

#include <tuple>

#include "engine/renderable.h"
#include "python/arrays.h"
#include "transport/object_ids.h"

namespace lajolla {

namespace {

using namespace nb::literals;

using Numbers = nb::ndarray<const std::int32_t, nb::ndim<1>, nb::c_contig, nb::device::cpu>;
using Counted = std::vector<std::tuple<std::string, Numbers>>;

std::size_t objects_of(const SceneParts &parts, ObjectKind kind) {
    return kind == ObjectKind::shape      ? parts.shapes.size()
           : kind == ObjectKind::material ? parts.materials.size()
                                          : parts.instances.size();
}

std::vector<CountedObjects> counted_objects(const Scene &scene, const Counted &counted) {
    std::vector<CountedObjects> result;
    for (const auto &[name, numbers] : counted) {
        constexpr auto names = choices(ObjectKind{});
        const auto found = std::ranges::find(names, std::string_view(name));
        if (found == names.end()) throw std::invalid_argument("unknown kind of objects: " + name);
        const auto kind = static_cast<ObjectKind>(found - names.begin());
        if (numbers.size() != objects_of(scene.parts(), kind))
            throw std::invalid_argument("one number for each " + name + " expected");
        result.push_back({kind, {numbers.data(), numbers.size()}});
    }
    return result;
}

nb::object centre_ids(const RenderableScene &scene, int threads) {
    static_assert(sizeof(ObjectIds) == 4 * sizeof(std::int32_t));
    std::vector<std::int32_t> values;
    {
        const nb::gil_scoped_release release;
        for (const ObjectIds &ids : ids_at_centres(*scene.scene, scene.output.integrator, threads))
            values.insert(values.end(), {ids.shape, ids.material, ids.instance, ids.primitive});
    }
    const Film &film = scene.scene->film();
    return array_of(std::move(values), {static_cast<std::size_t>(film.crop_height),
                                        static_cast<std::size_t>(film.crop_width), 4});
}

nb::list covering_objects(const RenderableScene &scene, const Counted &counted, std::uint32_t seed,
                          std::uint32_t first_sample, std::uint32_t count, std::size_t ranks, int first_row,
                          int end_row, int threads) {
    const Film &film = scene.scene->film();
    if (first_row < 0 || end_row < first_row || end_row > film.crop_height)
        throw std::invalid_argument("there are no such rows");
    const auto objects = counted_objects(*scene.scene, counted);
    std::vector<RankedObjects> found;
    {
        const nb::gil_scoped_release release;
        found = object_coverage(*scene.scene, scene.output.integrator, objects, scene.sequence, seed,
                                {first_sample, first_sample + count}, ranks, {first_row, end_row}, threads);
    }
    const auto rows = static_cast<std::size_t>(end_row - first_row),
               columns = static_cast<std::size_t>(film.crop_width);
    nb::list result;
    for (RankedObjects &ranked : found)
        result.append(nb::make_tuple(array_of(std::move(ranked.numbers), {rows, columns, ranks}),
                                     array_of(std::move(ranked.coverage), {rows, columns, ranks})));
    return result;
}

} // namespace

void bind_object_ids(nb::module_ &m) {
    m.def("ids_at_centres", &centre_ids, "scene"_a, "threads"_a = 0,
          nb::sig("def ids_at_centres(scene: Scene, threads: int = 0) -> "
                  "numpy.typing.NDArray[numpy.int32]"),
          "What the ray through each pixel's centre sees: int32 (height, width, 4), the positions of the "
          "shape, "
          "its material and the instance in the description's lists, and the primitive of the shape; -1 for "
          "none.");
    m.def(
        "object_coverage", &covering_objects, "scene"_a, "counted"_a, "seed"_a, "first_sample"_a, "count"_a,
        "ranks"_a, "first_row"_a, "end_row"_a, "threads"_a = 0,
        nb::sig(
            "def object_coverage(scene: Scene, counted: "
            "collections.abc.Sequence[tuple[str, numpy.typing.NDArray[numpy.int32]]], seed: int, "
            "first_sample: int, count: int, ranks: int, first_row: int, end_row: int, threads: int = 0) -> "
            "list[tuple[numpy.typing.NDArray[numpy.int32], numpy.typing.NDArray[numpy.float32]]]"),
        "The objects that cover each pixel of some rows most, as `count` samples from first_sample on see "
        "them.\n\n"
        "`counted` holds the kinds to count (\"shape\", \"material\", \"instance\"), each with a number "
        "above "
        "zero for every object in the description's list; objects with the same number count as one. "
        "Returns for each kind the numbers and the coverages, both (rows, width, ranks), in falling order of "
        "coverage and zero where there are no more.");
}

} // namespace lajolla
