#pragma once
// How descriptions carry a BSDF inside another.

#include "python/describe.h"
#include "python/measurement.h"
#include "scatter/bsdfs.h"

namespace lajolla {

// A BSDF inside another.
template <>
struct Described<BareBsdf> {
    static constexpr const char *type = "bsdf", *expected = "a bsdf";
    static bool read(nb::handle source, BareBsdf &value) {
        if (!nb::isinstance<nb::dict>(source)) return false;
        value = variant_from<BareBsdf>(nb::cast<nb::dict>(source), "base");
        return true;
    }
    static nb::object write(const BareBsdf &value) {
        nb::dict entry;
        entry["type"] = match(value, [](const auto &model) { return std::decay_t<decltype(model)>::name; });
        return entry;
    }
};

} // namespace lajolla
