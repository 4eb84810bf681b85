// A frame as map tiles: whole tiles only, straight from above, on the Web Mercator grid.
//
//   picture ─► pyramid level (no aliasing) ─► one remap over all tiles ─► 256 x 256 pixels each
//
// The level is the coarsest whose pixels are a little finer than the tile's (reduce_frame()); a JPEG may have been
// decoded smaller before (decoding_shrink()).
#pragma once

#include <opencv2/core/mat.hpp>
#include <vector>

#include "ortho/tile_projection.hpp"

namespace nadir {

struct OrthoTile {
  TileKey key;
  cv::Mat image;  // CV_8UC3, a part of a larger picture
};

struct ProjectedTile {
  TileKey key;
  TileProjection projection;
};

// The tiles of this zoom that the frame shows wholly. camera: of the picture that orthorectify() will be given.
std::vector<ProjectedTile> whole_tiles(int zoom, const LocalFrame& frame, const CameraModel& camera,
                                       const CameraPose& pose, const GroundSurface& surface);

// frame: as reduce_frame() makes it, and the camera that the tiles were projected with.
std::vector<OrthoTile> orthorectify(const ReducedFrame& frame, const std::vector<ProjectedTile>& tiles);

// What part of its size a picture of this camera may be decoded at for tiles with such pixels: 1, 2, 4 or 8.
int decoding_shrink(const CameraModel& camera, double agl_m, double tile_gsd_m);

}  // namespace nadir
