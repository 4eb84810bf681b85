// Which pixels of two frames show the same ground, where features do not tell: at night, in haze, under noise.
//
// A feature stands on a few pixels and must rise above their noise; a correlation stands on all that both frames show.
// The frame before is resampled north-up and coarse (rectification.hpp) and serves as the map; the frame now is
// searched in all of it that leaves enough overlap (map_search.hpp), and its patches are matched around the best place
// (patch_matching.hpp), as a frame is with a map. Frames of one camera and one light resemble each other more than a
// map of another season, so this holds in pictures that no map matches.
//
// Patches overlap and err together: several count as one (PixelPairs::redundancy).
#pragma once

#include "estimation/visual_odometry.hpp"

namespace nadir {

// Both at working size, with their images. Pixels of the matched patches' centres, many of them wrong where the frames
// do not overlap. None towards the horizon, where the heights of the two differ by far, and where nothing stands out.
PixelPairs correlated_pixels(const OdometryFrame& before, const OdometryFrame& now);

}  // namespace nadir
