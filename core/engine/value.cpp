#include "engine/value.h"

#include <algorithm>
#include <array>
#include <charconv>

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
