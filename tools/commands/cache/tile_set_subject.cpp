#include "commands/cache/tile_set_subject.hpp"

#include <fmt/format.h>

#include "base/error.hpp"
#include "base/files.hpp"

namespace nadir {
namespace fs = std::filesystem;

TileSetSubject find_tile_set(const fs::path& path) {
  if (!fs::exists(path)) {
    throw UsageError({.what = "nothing with this name",
                      .where = path.string(),
                      .expected = "a package's folder, an MBTiles file or a COG"});
  }
  if (!fs::is_directory(path)) return {path, std::nullopt, {}};
  ManifestReading reading = parse_manifest(read_file(path / kManifestFile, kMaxManifestSize));
  if (!reading.manifest) {
    const Finding& first = reading.findings.items().front();
    throw Error({.what = "cannot read the manifest",
                 .where = (path / kManifestFile).string() + ": " + first.where,
                 .expected = first.expected,
                 .found = first.found});
  }
  const Artifact* imagery = reading.manifest->artifact(kRoleImagery);
  if (imagery == nullptr) {
    throw Error({.what = "the package has no imagery",
                 .where = path.string(),
                 .expected = fmt::format("{} or {}", kImageryFile, kCogFile)});
  }
  const fs::path tiles = path / imagery->path;
  const Artifact* mission = reading.manifest->artifact(kRoleMission);
  return {tiles, std::move(reading.manifest), mission == nullptr ? fs::path() : path / kMissionFile};
}

}  // namespace nadir
