// The address of a map tile. Always XYZ (row 0 in the north) inside this code; MBTiles rows (TMS, row 0 in the south)
// exist only at the database's edge, through tms_row().
#pragma once

#include <compare>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

namespace nadir {

inline constexpr int kMaxZoom = 24;
inline constexpr int kTileSize = 256;  // pixels, both ways

struct TileKey {
  std::uint8_t z = 0;
  std::uint32_t x = 0;
  std::uint32_t y = 0;

  auto operator<=>(const TileKey&) const = default;  // by zoom, then x, then y

  bool valid() const { return z <= kMaxZoom && x < tiles_across() && y < tiles_across(); }
  std::uint32_t tiles_across() const { return std::uint32_t{1} << z; }
  std::uint32_t tms_row() const { return tiles_across() - 1 - y; }
  static TileKey from_tms(std::uint8_t z, std::uint32_t column, std::uint32_t row) {
    return {z, column, (std::uint32_t{1} << z) - 1 - row};
  }
  TileKey parent() const { return {static_cast<std::uint8_t>(z - 1), x / 2, y / 2}; }
};

std::string to_text(const TileKey& key);                       // "19/438048/225763"
std::optional<TileKey> parse_tile_key(std::string_view text);  // the same form back; nullopt when not a valid key

}  // namespace nadir
