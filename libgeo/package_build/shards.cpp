#include "package_build/shards.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <array>
#include <cstdint>
#include <set>

#include "base/error.hpp"
#include "base/number_text.hpp"

namespace nadir {
namespace {

namespace fs = std::filesystem;

[[noreturn]] void refuse_shard(std::string where, std::string expected, std::string found, std::string fix = {}) {
  throw UsageError({.what = "there is no such shard",
                    .where = std::move(where),
                    .expected = std::move(expected),
                    .found = std::move(found),
                    .fix = std::move(fix)});
}

int shard_of_engine(int shards, const EnvironmentVariable& variable) {
  struct Engine {
    const char* name;
    std::int64_t first;  // index of the first task
    const char* counted;
  };
  static constexpr std::array kEngines = {Engine{"SLURM_ARRAY_TASK_ID", 1, "sbatch --array=1-{}"},
                                          Engine{"JOB_COMPLETION_INDEX", 0, "completions: {}"},
                                          Engine{"AWS_BATCH_JOB_ARRAY_INDEX", 0, "an array of size {}"}};
  const Engine* engine = nullptr;
  std::string index;
  for (const Engine& one : kEngines) {
    const auto value = variable(one.name);
    if (!value) continue;
    if (engine != nullptr) {
      throw UsageError({.what = "two schedulers name a shard",
                        .where = "--shard auto",
                        .expected = "one of their variables",
                        .found = fmt::format("{} and {}", engine->name, one.name),
                        .fix = "state the shard: --shard I/N"});
    }
    engine = &one;
    index = *value;
  }
  if (engine == nullptr) {
    throw UsageError({.what = "no scheduler names a shard",
                      .where = "--shard auto",
                      .expected = "SLURM_ARRAY_TASK_ID, JOB_COMPLETION_INDEX or AWS_BATCH_JOB_ARRAY_INDEX",
                      .found = "none of them",
                      .fix = "run it as a task of an array, or state the shard: --shard I/N"});
  }
  const std::string fix =
      "number the tasks so: " +
      fmt::format(fmt::runtime(engine->counted), shards == 1 ? std::string("1") : std::to_string(shards));
  const std::int64_t last = engine->first + shards - 1;
  const auto check = [&](const char* name, const std::string& text) {
    const auto number = whole_number<std::int64_t>(text);
    if (number && *number >= engine->first && *number <= last) return *number;
    refuse_shard(name, fmt::format("{} to {}", engine->first, last), text, fix);
  };
  // An array from 0 on would make shard 1 of its second task, and never the last shard: every task refuses it.
  if (const auto first = variable("SLURM_ARRAY_TASK_MIN"); first && engine->first == 1) {
    check("SLURM_ARRAY_TASK_MIN", *first);
  }
  if (const auto most = variable("SLURM_ARRAY_TASK_MAX"); most && engine->first == 1) {
    check("SLURM_ARRAY_TASK_MAX", *most);
  }
  return static_cast<int>(check(engine->name, index) - engine->first) + 1;
}

std::string names_of(const std::vector<fs::path>& folders) {
  std::vector<std::string> names;
  for (const fs::path& folder : folders) names.push_back(folder.string());
  return fmt::format("{}", fmt::join(names, ", "));
}

void require_folders(const std::vector<fs::path>& folders) {
  for (const fs::path& folder : folders) {
    if (fs::is_directory(folder)) continue;
    throw UsageError(
        {.what = "the folder of shards does not exist", .where = folder.string(), .fix = "check --shards"});
  }
}

// 8 of "shard-3-of-8"; nothing for what is no shard's name.
std::optional<int> count_in_name(std::string_view name, std::string_view work) {
  const std::size_t of = name.rfind("-of-");
  if (of == std::string_view::npos || of <= work.size()) return std::nullopt;
  const auto shard = whole_number<std::int64_t>(name.substr(work.size() + 1, of - work.size() - 1));
  const auto shards = whole_number<std::int64_t>(name.substr(of + 4));
  if (!shard || !shards || *shard < 1 || *shard > *shards || *shards > kMaxShards) return std::nullopt;
  const int count = static_cast<int>(*shards);
  return name == shard_folder_name(work, static_cast<int>(*shard), count) ? std::optional(count) : std::nullopt;
}

}  // namespace

int parse_shard(std::string_view text, int shards, const EnvironmentVariable& variable) {
  if (text == "auto") return shard_of_engine(shards, variable);
  const std::size_t slash = text.find('/');
  const auto index = whole_number<std::int64_t>(text.substr(0, slash));
  const auto of = slash == std::string_view::npos ? std::optional<std::int64_t>(shards)
                                                  : whole_number<std::int64_t>(text.substr(slash + 1));
  if (!index || !of) {
    refuse_shard("--shard", "I/N (3/8), I, or auto", std::string(text));
  }
  if (*of != shards) {
    refuse_shard("--shard", fmt::format("one of {} shards", shards), fmt::format("one of {}", *of),
                 "the plan says how many there are");
  }
  if (*index < 1 || *index > shards) {
    refuse_shard("--shard", fmt::format("1/{0} to {0}/{0}", shards), std::string(text));
  }
  return static_cast<int>(*index);
}

ShardNumber parse_shard_number(std::string_view text, const EnvironmentVariable& variable) {
  const std::size_t slash = text.find('/');
  const auto shards =
      slash == std::string_view::npos ? std::nullopt : whole_number<std::int64_t>(text.substr(slash + 1));
  if (!shards || *shards < 1 || *shards > kMaxShards) {
    refuse_shard("--shard", fmt::format("I/N (3/8) or auto/N, N at most {}", kMaxShards), std::string(text));
  }
  const int count = static_cast<int>(*shards);
  return {parse_shard(text.substr(0, slash), count, variable), count};
}

std::string shard_folder_name(std::string_view work, int shard, int shards) {
  return fmt::format("{}-{}-of-{}", work, shard, shards);
}

std::vector<fs::path> find_shards(std::string_view work, int shards, const std::vector<fs::path>& folders,
                                  std::string_view build) {
  require_folders(folders);
  std::vector<fs::path> found;
  std::vector<std::string> missing;
  for (int shard = 1; shard <= shards; ++shard) {
    std::vector<fs::path> here;
    for (const fs::path& folder : folders) {
      const fs::path path = folder / shard_folder_name(work, shard, shards);
      if (fs::exists(fs::symlink_status(path))) here.push_back(path);
    }
    if (here.size() > 1 && !fs::equivalent(here[0], here[1])) {
      throw UsageError({.what = "a shard is there twice",
                        .where = fmt::format("shard {}/{}", shard, shards),
                        .expected = "one folder",
                        .found = fmt::format("{} and {}", here[0].string(), here[1].string()),
                        .fix = "remove one of them"});
    }
    if (here.empty()) {
      missing.push_back(std::to_string(shard));
    } else {
      found.push_back(here.front());
    }
  }
  if (missing.empty()) return found;
  constexpr std::size_t kNamed = 20;
  const std::string first = missing.front();
  std::string names = fmt::format(
      "{}", fmt::join(missing.begin(), missing.begin() + static_cast<std::ptrdiff_t>(std::min(kNamed, missing.size())),
                      ", "));
  if (missing.size() > kNamed) names += fmt::format(" and {} more", missing.size() - kNamed);
  throw UsageError({.what = missing.size() == 1 ? "a shard is missing" : "shards are missing",
                    .where = names_of(folders),
                    .expected = fmt::format("{} shards, {} and so on", shards, shard_folder_name(work, 1, shards)),
                    .found = fmt::format("no {}", names),
                    .fix = fmt::format("build them: {} --shard {}/{}", build, first, shards)});
}

std::unique_ptr<BuildJournal> open_shard_journal(const fs::path& staging, std::string_view configuration) {
  try {
    return std::make_unique<BuildJournal>(staging / kJournalFile, configuration);
  } catch (const UsageError& error) {
    ErrorText text = error.text();
    text.what = "an interrupted run of this shard had other inputs or options";
    text.fix = "repeat it with the same inputs and options, or remove " + staging.string();
    throw UsageError(text);
  }
}

int count_shards(std::string_view work, const std::vector<fs::path>& folders, std::string_view build) {
  require_folders(folders);
  std::set<int> counts;
  for (const fs::path& folder : folders) {
    for (const auto& entry : fs::directory_iterator(folder)) {
      if (const auto count = count_in_name(entry.path().filename().string(), work)) counts.insert(*count);
    }
  }
  if (counts.size() == 1) return *counts.begin();
  throw UsageError({.what = counts.empty() ? "there are no shards" : "shards of different counts lie here",
                    .where = names_of(folders),
                    .expected = fmt::format("those of one count: {} and so on", shard_folder_name(work, 1, 8)),
                    .found = counts.empty() ? "none" : fmt::format("of {}", fmt::join(counts, ", of ")),
                    .fix = counts.empty() ? fmt::format("build them: {} --shard I/N", build)
                                          : std::string("remove those of another count")});
}

}  // namespace nadir
