#include "meshio/ply_header.h"

#include <array>
#include <charconv>
#include <limits>
#include <optional>

namespace lajolla {
namespace {

/// More would let a small file of large polygons claim absurd amounts of memory.
constexpr size_t most_properties = 256;

struct TypeEntry {
    std::string_view name, alias, unofficial;
    size_t size;
    double largest;
};

/// In the order of `PlyType`. The last column contains Mitsuba 3's additional names.
constexpr std::array<TypeEntry, 11> types{{
    {"char", "int8", "", 1, 0x7f},
    {"uchar", "uint8", "", 1, 0xff},
    {"short", "int16", "", 2, 0x7fff},
    {"ushort", "uint16", "", 2, 0xffff},
    {"int", "int32", "", 4, 0x7fffffff},
    {"uint", "uint32", "", 4, 0xffffffff},
    {"int64", "int64", "long", 8, 0x1p63},
    {"uint64", "uint64", "ulong", 8, 0x1p64},
    {"float16", "float16", "half", 2, 1},
    {"float", "float32", "", 4, 1},
    {"double", "float64", "", 8, 1},
}};

const TypeEntry &entry(PlyType type) { return types[static_cast<size_t>(type)]; }

std::string_view next_word(TextCursor &text) {
    skip_blanks(text);
    return read_word(text);
}

std::string_view need_word(TextCursor &text, const char *what) {
    std::string_view word = next_word(text);
    if (word.empty()) fail(text, std::string("PLY header: expected ") + what + " before the end of the line");
    return word;
}

PlyType read_type(TextCursor &text) {
    std::string_view name = need_word(text, "a type");
    for (size_t i = 0; i < types.size(); ++i)
        if (name == types[i].name || name == types[i].alias || name == types[i].unofficial)
            return static_cast<PlyType>(i);
    fail(text, "PLY header: unknown type " + quote_word({name.data(), text.end}));
}

PlyFormat read_format(TextCursor &text) {
    std::string_view name = need_word(text, "a format");
    std::string_view version = need_word(text, "a version");
    if (version != "1.0") fail(text, "PLY header: unknown version " + quote_word({version.data(), text.end}));
    if (name == "ascii") return PlyFormat::ascii;
    if (name == "binary_little_endian") return PlyFormat::little_endian;
    if (name == "binary_big_endian") return PlyFormat::big_endian;
    fail(text, "PLY header: unknown format " + quote_word({name.data(), text.end}));
}

PlyElement read_element(TextCursor &text) {
    std::string name = to_utf8(need_word(text, "the name of an element"));
    std::string_view digits = need_word(text, "a count");
    uint64_t count = 0;
    auto [next, error] = std::from_chars(digits.data(), digits.data() + digits.size(), count);
    if (error != std::errc() || next != digits.data() + digits.size())
        fail(text, "PLY header: expected a count, found " + quote_word({digits.data(), text.end}));
    if (count >= std::numeric_limits<uint32_t>::max())
        fail(text, "PLY header: more than 2^32 of element '" + name + "'");
    return {name, count, {}};
}

PlyProperty read_property(TextCursor &text) {
    PlyProperty property;
    TextCursor start = text;
    property.is_list = need_word(text, "a type") == "list";
    if (property.is_list) {
        property.count_type = read_type(text);
        if (is_floating(property.count_type))
            fail(text, "PLY header: the length of a list must have an integer type");
    } else {
        text = start;
    }
    property.type = read_type(text);
    property.name = to_utf8(need_word(text, "the name of a property"));
    return property;
}

} // namespace

size_t size_of(PlyType type) { return entry(type).size; }

bool is_floating(PlyType type) { return type >= PlyType::float16; }

double largest_value(PlyType type) { return entry(type).largest; }

PlyHeader read_ply_header(TextCursor &text) {
    if (next_word(text) != "ply") fail(text, "this is no PLY file: it does not start with 'ply'");
    std::optional<PlyFormat> format;
    std::vector<PlyElement> elements;
    for (skip_line(text); text.at != text.end; skip_line(text)) {
        std::string_view keyword = next_word(text);
        if (keyword == "end_header") {
            if (!format) fail(text, "PLY header: there is no 'format' line");
            skip_line(text);
            return {*format, std::move(elements)};
        } else if (keyword == "format") {
            format = read_format(text);
        } else if (keyword == "element") {
            elements.push_back(read_element(text));
        } else if (keyword == "property") {
            if (elements.empty()) fail(text, "PLY header: a property stands before the first element");
            elements.back().properties.push_back(read_property(text));
            if (elements.back().properties.size() > most_properties)
                fail(text, "PLY header: an element has more than " + std::to_string(most_properties) +
                               " properties");
        } else if (!keyword.empty() && keyword != "comment" && keyword != "obj_info") {
            fail(text, "PLY header: unknown keyword " + quote_word({keyword.data(), text.end}));
        }
    }
    fail(text, "PLY header: the file ends before 'end_header'");
}

} // namespace lajolla
