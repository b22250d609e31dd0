#include "engine/value.h"

#include <algorithm>
#include <array>
#include <charconv>
#include <span>
#include <stdexcept>

namespace lajolla {

namespace {

std::string quoted(const std::string &text) { return std::string("'").append(text).append("'"); }

// text(item) of all items, with commas between them.
std::string listed(const char *open, const auto &items, auto &&text, const char *close) {
    std::string result = open;
    const char *between = "";
    for (const auto &item : items) result.append(std::exchange(between, ", ")).append(text(item));
    return result.append(close);
}

std::string number_text(double value) {
    std::array<char, 32> text{};
    return {text.data(), std::to_chars(text.data(), text.data() + text.size(), value).ptr};
}

} // namespace

Dict::Dict(std::initializer_list<Entry> entries) : entries_(entries) {}

const Value *Dict::find(std::string_view key) const {
    const auto entry =
        std::find_if(entries_.begin(), entries_.end(), [&](const Entry &e) { return e.first == key; });
    return entry == entries_.end() ? nullptr : &entry->second;
}

namespace {

const EntryColumn *column_in(const Value &value) {
    const Object *const object = value.get_if<Object>();
    return object ? object->as<EntryColumn>().get() : nullptr; // the value keeps it
}

Value nested(std::span<const double> numbers, std::span<const std::size_t> shape, bool integer) {
    if (shape.empty()) return integer ? Value(static_cast<std::int64_t>(numbers[0])) : Value(numbers[0]);
    const std::size_t size = numbers.size() / shape[0];
    List list;
    list.reserve(shape[0]);
    for (std::size_t i = 0; i < shape[0]; ++i)
        list.push_back(nested(numbers.subspan(i * size, size), shape.subspan(1), integer));
    return list;
}

} // namespace

Value EntryColumn::row(std::size_t index) const {
    const std::size_t size = numbers.size() / rows;
    return nested(std::span(numbers).subspan(index * size, size), shape, integer);
}

std::optional<std::size_t> row_count(const Dict &entry) {
    std::optional<std::size_t> count;
    for (const auto &[key, value] : entry)
        if (const EntryColumn *const column = column_in(value)) {
            if (count.value_or(column->rows) != column->rows)
                throw std::invalid_argument("columns have " + std::to_string(*count) + " and " +
                                            std::to_string(column->rows) + " rows");
            count = column->rows;
        }
    return count;
}

Dict row_of(const Dict &entry, std::size_t index) {
    Dict result;
    result.reserve(entry.size());
    for (const auto &[key, value] : entry) {
        const EntryColumn *const column = column_in(value);
        result.add(key, column ? column->row(index) : value);
    }
    return result;
}

std::string text_of(const Value &value) {
    if (const auto *truth = value.get_if<bool>()) return *truth ? "True" : "False";
    if (const auto *integer = value.get_if<std::int64_t>()) return std::to_string(*integer);
    if (const auto *number = value.get_if<double>()) return number_text(*number);
    if (const auto *text = value.get_if<std::string>()) return quoted(*text);
    if (const auto *list = value.get_if<List>()) return listed("[", *list, text_of, "]");
    if (const auto *dict = value.get_if<Dict>()) {
        const auto entry_text = [](const Dict::Entry &e) {
            return quoted(e.first) + ": " + text_of(e.second);
        };
        return listed("{", *dict, entry_text, "}");
    }
    return value.is_nothing() ? "None" : "an object";
}

} // namespace lajolla
