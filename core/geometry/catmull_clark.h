#pragma once
// The rules of Catmull-Clark subdivision (Catmull and Clark 1978), with creases (DeRose et al. 1998,
// "Subdivision Surfaces in Character Animation") that blend like those of OpenSubdiv, and limits (Halstead et
// al. 1993, "Efficient, Fair Interpolation using Catmull-Clark Surfaces"; Biermann et al. 2000, "Piecewise
// Smooth Subdivision Surfaces with Normal Control").

#include <array>
#include <cstdint>
#include <span>
#include <vector>

namespace lajolla {

// Edges and corners of this sharpness or more stay sharp at every level.
constexpr float infinitely_sharp = 10;

using Vec3d = std::array<double, 3>;

// A mesh at one level of subdivision, as half-edges. The k-th half-edge starts at the k-th corner of all
// faces and ends at the next corner of its face. From level 1 on, all faces are quads.
//
// A level may lack faces that nobody asks for. The rules are right for vertices all of whose faces are there.
class SubdivisionLevel {
public:
    static constexpr std::int32_t none = -1;

    // Level 0. `width` values per vertex; `sharpness` of the edge that starts at each corner: neighbours of
    // an edge must agree. Edges that do not have two faces, which run along it in opposite directions, stay
    // sharp.
    SubdivisionLevel(std::span<const std::uint32_t> sizes, std::span<const std::uint32_t> corners,
                     std::vector<float> sharpness, std::vector<float> corner_sharpness,
                     std::vector<double> values, std::size_t width);

    std::size_t width() const { return width_; }
    std::size_t face_count() const { return first_.size() - 1; }
    std::size_t half_edge_count() const { return start_.size(); }
    std::size_t vertex_count() const { return corner_sharpness_.size(); }
    std::uint32_t first(std::size_t face) const { return first_[face]; } // half-edge
    std::uint32_t size(std::size_t face) const { return first_[face + 1] - first_[face]; }
    std::uint32_t face_of(std::uint32_t h) const { return face_[h]; }
    std::uint32_t start(std::uint32_t h) const { return start_[h]; }
    std::int32_t twin(std::uint32_t h) const { return twin_[h]; }
    std::uint32_t next(std::uint32_t h) const {
        return h + 1 == first_[face_[h] + 1] ? first_[face_[h]] : h + 1;
    }
    std::uint32_t previous(std::uint32_t h) const {
        return h == first_[face_[h]] ? first_[face_[h] + 1] - 1 : h - 1;
    }
    bool is_boundary(std::uint32_t h) const { return sharpness_[h] == boundary; }
    // The half-edges that start at a vertex.
    std::span<const std::uint32_t> around(std::uint32_t vertex) const {
        return {outgoing_.data() + first_outgoing_[vertex], outgoing_.data() + first_outgoing_[vertex + 1]};
    }

    // What each part of this level becomes in the next one, none where nobody asked for it.
    struct Children {
        std::vector<std::int32_t> faces;    // of each half-edge, the quad at the corner where it starts
        std::vector<std::int32_t> vertices; // of each vertex
        std::vector<std::int32_t> edges;    // of each half-edge, the vertex on it
        std::vector<std::int32_t> centres;  // of each face, the vertex in its middle
    };
    // The next level, with the quads at these corners. Quads keep the order of their corners: the one at the
    // corner c has its own corner c there. Quads of other faces begin with the corner of the face.
    SubdivisionLevel refined(const std::vector<bool> &corners, Children &children) const;

    // Whether limit() and limit_normal() are exact: the faces around are quads, and no edge loses sharpness.
    bool has_limit(std::uint32_t vertex) const;
    void limit(std::uint32_t vertex, std::span<double> values) const;
    // The unit normal of the limit surface where a half-edge starts, on the side of its face if the vertex is
    // on a crease. The first three values are a position. Zero where there is none.
    Vec3d limit_normal(std::uint32_t h) const;
    // Whether it is the same for all faces around.
    bool is_smooth(std::uint32_t vertex) const { return rule(vertex).sharp < 2; }

private:
    static constexpr float boundary = 2 * infinitely_sharp;
    enum class Kind { smooth, crease, corner };
    struct Rule {
        Kind kind = Kind::smooth;
        std::uint32_t sharp = 0;           // number of sharp edges
        std::array<std::uint32_t, 2> ends; // the first two of them, by the vertices at their other ends
    };

    SubdivisionLevel() = default;
    Rule rule(std::uint32_t vertex, float decay = 0) const;
    // f(half-edge along the edge, vertex at its other end) for all edges at a vertex.
    void for_each_edge(std::uint32_t vertex, auto &&f) const;
    void find_twins();
    void find_outgoing();
    const double *value(std::uint32_t vertex) const { return values_.data() + vertex * width_; }
    std::vector<double> face_points() const;
    void edge_point(std::uint32_t h, const std::vector<double> &centres, double *result) const;
    void vertex_point(std::uint32_t v, const std::vector<double> &centres, double *result) const;
    void apply(const Rule &rule, std::uint32_t v, const std::vector<double> &centres, double weight,
               double *result) const;
    float transition(std::uint32_t vertex) const;
    std::vector<std::uint32_t> sector(std::uint32_t h, bool closed) const;
    Vec3d offset(std::uint32_t from, std::uint32_t to) const;

    std::size_t width_ = 0;
    std::vector<std::uint32_t> first_; // half-edge of each face, and their number
    std::vector<std::uint32_t> face_, start_;
    std::vector<std::int32_t> twin_;
    std::vector<float> sharpness_, corner_sharpness_;
    std::vector<double> values_;
    std::vector<std::uint32_t> first_outgoing_, outgoing_;
};

} // namespace lajolla
