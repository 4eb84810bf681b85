// Tile sets for GDAL that its own drivers cannot read as imagery, as one raster each: the tiles of the finest zoom as
// red, green, blue and alpha in Web Mercator. Where there is no tile it is transparent; coarser tiles are not read,
// because others may have made them in another way.
//
//   PMTiles        GDAL's driver of this name (since 3.8) reads vectors alone
//   .tpkx          GDAL reads it since 3.7 (ESRIC), and shows black where there is no tile
#pragma once

namespace nadir {

// A driver for each, which opens files by what they begin with. Part of register_gdal_drivers().
void register_tile_set_drivers();

}  // namespace nadir
