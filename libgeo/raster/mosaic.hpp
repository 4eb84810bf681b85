// Several rasters as one map: which lies on top of which, and how one gives way to the next.
//
// Hard seams: the topmost raster with ground shows. Feathered seams: a raster that ends where another continues fades
// out over the last metres before its edge (an alpha that grows linearly with the distance from the nearest place where
// it shows nothing); where nothing lies below, nothing fades.
#pragma once

#include <functional>
#include <span>
#include <vector>

#include "raster/imagery_input.hpp"
#include "raster/picture.hpp"
#include "raster/raster_source.hpp"
#include "package/mission.hpp"

namespace nadir {

// priority: as given. newest, finest: by capture time or ground sample distance; as given among equals.
enum class MosaicOrder { priority, newest, finest };

struct MosaicOptions {
  MosaicOrder order = MosaicOrder::priority;
  double feather_m = 0;  // 0: hard seams
};

// The same inputs, the topmost first.
std::vector<ImageryInput> in_order(std::vector<ImageryInput> inputs, MosaicOrder order);

// Fading over more pixels than this would take more memory than a build may.
inline constexpr double kMaxFeather_px = 256;

// The feather in pixels of the mission's finest zoom. Throws UsageError beyond kMaxFeather_px.
double feather_pixels(const Mission& mission, const MosaicOptions& mosaic);

// Which inputs show in each tile of a square of tiles.
class TileGrid {
 public:
  explicit TileGrid(int across) : across_(static_cast<std::size_t>(across)), cells_(across_ * across_) {}

  InputShares& at(int column, int row) {
    return cells_[static_cast<std::size_t>(row) * across_ + static_cast<std::size_t>(column)];
  }
  const InputShares& at(int column, int row) const {
    return cells_[static_cast<std::size_t>(row) * across_ + static_cast<std::size_t>(column)];
  }

 private:
  std::size_t across_;
  std::vector<InputShares> cells_;
};

// One layer of a mosaic: a rectangle of global pixels of a zoom; mask 0 where the layer shows nothing.
using LayerReader = std::function<Picture(int zoom, const cv::Rect& pixels)>;

// The rasters as layers; they must outlive the readers.
std::vector<LayerReader> layers_of(std::vector<RasterSource>& sources);

// Fills the canvas from `at` on with the given pixels of the zoom, whole tiles, and notes which of the layers, the
// topmost first, show where. The canvas begins without any ground.
void compose(int zoom, const cv::Rect& pixels, cv::Point at, double feather_px, std::span<const LayerReader> layers,
             Picture& canvas, TileGrid& used);

}  // namespace nadir
