// nadir recorder recover: finished files of what is left of a damaged or cut recording.
#pragma once

#include <filesystem>

#include "cli/command.hpp"

namespace nadir {

class RecorderRecoverCommand final : public Command {
 public:
  std::string_view group() const override { return "recorder"; }
  std::string_view name() const override { return "recover"; }
  std::string_view summary() const override { return "write finished files of what can be read of a recording"; }
  std::string_view details() const override;
  std::string_view examples() const override;
  bool offers_json() const override { return true; }

  void setup(Options& options) override;
  int run(Context& context) override;

 private:
  std::filesystem::path recording_, out_;
};

}  // namespace nadir
