// nadir mission import: a mission file from a route and areas that were drawn in another program.
#pragma once

#include <filesystem>
#include <optional>
#include <string>

#include "cli/command.hpp"

namespace nadir {

class MissionImportCommand final : public Command {
 public:
  std::string_view group() const override { return "mission"; }
  std::string_view name() const override { return "import"; }
  std::string_view summary() const override { return "begin a mission file from a drawn route and areas"; }
  std::string_view details() const override;
  std::string_view examples() const override;

  void setup(Options& options) override;
  int run(Context& context) override;

 private:
  std::filesystem::path file_;
  std::string id_;
  std::optional<std::string> route_;
  std::string class_ = "active";
  double half_width_m_ = 100;
  double agl_m_ = 120;
  double height_m_ = 0;
  std::filesystem::path out_;
};

}  // namespace nadir
