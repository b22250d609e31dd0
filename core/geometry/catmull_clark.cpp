#include "geometry/catmull_clark.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <unordered_map>

#include "base/math.h"

namespace lajolla {

namespace {

constexpr double pi_d = std::numbers::pi;

// Of weights for tangents, for which float's precision suffices.
double cosine(double x) { return cos(static_cast<float>(x)); }
double sine(double x) { return sin(static_cast<float>(x)); }

Vec3d cross(const Vec3d &a, const Vec3d &b) {
    return {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
}
double dot(const Vec3d &a, const Vec3d &b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }
void add(Vec3d &sum, double weight, const Vec3d &v) {
    for (std::size_t i = 0; i < 3; ++i) sum[i] += weight * v[i];
}

float decayed(float sharpness) {
    return sharpness >= infinitely_sharp ? sharpness : std::max(sharpness - 1, 0.0f);
}
bool will_decay(float sharpness) { return sharpness > 0 && sharpness < infinitely_sharp; }

// The directions from a vertex to its neighbours, in a sector of k faces: k edges and the one at the end, and
// the opposite corners of the faces.
struct Fan {
    std::vector<Vec3d> edges, diagonals;
    std::size_t size() const { return diagonals.size(); }
};

// Tangents at a vertex without creases (Halstead et al. 1993, appendix).
std::array<Vec3d, 2> smooth_tangents(const Fan &fan) {
    const auto n = static_cast<double>(fan.size());
    const double c = cosine(2 * pi_d / n);
    const double edge = 1 + c + cosine(pi_d / n) * std::sqrt(2 * (9 + c));
    std::array<Vec3d, 2> result{};
    for (std::size_t i = 0; i < fan.size(); ++i) {
        const double here = 2 * pi_d * static_cast<double>(i) / n, next = here + 2 * pi_d / n;
        add(result[0], edge * cosine(here), fan.edges[i]);
        add(result[0], cosine(here) + cosine(next), fan.diagonals[i]);
        add(result[1], edge * sine(here), fan.edges[i]);
        add(result[1], sine(here) + sine(next), fan.diagonals[i]);
    }
    return result;
}

// Tangents along and across a crease, on one side of it (Biermann et al. 2000, section 4). Across a single
// face, the edges meet like a parabola: its axis is the tangent.
std::array<Vec3d, 2> crease_tangents(const Fan &fan) {
    const std::size_t k = fan.size();
    std::array<Vec3d, 2> result{};
    add(result[0], 1, fan.edges.front());
    add(result[0], -1, fan.edges.back());
    if (k == 1) {
        add(result[1], 1, fan.edges.front());
        add(result[1], 1, fan.edges.back());
        return result;
    }
    const double theta = pi_d / static_cast<double>(k), r = (cosine(theta) + 1) / sine(theta);
    const double ends = -r * (1 + 2 * cosine(theta));
    add(result[1], ends, fan.edges.front());
    add(result[1], ends, fan.edges.back());
    for (std::size_t i = 0; i < k; ++i) {
        const double here = sine(static_cast<double>(i) * theta);
        const double next = sine(static_cast<double>(i + 1) * theta);
        if (i > 0) add(result[1], 4 * here, fan.edges[i]);
        add(result[1], here + next, fan.diagonals[i]);
    }
    return result; // the weights of the vertex itself do not count: all are directions from there
}

} // namespace

// --- topology --------------------------------------------------------------------------------------------

SubdivisionLevel::SubdivisionLevel(std::span<const std::uint32_t> sizes,
                                   std::span<const std::uint32_t> corners, std::vector<float> sharpness,
                                   std::vector<float> corner_sharpness, std::vector<double> values,
                                   std::size_t width)
    : width_(width), first_{0}, start_(corners.begin(), corners.end()), sharpness_(std::move(sharpness)),
      corner_sharpness_(std::move(corner_sharpness)), values_(std::move(values)) {
    for (const std::uint32_t size : sizes) {
        face_.insert(face_.end(), size, static_cast<std::uint32_t>(first_.size() - 1));
        first_.push_back(first_.back() + size);
    }
    find_twins();
    find_outgoing();
}

void SubdivisionLevel::find_twins() {
    struct Edge {
        std::int32_t up = none, down = none; // half-edges to the larger and to the smaller vertex
        bool is_regular = true;
    };
    std::unordered_map<std::uint64_t, Edge> edges;
    edges.reserve(start_.size());
    const auto edge_of = [&](std::uint32_t h) -> Edge & {
        const std::uint64_t a = start_[h], b = start_[next(h)];
        return edges[std::min(a, b) << 32 | std::max(a, b)];
    };
    for (std::uint32_t h = 0; h < start_.size(); ++h) {
        Edge &edge = edge_of(h);
        std::int32_t &side = start_[h] < start_[next(h)] ? edge.up : edge.down;
        edge.is_regular &= side == none;
        side = static_cast<std::int32_t>(h);
    }
    twin_.assign(start_.size(), none);
    for (std::uint32_t h = 0; h < start_.size(); ++h) {
        const Edge &edge = edge_of(h);
        if (edge.is_regular) twin_[h] = start_[h] < start_[next(h)] ? edge.down : edge.up;
        if (twin_[h] == none) sharpness_[h] = boundary;
    }
}

void SubdivisionLevel::find_outgoing() {
    first_outgoing_.assign(vertex_count() + 1, 0);
    for (const std::uint32_t v : start_) ++first_outgoing_[v + 1];
    for (std::size_t v = 0; v < vertex_count(); ++v) first_outgoing_[v + 1] += first_outgoing_[v];
    outgoing_.resize(start_.size());
    std::vector<std::uint32_t> next_place(first_outgoing_.begin(), first_outgoing_.end() - 1);
    for (std::uint32_t h = 0; h < start_.size(); ++h) outgoing_[next_place[start_[h]]++] = h;
}

void SubdivisionLevel::for_each_edge(std::uint32_t vertex, auto &&f) const {
    for (const std::uint32_t h : around(vertex)) {
        f(h, start_[next(h)]);
        const std::uint32_t before = previous(h);
        if (twin_[before] == none) f(before, start_[before]);
    }
}

// --- refinement ------------------------------------------------------------------------------------------

SubdivisionLevel::Rule SubdivisionLevel::rule(std::uint32_t vertex, float decay) const {
    const auto is_sharp = [&](float s) { return s > (s >= infinitely_sharp ? 0 : decay); };
    Rule result;
    for_each_edge(vertex, [&](std::uint32_t h, std::uint32_t end) {
        if (!is_sharp(sharpness_[h])) return;
        if (result.sharp < 2) result.ends[result.sharp] = end;
        ++result.sharp;
    });
    if (result.sharp > 2 || is_sharp(corner_sharpness_[vertex])) result.kind = Kind::corner;
    else if (result.sharp == 2) result.kind = Kind::crease;
    return result;
}

// How much of the rule of this level remains where sharpness ends before the next one.
float SubdivisionLevel::transition(std::uint32_t vertex) const {
    float sum = 0, count = 0;
    const auto note = [&](float sharpness) {
        if (sharpness > 0 && decayed(sharpness) == 0) sum += sharpness, ++count;
    };
    note(corner_sharpness_[vertex]);
    for_each_edge(vertex, [&](std::uint32_t h, std::uint32_t) { note(sharpness_[h]); });
    return count > 0 ? std::min(sum / count, 1.0f) : 0;
}

std::vector<double> SubdivisionLevel::face_points() const {
    std::vector<double> result(face_count() * width_);
    for (std::size_t f = 0; f < face_count(); ++f)
        for (std::uint32_t h = first_[f]; h < first_[f + 1]; ++h)
            for (std::size_t i = 0; i < width_; ++i)
                result[f * width_ + i] += value(start_[h])[i] / static_cast<double>(size(f));
    return result;
}

void SubdivisionLevel::edge_point(std::uint32_t h, const std::vector<double> &centres, double *result) const {
    const double *a = value(start_[h]), *b = value(start_[next(h)]);
    const double sharp = twin_[h] == none ? 1 : std::min(sharpness_[h], 1.0f);
    const double *left = centres.data() + face_[h] * width_;
    const double *right =
        sharp < 1 ? centres.data() + face_[static_cast<std::size_t>(twin_[h])] * width_ : left;
    for (std::size_t i = 0; i < width_; ++i) {
        const double middle = (a[i] + b[i]) / 2;
        result[i] =
            sharp < 1 ? sharp * middle + (1 - sharp) * (a[i] + b[i] + left[i] + right[i]) / 4 : middle;
    }
}

// Adds the point where a rule moves a vertex to.
void SubdivisionLevel::apply(const Rule &rule, std::uint32_t v, const std::vector<double> &centres,
                             double weight, double *result) const {
    const auto add_value = [&](double share, const double *values) {
        for (std::size_t i = 0; i < width_; ++i) result[i] += weight * share * values[i];
    };
    if (rule.kind == Kind::corner) return add_value(1, value(v));
    if (rule.kind == Kind::crease) {
        add_value(0.75, value(v));
        for (const std::uint32_t end : rule.ends) add_value(0.125, value(end));
        return;
    }
    const auto faces = around(v);
    const auto n = static_cast<double>(faces.size()); // as many as edges, for there is no boundary
    add_value((n - 2) / n, value(v));
    for (const std::uint32_t h : faces) {
        add_value(1 / (n * n), value(start_[next(h)]));
        add_value(1 / (n * n), centres.data() + face_[h] * width_);
    }
}

void SubdivisionLevel::vertex_point(std::uint32_t v, const std::vector<double> &centres,
                                    double *result) const {
    const Rule now = rule(v), then = rule(v, 1);
    const double weight = now.kind == then.kind ? 1 : transition(v);
    std::fill(result, result + width_, 0.0);
    if (weight > 0) apply(now, v, centres, weight, result);
    if (weight < 1) apply(then, v, centres, 1 - weight, result);
}

SubdivisionLevel SubdivisionLevel::refined(const std::vector<bool> &corners, Children &children) const {
    SubdivisionLevel result;
    result.width_ = width_;
    const std::size_t count = half_edge_count();
    children.faces.assign(count, none), children.edges.assign(count, none);
    children.vertices.assign(vertex_count(), none), children.centres.assign(face_count(), none);
    const std::vector<double> centres = face_points();

    // The corner of a child quad that is the corner of its parent.
    const auto turn = [&](std::uint32_t h) {
        const std::uint32_t f = face_[h];
        return size(f) == 4 ? h - first_[f] : 0;
    };
    const auto new_vertex = [&](std::int32_t &number, float sharpness, const auto &fill) {
        if (number == none) {
            number = static_cast<std::int32_t>(result.corner_sharpness_.size());
            result.corner_sharpness_.push_back(sharpness);
            result.values_.resize(result.values_.size() + width_);
            fill(result.values_.data() + result.values_.size() - width_);
        }
        return static_cast<std::uint32_t>(number);
    };
    const auto edge_vertex = [&](std::uint32_t h) {
        const bool has_twin = twin_[h] != none;
        std::int32_t &number =
            children.edges[has_twin ? std::min(h, static_cast<std::uint32_t>(twin_[h])) : h];
        const std::uint32_t v =
            new_vertex(number, 0, [&](double *target) { edge_point(h, centres, target); });
        children.edges[h] = static_cast<std::int32_t>(v);
        return v;
    };
    for (std::uint32_t h = 0; h < count; ++h) {
        if (!corners[h]) continue;
        const std::uint32_t f = face_[h], v = start_[h];
        children.faces[h] = static_cast<std::int32_t>(result.first_.size());
        result.first_.push_back(static_cast<std::uint32_t>(result.start_.size()));
        const std::array<std::uint32_t, 4> ring{
            new_vertex(children.vertices[v], decayed(corner_sharpness_[v]),
                       [&](double *target) { vertex_point(v, centres, target); }),
            edge_vertex(h),
            new_vertex(children.centres[f], 0,
                       [&](double *target) { std::copy_n(centres.data() + f * width_, width_, target); }),
            edge_vertex(previous(h))};
        const std::array<float, 4> sharpness{decayed(sharpness_[h]), 0, 0, decayed(sharpness_[previous(h)])};
        for (std::uint32_t k = 0; k < 4; ++k) {
            const std::uint32_t role = (k + 4 - turn(h)) % 4;
            result.start_.push_back(ring[role]);
            result.sharpness_.push_back(sharpness[role]);
            result.face_.push_back(static_cast<std::uint32_t>(children.faces[h]));
        }
    }
    result.first_.push_back(static_cast<std::uint32_t>(result.start_.size()));

    // Of a child, the half-edges 0 and 3 run along edges of the parent, 1 and 2 inside it.
    const auto child_edge = [&](std::uint32_t h, std::uint32_t role) {
        const std::int32_t child = children.faces[h];
        return child == none ? none : 4 * child + static_cast<std::int32_t>((turn(h) + role) % 4);
    };
    result.twin_.assign(result.start_.size(), none);
    for (std::uint32_t h = 0; h < count; ++h) {
        if (children.faces[h] == none) continue;
        const auto set = [&](std::uint32_t role, std::int32_t other) {
            result.twin_[static_cast<std::size_t>(child_edge(h, role))] = other;
        };
        const std::int32_t along = twin_[h], before = twin_[previous(h)];
        if (along != none) set(0, child_edge(next(static_cast<std::uint32_t>(along)), 3));
        set(1, child_edge(next(h), 2));
        set(2, child_edge(previous(h), 1));
        if (before != none) set(3, child_edge(static_cast<std::uint32_t>(before), 0));
    }
    result.find_outgoing();
    return result;
}

// --- limits ----------------------------------------------------------------------------------------------

bool SubdivisionLevel::has_limit(std::uint32_t vertex) const {
    bool result = !will_decay(corner_sharpness_[vertex]);
    std::uint32_t sharp = 0;
    for_each_edge(vertex, [&](std::uint32_t h, std::uint32_t) {
        result = result && !will_decay(sharpness_[h]);
        sharp += sharpness_[h] > 0;
    });
    for (const std::uint32_t h : around(vertex)) result = result && size(face_[h]) == 4;
    return result && sharp != 1; // where a crease ends, the limit is not known in closed form
}

void SubdivisionLevel::limit(std::uint32_t vertex, std::span<double> values) const {
    const Rule how = rule(vertex);
    std::fill(values.begin(), values.end(), 0.0);
    const auto add_value = [&](double share, std::uint32_t v) {
        for (std::size_t i = 0; i < width_; ++i) values[i] += share * value(v)[i];
    };
    if (how.kind == Kind::corner) return add_value(1, vertex);
    if (how.kind == Kind::crease) {
        add_value(4.0 / 6, vertex);
        for (const std::uint32_t end : how.ends) add_value(1.0 / 6, end);
        return;
    }
    const auto faces = around(vertex);
    const auto n = static_cast<double>(faces.size());
    const double whole = n * (n + 5);
    add_value(n * n / whole, vertex);
    for (const std::uint32_t h : faces) {
        add_value(4 / whole, start_[next(h)]);
        add_value(1 / whole, start_[next(next(h))]);
    }
}

// The half-edges that start at a vertex, counterclockwise from one crease to the next; all of them if
// `closed`.
std::vector<std::uint32_t> SubdivisionLevel::sector(std::uint32_t h, bool closed) const {
    const auto crosses = [&](std::uint32_t edge) {
        return twin_[edge] != none && (closed || !(sharpness_[edge] > 0));
    };
    std::uint32_t begin = h;
    while (crosses(begin)) {
        begin = next(static_cast<std::uint32_t>(twin_[begin]));
        if (begin == h) break;
    }
    std::vector<std::uint32_t> result{begin};
    while (crosses(previous(result.back()))) {
        const auto other = static_cast<std::uint32_t>(twin_[previous(result.back())]);
        if (other == begin) break;
        result.push_back(other);
    }
    return result;
}

Vec3d SubdivisionLevel::offset(std::uint32_t from, std::uint32_t to) const {
    const double *a = value(from), *b = value(to);
    return {b[0] - a[0], b[1] - a[1], b[2] - a[2]};
}

Vec3d SubdivisionLevel::limit_normal(std::uint32_t h) const {
    const std::uint32_t vertex = start_[h];
    const Rule how = rule(vertex);
    const bool closed = how.sharp < 2;
    Fan fan;
    Vec3d flat{}; // the sum of the faces' normals
    const std::vector<std::uint32_t> edges = sector(h, closed);
    for (const std::uint32_t edge : edges) {
        fan.edges.push_back(offset(vertex, start_[next(edge)]));
        fan.diagonals.push_back(offset(vertex, start_[next(next(edge))]));
        const Vec3d end = offset(vertex, start_[previous(edge)]);
        add(flat, 1, cross(fan.edges.back(), end));
    }
    std::array<Vec3d, 2> tangents{};
    if (closed) {
        tangents = smooth_tangents(fan);
    } else {
        fan.edges.push_back(offset(vertex, start_[previous(edges.back())]));
        tangents =
            how.kind == Kind::crease ? crease_tangents(fan) : std::array{fan.edges.front(), fan.edges.back()};
    }
    const auto length = [](const Vec3d &v) { return std::sqrt(dot(v, v)); };
    Vec3d normal = cross(tangents[0], tangents[1]);
    if (!(length(normal) > 1e-10 * length(tangents[0]) * length(tangents[1]))) normal = flat;
    const double size = length(normal) * (dot(normal, flat) < 0 ? -1 : 1);
    if (size == 0 || !std::isfinite(size)) return {};
    for (double &x : normal) x /= size;
    return normal;
}

} // namespace lajolla
