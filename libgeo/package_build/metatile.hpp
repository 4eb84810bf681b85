// A square block of tiles, warped at once and averaged down to its overviews in memory: the unit of work of a build,
// and what its journal keeps.
#pragma once

#include <functional>
#include <map>
#include <optional>
#include <span>
#include <vector>

#include "imagery/codecs.hpp"
#include "package_build/build_plan.hpp"
#include "raster/imagery_input.hpp"
#include "raster/masked_image.hpp"
#include "raster/mosaic.hpp"
#include "raster/raster_source.hpp"

namespace nadir {

struct TileEncoding {
  ImageFormat format = ImageFormat::jpeg;
  int quality = 75;
  bool lossless = false;  // WebP only: the replacement of PNG in a COG
};

struct EncodedTile {
  Sidecar sidecar;
  Bytes bytes;
};

// One tile before it is encoded, with the inputs that contribute to it.
struct TileCanvas {
  MaskedImage image;  // kTileSize x kTileSize
  InputShares used;
};

// Encodes tiles. Fills invalid pixels; the mask goes into the sidecar.
class TileEncoder {
 public:
  TileEncoder(const Mission& mission, std::span<const ImageryInput> inputs, TileEncoding encoding);

  EncodedTile encode(const TileKey& key, const TileCanvas& tile) const;  // of a tile with at least one valid pixel

 private:
  Bytes encoded(const cv::Mat& bgr) const;

  const Mission& mission_;
  LocalFrame frame_;
  std::span<const ImageryInput> inputs_;
  TileEncoding encoding_;
};

struct Metatile {
  std::vector<EncodedTile> tiles;  // every zoom from the finest to that of the metatile, without empty tiles
  TileCanvas top;                  // the one tile that covers it
};

// The metatile's pixels at the finest zoom, before they are cut into tiles.
struct MetatileCanvas {
  MaskedImage image;
  TileGrid used;
};

// range: the wanted tiles of the finest zoom. layers: the topmost first, read by this thread only. feather_px: width of
// the seams in pixels of the finest zoom; 0 is hard.
MetatileCanvas compose_metatile(const TileKey& key, const TileRange& range, std::span<const LayerReader> layers,
                                double feather_px);

// Calls visit for every tile with a valid pixel, from the finest zoom to that of the metatile. Returns the top tile.
using VisitTile = std::function<void(const TileKey& key, const TileCanvas& tile)>;
TileCanvas cut_metatile(const TileKey& key, int finest, MetatileCanvas canvas, const VisitTile& visit);

// Both, every tile encoded. layers: in the order of the encoder's inputs.
Metatile render_metatile(const TileKey& key, const TileRange& range, std::span<const LayerReader> layers,
                         double feather_px, const TileEncoder& encoder);

// A metatile as a record of the build's journal, which guards the bytes by digests. The layout is private to one
// version of the program.

Bytes serialize_metatile(const Metatile& metatile);
std::optional<Metatile> parse_metatile(ByteView record);  // nullopt when the layout does not fit

}  // namespace nadir
