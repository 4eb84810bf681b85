// nadir-candidates: serve, status, export and installed; what concerns tokens: token_commands.cpp.
#include <fcntl.h>
#include <fmt/format.h>
#include <fmt/ranges.h>
#include <sys/file.h>
#include <sys/ioctl.h>
#include <unistd.h>

#include <cerrno>
#include <chrono>
#include <filesystem>
#include <iostream>
#include <nlohmann/json.hpp>
#include <optional>
#include <ostream>
#include <string>
#include <thread>
#include <vector>

#include "base/error.hpp"
#include "base/files.hpp"
#include "base/printable.hpp"
#include "candidates/candidate_catalogue.hpp"
#include "candidates/candidate_service.hpp"
#include "candidates/promoted_imagery.hpp"
#include "cli/command.hpp"
#include "cli/options.hpp"
#include "cli/output.hpp"
#include "cli/program.hpp"
#include "cli/terminal.hpp"
#include "nadir_candidates/token_commands.hpp"
#include "nadir_candidates/upload_server.hpp"
#include "nadir_candidates/work_queue.hpp"

namespace nadir {
namespace {

constexpr std::size_t kQueuedPerClient = 16;  // requests
constexpr auto kPollInterval = std::chrono::milliseconds(100);
constexpr int kPollsBetweenTokens = 5;
constexpr int kPollsBetweenRetries = 50;
constexpr int kPollsBetweenCleanups = 36'000;  // an hour

// Of --data and --catalogue. Throws UsageError when neither is given.
CatalogueLocation catalogue_location(const std::string& catalogue, const std::optional<std::filesystem::path>& data) {
  if (!catalogue.empty()) return parse_catalogue_location(catalogue);
  if (data) return parse_catalogue_location((*data / "catalogue.sqlite").string());
  throw UsageError({.what = "no catalogue given", .expected = "--data DIR or --catalogue CATALOGUE"});
}

// The folder of a service, held by one process at a time.
class DataFolder {
 public:
  // Creates it where it is missing. Throws Error when another process holds it.
  explicit DataFolder(const std::filesystem::path& path) {
    std::error_code code;
    std::filesystem::create_directories(path, code);
    if (code) throw Error({.what = "cannot create the service's folder", .where = path, .found = code.message()});
    lock_ = ::open((path / ".lock").c_str(), O_RDWR | O_CREAT | O_CLOEXEC | O_NOFOLLOW, 0644);
    if (lock_ < 0) {
      throw Error({.what = "cannot write to the service's folder", .where = path, .found = system_error_text(errno)});
    }
    if (::flock(lock_, LOCK_EX | LOCK_NB) != 0) {
      ::close(lock_);
      throw Error(
          {.what = "another service uses this folder", .where = path, .fix = "stop it first, or use another --data"});
    }
  }
  ~DataFolder() { ::close(lock_); }
  DataFolder(const DataFolder&) = delete;
  DataFolder& operator=(const DataFolder&) = delete;

 private:
  int lock_ = -1;
};

// Runs the service.
class ServeCommand final : public Command {
 public:
  std::string_view group() const override { return {}; }
  std::string_view name() const override { return "serve"; }
  std::string_view summary() const override { return "accept and evaluate candidate tiles, and let flights vote"; }
  std::string_view details() const override;
  std::string_view examples() const override;

  void setup(Options& options) override;
  int run(Context& context) override;

 private:
  void complete_rules();

  CandidateServiceOptions service_;
  std::filesystem::path data_;
  std::string catalogue_;
  std::string listen_ = "127.0.0.1:8760";
  std::vector<std::string> token_files_;
  std::optional<std::filesystem::path> tokens_;
  std::optional<std::filesystem::path> port_file_;
  int threads_ = 2;
  int max_age_days_ = 90;
  int quota_mb_ = 8192;
  int keep_free_mb_ = 1024;
  std::string independent_ = "airframes";
};

std::string_view ServeCommand::details() const {
  return R"(Listens until it is interrupted. Whatever it has answered is on the disk: it may be killed at any moment and
resumes where it was. It does not speak TLS: beyond this machine, run it behind a proxy that does. Tiles are
evaluated when their upload is complete; one is promoted when --votes independent flights show the same
ground at the same place. The trust root is read again whenever its file changes, and its newest version is
remembered over restarts. So are the tokens. Who did what stands in DIR/audit/audit.jsonl.)";
}

std::string_view ServeCommand::examples() const {
  return R"(nadir-candidates serve --data /srv/candidates --trust root.json --tokens tokens.json
nadir-candidates serve --data /srv/candidates --trust root.json --token-file mini-07=field.token \
    --package /srv/packages/valley-12 --catalogue "PG:dbname=fleet" --votes 3)";
}

void ServeCommand::setup(Options& options) {
  options.value("--data", data_, "DIR", "folder for packs, uploads and the catalogue; created when missing").required();
  options.value("--trust", service_.trust, "FILE", "the trust root, with the airframes' tile signers").required();
  options.value("--tokens", tokens_, "FILE",
                "the clients' tokens, with scope and expiry: `nadir-candidates token create` makes it");
  options.values("--token-file", token_files_, "[AIRFRAME=]FILE",
                 "bearer token of a client, without expiry; the file name is the client's name");
  options.value("--listen", listen_, "IP:PORT", "address to listen on");
  options.value("--catalogue", catalogue_, "CATALOGUE",
                "a SpatiaLite file or \"PG:…\"; DATA/catalogue.sqlite without it");
  options.values("--package", service_.packages, "PACKAGE",
                 "base packages of the flights, verified against --trust; tiles of other packages are rejected");
  options.value("--votes", service_.rules.flights_to_promote, "N", "flights that must agree").between(2, 10);
  options
      .value("--independent", independent_, "WHAT",
             "which flights count as independent: only those of other airframes, or also those of other days: "
             "then one stolen key promotes tiles by itself")
      .one_of({"airframes", "days"});
  options.value("--max-age-days", max_age_days_, "N", "older tiles are refused").between(1, 3650);
  options.value("--quota-mb", quota_mb_, "N", "megabytes that an airframe may announce per day").between(1, 1'000'000);
  options.value("--keep-free-mb", keep_free_mb_, "N", "free megabytes on the disk below which no upload is accepted")
      .between(0, 1'000'000);
  options.value("--threads", threads_, "N", "worker threads").between(1, 64);
  options.value("--port-file", port_file_, "FILE", "write the port here once listening; for --listen IP:0");
}

void ServeCommand::complete_rules() {
  service_.rules.airframes_differ = independent_ == "airframes";
  service_.rules.max_age_ms = max_age_days_ * kDay_ms;
  service_.rules.quota_bytes = std::int64_t{quota_mb_} * 1'000'000;
  service_.keep_free_bytes = std::uint64_t{static_cast<unsigned>(keep_free_mb_)} * 1'000'000;
}

int ServeCommand::run(Context& context) {
  const ListenAddress address = parse_listen_address(listen_);
  if (token_files_.empty() && !tokens_) {
    throw UsageError({.what = "nobody could call this service",
                      .expected = "--tokens FILE or --token-file FILE",
                      .fix = "nadir-candidates token create --tokens FILE --id NAME --out NAME.token"});
  }
  Clients clients(token_files_, tokens_);
  complete_rules();
  const DataFolder folder(data_);
  service_.data = data_;
  service_.catalogue =
      parse_catalogue_location(catalogue_.empty() ? (data_ / "catalogue.sqlite").string() : catalogue_);
  CandidateService service(service_, context.clock);
  service.recover();
  const auto warn = [&context, &service](const char* act, const std::string& text) {
    context.err << "warning: " << printable(text) << '\n' << std::flush;
    service.audit().record({.act = act, .result = "warning", .detail = text});
  };
  service.audit().record({.act = "service.start",
                          .result = "started",
                          .detail = fmt::format("{} flights, independent by {}; base packages {}; tokens {}",
                                                service_.rules.flights_to_promote, independent_,
                                                service_.packages.size(), clients.all().size())});
  if (service.first_trust()) {
    warn("root.trust", fmt::format("no earlier trust root is remembered: version {} of {} is trusted as it is",
                                   service.root_version(), service_.trust.string()));
  }
  if (!service_.rules.airframes_differ) {
    warn("rules", "--independent days: one airframe's key, lost or stolen, promotes tiles by itself");
  }
  if (service_.packages.empty()) {
    warn("rules", "without --package no tile is compared with a map, and tiles over any package are taken");
  }
  if (!token_files_.empty()) {
    warn("rules", "tokens of --token-file do not expire; nadir-candidates token create makes such that do");
  }

  FairQueue queue(static_cast<std::size_t>(threads_), kQueuedPerClient);
  ServiceWork work(service, queue);
  const UploadApi api(service, clients, address.loopback(),
                      [&work](const UploadClient& client, std::int64_t upload) { work.evaluate(client.name, upload); });
  const UploadServer server(api, queue, address);
  for (const auto& [client, upload] : service.pending_evaluations()) work.evaluate(client, upload);
  work.vote();
  if (port_file_) write_file_atomic(*port_file_, fmt::format("{}\n", server.port()));
  if (!context.quiet) context.err << fmt::format("listening on {}:{}\n", address.ip, server.port()) << std::flush;
  std::string reported;
  for (int polls = 1; !interrupt_requested(); ++polls) {
    std::this_thread::sleep_for(kPollInterval);
    if (polls % kPollsBetweenRetries == 0) {
      std::string fault = work.fault();
      if (fault.empty()) fault = clients.fault();
      if (fault.empty()) fault = service.fault().reason;
      if (fault != reported) {
        reported = fault;
        context.err << (fault.empty() ? "works again without a fault" : printable(fault)) << '\n' << std::flush;
        service.audit().record(
            {.act = "service.fault", .result = fault.empty() ? "gone" : "reported", .detail = fault});
      }
      work.retry();
      work.apply_revocations();
      service.keep_audit();
    }
    if (polls % kPollsBetweenTokens == 0 && clients.reload()) {
      service.audit().record({.act = "tokens.load",
                              .result = "loaded",
                              .subject = tokens_->string(),
                              .detail = fmt::format("tokens {}", clients.all().size())});
    }
    if (polls % kPollsBetweenCleanups == 0) work.forget_expired();
  }
  service.audit().record({.act = "service.stop", .result = "stopped"});
  return kAccepted;
}

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
  std::optional<std::filesystem::path> data_;
  std::string catalogue_;
};

void StatusCommand::setup(Options& options) {
  options.value("--data", data_, "DIR", "the service's folder");
  options.value("--catalogue", catalogue_, "CATALOGUE", "if it is not DATA/catalogue.sqlite");
}

int StatusCommand::run(Context& context) {
  CandidateCatalogue catalogue(catalogue_location(catalogue_, data_), CandidateCatalogue::Access::read);
  const CatalogueCounts counts = catalogue.counts();
  if (context.json) {
    nlohmann::json rejected = nlohmann::json::object();
    for (const auto& [code, tiles] : counts.rejected_by) rejected[code] = tiles;
    print_json(context.out, {{"uploads", {{"all", counts.uploads}, {"open", counts.open}, {"judging", counts.judging}}},
                             {"tiles",
                              {{"announced", counts.tiles},
                               {"accepted", counts.accepted},
                               {"rejected", counts.rejected},
                               {"duplicate", counts.duplicate},
                               {"to_vote", counts.to_vote},
                               {"promoted", counts.promoted}}},
                             {"rejected", std::move(rejected)}});
    return kAccepted;
  }
  Figures figures{{"uploads", std::to_string(counts.uploads)},        {"  open", std::to_string(counts.open)},
                  {"  being judged", std::to_string(counts.judging)}, {"tiles announced", std::to_string(counts.tiles)},
                  {"  accepted", std::to_string(counts.accepted)},    {"  duplicate", std::to_string(counts.duplicate)},
                  {"  rejected", std::to_string(counts.rejected)}};
  for (const auto& [code, tiles] : counts.rejected_by) figures.emplace_back("    " + code, std::to_string(tiles));
  figures.emplace_back("waiting for a vote", std::to_string(counts.to_vote));
  figures.emplace_back("promoted", std::to_string(counts.promoted));
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
  std::filesystem::path data_, out_;
  std::string catalogue_;
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
  options.value("--data", data_, "DIR", "the service's folder").required();
  options.value("--catalogue", catalogue_, "CATALOGUE", "if it is not DATA/catalogue.sqlite");
  options.value("--out", out_, "OUT", "folder to create").required();
}

int ExportCommand::run(Context& context) {
  CandidateCatalogue catalogue(catalogue_location(catalogue_, data_), CandidateCatalogue::Access::read);
  const PackStore packs(data_ / "packs");
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
    throw UsageError({.what = "no folder of a service", .where = data_, .expected = "what was given to serve --data"});
  }
  InstalledStore store(data_ / "installed");
  if (forget_) {
    if (!store.forget(*forget_)) {
      throw UsageError({.what = "no report of this airframe", .where = data_ / "installed", .found = *forget_});
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
}  // namespace nadir

int main(int argc, char** argv) {
  nadir::install_signal_handlers();
  const nadir::SystemClock clock;
  std::vector<std::unique_ptr<nadir::Command>> commands;
  commands.push_back(std::make_unique<nadir::ServeCommand>());
  commands.push_back(std::make_unique<nadir::StatusCommand>());
  commands.push_back(std::make_unique<nadir::ExportCommand>());
  commands.push_back(std::make_unique<nadir::InstalledCommand>());
  commands.push_back(nadir::make_token_create());
  commands.push_back(nadir::make_token_list());
  commands.push_back(nadir::make_token_revoke());
  commands.push_back(std::make_unique<nadir::InstalledCommand>());
  commands.push_back(nadir::make_token_create());
  commands.push_back(nadir::make_token_list());
  commands.push_back(nadir::make_token_revoke());
  const nadir::ProgramText text{
      .name = "nadir-candidates",
      .summary = "stores tiles from flights and promotes those that independent flights agree on",
      .footer = "See docs/commands/ for a page per command."};
  winsize size{};
  const bool terminal = isatty(STDERR_FILENO) == 1;
  const bool sized = terminal && ioctl(STDERR_FILENO, TIOCGWINSZ, &size) == 0 && size.ws_col > 0;
  return nadir::run_program(text, commands, {argv + 1, argv + argc},
                            {std::cout, std::cerr, clock, terminal, sized ? size.ws_col : 80});
}
