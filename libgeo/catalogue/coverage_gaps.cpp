#include "catalogue/coverage_gaps.hpp"

#include <algorithm>
#include <cmath>
#include <map>
#include <tuple>

#include "catalogue/geometry.hpp"
#include "geodesy/web_mercator.hpp"
#include "package/coverage_gaps.hpp"
#include "package/coverage_requirement.hpp"
#include "package/mission_check.hpp"
#include "package/tile_image.hpp"

namespace nadir {
namespace {

// The first pixel whose centre is not left of (or above) this coordinate.
std::int64_t first_centre(double coordinate) { return static_cast<std::int64_t>(std::ceil(coordinate - 0.5)); }

}  // namespace

PixelCover::PixelCover(int zoom, std::uint32_t first_tile_row, std::uint32_t last_tile_row)
    : zoom_(zoom),
      first_row_(std::int64_t{first_tile_row} * kTileSize),
      spans_(static_cast<std::size_t>(last_tile_row - first_tile_row + 1) * kTileSize) {}

void PixelCover::add(const GeoArea& area) {
  for (const GeoPolygon& polygon : area) add_polygon(polygon);
}

void PixelCover::add_polygon(const GeoPolygon& polygon) {
  // Where the outline and the holes cross the line through the centres of a row's pixels.
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
    std::vector<double>& columns = crossings[row];
    std::sort(columns.begin(), columns.end());
    for (std::size_t i = 1; i < columns.size(); i += 2) {
      const Span span{first_centre(columns[i - 1]), first_centre(columns[i])};
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

namespace {

CatalogueGap catalogue_gap(const Mission& mission, const LocalFrame& frame, const Gap& gap, std::string reason) {
  const Sector* sector = governing_sector(mission, frame, gap.key);
  return {.key = gap.key,
          .reason = std::move(reason),
          .area_m2 = gap.area_m2,
          .sector = sector == nullptr ? "" : sector->id,
          .outline = {}};
}

// What the mission can use of the sources, and what it could use with weaker requirements.
class SourceEvaluator {
 public:
  SourceEvaluator(const Mission& mission, const PixelCover& empty, std::span<const CatalogueSource> sources, UtcTime at)
      : mission_(mission), frame_(mission_frame(mission)), stable_(empty), active_(empty), fine_(empty), any_(empty) {
    for (const CatalogueSource& source : sources) {
      any_.add(source.footprint);
      if (!fine(source)) continue;
      fine_.add(source.footprint);
      if (fresh(source, SectorClass::stable, at)) stable_.add(source.footprint);
      if (fresh(source, SectorClass::active, at)) active_.add(source.footprint);
    }
  }

  // The usable imagery at this address, as if it were a tile; nullopt where there is none.
  std::optional<Sidecar> tile(const TileKey& key) const {
    Bytes pixels = strict().pixels(key);
    if (!all(pixels)) {
      const Sector* sector = governing_sector(mission_, frame_, key);
      const bool stable = sector != nullptr && sector->cls == SectorClass::stable;
      pixels = (stable ? stable_ : active_).pixels(key);
    }
    const auto valid = static_cast<std::int64_t>(std::count(pixels.begin(), pixels.end(), std::uint8_t{255}));
    if (valid == 0) return std::nullopt;
    Sidecar tile;
    tile.key = key;
    tile.valid_ppm = valid * kWholeTile_ppm / static_cast<std::int64_t>(pixels.size());
    if (tile.valid_ppm != kWholeTile_ppm) tile.mask = encode_tile_mask(pixels);
    return tile;
  }

  std::string reason(const TileKey& key, const Bytes& missing) const {
    if (overlaps(fine_.pixels(key), missing)) return "stale imagery";
    return overlaps(any_.pixels(key), missing) ? "coarse imagery" : "no imagery";
  }

 private:
  bool fine(const CatalogueSource& source) const {
    return source.gsd_mm <= static_cast<std::int64_t>(std::llround(mission_.min_resolution_m * 1000));
  }
  bool fresh(const CatalogueSource& source, SectorClass cls, UtcTime at) const {
    constexpr std::int64_t kSecondsPerDay = 86'400;
    return at.unix_s - source.captured_at.unix_s <= mission_.freshness_days.of(cls) * kSecondsPerDay;
  }
  // What satisfies this one satisfies both sector classes.
  const PixelCover& strict() const {
    return mission_.freshness_days.stable < mission_.freshness_days.active ? stable_ : active_;
  }

  static bool all(const Bytes& pixels) { return std::find(pixels.begin(), pixels.end(), 0) == pixels.end(); }
  static bool overlaps(const Bytes& a, const Bytes& b) {
    for (std::size_t i = 0; i < a.size(); ++i) {
      if (a[i] != 0 && b[i] != 0) return true;
    }
    return false;
  }

  const Mission& mission_;
  LocalFrame frame_;
  PixelCover stable_, active_, fine_, any_;
};

}  // namespace

std::vector<CatalogueGap> gaps_of_package(const Mission& mission, std::span<const Sidecar> tiles) {
  const LocalFrame frame = mission_frame(mission);
  std::vector<CatalogueGap> gaps;
  for (int zoom = mission.zoom.max; zoom >= mission.zoom.min; --zoom) {
    for (const Gap& gap : find_gaps(mission, tiles, zoom)) {
      gaps.push_back(catalogue_gap(mission, frame, gap, gap.whole_tile ? "no tile" : "empty pixels"));
      gaps.back().outline = area_of(gap.key, outlines_of(gap, mission, tiles));
    }
  }
  return gaps;
}

std::vector<CatalogueSource> sources_of(std::span<const Sidecar> tiles) {
  if (tiles.empty()) return {};
  const int finest = tiles.back().key.z;
  using Facts = std::tuple<std::string, UtcTime, std::int64_t, std::int64_t, TileTrust>;
  std::map<Facts, std::vector<const Sidecar*>> groups;
  for (const Sidecar& tile : tiles) {
    if (tile.key.z != finest || tile.valid_ppm == 0) continue;
    groups[{tile.source, tile.captured_at, tile.gsd_mm, tile.ce90_mm, tile.trust}].push_back(&tile);
  }
  std::vector<CatalogueSource> sources;
  for (const auto& [facts, members] : groups) {
    const auto& [provider, captured_at, gsd_mm, ce90_mm, trust] = facts;
    sources.push_back({.package_id = 0,
                       .provider = provider,
                       .captured_at = captured_at,
                       .gsd_mm = gsd_mm,
                       .ce90_mm = ce90_mm,
                       .trust = trust,
                       .zoom = finest,
                       .tiles = static_cast<std::int64_t>(members.size()),
                       .footprint = footprint_of(members)});
  }
  return sources;
}

std::vector<CatalogueGap> gaps_of_imagery(const Mission& mission, std::span<const CatalogueSource> sources,
                                          UtcTime at) {
  const std::vector<TileKey> keys = required_tiles(mission, mission.zoom.max);
  if (keys.empty()) return {};
  const auto [north, south] =
      std::minmax_element(keys.begin(), keys.end(), [](const TileKey& a, const TileKey& b) { return a.y < b.y; });
  const SourceEvaluator evaluator(mission, PixelCover(mission.zoom.max, north->y, south->y), sources, at);
  std::vector<Sidecar> tiles;
  for (const TileKey& key : keys) {
    if (auto tile = evaluator.tile(key)) tiles.push_back(std::move(*tile));
  }
  const LocalFrame frame = mission_frame(mission);
  const CoverageRequirement need(required_region(mission, frame));
  std::vector<CatalogueGap> gaps;
  for (const Gap& gap : find_gaps(mission, tiles, mission.zoom.max)) {
    const auto tile = std::lower_bound(tiles.begin(), tiles.end(), gap.key,
                                       [](const Sidecar& a, const TileKey& key) { return a.key < key; });
    const bool there = tile != tiles.end() && tile->key == gap.key;
    const auto valid = there ? decode_tile_mask(tile->mask) : std::nullopt;
    const Bytes missing = need.missing_mask(TileFootprint(frame, gap.key), valid ? ByteView(*valid) : ByteView());
    gaps.push_back(catalogue_gap(mission, frame, gap, evaluator.reason(gap.key, missing)));
    gaps.back().outline = area_of(gap.key, outlines_of(missing));
  }
  return gaps;
}

}  // namespace nadir
