#include "imagery/tile_cache.hpp"

#include <fmt/format.h>

#include <opencv2/imgproc.hpp>

#include "base/error.hpp"
#include "imagery/codecs.hpp"

namespace nadir {
namespace {

constexpr int kHoleRequests = 8;  // a hole is read again at every so many requests

void check_tile_size(const cv::Mat& image, const std::string& name) {
  if (image.cols == kTileSize && image.rows == kTileSize) return;
  throw Error({.what = "a map tile has the wrong size",
               .where = name,
               .expected = fmt::format("{0} x {0} pixels", kTileSize),
               .found = fmt::format("{} x {}", image.cols, image.rows)});
}

}  // namespace

const DecodedTile& TileCache::get(const TileKey& key, Colour colour, int shrink) {
  const Key wanted{key, colour, shrink};
  if (const auto found = places_.find(wanted); found != places_.end()) {
    recent_.splice(recent_.begin(), recent_, found->second);
    Entry& entry = recent_.front();
    if (entry.tile.image.empty() && ++entry.requests >= kHoleRequests) {
      entry.requests = 0;
      entry.tile = decode(wanted);
    }
    return entry.tile;
  }
  recent_.push_front({wanted, decode(wanted)});
  places_[wanted] = recent_.begin();
  if (recent_.size() > capacity_ && recent_.size() > 1) {
    places_.erase(recent_.back().key);
    recent_.pop_back();
  }
  return recent_.front().tile;
}

DecodedTile TileCache::decode(const Key& key) const {
  const auto bytes = key.tile.valid() ? tiles_->read(key.tile) : std::nullopt;
  if (!bytes) return {};
  const std::string name = "tile " + to_text(key.tile);
  DecodedImage picture = decode_image(*bytes, key.colour, name);
  check_tile_size(picture.image, name);

  DecodedTile tile{picture.image, picture.alpha};
  if (const auto mask = tiles_->read_mask(key.tile)) {
    const cv::Mat ground = decode_image(*mask, Colour::grey, "mask of " + name).image;
    check_tile_size(ground, "mask of " + name);
    tile.mask = tile.mask.empty() ? ground : cv::Mat(cv::min(tile.mask, ground));
  }
  if (!tile.mask.empty()) cv::threshold(tile.mask, tile.mask, 254, 255, cv::THRESH_BINARY);
  if (key.shrink > 1) {
    const cv::Size size(kTileSize / key.shrink, kTileSize / key.shrink);
    cv::Mat small;
    cv::resize(tile.image, small, size, 0, 0, cv::INTER_AREA);
    tile.image = small;
    if (!tile.mask.empty()) {
      // The darkest of each cell: erode with the cell's shape, then take each cell's last pixel.
      cv::Mat eroded, corner;
      const cv::Mat cell = cv::Mat::ones(key.shrink, key.shrink, CV_8UC1);
      cv::erode(tile.mask, eroded, cell, {key.shrink - 1, key.shrink - 1}, 1, cv::BORDER_REPLICATE);
      corner.create(size, CV_8UC1);
      for (int row = 0; row < size.height; ++row) {
        for (int column = 0; column < size.width; ++column) {
          corner.at<std::uint8_t>(row, column) =
              eroded.at<std::uint8_t>(row * key.shrink + key.shrink - 1, column * key.shrink + key.shrink - 1);
        }
      }
      tile.mask = corner;
    }
  }
  return tile;
}

}  // namespace nadir
