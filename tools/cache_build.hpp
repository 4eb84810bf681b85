// `nadir cache build`: mission, imagery and elevation model to a signed package.
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "framework/command.hpp"

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
  std::optional<std::filesystem::path> dem_;
  std::string format_ = "mbtiles";
  std::string tile_format_ = "jpeg";
  int quality_ = 75;
  std::optional<std::filesystem::path> key_;
  std::optional<UtcTime> at_;
  std::optional<int> threads_;
  std::optional<UtcTime> captured_;
  std::optional<double> gsd_m_;
  std::optional<double> ce90_m_;
  std::optional<std::string> provider_;
  std::filesystem::path out_;
  bool resume_ = false;
  std::string mosaic_ = "priority";
  std::string seam_ = "hard";
  double feather_m_ = 10;
};

}  // namespace nadir
