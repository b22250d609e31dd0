#pragma once

#include <cstddef>
#include <optional>
#include <span>
#include <string>
#include <string_view>

namespace lajolla {

/// A reading position in a text file. Readers move it forward; `line` counts from 1.
struct TextCursor {
    const char *at;
    const char *end;
    size_t line = 1;
};

/// A cursor at the start of a file, behind the UTF-8 byte order mark if there is one.
TextCursor text_cursor(std::span<const std::byte> file);

/// @throws MeshError that starts with the line number.
[[noreturn]] void fail(const TextCursor &text, const std::string &message);

inline bool is_blank(char c) { return c == ' ' || c == '\t' || c == '\r' || c == '\v' || c == '\f'; }

/// Moves over blanks within the line.
inline void skip_blanks(TextCursor &text) {
    while (text.at != text.end && is_blank(*text.at)) ++text.at;
}

/// Moves over blanks and line ends.
void skip_space(TextCursor &text);

/// Moves to the start of the next line.
void skip_line(TextCursor &text);

/// The characters up to the next blank or line end; empty at a line end. Moves behind them.
std::string_view read_word(TextCursor &text);

/// The rest of the line without the blanks around it. Moves to the line end.
std::string_view read_rest_of_line(TextCursor &text);

/// A decimal number in any usual notation, with "nan", "inf" and the "1.#QNAN" of Microsoft's C library.
/// Numbers beyond the range of double become infinite or zero. Nothing if there is no number here.
std::optional<double> read_number(TextCursor &text);

/// A name from a file as UTF-8: unchanged if it is that already, otherwise taken as Latin-1.
std::string to_utf8(std::string_view name);

/// The word at the cursor in quotes, for messages: shortened, unprintable characters replaced.
std::string quote_word(TextCursor text);

} // namespace lajolla
