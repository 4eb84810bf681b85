// The two files of a place index (docs/formats/place-index.md).
//
// index/places.faiss: one vector per chunk of the map in a flat index of FAISS (IndexFlatIP), searched for the largest
// inner products. A flat search is exact, needs no training, and gives the same answer everywhere; 50 000 vectors take
// 25.6 MB and some milliseconds per query.
// index/places.json: what the vectors stand for: where each chunk lies, how large it is, how it was described, and of
// which imagery.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "base/bytes.hpp"
#include "base/digest.hpp"
#include "base/progress.hpp"
#include "geodesy/lon_lat.hpp"
#include "geodesy/web_mercator.hpp"
#include "vision/place_descriptor.hpp"

namespace nadir {

// Names inside a package, and the artifacts' roles in its manifest.
inline constexpr std::string_view kPlaceIndexFile = "index/places.faiss";
inline constexpr std::string_view kPlaceTableFile = "index/places.json";
inline constexpr std::string_view kRolePlaceIndex = "place-index";
inline constexpr std::string_view kRolePlaceTable = "place-table";

inline constexpr std::string_view kPlaceTableSchema = "nadir.place-table/1";
inline constexpr std::string_view kPlaceDescriptorName = "ogc6x8x8/1";  // changes with every change of the descriptor
inline constexpr std::size_t kMaxPlaceChunks = 1'000'000;
inline constexpr std::size_t kMaxPlaceLayers = 16;
inline constexpr std::uint64_t kMaxPlaceTableSize = std::uint64_t{96} << 20;

// Chunks of one size, made for one height above ground.
struct PlaceLayer {
  std::int64_t side_mm = 0;
  std::int64_t side_px = 0;  // of the patch that is described
  std::size_t first = 0;     // of its chunks
  std::size_t count = 0;
  std::size_t textureless = 0;  // omitted: water and the like
  std::size_t invalid = 0;      // omitted: too little of them shows ground

  double side_m() const { return static_cast<double>(side_mm) / 1000; }
  double gsd_m() const { return side_m() / static_cast<double>(side_px); }
};

struct PlaceChunk {
  std::int64_t lon_e7 = 0;  // of the middle
  std::int64_t lat_e7 = 0;
  TileKey tile;  // of the finest zoom, under the middle

  LonLat centre() const { return {static_cast<double>(lon_e7) / 1e7, static_cast<double>(lat_e7) / 1e7}; }
};

struct PlaceTable {
  Sha256 imagery_root;             // Merkle root of the tiles that were described
  std::int64_t origin_lon_e7 = 0;  // of the plane in which the chunks are squares
  std::int64_t origin_lat_e7 = 0;
  std::int64_t overlap_percent = 75;  // of neighbouring chunks, along a side
  std::int64_t zoom = 0;              // of the chunks' tiles
  std::vector<PlaceLayer> layers;
  std::vector<PlaceChunk> chunks;  // layer by layer, rows from the south
  PlaceProjection projection;

  LonLat origin() const { return {static_cast<double>(origin_lon_e7) / 1e7, static_cast<double>(origin_lat_e7) / 1e7}; }
};

std::string place_table_json(const PlaceTable& table);

// Strict. Throws Error for what is not exactly such a table.
PlaceTable parse_place_table(std::string_view json, std::string_view name);

// The vectors, on disk and for queries.
class PlaceVectors {
 public:
  explicit PlaceVectors(std::span<const PlaceVector> vectors);
  // Throws Error unless the bytes are a flat inner-product index of exactly `count` vectors of kPlaceSize, to the byte:
  // sizes are compared before anything is allocated for them.
  PlaceVectors(ByteView file, std::size_t count, std::string_view name);
  ~PlaceVectors();
  PlaceVectors(PlaceVectors&&) noexcept;
  PlaceVectors& operator=(PlaceVectors&&) noexcept;

  Bytes file() const;
  std::size_t size() const;
  std::span<const float> vector(std::size_t index) const;

  struct Hit {
    std::size_t index = 0;
    float score = -1;
  };
  // Of the vectors first … first + count − 1: for each query the `best` nearest, best first, fewer when there are
  // fewer. The same on any number of threads. `cancel` is checked before each batch of queries.
  std::vector<std::vector<Hit>> search(std::span<const PlaceVector> queries, std::size_t first, std::size_t count,
                                       std::size_t best, const Cancel& cancel = {}) const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace nadir
