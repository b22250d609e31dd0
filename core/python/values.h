#pragma once
// Python objects as the engine's values, and back.

#include <nanobind/nanobind.h>

#include <string>

#include "engine/describe.h"

namespace lajolla {

namespace nb = nanobind;

// What no model takes becomes an empty Object.
Value value_of(nb::handle source);
nb::object object_of(const Value &value); // None for objects
nb::dict object_of(const Dict &value);

// The message with Python's own name for the value that `source` held; `value` was made of it.
UnexpectedValue called_as_in_python(const UnexpectedValue &error, const Value &value, nb::handle source);

// f(value of source).
template <class F>
auto with_value(nb::handle source, F &&f) {
    const Value value = value_of(source);
    try {
        return f(value);
    } catch (const UnexpectedValue &error) {
        throw called_as_in_python(error, value, source);
    }
}

// f(dict).
template <class F>
auto with_dict(const nb::dict &source, F &&f) {
    return with_value(source, [&](const Value &value) { return f(*value.get_if<Dict>()); });
}

template <class T>
void read_value(nb::handle source, T &value, const std::string &where) {
    with_value(source, [&](const Value &given) { read_value(given, value, where); });
}

template <class Variant>
Variant variant_from(const nb::dict &description, const std::string &where) {
    return with_dict(description, [&](const Dict &dict) { return variant_from<Variant>(dict, where); });
}

} // namespace lajolla
