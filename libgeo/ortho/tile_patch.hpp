// What a frame shows of a tile that it does not show wholly: a piece that can be put beside those of other frames
// (ortho/tile_quilt.hpp).
#pragma once

#include <opencv2/core/mat.hpp>
#include <optional>
#include <vector>

#include "ortho/orthorectifier.hpp"

namespace nadir {

struct PartialTile {
  TileKey key;
  cv::Mat image;   // CV_8UC3, 256 x 256
  cv::Mat seen;    // CV_8UC1: 255 where the image shows what the frame saw, not too far off nadir
  cv::Mat slants;  // CV_32FC1: tangent of the angle off nadir
  int seen_px = 0;
  double least_view_rad = 0;  // of what is seen
};

// The tiles that the frame shows a part of, in the order of TileKey. camera: of the picture that cut_patch() is given.
std::vector<ProjectedTile> part_tiles(int zoom, const LocalFrame& frame, const CameraModel& camera,
                                      const CameraPose& pose, const GroundSurface& surface);

// Nothing when it shows hardly anything.
std::optional<PartialTile> cut_patch(const ReducedFrame& frame, const ProjectedTile& tile, double max_view_angle_rad);

}  // namespace nadir
