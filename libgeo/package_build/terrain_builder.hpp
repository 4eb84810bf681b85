// An elevation model that GDAL reads, cut out and resampled to the grid of a package's terrain/dem.tif.
//
// Heights keep the vertical datum of the source, in metres: within one flight only their differences matter.
#pragma once

#include <filesystem>

#include "imagery/terrain_raster.hpp"
#include "package/mission.hpp"

namespace nadir {

// Around the mission's area: as far as a frame sees beyond it.
inline constexpr double kTerrainMargin_m = 500;
// Finer relief than this is roofs and crowns, which matching does not need; coarser sources keep their resolution.
inline constexpr double kFinestTerrain_m = 10;

// Missing heights are NaN; nothing is checked here. Throws UsageError for a raster that is no elevation model.
TerrainRaster cut_terrain(const std::filesystem::path& dem, const Mission& mission);

// A tiled, deflated GeoTIFF (docs/formats.md). The same raster gives the same bytes.
void write_terrain(const TerrainRaster& terrain, const std::filesystem::path& path);

}  // namespace nadir
