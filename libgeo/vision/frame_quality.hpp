// Is a frame worth looking at? Black, blown-out, textureless and blurred frames must not reach the matcher.
#pragma once

#include <opencv2/core/mat.hpp>

namespace nadir {

struct FrameQuality {
  double mean = 0;           // grey level, 0-255
  double contrast = 0;       // standard deviation of the grey levels
  double clipped_share = 0;  // pixels at 0-2 or 253-255
  double sharpness = 0;      // mean gradient over contrast, at a fixed width of 320 pixels
  bool usable = false;
};

struct QualityLimits {
  double min_contrast = 5;
  double max_clipped_share = 0.6;
  double min_sharpness = 0.015;
};

FrameQuality judge_frame(const cv::Mat& grey, const QualityLimits& limits = {});

}  // namespace nadir
