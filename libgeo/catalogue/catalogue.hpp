// The catalogue of a fleet's map packages: the imagery and the mission of each, tile by tile, as layers of a spatial
// database. docs/formats/catalogue.md describes the tables.
//
// Every change is one transaction: a package is added completely or not at all.
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "base/error.hpp"
#include "base/progress.hpp"
#include "catalogue/coverage_gaps.hpp"
#include "catalogue/database.hpp"
#include "package/manifest.hpp"
#include "package/mission.hpp"
#include "package/sidecar.hpp"
#include "package/verify.hpp"

namespace nadir {

// A package to add.
struct CatalogueEntry {
  Manifest manifest;
  Sha256 manifest_sha256;
  Mission mission;
  std::vector<Sidecar> tiles;                       // in the order of TileKey
  std::optional<std::vector<std::string>> signers;  // ids of keys with verified signatures; none: not verified
};

struct CataloguedPackage {
  std::int64_t id = 0;
  std::string series;
  std::int64_t sequence = 0;
  std::string mission;
  UtcTime created;
  UtcTime expires;
  std::string manifest_sha256;
  std::string signers;  // empty: not verified
  std::int64_t tiles = 0;
  std::int64_t bytes = 0;
};

class Catalogue {
 public:
  using Access = CatalogueDatabase::Access;

  // write: creates an empty one where there is none. Throws Error.
  Catalogue(const CatalogueLocation& location, Access access) : database_(location, access) {}

  // known: the same package is catalogued already, nothing changes. conflict: another package has this series and
  // sequence, nothing changes either.
  enum class Added { added, known, conflict };
  Added add(const CatalogueEntry& entry, Progress& progress);

  // By series and sequence.
  std::vector<CataloguedPackage> packages();
  std::vector<CatalogueSource> sources();

  // Removes a package with all its rows. Returns whether there was one.
  bool remove(const std::string& series, std::int64_t sequence);

  // Replaces the gaps of this mission in the layer `gaps`.
  void store_gaps(const std::string& mission, UtcTime evaluated_at, const std::vector<CatalogueGap>& gaps);

 private:
  std::optional<CataloguedPackage> find(const std::string& series, std::int64_t sequence);
  std::int64_t add_package(const CatalogueEntry& entry);
  void add_plan(const CatalogueEntry& entry, std::int64_t package_id);
  void add_route(const Mission& mission, std::int64_t package_id);
  void add_tiles(const CatalogueEntry& entry, std::int64_t package_id, Progress& progress);
  void add_gap(const CatalogueGap& gap, std::optional<std::int64_t> package_id, const std::string& mission,
               UtcTime evaluated_at);
  void expect_count(const char* table, std::int64_t package_id, std::size_t count);

  CatalogueDatabase database_;
};

// A package that was read for the catalogue. entry is set exactly when no finding is an error.
struct CatalogueReading {
  Findings findings;
  std::optional<CatalogueEntry> entry;
};

// With options the package is verified with them. Without, only its parts are checked against each other (mission and
// tiles against the digests of the manifest), not its signatures. Throws Error when there is no package or it cannot be
// read.
CatalogueReading read_catalogue_entry(const std::filesystem::path& package, const VerifyOptions* options,
                                      Progress& progress);

}  // namespace nadir
