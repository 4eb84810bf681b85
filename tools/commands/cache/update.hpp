// `nadir cache update`: the next package of a series from the one before and newer imagery.
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "cli/command.hpp"
#include "commands/imagery_options.hpp"

namespace nadir {

class CacheUpdateCommand final : public Command {
 public:
  std::string_view group() const override { return "cache"; }
  std::string_view name() const override { return "update"; }
  std::string_view summary() const override { return "make the next package from an old one and newer imagery"; }
  std::string_view details() const override;
  std::string_view examples() const override;
  bool offers_json() const override { return true; }

  void setup(Options& options) override;
  int run(Context& context) override;

 private:
  std::filesystem::path old_;
  std::filesystem::path trust_;
  std::filesystem::path mission_;
  std::vector<std::filesystem::path> imagery_;
  std::vector<std::string> stretches_;
  std::optional<std::filesystem::path> dem_;
  int quality_ = 75;
  std::optional<std::string> format_;
  bool index_ = false;
  ImageryOptions options_{"newest"};
  std::optional<std::filesystem::path> key_;
  std::vector<std::filesystem::path> roots_;
  std::optional<UtcTime> at_;
  std::filesystem::path out_;
};

}  // namespace nadir
