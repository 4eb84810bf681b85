// Coverage gaps: what a mission lacks, of a package or of all catalogued imagery, tile by tile.
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "base/bytes.hpp"
#include "base/time.hpp"
#include "catalogue/geometry.hpp"
#include "geodesy/web_mercator.hpp"
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

// What a package lacks of its own mission, at all its zooms. The reason is "no tile" or "empty pixels". Tiles in the
// order of TileKey.
std::vector<CatalogueGap> gaps_of_package(const Mission& mission, std::span<const Sidecar> tiles);

// Available imagery: what a package was made from, and where its pixels are.
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

// Where no source covers the mission at its finest zoom: fine enough for min_resolution_m, and at `at` not older than
// the tile's sector allows (the same rules as package/mission_check.hpp). The reason is "no imagery", "coarse imagery",
// or "stale imagery" where there is some that is fine enough.
std::vector<CatalogueGap> gaps_of_imagery(const Mission& mission, std::span<const CatalogueSource> sources, UtcTime at);

// Rasterizes areas to the pixels of map tiles: scanline conversion by the even-odd rule at pixel centres.
class PixelCover {
 public:
  // For the tiles of one zoom in these tile rows. Edges are straight lines on the Web Mercator map.
  PixelCover(int zoom, std::uint32_t first_tile_row, std::uint32_t last_tile_row);

  // Areas may overlap.
  void add(const GeoArea& area);

  // kTileSize² bytes in rows, 255 where the pixel's centre lies in one of the areas.
  Bytes pixels(const TileKey& key) const;

 private:
  struct Span {
    std::int64_t begin = 0, end = 0;  // columns of global pixels; the end is outside
  };
  void add_polygon(const GeoPolygon& polygon);

  int zoom_;
  std::int64_t first_row_;                // of global pixels
  std::vector<std::vector<Span>> spans_;  // of each row, unordered
};

}  // namespace nadir
