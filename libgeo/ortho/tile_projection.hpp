// Where a frame sees the pixels of a map tile: each node of a coarse grid (every 16 pixels) is projected exactly, from
// the tile's Mercator pixel over longitude and latitude, the plane, the terrain, the pose and the lens; what lies
// between is filled in (vision/node_grid.hpp), less than a tenth of a pixel off where eligibility lets a tile be made.
#pragma once

#include <opencv2/core/mat.hpp>
#include <optional>
#include <vector>

#include "geodesy/local_frame.hpp"
#include "geodesy/tile_key.hpp"
#include "vision/rectification.hpp"

namespace nadir {

inline constexpr int kTileNodeStep = 16;  // pixels

struct TileProjection {
  cv::Mat nodes;              // CV_32FC2: frame pixels, NaN for what lies behind the camera or nearly beside it; the
                              // last row and column lie one pixel beyond the tile
  cv::Mat slants;             // CV_32FC1: tangent of the angle off nadir, at the same nodes
  bool whole = false;         // every pixel of the tile lies inside of the frame
  double view_angle_rad = 0;  // off nadir, of the worst node
  double slope = 0;           // rise over run of the ground, the steepest between neighbouring nodes
};

// camera: of the picture that will be sampled.
TileProjection project_tile(const TileKey& key, const LocalFrame& frame, const CameraModel& camera,
                            const CameraPose& pose, const GroundSurface& surface);

// Between pixels of the frame: the interpolation reads one beyond.
bool inside_frame(const CameraModel& camera, double x, double y);

// The tiles of this zoom that the frame may see, wholly or in part, in the order of TileKey: none when a corner of the
// frame looks near the horizon, or when there are more than `most`.
std::vector<TileKey> tiles_seen(int zoom, const LocalFrame& frame, const CameraModel& camera, const CameraPose& pose,
                                const GroundSurface& surface, std::size_t most = 4096);

// The same for one pixel, exactly: what the nodes are made of, and the oracle of what lies between them. Nothing for
// what lies behind the camera or nearly beside it.
std::optional<Eigen::Vector2d> frame_pixel_of(const TileKey& key, double column, double row, const LocalFrame& frame,
                                              const CameraModel& camera, const CameraPose& pose,
                                              const GroundSurface& surface);

}  // namespace nadir
