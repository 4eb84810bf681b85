#include "estimation/fault_maps.hpp"

#include <opencv2/imgproc.hpp>

#include "base/random.hpp"
#include "estimation/localizer_fixture.hpp"
#include "geodesy/web_mercator.hpp"
#include "imagery/codecs.hpp"

namespace nadir::test {
namespace {

TileKey same(const TileKey& key) { return key; }

// Fields and roofs of other shades over so much of the tile.
void build_over(cv::Mat& picture, const TileKey& key, double share) {
  Random random = Random(key.x).fork("built", key.y);
  cv::Mat built(picture.size(), CV_8UC1, cv::Scalar(0));
  while (cv::countNonZero(built) < share * static_cast<double>(built.total())) {
    const cv::Point from(random.integer(0, picture.cols), random.integer(0, picture.rows));
    const cv::Rect box(from, cv::Size(random.integer(12, 70), random.integer(12, 70)));
    cv::rectangle(picture, box, cv::Scalar::all(random.uniform(30, 220)), cv::FILLED);
    cv::rectangle(built, box, cv::Scalar(255), cv::FILLED);
  }
}

}  // namespace

std::optional<Bytes> ChangedTiles::read(const TileKey& key) const {
  const auto known = known_.find(key);
  if (known != known_.end()) return known->second;
  const auto bytes = right_.read(where_(key));
  if (!bytes) return known_[key] = std::nullopt;
  cv::Mat picture = decode_image(*bytes, Colour::bgr, "tile").image;
  change_(picture, key);
  return known_[key] = encode_image(picture, ImageFormat::jpeg, 90);
}

const TileSource& mirrored_tiles() {
  const TileKey middle = tile_at(kOrigin, 18);
  static const ChangedTiles tiles(
      landscape_tiles(),
      [middle](const TileKey& key) {
        return TileKey{key.z, 2 * middle.x - key.x, key.y};
      },
      [](cv::Mat& picture, const TileKey&) { cv::flip(picture, picture, 1); });
  return tiles;
}

const TileSource& outdated_tiles() {
  static const ChangedTiles tiles(landscape_tiles(), same,
                                  [](cv::Mat& picture, const TileKey& key) { build_over(picture, key, 0.45); });
  return tiles;
}

const TileSource& rebuilt_tiles() {
  static const ChangedTiles tiles(landscape_tiles(), same,
                                  [](cv::Mat& picture, const TileKey& key) { build_over(picture, key, 0.97); });
  return tiles;
}

}  // namespace nadir::test
