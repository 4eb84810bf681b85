// nadir mission check: is this mission file sound, and what does it ask for?
#pragma once

#include <filesystem>

#include "cli/command.hpp"

namespace nadir {

class MissionCheckCommand final : public Command {
 public:
  std::string_view group() const override { return "mission"; }
  std::string_view name() const override { return "check"; }
  std::string_view summary() const override { return "check a mission file and say what it asks for"; }
  std::string_view details() const override;
  std::string_view examples() const override;
  bool offers_json() const override { return true; }

  void setup(Options& options) override;
  int run(Context& context) override;

 private:
  std::filesystem::path mission_;
};

}  // namespace nadir
