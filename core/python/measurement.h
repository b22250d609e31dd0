#pragma once
// Measured materials as Python objects, and how descriptions carry them.

#include "python/meshes.h"
#include "scatter/measured.h"

namespace lajolla {

template <>
struct Described<std::shared_ptr<const Measurement>> {
    static constexpr const char *type = "measurement", *expected = "a Measurement, or None";
    static bool read(nb::handle source, std::shared_ptr<const Measurement> &value) {
        return source.is_none() || DescribedObject<Measurement>::read(source, value);
    }
    static nb::object write(const std::shared_ptr<const Measurement> &) { return nb::none(); }
};

void bind_measurements(nb::module_ &m);

} // namespace lajolla
