// nadir-candidates work.
#include <fmt/format.h>

#include <chrono>
#include <filesystem>
#include <memory>
#include <optional>
#include <ostream>
#include <string>
#include <thread>
#include <vector>

#include "base/error.hpp"
#include "base/printable.hpp"
#include "candidates/candidate_service.hpp"
#include "candidates/evaluation_workers.hpp"
#include "cli/options.hpp"
#include "cli/output.hpp"
#include "cli/terminal.hpp"
#include "nadir_candidates/commands.hpp"
#include "nadir_candidates/service_folder.hpp"

namespace nadir {
namespace {

constexpr auto kLookAtSignals = std::chrono::milliseconds(100);
constexpr auto kLookAtFaults = std::chrono::seconds(1);

bool nothing_left(const CatalogueLocation& location) {
  const CatalogueCounts counts = CandidateCatalogue(location, CandidateCatalogue::Access::read).counts();
  return counts.judging == 0 && counts.to_vote == 0;
}

UsageError no_service(const std::filesystem::path& data) {
  return UsageError({.what = "no service was started with this folder",
                     .where = data,
                     .expected = "the folder that serve was given, on this machine or mounted from its own",
                     .fix = "start the service first: its rules are the workers'"});
}

// Judges tiles and lets flights vote beside a service, by its rules.
class WorkCommand final : public Command {
 public:
  std::string_view group() const override { return {}; }
  std::string_view name() const override { return "work"; }
  std::string_view summary() const override { return "judge tiles and let flights vote, beside a service on PostGIS"; }
  std::string_view details() const override;
  std::string_view examples() const override;
  bool offers_json() const override { return true; }

  void setup(Options& options) override;
  int run(Context& context) override;

 private:
  ServiceStart rules_of_service(const BaseMaps& maps) const;
  bool supervise(Context& context, const ServiceStart& start, const CatalogueLocation& catalogue,
                 EvaluationWorkers& workers) const;

  ServicePlace place_;
  std::vector<std::filesystem::path> packages_;
  int workers_ = 1;
  bool until_done_ = false;
};

std::string_view WorkCommand::details() const {
  return R"(As many processes as there are cores for it, on this machine and on others that see the service's folder. Each
address is worked on by one worker at a time, so what is decided does not depend on how many there are. A worker
may be killed at any moment: what it had not finished, another one does. The rules are those of the service's last
start; its --package must be given here as well. Ends with exit code 1 when the service starts by other rules.)";
}

std::string_view WorkCommand::examples() const {
  return R"(nadir-candidates work --data /srv/candidates --catalogue "PG:dbname=fleet" --workers 4
nadir-candidates work --data /mnt/candidates --catalogue "PG:dbname=fleet host=tiles" --until-done)";
}

void WorkCommand::setup(Options& options) {
  place_.declare(options, ServicePlace::Data::required);
  options.values("--package", packages_, "PACKAGE", "base packages of the flights, the same as the service's");
  options.value("--workers", workers_, "N", "threads, each with a connection of its own").between(1, 64);
  options.flag("--until-done", until_done_, "end when nothing is left to judge or to vote on");
}

// Those of its last start, which it was given the same packages for.
ServiceStart WorkCommand::rules_of_service(const BaseMaps& maps) const {
  const auto start = read_service_start(*place_.data);
  if (!start) throw no_service(*place_.data);
  if (start->packages != maps.packages() || start->base_packages != std::ssize(start->packages)) {
    throw UsageError({.what = "the base packages are not the service's",
                      .where = *place_.data / "started.json",
                      .expected = fmt::format("{} packages, those of the service's --package", start->base_packages),
                      .found = fmt::format("{} packages", maps.packages().size()),
                      .fix = "give each --package that the service was started with, in the same version"});
  }
  return *start;
}

int WorkCommand::run(Context& context) {
  const CatalogueLocation catalogue = place_.location();
  require_server(catalogue, "nadir-candidates work");
  const std::filesystem::path data = *place_.data;
  if (!std::filesystem::exists(data / kTrustMemoryFile)) throw no_service(data);
  const auto root = std::make_shared<const TrustRoot>(read_trusted_root(data / kTrustMemoryFile));
  const BaseMaps maps(packages_, *root, context.clock.now());
  const ServiceStart start = rules_of_service(maps);
  CandidateRules rules;
  rules.flights_to_promote = static_cast<int>(start.votes), rules.airframes_differ = start.airframes_differ;

  PackStore packs(data / "packs");
  AuditLog audit(data / "audit", context.clock);
  // A key that is revoked later is noted in the catalogue, and found there with each result.
  TileEvaluation evaluation(
      packs, maps, [root] { return root; }, audit, context.clock, rules);
  EvaluationWorkers workers(evaluation, catalogue, nullptr, workers_);
  audit.record({.act = "work.start", .result = "started", .detail = fmt::format("workers {}", workers_)});
  if (!context.quiet) context.err << fmt::format("working: {}\n", workers_) << std::flush;
  const bool same_rules = supervise(context, start, catalogue, workers);
  workers.stop();
  const WorkerCounts counts = workers.counts();
  audit.record({.act = "work.stop",
                .result = "stopped",
                .subject = fmt::format("tiles {}", counts.tiles),
                .detail = fmt::format("addresses {}, promoted {}", counts.addresses, counts.promoted)});
  if (context.json) {
    print_json(context.out, {{"tiles", counts.tiles},
                             {"addresses", counts.addresses},
                             {"promoted", counts.promoted},
                             {"failures", counts.failures},
                             {"busy_s", rounded(counts.busy_s)},
                             {"catalogue_s", rounded(counts.catalogue_s)}});
  }
  return same_rules ? kAccepted : kRefused;
}

// Until it is interrupted, or nothing is left, or the service runs by other rules: then false. Reports faults that come
// and go, and has failed work tried again.
bool WorkCommand::supervise(Context& context, const ServiceStart& start, const CatalogueLocation& catalogue,
                            EvaluationWorkers& workers) const {
  std::string reported;
  auto looked = std::chrono::steady_clock::now();
  while (!interrupt_requested()) {
    std::this_thread::sleep_for(kLookAtSignals);
    if (until_done_ && workers.idle() && nothing_left(catalogue)) return true;
    if (std::chrono::steady_clock::now() - looked < kLookAtFaults) continue;
    looked = std::chrono::steady_clock::now();
    if (const std::string fault = workers.fault(); fault != reported) {
      reported = fault;
      context.err << (fault.empty() ? "works again without a fault" : printable(fault)) << '\n' << std::flush;
    }
    workers.retry();
    const auto now = read_service_start(*place_.data);
    if (now && now->same_rules(start)) continue;
    context.err << "the service was started by other rules: start this again with its --package\n" << std::flush;
    return false;
  }
  return true;
}

}  // namespace

std::unique_ptr<Command> make_work() { return std::make_unique<WorkCommand>(); }

}  // namespace nadir
