// nadir-candidates status: what a service's catalogue holds.
#pragma once

#include <filesystem>
#include <optional>

#include "cli/command.hpp"

namespace nadir {

class StatusCommand final : public Command {
 public:
  std::string_view group() const override { return {}; }
  std::string_view name() const override { return "status"; }
  std::string_view summary() const override {
    return "count what the service holds: uploads, verdicts, promoted tiles";
  }
  std::string_view examples() const override { return "nadir-candidates status --data /srv/candidates --json"; }
  bool offers_json() const override { return true; }

  void setup(Options& options) override;
  int run(Context& context) override;

 private:
  std::optional<std::filesystem::path> data_;
  std::string catalogue_;
};

}  // namespace nadir
