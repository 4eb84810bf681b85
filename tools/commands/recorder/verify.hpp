// nadir recorder verify: can this recording be relied on?.
#pragma once

#include <filesystem>

#include "cli/command.hpp"

namespace nadir {

class RecorderVerifyCommand final : public Command {
 public:
  std::string_view group() const override { return "recorder"; }
  std::string_view name() const override { return "verify"; }
  std::string_view summary() const override { return "check a recording for damage, losses and a clean end"; }
  std::string_view details() const override;
  std::string_view examples() const override;
  bool offers_json() const override { return true; }

  void setup(Options& options) override;
  int run(Context& context) override;

 private:
  std::filesystem::path recording_;
};

}  // namespace nadir
