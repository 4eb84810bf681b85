// nadir sync stage: takes a flight's candidate tiles into the outbox and signs what will be announced.
#include <fmt/format.h>

#include <filesystem>
#include <nlohmann/json.hpp>
#include <optional>
#include <ostream>
#include <set>

#include "base/error.hpp"
#include "cli/command.hpp"
#include "cli/options.hpp"
#include "cli/output.hpp"
#include "commands/commands.hpp"
#include "commands/sync/sync_environment.hpp"
#include "ortho/candidate_reader.hpp"
#include "ortho/tile_key_check.hpp"
#include "recorder/recording.hpp"
#include "upload/outbox_report.hpp"
#include "upload/staging.hpp"

namespace nadir {
namespace {

constexpr std::size_t kTilesPerTransaction = 256;

class Findings;
class CandidateReader;
class PublicKey;
class OutboxDatabase;
struct TrustRoot;

class SyncStageCommand final : public Command {
 public:
  explicit SyncStageCommand(SyncEnvironment environment) : environment_(std::move(environment)) {}

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

  SyncEnvironment environment_;
  std::filesystem::path candidates_;
  std::filesystem::path outbox_;
  std::filesystem::path key_;
  std::optional<std::filesystem::path> trust_;
  std::optional<std::filesystem::path> recorder_;
  std::optional<UtcTime> at_;
  bool force_ = false;
  bool dry_run_ = false;
};

std::string_view SyncStageCommand::details() const {
  return "CANDIDATES is the folder that nadird or `nadir ortho` wrote. Every tile is held against its sidecar and "
         "goes\n"
         "into the outbox once, however often this is called; what is new is signed in batches with the airframe's "
         "tile\n"
         "key. A flight that did not end orderly is refused: its recorder and its tiles should be looked at first.\n\n"
         "Exit codes: 0 staged, 1 refused or some tiles were not sound (the findings say which; the others are "
         "staged),\n"
         "2 could not be done.";
}

std::string_view SyncStageCommand::examples() const {
  return "nadir sync stage candidates --outbox outbox --key mini-07.key.pem\n"
         "nadir sync stage candidates --outbox outbox --key mini-07.key.pem --trust root.json --recorder recording";
}

void SyncStageCommand::setup(Options& options) {
  options.positional("CANDIDATES", candidates_, "folder of candidate tiles").required();
  options.value("--outbox", outbox_, "OUTBOX", "folder of the outbox; made when it is missing").required();
  options.value("--key", key_, "KEY.pem", "the airframe's tile key, which signs the batches").required();
  options.value("--trust", trust_, "ROOT.json", "check the tiles' and the key's signatures as the service will");
  options.value("--recorder", recorder_, "RECORDING", "the flight's recording: it must have ended cleanly too");
  options.value("--at", at_, "TIME", "judge keys as if it were this time");
  options.flag("--force", force_, "stage although the flight did not end orderly");
  options.flag("--dry-run", dry_run_, "check everything, change nothing");
}

// Whether the flight came to an orderly end, by the marks that its programs leave.
bool SyncStageCommand::flight_ended(const CandidateReader& reader, Findings& findings) const {
  const Severity severity = force_ ? Severity::warning : Severity::refuse;
  if (!reader.clean_shutdown()) {
    findings.add({.code = "flight.unfinished",
                  .severity = severity,
                  .where = candidates_.string(),
                  .expected = "the mark of an orderly end",
                  .found = "none: the flight goes on, or its program was killed",
                  .fix = "look at the flight first; --force stages what is there"});
  }
  if (recorder_) {
    const auto segments = read_recording(*recorder_, [](const Recorded&) {});
    const bool clean = !segments.empty() && segments.back().end && segments.back().end->clean_shutdown;
    if (!clean) {
      findings.add({.code = "flight.unfinished",
                    .severity = severity,
                    .where = recorder_->string(),
                    .expected = "a recording that ends with clean_shutdown",
                    .found = "one that was cut off",
                    .fix = "nadir recorder verify says more; --force stages all the same"});
    }
  }
  return !findings.refuses();
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
      if (check.findings.refuses()) continue;  // whatever airframe it names keeps no other tile
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
  if (flight_ended(reader, findings)) {
    std::optional<OutboxDatabase> outbox;
    if (!dry_run_) outbox.emplace(outbox_, OutboxDatabase::Access::make, environment_.hook);
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
                            {"dry_run", dry_run_}});
  }
  if (!findings.empty()) print_findings(context.out, findings);
  if (dry_run_) {
    context.out << fmt::format("{} tiles could be staged; nothing was changed\n", sum.seen);
  } else if (sum.seen > 0) {
    context.out << fmt::format("staged {} tiles, {} were there already; {} signed in {} batches\n", sum.staged,
                               sum.known, sealed.tiles, sealed.batches);
  }
  return findings.refuses() ? kRefused : kAccepted;
}

}  // namespace

std::unique_ptr<Command> make_sync_stage(SyncEnvironment environment) {
  return std::make_unique<SyncStageCommand>(std::move(environment));
}
std::unique_ptr<Command> make_sync_stage() { return make_sync_stage(SyncEnvironment{}); }

}  // namespace nadir
