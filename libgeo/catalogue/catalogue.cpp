#include "catalogue/catalogue.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <numeric>
#include <tuple>

#include "base/error.hpp"
#include "base/files.hpp"
#include "base/printable.hpp"
#include "catalogue/geometry.hpp"
#include "package/mission_check.hpp"

namespace nadir {
namespace {

using Insert = CatalogueDatabase::Insert;

// Tables whose rows belong to a package; the package itself is removed last.
constexpr const char* kOfPackages[] = {"gaps", "tiles", "required_tiles", "corridors", "routes", "sectors", "sources"};

void set_key(CatalogueRow& row, const TileKey& key) {
  row.set("z", std::int64_t{key.z}).set("x", std::int64_t{key.x}).set("y", std::int64_t{key.y});
}

void set_sector(CatalogueRow& row, const std::string& sector) {
  if (sector.empty()) {
    row.set_null("sector");
  } else {
    row.set("sector", sector);
  }
}

std::int64_t total_bytes(const Manifest& manifest) {
  return std::accumulate(
      manifest.artifacts.begin(), manifest.artifacts.end(), std::int64_t{0},
      [](std::int64_t sum, const Artifact& artifact) { return sum + static_cast<std::int64_t>(artifact.size); });
}

}  // namespace

Catalogue::Added Catalogue::add(const CatalogueEntry& entry, Progress& progress) {
  database_.begin();
  if (const auto known = find(entry.manifest.series, entry.manifest.sequence)) {
    database_.roll_back();
    return known->manifest_sha256 == entry.manifest_sha256.hex() ? Added::known : Added::conflict;
  }
  const std::int64_t package_id = add_package(entry);
  add_plan(entry, package_id);
  add_tiles(entry, package_id, progress);
  database_.commit();
  return Added::added;
}

std::int64_t Catalogue::add_package(const CatalogueEntry& entry) {
  const Manifest& manifest = entry.manifest;
  const Artifact* imagery = manifest.artifact(kRoleImagery);
  const bool has_tiles = imagery != nullptr && imagery->tiles.has_value();
  CatalogueRow row = database_.new_row("packages");
  row.set("series", manifest.series)
      .set("sequence", manifest.sequence)
      .set("mission", manifest.mission_id)
      .set("created", manifest.created)
      .set("expires", manifest.expires)
      .set("airframes", fmt::format("{}", fmt::join(manifest.airframes, " ")))
      .set("manifest_sha256", entry.manifest_sha256.hex())
      .set("merkle_root", has_tiles ? imagery->tiles->merkle_root.hex() : std::string())
      .set("min_zoom", std::int64_t{entry.mission.zoom.min})
      .set("max_zoom", std::int64_t{entry.mission.zoom.max})
      .set("tiles", static_cast<std::int64_t>(entry.tiles.size()))
      .set("bytes", total_bytes(manifest))
      .shape(area_geometry(mission_area(entry.mission)));
  if (entry.signers) {
    row.set("signers", fmt::format("{}", fmt::join(*entry.signers, " ")));
  } else {
    row.set_null("signers");
  }
  return database_.insert("packages", row, Insert::one);
}

void Catalogue::add_route(const Mission& mission, std::int64_t package_id) {
  CatalogueRow route = database_.new_row("routes");
  route.set("package_id", package_id)
      .set("agl_m", mission.route.agl_m)
      .set("length_m", length_m(to_plane(mission_frame(mission), mission.route.points)))
      .shape(line_geometry(mission.route.points));
  database_.insert("routes", route, Insert::one);
  CatalogueRow corridor = database_.new_row("corridors");
  corridor.set("package_id", package_id)
      .set("half_width_m", mission.route.corridor_half_width_m)
      .set("freshness_days", std::int64_t{mission.freshness_days.active})
      .shape(polygon_geometry(corridor_area(mission)));
  database_.insert("corridors", corridor, Insert::one);
}

void Catalogue::add_plan(const CatalogueEntry& entry, std::int64_t package_id) {
  const Mission& mission = entry.mission;
  for (const Sector& sector : mission.sectors) {
    CatalogueRow row = database_.new_row("sectors");
    row.set("package_id", package_id)
        .set("sector", sector.id)
        .set("class", name_of(sector.cls))
        .set("freshness_days", std::int64_t{mission.freshness_days.of(sector.cls)})
        .shape(polygon_geometry(sector_area(mission, sector)));
    database_.insert("sectors", row, Insert::one);
  }
  if (!mission.route.points.empty()) add_route(mission, package_id);
  for (const CatalogueSource& source : sources_of(entry.tiles)) {
    CatalogueRow row = database_.new_row("sources");
    row.set("package_id", package_id)
        .set("provider", source.provider)
        .set("captured_at", source.captured_at)
        .set("gsd_mm", source.gsd_mm)
        .set("ce90_mm", source.ce90_mm)
        .set("trust", name_of(source.trust))
        .set("zoom", std::int64_t{source.zoom})
        .set("tiles", source.tiles)
        .shape(area_geometry(source.footprint));
    database_.insert("sources", row, Insert::one);
  }
  for (const CatalogueGap& gap : gaps_of_package(mission, entry.tiles)) {
    add_gap(gap, package_id, mission.id, mission.created);
  }
}

void Catalogue::add_tiles(const CatalogueEntry& entry, std::int64_t package_id, Progress& progress) {
  std::vector<TileKey> required;
  for (int zoom = entry.mission.zoom.min; zoom <= entry.mission.zoom.max; ++zoom) {
    const std::vector<TileKey> keys = required_tiles(entry.mission, zoom);
    required.insert(required.end(), keys.begin(), keys.end());
  }
  progress.begin("cataloguing tiles", required.size() + entry.tiles.size(), "rows");
  for (const TileKey& key : required) {
    CatalogueRow row = database_.new_row("required_tiles");
    row.set("package_id", package_id).shape(polygon_geometry(area_of(key)));
    set_key(row, key);
    database_.insert("required_tiles", row, Insert::bulk);
    progress.advance();
  }
  database_.finish_bulk("required_tiles");
  for (const Sidecar& tile : entry.tiles) {
    CatalogueRow row = database_.new_row("tiles");
    row.set("package_id", package_id)
        .set("sha256", tile.sha256.hex())
        .set("source", tile.source)
        .set("captured_at", tile.captured_at)
        .set("gsd_mm", tile.gsd_mm)
        .set("ce90_mm", tile.ce90_mm)
        .set("trust", name_of(tile.trust))
        .set("valid_ppm", tile.valid_ppm)
        .shape(polygon_geometry(area_of(tile.key)));
    set_key(row, tile.key);
    set_sector(row, tile.sector);
    database_.insert("tiles", row, Insert::bulk);
    progress.advance();
  }
  database_.finish_bulk("tiles");
  progress.end();
  expect_count("required_tiles", package_id, required.size());
  expect_count("tiles", package_id, entry.tiles.size());
}

// A server may end a transaction by itself: verify the number of rows.
void Catalogue::expect_count(const char* table, std::int64_t package_id, std::size_t count) {
  const std::int64_t found = database_.count(table, package_id);
  if (found != static_cast<std::int64_t>(count)) {
    throw Error({.what = "the database did not store all rows",
                 .where = table,
                 .expected = std::to_string(count),
                 .found = std::to_string(found),
                 .fix = "nothing was stored; run the command again"});
  }
}

void Catalogue::add_gap(const CatalogueGap& gap, std::optional<std::int64_t> package_id, const std::string& mission,
                        UtcTime evaluated_at) {
  CatalogueRow row = database_.new_row("gaps");
  if (package_id) {
    row.set("package_id", *package_id);
  } else {
    row.set_null("package_id");
  }
  row.set("mission", mission)
      .set("judged_at", evaluated_at)
      .set("reason", gap.reason)
      .set("area_m2", gap.area_m2)
      .shape(area_geometry(gap.outline));
  set_key(row, gap.key);
  set_sector(row, gap.sector);
  database_.insert("gaps", row, Insert::one);
}

std::vector<CataloguedPackage> Catalogue::packages() {
  std::vector<CataloguedPackage> packages;
  database_.each("packages", [&packages](const CatalogueRow& row) {
    packages.push_back({.id = row.integer("id"),
                        .series = row.text("series"),
                        .sequence = row.integer("sequence"),
                        .mission = row.text("mission"),
                        .created = row.time("created").value_or(UtcTime()),
                        .expires = row.time("expires").value_or(UtcTime()),
                        .manifest_sha256 = row.text("manifest_sha256"),
                        .signers = row.text("signers"),
                        .tiles = row.integer("tiles"),
                        .bytes = row.integer("bytes")});
  });
  std::sort(packages.begin(), packages.end(), [](const CataloguedPackage& a, const CataloguedPackage& b) {
    return std::tie(a.series, a.sequence) < std::tie(b.series, b.sequence);
  });
  return packages;
}

std::optional<CataloguedPackage> Catalogue::find(const std::string& series, std::int64_t sequence) {
  for (CataloguedPackage& package : packages()) {
    if (package.series == printable(series) && package.sequence == sequence) return std::move(package);
  }
  return std::nullopt;
}

std::vector<CatalogueSource> Catalogue::sources() {
  std::vector<CatalogueSource> sources;
  database_.each("sources", [&sources](const CatalogueRow& row) {
    const auto captured_at = row.time("captured_at");
    if (!captured_at) return;  // unknown age: unusable
    sources.push_back({.package_id = row.integer("package_id"),
                       .provider = row.text("provider"),
                       .captured_at = *captured_at,
                       .gsd_mm = row.integer("gsd_mm"),
                       .ce90_mm = row.integer("ce90_mm"),
                       .trust = parse_tile_trust(row.text("trust")).value_or(TileTrust::soft),
                       .zoom = static_cast<int>(row.integer("zoom")),
                       .tiles = row.integer("tiles"),
                       .footprint = row.area()});
  });
  return sources;
}

bool Catalogue::remove(const std::string& series, std::int64_t sequence) {
  database_.begin();
  const auto known = find(series, sequence);
  if (!known) {
    database_.roll_back();
    return false;
  }
  for (const char* table : kOfPackages) database_.erase(table, "package_id", known->id);
  database_.erase("packages", "id", known->id);
  database_.commit();
  return true;
}

void Catalogue::store_gaps(const std::string& mission, UtcTime evaluated_at, const std::vector<CatalogueGap>& gaps) {
  database_.begin();
  std::vector<std::int64_t> before;
  database_.each("gaps", [&](const CatalogueRow& row) {
    if (row.is_null("package_id") && row.text("mission") == mission) before.push_back(row.integer("id"));
  });
  for (const std::int64_t id : before) database_.erase("gaps", "id", id);
  for (const CatalogueGap& gap : gaps) add_gap(gap, std::nullopt, mission, evaluated_at);
  database_.commit();
}

namespace {

void check_mission_file(const Directory& package, const Manifest& manifest, CatalogueReading& reading,
                        std::optional<Mission>& mission) {
  const Artifact* artifact = manifest.artifact(kRoleMission);
  const std::optional<InputFile> file = package.find(kMissionFile);
  if (artifact == nullptr || artifact->path != kMissionFile || !file) {
    reading.findings.add({.code = "artifact.missing",
                          .where = std::string(kMissionFile),
                          .expected = "the mission of the package",
                          .found = "none",
                          .fix = "build the package again"});
    return;
  }
  const Bytes text = file->read(std::uint64_t{1} << 20);
  if (sha256(text) != artifact->sha256) {
    reading.findings.add({.code = "artifact.hash",
                          .where = std::string(kMissionFile),
                          .expected = "the digest in the manifest",
                          .found = "different bytes",
                          .fix = "get the package again from its source"});
    return;
  }
  MissionReading checked = parse_mission(as_text(text), kMissionFile);
  reading.findings.add(checked.findings);
  mission = std::move(checked.mission);
}

CatalogueReading read_unverified(const std::filesystem::path& package, Progress& progress) {
  CatalogueReading reading;
  const Directory folder(package);
  ManifestReading manifest = parse_manifest(folder.open(kManifestFile).read(kMaxManifestSize));
  reading.findings.add(manifest.findings);
  if (!manifest.manifest) return reading;
  std::optional<Mission> mission;
  check_mission_file(folder, *manifest.manifest, reading, mission);
  const Artifact* imagery = manifest.manifest->artifact(kRoleImagery);
  if (imagery == nullptr || !imagery->tiles) {
    reading.findings.add({.code = "artifact.missing",
                          .where = std::string(kManifestFile),
                          .expected = "an artifact of role \"imagery\" with \"tiles\"",
                          .found = "none"});
    return reading;
  }
  TileSetFiles files{folder.open(imagery->path), std::nullopt};
  if (const Artifact* sidecars = manifest.manifest->artifact(kRoleSidecars); sidecars != nullptr) {
    files.sidecars = folder.find(sidecars->path);
  }
  TileSetCheck check = check_tile_set(std::move(files), *imagery->tiles, VerifyDepth::quick, progress);
  reading.findings.add(check.findings);
  if (reading.findings.has_errors() || !mission) return reading;
  reading.entry = CatalogueEntry{std::move(*manifest.manifest), {}, std::move(*mission), std::move(check.sidecars), {}};
  return reading;
}

CatalogueReading read_verified(const std::filesystem::path& package, const VerifyOptions& options, Progress& progress) {
  Verification verification = verify_package(package, options, progress);
  CatalogueReading reading{verification.findings, std::nullopt};
  if (!verification.accepted() || !verification.mission) return reading;
  reading.entry = CatalogueEntry{std::move(*verification.manifest),
                                 {},
                                 std::move(*verification.mission),
                                 std::move(verification.tiles),
                                 std::move(verification.signers)};
  return reading;
}

}  // namespace

CatalogueReading read_catalogue_entry(const std::filesystem::path& package, const VerifyOptions* options,
                                      Progress& progress) {
  if (!std::filesystem::is_directory(package)) {
    throw UsageError({.what = "package not found",
                      .where = package.string(),
                      .expected = "the folder of a package",
                      .found = std::filesystem::exists(package) ? "a file" : "nothing"});
  }
  CatalogueReading reading =
      options != nullptr ? read_verified(package, *options, progress) : read_unverified(package, progress);
  if (reading.entry) reading.entry->manifest_sha256 = sha256_file(package / kManifestFile);
  return reading;
}

}  // namespace nadir
