#include "package/verify.hpp"

#include "base/error.hpp"
#include "package/judge.hpp"
#include "package/judge_terrain.hpp"
#include "package/root_folder.hpp"
#include "package/verify_parts.hpp"

namespace nadir {
namespace fs = std::filesystem;
namespace {

void require_package(const fs::path& package) {
  const bool folder = fs::is_directory(package);
  const bool anything = folder && (fs::exists(fs::symlink_status(package / kManifestFile)) ||
                                   fs::exists(fs::symlink_status(package / kSignatureFile)));
  if (anything) return;
  throw Error({.what = "this is no mission package",
               .where = package,
               .expected = "a folder with manifest.json and manifest.sig",
               .found = folder                ? "a folder without both"
                        : fs::exists(package) ? "something that is no folder"
                                              : "nothing of this name",
               .fix = "give the folder that `nadir cache build --out` made"});
}

void verify_imagery(const fs::path& package, const VerifyOptions& options, const FileCheck& files, Progress& progress,
                    Verification& result) {
  const Artifact* imagery = result.manifest->artifact(kRoleImagery);
  if (imagery == nullptr || !imagery->tiles) {
    result.findings.add({.code = "manifest.schema",
                         .where = "manifest.json /artifacts",
                         .expected = "an artifact of role \"imagery\" with \"tiles\"",
                         .found = "none"});
    return;
  }
  if (!files.sound.contains(imagery->path)) return;  // its own finding is there
  // The sidecars of a COG are an artifact of their own.
  const Artifact* sidecars = result.manifest->artifact(kRoleSidecars);
  if (sidecars != nullptr && !files.sound.contains(sidecars->path)) return;
  TileSetCheck check = check_tile_set(package / imagery->path, *imagery->tiles, options.depth, progress);
  const bool readable = !check.findings.contains("sqlite.corrupt") && !check.findings.contains("tiff.corrupt");
  result.findings.add(check.findings);
  result.tiles = std::move(check.sidecars);
  if (readable && result.mission) {
    result.findings.add(judge_tiles(*result.mission, result.tiles, result.bytes, options.at));
  }
}

// At quick depth the terrain's bytes are left to whoever opens the package.
void verify_terrain(const fs::path& package, const VerifyOptions& options, const FileCheck& files,
                    Verification& result) {
  if (!result.mission) return;
  result.findings.add(judge_terrain_presence(*result.manifest, *result.mission));
  const Artifact* terrain = result.manifest->artifact(kRoleTerrain);
  if (options.depth != VerifyDepth::full || terrain == nullptr || !files.sound.contains(terrain->path)) return;
  TerrainReading reading = read_package_terrain(package, *result.manifest, *result.mission);
  result.findings.add(reading.findings);
  result.terrain = std::move(reading.terrain);
}

}  // namespace

void remember(AircraftState& state, const Verification& accepted, UtcTime at) {
  const Manifest& manifest = accepted.manifest.value();
  state.accept(manifest.series, manifest.sequence, accepted.root_version, at, accepted.newer_roots);
}

Verification verify_package(const fs::path& package, const VerifyOptions& options, Progress& progress) {
  require_package(package);
  Verification result;
  RootSuccession walk = walk_package_roots(package, *options.root, options.state);
  result.findings.add(walk.findings);
  result.newest_root = walk.root;
  result.root_version = walk.root.version;
  result.newer_roots = std::move(walk.newer);
  verify_signature(package, walk.root, options, result);
  if (!result.manifest) return result;
  for (const Artifact& artifact : result.manifest->artifacts) result.bytes += artifact.size;
  result.findings.add(verify_policy(*result.manifest, walk.root, options));
  const FileCheck files = verify_files(package, *result.manifest, options.depth, progress);
  result.findings.add(files.findings);
  const Artifact* mission = result.manifest->artifact(kRoleMission);
  if (mission == nullptr || files.sound.contains(mission->path)) verify_mission(package, result);
  verify_terrain(package, options, files, result);
  verify_imagery(package, options, files, progress, result);
  return result;
}

}  // namespace nadir
