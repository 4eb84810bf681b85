// What a mission lacks, as the catalogue keeps it and as it is shown: one per tile.
#pragma once

#include <span>
#include <string>
#include <vector>

#include "base/time.hpp"
#include "catalogue/catalogue_area.hpp"
#include "package/mission.hpp"
#include "package/sidecar.hpp"

namespace nadir {

struct CatalogueGap {
  TileKey key;
  std::string reason;
  double area_m2 = 0;  // on the ground
  std::string sector;  // that decides about the tile's freshness; empty outside of all
  GeoArea outline;     // along the edges of pixels
};

// What a package lacks of its own mission, at all its zooms: "no tile" or "empty pixels". Tiles in the order of
// TileKey.
std::vector<CatalogueGap> gaps_of_package(const Mission& mission, std::span<const Sidecar> tiles);

// Imagery that lies ready: what a package was made from, and where its pixels are.
struct CatalogueSource {
  std::int64_t package_id = 0;  // in the catalogue
  std::string provider;
  UtcTime captured_at;
  std::int64_t gsd_mm = 0;
  std::int64_t ce90_mm = 0;
  TileTrust trust = TileTrust::service;
  int zoom = 0;  // the finest of the package
  std::int64_t tiles = 0;
  GeoArea footprint;
};

// The sources of a tile set, from the sidecars of its finest zoom.
std::vector<CatalogueSource> sources_of(std::span<const Sidecar> tiles);

// Where no source serves the mission at its finest zoom: fine enough for min_resolution_m, and at `at` not older than
// the tile's sector allows (the same rules as judge.hpp). The reason is what would have to be better:
// "no imagery", "coarse imagery", or "stale imagery" where there is some that is fine enough.
std::vector<CatalogueGap> gaps_of_imagery(const Mission& mission, std::span<const CatalogueSource> sources, UtcTime at);

}  // namespace nadir
