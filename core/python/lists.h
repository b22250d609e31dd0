#pragma once
// Lists of models in a description.

#include <string>
#include <vector>

#include "python/describe.h"

namespace lajolla {

// Calls f(dict, where) for the entries of the list under a key of the description, if it is there.
template <class F>
void for_each_entry(const nb::dict &description, const char *key, F &&f) {
    if (!description.contains(key)) return;
    const nb::object entries = description[key];
    if (!nb::isinstance<nb::list>(entries) && !nb::isinstance<nb::tuple>(entries))
        throw_unexpected(key, "a list", entries);
    std::size_t index = 0;
    for (const nb::handle entry : entries) {
        const std::string where = std::string(key) + "[" + std::to_string(index++) + "]";
        if (!nb::isinstance<nb::dict>(entry)) throw_unexpected(where, "a dict", entry);
        f(nb::cast<nb::dict>(entry), where);
    }
}

// What read(dict, where) makes of the entries.
template <class Read>
auto read_list(const nb::dict &description, const char *key, Read &&read) {
    std::vector<std::decay_t<decltype(read(nb::dict(), std::string()))>> result;
    for_each_entry(description, key, [&](const nb::dict &entry, const std::string &where) {
        result.push_back(read(entry, where));
    });
    return result;
}

} // namespace lajolla
