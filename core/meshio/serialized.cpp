#include "meshio/serialized.h"

#include "meshio/text.h"

#include <zlib.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cstring>
#include <limits>
#include <memory>

// The format is little endian; it is described in the documentation of Mitsuba's `serialized` plugin.

namespace lajolla {
namespace {

constexpr uint16_t magic = 0x041c;
constexpr size_t header_size = 4;
constexpr uint64_t most_unused = 1 << 18; // vertices that no triangle needs
// A stream is inflated to so many bytes, and so many more for each of its own.
constexpr size_t small_stream = 1 << 24, most_packing = 32;

enum Flags : uint32_t {
    has_normals = 0x0001,
    has_texcoords = 0x0002,
    has_colors = 0x0008,
    face_normals = 0x0010,
    double_precision = 0x2000,
};

template <class T>
T from_little_endian(const std::byte *data) {
    std::array<std::byte, sizeof(T)> bytes;
    std::memcpy(bytes.data(), data, sizeof(T));
    if constexpr (std::endian::native == std::endian::big) std::reverse(bytes.begin(), bytes.end());
    return std::bit_cast<T>(bytes);
}

template <class T>
T read_at(std::span<const std::byte> file, size_t offset) {
    if (offset > file.size() || file.size() - offset < sizeof(T))
        throw MeshError("byte " + std::to_string(offset) + ": the file ends too early");
    return from_little_endian<T>(file.data() + offset);
}

/// Checks the uncompressed header of a mesh and returns the version.
uint16_t read_version(std::span<const std::byte> file, size_t offset) {
    std::string where = "byte " + std::to_string(offset) + ": ";
    if (read_at<uint16_t>(file, offset) != magic) throw MeshError(where + "no serialized mesh starts here");
    auto version = read_at<uint16_t>(file, offset + 2);
    if (version != 3 && version != 4)
        throw MeshError(where + "version " + std::to_string(version) +
                        " of the serialized format is not supported (3 and 4 are)");
    return version;
}

/// The offset of a mesh, from the dictionary at the end of the file: an offset per mesh (32 bits in version
/// 3, 64 bits in version 4) and their number.
size_t find_shape(std::span<const std::byte> file, int shape_index) {
    uint16_t version = read_version(file, 0);
    if (shape_index == 0) return 0;
    size_t entry_size = version == 3 ? 4 : 8;
    if (file.size() < header_size + 4)
        throw MeshError("byte " + std::to_string(file.size()) + ": the file ends too early");
    size_t end = file.size() - 4;
    auto count = read_at<uint32_t>(file, end);
    if (count > end / entry_size)
        throw MeshError("byte " + std::to_string(end) + ": the file is too short for a dictionary of " +
                        std::to_string(count) + " meshes");
    if (shape_index < 0 || static_cast<uint32_t>(shape_index) >= count)
        throw MeshError("there is no mesh " + std::to_string(shape_index) + ", the file holds " +
                        std::to_string(count) + ", numbered from 0");
    size_t entry = end - entry_size * (count - static_cast<uint32_t>(shape_index));
    uint64_t offset = version == 3 ? read_at<uint32_t>(file, entry) : read_at<uint64_t>(file, entry);
    if (offset > entry)
        throw MeshError("byte " + std::to_string(entry) + ": the offset of mesh " +
                        std::to_string(shape_index) + " lies behind the end of the file");
    return static_cast<size_t>(offset);
}

/// Inflates a zlib stream piece by piece.
class Inflater {
public:
    Inflater(std::span<const std::byte> file, size_t offset)
        : start(offset), input(file.subspan(offset)), limit(small_stream + most_packing * input.size()),
          stream(new z_stream{}) {
        if (inflateInit(stream.get()) != Z_OK) throw MeshError("zlib cannot be initialized");
    }

    void read(std::span<std::byte> out) {
        while (!out.empty()) {
            int status = inflate_some(out);
            if (!out.empty() && status == Z_STREAM_END)
                fail("the compressed data holds less than the mesh needs");
        }
    }

    /// Lets zlib compare the checksum behind the data, if the mesh is all that was compressed.
    void finish() {
        std::byte surplus;
        std::span<std::byte> out(&surplus, 1);
        while (!out.empty() && inflate_some(out) != Z_STREAM_END) {
        }
    }

    template <class T>
    T read() {
        std::array<std::byte, sizeof(T)> bytes;
        read(bytes);
        return from_little_endian<T>(bytes.data());
    }

    /// Reads `count` elements that are made of Out, each stored as T. Memory grows with the data that is
    /// really there.
    template <class T, class Out, class Elements>
    void read_array(uint64_t count, Elements &elements) {
        constexpr uint64_t chunk = 1 << 14;
        constexpr size_t per_element = sizeof(elements[0]) / sizeof(Out);
        std::vector<std::byte> bytes(chunk * per_element * sizeof(T));
        while (elements.size() < count) {
            size_t first = elements.size(), n = static_cast<size_t>(std::min(chunk, count - first));
            read(std::span(bytes).first(n * per_element * sizeof(T)));
            elements.resize(first + n);
            auto *out = reinterpret_cast<Out *>(&elements[first]);
            for (size_t i = 0; i < n * per_element; ++i)
                out[i] = static_cast<Out>(from_little_endian<T>(&bytes[i * sizeof(T)]));
        }
    }

    [[noreturn]] void fail(const std::string &message) const {
        throw MeshError("mesh at byte " + std::to_string(start) + ": " + message);
    }

private:
    /// One call of zlib; advances `out` past the written bytes. Returns Z_OK or Z_STREAM_END.
    int inflate_some(std::span<std::byte> &out) {
        auto in_size = static_cast<uInt>(std::min<size_t>(input.size(), 1 << 30));
        auto out_size = static_cast<uInt>(std::min<size_t>(out.size(), 1 << 30));
        // zlib does not write to its input; the member lacks const for historical reasons
        stream->next_in = reinterpret_cast<Bytef *>(const_cast<std::byte *>(input.data()));
        stream->avail_in = in_size;
        stream->next_out = reinterpret_cast<Bytef *>(out.data());
        stream->avail_out = out_size;
        int status = inflate(stream.get(), Z_NO_FLUSH);
        input = input.subspan(in_size - stream->avail_in);
        out = out.subspan(out_size - stream->avail_out);
        if (stream->total_out > limit)
            fail("more than " + std::to_string(limit) + " bytes are packed into so small a file");
        if (status ==
            Z_BUF_ERROR) // no progress: there is room for output, so it is the input that is missing
            fail("the file ends too early");
        if (status != Z_OK && status != Z_STREAM_END) fail("the compressed data is damaged");
        return status;
    }

    struct End {
        void operator()(z_stream *s) const {
            inflateEnd(s);
            delete s;
        }
    };

    size_t start; // of the compressed data
    std::span<const std::byte> input;
    size_t limit; // of bytes that come out
    std::unique_ptr<z_stream, End> stream;
};

std::string read_name(Inflater &data) {
    std::string name;
    for (char c = data.read<char>(); c != 0; c = data.read<char>()) name.push_back(c);
    return name;
}

MeshData read_mesh(Inflater &data, uint16_t version) {
    MeshData mesh;
    auto flags = data.read<uint32_t>();
    if (version == 4) mesh.name = to_utf8(read_name(data));
    auto vertex_count = data.read<uint64_t>();
    auto triangle_count = data.read<uint64_t>();
    if (std::max(vertex_count, triangle_count) >= std::numeric_limits<uint32_t>::max())
        data.fail("the mesh claims more than 2^32 vertices or triangles");

    if (vertex_count > most_unused + 16 * triangle_count)
        data.fail("the mesh claims " + std::to_string(vertex_count) + " vertices for " +
                  std::to_string(triangle_count) + " triangles");

    auto read_floats = [&](uint64_t count, auto &elements) {
        if (flags & double_precision) data.read_array<double, float>(count, elements);
        else data.read_array<float, float>(count, elements);
    };
    read_floats(vertex_count, mesh.positions);
    if (flags & has_normals) read_floats(vertex_count, mesh.normals);
    if (flags & face_normals) mesh.normals = {};
    mesh.face_normals = (flags & face_normals) != 0;
    if (flags & has_texcoords) read_floats(vertex_count, mesh.uvs);
    if (flags & has_colors)
        read_floats(3 * vertex_count, mesh.attributes.emplace_back("vertex_color", 3, false).values);
    data.read_array<uint32_t, uint32_t>(triangle_count, mesh.triangles);
    for (const MeshData::Triangle &triangle : mesh.triangles)
        for (uint32_t index : triangle)
            if (index >= vertex_count)
                data.fail("a triangle refers to vertex " + std::to_string(index) + " of " +
                          std::to_string(vertex_count));
    return mesh;
}

} // namespace

MeshData read_serialized(std::span<const std::byte> file, int shape_index) {
    size_t offset = find_shape(file, shape_index);
    uint16_t version = read_version(file, offset);
    Inflater data(file, offset + header_size);
    MeshData mesh = read_mesh(data, version);
    data.finish();
    finish(mesh);
    return mesh;
}

} // namespace lajolla
