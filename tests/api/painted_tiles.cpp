#include "api/painted_tiles.hpp"

#include <cmath>
#include <opencv2/core.hpp>

#include "imagery/codecs.hpp"

namespace nadir::test {

std::optional<Bytes> PaintedTiles::read(const TileKey& key) const {
  if (key.z < zooms().min || key.z > zooms().max) return std::nullopt;
  cv::Mat tile(kTileSize, kTileSize, CV_8UC3);
  const double pixels_of_finest = std::ldexp(1.0, zooms().max - key.z);
  for (int row = 0; row < kTileSize; ++row) {
    for (int column = 0; column < kTileSize; ++column) {
      const double x = (key.x * 256.0 + column) * pixels_of_finest, y = (key.y * 256.0 + row) * pixels_of_finest;
      const double field = std::sin(std::floor(x / 180) * 1.7 + std::floor(y / 240) * 2.9);
      const double furrow = std::sin(x / 9 + y / 31);
      tile.at<cv::Vec3b>(row, column) = {cv::saturate_cast<std::uint8_t>(80 + 20 * field),
                                         cv::saturate_cast<std::uint8_t>(130 + 30 * field + 6 * furrow),
                                         cv::saturate_cast<std::uint8_t>(120 + 40 * field * field)};
    }
  }
  return encode_image(tile, ImageFormat::jpeg, 80);
}

}  // namespace nadir::test
