// A SharedWork (base/shared_work.hpp) that several machines do: each a shard of its tasks, one takes the results of
// all. What it makes of them is the same, bit for bit, as if it had done the work alone.
//
// A shard is the folder WORK-I-of-N with a journal of results, in the order of the tasks. One that was killed continues
// in its hidden staging folder; nothing incomplete has the final name. Doing a shard that is there already checks it
// and does nothing else.
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <string>
#include <string_view>
#include <vector>

#include "base/progress.hpp"
#include "base/shared_work.hpp"
#include "package_build/shards.hpp"

namespace nadir {

struct WorkShardRequest {
  std::string_view work;         // its name, in the names of folders: "index"
  std::string inputs;            // lines "name: value" of what the work's own description does not say
  ShardNumber number;            // which part
  std::filesystem::path folder;  // that the shard's folder is made in
  int threads = 1;
  std::function<void()> check_inputs = [] {};  // before a result is kept: throws when what was read is damaged
  std::function<void(std::string_view)> on_remark = [](auto) {};
};

struct WorkShardReport {
  bool was_there = false;   // complete already; nothing was done
  std::size_t tasks = 0;    // of this shard
  std::size_t resumed = 0;  // from a run that was killed
  std::filesystem::path folder;
};

WorkShardReport do_shard(const SharedWork& work, const WorkShardRequest& request, Progress& progress);

// Adds all results to the work. folders: that shards lie in; build: the command that makes one, for messages. Throws
// UsageError when a shard is missing, there twice, or of other inputs; Error when one is damaged.
void take_shards(SharedWork& work, std::string_view name, const std::string& inputs,
                 const std::vector<std::filesystem::path>& folders, std::string_view build, Progress& progress);

}  // namespace nadir
