#include "ortho/orthorectifier.hpp"

#include <algorithm>
#include <opencv2/imgproc.hpp>

#include "vision/rectification.hpp"

namespace nadir {
namespace {

constexpr double kFiner = 1.2;             // the level's pixels against the tile's, as reduce_frame() has it
constexpr std::size_t kTilesAtOnce = 100;  // OpenCV's remap takes 32767 rows

}  // namespace

std::vector<ProjectedTile> whole_tiles(int zoom, const LocalFrame& frame, const CameraModel& camera,
                                       const CameraPose& pose, const GroundSurface& surface) {
  std::vector<ProjectedTile> tiles;
  for (const TileKey& key : tiles_seen(zoom, frame, camera, pose, surface)) {
    const bool corners = [&] {
      for (const double column : {0.0, kTileSize - 1.0}) {
        for (const double row : {0.0, kTileSize - 1.0}) {
          const auto pixel = frame_pixel_of(key, column, row, frame, camera, pose, surface);
          if (!pixel || pixel->x() < 0 || pixel->y() < 0 || pixel->x() > camera.width || pixel->y() > camera.height) {
            return false;
          }
        }
      }
      return true;
    }();
    if (!corners) continue;  // most of the box around a turned frame
    TileProjection projection = project_tile(key, frame, camera, pose, surface);
    if (projection.whole) tiles.push_back({key, std::move(projection)});
  }
  return tiles;
}

std::vector<OrthoTile> orthorectify(const ReducedFrame& frame, const std::vector<ProjectedTile>& tiles) {
  std::vector<OrthoTile> result;
  for (std::size_t first = 0; first < tiles.size(); first += kTilesAtOnce) {
    const std::size_t count = std::min(kTilesAtOnce, tiles.size() - first);
    cv::Mat pixels(static_cast<int>(count) * kTileSize, kTileSize, CV_32FC2);
    const auto rows_of = [](std::size_t i) {
      return cv::Range(static_cast<int>(i) * kTileSize, static_cast<int>(i + 1) * kTileSize);
    };
    for (std::size_t i = 0; i < count; ++i) {
      cv::Mat part = pixels.rowRange(rows_of(i));
      fill_between_nodes(tiles[first + i].projection.nodes, kTileNodeStep, part);
    }
    cv::Mat image;
    cv::remap(frame.image, image, pixels, cv::noArray(), cv::INTER_LINEAR, cv::BORDER_REPLICATE);
    for (std::size_t i = 0; i < count; ++i) result.push_back({tiles[first + i].key, image.rowRange(rows_of(i))});
  }
  return result;
}

int decoding_shrink(const CameraModel& camera, double agl_m, double tile_gsd_m) {
  for (const int shrink : {8, 4, 2}) {
    const bool whole = camera.width % shrink == 0 && camera.height % shrink == 0;
    if (whole && gsd_at(camera, agl_m) * shrink * kFiner <= tile_gsd_m) return shrink;
  }
  return 1;
}

}  // namespace nadir
