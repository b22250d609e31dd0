#include "meshio/text.h"

#include "meshio/mesh_data.h"

#include <charconv>
#include <cstring>
#include <limits>

namespace lajolla {
namespace {

/// Distinguishes underflow from overflow of a number that std::from_chars called out of range.
bool is_tiny(std::string_view number) {
    size_t exponent = number.find_first_of("eE");
    if (exponent != std::string_view::npos) return number[exponent + 1] == '-';
    return number.find_first_of("123456789") > number.find('.');
}

/// The length of the UTF-8 sequence that `text` starts with (RFC 3629, section 4); 0 if it is not valid.
size_t utf8_length(std::string_view text) {
    auto byte = [&](size_t i) { return i < text.size() ? static_cast<unsigned char>(text[i]) : 0u; };
    unsigned lead = byte(0);
    size_t length = lead < 0x80   ? 1
                    : lead < 0xc2 ? 0
                    : lead < 0xe0 ? 2
                    : lead < 0xf0 ? 3
                    : lead < 0xf5 ? 4
                                  : 0;
    for (size_t i = 1; i < length; ++i)
        if ((byte(i) & 0xc0) != 0x80) return 0;
    bool overlong = (lead == 0xe0 && byte(1) < 0xa0) || (lead == 0xf0 && byte(1) < 0x90);
    bool surrogate = lead == 0xed && byte(1) > 0x9f;
    bool too_large = lead == 0xf4 && byte(1) > 0x8f;
    return overlong || surrogate || too_large ? 0 : length;
}

bool is_utf8(std::string_view text) {
    while (!text.empty()) {
        size_t length = utf8_length(text);
        if (length == 0) return false;
        text.remove_prefix(length);
    }
    return true;
}

} // namespace

TextCursor text_cursor(std::span<const std::byte> file) {
    constexpr std::string_view byte_order_mark = "\xef\xbb\xbf";
    std::string_view text(reinterpret_cast<const char *>(file.data()), file.size());
    if (text.starts_with(byte_order_mark)) text.remove_prefix(byte_order_mark.size());
    return {text.data(), text.data() + text.size()};
}

void fail(const TextCursor &text, const std::string &message) {
    throw MeshError("line " + std::to_string(text.line) + ": " + message);
}

void skip_space(TextCursor &text) {
    for (skip_blanks(text); text.at != text.end && *text.at == '\n'; skip_blanks(text)) skip_line(text);
}

void skip_line(TextCursor &text) {
    if (text.at == text.end) return;
    const void *newline = std::memchr(text.at, '\n', static_cast<size_t>(text.end - text.at));
    text.at = newline ? static_cast<const char *>(newline) + 1 : text.end;
    ++text.line;
}

std::string_view read_word(TextCursor &text) {
    const char *first = text.at;
    while (text.at != text.end && *text.at != '\n' && !is_blank(*text.at)) ++text.at;
    return {first, text.at};
}

std::string_view read_rest_of_line(TextCursor &text) {
    skip_blanks(text);
    const char *first = text.at;
    while (text.at != text.end && *text.at != '\n') ++text.at;
    const char *last = text.at;
    while (last != first && is_blank(last[-1])) --last;
    return {first, last};
}

std::optional<double> read_number(TextCursor &text) {
    const char *first = text.at;
    if (first != text.end && *first == '+') // std::from_chars takes no plus sign
        ++first;
    double value = 0;
    auto [next, error] = std::from_chars(first, text.end, value);
    if (error == std::errc::invalid_argument) return std::nullopt;
    if (error == std::errc::result_out_of_range)
        value = is_tiny({first, next}) ? 0 : std::numeric_limits<double>::infinity();
    text.at = next;
    if (next != text.end && *next == '#') { // 1.#QNAN, -1.#IND, 1.#INF00
        value = std::numeric_limits<double>::quiet_NaN();
        read_word(text);
    }
    return value;
}

std::string to_utf8(std::string_view name) {
    if (is_utf8(name)) return std::string(name);
    std::string result;
    for (char c : name) {
        auto code = static_cast<unsigned char>(c);
        if (code >= 0x80) result.push_back(static_cast<char>(0xc0 | code >> 6));
        result.push_back(code < 0x80 ? c : static_cast<char>(0x80 | (code & 0x3f)));
    }
    return result;
}

std::string quote_word(TextCursor text) {
    constexpr size_t longest = 32;
    std::string word(read_word(text).substr(0, longest));
    for (char &c : word)
        if (c < ' ' || c > '~') c = '?';
    return word.empty() ? "the end of the line" : "'" + word + "'";
}

} // namespace lajolla
