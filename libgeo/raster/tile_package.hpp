// Esri's tile packages, .tpkx (github.com/Esri/tile-package-spec): a ZIP archive with
//
//   root.json                        the tiling scheme, which levels there are, how tiles are stored
//   tile/L17/R8000C10c00.bundle      128 x 128 tiles of level 17, from row 0x8000 and column 0x10c00 on
//
// A bundle (compact cache, version 2) begins with 64 bytes and an index: for each of its tiles, row by row, 8 bytes,
// little-endian, whose low 40 bits are where the tile begins in the bundle and whose high 24 bits are its size; 0:
// none.
//
// Read are packages in the scheme of web maps: Web Mercator, levels that halve, tiles of 256 or 512 pixels in JPEG, PNG
// or both. Packages in other schemes are refused. The tiles of the finest level that has any are the tile set.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "base/input_file.hpp"
#include "geodesy/web_mercator.hpp"
#include "imagery/tile_source.hpp"

namespace nadir {

inline constexpr std::string_view kZipMagic{"PK\3\4", 4};

class TilePackageReader final : public TileSource {
 public:
  // Throws Error for anything that is not such a package, or holds no tile.
  explicit TilePackageReader(const InputFile& file);
  ~TilePackageReader() override;

  ZoomRange zooms() const override { return {zoom_, zoom_}; }
  std::optional<Bytes> read(const TileKey& key) const override;

  std::vector<TileKey> keys() const;  // in the order of TileKey

 private:
  struct Entry {
    TileKey key;
    std::uint32_t bundle = 0;
    std::uint32_t size = 0;
    std::uint64_t at = 0;  // in the bundle
  };
  struct OpenBundle;
  [[noreturn]] void refuse(const std::string& where, std::string expected, std::string found) const;
  void read_root();
  void read_level(int level);
  void read_index(std::uint32_t bundle, std::uint32_t first_row, std::uint32_t first_column);
  OpenBundle& opened(std::uint32_t bundle) const;

  std::string path_, folder_;        // of the package; of its bundles in the archive
  std::vector<int> levels_, zooms_;  // that root.json describes, and which zoom of web maps each is
  int zoom_ = 0;
  std::vector<std::string> bundles_;          // names in the archive
  std::vector<Entry> entries_;                // in the order of TileKey
  mutable std::unique_ptr<OpenBundle> open_;  // the last that was read from
};

}  // namespace nadir
