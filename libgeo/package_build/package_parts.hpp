// What building a package and updating one share: reading the mission, preparing the terrain, and everything of the
// folder but the tiles.
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "base/finding.hpp"
#include "base/progress.hpp"
#include "base/time.hpp"
#include "imagery/terrain_raster.hpp"
#include "package/manifest.hpp"
#include "package/package_roots.hpp"
#include "trust/keys.hpp"

namespace nadir {

Mission parse_mission_or_throw(std::string_view yaml, const std::filesystem::path& path);  // UsageError

// Throws UsageError for zooms that are not built: pixels of the world's map are counted in 32 bit while tiles are made.
void check_zoom(const Mission& mission, const std::filesystem::path& mission_file);

// "package.expired".
Findings judge_date(const Mission& mission, UtcTime at);

// Throws UsageError when there is an elevation model although the mission's ground is flat.
void check_terrain_wanted(const Mission& mission, const std::filesystem::path& mission_file,
                          const std::optional<std::filesystem::path>& dem);

// Cut out and judged; adds its findings. Nothing with flat ground or without an elevation model.
std::optional<TerrainRaster> prepare_terrain(const Mission& mission, const std::filesystem::path& mission_file,
                                             const std::optional<std::filesystem::path>& dem, Findings& findings);

class PlaceIndex;

struct PackageParts {
  const Mission& mission;
  const std::string& mission_text;
  const TileSetFacts& tiles;  // of the imagery, which lies in the folder already
  const std::optional<TerrainRaster>& terrain;
  const RootChain& roots;
  const PrivateKey* key = nullptr;  // null: unsigned
  const PlaceIndex* index = nullptr;
};

// Writes mission, terrain, place index, roots, manifest and, last, the signature: two steps of progress.
void complete_package(const std::filesystem::path& folder, const PackageParts& parts, Progress& progress);

// Writes the two files of a place index; the artifacts that the manifest has to name.
std::vector<Artifact> write_place_index(const std::filesystem::path& folder, const PlaceIndex& index);

std::uint64_t package_size(const std::filesystem::path& folder);  // of its files, without a build's journal

}  // namespace nadir
