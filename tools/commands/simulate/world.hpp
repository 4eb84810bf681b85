// `nadir simulate world`: a made-up landscape to try everything with.
#pragma once

#include <filesystem>

#include "cli/command.hpp"
#include "simulation/world.hpp"

namespace nadir {

class SimulateWorldCommand final : public Command {
 public:
  std::string_view group() const override { return "simulate"; }
  std::string_view name() const override { return "world"; }
  std::string_view summary() const override {
    return "make a landscape: satellite map, the ground on the day, elevation";
  }
  std::string_view details() const override;
  std::string_view examples() const override;
  bool offers_json() const override { return true; }
  void setup(Options& options) override;
  int run(Context& context) override;

 private:
  WorldOptions options_;
  std::filesystem::path out_;
};

}  // namespace nadir
