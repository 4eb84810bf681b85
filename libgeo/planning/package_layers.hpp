// What a package holds, as layers of a map: its tiles with their dates, resolutions and origins, and its gaps.
#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <span>
#include <vector>

#include "base/time.hpp"
#include "imagery/matchability_raster.hpp"
#include "imagery/tile_source.hpp"
#include "package/coverage_gaps.hpp"
#include "package/manifest.hpp"
#include "package/mission.hpp"
#include "package/sidecar.hpp"

namespace nadir {

// A package of our own making, read without being verified: nothing is flown with it.
struct PlannedPackage {
  Manifest manifest;
  Mission mission;
  std::string mission_text;
  bool is_signed = false;
  std::uint64_t bytes = 0;
  std::shared_ptr<const TileSource> tiles;
  std::vector<Sidecar> sidecars;  // in the order of TileKey
  std::optional<MatchabilityRaster> matchability;

  std::filesystem::path folder;

  bool indexed() const;
};

// Throws Error for a folder that is no package.
PlannedPackage open_planned_package(const std::filesystem::path& folder);

// The bytes of its vectors; nothing: it has none, or they are no longer those of its manifest.
std::optional<Bytes> vectors_of(const PlannedPackage& package);

// RFC 7946. One feature per tile of the finest zoom, or of the finest one with at most `most` tiles; of a coarser zoom
// with the oldest date, the coarsest resolution and the worst accuracy of the finest tiles in it.
nlohmann::json tiles_geojson(const PlannedPackage& package, UtcTime at, std::size_t most);

// A geometry of RFC 7946 along the edges of the pixels of this tile that are not 0 (kTileSize² bytes in rows).
nlohmann::json pixels_geojson(const TileKey& key, ByteView mask);

// One feature per tile with a gap: tile, zoom, reason, area_m2, sector.
nlohmann::json gaps_geojson(const std::vector<Gap>& gaps, const Mission& mission, std::span<const Sidecar> tiles);

// Gaps of the package's finest zoom in what this mission requires, which may be a later one.
nlohmann::json gaps_geojson(const PlannedPackage& package, const Mission& mission);

}  // namespace nadir
