// A build by several machines: each makes a part of the metatiles, one makes the package of them.
//
//   plan_shards()   once: checks, and splits the work (shard_plan.hpp)
//   build_shard()   for each shard, anywhere, in any order: its metatiles to a journal
//   merge_shards()  once: overviews across the shards, terrain, checks, manifest, signature
//
// A shard is the folder shard-I-of-N with the journal of its metatiles: encoded tiles with their sidecars and digests,
// and of each metatile the one tile on top as pixels that were never compressed, which the overviews above it are made
// from. Merging takes the metatiles in the order in which one machine makes them, through the same code; so the package
// is the same, byte for byte, for any number of shards.
//
// A shard that was killed continues in its hidden staging folder; nothing incomplete has the final name. Building a
// shard that is there already checks it and does nothing else. Memory does not depend on the area: some 80 MB, 40
// MB for each thread, and up to 256 MB of GDAL's cache.
#pragma once

#include <filesystem>
#include <vector>

#include "package_build/shard_plan.hpp"

namespace nadir {

struct ShardRequest {
  std::filesystem::path plan;  // its folder
  std::string shard;           // "I/N", "I" or "auto"
  std::filesystem::path out;   // folder that the shard's own is made in; empty: the plan's
  int threads = 1;
  std::string program;
  EnvironmentVariable variable = [](const char*) { return std::optional<std::string>(); };
  std::function<void(std::string_view)> on_remark = [](auto) {};
};

struct ShardReport {
  Findings findings;  // with an error there is no shard
  int shard = 0, shards = 0;
  bool was_there = false;  // complete already; nothing was made
  std::uint64_t metatiles = 0;
  std::uint64_t tiles = 0;    // of all zooms up to that of the metatiles
  std::uint64_t resumed = 0;  // tiles of the finest zoom from a run that was killed
  std::uint64_t bytes = 0;    // of the tiles
  std::filesystem::path folder;
};

ShardReport build_shard(const ShardRequest& request, Progress& progress);

struct MergeRequest {
  std::filesystem::path plan_folder;
  ShardPlan plan;                              // read from there
  std::vector<std::filesystem::path> folders;  // that shards lie in; none: the plan's
  const PrivateKey* key = nullptr;             // null: unsigned
  RootChain roots;
  std::optional<UtcTime> now{};  // the present, for a warning about a mission that has expired
  std::filesystem::path out;
};

// Where there is a package already, as when a scheduler repeats a task whose end it did not see, the merge makes it
// again beside it and compares: the report says when it is the same. Throws UsageError when it is another one, when a
// shard is missing, there twice, or from another plan; Error when one is damaged.
PackageReport merge_shards(const MergeRequest& request, Progress& progress);

}  // namespace nadir
