// `nadir cache build`: mission, imagery and elevation model to a signed package.
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "cli/command.hpp"
#include "commands/imagery_options.hpp"

namespace nadir {

class CacheBuildCommand final : public Command {
 public:
  std::string_view group() const override { return "cache"; }
  std::string_view name() const override { return "build"; }
  std::string_view summary() const override { return "build and sign the map package of a mission"; }
  std::string_view details() const override;
  std::string_view examples() const override;
  bool offers_json() const override { return true; }

  void setup(Options& options) override;
  int run(Context& context) override;

 private:
  std::filesystem::path mission_;
  std::vector<std::filesystem::path> imagery_;
  std::vector<std::string> stretches_;
  std::optional<std::filesystem::path> dem_;
  std::string format_ = "mbtiles";
  std::string tile_format_ = "jpeg";
  int quality_ = 75;
  ImageryOptions imagery_options_{"priority"};
  std::optional<std::filesystem::path> key_;
  std::vector<std::filesystem::path> roots_;
  std::optional<std::filesystem::path> trust_;
  std::optional<UtcTime> at_;
  std::filesystem::path out_;
  bool resume_ = false;
};

}  // namespace nadir
