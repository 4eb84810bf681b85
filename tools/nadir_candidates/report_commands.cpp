// nadir-candidates status, export and installed: what a service holds, read beside it.
#include <fmt/format.h>
#include <fmt/ranges.h>

#include <filesystem>
#include <nlohmann/json.hpp>
#include <optional>
#include <ostream>
#include <string>
#include <utility>
#include <vector>

#include "base/error.hpp"
#include "base/files.hpp"
#include "base/printable.hpp"
#include "candidates/candidate_catalogue.hpp"
#include "candidates/candidate_service.hpp"
#include "candidates/promoted_imagery.hpp"
#include "cli/options.hpp"
#include "cli/output.hpp"
#include "nadir_candidates/commands.hpp"
#include "nadir_candidates/service_folder.hpp"
#include "nadir_candidates/upload_api.hpp"

namespace nadir {
namespace {

// What a service's catalogue holds.
class StatusCommand final : public Command {
 public:
  std::string_view group() const override { return {}; }
  std::string_view name() const override { return "status"; }
  std::string_view summary() const override {
    return "count what the service holds: uploads, verdicts, promoted tiles";
  }
  std::string_view examples() const override { return "nadir-candidates status --data /srv/candidates --json"; }
  bool offers_json() const override { return true; }

  void setup(Options& options) override;
  int run(Context& context) override;

 private:
  ServicePlace place_;
};

void StatusCommand::setup(Options& options) { place_.declare(options, ServicePlace::Data::optional); }

// What the service was started with, and what is risky about it. A record that is damaged keeps nobody from the counts.
std::pair<std::optional<ServiceStart>, std::vector<std::string>> start_of(
    const std::optional<std::filesystem::path>& data) {
  if (!data) return {};
  try {
    auto start = read_service_start(*data);
    std::vector<std::string> warnings = start ? start->warnings() : std::vector<std::string>();
    return {std::move(start), std::move(warnings)};
  } catch (const Error& error) {
    return {std::nullopt, {printable(error.what())}};
  }
}

int StatusCommand::run(Context& context) {
  CandidateCatalogue catalogue(place_.location(), CandidateCatalogue::Access::read);
  const CatalogueCounts counts = catalogue.counts();
  const auto [start, warnings] = start_of(place_.data);
  if (context.json) {
    nlohmann::json rejected = nlohmann::json::object();
    for (const auto& [code, tiles] : counts.rejected_by) rejected[code] = tiles;
    nlohmann::json rules;
    if (start) {
      rules = {{"started_at", to_rfc3339(start->started_at)},
               {"votes", start->votes},
               {"independent", start->independent()},
               {"base_packages", start->base_packages}};
    }
    print_json(context.out, {{"uploads", {{"all", counts.uploads}, {"open", counts.open}, {"judging", counts.judging}}},
                             {"tiles",
                              {{"announced", counts.tiles},
                               {"accepted", counts.accepted},
                               {"rejected", counts.rejected},
                               {"duplicate", counts.duplicate},
                               {"to_vote", counts.to_vote},
                               {"promoted", counts.promoted}}},
                             {"rejected", std::move(rejected)},
                             {"claims", {{"held", counts.claims}, {"oldest_ms", counts.oldest_claim_ms}}},
                             {"rules", std::move(rules)},
                             {"warnings", warnings}});
    return kAccepted;
  }
  Figures figures{{"uploads", std::to_string(counts.uploads)},        {"  open", std::to_string(counts.open)},
                  {"  being judged", std::to_string(counts.judging)}, {"tiles announced", std::to_string(counts.tiles)},
                  {"  accepted", std::to_string(counts.accepted)},    {"  duplicate", std::to_string(counts.duplicate)},
                  {"  rejected", std::to_string(counts.rejected)}};
  for (const auto& [code, tiles] : counts.rejected_by) figures.emplace_back("    " + code, std::to_string(tiles));
  figures.emplace_back("waiting for a vote", std::to_string(counts.to_vote));
  figures.emplace_back("promoted", std::to_string(counts.promoted));
  if (counts.claims > 0) {
    figures.emplace_back("claims of workers", fmt::format("{}, the oldest for {:.1f} s", counts.claims,
                                                          static_cast<double>(counts.oldest_claim_ms) / 1000));
  }
  if (start) {
    figures.emplace_back("promotion needs",
                         fmt::format("{} flights, independent by {}", start->votes, start->independent()));
  }
  for (const std::string& warning : warnings) figures.emplace_back("warning", warning);
  print_figures(context.out, figures);
  return kAccepted;
}

// Promoted tiles as imagery for the next map.
class ExportCommand final : public Command {
 public:
  std::string_view group() const override { return {}; }
  std::string_view name() const override { return "export"; }
  std::string_view summary() const override { return "write the promoted tiles as imagery for `nadir cache build`"; }
  std::string_view details() const override;
  std::string_view examples() const override;
  bool offers_json() const override { return true; }

  void setup(Options& options) override;
  int run(Context& context) override;

 private:
  ServicePlace place_;
  std::filesystem::path out_;
};

std::string_view ExportCommand::details() const {
  return R"(OUT appears complete or not at all: a Cloud Optimized GeoTIFF for each day and each block of 16 by 16 tiles,
with a STAC Item beside it that holds its capture time, resolution and accuracy. It may run beside the service.
Exit code 1: nothing is promoted, and nothing was written.)";
}

std::string_view ExportCommand::examples() const {
  return R"(nadir-candidates export --data /srv/candidates --out promoted
nadir cache build --mission next.yaml --imagery promoted/*.tif --imagery map.tif --out next)";
}

void ExportCommand::setup(Options& options) {
  place_.declare(options, ServicePlace::Data::required);
  options.value("--out", out_, "OUT", "folder to create").required();
}

int ExportCommand::run(Context& context) {
  CandidateCatalogue catalogue(place_.location(), CandidateCatalogue::Access::read);
  const PackStore packs(*place_.data / "packs");
  std::vector<PromotedTile> tiles;
  catalogue.each_promoted([&tiles](const PromotedTile& tile) { tiles.push_back(tile); });
  nlohmann::json list = nlohmann::json::array();
  if (tiles.empty()) {
    if (context.json) {
      print_json(context.out, {{"images", list}});
    } else {
      context.out << "nothing is promoted\n";
    }
    return kRefused;
  }
  StagingDirectory staging(out_);
  for (const ExportedImage& image : write_promoted(std::move(tiles), packs, staging.path(), context.progress)) {
    const std::string file = (out_ / image.file.filename()).string();
    list.push_back({{"file", file},
                    {"tiles", image.tiles},
                    {"captured_at", to_rfc3339(image.captured_at)},
                    {"gsd_m", image.gsd_m},
                    {"ce90_m", image.ce90_m}});
    if (!context.json) {
      context.out << fmt::format("{}  {}, {}, GSD {:.2f} m, CE90 {:.1f} m\n", file, count(image.tiles, "tile"),
                                 to_rfc3339(image.captured_at).substr(0, 10), image.gsd_m, image.ce90_m);
    }
  }
  staging.commit();
  if (context.json) print_json(context.out, {{"images", std::move(list)}});
  return kAccepted;
}

// What package each aircraft flies, by its own report.
class InstalledCommand final : public Command {
 public:
  std::string_view group() const override { return {}; }
  std::string_view name() const override { return "installed"; }
  std::string_view summary() const override { return "list the packages that aircraft report to have installed"; }
  std::string_view details() const override;
  std::string_view examples() const override;
  bool offers_json() const override { return true; }

  void setup(Options& options) override;
  int run(Context& context) override;

 private:
  std::filesystem::path data_;
  std::optional<std::string> forget_;
};

std::string_view InstalledCommand::details() const {
  return R"(Each aircraft signs what it flies, and `nadir sync push` brings that here with its tiles. A report is
listed as it was signed; the notes say what the service finds odd about it. It may run beside the service.
Exit code 1: an aircraft flies a package that it refused, went back to an older one, reports by a root older
than the service's, or its report is damaged.)";
}

std::string_view InstalledCommand::examples() const {
  return R"(nadir-candidates installed --data /srv/candidates
nadir-candidates installed --data /srv/candidates --forget mini-07)";
}

void InstalledCommand::setup(Options& options) {
  options.value("--data", data_, "DIR", "the service's folder").required();
  options.value("--forget", forget_, "AIRFRAME", "forget its report: the next one is taken whatever its number");
}

// What is odd about a report; the newest root that the service has trusted.
std::vector<std::string> notes_on(const InstalledStore::Entry& entry, const std::optional<TrustRoot>& root) {
  std::vector<std::string> notes;
  if (!entry.record) return {"damaged: " + entry.damage};
  const InstalledReport& report = entry.record->report.report;
  if (!report.accepted) notes.emplace_back("refused this package");
  if (entry.record->went_back()) {
    notes.push_back(fmt::format("went back from sequence {}", entry.record->highest_sequence));
  }
  if (!root) return notes;
  if (report.root_version < root->version) notes.push_back(fmt::format("the service has root {}", root->version));
  const SignatureCheck check = check_installed_signature(*root, entry.record->report, std::nullopt);
  for (const Finding& finding : check.findings.items()) notes.push_back(finding.code);
  return notes;
}

int InstalledCommand::run(Context& context) {
  if (!std::filesystem::is_directory(data_)) {
    throw UsageError({.what = "there is no folder of a service",
                      .where = data_,
                      .expected = "the folder that serve was given",
                      .fix = "check --data"});
  }
  InstalledStore store(data_ / "installed");
  if (forget_) {
    if (!store.forget(*forget_)) {
      throw UsageError({.what = "this airframe has not reported",
                        .where = data_ / "installed",
                        .found = *forget_,
                        .fix = "without --forget, the command lists those that have"});
    }
    AuditLog(data_ / "audit", context.clock)
        .record({.act = "installed.report", .result = "forgotten", .subject = *forget_});
    context.out << fmt::format("forgotten: {}\n", printable(*forget_));
    return kAccepted;
  }
  std::optional<TrustRoot> root;
  if (std::filesystem::exists(data_ / kTrustMemoryFile)) root = read_trusted_root(data_ / kTrustMemoryFile);
  nlohmann::json list = nlohmann::json::array();
  bool odd = false;
  for (const InstalledStore::Entry& entry : store.list()) {
    const std::vector<std::string> notes = notes_on(entry, root);
    odd = odd || !notes.empty();
    if (context.json) {
      list.push_back(installed_json(entry));
      list.back()["notes"] = notes;
      continue;
    }
    const std::string said = notes.empty() ? std::string() : fmt::format("  [{}]", fmt::join(notes, "; "));
    if (!entry.record) {
      context.out << printable(entry.airframe + said) << '\n';
      continue;
    }
    const InstalledReport& report = entry.record->report.report;
    context.out << printable(fmt::format("{}  {} {}  package {}  root {}  verified {}  received {}{}", entry.airframe,
                                         report.series, report.sequence, report.package.hex().substr(0, 12),
                                         report.root_version, to_rfc3339(report.verified_at),
                                         to_rfc3339(entry.record->received_at), said))
                << '\n';
  }
  if (context.json) print_json(context.out, {{"aircraft", std::move(list)}});
  return odd ? kRefused : kAccepted;
}

}  // namespace

std::unique_ptr<Command> make_status() { return std::make_unique<StatusCommand>(); }
std::unique_ptr<Command> make_export() { return std::make_unique<ExportCommand>(); }
std::unique_ptr<Command> make_installed() { return std::make_unique<InstalledCommand>(); }

}  // namespace nadir
