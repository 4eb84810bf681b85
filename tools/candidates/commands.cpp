#include "candidates/commands.hpp"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/file.h>
#include <unistd.h>

#include <cerrno>
#include <chrono>
#include <nlohmann/json.hpp>
#include <ostream>
#include <thread>

#include "base/error.hpp"
#include "base/files.hpp"
#include "candidates/candidate_catalogue.hpp"
#include "candidates/promoted_imagery.hpp"
#include "candidates/upload_server.hpp"
#include "candidates/work_queue.hpp"
#include "cli/interrupt.hpp"
#include "cli/options.hpp"
#include "cli/output.hpp"

namespace nadir {

CatalogueLocation catalogue_location(const std::string& catalogue, const std::optional<std::filesystem::path>& data) {
  if (!catalogue.empty()) return parse_catalogue_location(catalogue);
  if (data) return parse_catalogue_location((*data / "catalogue.sqlite").string());
  throw UsageError({.what = "no catalogue is named", .expected = "--data DIR or --catalogue CATALOGUE"});
}

DataFolder::DataFolder(const std::filesystem::path& path) {
  std::error_code code;
  std::filesystem::create_directories(path, code);
  if (code) throw Error({.what = "the service's folder cannot be made", .where = path, .found = code.message()});
  lock_ = ::open((path / ".lock").c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0644);
  if (lock_ < 0) {
    throw Error({.what = "the service's folder cannot be written", .where = path, .found = system_error_text(errno)});
  }
  if (::flock(lock_, LOCK_EX | LOCK_NB) != 0) {
    ::close(lock_);
    throw Error(
        {.what = "another service works in this folder", .where = path, .fix = "end it first, or use another --data"});
  }
}

DataFolder::~DataFolder() { ::close(lock_); }

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

void StatusCommand::setup(Options& options) {
  options.value("--data", data_, "DIR", "the service's folder");
  options.value("--catalogue", catalogue_, "CATALOGUE", "where it is not DATA/catalogue.sqlite");
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

std::string_view ExportCommand::details() const {
  return "OUT appears whole or not at all: a Cloud Optimized GeoTIFF for each day and each block of 16 by 16 tiles, "
         "with\n"
         "a STAC Item beside it that says when it was taken, how fine and how well placed it is. It may run beside "
         "the\n"
         "service. Exit code 1: nothing is promoted, and nothing was written.";
}

std::string_view ExportCommand::examples() const {
  return "nadir-candidates export --data /srv/candidates --out promoted\n"
         "nadir cache build --mission next.yaml --imagery promoted/*.tif --imagery map.tif --out next";
}

void ExportCommand::setup(Options& options) {
  options.value("--data", data_, "DIR", "the service's folder").required();
  options.value("--catalogue", catalogue_, "CATALOGUE", "where it is not DATA/catalogue.sqlite");
  options.value("--out", out_, "OUT", "folder that is made").required();
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
      context.out << fmt::format("{}  {} tiles, {}, GSD {:.2f} m, CE90 {:.1f} m\n", file, image.tiles,
                                 to_rfc3339(image.captured_at).substr(0, 10), image.gsd_m, image.ce90_m);
    }
  }
  staging.commit();
  if (context.json) print_json(context.out, {{"images", std::move(list)}});
  return kAccepted;
}

}  // namespace nadir
