// nadir sync stage: takes a flight's candidate tiles into the outbox and signs what will be announced.
#pragma once

#include <filesystem>
#include <optional>

#include "cli/command.hpp"
#include "commands/sync/sync_surroundings.hpp"

namespace nadir {

class Findings;
class CandidateReader;
class PublicKey;
class OutboxDatabase;
struct TrustRoot;

class SyncStageCommand final : public Command {
 public:
  explicit SyncStageCommand(SyncSurroundings surroundings = {}) : surroundings_(std::move(surroundings)) {}

  std::string_view group() const override { return "sync"; }
  std::string_view name() const override { return "stage"; }
  std::string_view summary() const override { return "take a flight's candidate tiles into the outbox"; }
  std::string_view details() const override;
  std::string_view examples() const override;
  bool offers_json() const override { return true; }

  void setup(Options& options) override;
  int run(Context& context) override;

 private:
  struct Sum {
    std::int64_t seen = 0, staged = 0, known = 0;
  };
  bool flight_ended(const CandidateReader& reader, Findings& findings) const;
  Sum take(CandidateReader& reader, OutboxDatabase* outbox, const TrustRoot* root, const PublicKey& key, UtcTime at,
           Context& context, Findings& findings) const;

  SyncSurroundings surroundings_;
  std::filesystem::path candidates_;
  std::filesystem::path outbox_;
  std::filesystem::path key_;
  std::optional<std::filesystem::path> trust_;
  std::optional<std::filesystem::path> recorder_;
  std::optional<UtcTime> at_;
  bool force_ = false;
  bool dry_run_ = false;
};

}  // namespace nadir
