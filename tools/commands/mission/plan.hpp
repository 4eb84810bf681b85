// nadir mission plan: how large a package will be, and how long its building takes, before anything is built.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>

#include "cli/command.hpp"

namespace nadir {

class MissionPlanCommand final : public Command {
 public:
  std::string_view group() const override { return "mission"; }
  std::string_view name() const override { return "plan"; }
  std::string_view summary() const override { return "estimate tiles, megabytes and minutes before building"; }
  std::string_view details() const override;
  std::string_view examples() const override;
  bool offers_json() const override { return true; }

  void setup(Options& options) override;
  int run(Context& context) override;

 private:
  std::filesystem::path mission_;
  std::string tile_format_ = "jpeg";
  int threads_ = 1;
};

}  // namespace nadir
