#include "candidates/agreement.hpp"

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>

namespace nadir {
namespace {

constexpr int kMean_px = 25;

cv::Mat fine_structure(const cv::Mat& grey) {
  cv::Mat values, mean;
  grey.convertTo(values, CV_32F);
  cv::blur(values, mean, {kMean_px, kMean_px}, {-1, -1}, cv::BORDER_REFLECT);
  return values - mean;
}

// Pearson's coefficient; 0 for a picture without structure.
double coefficient(const cv::Mat& one, const cv::Mat& other) {
  cv::Scalar mean_one, deviation_one, mean_other, deviation_other;
  cv::meanStdDev(one, mean_one, deviation_one);
  cv::meanStdDev(other, mean_other, deviation_other);
  const double product = deviation_one[0] * deviation_other[0];
  if (!(product > 1e-9)) return 0;
  return (one.dot(other) / static_cast<double>(one.total()) - mean_one[0] * mean_other[0]) / product;
}

// `other` moved by the shift, and of both what then lies upon each other.
double coefficient_at(const cv::Mat& one, const cv::Mat& other, const cv::Point2d& shift) {
  const cv::Mat move = (cv::Mat_<double>(2, 3) << 1, 0, -shift.x, 0, 1, -shift.y);
  cv::Mat moved;
  cv::warpAffine(other, moved, move, other.size(), cv::INTER_LINEAR, cv::BORDER_REFLECT);
  const int left = std::max(0, static_cast<int>(std::ceil(-shift.x))),
            top = std::max(0, static_cast<int>(std::ceil(-shift.y)));
  const int right = one.cols - std::max(0, static_cast<int>(std::ceil(shift.x)));
  const int bottom = one.rows - std::max(0, static_cast<int>(std::ceil(shift.y)));
  // Less than a quarter of the tile says nothing.
  if (right - left < one.cols / 2 || bottom - top < one.rows / 2) return 0;
  const cv::Rect common(left, top, right - left, bottom - top);
  return coefficient(one(common).clone(), moved(common).clone());
}

}  // namespace

Agreement compare_pictures(const cv::Mat& one, const cv::Mat& other) {
  const cv::Mat fine_one = fine_structure(one), fine_other = fine_structure(other);
  cv::Mat window;
  cv::createHanningWindow(window, one.size(), CV_32F);
  const cv::Point2d shift = cv::phaseCorrelate(fine_one, fine_other, window);
  if (!std::isfinite(shift.x) || !std::isfinite(shift.y)) return {};
  // Where they lie already may be better than a false peak.
  const double there = coefficient_at(fine_one, fine_other, shift), here = coefficient_at(fine_one, fine_other, {});
  if (here >= there) return {.shift_px = 0, .correlation = here};
  return {.shift_px = std::hypot(shift.x, shift.y), .correlation = there};
}

}  // namespace nadir
