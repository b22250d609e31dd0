#include "python/values.h"

#include <nanobind/stl/shared_ptr.h>

#include <optional>
#include <string_view>

#include "geometry/curves.h"
#include "geometry/mesh.h"
#include "images/face_images.h"
#include "images/grid.h"
#include "images/image.h"
#include "scatter/measured.h"

namespace lajolla {

namespace {

// A Python error raised by a conversion that failed is an answer here, not an error.
bool conversion_failed() {
    const bool failed = PyErr_Occurred() != nullptr;
    PyErr_Clear();
    return failed;
}

template <class... T>
Object shared_object(nb::handle source) {
    Object result;
    const auto taken = [&]<class One>(std::shared_ptr<One> object) {
        if (!nb::try_cast(source, object) || !object) return false;
        result = std::move(object);
        return true;
    };
    (taken(std::shared_ptr<T>()) || ...);
    return result;
}

std::string text_of_key(nb::handle key) {
    const char *const text = PyUnicode_Check(key.ptr()) ? PyUnicode_AsUTF8(key.ptr()) : nullptr;
    PyErr_Clear();
    return text ? text : nb::repr(key).c_str();
}

class Converter {
public:
    Value operator()(nb::handle source) {
        PyObject *const o = source.ptr();
        if (PyFloat_Check(o)) return PyFloat_AS_DOUBLE(o);
        if (PyBool_Check(o)) return o == Py_True;
        if (PyLong_Check(o)) return integer(o);
        if (PyUnicode_Check(o)) return text(o);
        if (PyDict_Check(o)) return nested([&] { return dict(o); });
        if (PyList_Check(o) || PyTuple_Check(o)) return nested([&] { return list(o); });
        if (o == Py_None) return {};
        if (nb::inst_check(source))
            return shared_object<Mesh, Image, FaceImages, Grid, CurveSet, Measurement, EntryColumn>(source);
        if (auto array = doubles(o); array && depth_ < deepest - 1) return *std::move(array);
        return other(o);
    }

private:
    // Descriptions are not deep; what holds itself would be.
    static constexpr int deepest = 10;
    // A picture that is given where numbers are expected is not taken to pieces: so many items, and no more,
    // are read of a sequence that is not a list.
    static constexpr Py_ssize_t longest = 1 << 20;
    static constexpr Py_ssize_t most_bytes = 1 << 10; // of what is read at once

    Value nested(auto &&f) {
        if (depth_ == deepest) return Object();
        ++depth_;
        Value result = f();
        --depth_;
        return result;
    }

    static Value integer(PyObject *o) {
        int overflow = 0;
        const long long value = PyLong_AsLongLongAndOverflow(o, &overflow);
        return overflow == 0 ? Value(value) : number(o);
    }

    static Value number(PyObject *o) {
        const double value = PyFloat_AsDouble(o);
        return conversion_failed() ? Value(Object()) : Value(value);
    }

    static Value text(PyObject *o) {
        Py_ssize_t size = 0;
        const char *const text = PyUnicode_AsUTF8AndSize(o, &size);
        return conversion_failed() ? Value(Object())
                                   : Value(std::string(text, static_cast<std::size_t>(size)));
    }

    Dict dict(PyObject *o) {
        Dict result;
        result.reserve(static_cast<std::size_t>(PyDict_Size(o)));
        PyObject *key = nullptr, *item = nullptr;
        for (Py_ssize_t i = 0; PyDict_Next(o, &i, &key, &item);) result.add(text_of_key(key), (*this)(item));
        return result;
    }

    List list(PyObject *o) {
        List result;
        result.reserve(static_cast<std::size_t>(PySequence_Fast_GET_SIZE(o)));
        for (Py_ssize_t i = 0; i < PySequence_Fast_GET_SIZE(o); ++i)
            result.push_back((*this)(PySequence_Fast_GET_ITEM(o, i)));
        return result;
    }

    // A matrix or a row of doubles, which NumPy's arrays show without a Python object for each number.
    static std::optional<Value> doubles(PyObject *o) {
        Py_buffer view;
        if (!PyObject_CheckBuffer(o) ||
            PyObject_GetBuffer(o, &view, PyBUF_FORMAT | PyBUF_C_CONTIGUOUS) != 0) {
            PyErr_Clear();
            return std::nullopt;
        }
        const bool fits = (view.ndim == 1 || view.ndim == 2) && view.format &&
                          std::string_view(view.format) == "d" && view.len <= most_bytes;
        const auto *numbers = static_cast<const double *>(view.buf);
        List list;
        if (fits) {
            const auto rows = static_cast<std::size_t>(view.shape[0]);
            const std::size_t columns = view.ndim == 2 ? static_cast<std::size_t>(view.shape[1]) : 0;
            list.reserve(rows);
            for (std::size_t i = 0; i < rows; ++i)
                if (view.ndim == 1) list.push_back(numbers[i]);
                else list.push_back(List(numbers + i * columns, numbers + (i + 1) * columns));
        }
        PyBuffer_Release(&view);
        return fits ? std::optional<Value>(std::move(list)) : std::nullopt;
    }

    // NumPy's numbers and arrays, and whatever else behaves like a number or a sequence.
    Value other(PyObject *o) {
        const Py_ssize_t size = PySequence_Check(o) ? PySequence_Size(o) : -1;
        PyErr_Clear();
        if (size >= 0) return nested([&] { return sequence(o, size); });
        const nb::object index = PyIndex_Check(o) ? nb::steal(PyNumber_Index(o)) : nb::object();
        return conversion_failed() || !index.is_valid() ? number(o) : integer(index.ptr());
    }

    Value sequence(PyObject *o, Py_ssize_t size) {
        const Py_ssize_t left = within_sequence_ ? left_ : longest;
        if (size > left) return Object();
        const bool outermost = !std::exchange(within_sequence_, true);
        left_ = left - size;
        List result;
        result.reserve(static_cast<std::size_t>(size));
        for (Py_ssize_t i = 0; i < size; ++i) {
            const nb::object item = nb::steal(PySequence_GetItem(o, i));
            result.push_back(conversion_failed() ? Value(Object()) : (*this)(item));
        }
        if (outermost) within_sequence_ = false;
        return result;
    }

    int depth_ = 0;
    bool within_sequence_ = false;
    Py_ssize_t left_ = 0;
};

// The object that `part` of a value was made of; invalid where it is no part of it.
nb::object origin_of(const Value *part, const Value &value, nb::handle source) {
    if (part == &value) return nb::borrow(source);
    nb::object found;
    if (const List *const list = value.get_if<List>()) {
        for (std::size_t i = 0; i < list->size() && !found.is_valid(); ++i) {
            const nb::object item = nb::steal(PySequence_GetItem(source.ptr(), static_cast<Py_ssize_t>(i)));
            if (!conversion_failed()) found = origin_of(part, (*list)[i], item);
        }
    } else if (const Dict *const dict = value.get_if<Dict>()) {
        PyObject *key = nullptr, *item = nullptr;
        Py_ssize_t position = 0;
        for (const auto &[name, entry] : *dict)
            if (!found.is_valid() && PyDict_Next(source.ptr(), &position, &key, &item))
                found = origin_of(part, entry, item);
    }
    return found;
}

} // namespace

Value value_of(nb::handle source) { return Converter()(source); }

UnexpectedValue called_as_in_python(const UnexpectedValue &error, const Value &value, nb::handle source) {
    const nb::object got = origin_of(error.got(), value, source);
    return got.is_valid() ? error.called(nb::repr(got).c_str()) : error;
}

nb::dict object_of(const Dict &value) {
    nb::dict result;
    for (const auto &[key, item] : value) result[key.c_str()] = object_of(item);
    return result;
}

nb::object object_of(const Value &value) {
    if (const auto *truth = value.get_if<bool>()) return nb::bool_(*truth);
    if (const auto *integer = value.get_if<std::int64_t>()) return nb::int_(*integer);
    if (const auto *number = value.get_if<double>()) return nb::float_(*number);
    if (const auto *text = value.get_if<std::string>()) return nb::str(text->c_str(), text->size());
    if (const auto *dict = value.get_if<Dict>()) return object_of(*dict);
    const auto *list = value.get_if<List>();
    if (!list) return nb::none();
    nb::list result;
    for (const Value &item : *list) result.append(object_of(item));
    return result;
}

} // namespace lajolla
