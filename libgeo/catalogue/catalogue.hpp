// The catalogue of a fleet's map packages: what each was made from and for, tile by tile, as layers of a spatial
// database. docs/formats/catalogue.md describes the tables.
//
// Every change is one transaction: all of a package or nothing of it.
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "base/finding.hpp"
#include "base/progress.hpp"
#include "catalogue/database.hpp"
#include "catalogue/coverage_gaps.hpp"
#include "package/manifest.hpp"
#include "package/mission.hpp"
#include "package/sidecar.hpp"
#include "package/verify.hpp"

namespace nadir {

// A package that is to be added.
struct CatalogueEntry {
  Manifest manifest;
  Sha256 manifest_sha256;
  Mission mission;
  std::vector<Sidecar> tiles;                       // in the order of TileKey
  std::optional<std::vector<std::string>> signers;  // ids of keys whose signatures were verified; none: not verified
};

struct CataloguedPackage {
  std::int64_t id = 0;
  std::string series;
  std::int64_t sequence = 0;
  std::string mission;
  UtcTime created;
  UtcTime expires;
  std::string manifest_sha256;
  std::string signers;  // empty: was not verified
  std::int64_t tiles = 0;
  std::int64_t bytes = 0;
};

class Catalogue {
 public:
  using Access = CatalogueDatabase::Access;

  // write: makes an empty one where there is none. Throws Error.
  Catalogue(const CatalogueLocation& location, Access access) : database_(location, access) {}

  // known: the same package is there already, and nothing has changed. conflict: another package has this series and
  // sequence; nothing has changed either.
  enum class Added { added, known, conflict };
  Added add(const CatalogueEntry& entry, Progress& progress);

  // By series and sequence.
  std::vector<CataloguedPackage> packages();
  std::vector<CatalogueSource> sources();

  // Whether there was such a package. Everything that belongs to it goes with it.
  bool remove(const std::string& series, std::int64_t sequence);

  // In the layer `gaps`, in place of what was stored for this mission before.
  void store_gaps(const std::string& mission, UtcTime evaluated_at, const std::vector<CatalogueGap>& gaps);

 private:
  std::optional<CataloguedPackage> find(const std::string& series, std::int64_t sequence);
  std::int64_t add_package(const CatalogueEntry& entry);
  void add_plan(const CatalogueEntry& entry, std::int64_t package_id);
  void add_tiles(const CatalogueEntry& entry, std::int64_t package_id, Progress& progress);
  void add_gap(const CatalogueGap& gap, std::optional<std::int64_t> package_id, const std::string& mission,
               UtcTime evaluated_at);
  void expect_count(const char* table, std::int64_t package_id, std::size_t count);

  CatalogueDatabase database_;
};

// Reads a package for the catalogue: what may go in, and why not where it may not.

// entry is there exactly when no finding refuses.
struct CatalogueReading {
  Findings findings;
  std::optional<CatalogueEntry> entry;
};

// With options the package is verified with them. Without, its parts must fit each other (the mission and the tiles'
// digests those of the manifest), but nobody vouches for them. Throws Error when there is no package or it cannot be
// read.
CatalogueReading read_catalogue_entry(const std::filesystem::path& package, const VerifyOptions* options,
                                      Progress& progress);

}  // namespace nadir
