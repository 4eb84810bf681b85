// nadir sync push: brings the outbox to the candidate service.
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>

#include "cli/command.hpp"
#include "commands/sync/sync_surroundings.hpp"

namespace nadir {

class SyncPushCommand final : public Command {
 public:
  explicit SyncPushCommand(SyncSurroundings surroundings = {}) : surroundings_(std::move(surroundings)) {}

  std::string_view group() const override { return "sync"; }
  std::string_view name() const override { return "push"; }
  std::string_view summary() const override {
    return "send the outbox to the candidate service and fetch the verdicts";
  }
  std::string_view details() const override;
  std::string_view examples() const override;
  bool offers_json() const override { return true; }

  void setup(Options& options) override;
  int run(Context& context) override;

 private:
  std::string token() const;
  int dry_run(Context& context) const;

  SyncSurroundings surroundings_;
  std::filesystem::path outbox_;
  std::string to_;
  std::optional<std::filesystem::path> token_file_;
  std::optional<std::filesystem::path> authorities_;
  std::int64_t patience_s_ = 900;
  bool dry_run_ = false;
};

}  // namespace nadir
