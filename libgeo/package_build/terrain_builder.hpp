// Elevation models that GDAL reads, cut out and resampled to the grid of a package's terrain/dem.tif. A model is a
// file, a pinned object, or a list of such (raster/stac.hpp).
//
// Of several each is resampled on its own, to the grid of the finest, and a post has the height of the first that has
// one there.
//
// Heights keep the vertical datum of the source, in metres: within one flight only their differences matter.
#pragma once

#include <filesystem>
#include <span>

#include "imagery/terrain_raster.hpp"
#include "package/mission.hpp"

namespace nadir {

// Around the mission's area: as far as a frame sees beyond it.
inline constexpr double kTerrainMargin_m = 500;
// Finer relief than this is roofs and crowns, which matching does not need; coarser sources keep their resolution.
inline constexpr double kFinestTerrain_m = 10;

// dem: one at least, the topmost first. Missing heights are NaN; nothing is checked here. Throws UsageError for a
// raster that is no elevation model.
TerrainRaster cut_terrain(std::span<const std::filesystem::path> dem, const Mission& mission);

// A tiled, deflated GeoTIFF (docs/formats.md). The same raster gives the same bytes.
void write_terrain(const TerrainRaster& terrain, const std::filesystem::path& path);

}  // namespace nadir
