#include "catalogue/catalogue_reading.hpp"

#include "base/error.hpp"
#include "base/files.hpp"

namespace nadir {
namespace {

void check_mission_file(const std::filesystem::path& package, const Manifest& manifest, CatalogueReading& reading,
                        std::optional<Mission>& mission) {
  const Artifact* artifact = manifest.artifact(kRoleMission);
  const std::filesystem::path path = package / kMissionFile;
  if (artifact == nullptr || artifact->path != kMissionFile || !std::filesystem::exists(path)) {
    reading.findings.add({.code = "artifact.missing",
                          .where = std::string(kMissionFile),
                          .expected = "the mission that the package is for",
                          .found = "none",
                          .fix = "build the package again"});
    return;
  }
  if (sha256_file(path) != artifact->sha256) {
    reading.findings.add({.code = "artifact.hash",
                          .where = std::string(kMissionFile),
                          .expected = "the digest in the manifest",
                          .found = "other bytes",
                          .fix = "fetch the package again"});
    return;
  }
  MissionReading checked = check_mission(path);
  reading.findings.add(checked.findings);
  mission = std::move(checked.mission);
}

CatalogueReading read_unverified(const std::filesystem::path& package, Progress& progress) {
  CatalogueReading reading;
  ManifestReading manifest = parse_manifest(read_file(package / kManifestFile, kMaxManifestSize));
  reading.findings.add(manifest.findings);
  if (!manifest.manifest) return reading;
  std::optional<Mission> mission;
  check_mission_file(package, *manifest.manifest, reading, mission);
  const Artifact* imagery = manifest.manifest->artifact(kRoleImagery);
  if (imagery == nullptr || !imagery->tiles) {
    reading.findings.add({.code = "artifact.missing",
                          .where = std::string(kManifestFile),
                          .expected = "an artifact of role \"imagery\" with \"tiles\"",
                          .found = "none"});
    return reading;
  }
  TileSetCheck check = check_tile_set(package / imagery->path, *imagery->tiles, VerifyDepth::quick, progress);
  reading.findings.add(check.findings);
  if (reading.findings.refuses() || !mission) return reading;
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
    throw UsageError({.what = "no package of this name",
                      .where = package.string(),
                      .expected = "a package's folder",
                      .found = std::filesystem::exists(package) ? "a file" : "nothing"});
  }
  CatalogueReading reading =
      options != nullptr ? read_verified(package, *options, progress) : read_unverified(package, progress);
  if (reading.entry) reading.entry->manifest_sha256 = sha256_file(package / kManifestFile);
  return reading;
}

}  // namespace nadir
