#include "base/printable.hpp"

#include <cstdint>

namespace nadir {
namespace {

// Length of the UTF-8 sequence at the front of the text; 0 when there is none (RFC 3629: no surrogates, nothing
// overlong, nothing above U+10FFFF).
std::size_t sequence_length(std::string_view text) {
  const auto byte = [text](std::size_t i) { return static_cast<std::uint8_t>(text[i]); };
  const std::uint8_t first = byte(0);
  if (first < 0x80) return 1;
  const std::size_t length = first >= 0xF0 ? 4 : first >= 0xE0 ? 3 : 2;
  if (first < 0xC2 || first > 0xF4 || text.size() < length) return 0;
  for (std::size_t i = 1; i < length; ++i) {
    if ((byte(i) & 0xC0) != 0x80) return 0;
  }
  const std::uint8_t second = byte(1);
  if ((first == 0xE0 && second < 0xA0) || (first == 0xED && second > 0x9F) || (first == 0xF0 && second < 0x90) ||
      (first == 0xF4 && second > 0x8F)) {
    return 0;
  }
  return length;
}

constexpr std::string_view kLineEnd = "⏎";

// What is shown instead of a character; itself where it is harmless.
std::string_view shown(std::string_view character) {
  const auto byte = [character](std::size_t i) { return static_cast<std::uint8_t>(character[i]); };
  if (character.size() == 1) {
    if (byte(0) == '\n') return kLineEnd;
    return byte(0) < 0x20 || byte(0) == 0x7F ? "?" : character;
  }
  if (character.size() == 2 && byte(0) == 0xC2 && byte(1) < 0xA0) return "?";  // U+0080 to U+009F
  if (character.size() == 3 && byte(0) == 0xE2) {
    if (byte(1) == 0x80 && (byte(2) == 0xA8 || byte(2) == 0xA9)) return kLineEnd;
    if (byte(1) == 0x80 && byte(2) >= 0xAA && byte(2) <= 0xAE) return "?";
    if (byte(1) == 0x81 && byte(2) >= 0xA6 && byte(2) <= 0xA9) return "?";
  }
  return character;
}

std::string printable(std::string_view text, bool keep_line_feeds) {
  std::string result;
  result.reserve(text.size());
  while (!text.empty()) {
    const std::size_t length = sequence_length(text);
    if (keep_line_feeds && text.front() == '\n') {
      result += '\n';
    } else {
      result += length == 0 ? "?" : shown(text.substr(0, length));
    }
    text.remove_prefix(length == 0 ? 1 : length);
  }
  return result;
}

}  // namespace

std::string printable(std::string_view text) { return printable(text, false); }

std::string printable_url(std::string_view url) {
  // A password may hold a slash that nobody has escaped: everything up to the last '@' is secret.
  const std::size_t scheme = url.find("://"), at = url.rfind('@');
  if (at == std::string_view::npos) return printable(url);
  const std::size_t begin = scheme == std::string_view::npos || scheme > at ? 0 : scheme + 3;
  return printable(url.substr(0, begin)) + "***" + printable(url.substr(at));
}

std::string printable_lines(std::string_view text) { return printable(text, true); }

}  // namespace nadir
