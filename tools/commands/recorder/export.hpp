// nadir recorder export: a recording for other programs.
#pragma once

#include <filesystem>
#include <optional>
#include <string>

#include "cli/command.hpp"

namespace nadir {

class RecorderExportCommand final : public Command {
 public:
  std::string_view group() const override { return "recorder"; }
  std::string_view name() const override { return "export"; }
  std::string_view summary() const override { return "write estimates, anchors and events for other programs"; }
  std::string_view details() const override;
  std::string_view examples() const override;

  void setup(Options& options) override;
  int run(Context& context) override;

 private:
  std::filesystem::path recording_, out_;
  std::string format_;
  std::optional<std::string> session_;
};

}  // namespace nadir
