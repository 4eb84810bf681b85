#include "commands/sync/prune.hpp"

#include <fmt/format.h>

#include <nlohmann/json.hpp>
#include <ostream>

#include "cli/options.hpp"
#include "cli/output.hpp"
#include "upload/outbox_upkeep.hpp"

namespace nadir {

std::string_view SyncPruneCommand::details() const {
  return "Only pictures go, and only those of tiles with a final verdict. What is known of each tile stays, so that "
         "no\n"
         "tile is staged again.\n\n"
         "Exit codes: 0 done, 2 could not be done.";
}

std::string_view SyncPruneCommand::examples() const { return "nadir sync prune outbox --keep-days 14"; }

void SyncPruneCommand::setup(Options& options) {
  options.positional("OUTBOX", outbox_, "folder of the outbox").required();
  options.value("--keep-days", keep_days_, "DAYS", "keep pictures so long after the verdict").between(0, 36'500);
  options.flag("--dry-run", dry_run_, "say what would go, delete nothing");
}

int SyncPruneCommand::run(Context& context) {
  OutboxDatabase outbox(outbox_, OutboxDatabase::Access::write, surroundings_.hook);
  const std::int64_t before_ms = surroundings_.pace()->now_ms() - keep_days_ * 86'400'000;
  const PruneSum sum = prune_blobs(outbox, before_ms, dry_run_);
  if (context.json) {
    print_json(context.out, {{"tiles", sum.tiles}, {"bytes", sum.bytes}, {"dry_run", dry_run_}});
  } else {
    context.out << fmt::format("{} the pictures of {} tiles, {:.1f} MB\n", dry_run_ ? "would delete" : "deleted",
                               sum.tiles, static_cast<double>(sum.bytes) / 1e6);
  }
  return kAccepted;
}

}  // namespace nadir
