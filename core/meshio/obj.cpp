#include "meshio/obj.h"

#include "meshio/polygon.h"
#include "meshio/text.h"

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <limits>
#include <unordered_map>

namespace lajolla {
namespace {

constexpr uint32_t absent = std::numeric_limits<uint32_t>::max();

struct Corner {
    uint32_t position, uv, normal;
    bool operator==(const Corner &) const = default;
};

/// Numbers the distinct corners in order of appearance. Open addressing with linear probing.
class CornerTable {
public:
    uint32_t number_of(const Corner &corner) {
        if (corner.position >= latest.size()) latest.resize(corner.position + size_t{1}, absent);
        uint32_t &number = latest[corner.position];
        if (number == absent || corners[number] != corner) number = look_up(corner);
        return number;
    }

    std::vector<Corner> corners;

private:
    uint32_t look_up(const Corner &corner) {
        if (2 * corners.size() >= slots.size()) grow();
        uint32_t &slot = find_slot(corner);
        if (slot == absent) {
            slot = static_cast<uint32_t>(corners.size());
            corners.push_back(corner);
        }
        return slot;
    }

    uint32_t &find_slot(const Corner &corner) {
        size_t mask = slots.size() - 1;
        size_t i = hash(corner) & mask;
        while (slots[i] != absent && corners[slots[i]] != corner) i = (i + 1) & mask;
        return slots[i];
    }

    void grow() {
        slots.assign(std::max<size_t>(1024, 2 * slots.size()), absent);
        for (uint32_t i = 0; i < corners.size(); ++i) find_slot(corners[i]) = i;
    }

    static size_t hash(const Corner &corner) {
        uint64_t h = corner.position * 0x9e3779b97f4a7c15u;
        h = (h ^ (h >> 32) ^ corner.uv) * 0xd6e8feb86659fd93u;
        h = (h ^ (h >> 32) ^ corner.normal) * 0xd6e8feb86659fd93u;
        return static_cast<size_t>(h ^ (h >> 32));
    }

    std::vector<uint32_t> slots; // a power of two of them
    std::vector<uint32_t>
        latest; // by position: mostly the same corner again, and near the one before in memory
};

/// The result of the statements read so far.
struct ObjState {
    std::vector<Vec3f> positions, normals; // as numbered by the file
    std::vector<Vec2f> uvs;
    std::vector<Vec3f> colors; // one per position; empty until the first coloured `v`
    CornerTable table;
    RoomyVector<MeshData::Triangle> triangles; // into the table
    std::vector<uint32_t> triangle_material;   // into `materials`
    std::vector<std::string> materials{""};
    std::unordered_map<std::string, uint32_t> material_numbers{{"", 0}};
    uint32_t material = 0;
    std::vector<std::string> libraries;
    int part = 0, wanted_part = -1; // -1: all
    bool part_has_faces = false;
    std::vector<uint32_t> face; // corners of the face that is read, and where they are
    std::vector<Vec3f> outline;
    PolygonCutter cutter;
    bool keeps_polygons = false;
    MeshData::Polygons polygons;
    std::vector<uint32_t> polygon_material;
    bool has_no_numbers = false; // among positions and normals, whether faces use them or not
};

bool is_finite(const Vec3f &v) { return std::isfinite(v.x) && std::isfinite(v.y) && std::isfinite(v.z); }

/// Moves to the next argument of the statement, over continuation lines. False where the statement ends.
bool next_argument(TextCursor &text) {
    skip_blanks(text);
    while (text.at != text.end && *text.at == '\\') {
        TextCursor next = text;
        ++next.at;
        skip_blanks(next); // "\r\n"
        if (next.at != next.end && *next.at != '\n') break;
        skip_line(next);
        text = next;
        skip_blanks(text);
    }
    return text.at != text.end && *text.at != '\n' && *text.at != '#';
}

/// Reads the arguments of a statement into `out`, at least `needed` of them. Further ones are skipped.
size_t read_numbers(TextCursor &text, std::span<float> out, size_t needed, const char *what) {
    size_t count = 0;
    while (next_argument(text)) {
        TextCursor start = text;
        std::optional<double> number = read_number(text);
        if (!number || (text.at != text.end && !is_blank(*text.at) && *text.at != '\n'))
            fail(text, std::string(what) + ": expected a number, found " + quote_word(start));
        if (count < out.size()) out[count++] = static_cast<float>(*number);
    }
    if (count < needed)
        fail(text, std::string(what) + ": expected " + std::to_string(needed) + " numbers, found " +
                       std::to_string(count));
    return count;
}

void read_position(TextCursor &text, ObjState &obj) {
    std::array<float, 6> values{};
    size_t count = read_numbers(text, values, 3, "vertex position");
    if (count == 6) {
        obj.colors.resize(obj.positions.size(), Vec3f(1)); // white where earlier vertices had none
        obj.colors.emplace_back(values[3], values[4], values[5]);
    } else if (!obj.colors.empty()) {
        obj.colors.emplace_back(1.f);
    }
    obj.positions.emplace_back(values[0], values[1], values[2]);
    obj.has_no_numbers |= !is_finite(obj.positions.back());
}

void read_uv(TextCursor &text, ObjState &obj) {
    std::array<float, 2> values{};
    read_numbers(text, values, 1, "texture coordinate");
    obj.uvs.emplace_back(values[0], values[1]);
}

void read_normal(TextCursor &text, ObjState &obj) {
    std::array<float, 3> values{};
    read_numbers(text, values, 3, "normal");
    obj.normals.emplace_back(values[0], values[1], values[2]);
    obj.has_no_numbers |= !is_finite(obj.normals.back());
}

/// Indices count from 1, or backwards from the latest element if negative.
uint32_t read_index(TextCursor &text, size_t count, const char *what) {
    int64_t index = 0;
    auto [next, error] = std::from_chars(text.at, text.end, index);
    if (error != std::errc())
        fail(text, std::string("face: expected the index of a ") + what + ", found " + quote_word(text));
    int64_t resolved = index > 0 ? index - 1 : index + static_cast<int64_t>(count);
    if (index == 0 || resolved < 0 || resolved >= static_cast<int64_t>(count))
        fail(text, std::string("face: there is no ") + what + " " + std::to_string(index) + " (" +
                       std::to_string(count) + " so far)");
    text.at = next;
    return static_cast<uint32_t>(resolved);
}

bool accept_slash(TextCursor &text) {
    bool found = text.at != text.end && *text.at == '/';
    text.at += found;
    return found;
}

bool at_index(const TextCursor &text) {
    return text.at != text.end && (*text.at == '-' || (*text.at >= '0' && *text.at <= '9'));
}

/// `v`, `v/vt`, `v//vn` or `v/vt/vn`; a slash at the end is harmless.
Corner read_corner(TextCursor &text, const ObjState &obj) {
    Corner corner{read_index(text, obj.positions.size(), "vertex"), absent, absent};
    if (accept_slash(text)) {
        if (at_index(text)) corner.uv = read_index(text, obj.uvs.size(), "texture coordinate");
        if (accept_slash(text) && at_index(text))
            corner.normal = read_index(text, obj.normals.size(), "normal");
    }
    if (text.at != text.end && !is_blank(*text.at) && *text.at != '\n')
        fail(text, "face: expected v, v/vt, v//vn or v/vt/vn, found " + quote_word(text));
    return corner;
}

/// Faces with fewer than three corners have no area and are skipped.
void read_face(TextCursor &text, ObjState &obj) {
    obj.part_has_faces = true;
    if (obj.wanted_part >= 0 && obj.part != obj.wanted_part) return;
    obj.face.clear();
    obj.outline.clear();
    while (next_argument(text)) {
        const Corner corner = read_corner(text, obj);
        const Vec3f &position = obj.positions[corner.position];
        if (!is_finite(position))
            fail(text, "face: vertex " + std::to_string(corner.position + 1) + " is not finite");
        obj.face.push_back(obj.table.number_of(corner));
        obj.outline.push_back(position);
    }
    if (obj.keeps_polygons && obj.face.size() >= 3) {
        obj.polygons.sizes.push_back(static_cast<uint32_t>(obj.face.size()));
        obj.polygons.corners.insert(obj.polygons.corners.end(), obj.face.begin(), obj.face.end());
        obj.polygon_material.push_back(obj.material);
    }
    for (const PolygonCutter::Triangle &t : obj.cutter.cut(obj.outline)) {
        obj.triangles.push_back({obj.face[t[0]], obj.face[t[1]], obj.face[t[2]]});
        obj.triangle_material.push_back(obj.material);
    }
    if (obj.table.corners.size() >= absent || obj.triangle_material.size() >= absent)
        fail(text, "the mesh has more than 2^32 vertices or triangles");
}

void end_part(ObjState &obj) {
    obj.part += obj.part_has_faces;
    obj.part_has_faces = false;
}

void read_material(TextCursor &text, ObjState &obj) {
    end_part(obj);
    std::string name = to_utf8(read_rest_of_line(text));
    auto [entry, is_new] = obj.material_numbers.try_emplace(name, obj.materials.size());
    if (is_new) obj.materials.push_back(name);
    obj.material = entry->second;
}

/// Several names may share a line, and a name may contain blanks: names end with ".mtl" or with the line.
void read_libraries(TextCursor &text, ObjState &obj) {
    std::string_view names = read_rest_of_line(text);
    while (!names.empty()) {
        size_t end = names.find(".mtl ");
        end = end == std::string_view::npos ? names.size() : end + 4;
        obj.libraries.push_back(to_utf8(names.substr(0, end)));
        names.remove_prefix(end);
        names.remove_prefix(std::min(names.find_first_not_of(' '), names.size()));
    }
}

/// A crease or a sharp corner; other tags do not change the surface, or are not supported.
void read_tag(TextCursor &text, ObjState &obj) {
    skip_blanks(text);
    const std::string_view name = read_word(text);
    const size_t vertices = name == "crease" ? 2 : name == "corner" ? 1 : 0;
    if (vertices == 0) return;
    skip_blanks(text);
    if (read_word(text) != (vertices == 2 ? "2/1/0" : "1/1/0")) return;
    std::array<float, 3> values{};
    read_numbers(text, std::span(values).first(vertices + 1), vertices + 1, "tag");
    std::array<uint32_t, 2> points{};
    for (size_t i = 0; i < vertices; ++i) {
        if (!(values[i] >= 0 && values[i] < static_cast<float>(obj.positions.size())))
            fail(text, "tag: there is no such vertex (" + std::to_string(obj.positions.size()) +
                           " so far, from 0)");
        points[i] = static_cast<uint32_t>(values[i]);
    }
    if (!(values[vertices] >= 0)) fail(text, "tag: sharpness must not be below 0");
    if (vertices == 2) obj.polygons.creases.push_back({points, values[2]});
    else obj.polygons.sharp_corners.push_back({points[0], values[1]});
}

void read_statement(TextCursor &text, ObjState &obj) {
    skip_blanks(text);
    std::string_view keyword = read_word(text);
    if (keyword == "v") read_position(text, obj);
    else if (keyword == "vt") read_uv(text, obj);
    else if (keyword == "vn") read_normal(text, obj);
    else if (keyword == "f") read_face(text, obj);
    else if (keyword == "usemtl") read_material(text, obj);
    else if (keyword == "mtllib") read_libraries(text, obj);
    else if (keyword == "g") end_part(obj);
    else if (keyword == "t" && obj.keeps_polygons) read_tag(text, obj);
}

/// What the corners' `number` picks from `values`; zero where absent. Empty if all are absent.
template <class T>
RoomyVector<T> gather(const std::vector<Corner> &corners, const std::vector<T> &values,
                      uint32_t Corner::*number) {
    bool any = false;
    RoomyVector<T> result(corners.size());
    for (size_t i = 0; i < corners.size(); ++i) {
        uint32_t source = corners[i].*number;
        if (source == absent) continue;
        any = true;
        result[i] = values[source];
    }
    return any ? std::move(result) : RoomyVector<T>();
}

/// Whether some corners have a number and others have none.
bool is_given_in_part(const std::vector<Corner> &corners, uint32_t Corner::*number) {
    const auto given = std::ranges::count_if(corners, [=](const Corner &c) { return c.*number != absent; });
    return given > 0 && static_cast<size_t>(given) < corners.size();
}

MeshData::Attribute gather_colors(const ObjState &obj) {
    MeshData::Attribute colors{"vertex_color", 3, false, {}};
    for (const Corner &corner : obj.table.corners) {
        const Vec3f &c = obj.colors[corner.position];
        colors.values.insert(colors.values.end(), {c.x, c.y, c.z});
    }
    return colors;
}

/// Orders the triangles by material (counting sort, so the order within a material stays) and names the
/// groups.
void group_triangles(const ObjState &obj, MeshData &mesh) {
    std::vector<uint32_t> next(obj.materials.size() + 1);
    for (uint32_t material : obj.triangle_material) ++next[material + 1];
    for (size_t m = 0; m < obj.materials.size(); ++m) {
        if (next[m + 1] > 0) mesh.groups.push_back({obj.materials[m], next[m], next[m + 1]});
        next[m + 1] += next[m];
    }
    mesh.triangles.resize(obj.triangles.size());
    for (size_t i = 0; i < obj.triangles.size(); ++i)
        mesh.triangles[next[obj.triangle_material[i]]++] = obj.triangles[i];

    std::vector<uint32_t> group_of(obj.materials.size());
    for (uint32_t g = 0; g < mesh.groups.size(); ++g)
        group_of[obj.material_numbers.at(mesh.groups[g].material)] = g;
    for (uint32_t material : obj.polygon_material) mesh.polygons.groups.push_back(group_of[material]);
}

} // namespace

MeshData read_obj(std::span<const std::byte> file, int shape_index, bool keep_polygons) {
    ObjState obj;
    obj.keeps_polygons = keep_polygons;
    obj.wanted_part = shape_index;
    for (TextCursor text = text_cursor(file); text.at != text.end; skip_line(text)) read_statement(text, obj);
    if (obj.positions.empty()) throw MeshError("this is no OBJ file: it has no vertices");
    end_part(obj);
    if (shape_index >= obj.part)
        throw MeshError("there is no shape " + std::to_string(shape_index) + "; the file has " +
                        std::to_string(obj.part));

    MeshData mesh;
    const std::vector<Corner> &corners = obj.table.corners;
    mesh.positions = gather(corners, obj.positions, &Corner::position);
    mesh.uvs = gather(corners, obj.uvs, &Corner::uv);
    mesh.normals = gather(corners, obj.normals, &Corner::normal);
    if (!obj.colors.empty()) mesh.attributes.push_back(gather_colors(obj));
    mesh.polygons = std::move(obj.polygons);
    if (keep_polygons)
        for (const Corner &corner : corners) mesh.polygons.points.push_back(corner.position);
    if (obj.materials.size() > 1) group_triangles(obj, mesh);
    else mesh.triangles = std::move(obj.triangles);
    mesh.material_libraries = std::move(obj.libraries);
    mesh.mended = obj.cutter.met_concave || obj.has_no_numbers || is_given_in_part(corners, &Corner::uv);
    finish(mesh);
    return mesh;
}

} // namespace lajolla
