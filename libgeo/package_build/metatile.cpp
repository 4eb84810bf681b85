#include "package_build/metatile.hpp"

#include <algorithm>
#include <opencv2/core.hpp>

#include "imagery/lossless_webp.hpp"
#include "package/mission_check.hpp"

namespace nadir {
namespace {

cv::Rect tile_rect(int column, int row) { return {column * kTileSize, row * kTileSize, kTileSize, kTileSize}; }

TileGrid merged(const TileGrid& used, int across) {
  const int half = across / 2;
  TileGrid result(half);
  for (int row = 0; row < across; ++row) {
    for (int column = 0; column < across; ++column) {
      InputShares& target = result.at(column / 2, row / 2);
      const InputShares& source = used.at(column, row);
      for (const auto& [input, pixels] : source) target[input] += pixels;
    }
  }
  return result;
}

}  // namespace

TileEncoder::TileEncoder(const Mission& mission, std::span<const ImageryInput> inputs, TileEncoding encoding)
    : mission_(mission), frame_(mission_frame(mission)), inputs_(inputs), encoding_(encoding) {}

Bytes TileEncoder::encoded(const cv::Mat& bgr) const {
  return encoding_.lossless ? encode_lossless_webp(bgr) : encode_image(bgr, encoding_.format, encoding_.quality);
}

EncodedTile TileEncoder::encode(const TileKey& key, const TileCanvas& tile) const {
  EncodedTile result;
  result.sidecar.key = key;
  set_facts(result.sidecar, inputs_, tile.used);
  if (const Sector* sector = governing_sector(mission_, frame_, key); sector != nullptr) {
    result.sidecar.sector = sector->id;
  }
  const int valid = cv::countNonZero(tile.picture.mask);
  if (valid == kTilePixels) {
    result.bytes = encoded(tile.picture.bgr);
  } else {
    Picture filled{tile.picture.bgr.clone(), tile.picture.mask.clone()};
    fill_unknown(filled);
    result.bytes = encoded(filled.bgr);
    result.sidecar.valid_ppm = kWholeTile_ppm * valid / kTilePixels;
    result.sidecar.mask = encode_image(tile.picture.mask, ImageFormat::png);
  }
  result.sidecar.sha256 = sha256(result.bytes);
  return result;
}

MetatileCanvas compose_metatile(const TileKey& key, const TileRange& range, std::span<const LayerReader> layers,
                                double feather_px) {
  const int steps = range.zoom - key.z, across = 1 << steps;
  const std::int64_t x = std::int64_t{key.x} << steps, y = std::int64_t{key.y} << steps;
  const std::int64_t first_x = std::max(x, range.first_x), last_x = std::min(x + across - 1, range.last_x);
  const std::int64_t first_y = std::max(y, range.first_y), last_y = std::min(y + across - 1, range.last_y);

  MetatileCanvas canvas{{cv::Mat::zeros(across * kTileSize, across * kTileSize, CV_8UC3),
                         cv::Mat::zeros(across * kTileSize, across * kTileSize, CV_8UC1)},
                        TileGrid(across)};
  if (first_x <= last_x && first_y <= last_y) {
    const auto pixels = [](std::int64_t tiles) { return static_cast<int>(tiles) * kTileSize; };
    const cv::Rect rect(pixels(first_x), pixels(first_y), pixels(last_x - first_x + 1), pixels(last_y - first_y + 1));
    compose(range.zoom, rect, {pixels(first_x - x), pixels(first_y - y)}, feather_px, layers, canvas.picture,
            canvas.used);
  }
  return canvas;
}

TileCanvas cut_metatile(const TileKey& key, int finest, MetatileCanvas canvas, const VisitTile& visit) {
  auto& [picture, used] = canvas;
  const int steps = finest - key.z;
  for (int step = 0, across = 1 << steps; step <= steps; ++step, across /= 2) {
    for (int column = 0; column < across; ++column) {
      for (int row = 0; row < across; ++row) {
        const cv::Rect rect = tile_rect(column, row);
        const TileCanvas tile{{picture.bgr(rect), picture.mask(rect)}, used.at(column, row)};
        if (cv::countNonZero(tile.picture.mask) == 0) continue;
        visit({static_cast<std::uint8_t>(finest - step), (key.x << (steps - step)) + static_cast<std::uint32_t>(column),
               (key.y << (steps - step)) + static_cast<std::uint32_t>(row)},
              tile);
      }
    }
    if (step == steps) break;
    picture = halved(picture);
    used = merged(used, across);
  }
  return {picture, used.at(0, 0)};
}

Metatile render_metatile(const TileKey& key, const TileRange& range, std::span<const LayerReader> layers,
                         double feather_px, const TileEncoder& encoder) {
  Metatile result;
  result.top = cut_metatile(
      key, range.zoom, compose_metatile(key, range, layers, feather_px),
      [&](const TileKey& tile_key, const TileCanvas& tile) { result.tiles.push_back(encoder.encode(tile_key, tile)); });
  return result;
}

}  // namespace nadir
