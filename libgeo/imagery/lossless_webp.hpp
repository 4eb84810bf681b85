// Lossless WebP: what a COG holds where an MBTiles file would hold PNG (TIFF knows WebP, but not PNG).
#pragma once

#include <opencv2/core/mat.hpp>

#include "base/bytes.hpp"

namespace nadir {

// image: CV_8UC3 (BGR). The same picture gives the same bytes.
Bytes encode_lossless_webp(const cv::Mat& image);

// Whether the bytes are such a picture; false for anything else.
bool is_lossless_webp(ByteView bytes);

}  // namespace nadir
