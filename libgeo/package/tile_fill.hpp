// Black or white fill at the edges of a picture: what tools write into JPEG tiles, which have no transparency, where
// their source ends. It looks like coverage and shows no ground.
//
// Found in blocks of 16 x 16 pixels, the unit in which JPEG works: a block counts when all of its pixels are within 3
// of black (or all of white) and it hangs together with the tile's edge over such blocks. So a shadow or a roof inside
// of the picture is none; a black lake or a burnt-out cloud at the edge is, and shows as little ground.
#pragma once

#include <opencv2/core/mat.hpp>

namespace nadir {

inline constexpr int kLeastFillBlocks = 4;  // fewer say nothing

// image: CV_8UC3, kTileSize both ways. CV_8UC1, 255 where the picture is fill; empty when there is none.
cv::Mat edge_fill(const cv::Mat& image);

}  // namespace nadir
