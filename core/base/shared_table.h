#pragma once
// Tables that are computed once for all objects with the same parameters.

#include <algorithm>
#include <array>
#include <bit>
#include <cstdint>
#include <map>
#include <memory>
#include <mutex>
#include <utility>

namespace lajolla {

// The bits of parameters, as a key: unlike floats, they have an order with NaN, too.
template <class... Parameters>
auto key_of(const Parameters &...parameters) {
    std::array<std::uint32_t, (... + (sizeof(Parameters) / sizeof(std::uint32_t)))> key{};
    auto end = key.begin();
    const auto append = [&](const auto &parameter) {
        const auto bits =
            std::bit_cast<std::array<std::uint32_t, sizeof(parameter) / sizeof(std::uint32_t)>>(parameter);
        end = std::copy(bits.begin(), bits.end(), end);
    };
    (append(parameters), ...);
    return key;
}

// The table with a key if anything has it, else the result of make(). One kind of table has one type of
// `make`. A colour can change without another table, and many objects that are alike have one.
template <class Key, class Make>
auto shared_table(const Key &key, const Make &make) {
    using Table = std::shared_ptr<const decltype(make())>;
    static std::mutex mutex;
    static std::map<Key, typename Table::weak_type> tables;
    const auto known = [&](Table made) { // keeps the one that was there first
        const std::scoped_lock lock(mutex);
        if (const auto found = tables.find(key); found != tables.end())
            if (Table table = found->second.lock()) return table;
        if (!made) return made;
        std::erase_if(tables, [](const auto &table) { return table.second.expired(); });
        tables.insert_or_assign(key, made);
        return made;
    };
    if (Table table = known(nullptr)) return table;
    return known(std::make_shared<decltype(make())>(make()));
}

} // namespace lajolla
