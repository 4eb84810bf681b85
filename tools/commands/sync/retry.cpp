// nadir sync retry: retries uploads that were given up.
#include <fmt/format.h>

#include <filesystem>
#include <nlohmann/json.hpp>
#include <optional>
#include <ostream>
#include <string>
#include <vector>

#include "base/error.hpp"
#include "cli/command.hpp"
#include "cli/options.hpp"
#include "cli/output.hpp"
#include "commands/commands.hpp"
#include "commands/sync/sync_environment.hpp"
#include "upload/outbox_upkeep.hpp"
#include "upload/reason_code.hpp"
#include "upload/staging.hpp"

namespace nadir {
namespace {

class SyncRetryCommand final : public SyncCommand {
 public:
  using SyncCommand::SyncCommand;

  std::string_view name() const override { return "retry"; }
  std::string_view summary() const override {
    return "retry tiles that were parked, or rejected for a temporary reason";
  }
  std::string_view details() const override;
  std::string_view examples() const override;

  void setup(Options& options) override;
  int run(Context& context) override;

 private:
  std::vector<std::string> codes_;
  std::optional<std::filesystem::path> key_;
};

std::string_view SyncRetryCommand::details() const {
  return R"(Parked batches are announced again by the next push, and waiting ones no longer wait. With --code,
tiles that were rejected or refused for this reason go into new batches, if their images still
exist: for temporary reasons, such as quota or base_package_unknown. With --key, parked batches with
damaged tiles are split: the damaged tiles are set aside, the others go into new batches.

Exit codes: 0 success, 1 success, but damaged tiles were set aside (the findings name them), 2 the
job could not be done.)";
}

std::string_view SyncRetryCommand::examples() const {
  return R"(nadir sync retry outbox
nadir sync retry outbox --code quota --key mini-07.key.pem)";
}

void SyncRetryCommand::setup(Options& options) {
  options.positional("OUTBOX", outbox_, "outbox folder").required();
  options.values("--code", codes_, "REASON", "retry tiles that failed for this reason; may be repeated").needs("--key");
  options.value("--key", key_, "KEY.pem", "private tile key of the airframe, which signs the new batches");
}

int SyncRetryCommand::run(Context& context) {
  for (const std::string& code : codes_) {
    if (parse_reason_code(code)) continue;
    throw UsageError(
        {.what = "unknown reason", .found = code, .fix = "nadir sync status lists the reasons in this outbox"});
  }
  std::optional<PrivateKey> key;
  if (key_) key = PrivateKey::read(*key_);
  OutboxDatabase outbox(outbox_, OutboxDatabase::Access::write, environment_.hook);
  const std::int64_t now_ms = environment_.pace()->now_ms();
  // Before retry_parked(), which announces these tiles again unchanged.
  RepairSum repaired;
  if (key) repaired = repair_damaged_batches(outbox, key->public_key(), now_ms);
  const std::int64_t batches = retry_parked(outbox, now_ms);
  std::int64_t tiles = repaired.tiles;
  for (const std::string& code : codes_) tiles += restage(outbox, code, now_ms);
  SealedSum sealed;
  if (key) sealed = seal_batches(outbox, *key, now_ms, environment_.random_bytes);
  Findings findings = std::move(repaired.findings);
  findings.add(sealed.findings);
  if (context.json) {
    return report_findings(context.out, true, findings,
                           {{"batches", batches}, {"restaged", tiles}, {"new_batches", sealed.batches}});
  }
  if (!findings.empty()) print_findings(context.out, findings);
  context.out << fmt::format("{} can be retried now; {} put into {}\n",
                             count(static_cast<std::uint64_t>(batches), "batch", "batches"),
                             count(static_cast<std::uint64_t>(tiles), "tile"),
                             count(static_cast<std::uint64_t>(sealed.batches), "new batch", "new batches"));
  return findings.has_errors() ? kRefused : kAccepted;
}

}  // namespace

std::unique_ptr<Command> make_sync_retry(SyncEnvironment environment) {
  return std::make_unique<SyncRetryCommand>(std::move(environment));
}
std::unique_ptr<Command> make_sync_retry() { return make_sync_retry(SyncEnvironment{}); }

}  // namespace nadir
