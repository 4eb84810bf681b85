#include "candidates/serve.hpp"

#include <fmt/format.h>

#include <chrono>
#include <ostream>
#include <thread>

#include "base/error.hpp"
#include "base/files.hpp"
#include "candidates/data_folder.hpp"
#include "candidates/service_work.hpp"
#include "candidates/upload_server.hpp"
#include "cli/terminal.hpp"
#include "cli/options.hpp"

namespace nadir {
namespace {

constexpr std::size_t kPlacesOfClient = 16;  // requests that wait
constexpr auto kLook = std::chrono::milliseconds(100);
constexpr int kLooksBetweenRetries = 50;
constexpr int kLooksBetweenClearings = 36'000;  // an hour

}  // namespace

std::string_view ServeCommand::details() const {
  return "Listens until it is interrupted. Whatever it has answered is on the disk: it may be killed at any moment "
         "and\n"
         "goes on where it was. There is no TLS in it: beyond this machine it belongs behind a proxy that has it.\n"
         "Tiles are judged when their upload is complete; one is promoted when --votes independent flights show the\n"
         "same ground at the same place. The trust root is read again whenever its file changes.";
}

std::string_view ServeCommand::examples() const {
  return "nadir-candidates serve --data /srv/candidates --trust root.json --token-file ground-1.token\n"
         "nadir-candidates serve --data /srv/candidates --trust root.json --token-file mini-07=field.token \\\n"
         "    --package /srv/packages/valley-12 --catalogue \"PG:dbname=fleet\" --votes 3";
}

void ServeCommand::setup(Options& options) {
  options.value("--data", data_, "DIR", "folder for packs, uploads and the catalogue; made when missing").required();
  options.value("--trust", service_.trust, "FILE", "the trust root, with the airframes' tile signers").required();
  options
      .values("--token-file", token_files_, "[AIRFRAME=]FILE", "bearer token of a client; its file's name is its name")
      .required();
  options.value("--listen", listen_, "IP:PORT", "address to listen on");
  options.value("--catalogue", catalogue_, "CATALOGUE",
                "a SpatiaLite file or \"PG:…\"; DATA/catalogue.sqlite without it");
  options.values("--package", service_.packages, "PACKAGE",
                 "packages that flights flew with; others' tiles are refused");
  options.value("--votes", service_.rules.flights_to_promote, "N", "flights that must agree").between(2, 10);
  options
      .value("--independent", independent_, "WHAT",
             "flights that count apart: of other airframes, or also of other days")
      .one_of({"airframes", "days"});
  options.value("--max-age-days", max_age_days_, "N", "older pictures are refused").between(1, 3650);
  options.value("--quota-mb", quota_mb_, "N", "that an airframe may announce in a day").between(1, 1'000'000);
  options.value("--keep-free-mb", keep_free_mb_, "N", "of the disk; below it nothing is taken").between(0, 1'000'000);
  options.value("--threads", threads_, "N", "threads that work").between(1, 64);
  options.value("--port-file", port_file_, "FILE", "where the port is written once it listens; for --listen IP:0");
}

void ServeCommand::complete_rules() {
  constexpr std::int64_t kDay_ms = std::int64_t{24} * 3600 * 1000;
  service_.rules.airframes_differ = independent_ == "airframes";
  service_.rules.max_age_ms = max_age_days_ * kDay_ms;
  service_.rules.quota_bytes = std::int64_t{quota_mb_} * 1'000'000;
  service_.keep_free_bytes = std::uint64_t{static_cast<unsigned>(keep_free_mb_)} * 1'000'000;
}

int ServeCommand::run(Context& context) {
  const ListenAddress address = parse_listen_address(listen_);
  const Clients clients(token_files_);
  complete_rules();
  const DataFolder folder(data_);
  service_.data = data_;
  service_.catalogue =
      parse_catalogue_location(catalogue_.empty() ? (data_ / "catalogue.sqlite").string() : catalogue_);
  CandidateService service(service_, context.clock);
  service.recover();

  FairQueue queue(static_cast<std::size_t>(threads_), kPlacesOfClient);
  ServiceWork work(service, queue);
  const UploadApi api(service, clients, address.loopback(),
                      [&work](const UploadClient& client, std::int64_t upload) { work.judge(client.name, upload); });
  const UploadServer server(api, queue, address);
  for (const auto& [client, upload] : service.to_judge()) work.judge(client, upload);
  work.vote();
  if (port_file_) write_file_atomic(*port_file_, fmt::format("{}\n", server.port()));
  if (!context.quiet) context.err << fmt::format("listening on {}:{}\n", address.ip, server.port()) << std::flush;
  std::string told;
  for (int looks = 1; !interrupt_requested(); ++looks) {
    std::this_thread::sleep_for(kLook);
    if (looks % kLooksBetweenRetries == 0) {
      std::string trouble = work.trouble();
      if (trouble.empty()) trouble = service.root_trouble();
      if (trouble != told) {
        told = trouble;
        if (!trouble.empty()) context.err << trouble << '\n' << std::flush;
      }
      work.retry();
      work.heed_revocations();
    }
    if (looks % kLooksBetweenClearings == 0) work.forget_expired();
  }
  return kAccepted;
}

}  // namespace nadir
