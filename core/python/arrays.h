#pragma once
// Arrays of numbers that come from NumPy and go back to it.

#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>

#include <array>
#include <cstddef>
#include <initializer_list>
#include <memory>
#include <stdexcept>
#include <string>
#include <type_traits>
#include <vector>

#include "base/frame.h"
#include "base/vec.h"

namespace lajolla {

namespace nb = nanobind;

// One row of N columns per item; a single row stands for all items.
template <std::size_t N, class T = float>
using Rows = nb::ndarray<const T, nb::shape<-1, static_cast<Py_ssize_t>(N)>, nb::c_contig, nb::device::cpu>;
using Column = nb::ndarray<const float, nb::ndim<1>, nb::c_contig, nb::device::cpu>;

// An array for NumPy that owns its numbers.
template <class T>
nb::object array_of(std::vector<T> numbers, std::initializer_list<std::size_t> shape) {
    auto owned = std::make_unique<std::vector<T>>(std::move(numbers));
    T *const data = owned->data();
    const nb::capsule owner(owned.release(),
                            [](void *p) noexcept { delete static_cast<std::vector<T> *>(p); });
    return nb::cast(nb::ndarray<nb::numpy, T>(data, shape, owner));
}

// An array of NumPy, whose memory is huge pages where the system has them, that is filled row by row. Rows
// that are not set have any values.
template <class T, std::size_t N>
class Table {
public:
    explicit Table(std::size_t rows) {
        const nb::object shape = N == 1 ? nb::int_(rows) : nb::object(nb::make_tuple(rows, N));
        array_ = nb::module_::import_("numpy").attr("empty")(shape, type_name());
        values_ = nb::cast<nb::ndarray<T, nb::numpy, nb::c_contig>>(array_).data();
    }
    T *row(std::size_t i) { return values_ + i * N; }
    void set(std::size_t i, auto... values) {
        static_assert(sizeof...(values) == N);
        T *target = row(i);
        ((*target++ = values), ...);
    }
    void set(std::size_t i, Vec2f v) { set(i, v.x, v.y); }
    void set(std::size_t i, const std::array<double, 3> &v) { set(i, v[0], v[1], v[2]); }
    template <class Tag>
    void set(std::size_t i, Triple<Tag, float> v) {
        set(i, v.x, v.y, v.z);
    }
    void set(std::size_t i, const Frame<float> &frame) {
        const auto &[s, t, n] = frame;
        set(i, s.x, s.y, s.z, t.x, t.y, t.z, n.x, n.y, n.z);
    }

    nb::object to_numpy() && { return std::move(array_); }

private:
    static const char *type_name() {
        if constexpr (std::is_same_v<T, bool>) return "bool";
        else if constexpr (std::is_floating_point_v<T>) return sizeof(T) == 4 ? "float32" : "float64";
        else return std::is_signed_v<T> ? "int32" : "uint32";
    }

    nb::object array_;
    T *values_;
};

// An array of f(0) ... f(rows - 1).
template <std::size_t N>
nb::object tabulate(std::size_t rows, auto &&f) {
    Table<float, N> table(rows);
    for (std::size_t i = 0; i < rows; ++i) table.set(i, f(i));
    return std::move(table).to_numpy();
}

inline Vec2f pair(const Rows<2> &rows, std::size_t i) { return {rows(i, 0), rows(i, 1)}; }
inline Vec3f triple(const Rows<3> &rows, std::size_t i) {
    const std::size_t row = rows.shape(0) == 1 ? 0 : i;
    return {rows(row, 0), rows(row, 1), rows(row, 2)};
}
// A position in the world, where float32 may not suffice.
template <class Real>
std::array<double, 3> position(const Rows<3, Real> &rows, std::size_t i) {
    const std::size_t row = rows.shape(0) == 1 ? 0 : i;
    return {rows(row, 0), rows(row, 1), rows(row, 2)};
}
inline void require_one_or(std::size_t rows, std::size_t expected, const char *name) {
    if (rows != 1 && rows != expected)
        throw std::invalid_argument(std::string(name) +
                                    ": one row or as many rows as the other array expected");
}

} // namespace lajolla
