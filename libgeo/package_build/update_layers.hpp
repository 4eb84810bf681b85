// What an updated map is made of: the new rasters and the tiles of the old package, ordered by the same rule as the
// rasters of a build. Old tiles have origins, sets of one source, date and accuracy; each takes the place of a raster.
//
// Origins that lie next to each other in the order are one layer, so that nothing fades between them.
#pragma once

#include <map>
#include <memory>
#include <tuple>
#include <vector>

#include "raster/mosaic.hpp"
#include "package_build/update_old_map.hpp"

namespace nadir {

class UpdateLayers {
 public:
  // Among equals new imagery lies on top. old must outlive this.
  UpdateLayers(std::vector<ImageryInput> rasters, const OldMap& old, MosaicOrder order);

  // New rasters and old origins, the topmost first: what InputShares refer to.
  const std::vector<ImageryInput>& inputs() const { return inputs_; }
  bool is_new(std::size_t input) const { return !inputs_[input].path.empty(); }

  // For one thread; opens the rasters. This must outlive them.
  std::vector<LayerReader> readers() const;

  // From shares by layer in a tile of the finest zoom, as compose() notes them, to shares by input.
  InputShares by_input(const TileKey& finest, const InputShares& by_layer) const;
  // Of an old tile of any zoom, in pixels of the finest; empty when there is none.
  InputShares of_old(const TileKey& key) const;

  // Whether a new raster may show in the tile: its outline's box touches it.
  bool may_touch(const TileKey& key) const;

 private:
  struct Layer {
    std::size_t first = 0;  // of its inputs
    bool old = false;
  };
  using Origin = std::tuple<std::string, std::int64_t, std::int64_t, std::int64_t, TileTrust>;
  static Origin origin_of(const Sidecar& sidecar);
  Picture read_old(std::size_t layer, int zoom, const cv::Rect& pixels) const;

  const OldMap& old_;
  int finest_;
  std::vector<ImageryInput> inputs_;
  std::map<Origin, std::size_t> origins_;  // to the input
  std::vector<Layer> layers_;
  std::vector<std::size_t> layer_of_;  // by input
};

}  // namespace nadir
