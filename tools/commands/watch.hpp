// nadir watch: what a running nadird says, on a terminal: live, once, or as lines for a log.
#pragma once

#include <filesystem>
#include <optional>
#include <string>

#include "cli/command.hpp"
#include "nadird_client/nadird_client.hpp"

namespace nadir {

class WatchCommand final : public Command {
 public:
  std::string_view group() const override { return {}; }
  std::string_view name() const override { return "watch"; }
  std::string_view summary() const override { return "show what a running nadird says"; }
  std::string_view details() const override;
  std::string_view examples() const override;
  bool offers_json() const override { return true; }

  void setup(Options& options) override;
  int run(Context& context) override;

 private:
  std::string url_{kDefaultServiceUrl};
  std::optional<std::filesystem::path> token_file_;
  bool once_ = false;
  double interval_s_ = 1;
};

}  // namespace nadir
