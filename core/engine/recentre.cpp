#include "engine/recentre.h"

#include <algorithm>
#include <cmath>
#include <optional>
#include <utility>

#include "engine/describe.h"

namespace lajolla {

namespace {

using Matrix = std::array<std::array<double, 4>, 4>;

// A number in a description; nullopt for other values, which are rejected when they are read.
std::optional<double> number_of(const Value &value) {
    if (const auto *number = value.get_if<double>()) return *number;
    if (const auto *integer = value.get_if<std::int64_t>()) return static_cast<double>(*integer);
    return std::nullopt;
}

template <class Item, std::size_t n>
bool read_all(const Value &source, std::array<Item, n> &result, auto &&read) {
    const List *const list = source.get_if<List>();
    return list && list->size() == n &&
           std::equal(list->begin(), list->end(), result.begin(),
                      [&](const Value &given, Item &item) { return read(given, item); });
}
bool read_number(const Value &source, double &number) {
    const auto given = number_of(source);
    number = given.value_or(0);
    return given.has_value();
}
bool read_point(const Value &source, Point &point) { return read_all(source, point, read_number); }
bool read_matrix(const Value &source, Matrix &matrix) {
    return read_all(source, matrix, [](const Value &row, std::array<double, 4> &numbers) {
        return read_all(row, numbers, read_number);
    });
}

Value value_of(const auto &numbers) { return List(numbers.begin(), numbers.end()); }

Point difference(Point a, const Point &b) {
    for (std::size_t axis = 0; axis < 3; ++axis) a[axis] -= b[axis];
    return a;
}

// An entry with other values under some keys.
Dict with(const Dict &entry, const Dict &changed) {
    Dict result;
    for (const auto &[key, value] : entry)
        if (!changed.contains(key)) result.add(key, value);
    for (const auto &[key, value] : changed) result.add(key, value);
    return result;
}

// A point of an entry; the origin if it is not given.
Point point_at(const Dict &entry, const char *key) {
    Point point{};
    if (const Value *const given = entry.find(key)) read_point(*given, point);
    return point;
}

// Moves an entry with a transform; its contents are first moved to `anchor`.
Dict placed(const Dict &entry, const Point &centre, const Point &anchor = {}) {
    Matrix m{{{1, 0, 0, 0}, {0, 1, 0, 0}, {0, 0, 1, 0}, {0, 0, 0, 1}}};
    const Value *const given = entry.find("to_world");
    if (given && !read_matrix(*given, m)) return entry; // it will be rejected
    for (std::size_t row = 0; row < 3; ++row)
        m[row][3] += m[row][0] * anchor[0] + m[row][1] * anchor[1] + m[row][2] * anchor[2] - centre[row];
    List rows;
    for (const auto &row : m) rows.push_back(value_of(row));
    return with(entry, {{"to_world", std::move(rows)}});
}

// The same with points that are placed by the transform, the first of which becomes the origin.
Dict placed(const Dict &entry, const Point &centre, std::initializer_list<const char *> points) {
    const Point anchor = point_at(entry, *points.begin());
    Dict changed;
    for (const char *const key : points)
        if (entry.contains(key)) changed.add(key, value_of(difference(point_at(entry, key), anchor)));
    return with(placed(entry, centre, anchor), changed);
}

Dict moved_point(const Dict &entry, const char *key, const Point &centre) {
    return with(entry, {{key, value_of(difference(point_at(entry, key), centre))}});
}

Dict moved_shape(const Dict &entry, const Point &centre) {
    if (entry.contains("center")) return placed(entry, centre, {"center"});                       // sphere
    if (entry.contains("p0") && entry.contains("p1")) return placed(entry, centre, {"p0", "p1"}); // cylinder
    return placed(entry, centre);
}

// Lights at infinity do not move, and area lights move with their shapes.
Dict moved_light(const Dict &entry, const Point &centre) {
    std::string type;
    if (const Value *const given = entry.find("type")) Described<std::string>::read(*given, type);
    if (type == "point") return moved_point(entry, "position", centre);
    return type == "spot" || type == "projector" ? placed(entry, centre) : entry;
}

Dict moved_sensor(const Dict &entry, const Point &centre) {
    const Dict result = placed(entry, centre);
    return entry.contains("target") ? moved_point(result, "target", centre) : result;
}

// The entries of a list, each replaced by move(entry, index).
Value moved_all(const Value &list, auto &&move) {
    const List *const entries = list.get_if<List>();
    if (!entries) return list;
    List result;
    for (const Value &entry : *entries) {
        const Dict *const dict = entry.get_if<Dict>();
        const auto rows = dict ? row_count(*dict) : std::nullopt;
        for (std::size_t row = 0; row < rows.value_or(0); ++row)
            result.push_back(move(row_of(*dict, row), result.size()));
        if (!rows) result.push_back(dict ? Value(move(*dict, result.size())) : entry);
    }
    return result;
}

// The new origin for something with these bounds, or nullopt if it need not move. It is a multiple of a power
// of two about as large as the bounds, so that round coordinates stay round, and translating a scene by such
// a multiple does not change the image.
std::optional<Point> far_centre(const Bounds &box) {
    if (box.empty()) return std::nullopt;
    Point middle{};
    double farthest = 0, squared = 0;
    for (std::size_t axis = 0; axis < 3; ++axis) {
        const double low = box.low[axis], high = box.high[axis];
        middle[axis] = (low + high) / 2;
        farthest = std::max(farthest, std::abs(middle[axis]));
        squared += (high - low) * (high - low) / 4;
    }
    const double size = std::max(std::sqrt(squared), farthest * 0x1p-24); // at least one ulp
    constexpr double near_enough = 16;
    if (!(farthest > near_enough * size)) return std::nullopt;
    const double step = std::exp2(std::ceil(std::log2(4 * size)));
    for (double &x : middle) x = std::round(x / step) * step;
    return middle;
}

} // namespace

bool Origins::move(const SceneParts &parts) {
    bool moved = false;
    const auto move_to = [&](Point &origin, const Bounds &box) {
        const auto centre = far_centre(box);
        for (std::size_t axis = 0; centre && axis < 3; ++axis) origin[axis] += (*centre)[axis];
        moved |= centre.has_value();
    };
    move_to(scene, bounds_of(parts));

    groups.resize(parts.groups.size());
    group_of.assign(parts.shapes.size(), no_group);
    bool share = false; // then groups stay where they are
    for (std::size_t group = 0; group < groups.size(); ++group)
        for (const std::uint32_t id : parts.groups[group])
            share |= std::exchange(group_of[id], group) != no_group;
    for (std::size_t group = 0; group < groups.size() && !share; ++group) {
        Bounds box;
        for (const std::uint32_t id : parts.groups[group])
            box.extend(match(parts.shapes[id], [](const auto &shape) { return shape.bounds(); }));
        move_to(groups[group], box);
    }
    return moved;
}

bool Origins::any_moved() const {
    const auto is_moved = [](const Point &origin) { return origin != Point{}; };
    return is_moved(scene) || std::ranges::any_of(groups, is_moved);
}

Dict recentred(const Dict &description, const SceneParts &parts, const Origins &origins) {
    const Point &centre = origins.scene;
    const auto place = [&](const Dict &entry, std::size_t) { return placed(entry, centre); };
    const auto move_shape = [&](const Dict &entry, std::size_t index) {
        const std::size_t group = origins.group_of[index];
        return moved_shape(entry, group == Origins::no_group ? centre : origins.groups[group]);
    };
    const auto move_instance = [&](const Dict &entry, std::size_t index) {
        return placed(entry, centre, origins.groups[static_cast<std::size_t>(parts.instances[index].group)]);
    };
    const auto move_light = [&](const Dict &entry, std::size_t) { return moved_light(entry, centre); };

    Dict result;
    for (const auto &[key, value] : description) {
        if (key == "shapes") result.add(key, moved_all(value, move_shape));
        else if (key == "emitters") result.add(key, moved_all(value, move_light));
        else if (key == "instances") result.add(key, moved_all(value, move_instance));
        else if (key == "volumes") result.add(key, moved_all(value, place));
        else if (const Dict *const sensor = key == "sensor" ? value.get_if<Dict>() : nullptr)
            result.add(key, sensor->contains("type") ? moved_sensor(*sensor, centre) : *sensor);
        else result.add(key, value);
    }
    return result;
}

} // namespace lajolla
