// A frame as map tiles: straight from above, on the Web Mercator grid.
//
//   image ─► pyramid level (no aliasing) ─► one remap over all tiles ─► 256 x 256 pixels each
//
// The level is the coarsest whose pixels are a little finer than the tile's (reduce_frame()); a JPEG may have been
// decoded smaller before (decoding_shrink()).
//
// Projection: each node of a coarse grid (every 16 pixels) is projected exactly, from the tile's Mercator pixel over
// longitude and latitude, the plane, the terrain, the pose and the lens; the pixels between are interpolated
// (vision/rectification.hpp), less than a tenth of a pixel off where eligibility lets a tile be made.
//
// A tile that the frame shows completely is a whole tile. One that it shows in part is a PartialTile, which a mosaic
// can merge with those of other frames (ortho/tile_mosaic.hpp).
#pragma once

#include <opencv2/core/mat.hpp>
#include <optional>
#include <vector>

#include "geodesy/local_frame.hpp"
#include "geodesy/web_mercator.hpp"
#include "vision/rectification.hpp"

namespace nadir {

inline constexpr int kTileNodeStep = 16;  // pixels

struct TileProjection {
  cv::Mat nodes;              // CV_32FC2: frame pixels, NaN for what is behind the camera or nearly beside it; the
                              // last row and column lie one pixel beyond the tile
  cv::Mat slants;             // CV_32FC1: tangent of the angle off nadir, at the same nodes
  bool whole = false;         // the frame shows every pixel of the tile
  double view_angle_rad = 0;  // off nadir, of the worst node
  double slope = 0;           // rise over run of the ground, the steepest between neighbouring nodes
};

// camera: of the image that will be sampled.
TileProjection project_tile(const TileKey& key, const LocalFrame& frame, const CameraModel& camera,
                            const CameraPose& pose, const GroundSurface& surface);

// Inside the frame with a margin of one pixel, which the interpolation reads.
bool inside_frame(const CameraModel& camera, double x, double y);

// The tiles of this zoom that the frame may show, completely or in part, in the order of TileKey: none when a corner of
// the frame looks near the horizon, or when there are more than `most`.
std::vector<TileKey> tiles_seen(int zoom, const LocalFrame& frame, const CameraModel& camera, const CameraPose& pose,
                                const GroundSurface& surface, std::size_t most = 4096);

// The exact projection of one pixel of a tile. Nothing for what is behind the camera or more than 72 degrees off nadir.
std::optional<Eigen::Vector2d> frame_pixel_of(const TileKey& key, double column, double row, const LocalFrame& frame,
                                              const CameraModel& camera, const CameraPose& pose,
                                              const GroundSurface& surface);

struct OrthoTile {
  TileKey key;
  cv::Mat image;  // CV_8UC3, a view into a larger image
};

struct ProjectedTile {
  TileKey key;
  TileProjection projection;
};

// The tiles of this zoom that the frame shows completely. camera: of the image that orthorectify() will get.
std::vector<ProjectedTile> whole_tiles(int zoom, const LocalFrame& frame, const CameraModel& camera,
                                       const CameraPose& pose, const GroundSurface& surface);

// frame: as reduce_frame() makes it, and the camera that the tiles were projected with.
std::vector<OrthoTile> orthorectify(const ReducedFrame& frame, const std::vector<ProjectedTile>& tiles);

// The factor by which an image of this camera may be decoded smaller for tiles of this resolution: 1, 2, 4 or 8.
int decoding_shrink(const CameraModel& camera, double agl_m, double tile_gsd_m);

struct PartialTile {
  TileKey key;
  cv::Mat image;   // CV_8UC3, 256 x 256
  cv::Mat seen;    // CV_8UC1: 255 where the frame shows the ground at a small enough view angle
  cv::Mat slants;  // CV_32FC1: tangent of the angle off nadir
  int seen_px = 0;
  double least_view_rad = 0;  // of what is seen
};

// The tiles that the frame shows in part, in the order of TileKey. camera: of the image that cut_partial_tile() will
// get.
std::vector<ProjectedTile> partial_tiles(int zoom, const LocalFrame& frame, const CameraModel& camera,
                                         const CameraPose& pose, const GroundSurface& surface);

// Nothing when it shows fewer than 64 pixels.
std::optional<PartialTile> cut_partial_tile(const ReducedFrame& frame, const ProjectedTile& tile,
                                            double max_view_angle_rad);

}  // namespace nadir
