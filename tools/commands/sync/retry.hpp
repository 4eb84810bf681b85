// nadir sync retry: tries again what was given up.
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "cli/command.hpp"
#include "commands/sync/sync_surroundings.hpp"

namespace nadir {

class SyncRetryCommand final : public Command {
 public:
  explicit SyncRetryCommand(SyncSurroundings surroundings = {}) : surroundings_(std::move(surroundings)) {}

  std::string_view group() const override { return "sync"; }
  std::string_view name() const override { return "retry"; }
  std::string_view summary() const override {
    return "try again what was parked, or rejected for a reason that has gone";
  }
  std::string_view details() const override;
  std::string_view examples() const override;
  bool offers_json() const override { return true; }

  void setup(Options& options) override;
  int run(Context& context) override;

 private:
  SyncSurroundings surroundings_;
  std::filesystem::path outbox_;
  std::vector<std::string> codes_;
  std::optional<std::filesystem::path> key_;
};

}  // namespace nadir
