#include "package/open_package.hpp"

#include <algorithm>

#include "base/error.hpp"
#include "base/files.hpp"
#include "package/mission_check.hpp"
#include "package/tile_container.hpp"
#include "package/vector_layer.hpp"

namespace nadir {
namespace {

constexpr std::size_t kMaxFindings = 1000;  // a flight is long and a damaged medium gives many

}  // namespace

CheckedTiles::CheckedTiles(InputFile tiles, std::vector<Sidecar> sidecars)
    : reader_(open_tile_source(std::move(tiles), TileSetRules::of_package(sidecars.size()))),
      sidecars_(std::move(sidecars)) {}

ZoomRange CheckedTiles::zooms() const {
  return sidecars_.empty() ? ZoomRange{} : ZoomRange{sidecars_.front().key.z, sidecars_.back().key.z};
}

const Sidecar* CheckedTiles::sidecar(const TileKey& key) const {
  const auto found = std::lower_bound(sidecars_.begin(), sidecars_.end(), key,
                                      [](const Sidecar& tile, const TileKey& wanted) { return tile.key < wanted; });
  return found != sidecars_.end() && found->key == key ? &*found : nullptr;
}

std::optional<Bytes> CheckedTiles::read(const TileKey& key) const {
  const Sidecar* signed_tile = sidecar(key);
  if (signed_tile == nullptr) return std::nullopt;
  try {
    auto bytes = reader_->read(key);
    if (bytes && sha256(*bytes) == signed_tile->sha256) return bytes;
    report("artifact.hash", key, bytes ? "bytes that differ from the signed ones" : "no tile");
  } catch (const Error& error) {
    const Finding fault = tile_set_finding(error, {});
    report(fault.code.c_str(), key, fault.found);
  }
  return std::nullopt;
}

std::optional<Bytes> CheckedTiles::read_mask(const TileKey& key) const {
  const Sidecar* signed_tile = sidecar(key);
  if (signed_tile == nullptr || signed_tile->mask.empty()) return std::nullopt;
  return signed_tile->mask;
}

std::optional<double> CheckedTiles::ce90_m(const TileKey& key) const {
  const Sidecar* signed_tile = sidecar(key);
  if (signed_tile == nullptr) return std::nullopt;
  return static_cast<double>(signed_tile->ce90_mm) / 1000;
}

Findings CheckedTiles::findings() const {
  const std::lock_guard lock(mutex_);
  return findings_;
}

void CheckedTiles::report(const char* code, const TileKey& key, std::string found) const {
  const std::lock_guard lock(mutex_);
  if (findings_.items().size() >= kMaxFindings || !reported_.insert(key).second) return;
  findings_.add({.code = code,
                 .where = "tile " + to_text(key),
                 .expected = "the signed tile",
                 .found = std::move(found),
                 .fix = "after the flight: verify the package at full depth and check the storage medium"});
}

CheckedTileSet open_checked_tiles(const std::filesystem::path& package, const Manifest& manifest, Progress& progress) {
  const Artifact* imagery = manifest.artifact(kRoleImagery);
  if (imagery == nullptr || !imagery->tiles) {
    throw Error({.what = "the package has no imagery", .where = package / kManifestFile});
  }
  TileSetFiles files = open_tile_set_files(package / imagery->path);
  InputFile tiles = files.tiles.duplicate();
  TileSetCheck check = check_tile_set(std::move(files), *imagery->tiles, VerifyDepth::quick, progress);
  CheckedTileSet opened{std::move(check.findings), nullptr};
  if (opened.findings.has_errors()) return opened;
  opened.tiles = std::make_unique<CheckedTiles>(std::move(tiles), std::move(check.sidecars));
  return opened;
}

Bytes read_artifact(const std::filesystem::path& package, const Artifact& artifact, std::uint64_t max_size) {
  Bytes bytes = read_file(package / artifact.path, max_size);
  if (const Sha256 found = sha256(bytes); found != artifact.sha256) {
    throw Error({.what = "a file of the package is not that of its manifest",
                 .where = package / artifact.path,
                 .expected = artifact.sha256.hex(),
                 .found = found.hex(),
                 .fix = "get the package again from its source"});
  }
  return bytes;
}

OpenPackage::OpenPackage(Verification accepted, std::optional<MatchabilityRaster> matchability)
    : folder_(std::move(accepted.folder)),
      imagery_file_(std::move(accepted.imagery)),
      manifest_(std::move(accepted.manifest.value())),
      mission_(std::move(accepted.mission.value())),
      imagery_(imagery_file_->duplicate(), std::move(accepted.tiles)),
      terrain_(std::move(accepted.terrain)),
      matchability_(std::move(matchability)) {}

std::unique_ptr<CheckedTiles> OpenPackage::another_imagery_reader() const {
  return std::make_unique<CheckedTiles>(imagery_file_->duplicate(), imagery_.sidecars());
}

std::optional<Bytes> OpenPackage::read_vectors() const {
  const Artifact* artifact = manifest_.artifact(kRoleVectors);
  if (artifact == nullptr || artifact->size > kMaxVectors_bytes) return std::nullopt;
  try {
    Bytes bytes = folder_->open(artifact->path).read(artifact->size);
    if (sha256(bytes) == artifact->sha256) return bytes;
  } catch (const Error&) {
    return std::nullopt;  // the medium fails: the map is shown without them
  }
  return std::nullopt;
}

namespace {

std::optional<MatchabilityRaster> read_matchability(const Directory& package, const Manifest& manifest,
                                                    Findings& findings) {
  const Artifact* artifact = manifest.artifact(kRoleMatchability);
  if (artifact == nullptr) return std::nullopt;
  const auto warn = [&](std::string expected, std::string found) {
    findings.add({.code = "matchability.corrupt",
                  .severity = Severity::warning,
                  .where = artifact->path,
                  .expected = std::move(expected),
                  .found = std::move(found),
                  .fix = "make it again with `nadir cache matchability --into-package`"});
  };
  try {
    const Bytes bytes = package.open(artifact->path).read(std::min(artifact->size, kMaxMatchabilityFile));
    const Sha256 digest = sha256(bytes);
    if (digest == artifact->sha256) return parse_matchability_raster(bytes, artifact->path);
    warn(artifact->sha256.hex(), digest.hex());
  } catch (const Error& error) {
    const ErrorText& text = error.text();
    warn(text.expected.empty() ? "a map as `nadir cache matchability` writes it" : text.expected,
         text.found.empty() ? text.what : text.found);
  }
  return std::nullopt;
}

Opening opened(Verification verification) {
  if (verification.accepted() && !verification.terrain) {
    TerrainReading reading = read_package_terrain(*verification.folder, *verification.manifest, *verification.mission);
    verification.findings.add(reading.findings);
    verification.terrain = std::move(reading.terrain);
  }
  Opening opening{verification.findings,    verification.newest_root, verification.root_version,
                  verification.newer_roots, verification.time_reset,  nullptr};
  if (verification.accepted()) {
    auto matchability = read_matchability(*verification.folder, *verification.manifest, opening.findings);
    opening.package = std::make_unique<OpenPackage>(std::move(verification), std::move(matchability));
  }
  return opening;
}

}  // namespace

Opening open_package(const std::filesystem::path& package, const VerifyOptions& options, Progress& progress) {
  return opened(verify_package(package, options, progress));
}

Opening open_accepted_package(const std::filesystem::path& package, const Sha256& manifest, UtcTime accepted_at,
                              Progress& progress) {
  return opened(verify_accepted_package(package, manifest, accepted_at, progress));
}

}  // namespace nadir
