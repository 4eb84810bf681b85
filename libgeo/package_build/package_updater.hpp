// Old package + newer imagery + mission = the next package of the series: the conductor of `nadir cache update`.
//
// The old package is verified; whether it may still fly does not matter, because expired dates and stale imagery are
// why it is updated. Its tiles are copied byte for byte where new imagery does not show, and the result is checked as a
// build's is. There is no journal: an interrupted update starts again, most of it being copying.
#pragma once

#include "package_build/package_builder.hpp"
#include "package_build/tile_set_updater.hpp"

namespace nadir {

struct UpdateRequest {
  std::filesystem::path old_package;
  const TrustRoot* trust = nullptr;  // required: verifies the old package
  std::filesystem::path mission;
  std::vector<std::filesystem::path> imagery;  // none: another area or other dates, from the old tiles alone
  ImageryOverrides overrides;
  std::vector<StretchRequest> stretches;     // none, one for all, or one for each
  std::vector<std::filesystem::path> dem;    // instead of the old package's terrain
  std::optional<VectorRequest> vectors;      // instead of the old package's vectors
  TileSetOptions tiles;                      // container and format are taken from the old package
  std::optional<TileSetKind> container;      // instead of the old package's
  bool index = false;                        // rebuild the old package's place index for the new tiles
  const PrivateKey* key = nullptr;           // null: unsigned
  std::vector<std::filesystem::path> roots;  // newer roots of trust, besides those that the old package carries
  std::optional<UtcTime> at;                 // time of evaluation; the mission's `created` by default
  std::filesystem::path out;
  std::function<void(std::string_view)> on_remark = [](auto) {};  // notes for the user while it runs
};

struct UpdateReport {
  PackageReport package;
  UpdateCounts counts;
  std::int64_t old_sequence = 0;
  std::int64_t sequence = 0;
};

UpdateReport update_package(const UpdateRequest& request, Progress& progress);

}  // namespace nadir
