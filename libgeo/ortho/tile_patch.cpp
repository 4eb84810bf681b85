#include "ortho/tile_patch.hpp"

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>

#include "vision/rectification.hpp"

namespace nadir {
namespace {

constexpr int kLeastSeen_px = 64;

cv::Mat filled_slants(const cv::Mat& nodes) {
  cv::Mat slants(kTileSize, kTileSize, CV_32FC1);
  for (int r = 0; r < kTileSize; ++r) {
    const int n = r / kTileNodeStep;
    const float v = static_cast<float>(r % kTileNodeStep) / kTileNodeStep;
    const auto *above = nodes.ptr<float>(n), *below = nodes.ptr<float>(n + 1);
    auto* row = slants.ptr<float>(r);
    for (int c = 0; c < kTileSize; ++c) {
      const int m = c / kTileNodeStep;
      const float u = static_cast<float>(c % kTileNodeStep) / kTileNodeStep;
      row[c] = (1 - v) * ((1 - u) * above[m] + u * above[m + 1]) + v * ((1 - u) * below[m] + u * below[m + 1]);
    }
  }
  return slants;
}

// pixels: of the frame; those that it does not have become ones that remap() can take.
PartialTile cut(const ReducedFrame& frame, const ProjectedTile& tile, cv::Mat& pixels, double max_view_angle_rad) {
  fill_between_nodes(tile.projection.nodes, kTileNodeStep, pixels);
  PartialTile patch;
  patch.key = tile.key;
  patch.slants = filled_slants(tile.projection.slants);
  patch.seen.create(kTileSize, kTileSize, CV_8UC1);
  const auto most = static_cast<float>(std::tan(max_view_angle_rad));
  float least = most;
  for (int r = 0; r < kTileSize; ++r) {
    auto* from = pixels.ptr<cv::Vec2f>(r);
    const auto* slant = patch.slants.ptr<float>(r);
    auto* seen = patch.seen.ptr<std::uint8_t>(r);
    for (int c = 0; c < kTileSize; ++c) {
      const bool sees = slant[c] <= most && inside_frame(frame.camera, from[c][0], from[c][1]);
      seen[c] = sees ? 255 : 0;
      if (sees) {
        ++patch.seen_px;
        least = std::min(least, slant[c]);
      } else {
        from[c] = {-1, -1};
      }
    }
  }
  patch.least_view_rad = std::atan(least);
  cv::remap(frame.image, patch.image, pixels, cv::noArray(), cv::INTER_LINEAR, cv::BORDER_REPLICATE);
  return patch;
}

}  // namespace

std::vector<ProjectedTile> part_tiles(int zoom, const LocalFrame& frame, const CameraModel& camera,
                                      const CameraPose& pose, const GroundSurface& surface) {
  constexpr double kLast = kTileSize - 1.0;
  std::vector<ProjectedTile> tiles;
  for (const TileKey& key : tiles_seen(zoom, frame, camera, pose, surface)) {
    // Many tiles of the box around a turned frame lie beside it; a thin corner that is missed here is no loss.
    const bool touched = [&] {
      for (const double column : {0.0, kLast / 4, kLast / 2, 3 * kLast / 4, kLast}) {
        for (const double row : {0.0, kLast / 4, kLast / 2, 3 * kLast / 4, kLast}) {
          const auto pixel = frame_pixel_of(key, column, row, frame, camera, pose, surface);
          if (pixel && inside_frame(camera, pixel->x(), pixel->y())) return true;
        }
      }
      return false;
    }();
    if (!touched) continue;
    TileProjection projection = project_tile(key, frame, camera, pose, surface);
    if (!projection.whole) tiles.push_back({key, std::move(projection)});
  }
  return tiles;
}

std::optional<PartialTile> cut_patch(const ReducedFrame& frame, const ProjectedTile& tile, double max_view_angle_rad) {
  cv::Mat pixels(kTileSize, kTileSize, CV_32FC2);
  PartialTile patch = cut(frame, tile, pixels, max_view_angle_rad);
  return patch.seen_px >= kLeastSeen_px ? std::optional(std::move(patch)) : std::nullopt;
}

}  // namespace nadir
