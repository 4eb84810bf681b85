#include "ground/package_updater.hpp"

#include <fmt/format.h>

#include <cmath>

#include "base/error.hpp"
#include "base/files.hpp"
#include "geodesy/angles.hpp"
#include "ground/open_imagery.hpp"
#include "ground/package_parts.hpp"
#include "ground/update_old_package.hpp"
#include "ground/update_tile_set.hpp"
#include "package/judge.hpp"

namespace nadir {
namespace {

namespace fs = std::filesystem;

// The old tiles of the finest zoom as one more raster, for plan_range() alone. Half a pixel inside, so that rounding
// does not reach for the next tile.
ImageryInput extent_of(const std::vector<Sidecar>& tiles) {
  ImageryInput extent;
  const int zoom = tiles.back().key.z;
  const double pixel_m = mercator_pixel_m(zoom), half_world_m = kPi * kMercatorRadius_m;
  std::uint32_t left = ~0U, top = ~0U, right = 0, bottom = 0;
  for (const Sidecar& tile : tiles) {
    if (tile.key.z != zoom) continue;
    left = std::min(left, tile.key.x), right = std::max(right, tile.key.x + 1);
    top = std::min(top, tile.key.y), bottom = std::max(bottom, tile.key.y + 1);
  }
  for (const double x : {left * double{kTileSize} + 0.5, right * double{kTileSize} - 0.5}) {
    for (const double y : {top * double{kTileSize} + 0.5, bottom * double{kTileSize} - 0.5}) {
      extent.outline.push_back({x * pixel_m - half_world_m, half_world_m - y * pixel_m});
    }
  }
  return extent;
}

TileRange range_of(const Mission& mission, std::vector<ImageryInput> rasters, const std::vector<Sidecar>& tiles) {
  rasters.push_back(extent_of(tiles));
  return plan_range(mission, rasters);
}

ImageFormat format_of(const fs::path& package, const Artifact& imagery) {
  if (!imagery.path.ends_with(".mbtiles")) {
    throw UsageError({.what = "only packages with tiles in MBTiles are updated",
                      .where = package,
                      .expected = std::string(kImageryFile),
                      .found = imagery.path,
                      .fix = "build the package anew with `nadir cache build --format cog`"});
  }
  const auto format = parse_image_format(imagery.tiles->format);
  if (!format) throw Error({.what = "unknown tile format", .where = package, .found = imagery.tiles->format});
  return *format;
}

void tell_what_stays_behind(const UpdateRequest& request, const OldPackage& old, const TrustRoot& newest) {
  for (const Artifact& artifact : old.manifest->artifacts) {
    if (artifact.role == kRoleImagery || artifact.role == kRoleMission || artifact.role == kRoleTerrain) continue;
    request.tell(fmt::format("{} is not carried over: it has to be made anew for the new tiles", artifact.path));
  }
  if (request.key == nullptr) return;
  const std::string id = request.key->public_key().id();
  if (newest.package_signer.key_ids.contains(id) && !newest.revoked.contains(id)) return;
  request.tell(fmt::format("root version {} does not let key {} sign packages: aircraft will refuse this one",
                           newest.version, id));
}

TrustRoot newest_of(const RootChain& roots, const TrustRoot& known) {
  if (roots.empty() || roots.rbegin()->first <= known.version) return known;
  return parse_root(roots.rbegin()->second, "the newest carried root").root;
}

}  // namespace

UpdateReport update_package(const UpdateRequest& request, Progress& progress) {
  const std::string mission_text = read_text_file(request.mission, std::uint64_t{1} << 20);
  const Mission mission = parse_mission_or_throw(mission_text, request.mission);
  check_zoom(mission, request.mission);
  check_terrain_wanted(mission, request.mission, request.dem);
  const UtcTime at = request.at.value_or(mission.created);

  UpdateReport report;
  report.package.zoom = mission.zoom;
  report.sequence = mission.sequence;
  Findings& findings = report.package.findings;
  OldPackage old = read_old_package(request.old_package, *request.trust, at, progress);
  findings = old.findings;
  if (findings.refuses()) return report;
  report.old_sequence = old.manifest->sequence;
  findings.add(judge_succession(*old.manifest, mission, request.mission));
  findings.add(judge_date(mission, at));
  std::optional<fs::path> dem = request.dem;
  if (!dem && !mission.terrain.flat) dem = old_terrain(request.old_package, *old.manifest, findings);
  if (findings.refuses()) return report;
  const Artifact& imagery = *old.manifest->artifact(kRoleImagery);
  TileSetOptions options = request.tiles;
  options.encoding.format = format_of(request.old_package, imagery);
  const std::vector<ImageryInput> rasters = open_imagery(request.imagery, request.overrides, request.stretches);
  const RootChain roots = read_root_chain(request.roots, old.roots, request.trust);
  const std::optional<TerrainRaster> terrain = prepare_terrain(mission, request.mission, dem, findings);
  if (findings.refuses()) return report;
  tell_what_stays_behind(request, old, newest_of(roots, old.newest_root));

  const TileRange range = range_of(mission, rasters, old.tiles);
  const OldMap map(request.old_package / imagery.path, std::move(old.tiles), mission);
  const UpdateLayers layers(rasters, map, options.mosaic.order);
  StagingDirectory staging(request.out);
  const fs::path& folder = staging.path();
  fs::create_directories(folder / fs::path(kImageryFile).parent_path());
  const UpdatedTileSet updated = update_tile_set(mission, map, layers, range, options, folder / kImageryFile, progress);
  findings.add(map.findings());
  if (updated.set.over_budget) findings.add(judge_budget(mission, updated.set.tile_bytes));
  if (findings.refuses()) return report;

  progress.begin("completing the package", 3, "steps");
  complete_package(folder, {mission, mission_text, updated.set.facts, terrain, roots, request.key}, progress);
  report.counts = updated.counts;
  report.package.tiles = updated.set.facts.count;
  report.package.merkle_root = updated.set.facts.merkle_root;
  report.package.bytes = package_size(folder);
  if (terrain) report.package.terrain = terrain->grid();
  findings.add(judge_tiles(mission, updated.set.sidecars, report.package.bytes, at));
  if (!findings.refuses()) {
    progress.advance();  // the last moment to be interrupted
    staging.commit();
  }
  progress.end();
  return report;
}

}  // namespace nadir
