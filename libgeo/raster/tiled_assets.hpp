// Tiled assets of STAC (github.com/stac-extensions/tiled-assets; STACTA in GDAL): an Item that names a template of
// files, "{TileMatrixSet}/{TileMatrix}/{TileRow}/{TileCol}.tif", and the tile matrix set of the OGC (17-083r2 or
// 17-083r4) that says where each lies. They are read as one raster, of the finest tile matrix that has tiles.
//
// Tiles are files on this machine: GeoTIFF, JPEG, PNG, WebP or JPEG 2000, all with the bands, type and nodata of the
// first. A tile that is not there is no ground: nodata where the tiles have it, else with alpha 0 in the last band. A
// tile that states a place of its own must lie where its number says.
//
// GDAL's own driver is not used: it fails where a tile is missing, or shows black, and does not say what it reads.
#pragma once

#include <filesystem>
#include <vector>

#include "raster/gdal_dataset.hpp"

namespace nadir {

// Throws Error for an item that holds no tiles, or none that can be read as one raster.
GdalHandle open_tiled_assets(const std::filesystem::path& item);

// The item, and all tiles that are there.
std::vector<std::filesystem::path> files_of_tiled_assets(const std::filesystem::path& item);

}  // namespace nadir
