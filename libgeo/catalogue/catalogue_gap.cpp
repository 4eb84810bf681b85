#include "catalogue/catalogue_gap.hpp"

#include <algorithm>
#include <cmath>
#include <map>
#include <tuple>

#include "catalogue/catalogue_cover.hpp"
#include "catalogue/catalogue_shapes.hpp"
#include "package/coverage_gaps.hpp"
#include "package/mission_check.hpp"
#include "package/tile_image.hpp"
#include "package/coverage_requirement.hpp"

namespace nadir {
namespace {

GeoArea area_from(const TileKey& key, const std::vector<PixelPolygon>& polygons) {
  GeoArea area;
  const auto ring_from = [&key](const PixelRing& ring) {
    GeoRing places;
    for (const PixelCorner& corner : ring) places.push_back(place_of(key, corner));
    return places;
  };
  for (const PixelPolygon& polygon : polygons) {
    GeoPolygon rings{ring_from(polygon.outer)};
    for (const PixelRing& hole : polygon.holes) rings.push_back(ring_from(hole));
    area.push_back(std::move(rings));
  }
  return area;
}

CatalogueGap catalogue_gap(const Mission& mission, const LocalFrame& frame, const Gap& gap, std::string reason) {
  const Sector* sector = governing_sector(mission, frame, gap.key);
  return {.key = gap.key,
          .reason = std::move(reason),
          .area_m2 = gap.area_m2,
          .sector = sector == nullptr ? "" : sector->id,
          .outline = {}};
}

// What the mission may use of the sources, and what it could use if it were less strict.
class Judge {
 public:
  Judge(const Mission& mission, const PixelCover& nothing, std::span<const CatalogueSource> sources, UtcTime at)
      : mission_(mission),
        frame_(mission_frame(mission)),
        stable_(nothing),
        active_(nothing),
        fine_(nothing),
        any_(nothing) {
    for (const CatalogueSource& source : sources) {
      any_.add(source.footprint);
      if (!fine(source)) continue;
      fine_.add(source.footprint);
      if (fresh(source, SectorClass::stable, at)) stable_.add(source.footprint);
      if (fresh(source, SectorClass::active, at)) active_.add(source.footprint);
    }
  }

  // The imagery that serves at this address, as if it were a tile; nullopt where there is none.
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
  // What serves here serves everywhere.
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
      gaps.back().outline = area_from(gap.key, outlines_of(gap, mission, tiles));
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
  const Judge judge(mission, PixelCover(mission.zoom.max, north->y, south->y), sources, at);
  std::vector<Sidecar> tiles;
  for (const TileKey& key : keys) {
    if (auto tile = judge.tile(key)) tiles.push_back(std::move(*tile));
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
    gaps.push_back(catalogue_gap(mission, frame, gap, judge.reason(gap.key, missing)));
    gaps.back().outline = area_from(gap.key, outlines_of(missing));
  }
  return gaps;
}

}  // namespace nadir
