#include "catalogue/catalogue_cover.hpp"

#include <algorithm>
#include <cmath>

#include "geodesy/web_mercator.hpp"

namespace nadir {
namespace {

// The first pixel whose centre is not left of (or above) this place.
std::int64_t first_centre(double place) { return static_cast<std::int64_t>(std::ceil(place - 0.5)); }

}  // namespace

PixelCover::PixelCover(int zoom, std::uint32_t first_tile_row, std::uint32_t last_tile_row)
    : zoom_(zoom),
      first_row_(std::int64_t{first_tile_row} * kTileSize),
      spans_(static_cast<std::size_t>(last_tile_row - first_tile_row + 1) * kTileSize) {}

void PixelCover::add(const GeoArea& area) {
  for (const GeoPolygon& polygon : area) add_polygon(polygon);
}

void PixelCover::add_polygon(const GeoPolygon& polygon) {
  // Even-odd along every row: where the outline and the holes cross the line through the row's centres.
  std::vector<std::vector<double>> crossings(spans_.size());
  const auto end_row = first_row_ + static_cast<std::int64_t>(spans_.size());
  for (const GeoRing& ring : polygon) {
    for (std::size_t i = 1; i < ring.size(); ++i) {
      GlobalPixel a = pixel_from_lonlat(ring[i - 1], zoom_), b = pixel_from_lonlat(ring[i], zoom_);
      if (b.y < a.y) std::swap(a, b);
      const std::int64_t begin = std::max(first_centre(a.y), first_row_), end = std::min(first_centre(b.y), end_row);
      for (std::int64_t row = begin; row < end; ++row) {
        const double along = (static_cast<double>(row) + 0.5 - a.y) / (b.y - a.y);
        crossings[static_cast<std::size_t>(row - first_row_)].push_back(a.x + along * (b.x - a.x));
      }
    }
  }
  for (std::size_t row = 0; row < crossings.size(); ++row) {
    std::vector<double>& places = crossings[row];
    std::sort(places.begin(), places.end());
    for (std::size_t i = 1; i < places.size(); i += 2) {
      const Span span{first_centre(places[i - 1]), first_centre(places[i])};
      if (span.begin < span.end) spans_[row].push_back(span);
    }
  }
}

Bytes PixelCover::pixels(const TileKey& key) const {
  Bytes pixels(static_cast<std::size_t>(kTileSize) * kTileSize, 0);
  const std::int64_t top = std::int64_t{key.y} * kTileSize - first_row_, left = std::int64_t{key.x} * kTileSize;
  if (top < 0 || top + kTileSize > static_cast<std::int64_t>(spans_.size())) return pixels;
  for (std::int64_t row = 0; row < kTileSize; ++row) {
    for (const Span& span : spans_[static_cast<std::size_t>(top + row)]) {
      const std::int64_t begin = std::max<std::int64_t>(span.begin - left, 0);
      const std::int64_t end = std::min<std::int64_t>(span.end - left, kTileSize);
      if (begin < end) std::fill(pixels.begin() + row * kTileSize + begin, pixels.begin() + row * kTileSize + end, 255);
    }
  }
  return pixels;
}

}  // namespace nadir
