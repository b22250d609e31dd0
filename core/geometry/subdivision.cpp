#include "geometry/subdivision.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <optional>
#include <stdexcept>

#include "geometry/control_surface.h"

namespace lajolla {

namespace {

constexpr std::uint32_t unset = ~0u;
constexpr unsigned levels_for_limits = 10; // after which what is not in closed form counts as its limit

Vec3f to_float(const Vec3d &v) {
    return {static_cast<float>(v[0]), static_cast<float>(v[1]), static_cast<float>(v[2])};
}

// The right and the upper ones of a quad's corners, which run from the lower left one counterclockwise.
constexpr std::uint32_t is_right(std::uint32_t corner) { return corner == 1 || corner == 2; }
constexpr std::uint32_t is_upper(std::uint32_t corner) { return corner >= 2; }

// A face of four corners, or the part of another face at one of its corners.
struct Patch {
    std::uint32_t face;
    bool is_part;
    std::uint8_t level;                  // of its grid, with 2^level squares along each edge
    std::array<std::uint8_t, 4> edges{}; // levels of its edges, none of which is higher
    std::uint32_t first_place = 0;       // of its grid, among all

    unsigned depth() const { return level + (is_part ? 1u : 0u); } // the level of subdivision with this grid
    std::uint32_t squares() const { return 1u << level; }
    std::uint32_t place(std::uint32_t i, std::uint32_t j) const {
        return first_place + j * (squares() + 1) + i;
    }
};

// The place of a face of a level in its quad: (x, y) of its lower left corner in units of its size.
struct Label {
    std::uint32_t quad = unset, x = 0, y = 0;
};

// A point of a grid, whose limit is looked for where a half-edge starts.
struct Request {
    std::uint32_t half_edge, quad, place;
};

// The quads of a mesh, with the levels of their edges.
std::vector<Patch> quads_of(const SubdivisionLevel &mesh, std::span<const std::uint8_t> levels) {
    std::vector<std::uint8_t> edges(levels.begin(), levels.end());
    const auto raise = [&](std::uint32_t h, std::uint8_t level) { edges[h] = std::max(edges[h], level); };
    for (std::uint32_t h = 0; h < edges.size(); ++h) {
        if (mesh.size(mesh.face_of(h)) != 4) raise(h, 1);
        if (mesh.twin(h) == SubdivisionLevel::none) continue;
        const auto twin = static_cast<std::uint32_t>(mesh.twin(h));
        if (mesh.size(mesh.face_of(twin)) != 4) raise(h, 1);
        raise(h, edges[twin]);
        raise(twin, edges[h]);
    }
    std::vector<Patch> quads;
    for (std::uint32_t f = 0; f < mesh.face_count(); ++f) {
        const std::uint32_t first = mesh.first(f), size = mesh.size(f);
        const std::uint8_t highest = *std::max_element(edges.begin() + first, edges.begin() + first + size);
        if (size == 4) {
            quads.push_back({f, false, highest, {}, 0});
            std::copy_n(edges.begin() + first, 4, quads.back().edges.begin());
            continue;
        }
        const auto inner = static_cast<std::uint8_t>(highest - 1);
        for (std::uint32_t h = first; h < first + size; ++h)
            quads.push_back({f,
                             true,
                             inner,
                             {static_cast<std::uint8_t>(edges[h] - 1), inner, inner,
                              static_cast<std::uint8_t>(edges[mesh.previous(h)] - 1)},
                             0});
    }
    return quads;
}

std::size_t triangle_count(const std::vector<Patch> &quads) {
    std::size_t count = 0;
    for (const Patch &quad : quads) count += std::size_t{2} << (2 * quad.level);
    return count;
}

// Refines level by level, and collects the vertices of the grids.
class Dicing {
public:
    Dicing(const PolygonMesh &mesh, const SubdivisionRules &rules, std::vector<Patch> quads)
        : mesh_(mesh), rules_(rules), quads_(std::move(quads)), first_quads_(first_quads(mesh)),
          surface_(control_surface(mesh, rules.boundary)) {
        if (!mesh.uvs.empty() && rules.uvs == SubdivisionUvs::smooth) uvs_.emplace(control_uvs(mesh));
        std::uint32_t places = 0;
        for (Patch &quad : quads_) {
            quad.first_place = places;
            places += (quad.squares() + 1) * (quad.squares() + 1);
        }
        vertices_.assign(places, unset);
        for (const auto &[name, attribute] : mesh.attributes)
            result_.mesh.attributes[name] = {attribute.channels, attribute.per_face, {}};
    }

    SubdivisionSurface run() {
        labels_.resize(surface_.face_count());
        for (std::uint32_t f = 0; f < surface_.face_count(); ++f)
            if (surface_.size(f) == 4) labels_[f].quad = first_quads_[f];
        points_.resize(surface_.vertex_count());
        std::iota(points_.begin(), points_.end(), 0u);
        point_count_ = static_cast<std::uint32_t>(points_.size());
        for (depth_ = 0;; ++depth_) {
            request_grids();
            resolve_requests();
            const std::vector<bool> corners = corners_to_refine();
            if (std::find(corners.begin(), corners.end(), true) == corners.end()) break;
            refine(corners);
        }
        make_triangles();
        return std::move(result_);
    }

private:
    void request_grids() {
        for (std::uint32_t f = 0; f < labels_.size(); ++f) {
            const Label &label = labels_[f];
            if (label.quad == unset || quads_[label.quad].depth() != depth_) continue;
            for (std::uint32_t c = 0; c < 4; ++c) {
                const std::uint32_t place =
                    quads_[label.quad].place(label.x + is_right(c), label.y + is_upper(c));
                if (vertices_[place] != unset) continue;
                vertices_[place] = unset - 1; // is requested
                requests_.push_back({surface_.first(f) + c, label.quad, place});
            }
        }
    }

    void resolve_requests() {
        std::vector<Request> later;
        for (const Request &request : requests_) {
            const bool is_last = depth_ >= quads_[request.quad].depth() + levels_for_limits;
            if (is_last || surface_.has_limit(surface_.start(request.half_edge)))
                vertices_[request.place] = vertex_at(request);
            else later.push_back(request);
        }
        requests_ = std::move(later);
    }

    std::uint32_t vertex_at(const Request &request) {
        const std::uint32_t h = request.half_edge, point = points_[surface_.start(h)];
        if (first_at_.size() < point_count_) first_at_.resize(point_count_, unset);
        const bool is_known = first_at_[point] != unset && surface_.is_smooth(surface_.start(h));
        const Vec3f normal =
            is_known ? result_.mesh.normals[first_at_[point]] : to_float(surface_.limit_normal(h));
        const Vec2f uv = uv_at(request);
        for (std::uint32_t v = first_at_[point]; v != unset; v = next_at_[v])
            if (result_.mesh.normals[v] == normal &&
                (mesh_.uvs.empty() || (result_.mesh.uvs[v].x == uv.x && result_.mesh.uvs[v].y == uv.y)))
                return v;
        return add_vertex(surface_.start(h), point, normal, uv);
    }

    std::uint32_t add_vertex(std::uint32_t vertex, std::uint32_t point, const Vec3f &normal, Vec2f uv) {
        Mesh &mesh = result_.mesh;
        const auto number = static_cast<std::uint32_t>(mesh.positions.size());
        const std::uint32_t known = first_at_[point];
        scratch_.resize(surface_.width());
        if (known == unset) surface_.limit(vertex, scratch_);
        mesh.positions.push_back(known == unset ? to_float({scratch_[0], scratch_[1], scratch_[2]})
                                                : mesh.positions[known]);
        std::size_t at = 3;
        for (auto &[name, attribute] : mesh.attributes) {
            if (attribute.per_face) continue;
            for (std::size_t c = 0; c < attribute.channels; ++c, ++at)
                attribute.values.push_back(known == unset ? static_cast<float>(scratch_[at])
                                                          : attribute.values[known * attribute.channels + c]);
        }
        mesh.normals.push_back(normal);
        if (!mesh_.uvs.empty()) mesh.uvs.push_back(uv);
        result_.points.push_back(point);
        next_at_.push_back(known);
        return first_at_[point] = number;
    }

    Vec2f uv_at(const Request &request) const {
        if (mesh_.uvs.empty()) return {};
        if (uvs_) {
            std::array<double, 2> uv;
            uvs_->limit(uvs_->start(request.half_edge), uv);
            return {static_cast<float>(uv[0]), static_cast<float>(uv[1])};
        }
        const Patch &quad = quads_[request.quad];
        const std::uint32_t row = quad.squares() + 1, place = request.place - quad.first_place;
        const double s = static_cast<double>(place % row) / quad.squares(),
                     t = static_cast<double>(place / row) / quad.squares();
        const auto corners = linear_uvs(request.quad);
        std::array<float, 2> uv;
        for (std::size_t i = 0; i < 2; ++i)
            uv[i] = static_cast<float>((1 - t) * ((1 - s) * corners[0][i] + s * corners[1][i]) +
                                       t * ((1 - s) * corners[3][i] + s * corners[2][i]));
        return {uv[0], uv[1]};
    }

    // At the corners of a quad.
    std::array<std::array<double, 2>, 4> linear_uvs(std::uint32_t number) const {
        const Patch &quad = quads_[number];
        const std::uint32_t first = first_corner(quad.face), size = mesh_.sizes[quad.face];
        const auto uv = [&](std::uint32_t k) {
            const Vec2f v = mesh_.uvs[mesh_.uv_corners[first + k % size]];
            return std::array<double, 2>{v.x, v.y};
        };
        if (!quad.is_part) return {uv(0), uv(1), uv(2), uv(3)};
        const std::uint32_t k = number - first_quads_[quad.face];
        const auto middle = [&](std::uint32_t a, std::uint32_t b) {
            return std::array{(uv(a)[0] + uv(b)[0]) / 2, (uv(a)[1] + uv(b)[1]) / 2};
        };
        std::array<double, 2> centre{};
        for (std::uint32_t i = 0; i < size; ++i)
            for (std::size_t c = 0; c < 2; ++c) centre[c] += uv(i)[c] / size;
        return {uv(k), middle(k, k + 1), centre, middle(k, k + size - 1)};
    }
    std::uint32_t first_corner(std::uint32_t face) const { return first_corners_[face]; }

    // The corners at vertices whose surroundings the next level needs.
    std::vector<bool> corners_to_refine() const {
        std::vector<bool> vertices(surface_.vertex_count());
        for (std::uint32_t f = 0; f < labels_.size(); ++f)
            if (labels_[f].quad == unset || quads_[labels_[f].quad].depth() > depth_)
                for (std::uint32_t c = 0; c < surface_.size(f); ++c)
                    vertices[surface_.start(surface_.first(f) + c)] = true;
        for (const Request &request : requests_) vertices[surface_.start(request.half_edge)] = true;
        std::vector<bool> corners(surface_.half_edge_count());
        for (std::uint32_t h = 0; h < corners.size(); ++h) corners[h] = vertices[surface_.start(h)];
        return corners;
    }

    void refine(const std::vector<bool> &corners) {
        SubdivisionLevel::Children children, uv_children;
        SubdivisionLevel next = surface_.refined(corners, children);
        if (uvs_) uvs_ = uvs_->refined(corners, uv_children);
        std::vector<Label> labels(next.face_count());
        for (std::uint32_t h = 0; h < corners.size(); ++h)
            if (children.faces[h] >= 0) labels[static_cast<std::size_t>(children.faces[h])] = child_label(h);
        std::vector<std::uint32_t> points(next.vertex_count(), unset);
        for (std::size_t v = 0; v < children.vertices.size(); ++v)
            if (children.vertices[v] >= 0)
                points[static_cast<std::size_t>(children.vertices[v])] = points_[v];
        for (std::uint32_t &point : points)
            if (point == unset) point = point_count_++;
        for (Request &request : requests_) request.half_edge = successor(next, children, request.half_edge);
        surface_ = std::move(next);
        labels_ = std::move(labels), points_ = std::move(points);
    }

    Label child_label(std::uint32_t h) const {
        const std::uint32_t f = surface_.face_of(h), corner = h - surface_.first(f);
        const Label &label = labels_[f];
        if (label.quad == unset) return {first_quads_[f] + corner, 0, 0};
        return {label.quad, 2 * label.x + is_right(corner), 2 * label.y + is_upper(corner)};
    }

    // The half-edge of the next level that starts at the same vertex, in the same face.
    std::uint32_t successor(const SubdivisionLevel &next, const SubdivisionLevel::Children &children,
                            std::uint32_t h) const {
        std::uint32_t result = next.first(static_cast<std::size_t>(children.faces[h]));
        const auto vertex = static_cast<std::uint32_t>(children.vertices[surface_.start(h)]);
        while (next.start(result) != vertex) ++result;
        return result;
    }

    // --- triangles ---

    void make_triangles() {
        std::vector<std::uint32_t> order(mesh_.sizes.size());
        std::iota(order.begin(), order.end(), 0u);
        const auto group = [&](std::uint32_t face) { return mesh_.groups.empty() ? 0 : mesh_.groups[face]; };
        std::ranges::stable_sort(order, {}, group);
        auto &triangles = result_.mesh.triangles;
        result_.mesh.face_count = first_quads_.back();
        for (const std::uint32_t face : order) {
            const auto before = static_cast<std::uint32_t>(triangles.size());
            if (result_.groups.empty() || result_.groups.back()[0] != group(face))
                result_.groups.push_back({group(face), before, 0});
            for (std::uint32_t q = first_quads_[face]; q < first_quads_[face + 1]; ++q) add_quad(q);
            const auto count = static_cast<std::uint32_t>(triangles.size()) - before;
            result_.groups.back()[2] += count;
            for (auto &[name, attribute] : result_.mesh.attributes) {
                if (!attribute.per_face) continue;
                const float *values = mesh_.attributes.at(name).values.data() + face * attribute.channels;
                for (std::uint32_t i = 0; i < count; ++i)
                    attribute.values.insert(attribute.values.end(), values, values + attribute.channels);
            }
        }
    }

    // The points of a grid's border that its edge does not have become the nearest ones that it has:
    // neighbours then have the same vertices.
    static std::uint32_t snapped(const Patch &quad, std::uint32_t along, std::uint8_t edge_level) {
        const std::uint32_t step = 1u << (quad.level - edge_level);
        return (along + step / 2) / step * step;
    }

    void add_quad(std::uint32_t number) {
        const Patch &quad = quads_[number];
        const std::uint32_t n = quad.squares();
        const auto place = [&](std::uint32_t i, std::uint32_t j) {
            if (j == 0) i = snapped(quad, i, quad.edges[0]);
            else if (j == n) i = snapped(quad, i, quad.edges[2]);
            if (i == n) j = snapped(quad, j, quad.edges[1]);
            else if (i == 0) j = snapped(quad, j, quad.edges[3]);
            return quad.place(i, j);
        };
        for (std::uint32_t j = 0; j < n; ++j)
            for (std::uint32_t i = 0; i < n; ++i) {
                const std::array<std::uint32_t, 4> p{place(i, j), place(i + 1, j), place(i + 1, j + 1),
                                                     place(i, j + 1)};
                const auto length = [&](std::size_t a, std::size_t b) {
                    const auto &positions = result_.mesh.positions;
                    return length_squared(positions[vertices_[p[a]]] - positions[vertices_[p[b]]]);
                };
                if (length(0, 2) <= length(1, 3)) {
                    add_triangle(number, p[0], p[1], p[2]);
                    add_triangle(number, p[0], p[2], p[3]);
                } else {
                    add_triangle(number, p[0], p[1], p[3]);
                    add_triangle(number, p[1], p[2], p[3]);
                }
            }
    }

    void add_triangle(std::uint32_t number, std::uint32_t a, std::uint32_t b, std::uint32_t c) {
        if (a == b || b == c || c == a) return;
        const Patch &quad = quads_[number];
        const std::uint32_t row = quad.squares() + 1;
        const auto at = [&](std::uint32_t place) {
            const std::uint32_t i = place - quad.first_place;
            return FaceCoordinates::packed(static_cast<float>(i % row) / static_cast<float>(row - 1),
                                           static_cast<float>(i / row) / static_cast<float>(row - 1));
        };
        result_.mesh.triangles.push_back({vertices_[a], vertices_[b], vertices_[c]});
        result_.mesh.face_coordinates.push_back({number, {at(a), at(b), at(c)}});
    }

    static std::vector<std::uint32_t> offsets(const std::vector<std::uint32_t> &sizes) {
        std::vector<std::uint32_t> result{0};
        for (const std::uint32_t size : sizes) result.push_back(result.back() + size);
        return result;
    }

    const PolygonMesh &mesh_;
    SubdivisionRules rules_;
    std::vector<Patch> quads_;
    std::vector<std::uint32_t> first_quads_, first_corners_ = offsets(mesh_.sizes);
    SubdivisionLevel surface_;
    std::optional<SubdivisionLevel> uvs_; // with the same half-edges as the surface
    unsigned depth_ = 0;
    std::vector<Label> labels_;         // of the level's faces
    std::vector<std::uint32_t> points_; // of the level's vertices: which point of the surface each one is
    std::uint32_t point_count_ = 0;
    std::vector<Request> requests_;
    std::vector<std::uint32_t> vertices_;           // of the grids' places
    std::vector<std::uint32_t> first_at_, next_at_; // the vertices at each point, as linked lists
    std::vector<double> scratch_;
    SubdivisionSurface result_;
};

} // namespace

SubdivisionSurface subdivide(const PolygonMesh &mesh, const SubdivisionRules &rules,
                             std::span<const std::uint8_t> levels, std::size_t most_triangles) {
    validate(mesh);
    if (levels.size() != mesh.corners.size())
        throw std::invalid_argument("a mesh needs a level of subdivision for each corner");
    std::vector<std::uint8_t> edges(levels.begin(), levels.end());
    for (std::uint8_t &level : edges)
        level = std::min<std::uint8_t>(level, static_cast<std::uint8_t>(most_subdivision_levels));
    const SubdivisionLevel control(mesh.sizes, mesh.corners, std::vector<float>(mesh.corners.size()),
                                   std::vector<float>(mesh.positions.size()), {}, 0);
    std::vector<Patch> quads = quads_of(control, edges);
    unsigned dropped = 0;
    while (triangle_count(quads) > most_triangles && *std::ranges::max_element(edges) > 0) {
        for (std::uint8_t &level : edges) level = level > 0 ? level - 1 : 0;
        quads = quads_of(control, edges);
        ++dropped;
    }
    SubdivisionSurface result = Dicing(mesh, rules, std::move(quads)).run();
    result.levels_dropped = dropped;
    return result;
}

Mesh displaced(const Mesh &mesh, std::span<const std::uint32_t> points, std::span<const float> distances) {
    const std::size_t count = mesh.positions.size();
    if (points.size() != count || distances.size() != count || mesh.normals.size() != count)
        throw std::invalid_argument(
            "a displaced mesh needs a point, a normal and a distance for each vertex");
    struct Move {
        Vec3f direction{0};
        double distance = 0;
        std::uint32_t vertices = 0;
    };
    std::vector<Move> moves(count == 0 ? 0 : *std::ranges::max_element(points) + std::size_t{1});
    for (std::size_t v = 0; v < count; ++v) {
        Move &move = moves[points[v]];
        move.direction += mesh.normals[v];
        move.distance += distances[v];
        ++move.vertices;
    }
    Mesh result = mesh;
    for (std::size_t v = 0; v < count; ++v) {
        const Move &move = moves[points[v]];
        const float size = length(move.direction);
        if (size > 0)
            result.positions[v] +=
                move.direction * (static_cast<float>(move.distance / move.vertices) / size);
    }
    return with_normals_after_moving(std::move(result), points);
}

} // namespace lajolla
