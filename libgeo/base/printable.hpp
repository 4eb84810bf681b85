// Text that is safe to show. Messages quote what they found, which may come from an attacker or a damaged file: no
// escape sequences to the terminal, no lines that look like the program's own, and always valid UTF-8.
#pragma once

#include <string>
#include <string_view>

namespace nadir {

// On one line. Line ends (line feed, U+2028, U+2029) become "⏎"; other control characters, those that change the
// direction of text (U+202A to U+202E, U+2066 to U+2069) and bytes that are not UTF-8 become '?'.
std::string printable(std::string_view text);

// The same, but keeps line feeds: for text whose lines the program itself has made of printable() parts.
std::string printable_lines(std::string_view text);

// The same of a URL, without what stands before the '@' of its address: user and password do not belong into messages.
std::string printable_url(std::string_view url);

}  // namespace nadir
