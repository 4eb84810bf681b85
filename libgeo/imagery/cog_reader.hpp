// Reads a tile set in a Cloud Optimized GeoTIFF, without GDAL: Nadir's own, and others' on the same grid. The images of
// the file (full resolution, overviews, their masks) become levels, one per zoom of the web map; each consists of
// blocks row by row.
//
// Where blocks are tiles of JPEG or WebP, a tile is the block's bytes (with the JPEG tables that blocks share put back
// in). Elsewhere (deflate, LZW, blocks of 512 pixels, images that begin inside a tile) it is cut out of the decoded
// blocks and becomes a PNG, transparent where the file has no data.
#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <string_view>
#include <vector>

#include "base/bytes.hpp"
#include "imagery/codecs.hpp"
#include "imagery/tiff.hpp"
#include "imagery/tile_source.hpp"

namespace nadir {

// Common to all blocks of an image.
struct CogBlockLayout {
  std::uint16_t compression = 1;
  std::uint16_t photometric = 1;
  std::uint16_t predictor = 1;
  int samples = 1;  // 1 grey, 2 grey and alpha, 3 RGB, 4 RGB and alpha
  int bits = 8;     // 8, or 1 in masks
  int width = 0, height = 0;
  Bytes jpeg_tables;
};

// A block of JPEG with the tables that the blocks share, as one complete JPEG; bytes that are complete stay as they
// are.
Bytes whole_jpeg(const CogBlockLayout& form, ByteView block);

// Throws Error naming `name` for bytes that do not decode to the block's size.
DecodedImage decode_cog_block(const CogBlockLayout& form, ByteView block, std::string_view name);

// The blocks of one image (or of its mask), row by row.
struct CogBlocks {
  CogBlockLayout form;
  std::int64_t width = 0, height = 0;  // of the image, pixels; blocks at the edge reach beyond
  std::int64_t across = 0, down = 0;
  std::vector<std::uint64_t> places, sizes;  // size 0: no block
};

struct CogLevel {
  int zoom = 0;
  std::int64_t west = 0, north = 0;  // global pixel of the image's corner at this zoom
  CogBlocks picture;
  std::optional<CogBlocks> mask;  // of the same width and height

  // Whether blocks are tiles, so that the encoded bytes of a block are those of a tile.
  bool native() const;
};

struct CogLevels {
  std::vector<CogLevel> levels;        // finest first
  std::optional<std::uint8_t> nodata;  // value of pixels without data, in every band
  std::vector<std::string> left_out;   // overviews that do not lie on the grid's pixels, as text
};

// What a file may hold, where it is known before the file is read: a manifest states how many tiles were signed.
struct CogLimits {
  std::uint64_t tiles = std::uint64_t{1} << 24;  // that keys() lists: 200 MB
  // Blocks of all images and masks together; an image is a rectangle, and most blocks of a corridor's are empty.
  std::uint64_t blocks = std::uint64_t{1} << 25;

  static CogLimits for_tiles(std::uint64_t tiles);
};

// Throws TiffError: tiff.corrupt, tiff.grid (another coordinate system, resolution or place than the web map's), and
// tiff.layout (strips, planes, 16 bit, a compression that is not read).
CogLevels read_cog_levels(const TiffFile& file, const CogLimits& limits = {});

// Safe to use by several threads. Blocks are read on demand; tables of their offsets stay in memory (16 bytes per
// block).
class CogReader final : public TileSource {
 public:
  // Throws TiffError when the file is not a GeoTIFF on the grid of web maps, Error when it cannot be
  // read at all.
  explicit CogReader(const std::filesystem::path& path);
  explicit CogReader(InputFile file, const CogLimits& limits = {});
  CogReader(std::unique_ptr<RandomBytes> bytes, std::string name, const CogLimits& limits = {});

  ZoomRange zooms() const override;
  // Throws TiffError when the block lies outside of the file, Error when one that has to be decoded does not decode.
  std::optional<Bytes> read(const TileKey& key) const override;
  std::optional<Bytes> read_mask(const TileKey& key) const override;

  const std::vector<CogLevel>& levels() const { return levels_.levels; }  // finest first
  const std::vector<std::string>& left_out() const { return levels_.left_out; }
  const CogLevel* level(int zoom) const;  // null when there is none

  // Addresses that may hold a tile, in the order of TileKey: those with a block. Throws TiffError where there are more
  // than the limit allows.
  std::vector<TileKey> keys() const;
  // Bytes of the tile's block; 0 when there is none, or when blocks are not tiles.
  std::uint64_t stored_size(const TileKey& key) const;

 private:
  struct Window;  // the part of a level that a tile covers

  std::optional<Bytes> block(const CogBlocks& blocks, std::int64_t column, std::int64_t row) const;
  std::optional<std::size_t> native_block(const CogLevel& level, const TileKey& key) const;
  bool any_block(const CogLevel& level, const TileKey& key) const;
  DecodedImage assemble(const CogLevel& level, const TileKey& key) const;
  void paste(const CogBlocks& blocks, const Window& window, DecodedImage& into, bool mask) const;
  bool is_masked(const CogLevel& level, const TileKey& key) const;

  std::unique_ptr<RandomBytes> bytes_;
  std::string name_;
  CogLimits limits_;
  CogLevels levels_;
};

}  // namespace nadir
