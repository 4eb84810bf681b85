// Text that is safe to show. Messages quote what they found, which may come from an attacker or a damaged file: no escape
// sequences to the terminal, and always valid UTF-8.
#pragma once

#include <string>
#include <string_view>

namespace nadir {

// Control characters other than line feeds, and bytes that are not UTF-8, become '?'.
std::string printable(std::string_view text);

}  // namespace nadir
