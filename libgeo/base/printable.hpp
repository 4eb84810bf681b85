// Text that is safe to show. Messages quote what they found, and that may come from an attacker or from a damaged file:
// no escape sequences to the terminal, and always valid UTF-8.
#pragma once

#include <string>
#include <string_view>

namespace nadir {

// Control characters (but for line ends) and bytes that are no UTF-8 become '?'.
std::string printable(std::string_view text);

}  // namespace nadir
