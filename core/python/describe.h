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
constexpr bool within(const Triple<Tag> &v, double low, double high) {
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

// "a number >= 0", "one of 'mis', 'light'": what a field takes, in words.
std::string range_text(double minimum, double maximum);
std::string quoted_list(const char *const *names, std::size_t count);

template <class Model, class T>
std::string expected_text(const Field<Model, T> &field) {
    if constexpr (Choice<T>)
        return "one of " + quoted_list(Described<T>::names.data(), Described<T>::names.size());
    else return Described<T>::expected + range_text(field.minimum, field.maximum);
}

nb::object bound(double value); // None where infinite

template <class Model, class T>
nb::dict schema_of_field(const Field<Model, T> &field) {
    nb::dict entry;
    entry["name"] = field.name;
    entry["type"] = Described<T>::type;
    entry["default"] = Described<T>::write(Model{}.*field.member);
    entry["minimum"] = bound(field.minimum);
    entry["maximum"] = bound(field.maximum);
    entry["unit"] = field.unit_name;
    entry["choices"] = nb::none();
    if constexpr (Choice<T>) {
        nb::list names;
        for (const char *name : Described<T>::names) names.append(name);
        entry["choices"] = names;
    }
    entry["doc"] = field.doc;
    return entry;
}

template <class Model>
std::string field_names() {
    std::string names;
    for_each_field<Model>(
        [&](const auto &field) { names += (names.empty() ? "" : ", ") + std::string(field.name); });
    return names.empty() ? "none" : names;
}

std::string text_of_key(nb::handle key);
std::string type_of(const nb::dict &description, const std::string &where, const std::string &known);

} // namespace detail

// {"doc": ..., "fields": [{"name", "type", "default", "minimum", "maximum", "unit", "choices", "doc"}, ...]}
template <class Model>
nb::dict schema_of() {
    nb::list fields;
    for_each_field<Model>([&](const auto &field) { fields.append(detail::schema_of_field(field)); });
    nb::dict schema;
    schema["doc"] = Model::doc;
    schema["fields"] = fields;
    return schema;
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
    for (const auto &[key, value] : description) {
        const std::string name = detail::text_of_key(key);
        bool known = name == "type" || std::find(extra.begin(), extra.end(), name) != extra.end();
        for_each_field<Model>([&, given = value](const auto &field) {
            if (name != field.name) return;
            known = true;
            auto &member = model.*field.member;
            if (!Described<std::decay_t<decltype(member)>>::read(given, member) ||
                !detail::within(member, field.minimum, field.maximum))
                throw_unexpected(where + "." + name, detail::expected_text(field), given);
        });
        if (!known)
            throw DescriptionError(where + ": unknown field '" + name +
                                   "' (known: " + detail::field_names<Model>() + ")");
    }
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
