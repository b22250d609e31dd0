#pragma once

#include "meshio/text.h"

#include <cstdint>
#include <string>
#include <vector>

namespace lajolla {

enum class PlyType { int8, uint8, int16, uint16, int32, uint32, int64, uint64, float16, float32, float64 };

size_t size_of(PlyType type);
bool is_floating(PlyType type);

/// The largest value of an integer type, 1 for the floating-point ones.
double largest_value(PlyType type);

struct PlyProperty {
    std::string name;
    PlyType type;
    bool is_list = false;
    PlyType count_type = PlyType::uint8; // of lists
};

struct PlyElement {
    std::string name;
    uint64_t count;
    std::vector<PlyProperty> properties;
};

enum class PlyFormat { ascii, little_endian, big_endian };

struct PlyHeader {
    PlyFormat format;
    std::vector<PlyElement> elements;
};

/// Reads the header and leaves the cursor at the first byte of the data.
/// @throws MeshError
PlyHeader read_ply_header(TextCursor &text);

} // namespace lajolla
