#include "geodesy/web_mercator.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <cmath>

#include "geodesy/angles.hpp"

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

namespace {

constexpr double kWgs84E2 = 0.0066943799901413165;

}  // namespace

MercatorXY mercator_from_lonlat(LonLat place) {
  const double lat = radians(std::clamp(place.lat_deg, -kMercatorMaxLat_deg, kMercatorMaxLat_deg));
  return {kMercatorRadius_m * radians(place.lon_deg), kMercatorRadius_m * std::asinh(std::tan(lat))};
}

LonLat lonlat_from_mercator(MercatorXY point) {
  return {degrees(point.x_m / kMercatorRadius_m), degrees(std::atan(std::sinh(point.y_m / kMercatorRadius_m)))};
}

double mercator_pixel_m(int zoom) { return 2.0 * kMercatorHalfWorld_m / (kTileSize * std::exp2(zoom)); }

GlobalPixel pixel_from_lonlat(LonLat place, int zoom) {
  const MercatorXY point = mercator_from_lonlat(place);
  const double pixel_m = mercator_pixel_m(zoom);
  return {(point.x_m + kMercatorHalfWorld_m) / pixel_m, (kMercatorHalfWorld_m - point.y_m) / pixel_m};
}

LonLat lonlat_from_pixel(GlobalPixel pixel, int zoom) {
  const double pixel_m = mercator_pixel_m(zoom);
  return lonlat_from_mercator({pixel.x * pixel_m - kMercatorHalfWorld_m, kMercatorHalfWorld_m - pixel.y * pixel_m});
}

double ground_resolution_m(int zoom, double lat_deg) {
  const double lat = radians(lat_deg);
  const double prime_vertical = 1.0 / std::sqrt(1.0 - kWgs84E2 * std::sin(lat) * std::sin(lat));
  return mercator_pixel_m(zoom) * std::cos(lat) * prime_vertical;
}

TileKey tile_at(LonLat place, int zoom) {
  const GlobalPixel pixel = pixel_from_lonlat(place, zoom);
  const double last = std::exp2(zoom) - 1.0;
  const auto index = [last](double value) {
    return static_cast<std::uint32_t>(std::clamp(std::floor(value / kTileSize), 0.0, last));
  };
  return {static_cast<std::uint8_t>(zoom), index(pixel.x), index(pixel.y)};
}

LonLatBox bounds_of(const TileKey& key) {
  const auto corner = [&](std::uint32_t x, std::uint32_t y) {
    return lonlat_from_pixel({static_cast<double>(x) * kTileSize, static_cast<double>(y) * kTileSize}, key.z);
  };
  const LonLat north_west = corner(key.x, key.y);
  const LonLat south_east = corner(key.x + 1, key.y + 1);
  return {north_west.lon_deg, south_east.lat_deg, south_east.lon_deg, north_west.lat_deg};
}

}  // namespace nadir
