// Several rasters as one map: which lies on top of which, and how one gives way to the next.
//
// Hard seams: the topmost raster with ground shows. Feathered seams: a raster that ends where another continues fades
// out over the last metres before its edge (an alpha that grows linearly with the distance from the nearest place where
// it shows nothing); where nothing lies below, nothing fades.
#pragma once

#include <vector>

#include "ground/imagery_input.hpp"
#include "ground/picture.hpp"
#include "ground/raster_source.hpp"

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

// Fills the canvas from `at` on with the given pixels of the zoom, whole tiles, and notes who shows where. The canvas
// begins without any ground.
void compose(int zoom, const cv::Rect& pixels, cv::Point at, double feather_px, std::vector<RasterSource>& sources,
             Picture& canvas, TileGrid& used);

}  // namespace nadir
