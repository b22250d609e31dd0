#include "meshio/ply.h"

#include "meshio/ply_header.h"
#include "meshio/polygon.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstring>
#include <limits>
#include <numeric>
#include <unordered_map>

namespace lajolla {
namespace {

struct AsciiSource {
    TextCursor text;

    [[noreturn]] void fail(const std::string &message) const { lajolla::fail(text, message); }

    /// The number of bytes left, and the minimum per value: a digit and a blank (the last needs no blank).
    uint64_t remaining() const { return static_cast<uint64_t>(text.end - text.at) + 1; }
    uint64_t least_size(PlyType) const { return 2; }

    double read(PlyType) {
        skip_space(text);
        if (text.at == text.end) fail("the file ends too early");
        std::optional<double> value = read_number(text);
        if (!value) fail("expected a number, found " + quote_word(text));
        return *value;
    }
};

/// IEEE 754 binary16.
double half_value(uint16_t bits) {
    int exponent = bits >> 10 & 31;
    int fraction = bits & 1023;
    double magnitude = exponent == 0    ? std::ldexp(fraction, -24)
                       : exponent == 31 ? std::numeric_limits<double>::infinity()
                                        : std::ldexp(1024 + fraction, exponent - 25);
    return bits & 0x8000 ? -magnitude : magnitude;
}

struct BinarySource {
    std::span<const std::byte> data; // what is left
    size_t file_size;
    bool swap_bytes;

    [[noreturn]] void fail(const std::string &message) const {
        throw MeshError("byte " + std::to_string(file_size - data.size()) + ": " + message);
    }

    uint64_t remaining() const { return data.size(); }
    uint64_t least_size(PlyType type) const { return size_of(type); }

    template <class T>
    T take() {
        std::array<std::byte, sizeof(T)> bytes;
        if (data.size() < sizeof(T)) fail("the file ends too early");
        std::memcpy(bytes.data(), data.data(), sizeof(T));
        if (swap_bytes) std::reverse(bytes.begin(), bytes.end());
        data = data.subspan(sizeof(T));
        return std::bit_cast<T>(bytes);
    }

    double read(PlyType type) {
        switch (type) {
        case PlyType::int8: return take<int8_t>();
        case PlyType::uint8: return take<uint8_t>();
        case PlyType::int16: return take<int16_t>();
        case PlyType::uint16: return take<uint16_t>();
        case PlyType::int32: return take<int32_t>();
        case PlyType::uint32: return take<uint32_t>();
        case PlyType::int64: return static_cast<double>(take<int64_t>());
        case PlyType::uint64: return static_cast<double>(take<uint64_t>());
        case PlyType::float16: return half_value(take<uint16_t>());
        case PlyType::float32: return take<float>();
        case PlyType::float64: return take<double>();
        }
        return 0;
    }
};

/// The linear value of an sRGB value (IEC 61966-2-1).
float linear(double srgb) {
    return static_cast<float>(srgb <= 0.04045 ? srgb / 12.92 : std::pow((srgb + 0.055) / 1.055, 2.4));
}

/// Properties of an element that form one field, and their values in the rows read so far.
struct Field {
    std::string name;
    std::vector<size_t> properties; // positions in the element's list
    float scale = 1;
    bool is_srgb = false;
    std::vector<float> values; // of attributes

    float *write(std::span<const double> row, float *out) const {
        for (size_t p : properties) {
            const float value = static_cast<float>(row[p]) * scale;
            *out++ = is_srgb ? linear(value) : value;
        }
        return out;
    }
    void append(std::span<const double> row) {
        values.resize(values.size() + properties.size());
        write(row, values.data() + values.size() - properties.size());
    }
};

using Names = std::span<const std::string_view>;

std::optional<size_t> find_property(const PlyElement &element, std::string_view name) {
    for (size_t i = 0; i < element.properties.size(); ++i)
        if (element.properties[i].name == name && !element.properties[i].is_list) return i;
    return std::nullopt;
}

/// Adds a field if the element has all its properties.
bool add_field(std::vector<Field> &fields, const PlyElement &element, std::string name, Names properties) {
    Field field;
    field.name = std::move(name);
    for (std::string_view property : properties) {
        std::optional<size_t> index = find_property(element, property);
        if (!index) return false;
        field.properties.push_back(*index);
    }
    fields.push_back(std::move(field));
    return true;
}

/// Colours of integer type cover the whole range of the type, and may be encoded.
void normalize_color(Field &field, const PlyElement &element, bool srgb) {
    PlyType type = element.properties[field.properties[0]].type;
    field.scale = static_cast<float>(1 / largest_value(type));
    field.is_srgb = srgb && !is_floating(type);
}

/// The number of properties from `first` on that share its prefix and continue its suffix along `suffixes`.
size_t run_length(const PlyElement &element, size_t first, std::string_view prefix,
                  std::string_view suffixes) {
    size_t length = 0;
    for (; length < suffixes.size() && first + length < element.properties.size(); ++length) {
        const PlyProperty &property = element.properties[first + length];
        if (property.is_list || property.name.size() != prefix.size() + 1 ||
            !property.name.starts_with(prefix) || property.name.back() != suffixes[length])
            break;
    }
    return length;
}

/// The longest run of properties from `first` on that reads prefix_x prefix_y ..., prefix_r ..., prefix_0 ...
/// or prefix_1 ...
Field find_run(const PlyElement &element, size_t first, const std::string &kind, bool srgb) {
    const std::string &name = element.properties[first].name;
    std::string prefix = name.substr(0, name.rfind('_') + 1);
    Field run;
    if (prefix.size() < 2) return run;
    for (std::string_view suffixes : {"xyzw", "rgba", "0123", "1234"}) {
        size_t length = run_length(element, first, prefix, suffixes);
        if (length == 0) continue;
        bool is_color = suffixes == "rgba";
        run.name = kind + name.substr(0, prefix.size() - 1) + (is_color ? "_color" : "");
        for (size_t i = 0; i < length; ++i) run.properties.push_back(first + i);
        if (is_color) normalize_color(run, element, srgb);
    }
    return run;
}

/// Attributes in Mitsuba 3's sense: plain colours, and runs as above. Runs of other lengths than 1 and 3, and
/// those whose name is taken, are ignored, as there.
void add_attributes(std::vector<Field> &fields, const PlyElement &element, const std::string &kind,
                    bool srgb) {
    static constexpr std::array<std::string_view, 3> rgb{"r", "g", "b"}, words{"red", "green", "blue"};
    if (add_field(fields, element, kind + "color", rgb) || add_field(fields, element, kind + "color", words))
        normalize_color(fields.back(), element, srgb);
    for (size_t i = 0; i < element.properties.size();) {
        Field run = find_run(element, i, kind, srgb);
        size_t length = run.properties.size();
        bool is_taken =
            std::any_of(fields.begin(), fields.end(), [&](const Field &f) { return f.name == run.name; });
        if ((length == 1 || length == 3) && !is_taken) fields.push_back(std::move(run));
        i += std::max<size_t>(length, 1);
    }
}

/// The values of one of an element's lists, in the row that was read last.
struct List {
    size_t property; // its position among the element's
    std::vector<double> values;
};

/// Reads one row: scalars go to `row` (one place per property), and the values of lists to those of `lists`.
template <class Source>
void read_row(Source &source, const PlyElement &element, std::span<double> row, std::span<List> lists) {
    for (size_t i = 0; i < element.properties.size(); ++i) {
        const PlyProperty &property = element.properties[i];
        if (!property.is_list) {
            row[i] = source.read(property.type);
            continue;
        }
        double length = source.read(property.count_type);
        if (!(length >= 0) || length != std::floor(length) ||
            length > static_cast<double>(source.remaining() / source.least_size(property.type)))
            source.fail("the list '" + property.name + "' has an impossible length");
        auto list = std::ranges::find(lists, i, &List::property);
        if (list != lists.end()) list->values.clear();
        for (double k = 0; k < length; ++k) {
            double value = source.read(property.type);
            if (list != lists.end()) list->values.push_back(value);
        }
    }
}

/// Rejects counts that the rest of the file cannot hold, before memory is reserved for them.
template <class Source>
void check_count(const Source &source, const PlyElement &element) {
    uint64_t row_size = 0;
    for (const PlyProperty &property : element.properties)
        row_size += source.least_size(property.is_list ? property.count_type : property.type);
    if (row_size > 0 && element.count > source.remaining() / row_size)
        source.fail("the file is too short for " + std::to_string(element.count) + " of element '" +
                    element.name + "'");
}

template <class Source>
void skip_element(Source &source, const PlyElement &element) {
    std::vector<double> row(element.properties.size());
    if (!row.empty())
        for (uint64_t i = 0; i < element.count; ++i) read_row(source, element, row, {});
}

MeshData::Attribute to_attribute(Field &field, bool per_face) {
    return {field.name, static_cast<int>(field.properties.size()), per_face, std::move(field.values)};
}

/// The destination of a vertex field's values.
float *make_room(Field &field, size_t count, MeshData &mesh) {
    auto resized = [&](auto &elements, size_t size) {
        elements.resize(size);
        return reinterpret_cast<float *>(elements.data());
    };
    if (field.name == "position") return resized(mesh.positions, count);
    if (field.name == "normal") return resized(mesh.normals, count);
    if (field.name == "uv") return resized(mesh.uvs, count);
    return resized(field.values, count * field.properties.size());
}

template <class Source>
void read_vertices(Source &source, const PlyElement &element, bool srgb, MeshData &mesh) {
    static constexpr std::array<std::string_view, 3> xyz{"x", "y", "z"}, normal{"nx", "ny", "nz"};
    static constexpr std::array<std::array<std::string_view, 2>, 3> uvs{
        {{"texture_u", "texture_v"}, {"s", "t"}, {"u", "v"}}};
    std::vector<Field> fields;
    if (!add_field(fields, element, "position", xyz)) source.fail("the vertices have no x, y and z");
    add_field(fields, element, "normal", normal);
    for (Names names : uvs)
        if (add_field(fields, element, "uv", names)) break;
    add_attributes(fields, element, "vertex_", srgb);

    std::vector<float *> targets;
    for (Field &field : fields) targets.push_back(make_room(field, element.count, mesh));
    std::vector<double> row(element.properties.size());
    for (uint64_t i = 0; i < element.count; ++i) {
        read_row(source, element, row, {});
        for (size_t f = 0; f < fields.size(); ++f) targets[f] = fields[f].write(row, targets[f]);
    }
    for (Field &field : fields)
        if (field.name.starts_with("vertex_")) mesh.attributes.push_back(to_attribute(field, false));
}

using Triangles = RoomyVector<MeshData::Triangle>;

/// Appends a triangle strip; every other triangle is turned round, so that all face the same way.
void append_strip(std::span<const uint32_t> corners, Triangles &triangles) {
    for (size_t i = 2; i < corners.size(); ++i)
        triangles.push_back({corners[i - 2 + i % 2], corners[i - 1 - i % 2], corners[i]});
}

template <class Source>
uint32_t to_index(const Source &source, double value, uint64_t vertex_count) {
    if (!(value >= 0 && value < static_cast<double>(vertex_count)) || value != std::floor(value))
        source.fail("a face refers to a vertex that does not exist");
    return static_cast<uint32_t>(value);
}

/// Appends the triangles of one list of vertex indices, where -1 starts a new strip. `corners` is scratch.
template <class Source>
void append_strips(const Source &source, std::span<const double> list, uint64_t vertex_count,
                   std::vector<uint32_t> &corners, Triangles &triangles) {
    corners.clear();
    for (double value : list) {
        if (value == -1) {
            append_strip(corners, triangles);
            corners.clear();
        } else {
            corners.push_back(to_index(source, value, vertex_count));
        }
    }
    append_strip(corners, triangles);
}

/// A polygon's corners, by number and, where the vertices are known already, by place.
struct Polygon {
    std::vector<uint32_t> corners;
    std::vector<Vec3f> outline;

    template <class Source>
    void read(const Source &source, std::span<const double> list, uint64_t vertex_count,
              const RoomyVector<Vec3f> &positions) {
        corners.clear();
        outline.clear();
        for (double value : list) {
            corners.push_back(to_index(source, value, vertex_count));
            if (!positions.empty()) outline.push_back(positions[corners.back()]);
        }
    }
    std::span<const PolygonCutter::Triangle> cut(PolygonCutter &cutter) const {
        return outline.empty() ? cutter.fan(corners.size()) : cutter.cut(outline);
    }
};

/// The position of the first list of one of these names; past the end where there is none.
size_t find_list(const PlyElement &element, std::initializer_list<std::string_view> names) {
    for (size_t i = 0; i < element.properties.size(); ++i)
        if (const PlyProperty &property = element.properties[i];
            property.is_list && std::ranges::find(names, property.name) != names.end())
            return i;
    return element.properties.size();
}

// Where faces have their own: of each triangle, and of the corners of the polygons that are kept.
struct CornerUvs {
    std::vector<std::array<Vec2f, 3>> triangles;
    std::vector<Vec2f> polygons;
};

/// Appends the texture coordinates of a polygon's triangles: the pairs at its corners, or those of its
/// vertices.
void append_corner_uvs(std::span<const double> pairs, std::span<const uint32_t> corners,
                       std::span<const PolygonCutter::Triangle> triangles, const MeshData &mesh,
                       CornerUvs &result) {
    auto uv = [&](size_t corner) {
        if (pairs.size() == 2 * corners.size())
            return Vec2f(static_cast<float>(pairs[2 * corner]), static_cast<float>(pairs[2 * corner + 1]));
        return mesh.uvs.empty() ? Vec2f(0, 0) : mesh.uvs[corners[corner]];
    };
    for (const auto &t : triangles) result.triangles.push_back({uv(t[0]), uv(t[1]), uv(t[2])});
    for (size_t i = 0; i < corners.size(); ++i) result.polygons.push_back(uv(i));
}

/// A vertex with a texture coordinate, bit by bit.
struct VertexWithUv {
    uint32_t vertex;
    uint64_t uv;
    bool operator==(const VertexWithUv &) const = default;
};

struct HashOfVertexWithUv {
    size_t operator()(const VertexWithUv &key) const {
        return std::hash<uint64_t>()((key.uv ^ key.vertex * 0x9e3779b97f4a7c15u) * 0xd6e8feb86659fd93u);
    }
};

/// Repeats the values of some vertices at the end, `width` of them each.
void repeat(auto &values, std::span<const uint32_t> origins, size_t width) {
    const size_t before = values.size();
    if (before == 0) return;
    values.resize(before + origins.size() * width);
    for (size_t i = 0; i < origins.size(); ++i)
        for (size_t k = 0; k < width; ++k) values[before + i * width + k] = values[origins[i] * width + k];
}

/// Makes texture coordinates of corners those of vertices: a vertex with several becomes several vertices.
class VertexSplitter {
public:
    explicit VertexSplitter(MeshData &data) : mesh(data), has_uv(data.positions.size()) {
        mesh.uvs.resize(mesh.positions.size());
    }

    void split(const CornerUvs &uvs) {
        if (mesh.positions.size() + 3 * uvs.triangles.size() > std::numeric_limits<uint32_t>::max())
            throw MeshError("the mesh has more than 2^32 corners with texture coordinates");
        for (size_t t = 0; t < uvs.triangles.size(); ++t)
            for (size_t k = 0; k < 3; ++k) give(mesh.triangles[t][k], uvs.triangles[t][k]);
        for (size_t i = 0; i < mesh.polygons.corners.size(); ++i)
            give(mesh.polygons.corners[i], uvs.polygons[i]);
        repeat(mesh.positions, origins, 1);
        repeat(mesh.normals, origins, 1);
        repeat(mesh.polygons.points, origins, 1);
        for (MeshData::Attribute &attribute : mesh.attributes)
            if (!attribute.per_face)
                repeat(attribute.values, origins, static_cast<size_t>(attribute.channels));
    }

private:
    /// Replaces a vertex by the one at the same place that has a texture coordinate.
    void give(uint32_t &vertex, Vec2f uv) {
        const auto bits = std::bit_cast<uint64_t>(std::array{uv.x, uv.y});
        if (!has_uv[vertex]) {
            has_uv[vertex] = true;
            mesh.uvs[vertex] = uv;
        }
        if (std::bit_cast<uint64_t>(std::array{mesh.uvs[vertex].x, mesh.uvs[vertex].y}) == bits) return;
        const auto [known, is_new] =
            others.try_emplace({vertex, bits}, static_cast<uint32_t>(mesh.uvs.size()));
        if (is_new) {
            origins.push_back(vertex);
            mesh.uvs.push_back(uv);
        }
        vertex = known->second;
    }

    MeshData &mesh;
    std::vector<bool> has_uv;
    std::unordered_map<VertexWithUv, uint32_t, HashOfVertexWithUv> others;
    std::vector<uint32_t> origins; // of the vertices that are added
};

template <class Source>
void read_faces(Source &source, const PlyElement &element, uint64_t vertex_count, bool srgb,
                bool keep_polygons, MeshData &mesh, CornerUvs &corner_uvs) {
    std::array lists{List{find_list(element, {"vertex_indices", "vertex_index"}), {}},
                     List{find_list(element, {"texcoord"}), {}}}; // as MeshLab writes them
    const size_t none = element.properties.size();
    if (lists[0].property == none) source.fail("the faces have no list 'vertex_indices' or 'vertex_index'");
    std::vector<Field> fields;
    add_attributes(fields, element, "face_", srgb);

    const bool is_strip = element.name == "tristrips";
    const bool has_corner_uvs = lists[1].property != none && !is_strip;
    std::vector<double> row(element.properties.size());
    Polygon polygon;
    PolygonCutter cutter;
    for (uint64_t i = 0; i < element.count; ++i) {
        read_row(source, element, row, lists);
        size_t before = mesh.triangles.size();
        if (is_strip) {
            append_strips(source, lists[0].values, vertex_count, polygon.corners, mesh.triangles);
        } else {
            polygon.read(source, lists[0].values, vertex_count, mesh.positions);
            const auto &corners = polygon.corners;
            const auto cut = polygon.cut(cutter);
            for (const auto &t : cut) mesh.triangles.push_back({corners[t[0]], corners[t[1]], corners[t[2]]});
            if (keep_polygons && corners.size() >= 3) {
                mesh.polygons.sizes.push_back(static_cast<uint32_t>(corners.size()));
                mesh.polygons.corners.insert(mesh.polygons.corners.end(), corners.begin(), corners.end());
            }
            if (has_corner_uvs && corners.size() >= 3)
                append_corner_uvs(lists[1].values, corners, cut, mesh, corner_uvs);
        }
        for (size_t k = before; k < mesh.triangles.size(); ++k)
            for (Field &field : fields) field.append(row);
        if (mesh.triangles.size() >= std::numeric_limits<uint32_t>::max())
            source.fail("the mesh has more than 2^32 triangles");
    }
    for (Field &field : fields) mesh.attributes.push_back(to_attribute(field, true));
    mesh.mended |= cutter.met_concave;
}

template <class Source>
MeshData read_elements(Source source, const PlyHeader &header, bool srgb, bool keep_polygons) {
    const PlyElement *vertices = nullptr, *faces = nullptr;
    for (const PlyElement &element : header.elements) {
        const PlyElement *&known = element.name == "vertex" ? vertices : faces;
        if (element.name == "vertex" || element.name == "face" || element.name == "tristrips") {
            if (known) source.fail("PLY header: there is a second element '" + element.name + "'");
            known = &element;
        }
    }
    if (!vertices || !faces)
        source.fail(std::string("PLY header: there is no element '") + (vertices ? "face'" : "vertex'"));

    MeshData mesh;
    CornerUvs corner_uvs;
    for (const PlyElement &element : header.elements) {
        check_count(source, element);
        if (&element == vertices) read_vertices(source, element, srgb, mesh);
        else if (&element == faces)
            read_faces(source, element, vertices->count, srgb, keep_polygons, mesh, corner_uvs);
        else skip_element(source, element);
    }
    if (keep_polygons) {
        mesh.polygons.points.resize(mesh.positions.size());
        std::iota(mesh.polygons.points.begin(), mesh.polygons.points.end(), 0u);
    }
    if (!corner_uvs.triangles.empty()) VertexSplitter(mesh).split(corner_uvs);
    finish(mesh);
    return mesh;
}

} // namespace

MeshData read_ply(std::span<const std::byte> file, bool srgb_colors, bool keep_polygons) {
    TextCursor text = text_cursor(file);
    PlyHeader header = read_ply_header(text);
    if (header.format == PlyFormat::ascii)
        return read_elements(AsciiSource{text}, header, srgb_colors, keep_polygons);
    bool native_is_little = std::endian::native == std::endian::little;
    bool swap_bytes = (header.format == PlyFormat::little_endian) != native_is_little;
    auto data = file.last(static_cast<size_t>(text.end - text.at));
    return read_elements(BinarySource{data, file.size(), swap_bytes}, header, srgb_colors, keep_polygons);
}

} // namespace lajolla
