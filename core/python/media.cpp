#include "python/media.h"

#include <nanobind/ndarray.h>

#include "python/lists.h"

namespace lajolla {

namespace {

using namespace nb::literals;
using Voxels = nb::ndarray<nb::ro, nb::c_contig, nb::device::cpu>;

template <class T>
std::vector<T> values_of(const Voxels &voxels) {
    const auto *first = static_cast<const T *>(voxels.data());
    std::vector<T> values(first, first + voxels.size());
    if constexpr (!std::is_integral_v<T>)
        if (!std::all_of(values.begin(), values.end(),
                         [](T v) { return std::isfinite(static_cast<float>(v)); }))
            throw std::invalid_argument("voxels must be finite");
    return values;
}

std::shared_ptr<Grid> make_grid(const Voxels &voxels) {
    const std::size_t channels = voxels.ndim() == 4 ? voxels.shape(3) : 1;
    if ((voxels.ndim() != 3 && voxels.ndim() != 4) || voxels.size() == 0 ||
        (channels != 1 && channels != 3 && channels != 6))
        throw std::invalid_argument("voxels must have the shape (depth, height, width[, 1, 3 or 6])");
    auto grid = std::make_shared<Grid>();
    grid->depth = static_cast<std::uint32_t>(voxels.shape(0));
    grid->height = static_cast<std::uint32_t>(voxels.shape(1));
    grid->width = static_cast<std::uint32_t>(voxels.shape(2));
    if (std::max({voxels.shape(0), voxels.shape(1), voxels.shape(2)}) > (1u << 20))
        throw std::invalid_argument("a grid has at most a million voxels along an axis");
    grid->channels = static_cast<std::uint32_t>(channels);
    const auto type = voxels.dtype();
    if (type == nb::dtype<std::uint8_t>()) grid->values = values_of<std::uint8_t>(voxels);
    else if (type == nb::dtype<float>()) grid->values = values_of<float>(voxels);
    else if (type.code == static_cast<std::uint8_t>(nb::dlpack::dtype_code::Float) && type.bits == 16)
        grid->values = values_of<Grid::Half>(voxels);
    else throw std::invalid_argument("voxels must be uint8, float16 or float32");
    return grid;
}

template <class T>
void check_handle(const Volume<T> &volume, const Media &media, const std::string &where) {
    if (volume.id >= static_cast<std::int64_t>(media.volumes().size()))
        throw DescriptionError(where + ": there is no volume " + std::to_string(volume.id));
}
void check_handle(PhaseId phase, const Media &media, const std::string &where) {
    if (phase.id >= static_cast<std::int64_t>(media.phases().size()))
        throw DescriptionError(where + ": there is no phase function " + std::to_string(phase.id) +
                               " before this");
}

// Every volume and phase function that a model refers to must be there already.
template <class Variant>
void check_handles(const Variant &variant, const Media &media, const std::string &where) {
    match(variant, [&](const auto &model) {
        for_each_field<std::decay_t<decltype(model)>>([&](const auto &field) {
            if constexpr (requires { (model.*field.member).id; })
                check_handle(model.*field.member, media, where + "." + field.name);
        });
    });
}

} // namespace

bool Described<std::vector<float>>::read(nb::handle source, std::vector<float> &value) {
    const Py_ssize_t size = PySequence_Check(source.ptr()) ? PySequence_Size(source.ptr()) : -1;
    PyErr_Clear();
    if (size < 0 || nb::isinstance<nb::str>(source)) return false;
    value.assign(static_cast<std::size_t>(size), 0);
    for (Py_ssize_t i = 0; i < size; ++i) {
        const nb::object item = nb::steal(PySequence_GetItem(source.ptr(), i));
        PyErr_Clear();
        if (!item.is_valid() || !Described<float>::read(item, value[static_cast<std::size_t>(i)]))
            return false;
    }
    return true;
}
nb::object Described<std::vector<float>>::write(const std::vector<float> &value) {
    nb::list numbers;
    for (const float v : value) numbers.append(Described<float>::write(v));
    return numbers;
}

bool Described<SymmetricMatrix>::read(nb::handle source, SymmetricMatrix &value) {
    std::vector<float> v;
    if (!Described<std::vector<float>>::read(source, v) || v.size() != 6) return false;
    value = {v[0], v[1], v[2], v[3], v[4], v[5]};
    return true;
}
nb::object Described<SymmetricMatrix>::write(const SymmetricMatrix &m) {
    return Described<std::vector<float>>::write({m.xx, m.yy, m.zz, m.xy, m.xz, m.yz});
}

Media read_media(const nb::dict &description) {
    Media media;
    const auto add = [&](auto model, const std::string &where) {
        check_handles(model, media, where);
        try {
            media.add(std::move(model));
        } catch (const std::invalid_argument &error) {
            throw DescriptionError(where + ": " + error.what());
        }
    };
    for_each_entry(description, "volumes", [&](const nb::dict &entry, const std::string &where) {
        media.add(variant_from<VolumeModel>(entry, where));
    });
    for_each_entry(description, "phases", [&](const nb::dict &entry, const std::string &where) {
        add(variant_from<Phase>(entry, where), where);
    });
    for_each_entry(description, "media", [&](const nb::dict &entry, const std::string &where) {
        add(variant_from<Medium>(entry, where), where);
    });
    return media;
}

void bind_grids(nb::module_ &m) {
    nb::class_<Grid>(m, "Grid", "Voxels of a volume.")
        .def(nb::new_(&make_grid), "voxels"_a,
             "voxels (depth, height, width[, 1, 3 or 6]) of uint8, float16 or float32, kept as they are; 255 "
             "means 1.")
        .def_ro("width", &Grid::width)
        .def_ro("height", &Grid::height)
        .def_ro("depth", &Grid::depth)
        .def_ro("channels", &Grid::channels);
}

} // namespace lajolla
