// A GeoTIFF's pictures as zooms of the web map: which place each has on the grid, and where its blocks lie in the file.
#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "imagery/cog_block.hpp"
#include "imagery/cog_tiff.hpp"

namespace nadir {

// The blocks of one picture (or of its mask), row by row.
struct CogBlocks {
  CogBlockForm form;
  std::int64_t width = 0, height = 0;  // of the picture, pixels; blocks at the rim reach beyond
  std::int64_t across = 0, down = 0;
  std::vector<std::uint64_t> places, sizes;  // size 0: no block
};

struct CogLevel {
  int zoom = 0;
  std::int64_t west = 0, north = 0;  // global pixel of the picture's corner at this zoom
  CogBlocks picture;
  std::optional<CogBlocks> mask;  // of the same width and height

  // Blocks are tiles: the encoded bytes of one are a tile's.
  bool native() const;
};

struct CogLevels {
  std::vector<CogLevel> levels;        // finest first
  std::optional<std::uint8_t> nodata;  // pixels of which every colour has this value show nothing
  std::vector<std::string> left_out;   // overviews that lie between the grid's pixels, in words
};

// Throws CogError: tiff.corrupt, tiff.grid (another coordinate system, resolution or place than the web map's), and
// tiff.layout (strips, planes, 16 bit, a compression that is not read).
CogLevels read_cog_levels(const TiffFile& file);

}  // namespace nadir
