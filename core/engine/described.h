#pragma once
// How descriptions carry what models have beside numbers and textures: objects, volumes, phase functions and
// other materials.

#include <memory>
#include <vector>

#include "engine/describe.h"
#include "geometry/curves.h"
#include "geometry/mesh.h"
#include "images/face_images.h"
#include "images/image.h"
#include "materials/material.h"
#include "media/medium.h"
#include "scatter/bsdfs.h"
#include "scatter/measured.h"

namespace lajolla {

// Descriptions hold the objects themselves; models share them.
template <class T>
struct DescribedObject {
    static bool read(const Value &source, std::shared_ptr<const T> &value) {
        const Object *const object = source.get_if<Object>();
        value = object ? object->as<T>() : nullptr;
        return value != nullptr;
    }
    static Value write(const std::shared_ptr<const T> &) { return {}; }
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

template <>
struct Described<std::shared_ptr<const FaceImages>> : DescribedObject<FaceImages> {
    static constexpr const char *type = "face_images", *expected = "FaceImages";
};

template <>
struct Described<std::shared_ptr<const Grid>> : DescribedObject<Grid> {
    static constexpr const char *type = "grid", *expected = "a Grid";
};

template <>
struct Described<std::shared_ptr<const Measurement>> : DescribedObject<Measurement> {
    static constexpr const char *type = "measurement", *expected = "a Measurement, or None";
    static bool read(const Value &source, std::shared_ptr<const Measurement> &value) {
        return source.is_nothing() || DescribedObject<Measurement>::read(source, value);
    }
};

template <>
struct Described<std::vector<float>> {
    static constexpr const char *type = "floats", *expected = "a list of numbers";
    static bool read(const Value &source, std::vector<float> &value);
    static Value write(const std::vector<float> &value);
};

template <>
struct Described<SymmetricMatrix> {
    static constexpr const char *type = "matrix", *expected = "six numbers";
    static bool read(const Value &source, SymmetricMatrix &value);
    static Value write(const SymmetricMatrix &value);
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
    static bool read(const Value &source, Volume<T> &value) {
        return read_handle_or_constant(source, "volume", value);
    }
    static Value write(const Volume<T> &value) { return Described<T>::write(value.constant); }
};

template <>
struct Described<PhaseId> {
    static constexpr const char *type = "phase", *expected = "the index of a phase function, or -1";
    static bool read(const Value &source, PhaseId &value) {
        const auto index = read_integer(source, -1, std::numeric_limits<std::int32_t>::max());
        value.id = static_cast<std::int32_t>(index.value_or(-1));
        return index.has_value();
    }
    static Value write(PhaseId value) { return value.id; }
};

// An index of a BSDF, -1 for black, or {"adapter": index}.
template <>
struct Described<MaterialId> {
    static constexpr const char *type = "material", *expected = "an index or {'adapter': index}";
    static bool read(const Value &source, MaterialId &value) {
        const auto adapter = read_handle(source, "adapter");
        value.adapter = adapter.value_or(-1);
        value.bsdf = -1;
        return adapter || Described<std::int32_t>::read(source, value.bsdf);
    }
    static Value write(MaterialId value) { return value.bsdf; }
};

// A BSDF inside another.
template <>
struct Described<BareBsdf> {
    static constexpr const char *type = "bsdf", *expected = "a bsdf";
    static bool read(const Value &source, BareBsdf &value) {
        const Dict *const dict = source.get_if<Dict>();
        if (dict) value = variant_from<BareBsdf>(*dict, "base");
        return dict != nullptr;
    }
    static Value write(const BareBsdf &value) {
        return Dict{
            {"type", match(value, [](const auto &model) { return std::decay_t<decltype(model)>::name; })}};
    }
};

} // namespace lajolla
