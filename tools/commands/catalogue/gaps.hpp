// nadir catalogue gaps: what no imagery of a catalogue serves of a mission.
#pragma once

#include <filesystem>
#include <optional>

#include "cli/command.hpp"

namespace nadir {

class CatalogueGapsCommand final : public Command {
 public:
  std::string_view group() const override { return "catalogue"; }
  std::string_view name() const override { return "gaps"; }
  std::string_view summary() const override { return "outline what no catalogued imagery covers of a mission"; }
  std::string_view details() const override;
  std::string_view examples() const override;

  void setup(Options& options) override;
  int run(Context& context) override;

 private:
  std::string catalogue_;
  std::filesystem::path mission_;
  std::optional<std::filesystem::path> out_;
  std::optional<UtcTime> at_;
  bool store_ = false;
};

}  // namespace nadir
