#include "geometry/mesh.h"

#include <algorithm>
#include <cstring>
#include <stdexcept>
#include <unordered_map>

#include "geometry/triangle.h"

namespace lajolla {

namespace {

// Faces that share a position share its normals, even if other attributes of their vertices differ.
struct PositionHash {
    std::size_t operator()(Vec3f p) const {
        std::size_t hash = 0;
        for (const float x : {p.x, p.y, p.z}) {
            const float canonical = x == 0 ? 0 : x; // -0 equals 0
            std::uint32_t bits;
            std::memcpy(&bits, &canonical, sizeof bits);
            hash = (hash ^ bits) * 0x9e3779b97f4a7c15ull;
            hash ^= hash >> 29;
        }
        return hash;
    }
};

struct Corner {
    std::uint32_t face;
    float weight;
};

// Of a triangle at its first corner.
struct CornerShape {
    Vec3f normal; // zero if the area is zero
    float weight;
};
CornerShape corner_shape(Vec3f edge1, Vec3f edge2, NormalWeights weights) {
    const EdgeCross<float> face(edge1, edge2);
    const float area = sqrt(face.squared); // of the parallelogram, scaled
    if (!(area > 0 && std::isfinite(area))) return {Vec3f(0), 0};
    const auto weight = [&] {
        switch (weights) {
        case NormalWeights::area: return area / sqr(face.scale);
        case NormalWeights::max:
            return area / length_squared(face.e1) / length_squared(face.e2) * sqr(face.scale);
        case NormalWeights::angle: break;
        }
        return atan2(area, dot(face.e1, face.e2));
    };
    return {face.normal / area, weight()};
}

// Weights may be so large or small that the square of their sum is no number.
Vec3f unit_or_zero(Vec3f v) {
    v *= unit_scale(max_component(abs(v)));
    const float l = length(v);
    return l > 0 && std::isfinite(l) ? v / l : Vec3f(0);
}

// Copies attributes of the vertices and faces that `target` consists of; no faces: all of them.
void copy_attributes(const Mesh &mesh, const std::vector<std::uint32_t> &vertices,
                     const std::vector<std::uint32_t> &faces, Mesh &target) {
    for (const auto &[name, attribute] : mesh.attributes) {
        const auto &chosen = attribute.per_face ? faces : vertices;
        Mesh::Attribute copy{attribute.channels, attribute.per_face, {}};
        if (attribute.per_face && faces.empty()) copy.values = attribute.values;
        else
            for (const std::uint32_t old : chosen) {
                const auto first =
                    attribute.values.begin() + static_cast<std::ptrdiff_t>(old * attribute.channels);
                copy.values.insert(copy.values.end(), first, first + attribute.channels);
            }
        target.attributes.emplace(name, std::move(copy));
    }
}

} // namespace

std::size_t Mesh::bytes() const {
    std::size_t sum = (positions.size() + normals.size()) * sizeof(Vec3f) + uvs.size() * sizeof(Vec2f) +
                      triangles.size() * sizeof(Triangle) + face_coordinates.size() * sizeof(FaceCoordinates);
    for (const auto &[name, attribute] : attributes) sum += attribute.values.size() * sizeof(float);
    return sum;
}

void validate(const Mesh &mesh) {
    const std::size_t count = mesh.positions.size();
    if (!mesh.normals.empty() && mesh.normals.size() != count)
        throw std::invalid_argument("a mesh needs one normal per vertex, or none");
    if (!mesh.uvs.empty() && mesh.uvs.size() != count)
        throw std::invalid_argument("a mesh needs one uv per vertex, or none");
    for (std::size_t i = 0; i < count; ++i)
        if (!std::isfinite(dot(mesh.positions[i], Vec3f(1))))
            throw std::invalid_argument("vertex " + std::to_string(i) + " is not finite");
    for (const Triangle &triangle : mesh.triangles)
        for (const std::uint32_t index : triangle)
            if (index >= count)
                throw std::invalid_argument("vertex index " + std::to_string(index) +
                                            " is beyond the mesh's " + std::to_string(count) + " vertices");
    for (const auto &[name, attribute] : mesh.attributes) {
        const std::size_t elements = attribute.per_face ? mesh.triangles.size() : count;
        if (attribute.values.size() != elements * attribute.channels)
            throw std::invalid_argument("attribute '" + name + "' has the wrong length");
    }
    if (!mesh.face_coordinates.empty() && mesh.face_coordinates.size() != mesh.triangles.size())
        throw std::invalid_argument("a mesh needs the face of each triangle, or of none");
    for (const FaceCoordinates &place : mesh.face_coordinates)
        if (place.face >= mesh.face_count)
            throw std::invalid_argument("face " + std::to_string(place.face) + " is beyond the mesh's " +
                                        std::to_string(mesh.face_count) + " faces");
}

Mesh transformed(const Mesh &mesh, const Transform &to_world) {
    const auto to_object = inverse(to_world);
    if (!to_object) throw std::invalid_argument("to_world is singular: it flattens the shape");
    Mesh result = mesh;
    for (Vec3f &p : result.positions) p = to_world.point(p);
    for (Vec3f &n : result.normals) n = unit_or_zero(to_object->transposed_vector(n));
    return result;
}

Mesh with_vertex_normals(const Mesh &mesh, const Transform &to_world, NormalWeights weights) {
    Mesh result = mesh;
    result.normals.assign(mesh.positions.size(), Vec3f(0));
    for (const Triangle &triangle : mesh.triangles) {
        const auto corner = [&](std::size_t k) { return to_world.point(mesh.positions[triangle[k % 3]]); };
        const auto shape = [&](std::size_t k) {
            return corner_shape(corner(k + 1) - corner(k), corner(k + 2) - corner(k), weights);
        };
        const Vec3f normal = shape(0).normal;
        for (std::size_t k = 0; k < 3; ++k) result.normals[triangle[k]] += normal * shape(k).weight;
    }
    for (Vec3f &n : result.normals) n = unit_or_zero(to_world.transposed_vector(unit_or_zero(n)));
    return result;
}

Mesh with_normals_after_moving(Mesh moved, std::span<const std::uint32_t> points) {
    constexpr std::uint32_t none = ~0u;
    const std::size_t count = moved.positions.size();
    // Of each vertex, the first one that shares its normal; of each point, the last of those, as linked
    // lists.
    std::vector<std::uint32_t> leader(count), next(count, none);
    std::vector<std::uint32_t> last(count == 0 ? 0 : *std::ranges::max_element(points) + std::size_t{1},
                                    none);
    for (std::uint32_t v = 0; v < count; ++v) {
        std::uint32_t found = last[points[v]];
        while (found != none && !(moved.normals[found] == moved.normals[v])) found = next[found];
        leader[v] = found == none ? v : found;
        if (found != none) continue;
        next[v] = last[points[v]];
        last[points[v]] = v;
    }
    std::vector<Vec3f> sums(count, Vec3f(0));
    for (const Triangle &triangle : moved.triangles)
        for (std::size_t k = 0; k < 3; ++k) {
            const auto corner = [&](std::size_t i) { return moved.positions[triangle[(k + i) % 3]]; };
            const CornerShape shape =
                corner_shape(corner(1) - corner(0), corner(2) - corner(0), NormalWeights::angle);
            sums[leader[triangle[k]]] += shape.normal * shape.weight;
        }
    for (std::size_t v = 0; v < count; ++v)
        if (const Vec3f n = unit_or_zero(sums[leader[v]]); length_squared(n) > 0) moved.normals[v] = n;
    return moved;
}

Mesh part_of(const Mesh &mesh, std::size_t first_triangle, std::size_t count) {
    constexpr std::uint32_t unused = ~0u;
    Mesh part;
    std::vector<std::uint32_t> source, target(mesh.positions.size(), unused), faces(count);
    for (std::size_t f = 0; f < count; ++f) {
        faces[f] = static_cast<std::uint32_t>(first_triangle + f);
        Triangle triangle = mesh.triangles[faces[f]];
        for (std::uint32_t &index : triangle) {
            if (target[index] == unused) {
                target[index] = static_cast<std::uint32_t>(source.size());
                source.push_back(index);
            }
            index = target[index];
        }
        part.triangles.push_back(triangle);
        if (!mesh.face_coordinates.empty()) part.face_coordinates.push_back(mesh.face_coordinates[faces[f]]);
    }
    part.face_count = mesh.face_count;
    for (const std::uint32_t old : source) {
        part.positions.push_back(mesh.positions[old]);
        if (!mesh.normals.empty()) part.normals.push_back(mesh.normals[old]);
        if (!mesh.uvs.empty()) part.uvs.push_back(mesh.uvs[old]);
    }
    copy_attributes(mesh, source, faces, part);
    return part;
}

Mesh with_smooth_normals(const Mesh &mesh, const Transform &to_world, float max_angle,
                         NormalWeights weights) {
    const std::size_t face_count = mesh.triangles.size();
    std::vector<Vec3f> face_normals(face_count);
    std::unordered_map<Vec3f, std::vector<Corner>, PositionHash> corners_at;
    for (std::uint32_t f = 0; f < face_count; ++f) {
        const auto position = [&](std::size_t k) { return mesh.positions[mesh.triangles[f][k % 3]]; };
        const auto corner = [&](std::size_t k) { return to_world.point(position(k)); };
        const auto shape = [&](std::size_t k) {
            return corner_shape(corner(k + 1) - corner(k), corner(k + 2) - corner(k), weights);
        };
        face_normals[f] = shape(0).normal;
        for (std::size_t k = 0; k < 3; ++k) corners_at[position(k)].push_back({f, shape(k).weight});
    }

    Mesh result;
    result.triangles = mesh.triangles;
    result.face_coordinates = mesh.face_coordinates;
    result.face_count = mesh.face_count;
    std::vector<std::uint32_t> source; // the original vertex of each new one
    std::vector<std::vector<std::uint32_t>> made(mesh.positions.size()); // new vertices of each original one
    const float cos_max = cos(max_angle);
    for (std::uint32_t f = 0; f < face_count; ++f)
        for (std::uint32_t &index : result.triangles[f]) {
            const std::uint32_t old = index;
            Vec3f sum(0);
            for (const Corner &c : corners_at.at(mesh.positions[old]))
                if (dot(face_normals[c.face], face_normals[f]) >= cos_max)
                    sum += face_normals[c.face] * c.weight;
            const Vec3f smooth = unit_or_zero(sum);
            const Vec3f normal = length_squared(smooth) > 0 ? smooth : face_normals[f];
            auto &candidates = made[old];
            const auto same = std::find_if(candidates.begin(), candidates.end(),
                                           [&](std::uint32_t v) { return result.normals[v] == normal; });
            if (same != candidates.end()) {
                index = *same;
                continue;
            }
            index = static_cast<std::uint32_t>(source.size());
            candidates.push_back(index);
            source.push_back(old);
            result.positions.push_back(mesh.positions[old]);
            result.normals.push_back(normal);
            if (!mesh.uvs.empty()) result.uvs.push_back(mesh.uvs[old]);
        }

    for (Vec3f &n : result.normals) n = unit_or_zero(to_world.transposed_vector(n));
    copy_attributes(mesh, source, {}, result);
    return result;
}

} // namespace lajolla
