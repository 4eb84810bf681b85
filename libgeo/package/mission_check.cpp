#include "package/mission_check.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>

#include "base/error.hpp"
#include "base/files.hpp"
#include "base/plural.hpp"
#include "geodesy/angles.hpp"
#include "geodesy/web_mercator.hpp"
#include "package/coverage_gaps.hpp"
#include "package/coverage_requirement.hpp"

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
                .expected = "valid pixels for every part of the sectors and of the corridor",
                .found = fmt::format("{} with gaps, {:.0f} m² in total", count(gaps.size(), "tile"), total_m2),
                .fix = "use imagery that covers the mission, or reduce the mission's area"});
  for (std::size_t i = 0; i < std::min(gaps.size(), kNamedPerZoom); ++i) {
    const Gap& gap = gaps[i];
    findings.add(
        {.code = "coverage.gap",
         .where = "tile " + to_text(gap.key) + " " + place_text(gap.key),
         .expected = "valid pixels",
         .found = fmt::format("{}, {:.0f} m² needed", gap.whole_tile ? "no tile" : "empty pixels", gap.area_m2)});
  }
}

}  // namespace

Findings check_coverage(const Mission& mission, std::span<const Sidecar> tiles) {
  Findings findings;
  for (int zoom = mission.zoom.max; zoom >= mission.zoom.min; --zoom) {
    report_gaps(find_gaps(mission, tiles, zoom), zoom, findings);
  }
  return findings;
}

const Sector* governing_sector(const Mission& mission, const LocalFrame& frame, const TileKey& key) {
  const Sector* strictest = nullptr;
  const TileFootprint footprint(frame, key);
  for (const Sector& sector : mission.sectors) {
    const bool stricter =
        strictest == nullptr || mission.freshness_days.of(sector.cls) < mission.freshness_days.of(strictest->cls);
    if (stricter && CoverageRequirement(region_of(sector, frame)).needs(footprint)) strictest = &sector;
  }
  return strictest;
}

Findings check_freshness(const Mission& mission, std::span<const Sidecar> tiles, UtcTime at) {
  // Sectors once, in the plane: there are many tiles.
  const LocalFrame frame = mission_frame(mission);
  struct Area {
    std::string name;
    SectorClass cls;
    CoverageRequirement need;
  };
  std::vector<Area> areas;
  for (const Sector& sector : mission.sectors) {
    areas.push_back({"sector " + sector.id, sector.cls, CoverageRequirement(region_of(sector, frame))});
  }
  areas.push_back({"the corridor", SectorClass::active, CoverageRequirement(corridor_of(mission.route, frame))});

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
         .where = fmt::format("{}, {}, for example {}", areas[area].name, count(entry.count, "tile"),
                              to_text(entry.example)),
         .expected = fmt::format("imagery at most {} old ({}) at {}", count(static_cast<std::size_t>(days), "day"),
                                 name_of(areas[area].cls), to_rfc3339(at)),
         .found =
             fmt::format("captured {}, {} earlier", to_rfc3339(entry.oldest),
                         count(static_cast<std::size_t>((at.unix_s - entry.oldest.unix_s) / kSecondsPerDay), "day")),
         .fix = "get newer imagery, or raise freshness_days if the ground has not changed"});
  }
  return findings;
}

Findings check_resolution(const Mission& mission, std::span<const Sidecar> tiles) {
  const auto limit_mm = static_cast<std::int64_t>(std::llround(mission.min_resolution_m * 1000));
  std::size_t coarse = 0;
  const Sidecar* coarsest = nullptr;
  for (const Sidecar& tile : tiles) {
    if (tile.key.z != mission.zoom.max || tile.gsd_mm <= limit_mm) continue;
    ++coarse;
    if (coarsest == nullptr || tile.gsd_mm > coarsest->gsd_mm) coarsest = &tile;
  }
  Findings findings;
  if (coarsest != nullptr) {
    findings.add({.code = "resolution.coarse",
                  .where = fmt::format("{}, for example {}", count(coarse, "tile"), to_text(coarsest->key)),
                  .expected = fmt::format("imagery of {} m or finer", mission.min_resolution_m),
                  .found = fmt::format("{} m", static_cast<double>(coarsest->gsd_mm) / 1000),
                  .fix = "get finer imagery, or raise min_resolution_m"});
  }
  return findings;
}

Findings check_expiry(const Mission& mission, UtcTime at, Severity severity) {
  Findings findings;
  if (at >= mission.expires) {
    findings.add({.code = "package.expired",
                  .severity = severity,
                  .where = "mission.expires",
                  .expected = "later than " + to_rfc3339(at) + ": aircraft reject an expired package",
                  .found = to_rfc3339(mission.expires),
                  .fix = "give the mission a later date"});
  }
  return findings;
}

Findings check_plausibility(const Mission& mission) {
  constexpr double kMetresPerFoot = 0.3048;
  constexpr double kUsualCeiling_m = 300;  // few small aircraft photograph from above; 400 and 500 are usual in feet
  Findings findings;
  const Route& route = mission.route;
  double highest_m = route.agl_m;
  for (std::size_t i = 0; i < route.heights_m.size(); ++i) {
    if (route.frame_at(i) != HeightFrame::above_sea_level) highest_m = std::max(highest_m, route.heights_m[i]);
  }
  if (highest_m >= kUsualCeiling_m) {
    findings.add({.code = "mission.height",
                  .severity = Severity::note,
                  .where = "route",
                  .expected = "heights in metres",
                  .found = fmt::format("{:g} m, which is {:.0f} ft", highest_m, highest_m / kMetresPerFoot),
                  .fix = fmt::format("if these are feet, write {:.0f}", highest_m * kMetresPerFoot)});
  }
  const LocalFrame frame = mission_frame(mission);
  const PlanePath path = to_plane(frame, route.points);
  for (const NoFlyArea& area : mission.no_fly) {
    bool enters = false;
    if (area.polygon.empty()) {
      enters = path.size() > 1 && distance_to_path_m(path, frame.plane_from_lonlat(area.centre)) < area.radius_m;
    } else {
      const PlaneRing ring = to_plane(frame, area.polygon);
      constexpr double kStep_m = 5;
      for (std::size_t i = 1; i < path.size() && !enters; ++i) {
        const double leg_m = distance_m(path[i - 1], path[i]);
        const int steps = std::max(1, static_cast<int>(std::ceil(leg_m / kStep_m)));
        for (int k = 0; k <= steps && !enters; ++k) {
          enters = contains(ring, path[i - 1] + static_cast<double>(k) / steps * (path[i] - path[i - 1]));
        }
      }
    }
    if (!enters) continue;
    findings.add({.code = "mission.no_fly",
                  .severity = Severity::warning,
                  .where = "route",
                  .expected = "a route that stays out of no-fly areas",
                  .found = "it enters " + area.id,
                  .fix = "move the route, or remove the area"});
  }
  return findings;
}

Findings check_budget(const Mission& mission, std::uint64_t package_bytes,
                      std::optional<std::uint64_t> expected_bytes) {
  Findings findings;
  if (package_bytes > static_cast<std::uint64_t>(mission.budget_mb) * 1'000'000) {
    findings.add({.code = "budget.exceeded",
                  .where = "the package",
                  .expected = fmt::format("at most {} MB", mission.budget_mb),
                  .found = expected_bytes ? fmt::format("at least {:.1f} MB, about {:.1f} MB expected",
                                                        static_cast<double>(package_bytes) / 1e6,
                                                        static_cast<double>(*expected_bytes) / 1e6)
                                          : fmt::format("{:.1f} MB", static_cast<double>(package_bytes) / 1e6),
                  .fix = "lower the quality or zoom.max, reduce the area, or raise budget_mb"});
  }
  return findings;
}

Findings check_tile_requirements(const Mission& mission, std::span<const Sidecar> tiles, std::uint64_t package_bytes,
                                 UtcTime at) {
  Findings findings = check_coverage(mission, tiles);
  findings.add(check_freshness(mission, tiles, at));
  findings.add(check_resolution(mission, tiles));
  findings.add(check_budget(mission, package_bytes));
  return findings;
}

namespace {

constexpr int kMinBlock = 64;                   // quads per side that are searched together
constexpr int kMaxBlocks = 1000;                // per side
constexpr std::size_t kMaxGapSamples = 20'000;  // the search stops there
constexpr std::size_t kNamedGaps = 10;
constexpr double kMetresPerDegree = 111'320;

struct GapBlock {
  LonLat first;
  std::size_t samples = 0;
};

// Quad (c, r) is the ground between posts c, c + 1 and r, r + 1. Most have four known posts; for the others
// that touch the region, heights are sampled point by point.
class GapSearch {
 public:
  GapSearch(const Mission& mission, const TerrainRaster& terrain)
      : terrain_(terrain),
        grid_(terrain.grid()),
        frame_(mission_frame(mission)),
        region_(required_region(mission, frame_)) {
    for (const PlaneRing& ring : region_.rings) {
      outlines_.push_back(ring);
      outlines_.back().push_back(ring.front());
    }
    bounds_ = manifest_for(mission).bounds;
  }

  void run() {
    const int left = quad(grid_.column_of(bounds_.west_deg)), right = quad(grid_.column_of(bounds_.east_deg));
    const int top = quad(grid_.row_of(bounds_.north_deg)), bottom = quad(grid_.row_of(bounds_.south_deg));
    int block = kMinBlock;
    while (std::max(right - left, bottom - top) / block > kMaxBlocks) block *= 2;
    for (int row = top; row <= bottom; row += block) {
      for (int column = left; column <= right; column += block) {
        gaps_.push_back({});
        search(column, row, block);
        if (gaps_.back().samples == 0) gaps_.pop_back();
        if (samples_ >= kMaxGapSamples) {
          stopped_ = true;
          return;
        }
      }
    }
  }

  const std::vector<GapBlock>& gaps() const { return gaps_; }
  bool stopped() const { return stopped_; }
  double area_m2() const {
    const double height_m = grid_.lat_step_deg * kMetresPerDegree / kSamplesPerSide;
    const double width_m = grid_.lon_step_deg * kMetresPerDegree / kSamplesPerSide *
                           std::cos(radians((bounds_.south_deg + bounds_.north_deg) / 2));
    return static_cast<double>(samples_) * height_m * width_m;
  }

 private:
  static constexpr int kSamplesPerSide = 4;

  // Far outside the grid is as good as just outside; a region of a degree has at most some 10^7 quads a side.
  static int quad(double post) { return static_cast<int>(std::floor(std::clamp(post, -2e7, 4e7))); }

  PlanePoint plane(double column, double row) const { return frame_.plane_from_lonlat(grid_.place(column, row)); }

  bool touches(PlanePoint centre, double radius_m) const {
    return std::any_of(region_.rings.begin(), region_.rings.end(),
                       [&](const PlaneRing& ring) { return contains(ring, centre); }) ||
           std::any_of(outlines_.begin(), outlines_.end(),
                       [&](const PlanePath& path) { return distance_to_path_m(path, centre) <= radius_m; }) ||
           std::any_of(region_.corridors.begin(), region_.corridors.end(), [&](const Corridor& corridor) {
             return distance_to_path_m(corridor.path, centre) <= corridor.half_width_m + radius_m;
           });
  }

  void search(int column, int row, int size) {
    if (samples_ >= kMaxGapSamples || terrain_.known(column, row, column + size, row + size)) return;
    const PlanePoint centre = plane(column + size / 2.0, row + size / 2.0);
    const PlanePoint corner = plane(column, row), other = plane(column + size, row);
    // Longitudes and latitudes are not quite square in the plane: a little more than the half diagonal.
    if (!touches(centre, 1.02 * std::max(distance_m(corner, centre), distance_m(other, centre)))) return;
    if (size == 1) return sample(column, row);
    const int half = size / 2;
    search(column, row, half);
    search(column + half, row, half);
    search(column, row + half, half);
    search(column + half, row + half, half);
  }

  void sample(int column, int row) {
    for (int i = 0; i < kSamplesPerSide * kSamplesPerSide; ++i) {
      const double at_column = column + (i % kSamplesPerSide + 0.5) / kSamplesPerSide;
      const double at_row = row + (i / kSamplesPerSide + 0.5) / kSamplesPerSide;
      const LonLat place = grid_.place(at_column, at_row);
      if (terrain_.height_m(place) || !region_.contains(plane(at_column, at_row))) continue;
      if (gaps_.back().samples++ == 0) gaps_.back().first = place;
      ++samples_;
    }
  }

  const TerrainRaster& terrain_;
  const TerrainGrid& grid_;
  LocalFrame frame_;
  Region region_;
  std::vector<PlanePath> outlines_;
  LonLatBox bounds_;
  std::vector<GapBlock> gaps_;
  std::size_t samples_ = 0;
  bool stopped_ = false;
};

void check_terrain_gaps(const Mission& mission, const TerrainRaster& terrain, Findings& findings) {
  GapSearch search(mission, terrain);
  search.run();
  if (search.gaps().empty()) return;
  const TerrainGrid& grid = terrain.grid();
  findings.add({.code = "dem.gap",
                .where = std::string(kTerrainFile),
                .expected = "a height for every part of the sectors and of the corridor",
                .found = fmt::format("no height for {} {:.0f} m²; the model covers {:.6f},{:.6f} to {:.6f},{:.6f}",
                                     search.stopped() ? "more than" : "about", search.area_m2(), grid.west_deg,
                                     grid.south_deg(), grid.east_deg(), grid.north_deg),
                .fix = "build with an elevation model that covers the mission without gaps"});
  for (std::size_t i = 0; i < std::min(search.gaps().size(), kNamedGaps); ++i) {
    const LonLat at = search.gaps()[i].first;
    findings.add({.code = "dem.gap",
                  .where = fmt::format("near {:.6f},{:.6f}", at.lon_deg, at.lat_deg),
                  .expected = "a height",
                  .found = "none"});
  }
}

void check_terrain_heights(const TerrainRaster& terrain, Findings& findings) {
  std::size_t posts = 0, first = 0;
  const auto heights = terrain.heights_m();
  double lowest = 0, highest = 0;
  for (std::size_t i = 0; i < heights.size(); ++i) {
    const double height = static_cast<double>(heights[i]);
    if (std::isnan(height) || (height >= kLowestGround_m && height <= kHighestGround_m)) continue;
    if (posts++ == 0) first = i;
    lowest = std::min(lowest, height), highest = std::max(highest, height);
  }
  if (posts == 0) return;
  const auto columns = static_cast<std::size_t>(terrain.grid().columns);
  const LonLat at = terrain.grid().place(static_cast<double>(first % columns), static_cast<double>(first / columns));
  findings.add({.code = "dem.implausible",
                .where = fmt::format("{}, {}, for example at {:.6f},{:.6f}", kTerrainFile, count(posts, "post"),
                                     at.lon_deg, at.lat_deg),
                .expected = fmt::format("metres from {:.0f} to {:.0f}", kLowestGround_m, kHighestGround_m),
                .found = lowest < kLowestGround_m ? fmt::format("{}", lowest) : fmt::format("{}", highest),
                .fix = "declare the no-data value: gdal_translate -a_nodata VALUE; heights are in metres"});
}

}  // namespace

Findings check_terrain(const Mission& mission, const TerrainRaster& terrain) {
  Findings findings;
  check_terrain_gaps(mission, terrain, findings);
  check_terrain_heights(terrain, findings);
  return findings;
}

Findings check_terrain_presence(const Manifest& manifest, const Mission& mission) {
  Findings findings;
  const bool present = manifest.artifact(kRoleTerrain) != nullptr;
  if (!mission.terrain.flat && !present) {
    findings.add({.code = "dem.gap",
                  .where = "manifest.json /artifacts",
                  .expected = "an artifact of role \"terrain\", because the mission says terrain: {mode: dem}",
                  .found = "none",
                  .fix = "build the package with --dem"});
  }
  if (mission.terrain.flat && present) {
    findings.add({.code = "mission.mismatch",
                  .where = "manifest.json /artifacts",
                  .expected = "no terrain, because the mission says terrain: {mode: flat}",
                  .found = manifest.artifact(kRoleTerrain)->path,
                  .fix = "build the package again from its mission"});
  }
  return findings;
}

TerrainReading read_package_terrain(const Directory& package, const Manifest& manifest, const Mission& mission) {
  TerrainReading reading;
  const Artifact* artifact = manifest.artifact(kRoleTerrain);
  if (mission.terrain.flat || artifact == nullptr) return reading;
  try {
    const Bytes bytes = package.open(artifact->path).read(std::min(artifact->size, kMaxTerrainFile));
    if (const Sha256 digest = sha256(bytes); digest != artifact->sha256) {
      reading.findings.add({.code = "artifact.hash",
                            .where = artifact->path,
                            .expected = artifact->sha256.hex(),
                            .found = digest.hex(),
                            .fix = "get the package again from its producer"});
      return reading;
    }
    reading.terrain = parse_terrain_raster(bytes, artifact->path);
  } catch (const Error& error) {
    const ErrorText& text = error.text();
    reading.findings.add(
        {.code = "dem.corrupt",
         .where = artifact->path,
         .expected = text.expected.empty() ? "a terrain file as `nadir cache build` writes it" : text.expected,
         .found = text.found.empty() ? text.what : text.found,
         .fix = "build the package again"});
    return reading;
  }
  reading.findings = check_terrain(mission, *reading.terrain);
  if (reading.findings.has_errors()) reading.terrain.reset();
  return reading;
}

}  // namespace nadir
