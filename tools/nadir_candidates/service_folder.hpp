// The folder of a candidate service (--data) as its commands use it: one service at a time, the catalogue in it, and
// what a service was started with, for those who look at it from outside:
//   DATA/started.json
//   {"schema": "nadir.candidate-start/1", "started_at", "votes", "independent", "base_packages", "packages",
//    "tokens_without_expiry"}
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <set>
#include <string>
#include <string_view>
#include <vector>

#include "base/time.hpp"
#include "candidates/candidate_catalogue.hpp"

namespace nadir {

class Options;

// Held by one process at a time.
class ServiceLock {
 public:
  // Creates the folder where it is missing. Throws Error when another process holds it.
  explicit ServiceLock(const std::filesystem::path& folder);
  ~ServiceLock();
  ServiceLock(const ServiceLock&) = delete;
  ServiceLock& operator=(const ServiceLock&) = delete;

 private:
  int lock_ = -1;
};

// --data and --catalogue of the commands that read beside a service.
struct ServicePlace {
  std::optional<std::filesystem::path> data;
  std::string catalogue;

  enum class Data { required, optional };
  void declare(Options& options, Data need);
  static void declare_catalogue(Options& options, std::string& catalogue);
  // Throws UsageError when neither is given.
  CatalogueLocation location() const;
};

// Several processes judge the tiles of a catalogue in PostGIS alone. Throws UsageError for a file; what: an option or a
// command that asks for it.
void require_server(const CatalogueLocation& catalogue, const std::string& what);

// What decides whose word promotes tiles, as the operator chose it.
struct ServiceStart {
  UtcTime started_at;
  std::int64_t votes = 0;        // flights that must agree
  bool airframes_differ = true;  // else also flights of one airframe on different days
  std::int64_t base_packages = 0;
  std::set<Sha256> packages{};  // their manifests; empty also in a record of an earlier version
  std::int64_t tokens_without_expiry = 0;

  std::string_view independent() const { return airframes_differ ? "airframes" : "days"; }
  // Whether tiles are judged and voted on alike.
  bool same_rules(const ServiceStart& other) const;
  // What is risky about it, in words: a choice, not a fault. It is reported for as long as the service runs so.
  std::vector<std::string> warnings() const;
};

// Form only; throws Error, naming the member.
ServiceStart parse_service_start(std::string_view text, std::string_view name);
std::string service_start_json(const ServiceStart& start);

// Of the last start; nullopt: none is recorded there. Throws Error.
std::optional<ServiceStart> read_service_start(const std::filesystem::path& data);
void write_service_start(const std::filesystem::path& data, const ServiceStart& start);  // throws OutOfSpace, Error

}  // namespace nadir
