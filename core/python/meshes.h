#pragma once
// Meshes and images as Python objects, and how descriptions carry them.

#include <nanobind/nanobind.h>
#include <nanobind/stl/shared_ptr.h>

#include "python/describe.h"
#include "scene/curves.h"
#include "scene/image.h"
#include "scene/mesh.h"

namespace lajolla {

// Descriptions hold the objects themselves; models share them.
template <class T>
struct DescribedObject {
    static bool read(nb::handle source, std::shared_ptr<const T> &value) {
        std::shared_ptr<T> object;
        if (!nb::try_cast(source, object)) return false;
        value = std::move(object);
        return value != nullptr;
    }
    static nb::object write(const std::shared_ptr<const T> &) { return nb::none(); }
};

template <>
struct Described<std::shared_ptr<const Mesh>> : DescribedObject<Mesh> {
    static constexpr const char *type = "mesh", *expected = "a Mesh";
};

template <>
struct Described<std::shared_ptr<const CurveSet>> : DescribedObject<CurveSet> {
    static constexpr const char *type = "curves", *expected = "Curves";
};

template <>
struct Described<std::shared_ptr<const Image>> : DescribedObject<Image> {
    static constexpr const char *type = "image", *expected = "an Image";
};

void bind_meshes(nb::module_ &m);

} // namespace lajolla
