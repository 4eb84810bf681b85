// Several rasters as one map: their order, and how one blends into the next.
//
// Hard seams: the topmost valid pixel shows. Feathered seams: a raster that ends where another continues fades out over
// the last pixels before its edge. With d the distance to the nearest invalid pixel of the layer and f the feather,
//   alpha_i = min(1, d / f),  weight_i = alpha_i prod_{j<i} (1 - alpha_j),  colour = sum weight_i colour_i / sum
//   weight_i
// so that nothing fades where no layer lies below.
#pragma once

#include <functional>
#include <span>
#include <vector>

#include "package/mission.hpp"
#include "raster/imagery_input.hpp"
#include "raster/masked_image.hpp"

namespace nadir {

// priority: as given. newest, finest: by capture time or ground sample distance; as given among equals.
enum class MosaicOrder { priority, newest, finest };

struct MosaicOptions {
  MosaicOrder order = MosaicOrder::priority;
  double feather_m = 0;  // 0: hard seams
};

// The same inputs, the topmost first. Stable.
std::vector<ImageryInput> in_order(std::vector<ImageryInput> inputs, MosaicOrder order);

// A wider feather would exceed the memory budget of a build.
inline constexpr double kMaxFeather_px = 256;

// The feather in pixels of the mission's finest zoom. Throws UsageError beyond kMaxFeather_px.
double feather_pixels(const Mission& mission, const MosaicOptions& mosaic);

// Which inputs show in each tile of a square block of tiles.
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

// Reads one layer of a mosaic: a rectangle of global pixels of a zoom; mask 0 where the layer shows nothing. Empty
// images when it shows nothing in all of it.
using LayerReader = std::function<MaskedImage(int zoom, const cv::Rect& pixels)>;

// Whether the raster may show in this rectangle, or a seam beside it: the box of its outline touches, or lies near.
bool lies_near(const ImageryInput& input, int zoom, const cv::Rect& pixels);

// The rasters as layers for one thread; the inputs must outlive the readers. A raster is opened when pixels are wanted
// that it lies near, and closed when too many others are open: the number of inputs costs neither memory nor file
// handles, and a part of a large map opens only what lies there.
std::vector<LayerReader> layers_of(std::span<const ImageryInput> inputs);

// Fills the canvas from `at` on with the given pixels of the zoom, whole tiles, and records which of the layers, the
// topmost first, show in which tile. The canvas must be empty (mask 0) before.
void compose_layers(int zoom, const cv::Rect& pixels, cv::Point at, double feather_px,
                    std::span<const LayerReader> layers, MaskedImage& canvas, TileGrid& used);

}  // namespace nadir
