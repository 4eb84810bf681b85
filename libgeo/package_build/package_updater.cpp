#include "package_build/package_updater.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>

#include "base/error.hpp"
#include "base/files.hpp"
#include "geodesy/angles.hpp"
#include "raster/open_imagery.hpp"
#include "package_build/package_parts.hpp"
#include "package_build/update_old_package.hpp"
#include "package_build/update_place_index.hpp"
#include "package_build/update_tile_set.hpp"
#include "imagery/lossless_webp.hpp"
#include "package/mission_check.hpp"
#include "package/tile_container.hpp"

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

void tell_what_stays_behind(const UpdateRequest& request, const OldPackage& old, const TrustRoot& newest) {
  if (!request.index && old.manifest->artifact(kRolePlaceTable) != nullptr) {
    request.tell(
        "the place index is not carried over, because it belongs to the old tiles: give --index, or make it "
        "afterwards with `nadir cache index`");
  }
  for (const Artifact& artifact : old.manifest->artifacts) {
    constexpr std::array kKnown{kRoleImagery, kRoleSidecars,   kRoleMission,
                                kRoleTerrain, kRolePlaceIndex, kRolePlaceTable};
    if (std::find(kKnown.begin(), kKnown.end(), artifact.role) != kKnown.end()) continue;
    request.tell(fmt::format("{} is not carried over: it has to be made anew for the new tiles", artifact.path));
  }
  if (request.key == nullptr) return;
  const std::string id = request.key->public_key().id();
  if (newest.package_signer.key_ids.contains(id) && !newest.revoked.contains(id)) return;
  request.tell(fmt::format("root version {} does not let key {} sign packages: aircraft will refuse this one",
                           newest.version, id));
}

// Tiles are copied, so what is encoded anew has to be like them.
TileSetOptions options_after(const UpdateRequest& request, const Artifact& imagery, const std::vector<Sidecar>& tiles) {
  const auto format = parse_image_format(imagery.tiles->format);
  if (!format) {
    throw Error({.what = "unknown tile format", .where = request.old_package, .found = imagery.tiles->format});
  }
  TileSetOptions options = request.tiles;
  options.container = request.container.value_or(imagery.path == kCogFile ? TileSetKind::cog : TileSetKind::mbtiles);
  options.encoding.format = *format;
  if (*format == ImageFormat::webp && !tiles.empty()) {
    const std::unique_ptr<TileSource> source = open_tile_source(request.old_package / imagery.path);
    options.encoding.lossless = is_lossless_webp(source->read(tiles.back().key).value_or(Bytes{}));
  }
  if (*format == ImageFormat::png && options.container == TileSetKind::cog) {
    throw UsageError({.what = "PNG tiles cannot be put into a COG as they are",
                      .where = request.old_package,
                      .expected = "JPEG or WebP tiles, because TIFF knows no PNG",
                      .found = "png",
                      .fix = "leave --format away, or build anew: nadir cache build --format cog --tile-format png"});
  }
  return options;
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
  const TileSetOptions options = options_after(request, imagery, old.tiles);
  std::optional<PlaceTable> old_index;
  if (request.index) old_index = old_place_table(request.old_package, *old.manifest);
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
  const fs::path file = folder / file_of(options.container);
  fs::create_directories(file.parent_path());
  const UpdatedTileSet updated = update_tile_set(mission, map, layers, range, options, file, progress);
  findings.add(map.findings());
  if (updated.set.over_budget) findings.add(check_budget(mission, updated.set.tile_bytes));
  if (findings.refuses()) return report;

  std::optional<PlaceIndex> index;
  if (old_index) {
    index = remake_place_index(*old_index, file, updated.set, mission.takeoff, options.threads, progress);
  }
  progress.begin("completing the package", 3, "steps");
  complete_package(folder,
                   {mission, mission_text, updated.set.facts, terrain, roots, request.key, index ? &*index : nullptr},
                   progress);
  report.counts = updated.counts;
  report.package.tiles = updated.set.facts.count;
  report.package.merkle_root = updated.set.facts.merkle_root;
  report.package.bytes = package_size(folder);
  if (terrain) report.package.terrain = terrain->grid();
  findings.add(check_tile_requirements(mission, updated.set.sidecars, report.package.bytes, at));
  if (!findings.refuses()) {
    progress.advance();  // the last moment to be interrupted
    staging.commit();
  }
  progress.end();
  return report;
}

}  // namespace nadir
