// Tiles whose water is not ground: for surveys of matchability, where the package's vectors show it.
//
// What an image shows of a water surface, such as waves, glint, colour and boats, is of its moment. A survey that takes
// the map itself for the frame of another day finds it again all the same, and so believes too much of it. Masked,
// water neither supports a match nor competes with one, and a frame that is mostly water shows too little ground
// (kMinValidShare). Its banks remain. Lines of rivers and streams are not masked, because their width is not known.
#pragma once

#include <vector>

#include "geodesy/web_mercator.hpp"
#include "imagery/tile_source.hpp"
#include "package/vector_layer.hpp"

namespace nadir {

class WaterMaskedTiles final : public TileSource {
 public:
  // Both must outlive it. Safe to read from several threads where `tiles` is.
  WaterMaskedTiles(const TileSource& tiles, const VectorLayer& vectors);

  std::size_t areas() const { return areas_.size(); }  // of water

  ZoomRange zooms() const override { return tiles_.zooms(); }
  std::optional<Bytes> read(const TileKey& key) const override { return tiles_.read(key); }
  std::optional<Bytes> read_mask(const TileKey& key) const override;  // as the tiles have it where there is no water
  std::optional<double> ce90_m(const TileKey& key) const override { return tiles_.ce90_m(key); }

 private:
  struct Area {
    const MapVector* vector;
    LonLatBox box;
  };
  const TileSource& tiles_;
  std::vector<Area> areas_;
};

}  // namespace nadir
