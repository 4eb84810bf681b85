#include "package_build/update_layers.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <opencv2/core.hpp>

#include "geodesy/angles.hpp"

namespace nadir {
namespace {

constexpr double kHalfWorld_m = kPi * kMercatorRadius_m;

int floor_tile(int pixel) { return pixel >= 0 ? pixel / kTileSize : -((kTileSize - 1 - pixel) / kTileSize); }

}  // namespace

UpdateLayers::Origin UpdateLayers::origin_of(const Sidecar& sidecar) {
  return {sidecar.source, sidecar.captured_at.unix_s, sidecar.gsd_mm, sidecar.ce90_mm, sidecar.trust};
}

UpdateLayers::UpdateLayers(std::vector<ImageryInput> rasters, const OldMap& old, MosaicOrder order)
    : old_(old), finest_(old.sidecars().empty() ? 0 : old.sidecars().back().key.z), inputs_(std::move(rasters)) {
  for (const Sidecar& sidecar : old.sidecars()) origins_.emplace(origin_of(sidecar), 0);
  for (const auto& [origin, unused] : origins_) {
    const auto& [source, captured_at, gsd_mm, ce90_mm, trust] = origin;
    ImageryInput input;
    input.facts = {{captured_at}, static_cast<double>(gsd_mm) / 1000, static_cast<double>(ce90_mm) / 1000, source};
    input.trust = trust;
    inputs_.push_back(std::move(input));
  }
  inputs_ = in_order(std::move(inputs_), order);
  for (std::size_t i = 0; i < inputs_.size(); ++i) {
    if (is_new(i) || layers_.empty() || !layers_.back().old) layers_.push_back({i, !is_new(i)});
    layer_of_.push_back(layers_.size() - 1);
    if (is_new(i)) continue;
    const ImageryFacts& facts = inputs_[i].facts;
    origins_[{facts.provider, facts.captured_at.unix_s, std::llround(facts.gsd_m * 1000),
              std::llround(facts.ce90_m * 1000), inputs_[i].trust}] = i;
  }
}

std::vector<LayerReader> UpdateLayers::readers() const {
  std::vector<LayerReader> readers;
  for (std::size_t layer = 0; layer < layers_.size(); ++layer) {
    if (layers_[layer].old) {
      readers.emplace_back([this, layer](int zoom, const cv::Rect& pixels) { return read_old(layer, zoom, pixels); });
      continue;
    }
    const ImageryInput& input = inputs_[layers_[layer].first];
    const auto source = std::make_shared<RasterSource>(input.path, input.stretch);
    readers.emplace_back([source](int zoom, const cv::Rect& pixels) { return source->read(zoom, pixels); });
  }
  return readers;
}

Picture UpdateLayers::read_old(std::size_t layer, int zoom, const cv::Rect& pixels) const {
  Picture picture{cv::Mat::zeros(pixels.size(), CV_8UC3), cv::Mat::zeros(pixels.size(), CV_8UC1)};
  for (int y = std::max(0, floor_tile(pixels.y)); y * kTileSize < pixels.br().y; ++y) {
    for (int x = std::max(0, floor_tile(pixels.x)); x * kTileSize < pixels.br().x; ++x) {
      const TileKey key{static_cast<std::uint8_t>(zoom), static_cast<std::uint32_t>(x), static_cast<std::uint32_t>(y)};
      const Sidecar* sidecar = old_.sidecar(key);
      if (sidecar == nullptr || layer_of_[origins_.at(origin_of(*sidecar))] != layer) continue;
      const Picture tile = old_.picture(key);
      const cv::Point corner(x * kTileSize, y * kTileSize);
      const cv::Rect part = pixels & cv::Rect(corner, cv::Size(kTileSize, kTileSize));
      tile.bgr(part - corner).copyTo(picture.bgr(part - pixels.tl()));
      tile.mask(part - corner).copyTo(picture.mask(part - pixels.tl()));
    }
  }
  return picture;
}

InputShares UpdateLayers::by_input(const TileKey& finest, const InputShares& by_layer) const {
  InputShares shares;
  for (const auto& [layer, pixels] : by_layer) {
    if (!layers_[layer].old) {
      shares[layers_[layer].first] += pixels;
    } else if (const Sidecar* sidecar = old_.sidecar(finest); sidecar != nullptr) {
      shares[origins_.at(origin_of(*sidecar))] += pixels;
    }
  }
  return shares;
}

InputShares UpdateLayers::of_old(const TileKey& key) const {
  const Sidecar* sidecar = old_.sidecar(key);
  if (sidecar == nullptr) return {};
  const auto valid = static_cast<std::uint64_t>(kTilePixels * sidecar->valid_ppm / kWholeTile_ppm);
  return {{origins_.at(origin_of(*sidecar)), std::max<std::uint64_t>(1, valid) << (2 * (finest_ - key.z))}};
}

bool UpdateLayers::may_touch(const TileKey& key) const {
  const double tile_m = mercator_pixel_m(key.z) * kTileSize;
  const double west = key.x * tile_m - kHalfWorld_m, north = kHalfWorld_m - key.y * tile_m;
  return std::any_of(inputs_.begin(), inputs_.end(), [&](const ImageryInput& input) {
    if (input.path.empty()) return false;
    double left = std::numeric_limits<double>::max(), bottom = left, right = -left, top = -left;
    for (const MercatorXY& point : input.outline) {
      left = std::min(left, point.x_m), right = std::max(right, point.x_m);
      bottom = std::min(bottom, point.y_m), top = std::max(top, point.y_m);
    }
    // An edge that is bent in this projection may bulge out between the outline's points.
    const double spare_m = mercator_pixel_m(finest_) * kTileSize;
    return left - spare_m < west + tile_m && west < right + spare_m && bottom - spare_m < north &&
           north - tile_m < top + spare_m;
  });
}

}  // namespace nadir
