// What `cache build`, `cache plan-shards` and `cache merge` have in common: the options that say what a package is made
// of, and how the package that was made is reported.
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "cli/command.hpp"
#include "commands/cache/imagery_options.hpp"
#include "package_build/package_builder.hpp"

namespace nadir {

class Options;

class BuildOptions {
 public:
  void setup(Options& options);

  PackageRequest request() const;  // without key, roots, output
  int threads() const { return imagery_options_.threads(); }

 private:
  std::filesystem::path mission_;
  std::vector<std::filesystem::path> imagery_;
  std::vector<std::string> stretches_;
  std::vector<std::filesystem::path> dem_;
  std::string format_ = "mbtiles";
  std::string tile_format_ = "jpeg";
  int quality_ = 75;
  VectorOptions vectors_;
  ImageryOptions imagery_options_{"priority"};
  std::optional<UtcTime> at_;
};

// Findings and figures of a package without errors, and a note when it is unsigned (null key).
void print_package(Context& context, const std::filesystem::path& package, const PackageReport& report,
                   const PrivateKey* key);

}  // namespace nadir
