// Old package + newer imagery + mission = the next package of the series: the conductor of `nadir cache update`.
//
// The old package is verified, its tiles are copied byte for byte where new imagery does not show, and the result is
// judged as a build's is. There is no journal: a killed update is begun again, most of it being copying.
#pragma once

#include "package_build/package_builder.hpp"
#include "package_build/update_metatile.hpp"

namespace nadir {

struct UpdateRequest {
  std::filesystem::path old_package;
  const TrustRoot* trust = nullptr;  // required: what the old package is verified with
  std::filesystem::path mission;
  std::vector<std::filesystem::path> imagery;  // none: another area, other dates, from the old tiles alone
  ImageryOverrides overrides;
  std::vector<StretchWish> stretches;        // none, one for all, or one for each
  std::optional<std::filesystem::path> dem;  // instead of the old package's terrain
  TileSetOptions tiles;                      // container and format are taken from the old package
  std::optional<TileSetKind> container;      // instead of the old package's
  bool index = false;                        // the old package's place index is made anew for the new tiles
  const PrivateKey* key = nullptr;           // null: unsigned
  std::vector<std::filesystem::path> roots;  // newer roots of trust, besides those that the old package carries
  std::optional<UtcTime> at;                 // judged at; the mission's `created` by default
  std::filesystem::path out;
  std::function<void(std::string_view)> tell = [](auto) {};  // remarks for the user while it runs
};

struct UpdateReport {
  PackageReport package;
  UpdateCounts counts;
  std::int64_t old_sequence = 0;
  std::int64_t sequence = 0;
};

UpdateReport update_package(const UpdateRequest& request, Progress& progress);

}  // namespace nadir
