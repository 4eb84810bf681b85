// A world whose colour at every place is known: waves along the global pixels of one zoom.
#pragma once

#include <functional>
#include <map>
#include <numbers>
#include <opencv2/core.hpp>

#include "geodesy/web_mercator.hpp"
#include "imagery/codecs.hpp"
#include "imagery/tile_source.hpp"

namespace nadir::test {

// Blue is a wave along x, green one along y, red constant; 64 pixels of the zoom `finest` long.
class WaveTiles final : public TileSource {
 public:
  WaveTiles(ZoomRange zooms, int finest) : zooms_(zooms), finest_(finest) {}

  static double wave(double position) { return 128.0 + 100.0 * std::sin(position * (2.0 * std::numbers::pi / 64.0)); }
  static double slope(double position) {
    return 100.0 * (2.0 * std::numbers::pi / 64.0) * std::cos(position * (2.0 * std::numbers::pi / 64.0));
  }

  ZoomRange zooms() const override { return zooms_; }
  std::optional<Bytes> read(const TileKey& key) const override {
    ++reads[key];
    if (missing(key)) return std::nullopt;
    const double scale = std::exp2(finest_ - key.z);
    cv::Mat tile(kTileSize, kTileSize, CV_8UC3);
    for (int row = 0; row < kTileSize; ++row) {
      for (int column = 0; column < kTileSize; ++column) {
        const double x = (static_cast<double>(key.x) * kTileSize + column + 0.5) * scale;
        const double y = (static_cast<double>(key.y) * kTileSize + row + 0.5) * scale;
        tile.at<cv::Vec3b>(row, column) = {cv::saturate_cast<std::uint8_t>(wave(x)),
                                           cv::saturate_cast<std::uint8_t>(wave(y)),
                                           static_cast<std::uint8_t>(10 * (key.z % 20))};
      }
    }
    return encode_image(tile, ImageFormat::png);
  }
  std::optional<Bytes> read_mask(const TileKey& key) const override { return mask ? mask(key) : std::nullopt; }

  std::optional<double> ce90_m(const TileKey& key) const override { return ce90 ? ce90(key) : std::nullopt; }

  mutable std::map<TileKey, int> reads;
  std::function<bool(const TileKey&)> missing = [](const TileKey&) { return false; };
  std::function<std::optional<Bytes>(const TileKey&)> mask;
  std::function<std::optional<double>(const TileKey&)> ce90;

 private:
  ZoomRange zooms_;
  int finest_;
};

}  // namespace nadir::test
