// The plan of a build by several machines: everything that is decided before a pixel is read, and how the work is
// split.
//
// The folder of a plan holds plan.json and the mission. The plan states each raster's facts, outline and files with
// size, time and digest, so that a shard opens and reads only the rasters that it needs, and nothing is hashed or
// measured twice. Its shards are spans of the metatiles in Morton order with about as many tiles each; a shard is a
// compact area.
//
// What a shard is compared with when it is merged is the plan's description: the digests of all that the tiles depend
// on, not paths. Two plans of the same mission, imagery, options and number of shards are the same plan.
#pragma once

#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "base/error.hpp"
#include "package_build/package_builder.hpp"
#include "package_build/pinned_file.hpp"
#include "package_build/shards.hpp"

namespace nadir {

inline constexpr const char* kShardPlanFile = "plan.json";
inline constexpr const char* kShardPlanMission = "mission.yaml";

struct ShardPlan {
  std::string program;  // its version
  std::string mission_text;
  Mission mission;
  std::vector<ImageryInput> inputs;           // the topmost first
  std::vector<std::vector<PinnedFile>> pins;  // of each input
  TileSetOptions tiles;                       // threads: not part of the plan
  std::vector<PinnedLayer> dem;               // the topmost first
  std::optional<PinnedLayer> vectors;
  VectorOrigin vectors_origin;
  std::optional<UtcTime> at;
  std::vector<MetatileSpan> shards;  // of metatiles_of(mission, plan_range(mission, inputs)), without gaps

  std::string description() const;           // lines "name: value" of all that the tiles depend on
  std::string description(int shard) const;  // 1 to N: also which part it makes
};

struct ShardPlanReport {
  Findings findings;  // with an error there is no plan
  std::uint64_t metatiles = 0;
  std::uint64_t tiles = 0;       // of all zooms, at most
  std::uint64_t most_tiles = 0;  // of the finest zoom in the largest shard
  std::uint64_t imagery_bytes = 0;
};

// Checks what a build checks before it reads pixels, and writes the plan's folder `out`. request: without key, roots
// and resume. Throws UsageError for more shards than there are metatiles.
ShardPlanReport plan_shards(const PackageRequest& request, int shards, const std::filesystem::path& out,
                            Progress& progress);

// program: the version that reads it. Throws UsageError when another one made the plan (its tiles may differ), Error
// when the plan is damaged.
ShardPlan read_shard_plan(const std::filesystem::path& folder, std::string_view program);

std::string shard_plan_json(const ShardPlan& plan);
ShardPlan parse_shard_plan(std::string_view json, std::string_view mission_text, const std::string& name);

// Splits the metatiles into spans with about as many tiles of the finest zoom each.
std::vector<MetatileSpan> split_metatiles(const TilePlan& plan, int shards);

}  // namespace nadir
