#include "package_build/package_updater.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>

#include "base/digest.hpp"
#include "base/error.hpp"
#include "base/files.hpp"
#include "geodesy/angles.hpp"
#include "imagery/codecs.hpp"
#include "package/mission_check.hpp"
#include "package/package_roots.hpp"
#include "package/tile_container.hpp"
#include "package/vector_layer.hpp"
#include "package/verify.hpp"
#include "package_build/pinned_file.hpp"
#include "vision/place_index.hpp"
#include "vision/place_index_builder.hpp"

namespace nadir {
namespace {

namespace fs = std::filesystem;

// The package that an update begins with.
struct OldPackage {
  Findings findings;  // those of verify_package() that question its authenticity
  std::optional<Manifest> manifest;
  std::vector<Sidecar> tiles;  // in the order of TileKey
  TrustRoot newest_root;       // the newest that the carried roots lead to
  RootChain roots;             // that it carries
};

// Findings that concern only whether the old package may still fly.
constexpr std::array<std::string_view, 9> kIgnoredFindings = {
    "package.expired", "time.untrusted",    "freshness.stale", "coverage.gap",   "resolution.coarse",
    "budget.exceeded", "airframe.mismatch", "dem.gap",         "dem.implausible"};

// Quick depth: tiles are hashed when they are copied. at: when keys and roots must be valid.
OldPackage read_old_package(const fs::path& package, const TrustRoot& trusted, UtcTime at, Progress& progress) {
  const Verification verification = verify_package(package,
                                                   {.root = &trusted,
                                                    .depth = VerifyDepth::quick,
                                                    .at = at,
                                                    .airframe = std::nullopt,
                                                    .state = nullptr,
                                                    .permit = nullptr},
                                                   progress);
  OldPackage old;
  for (Finding finding : verification.findings.items()) {
    if (std::find(kIgnoredFindings.begin(), kIgnoredFindings.end(), finding.code) != kIgnoredFindings.end()) continue;
    finding.where = fmt::format("{}: {}", package.string(), finding.where);
    old.findings.add(std::move(finding));
  }
  old.manifest = verification.manifest;
  old.tiles = verification.tiles;
  old.newest_root = walk_package_roots(*verification.folder, trusted, nullptr, at).root;
  old.roots = roots_in_package(*verification.folder);
  return old;
}

// mission.mismatch for another series or other zooms, package.rollback for a sequence that is not higher.
Findings check_succession(const Manifest& old, const Mission& mission, const fs::path& mission_file) {
  Findings findings;
  if (old.series != mission.series) {
    findings.add({.code = "mission.mismatch",
                  .where = mission_file.string() + " (series)",
                  .expected = fmt::format("{}, that of the package", old.series),
                  .found = mission.series,
                  .fix = "build the first package of a series with `nadir cache build`"});
  } else if (mission.sequence <= old.sequence) {
    findings.add({.code = "package.rollback",
                  .where = mission_file.string() + " (sequence)",
                  .expected = fmt::format("{} or more, because the package has {}", old.sequence + 1, old.sequence),
                  .found = std::to_string(mission.sequence),
                  .fix = "give the mission the next sequence: aircraft reject a lower one"});
  }
  const Artifact* imagery = old.artifact(kRoleImagery);
  if (imagery == nullptr || !imagery->tiles) return findings;
  const ZoomRange zoom = imagery->tiles->zoom;
  if (zoom.min != mission.zoom.min || zoom.max != mission.zoom.max) {
    findings.add({.code = "mission.mismatch",
                  .where = mission_file.string() + " (zoom)",
                  .expected = fmt::format("{} to {}, those of the package", zoom.min, zoom.max),
                  .found = fmt::format("{} to {}", mission.zoom.min, mission.zoom.max),
                  .fix = "changing the zooms requires a full build: `nadir cache build`"});
  }
  return findings;
}

// The terrain of the old package, compared with its signed digest; none when it has none. Adds artifact.hash.
std::vector<fs::path> old_terrain(const fs::path& package, const Manifest& manifest, Findings& findings) {
  const Artifact* terrain = manifest.artifact(kRoleTerrain);
  if (terrain == nullptr) return {};
  if (sha256_file(package / terrain->path) == terrain->sha256) return {package / terrain->path};
  findings.add({.code = "artifact.hash",
                .where = fmt::format("{}: {}", package.string(), terrain->path),
                .expected = terrain->sha256.hex(),
                .found = "different bytes",
                .fix = "get the package again from its source, or pass an elevation model with --dem"});
  return {};
}

// The vectors of the old package as they are, compared with their signed digest; none when it has none. Adds
// artifact.hash.
std::optional<PackageVectors> old_vectors(const fs::path& package, const Manifest& manifest, Findings& findings) {
  const Artifact* artifact = manifest.artifact(kRoleVectors);
  if (artifact == nullptr || !artifact->vectors) return std::nullopt;
  const Bytes bytes = read_file(package / artifact->path, kMaxVectors_bytes);
  if (sha256(bytes) == artifact->sha256) return PackageVectors{std::string(as_text(bytes)), *artifact->vectors};
  findings.add({.code = "artifact.hash",
                .where = fmt::format("{}: {}", package.string(), artifact->path),
                .expected = artifact->sha256.hex(),
                .found = "different bytes",
                .fix = "get the package again from its source, or pass a file with --vectors"});
  return std::nullopt;
}

// How the old place index was made. Throws UsageError when there is none, Error when its bytes are not the signed ones.
PlaceTable previous_place_table(const fs::path& package, const Manifest& manifest) {
  if (const std::optional<PlaceIndex> index = PlaceIndex::open(Directory(package), manifest)) return index->table();
  throw UsageError({.what = "the old package has no place index to rebuild",
                    .where = package,
                    .expected = std::string(kPlaceTableFile),
                    .found = "none",
                    .fix = "omit --index, and make one afterwards: nadir cache index NEW --camera FILE.yaml"});
}

// The place index for the new tiles: windows of the same sizes, resolution and overlap. The old descriptors belong to
// the old tiles. tiles: the new file, closed. origin: of the new mission's local frame.
PlaceIndex rebuild_place_index(const PlaceTable& old, const fs::path& tiles, const TileSet& set, LonLat origin,
                               int threads, Progress& progress) {
  PlaceIndexOptions options;
  options.overlap_percent = static_cast<int>(old.overlap_percent);
  options.threads = threads;
  for (const PlaceLayer& layer : old.layers) {
    options.footprints_m.push_back(layer.side_m());
    options.sides_px.push_back(layer.side_px);
  }
  const std::unique_ptr<TileSource> source = open_tile_source(tiles);
  IndexedMap map{source.get(), {}, set.facts.merkle_root, origin};
  for (const Sidecar& sidecar : set.sidecars) {
    if (sidecar.key.z == set.facts.zoom.max) map.keys.push_back(sidecar.key);
  }
  return build_place_index(map, options, progress);
}

// The old tiles of the finest zoom as one more raster, only for plan_range(). Half a pixel inside, so that rounding
// does not reach the next tile.
ImageryInput extent_of(const std::vector<Sidecar>& tiles) {
  ImageryInput extent;
  const int zoom = tiles.back().key.z;
  const double pixel_m = mercator_pixel_m(zoom), half_world_m = kMercatorHalfWorld_m;
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

void report_dropped_artifacts(const UpdateRequest& request, const OldPackage& old, const TrustRoot& newest) {
  if (!request.index && old.manifest->artifact(kRolePlaceTable) != nullptr) {
    request.on_remark(
        "the place index is not carried over, because it belongs to the old tiles: pass --index, or make one "
        "afterwards with `nadir cache index`");
  }
  for (const Artifact& artifact : old.manifest->artifacts) {
    constexpr std::array kKnown{kRoleImagery, kRoleSidecars,   kRoleMission,   kRoleTerrain,
                                kRoleVectors, kRolePlaceIndex, kRolePlaceTable};
    if (std::find(kKnown.begin(), kKnown.end(), artifact.role) != kKnown.end()) continue;
    request.on_remark(fmt::format("{} is not carried over: it must be made again for the new tiles", artifact.path));
  }
  if (request.key == nullptr) return;
  const std::string id = request.key->public_key().id();
  if (newest.package_signer.key_ids.contains(id) && !newest.revoked.contains(id)) return;
  request.on_remark(fmt::format("root version {} does not allow key {} to sign packages: aircraft will reject this one",
                                newest.version, id));
}

// Tiles are copied, so re-encoded tiles must use the same encoding.
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
                      .fix = "omit --format, or build again: nadir cache build --format cog --tile-format png"});
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
  if (findings.has_errors()) return report;
  report.old_sequence = old.manifest->sequence;
  findings.add(check_succession(*old.manifest, mission, request.mission));
  findings.add(check_expiry(mission, at));
  std::vector<fs::path> dem = request.dem;
  pin_rasters(dem);  // throws when one is not what its list states
  if (dem.empty() && !mission.terrain.flat) dem = old_terrain(request.old_package, *old.manifest, findings);
  if (findings.has_errors()) return report;
  const Artifact& imagery = *old.manifest->artifact(kRoleImagery);
  const TileSetOptions options = options_after(request, imagery, old.tiles);
  std::optional<PlaceTable> old_index;
  if (request.index) old_index = previous_place_table(request.old_package, *old.manifest);
  const std::vector<ImageryInput> rasters = open_imagery(request.imagery, request.overrides, request.stretches);
  for (const ImageryInput& raster : rasters) {
    if (raster.stated_sha256) pin_raster(raster.path, raster.stated_sha256);  // throws when it is another
  }
  findings.add(check_stated_places(rasters));
  findings.add(check_stated_licences(rasters));
  const RootChain roots = read_root_chain(request.roots, at, old.roots, request.trust);
  const std::optional<TerrainRaster> terrain = prepare_terrain(mission, request.mission, dem, findings);
  const std::optional<PackageVectors> vectors = request.vectors
                                                    ? cut_vectors(*request.vectors, mission, findings)
                                                    : old_vectors(request.old_package, *old.manifest, findings);
  if (findings.has_errors()) return report;
  report_dropped_artifacts(request, old, newest_of(roots, old.newest_root));

  const TileRange range = range_of(mission, rasters, old.tiles);
  StagingDirectory staging(request.out);
  const fs::path& folder = staging.path();
  const fs::path file = folder / file_of(options.container);
  fs::create_directories(file.parent_path());
  UpdatedTileSet updated = update_tile_set(mission, {request.old_package / imagery.path, std::move(old.tiles)}, rasters,
                                           range, options, file, progress);
  updated.set.facts.sources = stated_sources(updated.set.sidecars, rasters, imagery.tiles->sources);
  findings.add(updated.findings);
  if (updated.set.over_budget) findings.add(check_budget(mission, updated.set.tile_bytes));
  if (findings.has_errors()) return report;

  std::optional<PlaceIndex> index;
  if (old_index) {
    index = rebuild_place_index(*old_index, file, updated.set, mission.takeoff, options.threads, progress);
  }
  progress.begin("completing the package", 3, "steps");
  complete_package(folder,
                   {.mission = mission,
                    .mission_text = mission_text,
                    .tiles = updated.set.facts,
                    .terrain = terrain,
                    .roots = roots,
                    .key = request.key,
                    .index = index ? &*index : nullptr,
                    .vectors = vectors ? &*vectors : nullptr},
                   progress);
  report.counts = updated.counts;
  report.package.tiles = updated.set.facts.count;
  report.package.merkle_root = updated.set.facts.merkle_root;
  report.package.bytes = package_size(folder);
  if (terrain) report.package.terrain = terrain->grid();
  if (vectors) report.package.vectors = vectors->facts;
  findings.add(check_tile_requirements(mission, updated.set.sidecars, report.package.bytes, at));
  if (!findings.has_errors()) {
    progress.advance();  // the last point of interruption
    staging.commit();
  }
  progress.end();
  return report;
}

}  // namespace nadir
