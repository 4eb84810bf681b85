// --shards and --shard of commands whose work on a package several machines may share (package_build/work_shards.hpp).
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "base/shared_work.hpp"
#include "cli/command.hpp"
#include "cli/options.hpp"
#include "package/manifest.hpp"
#include "package/open_package.hpp"

namespace nadir {

// For parse_shard().
std::optional<std::string> environment_variable(const char* name);

// Of a package whose other files are not read. Throws Error when it is not that of the manifest.
Mission read_signed_mission(const std::filesystem::path& package, const Manifest& manifest);

class ShardOptions {
 public:
  // command: "nadir cache index", for messages; work: what its shards are called.
  ShardOptions(std::string_view command, std::string_view work) : command_(command), work_(work) {}

  void setup(Options& options);
  void check() const;  // throws UsageError

  bool make_one() const { return shard_.has_value(); }  // a shard is wanted, and nothing else
  bool take_all() const { return !shard_ && !folders_.empty(); }

  // Makes the shard and says so. tiles: of the package, whose damage ends it.
  int make(const SharedWork& work, const Manifest& manifest, const CheckedTiles& tiles, int threads,
           Context& context) const;

  // Does all of the work: from the shards, or here where none are named.
  void finish(SharedWork& work, const std::filesystem::path& package, const Manifest& manifest, int threads,
              Progress& progress) const;

 private:
  std::string_view command_, work_;
  std::vector<std::filesystem::path> folders_;
  std::optional<std::string> shard_;
};

}  // namespace nadir
