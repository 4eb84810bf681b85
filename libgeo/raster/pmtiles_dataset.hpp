// PMTiles for GDAL, whose own driver of this name (since 3.8) reads vectors alone: the tiles of the finest zoom as one
// raster of red, green, blue and alpha in Web Mercator. Where there is no tile it is transparent; coarser tiles are not
// read, because others may have made them in another way.
#pragma once

namespace nadir {

// A driver that opens files which begin as PMTiles. Part of register_gdal_drivers().
void register_pmtiles_driver();

}  // namespace nadir
