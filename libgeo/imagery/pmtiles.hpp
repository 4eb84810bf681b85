// Tile sets in PMTiles files, version 3 (github.com/protomaps/PMTiles, spec/v3): one file that web maps, MapLibre and
// QGroundControl read by ranges, without a server.
//
//   header       127 bytes, little-endian
//   root         directory; header and root lie in the first 16 KiB
//   metadata     JSON object
//   leaves       directories that the root names, when it would be larger than that
//   tiles        encoded images, in the order of their ids ("clustered")
//
// A tile's id counts all tiles of the zooms above, and then along a Hilbert curve of its own zoom (XYZ). An entry of a
// directory names the bytes of as many consecutive ids as have the same content; each content is there once.
// Directories and metadata are compressed by gzip, tiles are not: they are the bytes of the tile set.
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "base/bytes.hpp"
#include "base/digest.hpp"
#include "base/input_file.hpp"
#include "geodesy/web_mercator.hpp"
#include "imagery/codecs.hpp"
#include "imagery/tile_source.hpp"

namespace nadir {

inline constexpr std::string_view kPmtilesMagic{"PMTiles\3", 8};

std::uint64_t pmtiles_id(const TileKey& key);
std::optional<TileKey> tile_of_pmtiles_id(std::uint64_t id);  // nullopt: beyond kMaxZoom

// What is known of a tile before its bytes are written.
struct PmtilesTile {
  TileKey key;
  Sha256 sha256;
  std::uint32_t size = 0;  // bytes
};

struct PmtilesFacts {
  ImageFormat format = ImageFormat::jpeg;
  LonLatBox bounds;
  std::string metadata;  // a JSON object
};

struct PmtilesCounts {
  std::uint64_t tiles = 0, entries = 0, contents = 0;
};

// read: the bytes of a tile, asked for once for each content, in the order of ids; written: after each. Memory: the
// tiles' facts and the directories, about 160 bytes for each tile. The same tiles and facts give the same bytes. The
// file is created, and is whole and closed when this returns. Throws Error when it exists, when a tile is there twice,
// and when `read` returns another size than stated.
PmtilesCounts write_pmtiles(const std::filesystem::path& path, std::vector<PmtilesTile> tiles,
                            const PmtilesFacts& facts, const std::function<Bytes(const TileKey&)>& read,
                            const std::function<void()>& written);

// Raster tiles that are not compressed a second time. Directories are read and checked when the file is opened, up to
// 16 777 216 entries (24 bytes each).
class PmtilesReader final : public TileSource {
 public:
  // Throws Error for anything that is not such a file: what, where in it, and what was expected.
  explicit PmtilesReader(InputFile file);

  ZoomRange zooms() const override { return zooms_; }  // of the tiles that are there
  std::optional<Bytes> read(const TileKey& key) const override;

  std::vector<TileKey> keys() const;  // in the order of TileKey; throws Error where there are more than 16 777 216
  std::optional<std::uint32_t> stored_size(const TileKey& key) const;
  const std::string& metadata() const { return metadata_; }  // the JSON as it is in the file
  std::string_view tile_type() const;                        // "jpg", "png", "webp"

 private:
  struct Entry {
    std::uint64_t id = 0;
    std::uint64_t at = 0;  // in the file
    std::uint32_t size = 0;
    std::uint32_t run = 0;
  };
  struct Section {
    std::uint64_t at = 0, size = 0;
  };
  [[noreturn]] void refuse(const std::string& where, std::string expected, std::string found) const;
  Section section(ByteView header, std::size_t field, const char* name) const;
  Bytes inflate(const Section& part, std::uint64_t limit, const std::string& where) const;
  void read_directory(const Section& part, int depth);
  const Entry* find(const TileKey& key) const;

  InputFile file_;
  Section leaves_, data_;
  std::uint8_t tile_type_ = 0, internal_compression_ = 0;
  std::string metadata_;
  ZoomRange zooms_;
  std::vector<Entry> entries_;  // by id, without overlap
};

}  // namespace nadir
