// nadir-candidates serve.
#include <fmt/format.h>

#include <chrono>
#include <filesystem>
#include <optional>
#include <ostream>
#include <string>
#include <thread>
#include <vector>

#include "base/error.hpp"
#include "base/files.hpp"
#include "base/printable.hpp"
#include "candidates/candidate_service.hpp"
#include "cli/options.hpp"
#include "cli/terminal.hpp"
#include "nadir_candidates/commands.hpp"
#include "nadir_candidates/service_folder.hpp"
#include "nadir_candidates/service_work.hpp"
#include "nadir_candidates/upload_server.hpp"

namespace nadir {
namespace {

constexpr std::size_t kQueuedPerClient = 16;  // requests
constexpr auto kPollInterval = std::chrono::milliseconds(100);
constexpr int kPollsBetweenTokens = 5;
constexpr int kPollsBetweenRetries = 50;
constexpr int kPollsBetweenCleanups = 36'000;  // an hour

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
  ServiceStart prepare(Context& context);
  static void supervise(Context& context, CandidateService& service, Clients& clients, ServiceWork& work);

  CandidateServiceOptions service_;
  std::filesystem::path data_;
  std::string catalogue_;
  std::string listen_ = "127.0.0.1:8760";
  std::vector<std::string> token_files_;
  std::optional<std::filesystem::path> tokens_;
  std::optional<std::filesystem::path> port_file_;
  int threads_ = 2;
  int workers_ = 1;
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
  ServicePlace::declare_catalogue(options, catalogue_);
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
  options.value("--threads", threads_, "N", "threads that answer clients").between(1, 64);
  options
      .value("--workers", workers_, "N",
             "threads that judge tiles and let flights vote; 0: other processes do (nadir-candidates work)")
      .between(0, 64);
  options.value("--port-file", port_file_, "FILE", "write the port here once listening; for --listen IP:0");
}

// Completes the service's options; what the operator has chosen.
ServiceStart ServeCommand::prepare(Context& context) {
  service_.catalogue = ServicePlace{.data = data_, .catalogue = catalogue_}.location();
  if (workers_ == 0) require_server(service_.catalogue, "--workers 0");
  service_.rules.airframes_differ = independent_ == "airframes";
  service_.rules.max_age_ms = max_age_days_ * kDay_ms;
  service_.rules.quota_bytes = std::int64_t{quota_mb_} * 1'000'000;
  service_.packs.keep_free_bytes = std::uint64_t{static_cast<unsigned>(keep_free_mb_)} * 1'000'000;
  service_.data = data_;
  return {.started_at = context.clock.now(),
          .votes = service_.rules.flights_to_promote,
          .airframes_differ = service_.rules.airframes_differ,
          .base_packages = std::ssize(service_.packages),
          .tokens_without_expiry = std::ssize(token_files_)};
}

int ServeCommand::run(Context& context) {
  const ListenAddress address = parse_listen_address(listen_);
  if (token_files_.empty() && !tokens_) {
    throw UsageError({.what = "without tokens nobody could call this service",
                      .expected = "--tokens FILE or --token-file FILE",
                      .fix = "nadir-candidates token create --tokens FILE --id NAME --out NAME.token"});
  }
  Clients clients(token_files_, tokens_);
  ServiceStart start = prepare(context);
  const ServiceLock lock(data_);
  CandidateService service(service_, context.clock);
  start.packages = service.base_packages();
  service.recover();
  const auto warn = [&context, &service](const char* act, const std::string& text) {
    context.err << "warning: " << printable(text) << '\n' << std::flush;
    service.audit().record({.act = act, .result = "warning", .detail = text});
  };
  service.audit().record(
      {.act = "service.start",
       .result = "started",
       .detail = fmt::format("{} flights, independent by {}; base packages {}; tokens {}; workers {}", start.votes,
                             start.independent(), start.base_packages, clients.all().size(), workers_)});
  if (service.first_trust()) {
    warn("root.trust", fmt::format("no earlier trust root is remembered: version {} of {} is trusted as it is",
                                   service.root_version(), service_.trust.string()));
  }
  for (const std::string& text : start.warnings()) warn("rules", text);
  try {
    write_service_start(data_, start);
  } catch (const Error& error) {  // it serves all the same
    warn("rules", std::string("nadir-candidates status will not show how this service was started: ") + error.what());
  }

  FairQueue queue(static_cast<std::size_t>(threads_), kQueuedPerClient);
  EvaluationWorkers workers(service.evaluation(), service_.catalogue, &service.catalogue(), workers_);
  ServiceWork work(service, queue, workers);
  const UploadApi api(
      service, clients, address.loopback(), [&workers] { workers.wake(); }, start.warnings());
  const UploadServer server(api, queue, address);
  if (port_file_) write_file_atomic(*port_file_, fmt::format("{}\n", server.port()));
  if (!context.quiet) context.err << fmt::format("listening on {}:{}\n", address.ip, server.port()) << std::flush;
  supervise(context, service, clients, work);
  service.audit().record({.act = "service.stop", .result = "stopped"});
  return kAccepted;
}

// Until it is interrupted: reports faults that come and go, retries what failed, reads the tokens again, tidies up.
void ServeCommand::supervise(Context& context, CandidateService& service, Clients& clients, ServiceWork& work) {
  std::string reported;
  const auto report = [&] {
    std::string fault = work.fault();
    if (fault.empty()) fault = clients.fault();
    if (fault.empty()) fault = service.fault().reason;
    if (fault == reported) return;
    reported = fault;
    context.err << (fault.empty() ? "works again without a fault" : printable(fault)) << '\n' << std::flush;
    service.audit().record({.act = "service.fault", .result = fault.empty() ? "gone" : "reported", .detail = fault});
  };
  for (int polls = 1; !interrupt_requested(); ++polls) {
    std::this_thread::sleep_for(kPollInterval);
    if (polls % kPollsBetweenRetries == 0) {
      report();
      work.retry();
      work.apply_revocations();
      service.retry_recovery();
      service.keep_audit();
    }
    if (polls % kPollsBetweenTokens == 0 && clients.reload()) {
      service.audit().record({.act = "tokens.load",
                              .result = "loaded",
                              .subject = clients.file().string(),
                              .detail = fmt::format("tokens {}", clients.all().size())});
    }
    if (polls % kPollsBetweenCleanups == 0) work.forget_expired();
  }
}

}  // namespace

std::unique_ptr<Command> make_serve() { return std::make_unique<ServeCommand>(); }

}  // namespace nadir
