// A cache of decoded tiles (least recently used out first): overlapping windows decode their common tiles once. A tile
// that could not be read is a hole at first, and is read again at every eighth request: what fails once in flight, a
// bad contact of the storage medium, is not missing for the rest of it, and a medium that is broken is not asked each
// time.
#pragma once

#include <compare>
#include <cstddef>
#include <list>
#include <map>
#include <opencv2/core/mat.hpp>

#include "imagery/codecs.hpp"
#include "imagery/tile_source.hpp"

namespace nadir {

struct DecodedTile {
  cv::Mat image;  // empty when the set does not hold the tile, or it could not be read
  cv::Mat mask;   // CV_8UC1, 255 = ground; empty when every pixel is
};

class TileCache {
 public:
  TileCache(const TileSource& tiles, std::size_t capacity) : tiles_(&tiles), capacity_(capacity) {}

  // shrink: a power of two up to 256; the tile then has 256 / shrink pixels a side, averaged, and a pixel is
  // valid when all that it averages are. Throws Error for tiles that do not decode to 256 x 256 pixels.
  const DecodedTile& get(const TileKey& key, Colour colour, int shrink);

  const TileSource& source() const { return *tiles_; }

 private:
  struct Key {
    TileKey tile;
    Colour colour;
    int shrink;
    auto operator<=>(const Key&) const = default;
  };
  struct Entry {
    Key key;
    DecodedTile tile;
    int requests = 0;  // for a hole, since it was last read
  };
  DecodedTile decode(const Key& key) const;

  const TileSource* tiles_;
  std::size_t capacity_;
  std::list<Entry> recent_;  // most recently used first
  std::map<Key, std::list<Entry>::iterator> places_;
};

}  // namespace nadir
