#pragma once
// Converts between descriptions and models by their fields(). schema_of_list() lists models' fields;
// read_model() and variant_from() build a model from a dict, and report errors.
//
// Described<T> describes a type that appears in fields(); it is specialised for meshes, images and so on in
// described.h.

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
#include "engine/value.h"

namespace lajolla {

// A description that does not fit its model; `_core.DescriptionError`, a ValueError, in Python.
class DescriptionError : public std::runtime_error {
public:
    using std::runtime_error::runtime_error;
};

// "where: expected ..., got <value>".
class UnexpectedValue : public DescriptionError {
public:
    UnexpectedValue(const std::string &where, const std::string &expected, const Value &got)
        : UnexpectedValue(where + ": expected " + expected + ", got ", &got, text_of(got)) {}

    const Value *got() const { return got_; } // a part of the description, which must still be there
    // The same message where the value is known by another text.
    UnexpectedValue called(const std::string &text) const { return {problem_, got_, text}; }

private:
    UnexpectedValue(const std::string &problem, const Value *got, const std::string &text);

    std::string problem_; // before the value
    const Value *got_;
};

// How descriptions name and carry a T:
//   type      the schema's name for it
//   expected  what messages call it
//   read      from a value; false where the value does not fit
//   write     to a value, such that read() gives it back
template <class T>
struct Described;

template <>
struct Described<float> {
    static constexpr const char *type = "float", *expected = "a number";
    static bool read(const Value &source, float &value);
    static Value write(float value);
};

// Whole numbers in [lowest, highest]; truth values are none.
std::optional<std::int64_t> read_integer(const Value &source, std::int64_t lowest, std::int64_t highest);

template <std::integral T>
struct Described<T> {
    static constexpr const char *type = "integer", *expected = "an integer";
    static bool read(const Value &source, T &value) {
        const auto number =
            read_integer(source, std::numeric_limits<T>::lowest(), std::numeric_limits<T>::max());
        value = static_cast<T>(number.value_or(0));
        return number.has_value();
    }
    static Value write(T value) { return value; }
};

// A value that is carried as it is.
template <class T>
struct DescribedPlainly {
    static bool read(const Value &source, T &value) {
        const T *given = source.get_if<T>();
        if (given) value = *given;
        return given != nullptr;
    }
    static Value write(const T &value) { return value; }
};

template <>
struct Described<bool> : DescribedPlainly<bool> {
    static constexpr const char *type = "boolean", *expected = "True or False";
};

template <>
struct Described<std::string> : DescribedPlainly<std::string> {
    static constexpr const char *type = "string", *expected = "a string";
};

template <>
struct Described<Spectrum> {
    static constexpr const char *type = "spectrum", *expected = "a number or three numbers";
    static bool read(const Value &source, Spectrum &value);
    static Value write(Spectrum value);
};

template <>
struct Described<Vec3f> {
    static constexpr const char *type = "vector", *expected = "three numbers";
    static bool read(const Value &source, Vec3f &value);
    static Value write(Vec3f value);
};

template <>
struct Described<Transform> {
    static constexpr const char *type = "transform", *expected = "a 4x4 matrix of numbers";
    static bool read(const Value &source, Transform &value);
    static Value write(const Transform &value);
};

// The index in {kind: index}, a reference to a texture or a volume of the scene.
std::optional<std::int32_t> read_handle(const Value &source, std::string_view kind);

// A handle that is a constant or {kind: index}.
template <class Handle>
bool read_handle_or_constant(const Value &source, std::string_view kind, Handle &value) {
    const auto index = read_handle(source, kind);
    value.id = index.value_or(-1);
    return index || Described<decltype(value.constant)>::read(source, value.constant);
}

template <class T>
struct Described<Texture<T>> {
    static constexpr bool scalar = std::same_as<T, float>;
    static constexpr const char *type = scalar ? "texture_float" : "texture_spectrum";
    static constexpr const char *expected =
        scalar ? "{'texture': index} or a number" : "{'texture': index}, a number or three numbers";
    static bool read(const Value &source, Texture<T> &value) {
        return read_handle_or_constant(source, "texture", value);
    }
    static Value write(const Texture<T> &value) { return Described<T>::write(value.constant); }
};

template <class T>
concept Choice = std::is_enum_v<T> && requires(T value) { choices(value); };

std::optional<std::size_t> read_choice(const Value &source, std::span<const char *const> names);

template <Choice T>
struct Described<T> {
    static constexpr const char *type = "choice", *expected = "one of";
    static constexpr auto names = choices(T{});
    static bool read(const Value &source, T &value) {
        const auto index = read_choice(source, names);
        value = static_cast<T>(index.value_or(0));
        return index.has_value();
    }
    static Value write(T value) { return names[static_cast<std::size_t>(value)]; }
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

// The functions of a type, so that tables of fields are data, and code is compiled once per type instead of
// per field.
struct FieldType {
    const char *type, *expected;
    std::span<const char *const> choices;
    bool (*read)(const Value &source, void *value, double low, double high); // false where it does not fit
    Value (*write)(const void *value);
};

template <class T>
constexpr std::span<const char *const> choices_of() {
    if constexpr (Choice<T>) return Described<T>::names;
    else return {};
}

template <class T>
inline constexpr FieldType field_type{
    Described<T>::type, Described<T>::expected, choices_of<T>(),
    [](const Value &source, void *value, double low, double high) {
        T &typed = *static_cast<T *>(value);
        return Described<T>::read(source, typed) && within(typed, low, high);
    },
    [](const void *value) -> Value { return Described<T>::write(*static_cast<const T *>(value)); }};

// A field of one model in memory.
struct BoundField {
    const char *name, *doc, *unit;
    double minimum, maximum;
    void *value;
    const FieldType *type;
};

template <class Model>
auto bind_fields(Model &model) {
    static constexpr auto fields = Model::fields();
    return std::apply(
        [&](const auto &...field) {
            return std::array<BoundField, sizeof...(field)>{BoundField{
                field.name, field.doc, field.unit_name, field.minimum, field.maximum, &(model.*field.member),
                &field_type<std::decay_t<decltype(model.*field.member)>>}...};
        },
        fields);
}

Dict describe(const char *doc, std::span<const BoundField> fields);
void read_fields(std::span<const BoundField> fields, const Dict &description, const std::string &where,
                 std::initializer_list<std::string_view> extra);

// The names of a variant's models, with commas between them.
template <class Variant>
std::string names_of() {
    std::string names;
    for_each_alternative<Variant>(
        [&]<class Model>() { names += (names.empty() ? "" : ", ") + std::string(Model::name); });
    return names;
}

} // namespace detail

// Of every alternative {name: {"doc": ..., "fields": [{"name", "type", "default", "minimum", "maximum",
// "unit", "choices", "doc"}, ...]}}, with the fields of what each of them has beside its own.
template <class Variant, class... Shared>
Dict schema_of_list() {
    Dict schema;
    for_each_alternative<Variant>([&]<class Model>() {
        Model model;
        std::tuple<Shared...> shared;
        std::vector<detail::BoundField> fields;
        const auto append = [&](auto &each) {
            for (const auto &field : detail::bind_fields(each)) fields.push_back(field);
        };
        append(model);
        std::apply([&](auto &...each) { (append(each), ...); }, shared);
        schema.add(Model::name, detail::describe(Model::doc, fields));
    });
    return schema;
}

// Reads one value; where it does not fit, an UnexpectedValue names the place, whose parts are `where`.
template <class T>
void read_value(const Value &source, T &value, const auto &...where) {
    if (!Described<T>::read(source, value))
        throw UnexpectedValue((std::string() + ... + where), Described<T>::expected, source);
}

// Sets the fields that the description holds. Keys other than fields, "type" and `extra` are errors, and so
// are values of another type or out of range.
template <class Model>
void read_model(Model &model, const Dict &description, const std::string &where,
                std::initializer_list<std::string_view> extra = {}) {
    detail::read_fields(detail::bind_fields(model), description, where, extra);
}

// A model read from a description and built where it has tables to compute.
template <class Model>
Model model_from(const Dict &description, const std::string &where,
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
Variant variant_from(const Dict &description, const std::string &where,
                     std::initializer_list<std::string_view> extra = {}) {
    const auto refuse = [&](const std::string &why) {
        throw DescriptionError(where + ": " + why + " (known: " + detail::names_of<Variant>() + ")");
    };
    const Value *const given = description.find("type");
    if (!given) refuse("\"type\" is missing");
    std::string type;
    read_value(*given, type, where, ".type");
    std::optional<Variant> result;
    for_each_alternative<Variant>([&]<class Model>() {
        if (type == Model::name)
            result.emplace(model_from<Model>(description, where + " (" + type + ")", extra));
    });
    if (!result) refuse("unknown type '" + type + "'");
    return *std::move(result);
}

// The list under a key of a description; null where there is none.
const List *find_list(const Dict &description, const char *key);

// The number of entries that an entry of a list represents: several if it contains columns (value.h).
std::size_t entries_in(const Value &entry, const std::string &where);

// Calls f(dict, where) for the entries of the list under a key of the description, if it is there.
template <class F>
void for_each_entry(const Dict &description, const char *key, F &&f) {
    const List *const entries = find_list(description, key);
    if (!entries) return;
    std::size_t index = 0;
    const auto next = [&] { return std::string(key) + "[" + std::to_string(index) + "]"; };
    for (const Value &entry : *entries) {
        const Dict *const dict = entry.get_if<Dict>();
        if (!dict) throw UnexpectedValue(next(), "a dict", entry);
        const std::size_t count = entries_in(entry, next());
        const bool has_columns = row_count(*dict).has_value();
        for (std::size_t row = 0; row < count; ++row, ++index)
            if (has_columns) f(row_of(*dict, row), next());
            else f(*dict, next());
    }
}

// The results of read(dict, where) for all entries.
template <class Read>
auto read_list(const Dict &description, const char *key, Read &&read) {
    std::vector<std::decay_t<decltype(read(Dict(), std::string()))>> result;
    std::size_t count = 0;
    if (const List *const entries = find_list(description, key))
        for (const Value &entry : *entries) count += entries_in(entry, key);
    result.reserve(count);
    for_each_entry(description, key, [&](const Dict &entry, const std::string &where) {
        result.push_back(read(entry, where));
    });
    return result;
}

} // namespace lajolla
