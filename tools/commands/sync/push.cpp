// nadir sync push: brings the outbox to the candidate service.
#include <fmt/format.h>

#include <algorithm>
#include <cstdint>
#include <cstdlib>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <optional>
#include <ostream>
#include <string>

#include "base/error.hpp"
#include "base/printable.hpp"
#include "cli/command.hpp"
#include "cli/options.hpp"
#include "cli/output.hpp"
#include "commands/commands.hpp"
#include "commands/sync/sync_environment.hpp"
#include "trust/bearer_token.hpp"
#include "upload/outbox_upkeep.hpp"
#include "upload/transport.hpp"
#include "upload/uploader.hpp"

namespace nadir {
namespace {

constexpr const char* kTokenVariable = "NADIR_SYNC_TOKEN";
constexpr std::int64_t kShortestStall_s = 5;  // that ends a request, however short --timeout-s is

std::uint64_t seed_from(const std::array<std::uint8_t, 16>& bytes) {
  std::uint64_t seed = 0;
  for (std::size_t i = 0; i < 8; ++i) seed = seed << 8 | bytes[i];
  return seed;
}

int exit_code(const UploadOutcome& outcome) {
  if (!outcome.finished) return kFailed;
  const std::int64_t not_taken = outcome.verdicts.rejected + outcome.refused + outcome.parked + outcome.reports_refused;
  return not_taken > 0 ? kRefused : kAccepted;
}

nlohmann::json json_from(const UploadOutcome& outcome) {
  return {
      {"accepted", outcome.verdicts.accepted},
      {"duplicate", outcome.verdicts.duplicate},
      {"rejected", outcome.verdicts.rejected},
      {"refused", outcome.refused},
      {"parked", outcome.parked},
      {"finished", outcome.finished},
      {"waits_for", outcome.waits_for},
      {"reports",
       {{"sent", outcome.reports_sent}, {"refused", outcome.reports_refused}, {"waiting", outcome.reports_waiting}}},
      {"retries", outcome.retries},
      {"body_bytes", outcome.body_bytes}};
}

class SyncPushCommand final : public SyncCommand {
 public:
  using SyncCommand::SyncCommand;

  std::string_view name() const override { return "push"; }
  std::string_view summary() const override {
    return "send the outbox to the candidate service and fetch the verdicts";
  }
  std::string_view details() const override;
  std::string_view examples() const override;

  void setup(Options& options) override;
  int run(Context& context) override;

 private:
  std::string token() const;
  int dry_run(Context& context) const;

  std::string to_;
  std::optional<std::filesystem::path> token_file_;
  std::optional<std::filesystem::path> authorities_;
  std::int64_t patience_s_ = 900;
  bool dry_run_ = false;
};

std::string_view SyncPushCommand::details() const {
  return R"(May be interrupted, killed and restarted at any time: it resumes at any byte, and no tile is lost or
counted twice. If the service fails, it waits with increasing delays (or as long as the service
requests) and gives up for now if there is no progress for --timeout-s. An answer slower than 512
bytes/s for that time, 60 s at most, counts as none. The service's certificate is verified. The token
comes from --token-file or from the environment variable NADIR_SYNC_TOKEN. The aircraft's report of
what it has installed goes first.

Exit codes: 0 every tile is accepted, 1 some were rejected, refused or parked (nadir sync status
states why), or a report was refused, 2 not complete: run it again, 130 interrupted.)";
}

std::string_view SyncPushCommand::examples() const {
  return R"(nadir sync push outbox --to https://tiles.example.org --token-file token
nadir sync push outbox --to https://tiles.example.org --token-file token --timeout-s 60 --json)";
}

void SyncPushCommand::setup(Options& options) {
  options.positional("OUTBOX", outbox_, "outbox folder").required();
  options.value("--to", to_, "URL", "service: https://HOST[:PORT][/PATH]; http:// only to localhost").required();
  options.value("--token-file", token_file_, "FILE", "bearer token of the service; readable by its owner only");
  options.value("--ca", authorities_, "FILE.pem", "trust these certificate authorities instead of the system's");
  options.value("--timeout-s", patience_s_, "S", "give up for now without progress for this time")
      .between(0, 86'400)
      .formerly("--patience");
  options.flag("--dry-run", dry_run_, "report what would be sent, without connecting");
}

std::string SyncPushCommand::token() const {
  if (token_file_) return read_bearer_token(*token_file_);
  const char* text = std::getenv(kTokenVariable);
  if (text == nullptr) {
    throw UsageError({.what = "no token given",
                      .expected = fmt::format("--token-file FILE, or {} in the environment", kTokenVariable),
                      .fix = "ask the operator of the service for one; never put it on the command line"});
  }
  return checked_bearer_token(text, kTokenVariable);
}

int SyncPushCommand::dry_run(Context& context) const {
  const OutboxDatabase outbox(outbox_, OutboxDatabase::Access::read);
  const OutboxReport report = report_outbox(outbox);
  StateSum unsent;
  for (const TileState state : {TileState::sealed, TileState::announced, TileState::sending, TileState::waiting}) {
    unsent.tiles += report.states.at(state).tiles;
    unsent.bytes += report.states.at(state).bytes;
  }
  const std::int64_t awaited = report.states.at(TileState::sent).tiles;
  if (context.json) {
    print_json(context.out,
               {{"dry_run", true}, {"to_send", unsent.tiles}, {"bytes", unsent.bytes}, {"verdicts_awaited", awaited}});
  } else {
    context.out << fmt::format(
        "{} would be sent, at most {:.1f} MB; {} pending\n", count(static_cast<std::uint64_t>(unsent.tiles), "tile"),
        static_cast<double>(unsent.bytes) / 1e6, count(static_cast<std::uint64_t>(awaited), "verdict"));
  }
  return kAccepted;
}

int SyncPushCommand::run(Context& context) {
  const std::string address = checked_service_address(to_);
  if (dry_run_) return dry_run(context);
  const std::string bearer = token();
  OutboxDatabase outbox(outbox_, OutboxDatabase::Access::write, environment_.hook);
  const auto transport = environment_.transport(
      std::make_unique<CurlTransport>(CurlSettings{.address = address,
                                                   .token = bearer,
                                                   .authorities = authorities_,
                                                   .stall_timeout_s = static_cast<int>(std::clamp<std::int64_t>(
                                                       patience_s_, kShortestStall_s, CurlSettings{}.stall_timeout_s))},
                                      [&context] { context.progress.advance(0); }));
  ServiceClient service(*transport);
  const auto pace = environment_.pace();
  const UploadLog tell = [&context](const std::string& line) {
    if (!context.quiet) context.err << printable(line) << std::endl;
  };
  Uploader uploader(outbox, service,
                    {.clock = *pace,
                     .random = Random(seed_from(environment_.random_bytes())),
                     .progress = context.progress,
                     .log = tell},
                    {.patience_ms = patience_s_ * 1'000});
  const UploadOutcome outcome = uploader.run();
  if (context.json) {
    print_json(context.out, json_from(outcome));
    return exit_code(outcome);
  }
  context.out << fmt::format("accepted {}, accepted before {}, rejected {}, refused {}, parked {}\n",
                             outcome.verdicts.accepted, outcome.verdicts.duplicate, outcome.verdicts.rejected,
                             outcome.refused, outcome.parked);
  if (!outcome.finished) {
    context.out << fmt::format("not complete: {}; run this command again to resume\n", printable(outcome.waits_for));
  }
  return exit_code(outcome);
}

}  // namespace

std::unique_ptr<Command> make_sync_push(SyncEnvironment environment) {
  return std::make_unique<SyncPushCommand>(std::move(environment));
}
std::unique_ptr<Command> make_sync_push() { return make_sync_push(SyncEnvironment{}); }

}  // namespace nadir
