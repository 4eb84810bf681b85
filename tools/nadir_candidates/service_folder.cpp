#include "nadir_candidates/service_folder.hpp"

#include <fcntl.h>
#include <sys/file.h>
#include <unistd.h>

#include <cerrno>
#include <nlohmann/json.hpp>

#include "base/error.hpp"
#include "base/files.hpp"
#include "base/json.hpp"
#include "cli/options.hpp"

namespace nadir {

namespace fs = std::filesystem;

namespace {

constexpr const char* kStartFile = "started.json";
constexpr const char* kStartSchema = "nadir.candidate-start/1";
constexpr std::uint64_t kMaxStartSize = std::uint64_t{1} << 18;  // bytes
constexpr std::size_t kMostPackages = 2000;
constexpr std::int64_t kMostCounted = std::int64_t{1} << 31;

}  // namespace

ServiceLock::ServiceLock(const fs::path& folder) {
  std::error_code code;
  fs::create_directories(folder, code);
  if (code) {
    throw Error({.what = "cannot create the service's folder",
                 .where = folder,
                 .found = code.message(),
                 .fix = "create it for the service's user, or choose another --data"});
  }
  lock_ = ::open((folder / ".lock").c_str(), O_RDWR | O_CREAT | O_CLOEXEC | O_NOFOLLOW, 0644);
  if (lock_ < 0) {
    throw Error({.what = "cannot write to the service's folder",
                 .where = folder,
                 .found = system_error_text(errno),
                 .fix = "check the owner of the folder and its disk, or choose another --data"});
  }
  if (::flock(lock_, LOCK_EX | LOCK_NB) != 0) {
    ::close(lock_);
    throw Error({.what = "another service uses this folder",
                 .where = folder,
                 .fix = "stop that service first, or choose another --data"});
  }
}

ServiceLock::~ServiceLock() { ::close(lock_); }

void ServicePlace::declare(Options& options, Data need) {
  Option folder = options.value("--data", data, "DIR", "the service's folder");
  if (need == Data::required) folder.required();
  declare_catalogue(options, catalogue);
}

void ServicePlace::declare_catalogue(Options& options, std::string& catalogue) {
  options.value("--catalogue", catalogue, "CATALOGUE",
                "a SpatiaLite file or \"PG:…\"; DIR/catalogue.sqlite without it");
}

CatalogueLocation ServicePlace::location() const {
  if (!catalogue.empty()) return parse_catalogue_location(catalogue);
  if (data) return parse_catalogue_location((*data / "catalogue.sqlite").string());
  throw UsageError({.what = "no catalogue given", .expected = "--data DIR or --catalogue CATALOGUE"});
}

void require_server(const CatalogueLocation& catalogue, const std::string& what) {
  if (catalogue.kind == CatalogueLocation::Kind::postgres) return;
  throw UsageError({.what = what + " needs a catalogue in PostGIS: a SpatiaLite file has one process that writes to it",
                    .where = catalogue.shown,
                    .expected = "--catalogue \"PG:…\"",
                    .fix = "let the service judge by itself, with serve --workers N, or move to PostGIS"});
}

bool ServiceStart::same_rules(const ServiceStart& other) const {
  return votes == other.votes && airframes_differ == other.airframes_differ && base_packages == other.base_packages &&
         packages == other.packages;
}

std::vector<std::string> ServiceStart::warnings() const {
  std::vector<std::string> list;
  if (!airframes_differ) {
    list.emplace_back("--independent days: one airframe's key, lost or stolen, promotes tiles by itself");
  }
  if (base_packages == 0) {
    list.emplace_back("without --package no tile is compared with a map, and tiles over any package are taken");
  }
  if (tokens_without_expiry > 0) {
    list.emplace_back("tokens of --token-file do not expire; nadir-candidates token create makes such that do");
  }
  return list;
}

ServiceStart parse_service_start(std::string_view text, std::string_view name) {
  const nlohmann::json document = parse_json(text, name, {.max_depth = 2, .allow_floats = false});
  const JsonReader in(document, {.name = std::string(name),
                                 .what = "cannot read what the service was started with",
                                 .fix = "the service's next start writes the file anew"});
  in.expect("schema", kStartSchema);
  ServiceStart start{.started_at = in.time("started_at"),
                     .votes = in.integer("votes", 2, kMostCounted),
                     .airframes_differ = in.choice("independent", {"airframes", "days"}) == "airframes",
                     .base_packages = in.integer("base_packages", 0, kMostCounted),
                     .tokens_without_expiry = in.integer("tokens_without_expiry", 0, kMostCounted)};
  if (const auto packages = in.optional_array("packages", {.most = kMostPackages})) {
    for (std::size_t i = 0; i < packages->size(); ++i) start.packages.insert(packages->digest(i));
  }
  in.finish();
  return start;
}

std::string service_start_json(const ServiceStart& start) {
  nlohmann::json packages = nlohmann::json::array();
  for (const Sha256& package : start.packages) packages.push_back(package.hex());
  return nlohmann::json{{"schema", kStartSchema},
                        {"started_at", to_rfc3339(start.started_at)},
                        {"votes", start.votes},
                        {"independent", start.independent()},
                        {"base_packages", start.base_packages},
                        {"packages", std::move(packages)},
                        {"tokens_without_expiry", start.tokens_without_expiry}}
             .dump(1) +
         "\n";
}

std::optional<ServiceStart> read_service_start(const fs::path& data) {
  const fs::path path = data / kStartFile;
  if (!fs::exists(fs::symlink_status(path))) return std::nullopt;
  return parse_service_start(read_text_file(path, kMaxStartSize), path.string());
}

void write_service_start(const fs::path& data, const ServiceStart& start) {
  write_file_atomic(data / kStartFile, service_start_json(start));
}

}  // namespace nadir
