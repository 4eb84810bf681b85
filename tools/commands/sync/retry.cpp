#include "commands/sync/retry.hpp"

#include <fmt/format.h>

#include <nlohmann/json.hpp>
#include <ostream>

#include "base/error.hpp"
#include "upload/reason_code.hpp"
#include "cli/options.hpp"
#include "cli/output.hpp"
#include "upload/outbox_upkeep.hpp"
#include "upload/staging.hpp"

namespace nadir {

std::string_view SyncRetryCommand::details() const {
  return "Parked batches will be announced again by the next push, and those that wait will not wait any longer. With\n"
         "--code, tiles that were rejected or refused for this reason go into new batches, as far as their pictures "
         "are\n"
         "still there: for reasons that can pass, such as quota or base_package_unknown. With --key, parked batches "
         "of\n"
         "which something is damaged are taken apart: the damaged tiles are set aside, the others go into new "
         "batches.\n\n"
         "Exit codes: 0 done, 1 done, and damaged tiles were set aside (the findings name them), 2 could not be done.";
}

std::string_view SyncRetryCommand::examples() const {
  return "nadir sync retry outbox\n"
         "nadir sync retry outbox --code quota --key mini-07.key.pem";
}

void SyncRetryCommand::setup(Options& options) {
  options.positional("OUTBOX", outbox_, "folder of the outbox").required();
  options.values("--code", codes_, "REASON", "try tiles again that failed for this reason; may be given several times")
      .needs("--key");
  options.value("--key", key_, "KEY.pem", "the airframe's tile key, which signs the new batches");
}

int SyncRetryCommand::run(Context& context) {
  for (const std::string& code : codes_) {
    if (parse_reason_code(code)) continue;
    throw UsageError({.what = "there is no such reason",
                      .found = code,
                      .fix = "nadir sync status shows the reasons of this outbox's tiles"});
  }
  std::optional<PrivateKey> key;
  if (key_) key = PrivateKey::read(*key_);
  OutboxDatabase outbox(outbox_, OutboxDatabase::Access::write, surroundings_.hook);
  const std::int64_t now_ms = surroundings_.pace()->now_ms();
  // First what retry_parked() would announce again as it is.
  RepairSum mended;
  if (key) mended = repair_damaged_batches(outbox, key->public_key(), now_ms);
  const std::int64_t batches = retry_parked(outbox, now_ms);
  std::int64_t tiles = mended.tiles;
  for (const std::string& code : codes_) tiles += restage(outbox, code, now_ms);
  SealedSum sealed;
  if (key) sealed = seal_batches(outbox, *key, now_ms, surroundings_.random_bytes);
  Findings findings = std::move(mended.findings);
  findings.add(sealed.findings);
  if (context.json) {
    return report_findings(context.out, true, findings,
                           {{"batches", batches}, {"restaged", tiles}, {"new_batches", sealed.batches}});
  }
  if (!findings.empty()) print_findings(context.out, findings);
  context.out << fmt::format("{} batches may be tried at once; {} tiles go into {} new batches\n", batches, tiles,
                             sealed.batches);
  return findings.refuses() ? kRefused : kAccepted;
}

}  // namespace nadir
