// nadir recorder info: what is in a recording.
#pragma once

#include <filesystem>

#include "cli/command.hpp"

namespace nadir {

class RecorderInfoCommand final : public Command {
 public:
  std::string_view group() const override { return "recorder"; }
  std::string_view name() const override { return "info"; }
  std::string_view summary() const override { return "show what is in a recording"; }
  std::string_view details() const override;
  std::string_view examples() const override;
  bool offers_json() const override { return true; }

  void setup(Options& options) override;
  int run(Context& context) override;

 private:
  std::filesystem::path recording_;
};

}  // namespace nadir
