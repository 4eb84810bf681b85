// A small tile set for the tests of COG files: images that differ from tile to tile, some tiles missing.
#pragma once

#include <map>
#include <opencv2/core.hpp>

#include "imagery/cog_writer.hpp"

namespace nadir::test {

// 2 x 1 tiles of zoom 15 and what lies below them down to zoom 17, near the equator and Greenwich.
inline const CogShape kShape{{15, 17}, 16384, 16383, 2, 1};

inline cv::Mat picture_of(const TileKey& key) {
  cv::Mat image(kTileSize, kTileSize, CV_8UC3);
  for (int row = 0; row < kTileSize; ++row) {
    for (int column = 0; column < kTileSize; ++column) {
      image.at<cv::Vec3b>(row, column) = {static_cast<std::uint8_t>(column + static_cast<int>(key.x) * 37),
                                          static_cast<std::uint8_t>(row + static_cast<int>(key.y) * 59),
                                          static_cast<std::uint8_t>(key.z * 13)};
    }
  }
  return image;
}

inline std::map<TileKey, Bytes> tiles_of(const CogShape& shape, ImageFormat format) {
  std::map<TileKey, Bytes> tiles;
  for (int zoom = shape.zooms.min; zoom <= shape.zooms.max; ++zoom) {
    const int steps = zoom - shape.zooms.min;
    for (std::uint32_t x = shape.first_x << steps; x < (shape.first_x + shape.columns) << steps; ++x) {
      for (std::uint32_t y = shape.first_y << steps; y < (shape.first_y + shape.rows) << steps; ++y) {
        const TileKey key{static_cast<std::uint8_t>(zoom), x, y};
        if (zoom == shape.zooms.max && (x + y) % 3 == 0) continue;  // sparse, the very first among them or not
        tiles[key] = encode_image(picture_of(key), format, 80);
      }
    }
  }
  return tiles;
}

inline void write_cog(const std::filesystem::path& path, const std::map<TileKey, Bytes>& tiles, ImageFormat format,
                      std::uint64_t classic_limit = 0xffff'0000) {
  CogWriter writer(path, kShape, format, classic_limit);
  for (const auto& [key, bytes] : tiles) writer.add(key, bytes);
  writer.finish();
}

}  // namespace nadir::test
