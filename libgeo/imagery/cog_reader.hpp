// Reads a tile set in a Cloud Optimized GeoTIFF, without GDAL: Nadir's own, and others' on the same grid. Where blocks
// are tiles of JPEG or WebP, a tile is the block's bytes (with the JPEG tables that blocks share put back in);
// elsewhere (deflate, LZW, blocks of 512 pixels, pictures that begin inside a tile) it is cut out of the decoded blocks
// and becomes a PNG, transparent where the file says that nothing is shown.
//
// Safe to use by several threads. A block is read when it is asked for; tables of places stay in memory (16 bytes per
// block).
#pragma once

#include <filesystem>
#include <memory>
#include <optional>
#include <vector>

#include "imagery/cog_levels.hpp"
#include "imagery/tile_source.hpp"

namespace nadir {

class CogReader final : public TileSource {
 public:
  // Throws CogError when the file is no GeoTIFF on the grid of web maps (codes: cog_tiff.hpp), Error when it cannot be
  // read at all.
  explicit CogReader(const std::filesystem::path& path);
  CogReader(std::unique_ptr<RandomBytes> bytes, std::string name);

  ZoomRange zooms() const override;
  // Throws CogError when the block lies outside of the file, Error when one that has to be decoded does not decode.
  std::optional<Bytes> read(const TileKey& key) const override;
  std::optional<Bytes> read_mask(const TileKey& key) const override;

  const std::vector<CogLevel>& levels() const { return levels_.levels; }  // finest first
  const std::vector<std::string>& left_out() const { return levels_.left_out; }
  const CogLevel* level(int zoom) const;  // null when there is none

  // Addresses that may hold a tile, in the order of TileKey: those with a block.
  std::vector<TileKey> keys() const;
  // Bytes of the tile's block; 0 when there is none, or when blocks are no tiles.
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
  CogLevels levels_;
};

}  // namespace nadir
