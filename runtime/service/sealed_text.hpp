// One line of text and, in a second line, its SHA-256: what the state directory's files are. Anything else, each
// truncation and each flipped bit, is rejected with a reason.
#pragma once

#include <optional>
#include <string>
#include <string_view>

#include "base/digest.hpp"

namespace nadir {

inline std::string sealed(const std::string& line) { return line + "\n" + sha256(as_bytes(line)).hex() + "\n"; }

// The line; or nullopt, and why.
inline std::optional<std::string_view> unsealed(std::string_view text, std::string& rejection) {
  const std::size_t end = text.find('\n');
  if (end == std::string_view::npos) {
    rejection = "cut short";
    return std::nullopt;
  }
  const std::string_view line = text.substr(0, end);
  if (text.substr(end + 1) == sha256(as_bytes(line)).hex() + "\n") return line;
  rejection = "damaged: its SHA-256 does not match";
  return std::nullopt;
}

}  // namespace nadir
