#include "engine/describe.h"

#include <charconv>
#include <cmath>

namespace lajolla {

namespace {

// Fills n numbers from a list of exactly n.
bool read_numbers(const Value &source, float *values, std::size_t n) {
    const List *const list = source.get_if<List>();
    return list && list->size() == n && std::all_of(list->begin(), list->end(), [&](const Value &item) {
               return Described<float>::read(item, *values++);
           });
}

template <class Tag>
bool read_triple(const Value &source, Triple<Tag, float> &value) {
    std::array<float, 3> v{};
    const bool fits = read_numbers(source, v.data(), 3);
    value = {v[0], v[1], v[2]};
    return fits;
}

constexpr std::size_t longest_text = 60; // of a value in a message

Value write_numbers(std::span<const float> numbers) {
    List list;
    for (const float number : numbers) list.push_back(Described<float>::write(number));
    return list;
}

} // namespace

UnexpectedValue::UnexpectedValue(const std::string &problem, const Value *got, const std::string &text)
    : DescriptionError(problem + (text.size() > longest_text ? text.substr(0, longest_text) + "..." : text)),
      problem_(problem), got_(got) {}

bool Described<float>::read(const Value &source, float &value) {
    if (const auto *number = source.get_if<double>()) value = static_cast<float>(*number);
    else if (const auto *integer = source.get_if<std::int64_t>()) value = static_cast<float>(*integer);
    else return false;
    return std::isfinite(value);
}
// The double with the shortest decimal that names this float: 0.1f is shown as 0.1.
Value Described<float>::write(float value) {
    std::array<char, 32> text{};
    const auto end = std::to_chars(text.data(), text.data() + text.size(), value).ptr;
    double result = value;
    std::from_chars(text.data(), end, result);
    return result;
}

std::optional<std::int64_t> read_integer(const Value &source, std::int64_t lowest, std::int64_t highest) {
    const auto *value = source.get_if<std::int64_t>();
    return value && *value >= lowest && *value <= highest ? std::optional(*value) : std::nullopt;
}

bool Described<Spectrum>::read(const Value &source, Spectrum &value) {
    if (float grey = 0; Described<float>::read(source, grey)) {
        value = Spectrum(grey);
        return true;
    }
    return read_triple(source, value);
}
Value Described<Spectrum>::write(Spectrum value) {
    return write_numbers(std::array{value.x, value.y, value.z});
}

bool Described<Vec3f>::read(const Value &source, Vec3f &value) { return read_triple(source, value); }
Value Described<Vec3f>::write(Vec3f value) { return write_numbers(std::array{value.x, value.y, value.z}); }

bool Described<Transform>::read(const Value &source, Transform &value) {
    const List *const rows = source.get_if<List>();
    if (!rows || rows->size() != 4) return false;
    for (std::size_t row = 0; row < 4; ++row)
        if (!read_numbers((*rows)[row], value.m[row].data(), 4)) return false;
    return true;
}
Value Described<Transform>::write(const Transform &value) {
    List rows;
    for (const auto &row : value.m) rows.push_back(write_numbers(row));
    return rows;
}

std::optional<std::int32_t> read_handle(const Value &source, std::string_view kind) {
    const Dict *const dict = source.get_if<Dict>();
    const Value *const given = dict && dict->size() == 1 ? dict->find(kind) : nullptr;
    if (!given) return std::nullopt;
    const auto index = read_integer(*given, 0, std::numeric_limits<std::int32_t>::max());
    return index ? std::optional(static_cast<std::int32_t>(*index)) : std::nullopt;
}

std::optional<std::size_t> read_choice(const Value &source, std::span<const char *const> names) {
    const auto *given = source.get_if<std::string>();
    if (!given) return std::nullopt;
    const auto found = std::find(names.begin(), names.end(), *given);
    return found == names.end() ? std::nullopt
                                : std::optional(static_cast<std::size_t>(found - names.begin()));
}

const List *find_list(const Dict &description, const char *key) {
    const Value *const given = description.find(key);
    if (!given) return nullptr;
    const List *const list = given->get_if<List>();
    if (!list) throw UnexpectedValue(key, "a list", *given);
    return list;
}

std::size_t entries_in(const Value &entry, const std::string &where) {
    const Dict *const dict = entry.get_if<Dict>();
    try {
        return dict ? row_count(*dict).value_or(1) : 1;
    } catch (const std::invalid_argument &error) {
        throw DescriptionError(where + ": " + error.what());
    }
}

namespace detail {

namespace {

std::string range_text(double minimum, double maximum) {
    const bool low = std::isfinite(minimum), high = std::isfinite(maximum);
    if (low && high) return " in [" + text_of(minimum) + ", " + text_of(maximum) + "]";
    if (low) return " >= " + text_of(minimum);
    return high ? " <= " + text_of(maximum) : "";
}

// "a number >= 0", "one of 'mis', 'light'": what a field takes, in words.
std::string expected_text(const BoundField &field) {
    if (field.type->choices.empty()) return field.type->expected + range_text(field.minimum, field.maximum);
    std::string text;
    for (const char *name : field.type->choices)
        text += (text.empty() ? "'" : ", '") + std::string(name) + "'";
    return "one of " + text;
}

Value bound(double value) { return std::isfinite(value) ? Value(value) : Value(); } // nothing where infinite

Value choices_value(std::span<const char *const> choices) {
    return choices.empty() ? Value() : List(choices.begin(), choices.end());
}

std::string field_names(std::span<const BoundField> fields) {
    std::string names;
    for (const BoundField &field : fields) names += (names.empty() ? "" : ", ") + std::string(field.name);
    return names.empty() ? "none" : names;
}

} // namespace

Dict describe(const char *doc, std::span<const BoundField> fields) {
    List entries;
    for (const BoundField &field : fields)
        entries.push_back(Dict{{"name", field.name},
                               {"type", field.type->type},
                               {"default", field.type->write(field.value)},
                               {"minimum", bound(field.minimum)},
                               {"maximum", bound(field.maximum)},
                               {"unit", field.unit},
                               {"choices", choices_value(field.type->choices)},
                               {"doc", field.doc}});
    return {{"doc", doc}, {"fields", entries}};
}

void read_fields(std::span<const BoundField> fields, const Dict &description, const std::string &where,
                 std::initializer_list<std::string_view> extra) {
    for (const auto &[name, given] : description) {
        const auto field = std::find_if(fields.begin(), fields.end(),
                                        [&](const BoundField &candidate) { return name == candidate.name; });
        if (field != fields.end()) {
            if (!field->type->read(given, field->value, field->minimum, field->maximum))
                throw UnexpectedValue(where + "." + name, expected_text(*field), given);
        } else if (name != "type" && std::find(extra.begin(), extra.end(), name) == extra.end()) {
            throw DescriptionError(where + ": unknown field '" + name + "' (known: " + field_names(fields) +
                                   ")");
        }
    }
}

} // namespace detail

} // namespace lajolla
