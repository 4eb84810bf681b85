// Shards of work that several machines share: which one this is, and where those lie that are done.
//
// A finished shard is a folder named after the work and its number, "shard-3-of-8", with a journal (build_journal.hpp)
// inside. Shards may lie in one folder or in several.
#pragma once

#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "package_build/build_journal.hpp"

namespace nadir {

inline constexpr int kMaxShards = 100'000;

// Which shard, from "I/N", "I", or "auto": from the variables that Slurm (SLURM_ARRAY_TASK_ID, from 1 on), Kubernetes
// (JOB_COMPLETION_INDEX, from 0 on) and AWS Batch (AWS_BATCH_JOB_ARRAY_INDEX, from 0 on) set for the tasks of an array.
// variable: of the environment. Throws UsageError for anything that is not one of 1 to `shards`.
using EnvironmentVariable = std::function<std::optional<std::string>(const char* name)>;
int parse_shard(std::string_view text, int shards, const EnvironmentVariable& variable);

// The same where no plan says how many there are: "I/N" or "auto/N".
struct ShardNumber {
  int shard = 1, shards = 1;  // 1 to shards
};
ShardNumber parse_shard_number(std::string_view text, const EnvironmentVariable& variable);

std::string shard_folder_name(std::string_view work, int shard, int shards);  // "shard-3-of-8"

// The folder of each shard, in order. build: the command that builds one, for messages. Throws UsageError when one is
// missing or there twice.
std::vector<std::filesystem::path> find_shards(std::string_view work, int shards,
                                               const std::vector<std::filesystem::path>& folders,
                                               std::string_view build);
// The journal of a shard that is being made, continued where a killed process left it. Throws UsageError where that one
// had another configuration.
std::unique_ptr<BuildJournal> open_shard_journal(const std::filesystem::path& staging, std::string_view configuration);

// How many there are, by their names. Throws UsageError for none, and for those of different counts.
int count_shards(std::string_view work, const std::vector<std::filesystem::path>& folders, std::string_view build);

}  // namespace nadir
