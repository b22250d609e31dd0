#pragma once
// Between Python descriptions and models: everything here follows from a model's fields(). schema_of() tells
// what a model takes, read_model() and variant_from() build one from a dict and say what is wrong with it.
//
// A type that appears in fields() is known through one trait, Described<T>; meshes, images and the like are
// added by specialising it.

#include <nanobind/nanobind.h>

#include <algorithm>
#include <array>
#include <concepts>
#include <cstdint>
#include <initializer_list>
#include <limits>
#include <optional>
#include <span>
#include <stdexcept>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

#include "base/fields.h"
#include "base/match.h"
#include "base/texture.h"
#include "base/transform.h"
#include "base/vec.h"

namespace lajolla {

namespace nb = nanobind;

// A description that does not fit its model; `_core.DescriptionError`, a ValueError, in Python.
class DescriptionError : public std::runtime_error {
public:
    using std::runtime_error::runtime_error;
};

// "where: expected ..., got <repr>".
[[noreturn]] void throw_unexpected(const std::string &where, const std::string &expected, nb::handle got);

// How descriptions name and carry a T:
//   type      the schema's name for it
//   expected  what messages call it
//   read      from Python; false where the value does not fit
//   write     to Python, such that read() gives it back
template <class T>
struct Described;

template <>
struct Described<float> {
    static constexpr const char *type = "float", *expected = "a number";
    static bool read(nb::handle source, float &value);
    static nb::object write(float value);
};

// Whole numbers in [lowest, highest]; True and False are none.
std::optional<std::int64_t> read_integer(nb::handle source, std::int64_t lowest, std::int64_t highest);

template <std::integral T>
struct Described<T> {
    static constexpr const char *type = "integer", *expected = "an integer";
    static bool read(nb::handle source, T &value) {
        const auto number =
            read_integer(source, std::numeric_limits<T>::lowest(), std::numeric_limits<T>::max());
        value = static_cast<T>(number.value_or(0));
        return number.has_value();
    }
    static nb::object write(T value) { return nb::int_(value); }
};

template <>
struct Described<bool> {
    static constexpr const char *type = "boolean", *expected = "True or False";
    static bool read(nb::handle source, bool &value);
    static nb::object write(bool value) { return nb::bool_(value); }
};

template <>
struct Described<std::string> {
    static constexpr const char *type = "string", *expected = "a string";
    static bool read(nb::handle source, std::string &value);
    static nb::object write(const std::string &value) { return nb::str(value.c_str(), value.size()); }
};

template <>
struct Described<Spectrum> {
    static constexpr const char *type = "spectrum", *expected = "a number or three numbers";
    static bool read(nb::handle source, Spectrum &value);
    static nb::object write(Spectrum value);
};

template <>
struct Described<Vec3f> {
    static constexpr const char *type = "vector", *expected = "three numbers";
    static bool read(nb::handle source, Vec3f &value);
    static nb::object write(Vec3f value);
};

template <>
struct Described<Transform> {
    static constexpr const char *type = "transform", *expected = "a 4x4 matrix of numbers";
    static bool read(nb::handle source, Transform &value);
    static nb::object write(const Transform &value);
};

// The index in {kind: index}, which stands for a texture or a volume of the scene.
std::optional<std::int32_t> read_handle(nb::handle source, const char *kind);

template <class T>
struct Described<Texture<T>> {
    static constexpr bool scalar = std::same_as<T, float>;
    static constexpr const char *type = scalar ? "texture_float" : "texture_spectrum";
    static constexpr const char *expected =
        scalar ? "{'texture': index} or a number" : "{'texture': index}, a number or three numbers";
    static bool read(nb::handle source, Texture<T> &value) {
        if (const auto index = read_handle(source, "texture")) {
            value.id = *index;
            return true;
        }
        value.id = -1;
        return Described<T>::read(source, value.constant);
    }
    static nb::object write(const Texture<T> &value) { return Described<T>::write(value.constant); }
};

template <class T>
concept Choice = std::is_enum_v<T> && requires(T value) { choices(value); };

std::optional<std::size_t> read_choice(nb::handle source, const char *const *names, std::size_t count);

template <Choice T>
struct Described<T> {
    static constexpr const char *type = "choice", *expected = "one of";
    static constexpr auto names = choices(T{});
    static bool read(nb::handle source, T &value) {
        const auto index = read_choice(source, names.data(), names.size());
        value = static_cast<T>(index.value_or(0));
        return index.has_value();
    }
    static nb::object write(T value) { return nb::str(names[static_cast<std::size_t>(value)]); }
};

namespace detail {

// Whether every number of a value is within [low, high]; values without numbers always are.
template <class T>
constexpr bool within(const T &value, double low, double high) {
    if constexpr (std::floating_point<T>) // bounds are rounded as values are: 0.1 is within [0.1, 1]
        return value >= static_cast<T>(low) && value <= static_cast<T>(high);
    else if constexpr (std::integral<T>)
        return static_cast<double>(value) >= low && static_cast<double>(value) <= high;
    else return true;
}
template <class Tag>
constexpr bool within(const Triple<Tag, float> &v, double low, double high) {
    return within(v.x, low, high) && within(v.y, low, high) && within(v.z, low, high);
}
inline bool within(const std::vector<float> &values, double low, double high) {
    return std::all_of(values.begin(), values.end(), [&](float v) { return within(v, low, high); });
}
// Handles of textures and volumes.
template <class T>
    requires requires(const T &handle) { handle.is_constant(); }
constexpr bool within(const T &handle, double low, double high) {
    return !handle.is_constant() || within(handle.constant, low, high);
}

// What a type does, so that tables of fields are data and the code is compiled once for each type, not for
// each field of each model.
struct FieldType {
    const char *type, *expected;
    std::span<const char *const> choices;
    bool (*read)(nb::handle source, void *value, double low, double high); // false where it does not fit
    nb::object (*write)(const void *value);
};

template <class T>
constexpr std::span<const char *const> choices_of() {
    if constexpr (Choice<T>) return Described<T>::names;
    else return {};
}

template <class T>
inline constexpr FieldType field_type{
    Described<T>::type, Described<T>::expected, choices_of<T>(),
    [](nb::handle source, void *value, double low, double high) {
        T &typed = *static_cast<T *>(value);
        return Described<T>::read(source, typed) && within(typed, low, high);
    },
    [](const void *value) -> nb::object { return Described<T>::write(*static_cast<const T *>(value)); }};

// A field of one model in memory.
struct BoundField {
    const char *name, *doc, *unit;
    double minimum, maximum;
    void *value;
    const FieldType *type;
};

template <class Model>
std::vector<BoundField> bind_fields(Model &model) {
    std::vector<BoundField> fields;
    for_each_field<Model>([&](const auto &field) {
        auto &value = model.*field.member;
        fields.push_back({field.name, field.doc, field.unit_name, field.minimum, field.maximum, &value,
                          &field_type<std::decay_t<decltype(value)>>});
    });
    return fields;
}

nb::dict describe(const char *doc, std::span<const BoundField> fields);
void read_fields(std::span<const BoundField> fields, const nb::dict &description, const std::string &where,
                 std::initializer_list<std::string_view> extra);

std::string text_of_key(nb::handle key);
std::string type_of(const nb::dict &description, const std::string &where, const std::string &known);

} // namespace detail

// {"doc": ..., "fields": [{"name", "type", "default", "minimum", "maximum", "unit", "choices", "doc"}, ...]}
template <class Model>
nb::dict schema_of() {
    Model model;
    return detail::describe(Model::doc, detail::bind_fields(model));
}

// {name: schema_of(model)} of every alternative.
template <class Variant>
nb::dict schema_of_list() {
    nb::dict schema;
    for_each_alternative<Variant>([&]<class Model>() { schema[Model::name] = schema_of<Model>(); });
    return schema;
}

// Reads one value; a DescriptionError names the place where it does not fit.
template <class T>
void read_value(nb::handle source, T &value, const std::string &where) {
    if (!Described<T>::read(source, value)) throw_unexpected(where, Described<T>::expected, source);
}

// Sets the fields that the description holds. Keys other than fields, "type" and `extra` are errors, and so
// are values of another type or out of range.
template <class Model>
void read_model(Model &model, const nb::dict &description, const std::string &where,
                std::initializer_list<std::string_view> extra = {}) {
    detail::read_fields(detail::bind_fields(model), description, where, extra);
}

// A model read from a description and built where it has tables to compute.
template <class Model>
Model model_from(const nb::dict &description, const std::string &where,
                 std::initializer_list<std::string_view> extra = {}) {
    Model model;
    read_model(model, description, where, extra);
    if constexpr (requires { model.build(); }) {
        try {
            model.build();
        } catch (const std::invalid_argument &error) {
            throw DescriptionError(where + ": " + error.what());
        }
    }
    return model;
}

// The alternative that "type" names; messages then call the place "where (type)".
template <class Variant>
Variant variant_from(const nb::dict &description, const std::string &where,
                     std::initializer_list<std::string_view> extra = {}) {
    std::string known;
    for_each_alternative<Variant>(
        [&]<class Model>() { known += (known.empty() ? "" : ", ") + std::string(Model::name); });
    const std::string type = detail::type_of(description, where, known);
    std::optional<Variant> result;
    for_each_alternative<Variant>([&]<class Model>() {
        if (type == Model::name)
            result.emplace(model_from<Model>(description, where + " (" + type + ")", extra));
    });
    if (!result) throw DescriptionError(where + ": unknown type '" + type + "' (known: " + known + ")");
    return *std::move(result);
}

} // namespace lajolla
