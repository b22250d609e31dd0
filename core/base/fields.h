#pragma once
// The single declaration of a model's parameters. From `fields()` come the scene reader's checks, the Python
// constructor, `lajolla list` and the generic tests.

#include <limits>
#include <tuple>

namespace lajolla {

template <class Model, class T>
struct Field {
    const char *name;
    T Model::*member;
    const char *doc;
    double minimum = -std::numeric_limits<double>::infinity();
    double maximum = std::numeric_limits<double>::infinity();
    const char *unit_name = "";

    constexpr Field range(double low, double high = std::numeric_limits<double>::infinity()) const {
        Field copy = *this;
        copy.minimum = low;
        copy.maximum = high;
        return copy;
    }
    constexpr Field unit(const char *text) const {
        Field copy = *this;
        copy.unit_name = text;
        return copy;
    }
};

// Enumerations are choices by name: declare `constexpr auto choices(MyEnum) { return std::array{"a", "b"}; }`
// beside the enumeration, names in the order of its values, which count from zero.
template <class Model, class T>
constexpr Field<Model, T> field(const char *name, T Model::*member, const char *doc) {
    return {name, member, doc};
}

// Calls f(field) for each field of a model type.
template <class Model, class F>
constexpr void for_each_field(F &&f) {
    std::apply([&](const auto &...fields) { (f(fields), ...); }, Model::fields());
}

} // namespace lajolla
