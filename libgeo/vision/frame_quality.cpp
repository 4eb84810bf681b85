#include "vision/frame_quality.hpp"

#include <opencv2/imgproc.hpp>

namespace nadir {

FrameQuality judge_frame(const cv::Mat& grey, const QualityLimits& limits) {
  FrameQuality quality;
  if (grey.empty()) return quality;
  cv::Mat small;
  const double factor = 320.0 / std::max(grey.cols, grey.rows);
  cv::resize(grey, small, cv::Size(), factor, factor, factor < 1 ? cv::INTER_AREA : cv::INTER_LINEAR);
  cv::Scalar mean, deviation;
  cv::meanStdDev(small, mean, deviation);
  quality.mean = mean[0];
  quality.contrast = deviation[0];
  const int clipped = cv::countNonZero(small <= 2) + cv::countNonZero(small >= 253);
  quality.clipped_share = clipped / static_cast<double>(small.total());
  cv::Mat dx, dy, strength;
  cv::Sobel(small, dx, CV_32F, 1, 0, 3, 0.125);
  cv::Sobel(small, dy, CV_32F, 0, 1, 3, 0.125);
  cv::magnitude(dx, dy, strength);
  quality.sharpness = deviation[0] > 0 ? cv::mean(strength)[0] / deviation[0] : 0;
  quality.usable = quality.contrast >= limits.min_contrast && quality.clipped_share <= limits.max_clipped_share &&
                   quality.sharpness >= limits.min_sharpness;
  return quality;
}

}  // namespace nadir
