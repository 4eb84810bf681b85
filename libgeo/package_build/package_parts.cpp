#include "package_build/package_parts.hpp"

#include <fmt/format.h>

#include "base/error.hpp"
#include "base/files.hpp"
#include "package_build/build_journal.hpp"
#include "package_build/terrain_builder.hpp"
#include "package/mission_check.hpp"
#include "package/package_writer.hpp"
#include "vision/place_index.hpp"

namespace nadir {
namespace fs = std::filesystem;

Mission parse_mission_or_throw(std::string_view yaml, const fs::path& path) {
  MissionReading reading = parse_mission(yaml, path.string());
  if (reading.mission) return *reading.mission;
  const Finding& first = reading.findings.items().front();
  throw UsageError({.what = "the mission does not read",
                    .where = first.where,
                    .expected = first.expected,
                    .found = first.found,
                    .fix = first.fix.empty() ? "nadir mission check lists everything" : first.fix});
}

Findings judge_date(const Mission& mission, UtcTime at) {
  Findings findings;
  if (at >= mission.expires) {
    findings.add({.code = "package.expired",
                  .where = "mission.expires",
                  .expected = "later than " + to_rfc3339(at),
                  .found = to_rfc3339(mission.expires),
                  .fix = "plan the mission anew with a later date"});
  }
  return findings;
}

void check_zoom(const Mission& mission, const fs::path& path) {
  constexpr int kFinest = 22;
  if (mission.zoom.max <= kFinest) return;
  throw UsageError({.what = "tiles of this zoom are not built",
                    .where = path.string() + " (zoom.max)",
                    .expected = fmt::format("at most {}, which is 4 cm per pixel", kFinest),
                    .found = std::to_string(mission.zoom.max)});
}

void check_terrain_wanted(const Mission& mission, const fs::path& mission_file, const std::optional<fs::path>& dem) {
  if (!mission.terrain.flat || !dem) return;
  throw UsageError({.what = "the mission says that its ground is flat",
                    .where = mission_file.string() + " (terrain)",
                    .expected = "terrain: {mode: dem} when an elevation model is given",
                    .found = "mode: flat, and --dem " + dem->string(),
                    .fix = "write mode: dem, or leave --dem away"});
}

std::optional<TerrainRaster> prepare_terrain(const Mission& mission, const fs::path& mission_file,
                                             const std::optional<fs::path>& dem, Findings& findings) {
  if (mission.terrain.flat) return std::nullopt;
  if (!dem) {
    findings.add({.code = "dem.gap",
                  .where = mission_file.string() + " (terrain)",
                  .expected = "an elevation model, because the mission says mode: dem",
                  .found = "none",
                  .fix = "give it with --dem FILE, or write terrain: {mode: flat, height_m: …}"});
    return std::nullopt;
  }
  TerrainRaster terrain = cut_terrain(*dem, mission);
  findings.add(check_terrain(mission, terrain));
  return terrain;
}

void complete_package(const fs::path& folder, const PackageParts& parts, Progress& progress) {
  fs::create_directories(folder / fs::path(kMissionFile).parent_path());
  write_file_atomic(folder / kMissionFile, parts.mission_text);
  if (parts.terrain) {
    fs::create_directories(folder / fs::path(kTerrainFile).parent_path());
    write_terrain(*parts.terrain, folder / kTerrainFile);
  }
  add_package_roots(folder, parts.roots);
  progress.advance();

  Manifest manifest = manifest_for(parts.mission);
  const bool cog = fs::exists(folder / kCogFile);
  manifest.artifacts.push_back(describe_file(folder, cog ? kCogFile : kImageryFile, kRoleImagery));
  manifest.artifacts.back().tiles = parts.tiles;
  if (cog) manifest.artifacts.push_back(describe_file(folder, kSidecarFile, kRoleSidecars));
  manifest.artifacts.push_back(describe_file(folder, kMissionFile, kRoleMission));
  if (parts.terrain) manifest.artifacts.push_back(describe_file(folder, kTerrainFile, kRoleTerrain));
  if (parts.index != nullptr) {
    for (Artifact& artifact : write_place_index(folder, *parts.index))
      manifest.artifacts.push_back(std::move(artifact));
  }
  write_manifest(folder, manifest);
  if (parts.key != nullptr) sign_package(folder, *parts.key);
  progress.advance();
}

std::vector<Artifact> write_place_index(const fs::path& folder, const PlaceIndex& index) {
  fs::create_directories((folder / kPlaceIndexFile).parent_path());
  write_file_atomic(folder / kPlaceIndexFile, index.vectors().file());
  write_file_atomic(folder / kPlaceTableFile, place_table_json(index.table()));
  return {describe_file(folder, kPlaceIndexFile, kRolePlaceIndex),
          describe_file(folder, kPlaceTableFile, kRolePlaceTable)};
}

std::uint64_t package_size(const fs::path& folder) {
  std::uint64_t size = 0;
  for (const auto& entry : fs::recursive_directory_iterator(folder)) {
    if (entry.is_regular_file() && entry.path().filename() != kJournalFile) size += entry.file_size();
  }
  return size;
}

}  // namespace nadir
