// Mission + imagery = package: the conductor of `nadir cache build`, and the steps that an update shares with it.
//
// Errors that verification would find are reported here: first those that show without reading a pixel (dates,
// resolution, gaps beside the imagery), then those that show while tiles are made (holes in the imagery, the budget).
// Nothing appears under the final name before everything is checked, written, signed and synced to disk.
#pragma once

#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "base/error.hpp"
#include "base/progress.hpp"
#include "base/time.hpp"
#include "imagery/terrain_raster.hpp"
#include "package/manifest.hpp"
#include "package/package_roots.hpp"
#include "package_build/tile_set_builder.hpp"
#include "package_build/vector_source.hpp"
#include "raster/imagery_input.hpp"
#include "trust/keys.hpp"

namespace nadir {

class PlaceIndex;

struct PackageRequest {
  std::filesystem::path mission;
  std::vector<std::filesystem::path> imagery;  // tiles.mosaic orders them
  ImageryOverrides overrides;
  std::vector<StretchRequest> stretches;     // none, one for all, or one for each
  std::optional<std::filesystem::path> dem;  // with terrain mode dem, and only then
  std::optional<VectorRequest> vectors;      // roads, water, woods and buildings, for people and for matchability
  TileSetOptions tiles;
  const PrivateKey* key = nullptr;  // null: unsigned
  RootChain roots;                  // newer roots of trust that travel with the package
  std::optional<UtcTime> at;        // time of evaluation; the mission's `created` by default
  std::optional<UtcTime> now{};     // the present, for a warning about a mission that has expired
  std::filesystem::path out;
  std::string program;                                            // its version, which the result depends on
  bool resume = false;                                            // continue an interrupted build
  std::function<void(std::string_view)> on_remark = [](auto) {};  // notes for the user while it runs
};

struct PackageReport {
  Findings findings;  // with an error there is no package
  std::uint64_t tiles = 0;
  std::uint64_t resumed = 0;  // of them, tiles of the finest zoom from the interrupted build
  std::uint64_t bytes = 0;    // of the whole package
  ZoomRange zoom;
  std::optional<TerrainGrid> terrain;
  std::optional<VectorFacts> vectors;
  Sha256 merkle_root;
};

PackageReport build_package(const PackageRequest& request, Progress& progress);

// Steps of a build that `nadir cache update` and `nadir cache index` share.

Mission parse_mission_or_throw(std::string_view yaml, const std::filesystem::path& path);  // UsageError

// Throws UsageError for zooms that are not supported: global pixels are counted in 32 bits while tiles are made.
void check_zoom(const Mission& mission, const std::filesystem::path& mission_file);

// Throws UsageError when there is an elevation model although the mission states flat terrain.
void check_terrain_wanted(const Mission& mission, const std::filesystem::path& mission_file,
                          const std::optional<std::filesystem::path>& dem);

// The terrain, cut out and checked; adds its findings. None for flat terrain or without an elevation model.
std::optional<TerrainRaster> prepare_terrain(const Mission& mission, const std::filesystem::path& mission_file,
                                             const std::optional<std::filesystem::path>& dem, Findings& findings);

struct PackageParts {
  const Mission& mission;
  const std::string& mission_text;
  const TileSetFacts& tiles;  // of the imagery, which is in the folder already
  const std::optional<TerrainRaster>& terrain;
  const RootChain& roots;
  const PrivateKey* key = nullptr;  // null: unsigned
  const PlaceIndex* index = nullptr;
  const PackageVectors* vectors = nullptr;
};

// Writes mission, terrain, place index, roots, manifest and, last, the signature: two steps of progress.
void complete_package(const std::filesystem::path& folder, const PackageParts& parts, Progress& progress);

// Writes the two files of a place index. Returns their artifacts for the manifest.
std::vector<Artifact> write_place_index(const std::filesystem::path& folder, const PlaceIndex& index);

std::uint64_t package_size(const std::filesystem::path& folder);  // bytes of its files, without a build's journal

}  // namespace nadir
