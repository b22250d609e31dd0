#pragma once
// The values of descriptions: plain values, lists and dicts of them, and objects that are passed on
// unchanged, such as meshes.

#include <concepts>
#include <cstdint>
#include <initializer_list>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <typeinfo>
#include <utility>
#include <variant>
#include <vector>

namespace lajolla {

class Value;
using List = std::vector<Value>;

// An object that models share; an empty one is something that no model takes.
class Object {
public:
    Object() = default;
    template <class T>
    Object(std::shared_ptr<T> object) : object_(std::move(object)), type_(&typeid(T)) {}

    // Null where it is of another type.
    template <class T>
    std::shared_ptr<const T> as() const {
        return *type_ == typeid(T) ? std::static_pointer_cast<const T>(object_) : nullptr;
    }

private:
    std::shared_ptr<const void> object_;
    const std::type_info *type_ = &typeid(void);
};

// Values by key, in the order in which they were added. Entries of a description have so few keys that they
// are looked for one by one.
class Dict {
public:
    using Entry = std::pair<std::string, Value>;

    Dict() = default;
    Dict(std::initializer_list<Entry> entries);

    void add(std::string key, Value value); // a key that is not there yet
    const Value *find(std::string_view key) const;
    bool contains(std::string_view key) const { return find(key) != nullptr; }
    std::size_t size() const;
    void reserve(std::size_t size);
    auto begin() const { return entries_.begin(); }
    auto end() const { return entries_.end(); }

private:
    std::vector<Entry> entries_;
};

class Value {
public:
    Value() = default; // nothing
    template <std::same_as<bool> T>
    Value(T value) : value_(value) {}
    template <std::integral T>
        requires(!std::same_as<T, bool>)
    Value(T value) : value_(static_cast<std::int64_t>(value)) {}
    template <std::floating_point T>
    Value(T value) : value_(static_cast<double>(value)) {}
    Value(const char *value) : value_(std::string(value)) {}
    Value(std::string value) : value_(std::move(value)) {}
    Value(List value) : value_(std::move(value)) {}
    Value(Dict value) : value_(std::move(value)) {}
    Value(Object value) : value_(std::move(value)) {}
    template <class T>
    Value(std::shared_ptr<T> object) : value_(Object(std::move(object))) {}

    bool is_nothing() const { return value_.index() == 0; }
    // Of bool, std::int64_t, double, std::string, List, Dict and Object; null where it is another.
    template <class T>
    const T *get_if() const {
        return std::get_if<T>(&value_);
    }

private:
    std::variant<std::monostate, bool, std::int64_t, double, std::string, List, Dict, Object> value_;
};

inline void Dict::add(std::string key, Value value) {
    entries_.emplace_back(std::move(key), std::move(value));
}
inline std::size_t Dict::size() const { return entries_.size(); }
inline void Dict::reserve(std::size_t size) { entries_.reserve(size); }

// Numbers of several entries of a list. An entry with columns of n rows represents n entries: the i-th has
// the i-th row of each column, and shares all other values.
struct EntryColumn {
    std::vector<double> numbers; // row by row
    std::size_t rows = 0;
    std::vector<std::size_t> shape; // of a row: none for a number, {3} for three, {4, 4} for a matrix
    bool integer = false;

    Value row(std::size_t index) const;
};

// The number of entries that an entry with columns represents; nullopt without columns.
std::optional<std::size_t> row_count(const Dict &entry); // throws std::invalid_argument for uneven columns
Dict row_of(const Dict &entry, std::size_t index);

// A value in words, for messages: 'mis', [1, 2.5], {'texture': 3}.
std::string text_of(const Value &value);

} // namespace lajolla
