// A square of many tiles, warped at once and averaged down to its overviews in memory: the unit of work of a build.
#pragma once

#include <functional>
#include <map>
#include <span>
#include <vector>

#include "raster/imagery_input.hpp"
#include "raster/mosaic.hpp"
#include "raster/picture.hpp"
#include "raster/raster_source.hpp"
#include "package_build/tile_plan.hpp"
#include "imagery/codecs.hpp"

namespace nadir {

struct TileEncoding {
  ImageFormat format = ImageFormat::jpeg;
  int quality = 75;
  bool lossless = false;  // of WebP: what stands for PNG in a COG
};

struct EncodedTile {
  Sidecar sidecar;
  Bytes bytes;
};

// One tile before it is encoded, with the inputs that it came from.
struct TileCanvas {
  Picture picture;  // kTileSize x kTileSize
  InputShares used;
};

// Encodes the tile. Fills what shows no ground; the mask goes into the sidecar.
class TileEncoder {
 public:
  TileEncoder(const Mission& mission, std::span<const ImageryInput> inputs, TileEncoding encoding);

  EncodedTile encode(const TileKey& key, const TileCanvas& tile) const;  // of a tile that shows some ground

 private:
  Bytes encoded(const cv::Mat& bgr) const;

  const Mission& mission_;
  LocalFrame frame_;
  std::span<const ImageryInput> inputs_;
  TileEncoding encoding_;
};

struct Metatile {
  std::vector<EncodedTile> tiles;  // every zoom from the finest to that of the metatile, those that show ground
  TileCanvas top;                  // the one tile that covers it
};

// The metatile's ground at the finest zoom, before it is cut into tiles.
struct MetatileCanvas {
  Picture picture;
  TileGrid used;
};

// range: the tiles of the finest zoom that are wanted. layers: the topmost first, read by this thread alone.
// feather_px: over how many pixels of the finest zoom seams fade; 0 is hard.
MetatileCanvas compose_metatile(const TileKey& key, const TileRange& range, std::span<const LayerReader> layers,
                                double feather_px);

// Calls visit for every tile that shows ground, from the finest zoom to that of the metatile. Returns the last one.
using VisitTile = std::function<void(const TileKey& key, const TileCanvas& tile)>;
TileCanvas cut_metatile(const TileKey& key, int finest, MetatileCanvas canvas, const VisitTile& visit);

// Both, every tile encoded. layers: in the order of the encoder's inputs.
Metatile render_metatile(const TileKey& key, const TileRange& range, std::span<const LayerReader> layers,
                         double feather_px, const TileEncoder& encoder);

}  // namespace nadir
