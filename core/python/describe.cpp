#include "python/describe.h"

#include <charconv>
#include <cmath>
#include <cstdio>

namespace lajolla {

namespace {

// A Python error raised by a conversion that failed is an answer here, not an error.
bool conversion_failed() {
    const bool failed = PyErr_Occurred() != nullptr;
    PyErr_Clear();
    return failed;
}

// Fills n numbers from a sequence of exactly n.
bool read_numbers(nb::handle source, float *values, Py_ssize_t n) {
    if (PySequence_Check(source.ptr()) == 0 || PySequence_Size(source.ptr()) != n) {
        PyErr_Clear();
        return false;
    }
    for (Py_ssize_t i = 0; i < n; ++i) {
        const nb::object item = nb::steal(PySequence_GetItem(source.ptr(), i));
        if (conversion_failed() || !Described<float>::read(item, values[i])) return false;
    }
    return true;
}

// The double with the shortest decimal that names this float: 0.1f is shown as 0.1.
double shortest(float value) {
    std::array<char, 32> text{};
    const auto end = std::to_chars(text.data(), text.data() + text.size(), value).ptr;
    double result = value;
    std::from_chars(text.data(), end, result);
    return result;
}

template <class Tag>
bool read_triple(nb::handle source, Triple<Tag, float> &value) {
    std::array<float, 3> v{};
    const bool fits = read_numbers(source, v.data(), 3);
    value = {v[0], v[1], v[2]};
    return fits;
}

template <class Tag>
nb::object write_triple(Triple<Tag, float> v) {
    return nb::make_tuple(shortest(v.x), shortest(v.y), shortest(v.z));
}

std::string number_text(double value) {
    std::array<char, 32> text{};
    return {text.data(), std::to_chars(text.data(), text.data() + text.size(), value).ptr};
}

} // namespace

void throw_unexpected(const std::string &where, const std::string &expected, nb::handle got) {
    constexpr std::size_t longest = 60;
    std::string text = nb::repr(got).c_str();
    if (text.size() > longest) text = text.substr(0, longest) + "...";
    throw DescriptionError(where + ": expected " + expected + ", got " + text);
}

bool Described<float>::read(nb::handle source, float &value) {
    if (PyBool_Check(source.ptr())) return false;
    value = static_cast<float>(PyFloat_AsDouble(source.ptr()));
    return !conversion_failed() && std::isfinite(value);
}
nb::object Described<float>::write(float value) { return nb::float_(shortest(value)); }

std::optional<std::int64_t> read_integer(nb::handle source, std::int64_t lowest, std::int64_t highest) {
    if (PyBool_Check(source.ptr()) || PyIndex_Check(source.ptr()) == 0) return std::nullopt;
    const nb::object index = nb::steal(PyNumber_Index(source.ptr()));
    if (conversion_failed()) return std::nullopt;
    const std::int64_t value = PyLong_AsLongLong(index.ptr());
    if (conversion_failed() || value < lowest || value > highest) return std::nullopt;
    return value;
}

bool Described<bool>::read(nb::handle source, bool &value) {
    value = source.is(Py_True);
    return PyBool_Check(source.ptr());
}

bool Described<std::string>::read(nb::handle source, std::string &value) {
    Py_ssize_t size = 0;
    const char *text =
        nb::isinstance<nb::str>(source) ? PyUnicode_AsUTF8AndSize(source.ptr(), &size) : nullptr;
    if (conversion_failed() || text == nullptr) return false;
    value.assign(text, static_cast<std::size_t>(size));
    return true;
}

bool Described<Spectrum>::read(nb::handle source, Spectrum &value) {
    if (float grey = 0; Described<float>::read(source, grey)) {
        value = Spectrum(grey);
        return true;
    }
    return read_triple(source, value);
}
nb::object Described<Spectrum>::write(Spectrum value) { return write_triple(value); }

bool Described<Vec3f>::read(nb::handle source, Vec3f &value) { return read_triple(source, value); }
nb::object Described<Vec3f>::write(Vec3f value) { return write_triple(value); }

bool Described<Transform>::read(nb::handle source, Transform &value) {
    if (PySequence_Check(source.ptr()) == 0 || PySequence_Size(source.ptr()) != 4) {
        PyErr_Clear();
        return false;
    }
    for (std::size_t row = 0; row < 4; ++row) {
        const nb::object numbers = nb::steal(PySequence_GetItem(source.ptr(), static_cast<Py_ssize_t>(row)));
        if (conversion_failed() || !read_numbers(numbers, value.m[row].data(), 4)) return false;
    }
    return true;
}
nb::object Described<Transform>::write(const Transform &value) {
    nb::list rows;
    for (const auto &row : value.m) {
        nb::list numbers;
        for (const float number : row) numbers.append(shortest(number));
        rows.append(numbers);
    }
    return rows;
}

std::optional<std::int32_t> read_handle(nb::handle source, const char *kind) {
    if (!nb::isinstance<nb::dict>(source) || nb::len(source) != 1 ||
        PyDict_GetItemString(source.ptr(), kind) == nullptr)
        return std::nullopt;
    const auto index =
        read_integer(PyDict_GetItemString(source.ptr(), kind), 0, std::numeric_limits<std::int32_t>::max());
    return index ? std::optional(static_cast<std::int32_t>(*index)) : std::nullopt;
}

std::optional<std::size_t> read_choice(nb::handle source, const char *const *names, std::size_t count) {
    std::string given;
    if (!Described<std::string>::read(source, given)) return std::nullopt;
    const auto *const end = names + count;
    const auto *const found = std::find(names, end, given);
    return found == end ? std::nullopt : std::optional(static_cast<std::size_t>(found - names));
}

namespace detail {

namespace {

std::string range_text(double minimum, double maximum) {
    const bool low = std::isfinite(minimum), high = std::isfinite(maximum);
    if (low && high) return " in [" + number_text(minimum) + ", " + number_text(maximum) + "]";
    if (low) return " >= " + number_text(minimum);
    return high ? " <= " + number_text(maximum) : "";
}

// "a number >= 0", "one of 'mis', 'light'": what a field takes, in words.
std::string expected_text(const BoundField &field) {
    if (field.type->choices.empty()) return field.type->expected + range_text(field.minimum, field.maximum);
    std::string text;
    for (const char *name : field.type->choices)
        text += (text.empty() ? "'" : ", '") + std::string(name) + "'";
    return "one of " + text;
}

nb::object bound(double value) { // None where infinite
    return std::isfinite(value) ? nb::object(nb::float_(value)) : nb::object(nb::none());
}

nb::object names_of(std::span<const char *const> choices) {
    if (choices.empty()) return nb::none();
    nb::list names;
    for (const char *name : choices) names.append(name);
    return names;
}

std::string field_names(std::span<const BoundField> fields) {
    std::string names;
    for (const BoundField &field : fields) names += (names.empty() ? "" : ", ") + std::string(field.name);
    return names.empty() ? "none" : names;
}

} // namespace

nb::dict describe(const char *doc, std::span<const BoundField> fields) {
    nb::list entries;
    for (const BoundField &field : fields) {
        nb::dict entry;
        entry["name"] = field.name;
        entry["type"] = field.type->type;
        entry["default"] = field.type->write(field.value);
        entry["minimum"] = bound(field.minimum);
        entry["maximum"] = bound(field.maximum);
        entry["unit"] = field.unit;
        entry["choices"] = names_of(field.type->choices);
        entry["doc"] = field.doc;
        entries.append(entry);
    }
    nb::dict schema;
    schema["doc"] = doc;
    schema["fields"] = entries;
    return schema;
}

void read_fields(std::span<const BoundField> fields, const nb::dict &description, const std::string &where,
                 std::initializer_list<std::string_view> extra) {
    for (const auto &[key, given] : description) {
        const std::string name = text_of_key(key);
        const auto field = std::find_if(fields.begin(), fields.end(),
                                        [&](const BoundField &candidate) { return name == candidate.name; });
        if (field != fields.end()) {
            if (!field->type->read(given, field->value, field->minimum, field->maximum))
                throw_unexpected(where + "." + name, expected_text(*field), given);
        } else if (name != "type" && std::find(extra.begin(), extra.end(), name) == extra.end()) {
            throw DescriptionError(where + ": unknown field '" + name + "' (known: " + field_names(fields) +
                                   ")");
        }
    }
}

std::string text_of_key(nb::handle key) {
    std::string text;
    return Described<std::string>::read(key, text) ? text : nb::repr(key).c_str();
}

std::string type_of(const nb::dict &description, const std::string &where, const std::string &known) {
    if (!description.contains("type"))
        throw DescriptionError(where + ": \"type\" is missing (known: " + known + ")");
    std::string type;
    read_value(description["type"], type, where + ".type");
    return type;
}

} // namespace detail

} // namespace lajolla
