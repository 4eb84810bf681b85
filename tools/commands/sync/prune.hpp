// nadir sync prune: gives the room of finished tiles back.
#pragma once

#include <cstdint>
#include <filesystem>

#include "cli/command.hpp"
#include "commands/sync/sync_surroundings.hpp"

namespace nadir {

class SyncPruneCommand final : public Command {
 public:
  explicit SyncPruneCommand(SyncSurroundings surroundings = {}) : surroundings_(std::move(surroundings)) {}

  std::string_view group() const override { return "sync"; }
  std::string_view name() const override { return "prune"; }
  std::string_view summary() const override {
    return "delete the pictures of tiles that have had their verdict for a while";
  }
  std::string_view details() const override;
  std::string_view examples() const override;
  bool offers_json() const override { return true; }

  void setup(Options& options) override;
  int run(Context& context) override;

 private:
  SyncSurroundings surroundings_;
  std::filesystem::path outbox_;
  std::int64_t keep_days_ = 30;
  bool dry_run_ = false;
};

}  // namespace nadir
