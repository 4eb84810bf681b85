// Writes a tile set as a Cloud Optimized GeoTIFF on the grid of web maps (EPSG:3857, 256 x 256 pixels, GDAL's
// GoogleMapsCompatible): one image per zoom, each a whole number of tiles, so that the blocks of the image ARE the
// tiles.
//
// A block holds the encoded tile byte for byte: a complete JPEG stream (TIFF compression 7 without shared tables) or a
// WebP file (compression 50001). So an MBTiles and a COG of one build hold the same tiles with the same digests.
// Missing tiles have offset and size 0. Layout: header, GDAL's note on the structure, the directories from the finest
// zoom to the coarsest, then the tiles from the coarsest zoom to the finest, row by row, each with its size before it
// and its last four bytes repeated behind it, as that note says. From 4 GB on it is a BigTIFF.
//
// Sizes come first in the file and are known last, so tiles are spooled to FILE.tiles beside it until finish(); memory
// holds 24 bytes for each of them. The file is a function of the tiles alone. A killed writer leaves a damaged file, so
// write into a StagingDirectory.
#pragma once

#include <filesystem>
#include <vector>

#include "base/files.hpp"
#include "geodesy/web_mercator.hpp"
#include "imagery/codecs.hpp"
#include "imagery/tile_source.hpp"

namespace nadir {

// The addresses that the images cover: a rectangle of tiles of the coarsest zoom, and below it those of the others.
struct CogShape {
  ZoomRange zooms;
  std::uint32_t first_x = 0, first_y = 0, columns = 0, rows = 0;  // tiles of zooms.min
};

// The tables have an entry for each address of the finest zoom, whether there is a tile or not.
inline constexpr std::uint64_t kMaxCogTiles = std::uint64_t{1} << 23;

class CogWriter {
 public:
  // format: jpeg (colour, 4:2:0) or webp. Throws UsageError when the shape has more addresses than a COG should name.
  // classic_limit: larger files become BigTIFF.
  CogWriter(std::filesystem::path path, const CogShape& shape, ImageFormat format,
            std::uint64_t classic_limit = 0xffff'0000);
  ~CogWriter();
  CogWriter(const CogWriter&) = delete;
  CogWriter& operator=(const CogWriter&) = delete;

  // In any order. Throws Error for an address outside the shape.
  void add(const TileKey& key, ByteView encoded);

  // Throws Error when a tile was added twice. Without it there is no file.
  void finish();

 private:
  struct SpooledTile {
    TileKey key;
    std::uint32_t size = 0;
    std::uint64_t at = 0;  // in FILE.tiles
  };

  std::filesystem::path path_, spool_path_;
  CogShape shape_;
  ImageFormat format_;
  std::uint64_t classic_limit_;
  AppendFile spool_;
  std::vector<SpooledTile> tiles_;
};

}  // namespace nadir
