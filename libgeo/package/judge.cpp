#include "package/judge.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>

#include "geodesy/web_mercator.hpp"
#include "package/gaps.hpp"
#include "package/tile_need.hpp"

namespace nadir {
namespace {

constexpr std::size_t kNamedPerZoom = 20;  // holes that are named one by one; more are only counted
constexpr std::int64_t kSecondsPerDay = 86'400;

std::string place_text(const TileKey& key) {
  const LonLatBox box = bounds_of(key);
  return fmt::format("near {:.6f},{:.6f}", (box.west_deg + box.east_deg) / 2, (box.south_deg + box.north_deg) / 2);
}

void report_gaps(const std::vector<Gap>& gaps, int zoom, Findings& findings) {
  if (gaps.empty()) return;
  double total_m2 = 0;
  for (const Gap& gap : gaps) total_m2 += gap.area_m2;
  findings.add({.code = "coverage.gap",
                .where = fmt::format("zoom {}", zoom),
                .expected = "every part of the sectors and of the corridor on valid pixels",
                .found = fmt::format("{} tiles with gaps, {:.0f} m² in all", gaps.size(), total_m2),
                .fix = "use imagery that covers the mission, or make the mission's area smaller"});
  for (std::size_t i = 0; i < std::min(gaps.size(), kNamedPerZoom); ++i) {
    const Gap& gap = gaps[i];
    findings.add(
        {.code = "coverage.gap",
         .where = "tile " + to_text(gap.key) + " " + place_text(gap.key),
         .expected = "valid pixels",
         .found = fmt::format("{}, {:.0f} m² of it needed", gap.whole_tile ? "no tile" : "empty pixels", gap.area_m2)});
  }
}

}  // namespace

std::vector<TileKey> required_tiles(const Mission& mission, int zoom) {
  const LocalFrame frame = mission_frame(mission);
  return tiles_needed(CoverageRequirement(required_region(mission, frame)), frame, zoom);
}

Findings judge_coverage(const Mission& mission, std::span<const Sidecar> tiles) {
  Findings findings;
  for (int zoom = mission.zoom.max; zoom >= mission.zoom.min; --zoom) {
    report_gaps(find_gaps(mission, tiles, zoom), zoom, findings);
  }
  return findings;
}

const Sector* deciding_sector(const Mission& mission, const LocalFrame& frame, const TileKey& key) {
  const Sector* strictest = nullptr;
  const TileFootprint footprint(frame, key);
  for (const Sector& sector : mission.sectors) {
    const bool stricter =
        strictest == nullptr || mission.freshness_days.of(sector.cls) < mission.freshness_days.of(strictest->cls);
    if (stricter && CoverageRequirement({{to_plane(frame, sector.polygon)}, {}}).needs(footprint)) strictest = &sector;
  }
  return strictest;
}

Findings judge_freshness(const Mission& mission, std::span<const Sidecar> tiles, UtcTime at) {
  // Sectors once, in the plane: there are many tiles.
  const LocalFrame frame = mission_frame(mission);
  struct Area {
    std::string name;
    SectorClass cls;
    CoverageRequirement need;
  };
  std::vector<Area> areas;
  for (const Sector& sector : mission.sectors) {
    areas.push_back({"sector " + sector.id, sector.cls, CoverageRequirement({{to_plane(frame, sector.polygon)}, {}})});
  }
  const Region region = required_region(mission, frame);
  areas.push_back({"the corridor", SectorClass::active, CoverageRequirement({{}, region.corridors})});

  struct Stale {
    std::size_t count = 0;
    TileKey example;
    UtcTime oldest{INT64_MAX};
  };
  std::map<std::size_t, Stale> stale;
  const int least_days = std::min(mission.freshness_days.stable, mission.freshness_days.active);
  for (const Sidecar& tile : tiles) {
    const std::int64_t age_s = at.unix_s - tile.captured_at.unix_s;
    if (age_s <= least_days * kSecondsPerDay) continue;
    const TileFootprint footprint(frame, tile.key);
    std::optional<std::size_t> decides;
    for (std::size_t i = 0; i < areas.size(); ++i) {
      if (decides && i + 1 == areas.size()) break;  // the corridor counts only outside of every sector
      const int days = mission.freshness_days.of(areas[i].cls);
      if (decides && days >= mission.freshness_days.of(areas[*decides].cls)) continue;
      if (areas[i].need.needs(footprint)) decides = i;
    }
    if (!decides || age_s <= mission.freshness_days.of(areas[*decides].cls) * kSecondsPerDay) continue;
    Stale& entry = stale[*decides];
    if (tile.captured_at < entry.oldest) entry.oldest = tile.captured_at, entry.example = tile.key;
    ++entry.count;
  }

  Findings findings;
  for (const auto& [area, entry] : stale) {
    const int days = mission.freshness_days.of(areas[area].cls);
    findings.add(
        {.code = "freshness.stale",
         .where = fmt::format("{}, {} tiles, for example {}", areas[area].name, entry.count, to_text(entry.example)),
         .expected =
             fmt::format("imagery of at most {} days ({}) at {}", days, name_of(areas[area].cls), to_rfc3339(at)),
         .found = fmt::format("captured {}, {} days before", to_rfc3339(entry.oldest),
                              (at.unix_s - entry.oldest.unix_s) / kSecondsPerDay),
         .fix = "get newer imagery, or raise freshness_days if the ground really has not changed"});
  }
  return findings;
}

Findings judge_resolution(const Mission& mission, std::span<const Sidecar> tiles) {
  const auto limit_mm = static_cast<std::int64_t>(std::llround(mission.min_resolution_m * 1000));
  std::size_t count = 0;
  const Sidecar* coarsest = nullptr;
  for (const Sidecar& tile : tiles) {
    if (tile.key.z != mission.zoom.max || tile.gsd_mm <= limit_mm) continue;
    ++count;
    if (coarsest == nullptr || tile.gsd_mm > coarsest->gsd_mm) coarsest = &tile;
  }
  Findings findings;
  if (coarsest != nullptr) {
    findings.add({.code = "resolution.coarse",
                  .where = fmt::format("{} tiles, for example {}", count, to_text(coarsest->key)),
                  .expected = fmt::format("imagery of {} m or finer", mission.min_resolution_m),
                  .found = fmt::format("{} m", static_cast<double>(coarsest->gsd_mm) / 1000),
                  .fix = "get finer imagery, or raise min_resolution_m"});
  }
  return findings;
}

Findings judge_budget(const Mission& mission, std::uint64_t package_bytes) {
  Findings findings;
  if (package_bytes > static_cast<std::uint64_t>(mission.budget_mb) * 1'000'000) {
    findings.add({.code = "budget.exceeded",
                  .where = "the package",
                  .expected = fmt::format("at most {} MB", mission.budget_mb),
                  .found = fmt::format("{:.1f} MB", static_cast<double>(package_bytes) / 1e6),
                  .fix = "lower the quality or zoom.max, make the area smaller, or raise budget_mb"});
  }
  return findings;
}

Findings judge_tiles(const Mission& mission, std::span<const Sidecar> tiles, std::uint64_t package_bytes, UtcTime at) {
  Findings findings = judge_coverage(mission, tiles);
  findings.add(judge_freshness(mission, tiles, at));
  findings.add(judge_resolution(mission, tiles));
  findings.add(judge_budget(mission, package_bytes));
  return findings;
}

}  // namespace nadir
