#pragma once
// Voxel grids as Python objects, and how descriptions carry what media consist of.

#include <nanobind/nanobind.h>

#include <vector>

#include "python/meshes.h"
#include "scene/medium.h"

namespace lajolla {

template <>
struct Described<std::shared_ptr<const Grid>> : DescribedObject<Grid> {
    static constexpr const char *type = "grid", *expected = "a Grid";
};

template <>
struct Described<std::vector<float>> {
    static constexpr const char *type = "floats", *expected = "a list of numbers";
    static bool read(nb::handle source, std::vector<float> &value);
    static nb::object write(const std::vector<float> &value);
};

template <>
struct Described<SymmetricMatrix> {
    static constexpr const char *type = "matrix", *expected = "six numbers";
    static bool read(nb::handle source, SymmetricMatrix &value);
    static nb::object write(const SymmetricMatrix &value);
};

template <class T>
struct Described<Volume<T>> {
    static constexpr bool scalar = std::same_as<T, float>, matrix = std::same_as<T, SymmetricMatrix>;
    static constexpr const char *type = scalar   ? "volume_float"
                                        : matrix ? "volume_matrix"
                                                 : "volume_spectrum";
    static constexpr const char *expected = scalar   ? "{'volume': index} or a number"
                                            : matrix ? "{'volume': index} or six numbers"
                                                     : "{'volume': index}, a number or three numbers";
    static bool read(nb::handle source, Volume<T> &value) {
        if (const auto index = read_handle(source, "volume")) {
            value.id = *index;
            return true;
        }
        value.id = -1;
        return Described<T>::read(source, value.constant);
    }
    static nb::object write(const Volume<T> &value) { return Described<T>::write(value.constant); }
};

template <>
struct Described<PhaseId> {
    static constexpr const char *type = "phase", *expected = "the index of a phase function, or -1";
    static bool read(nb::handle source, PhaseId &value) {
        const auto index = read_integer(source, -1, std::numeric_limits<std::int32_t>::max());
        value.id = static_cast<std::int32_t>(index.value_or(-1));
        return index.has_value();
    }
    static nb::object write(PhaseId value) { return nb::int_(value.id); }
};

// The media of a description: its lists "volumes", "phases" and "media". Throws DescriptionError.
Media read_media(const nb::dict &description);

void bind_grids(nb::module_ &m);

} // namespace lajolla
