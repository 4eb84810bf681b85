// Web Mercator (EPSG:3857), the grid of all tiles: the Mercator projection of a sphere, applied to WGS84 longitudes and
// latitudes.
//
//   x = R lon,  y = R asinh(tan lat),  R = 6378137 m
//
// Global pixels: at zoom z the world is 256·2^z pixels wide; (0, 0) is the north-west corner, y grows south. A pixel's
// centre is at +0.5. On the ground a pixel is smaller by cos(latitude) than on the map (and by up to 0.7 % more,
// because the projection takes the ellipsoid for a sphere): measure in a LocalFrame, not in Mercator metres.
//
// A TileKey is the address of a tile of 256 x 256 pixels: always XYZ (row 0 in the north) inside this code. MBTiles
// rows (TMS, row 0 in the south) exist only at the database, through tms_row().
#pragma once

#include <compare>
#include <cstdint>
#include <numbers>
#include <optional>
#include <string>
#include <string_view>

#include "geodesy/lon_lat.hpp"

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

inline constexpr double kMercatorRadius_m = 6378137.0;
inline constexpr double kMercatorHalfWorld_m = std::numbers::pi * kMercatorRadius_m;  // from its centre to each edge
inline constexpr double kMercatorMaxLat_deg = 85.05112877980659;

struct MercatorXY {
  double x_m = 0;  // east
  double y_m = 0;  // north
};

struct GlobalPixel {
  double x = 0;
  double y = 0;
};

MercatorXY mercator_from_lonlat(LonLat place);
LonLat lonlat_from_mercator(MercatorXY point);

GlobalPixel pixel_from_lonlat(LonLat place, int zoom);
LonLat lonlat_from_pixel(GlobalPixel pixel, int zoom);

// Side of a pixel in Mercator metres: 156543.03 m at zoom 0.
double mercator_pixel_m(int zoom);

// East-west size of a pixel on the ellipsoid at this latitude.
double ground_resolution_m(int zoom, double lat_deg);

// The tile that holds the place; the edge of the world belongs to the last tile.
TileKey tile_at(LonLat place, int zoom);

struct LonLatBox {
  double west_deg = 0, south_deg = 0, east_deg = 0, north_deg = 0;
};
LonLatBox bounds_of(const TileKey& key);

}  // namespace nadir
