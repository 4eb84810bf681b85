// Mission + imagery = package: the conductor of `nadir cache build`.
//
// What verification would refuse is refused here: first what shows without reading a pixel (dates, resolution, gaps
// beside the imagery), then what shows while tiles are made (holes inside it, the budget). Nothing appears under the
// final name before everything is judged, written, signed and on disk.
#pragma once

#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "base/finding.hpp"
#include "base/progress.hpp"
#include "base/time.hpp"
#include "raster/imagery_facts.hpp"
#include "package_build/tile_set_builder.hpp"
#include "imagery/terrain_raster.hpp"
#include "package/package_roots.hpp"
#include "trust/keys.hpp"

namespace nadir {

struct PackageRequest {
  std::filesystem::path mission;
  std::vector<std::filesystem::path> imagery;  // which lies on top: tiles.mosaic
  ImageryOverrides overrides;
  std::vector<StretchWish> stretches;        // none, one for all, or one for each
  std::optional<std::filesystem::path> dem;  // with terrain mode dem, and only then
  TileSetOptions tiles;
  const PrivateKey* key = nullptr;  // null: unsigned
  RootChain roots;                  // newer roots of trust that travel with the package
  std::optional<UtcTime> at;        // judged at; the mission's `created` by default
  std::filesystem::path out;
  std::string program;                                       // its version, which the result depends on
  bool resume = false;                                       // go on with what a killed build left
  std::function<void(std::string_view)> tell = [](auto) {};  // remarks for the user while it runs
};

struct PackageReport {
  Findings findings;  // when they refuse, there is no package
  std::uint64_t tiles = 0;
  std::uint64_t resumed = 0;  // of them, those of the finest zoom that an earlier build had made
  std::uint64_t bytes = 0;    // of the whole package
  ZoomRange zoom;
  std::optional<TerrainGrid> terrain;
  Sha256 merkle_root;
};

PackageReport build_package(const PackageRequest& request, Progress& progress);

}  // namespace nadir
