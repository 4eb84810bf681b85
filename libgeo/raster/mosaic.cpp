#include "raster/mosaic.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <memory>
#include <opencv2/imgproc.hpp>

#include "base/error.hpp"
#include "raster/raster_source.hpp"

namespace nadir {
namespace {

constexpr int kChunk = 4 * kTileSize;  // pixels blended at once: bounds the memory

cv::Rect tile_rect(int column, int row) { return {column * kTileSize, row * kTileSize, kTileSize, kTileSize}; }

// The part of the canvas that is being filled.
struct Target {
  MaskedImage image;
  cv::Point first_tile;  // in the grid
  TileGrid& used;
};

void compose_hard(int zoom, const cv::Rect& pixels, std::span<const LayerReader> layers, Target& target) {
  MaskedImage& image = target.image;
  for (std::size_t i = 0; i < layers.size(); ++i) {
    const MaskedImage layer = layers[i](zoom, pixels);
    if (layer.mask.empty()) continue;
    cv::Mat fresh = layer.mask;
    if (i == 0) {
      layer.bgr.copyTo(image.bgr);
      layer.mask.copyTo(image.mask);
    } else {
      fresh = layer.mask & ~image.mask;
      layer.bgr.copyTo(image.bgr, fresh);
      image.mask |= fresh;
    }
    for (int row = 0; row < pixels.height / kTileSize; ++row) {
      for (int column = 0; column < pixels.width / kTileSize; ++column) {
        const int shown = cv::countNonZero(fresh(tile_rect(column, row)));
        if (shown == 0) continue;
        target.used.at(target.first_tile.x + column, target.first_tile.y + row)[i] = static_cast<std::uint64_t>(shown);
      }
    }
    if (cv::countNonZero(image.mask) == pixels.area()) break;
  }
}

// Accumulates layers from the top: weighted colours, and the transparency that is left.
class Blend {
 public:
  explicit Blend(cv::Size size)
      : colours_(size, CV_32FC3, cv::Scalar::all(0)),
        weights_(size, CV_32F, cv::Scalar(0)),
        transparency_(size, CV_32F, 1.0F) {}

  // Returns the layer's weight at each pixel.
  cv::Mat add(const cv::Mat& bgr, const cv::Mat& alpha) {
    cv::Mat weight(alpha.size(), CV_32F);
    for (int row = 0; row < alpha.rows; ++row) {
      const auto* a = alpha.ptr<float>(row);
      const auto* colour = bgr.ptr<cv::Vec3b>(row);
      auto* left = transparency_.ptr<float>(row);
      auto* sum = colours_.ptr<cv::Vec3f>(row);
      auto* total = weights_.ptr<float>(row);
      auto* own = weight.ptr<float>(row);
      for (int column = 0; column < alpha.cols; ++column) {
        own[column] = left[column] * a[column];
        left[column] *= 1.0F - a[column];
        total[column] += own[column];
        for (int band = 0; band < 3; ++band)
          sum[column][band] += own[column] * static_cast<float>(colour[column][band]);
      }
    }
    return weight;
  }

  bool opaque() const {
    double most = 0;
    cv::minMaxLoc(transparency_, nullptr, &most);
    return most <= 0;
  }

  void finish(MaskedImage& image) const {
    for (int row = 0; row < weights_.rows; ++row) {
      const auto* sum = colours_.ptr<cv::Vec3f>(row);
      const auto* total = weights_.ptr<float>(row);
      for (int column = 0; column < weights_.cols; ++column) {
        if (total[column] <= 0) continue;
        for (int band = 0; band < 3; ++band) {
          image.bgr.at<cv::Vec3b>(row, column)[band] =
              cv::saturate_cast<std::uint8_t>(sum[column][band] / total[column]);
        }
        image.mask.at<std::uint8_t>(row, column) = 255;
      }
    }
  }

 private:
  cv::Mat colours_, weights_, transparency_;
};

// 0 where the layer is invalid, growing to 1 at feather_px from there.
cv::Mat alpha_of(const cv::Mat& mask, double feather_px) {
  if (cv::countNonZero(mask) == mask.rows * mask.cols) return {mask.size(), CV_32F, cv::Scalar(1)};
  cv::Mat distance;
  cv::distanceTransform(mask, distance, cv::DIST_L2, cv::DIST_MASK_PRECISE, CV_32F);
  distance /= feather_px;
  return cv::min(distance, 1.0);
}

void compose_feathered(int zoom, const cv::Rect& pixels, double feather_px, std::span<const LayerReader> layers,
                       Target& target) {
  // Edges beyond the chunk fade pixels inside it: neighbouring chunks must see the same distances.
  const int halo = static_cast<int>(std::ceil(feather_px)) + 1;
  const cv::Rect wide(pixels.x - halo, pixels.y - halo, pixels.width + 2 * halo, pixels.height + 2 * halo);
  const cv::Rect inner({halo, halo}, pixels.size());
  Blend blend(pixels.size());
  for (std::size_t i = 0; i < layers.size() && !blend.opaque(); ++i) {
    const MaskedImage layer = layers[i](zoom, wide);
    if (layer.mask.empty() || cv::countNonZero(layer.mask(inner)) == 0) continue;
    const cv::Mat weight = blend.add(layer.bgr(inner), alpha_of(layer.mask, feather_px)(inner));
    for (int row = 0; row < pixels.height / kTileSize; ++row) {
      for (int column = 0; column < pixels.width / kTileSize; ++column) {
        const double shown = cv::sum(weight(tile_rect(column, row)))[0];
        if (shown <= 0) continue;
        target.used.at(target.first_tile.x + column, target.first_tile.y + row)[i] =
            static_cast<std::uint64_t>(std::max(1LL, std::llround(shown)));
      }
    }
  }
  blend.finish(target.image);
}

}  // namespace

std::vector<ImageryInput> in_order(std::vector<ImageryInput> inputs, MosaicOrder order) {
  std::stable_sort(inputs.begin(), inputs.end(), [order](const ImageryInput& a, const ImageryInput& b) {
    if (order == MosaicOrder::newest) return a.facts.captured_at > b.facts.captured_at;
    return order == MosaicOrder::finest && a.facts.gsd_m < b.facts.gsd_m;
  });
  return inputs;
}

double feather_pixels(const Mission& mission, const MosaicOptions& mosaic) {
  const double pixel_m = ground_resolution_m(mission.zoom.max, mission.takeoff.lat_deg);
  const double pixels = mosaic.feather_m / pixel_m;
  if (pixels <= kMaxFeather_px) return pixels;
  throw UsageError({.what = "the feather is too wide",
                    .where = "--feather-m",
                    .expected = fmt::format("at most {:.0f} m at zoom {}", kMaxFeather_px * pixel_m, mission.zoom.max),
                    .found = fmt::format("{} m", mosaic.feather_m)});
}

bool lies_near(const ImageryInput& input, int zoom, const cv::Rect& pixels) {
  constexpr double kNear_px = 1024;  // more than the widest seam, and than a raster that is rotated against the map
  double west_m = INFINITY, south_m = INFINITY, east_m = -INFINITY, north_m = -INFINITY;
  for (const MercatorXY& point : input.outline) {
    west_m = std::min(west_m, point.x_m), east_m = std::max(east_m, point.x_m);
    south_m = std::min(south_m, point.y_m), north_m = std::max(north_m, point.y_m);
  }
  const double pixel_m = mercator_pixel_m(zoom);
  return (pixels.x - kNear_px) * pixel_m - kMercatorHalfWorld_m < east_m &&
         (pixels.br().x + kNear_px) * pixel_m - kMercatorHalfWorld_m > west_m &&
         kMercatorHalfWorld_m - (pixels.y - kNear_px) * pixel_m > south_m &&
         kMercatorHalfWorld_m - (pixels.br().y + kNear_px) * pixel_m < north_m;
}

namespace {

// The rasters that one thread reads.
class OpenRasters {
 public:
  explicit OpenRasters(std::span<const ImageryInput> inputs) : inputs_(inputs) {}

  MaskedImage read(std::size_t input, int zoom, const cv::Rect& pixels) {
    return lies_near(inputs_[input], zoom, pixels) ? opened(input).read(zoom, pixels) : MaskedImage();
  }

 private:
  struct Open {
    RasterSource source;
    std::uint64_t last_use = 0;
  };

  RasterSource& opened(std::size_t input) {
    constexpr std::size_t kMostOpen = 64;
    auto found = open_.find(input);
    if (found == open_.end()) {
      if (open_.size() == kMostOpen) {
        open_.erase(std::min_element(open_.begin(), open_.end(), [](const auto& a, const auto& b) {
          return a.second.last_use < b.second.last_use;
        }));
      }
      found = open_.emplace(input, Open{RasterSource(inputs_[input].path, inputs_[input].stretch)}).first;
    }
    found->second.last_use = ++uses_;
    return found->second.source;
  }

  std::span<const ImageryInput> inputs_;
  std::map<std::size_t, Open> open_;
  std::uint64_t uses_ = 0;
};

}  // namespace

std::vector<LayerReader> layers_of(std::span<const ImageryInput> inputs) {
  const auto rasters = std::make_shared<OpenRasters>(inputs);
  std::vector<LayerReader> layers;
  for (std::size_t i = 0; i < inputs.size(); ++i) {
    layers.emplace_back([rasters, i](int zoom, const cv::Rect& pixels) { return rasters->read(i, zoom, pixels); });
  }
  return layers;
}

void compose_layers(int zoom, const cv::Rect& pixels, cv::Point at, double feather_px,
                    std::span<const LayerReader> layers, MaskedImage& canvas, TileGrid& used) {
  const auto part_of = [&](const cv::Rect& place) {
    return Target{{canvas.bgr(place), canvas.mask(place)}, {place.x / kTileSize, place.y / kTileSize}, used};
  };
  if (feather_px <= 0 || layers.size() < 2) {
    Target target = part_of({at, pixels.size()});
    compose_hard(zoom, pixels, layers, target);
    return;
  }
  for (int row = 0; row < pixels.height; row += kChunk) {
    for (int column = 0; column < pixels.width; column += kChunk) {
      const cv::Rect chunk(column, row, std::min(kChunk, pixels.width - column), std::min(kChunk, pixels.height - row));
      Target target = part_of(chunk + at);
      compose_feathered(zoom, chunk + pixels.tl(), feather_px, layers, target);
    }
  }
}

}  // namespace nadir
