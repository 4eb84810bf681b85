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
  std::vector<StretchRequest> stretches;   // none, one for all, or one for each
  std::vector<std::filesystem::path> dem;  // with terrain mode dem, and only then; the first lies on top
  std::optional<VectorRequest> vectors;    // roads, water, woods and buildings, for people and for matchability
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
  bool was_there = false;     // with the same bytes; nothing was written
  ZoomRange zoom;
  std::optional<TerrainGrid> terrain;
  std::optional<VectorFacts> vectors;
  Sha256 merkle_root;
};

PackageReport build_package(const PackageRequest& request, Progress& progress);

// What a build is, before a pixel is read.
struct PreparedBuild {
  std::string mission_text;
  Mission mission;
  std::vector<ImageryInput> inputs;  // the topmost first
  TileRange range;
  UtcTime at;          // time of evaluation
  Findings findings;   // of the plan: valid as long as every pixel of the imagery is
  Findings of_inputs;  // what the tiles that are made will not show
  std::optional<TerrainRaster> terrain;
  std::optional<PackageVectors> vectors;

  bool rejected() const { return findings.has_errors() || of_inputs.has_errors(); }
};

PreparedBuild prepare_build(const PackageRequest& request);

// Terrain and vectors of the request, for a build whose mission and inputs are known.
void prepare_layers(const PackageRequest& request, PreparedBuild& build);

// Everything that the tiles depend on, as lines "name: value". digests: one for each input.
std::string describe_tiles(const PackageRequest& request, std::string_view mission_text,
                           std::span<const ImageryInput> inputs, std::span<const Sha256> digests);

// Writes the whole package into the folder. make_tiles: writes the tile set. Without errors in the report's findings
// the folder is complete.
using MakeTiles = std::function<TileSet(const std::filesystem::path& file)>;
PackageReport fill_package(const std::filesystem::path& folder, const PackageRequest& request,
                           const PreparedBuild& build, const MakeTiles& make_tiles, Progress& progress);

// Steps of a build that `nadir cache update` and `nadir cache index` share.

Mission parse_mission_or_throw(std::string_view yaml, const std::filesystem::path& path);  // UsageError

// Throws UsageError for zooms that are not supported: global pixels are counted in 32 bits while tiles are made.
void check_zoom(const Mission& mission, const std::filesystem::path& mission_file);

// Throws UsageError when there is an elevation model although the mission states flat terrain.
void check_terrain_wanted(const Mission& mission, const std::filesystem::path& mission_file,
                          std::span<const std::filesystem::path> dem);

// The terrain, cut out and checked; adds its findings. None for flat terrain or without an elevation model.
std::optional<TerrainRaster> prepare_terrain(const Mission& mission, const std::filesystem::path& mission_file,
                                             std::span<const std::filesystem::path> dem, Findings& findings);

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
