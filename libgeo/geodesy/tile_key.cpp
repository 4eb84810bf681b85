#include "geodesy/tile_key.hpp"

#include <fmt/format.h>

#include <charconv>

namespace nadir {

std::string to_text(const TileKey& key) { return fmt::format("{}/{}/{}", key.z, key.x, key.y); }

std::optional<TileKey> parse_tile_key(std::string_view text) {
  std::uint32_t parts[3] = {};
  const char* at = text.data();
  const char* const end = text.data() + text.size();
  for (int i = 0; i < 3; ++i) {
    if (i > 0 && (at == end || *at++ != '/')) return std::nullopt;
    const auto [next, error] = std::from_chars(at, end, parts[i]);
    if (error != std::errc{}) return std::nullopt;
    at = next;
  }
  if (at != end || parts[0] > static_cast<std::uint32_t>(kMaxZoom)) return std::nullopt;
  const TileKey key{static_cast<std::uint8_t>(parts[0]), parts[1], parts[2]};
  const bool one_spelling = to_text(key) == text;  // no leading zeros
  return key.valid() && one_spelling ? std::optional(key) : std::nullopt;
}

}  // namespace nadir
