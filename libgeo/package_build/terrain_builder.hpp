// An elevation model that GDAL reads, cut out and brought onto the grid of a package's terrain/dem.tif.
//
// Heights stay what they are in the source, metres above its own zero: within one flight only their differences count.
#pragma once

#include <filesystem>

#include "imagery/terrain_raster.hpp"
#include "package/mission.hpp"

namespace nadir {

// Around the mission's area as much as a frame sees beyond it.
inline constexpr double kTerrainMargin_m = 500;
// Finer relief than this is roofs and crowns, which matching does not need; coarser sources stay as coarse as they are.
inline constexpr double kFinestTerrain_m = 10;

// What the source does not know is NaN; nothing is judged here. Throws UsageError for what is no elevation model.
TerrainRaster cut_terrain(const std::filesystem::path& dem, const Mission& mission);

// A tiled, deflated GeoTIFF (docs/formats.md). The same raster gives the same bytes.
void write_terrain(const TerrainRaster& terrain, const std::filesystem::path& path);

}  // namespace nadir
