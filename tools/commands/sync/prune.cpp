// nadir sync prune: gives the room of finished tiles back.
#include <fmt/format.h>

#include <cstdint>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <ostream>

#include "cli/command.hpp"
#include "cli/options.hpp"
#include "cli/output.hpp"
#include "commands/commands.hpp"
#include "commands/sync/sync_environment.hpp"
#include "upload/outbox_upkeep.hpp"

namespace nadir {
namespace {

class SyncPruneCommand final : public SyncCommand {
 public:
  using SyncCommand::SyncCommand;

  std::string_view name() const override { return "prune"; }
  std::string_view summary() const override { return "delete the images of tiles whose verdict is old enough"; }
  std::string_view details() const override;
  std::string_view examples() const override;

  void setup(Options& options) override;
  int run(Context& context) override;

 private:
  std::int64_t keep_days_ = 30;
  bool dry_run_ = false;
};

std::string_view SyncPruneCommand::details() const {
  return R"(Only images are deleted, and only those of tiles with a final verdict. The record of each tile
stays, so that no tile is staged twice.

Exit codes: 0 success, 2 the job could not be done.)";
}

std::string_view SyncPruneCommand::examples() const { return R"(nadir sync prune outbox --keep-days 14)"; }

void SyncPruneCommand::setup(Options& options) {
  options.positional("OUTBOX", outbox_, "outbox folder").required();
  options.value("--keep-days", keep_days_, "DAYS", "days to keep images after the verdict").between(0, 36'500);
  options.flag("--dry-run", dry_run_, "report what would be deleted, delete nothing");
}

int SyncPruneCommand::run(Context& context) {
  OutboxDatabase outbox(outbox_, OutboxDatabase::Access::write, environment_.hook);
  const std::int64_t before_ms = environment_.pace()->now_ms() - keep_days_ * 86'400'000;
  const PruneSum sum = prune_blobs(outbox, before_ms, dry_run_);
  if (context.json) {
    print_json(context.out, {{"tiles", sum.tiles}, {"bytes", sum.bytes}, {"dry_run", dry_run_}});
  } else {
    context.out << fmt::format("{} the images of {}, {:.1f} MB\n", dry_run_ ? "would delete" : "deleted",
                               count(static_cast<std::uint64_t>(sum.tiles), "tile"),
                               static_cast<double>(sum.bytes) / 1e6);
  }
  return kAccepted;
}

}  // namespace

std::unique_ptr<Command> make_sync_prune(SyncEnvironment environment) {
  return std::make_unique<SyncPruneCommand>(std::move(environment));
}
std::unique_ptr<Command> make_sync_prune() { return make_sync_prune(SyncEnvironment{}); }

}  // namespace nadir
