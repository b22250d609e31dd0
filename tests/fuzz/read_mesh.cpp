// Feeds bytes to one of the mesh readers, for libFuzzer: a mesh that keeps the promises of MeshData, or a
// MeshError.
//   read_mesh --reader=obj|ply|serialized|inflated [folders of inputs] [options of libFuzzer]

#include <zlib.h>

#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <string_view>

#include "meshio/obj.h"
#include "meshio/ply.h"
#include "meshio/serialized.h"

namespace lajolla {
namespace {

using Bytes = std::span<const std::byte>;
using Reader = MeshData (*)(Bytes);

// A file of version 4 with one mesh, whose data is the input: changes would seldom get past the compression.
MeshData read_inflated(Bytes payload) {
    const unsigned char head[] = {0x1C, 0x04, 0x04, 0x00};
    const unsigned char dictionary[] = {0, 0, 0, 0, 0, 0, 0, 0, 1, 0, 0, 0};
    uLongf size = compressBound(static_cast<uLong>(payload.size()));
    std::vector<unsigned char> file(std::size(head) + size);
    std::copy(std::begin(head), std::end(head), file.begin());
    const auto *data = reinterpret_cast<const unsigned char *>(payload.data());
    compress2(file.data() + std::size(head), &size, data, static_cast<uLong>(payload.size()), 1);
    file.resize(std::size(head) + size);
    file.insert(file.end(), std::begin(dictionary), std::end(dictionary));
    return read_serialized(std::as_bytes(std::span(file)), 0);
}

// The first byte stands for the settings, which a scene gives.
int setting(Bytes input) { return input.empty() ? 0 : static_cast<int>(input[0]); }

Reader reader_named(std::string_view name) {
    if (name == "obj") return [](Bytes input) { return read_obj(input, setting(input) % 4 - 1); };
    if (name == "ply") return [](Bytes input) { return read_ply(input, input.size() % 2); };
    if (name == "serialized") return [](Bytes input) { return read_serialized(input, setting(input) % 2); };
    if (name == "inflated") return read_inflated;
    return nullptr;
}

Reader reader = nullptr;

void require(bool holds, const char *promise) {
    if (holds) return;
    std::fprintf(stderr, "broken promise: %s\n", promise);
    std::abort();
}

bool is_finite(Vec3f v) { return std::isfinite(v.x) && std::isfinite(v.y) && std::isfinite(v.z); }

void check(const MeshData &mesh) {
    const size_t vertices = mesh.positions.size(), triangles = mesh.triangles.size();
    for (const Vec3f &p : mesh.positions) require(is_finite(p), "positions are finite");
    require(mesh.normals.empty() || mesh.normals.size() == vertices, "a normal for each vertex");
    for (const Vec3f &n : mesh.normals)
        require(std::abs(dot(n, n) - 1) < 1e-4f, "normals are of unit length");
    require(mesh.uvs.empty() || mesh.uvs.size() == vertices, "coordinates for each vertex");
    for (const Vec2f &uv : mesh.uvs)
        require(std::isfinite(uv.x) && std::isfinite(uv.y), "finite coordinates");
    for (const auto &triangle : mesh.triangles)
        for (const uint32_t index : triangle) require(index < vertices, "indices are below the vertex count");
    for (const auto &attribute : mesh.attributes) {
        const size_t count = attribute.per_face ? triangles : vertices;
        require(attribute.channels == 1 || attribute.channels == 3, "one or three channels");
        require(attribute.values.size() == count * static_cast<size_t>(attribute.channels),
                "as many values as there are vertices or triangles");
        for (const float value : attribute.values) require(std::isfinite(value), "attributes are finite");
    }
    size_t covered = 0;
    for (const auto &group : mesh.groups) {
        require(group.first_triangle == covered && group.triangle_count > 0, "groups follow each other");
        covered += group.triangle_count;
    }
    require(covered == 0 || covered == triangles, "groups hold all triangles");
}

} // namespace
} // namespace lajolla

extern "C" int LLVMFuzzerInitialize(int *count, char ***words) {
    for (int i = 1; i < *count; i++) {
        const std::string_view word = (*words)[i], option = "--reader=";
        if (word.starts_with(option)) lajolla::reader = lajolla::reader_named(word.substr(option.size()));
    }
    lajolla::require(lajolla::reader, "--reader=obj|ply|serialized|inflated is given");
    return 0;
}

extern "C" int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    try {
        lajolla::check(lajolla::reader(std::as_bytes(std::span(data, size))));
    } catch (const lajolla::MeshError &error) {
        lajolla::require(*error.what(), "errors have a message");
    }
    return 0;
}
