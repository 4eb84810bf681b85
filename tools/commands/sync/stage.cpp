// nadir sync stage: takes a flight's candidate tiles into the outbox and signs what will be announced.
#include <fmt/format.h>

#include <filesystem>
#include <nlohmann/json.hpp>
#include <optional>
#include <ostream>
#include <set>

#include "base/error.hpp"
#include "base/files.hpp"
#include "cli/command.hpp"
#include "cli/options.hpp"
#include "cli/output.hpp"
#include "commands/commands.hpp"
#include "commands/sync/sync_environment.hpp"
#include "ortho/candidate_store.hpp"
#include "ortho/tile_key_check.hpp"
#include "recorder/recording.hpp"
#include "trust/installed_report.hpp"
#include "upload/outbox_upkeep.hpp"
#include "upload/staging.hpp"

namespace nadir {
namespace {

constexpr std::size_t kTilesPerTransaction = 256;

class SyncStageCommand final : public SyncCommand {
 public:
  using SyncCommand::SyncCommand;

  std::string_view name() const override { return "stage"; }
  std::string_view summary() const override { return "add a flight's candidate tiles to the outbox"; }
  std::string_view details() const override;
  std::string_view examples() const override;

  void setup(Options& options) override;
  int run(Context& context) override;

 private:
  struct Sum {
    std::int64_t seen = 0, staged = 0, known = 0;
  };
  bool flight_ended(const CandidateReader& reader, Findings& findings) const;
  std::optional<SignedInstalledReport> installed_report(const TrustRoot* root, UtcTime at, Findings& findings) const;
  Sum take(CandidateReader& reader, OutboxDatabase* outbox, const TrustRoot* root, const PublicKey& key, UtcTime at,
           Context& context, Findings& findings) const;

  std::filesystem::path candidates_;
  std::filesystem::path key_;
  std::optional<std::filesystem::path> trust_;
  std::optional<std::filesystem::path> recorder_;
  std::optional<UtcTime> at_;
  bool force_ = false;
  bool dry_run_ = false;
};

std::string_view SyncStageCommand::details() const {
  return R"(CANDIDATES is the folder that nadird or `nadir ortho` wrote. Every tile is checked against its
sidecar and added to the outbox once, however often this command runs; new tiles are signed in
batches with the airframe's tile key. A flight without a clean shutdown is rejected: inspect its
recording and its tiles first.

Exit codes: 0 staged, 1 rejected, or some tiles were invalid (the findings name them; the others are
staged), 2 the job could not be done.)";
}

std::string_view SyncStageCommand::examples() const {
  return R"(nadir sync stage candidates --outbox outbox --key mini-07.key.pem
nadir sync stage candidates --outbox outbox --key mini-07.key.pem --trust root.json --recorder recording)";
}

void SyncStageCommand::setup(Options& options) {
  options.positional("CANDIDATES", candidates_, "folder with the candidate tiles").required();
  options.value("--outbox", outbox_, "OUTBOX", "outbox folder; created if missing").required();
  options.value("--key", key_, "KEY.pem", "private tile key of the airframe, which signs the batches").required();
  options.value("--trust", trust_, "ROOT.json", "check the signatures of tiles and key as the service will");
  options.value("--recorder", recorder_, "RECORDING", "recording of the flight: it must have a clean shutdown too");
  options.value("--at", at_, "TIME", "evaluate validity as of this time");
  options.flag("--force", force_, "stage even without a clean shutdown");
  options.flag("--dry-run", dry_run_, "check everything, change nothing");
}

// Whether the flight came to an orderly end, by the marks that its programs leave.
bool SyncStageCommand::flight_ended(const CandidateReader& reader, Findings& findings) const {
  const Severity severity = force_ ? Severity::warning : Severity::error;
  if (!reader.clean_shutdown()) {
    findings.add({.code = "flight.unfinished",
                  .severity = severity,
                  .where = candidates_.string(),
                  .expected = "the mark of a clean shutdown",
                  .found = "none: the flight is still running, or its program was killed",
                  .fix = "inspect the flight first; --force stages what exists"});
  }
  if (recorder_) {
    const auto segments = read_recording(*recorder_, [](const Recorded&) {});
    const bool clean = !segments.empty() && segments.back().end && segments.back().end->clean_shutdown;
    if (!clean) {
      findings.add({.code = "flight.unfinished",
                    .severity = severity,
                    .where = recorder_->string(),
                    .expected = "a recording that ends with clean_shutdown",
                    .found = "a truncated recording",
                    .fix = "run nadir recorder verify for details; --force stages anyway"});
    }
  }
  return !findings.has_errors();
}

// What the aircraft reported beside its tiles. One that is damaged or not the airframe's is a warning: it costs no
// tile.
std::optional<SignedInstalledReport> SyncStageCommand::installed_report(const TrustRoot* root, UtcTime at,
                                                                        Findings& findings) const {
  const std::filesystem::path file = candidates_ / kInstalledFile;
  if (!std::filesystem::exists(std::filesystem::symlink_status(file))) return std::nullopt;
  Finding invalid{.code = "installed.invalid",
                  .severity = Severity::warning,
                  .where = file.string(),
                  .expected = "the airframe's signed report of its package",
                  .fix = "the tiles are staged without it; inspect the aircraft's storage"};
  try {
    auto report = parse_installed_report(read_text_file(file, kMaxInstalledSize), file.string());
    if (root == nullptr) return report;
    const SignatureCheck check = check_installed_signature(*root, report, at);
    if (!check.findings.has_errors()) return report;
    invalid.found = check.findings.items().front().code + ": " + check.findings.items().front().found;
  } catch (const Error& error) {
    invalid.found = error.text().found.empty() ? error.text().what : error.text().found;
  }
  findings.add(std::move(invalid));
  return std::nullopt;
}

SyncStageCommand::Sum SyncStageCommand::take(CandidateReader& reader, OutboxDatabase* outbox, const TrustRoot* root,
                                             const PublicKey& key, UtcTime at, Context& context,
                                             Findings& findings) const {
  Sum sum;
  const std::int64_t now_ms = environment_.pace()->now_ms();
  std::vector<Candidate> ready;
  std::set<std::string> checked;  // airframes whose batches the key may sign
  const auto flush = [&] {
    if (outbox == nullptr || ready.empty()) return;
    const std::int64_t staged = stage_candidates(*outbox, ready, now_ms);
    sum.staged += staged;
    sum.known += static_cast<std::int64_t>(ready.size()) - staged;
    ready.clear();
  };
  context.progress.begin("staging", reader.rows(), "tiles");
  while (auto candidate = reader.next(findings)) {
    ++sum.seen;
    context.progress.advance();
    if (root != nullptr) {
      const auto check =
          check_candidate_signature(*root, candidate->sidecar, candidate->sidecar_bytes, candidate->signature, at);
      findings.add(check.findings);
      if (check.findings.has_errors()) continue;  // whatever airframe it names keeps no other tile
      if (checked.insert(candidate->sidecar.airframe).second) {
        require_tile_key(*root, candidate->sidecar.airframe, key);
      }
    }
    ready.push_back(std::move(*candidate));
    if (ready.size() == kTilesPerTransaction) flush();
  }
  flush();
  context.progress.end();
  return sum;
}

int SyncStageCommand::run(Context& context) {
  const PrivateKey key = PrivateKey::read(key_);
  const UtcTime at = evaluation_time(at_, context.clock);
  std::optional<TrustRoot> root;
  if (trust_) root = read_trusted_root(*trust_);
  CandidateReader reader(candidates_);
  Findings findings;
  Sum sum;
  SealedSum sealed;
  const auto report = installed_report(root ? &*root : nullptr, at, findings);
  bool report_staged = false;
  if (flight_ended(reader, findings)) {
    std::optional<OutboxDatabase> outbox;
    if (!dry_run_) outbox.emplace(outbox_, OutboxDatabase::Access::make, environment_.hook);
    if (outbox && report) report_staged = stage_installed(*outbox, *report);
    sum = take(reader, outbox ? &*outbox : nullptr, root ? &*root : nullptr, key.public_key(), at, context, findings);
    if (outbox) {
      sealed = seal_batches(*outbox, key, environment_.pace()->now_ms(), environment_.random_bytes);
      findings.add(sealed.findings);
    }
  }
  if (context.json) {
    return report_findings(context.out, true, findings,
                           {{"tiles", sum.seen},
                            {"staged", sum.staged},
                            {"known", sum.known},
                            {"batches", sealed.batches},
                            {"sealed", sealed.tiles},
                            {"report", report_staged},
                            {"dry_run", dry_run_}});
  }
  if (!findings.empty()) print_findings(context.out, findings);
  if (dry_run_) {
    context.out << fmt::format("{} could be staged; nothing was changed\n",
                               count(static_cast<std::uint64_t>(sum.seen), "tile"));
  } else if (sum.seen > 0) {
    context.out << fmt::format("staged {}, {} already staged; {} signed in {}\n",
                               count(static_cast<std::uint64_t>(sum.staged), "tile"), sum.known, sealed.tiles,
                               count(static_cast<std::uint64_t>(sealed.batches), "batch", "batches"));
  }
  return findings.has_errors() ? kRefused : kAccepted;
}

}  // namespace

std::unique_ptr<Command> make_sync_stage(SyncEnvironment environment) {
  return std::make_unique<SyncStageCommand>(std::move(environment));
}
std::unique_ptr<Command> make_sync_stage() { return make_sync_stage(SyncEnvironment{}); }

}  // namespace nadir
