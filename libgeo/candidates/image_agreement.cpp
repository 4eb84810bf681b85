#include "candidates/image_agreement.hpp"

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>
#include <optional>

#include "geodesy/hypotenuse.hpp"

namespace nadir {
namespace {

constexpr int kMean_px = 25;
constexpr int kPeakReach_px = 2;  // of the neighbourhood whose centroid is the peak

// Sums of whole numbers: exact, and three times as fast as the means of floats.
cv::Mat without_local_means(const cv::Mat& grey) {
  constexpr int kPixels = kMean_px * kMean_px;
  cv::Mat sums, values(grey.size(), CV_32F);
  cv::boxFilter(grey, sums, CV_32S, {kMean_px, kMean_px}, {-1, -1}, false, cv::BORDER_REFLECT);
  for (int row = 0; row < grey.rows; ++row) {
    const std::uint8_t* level = grey.ptr<std::uint8_t>(row);
    const int* sum = sums.ptr<int>(row);
    float* value = values.ptr<float>(row);
    for (int column = 0; column < grey.cols; ++column)
      value[column] = static_cast<float>(level[column] * kPixels - sum[column]) * (1.0F / kPixels);
  }
  return values;
}

// The same memory.
cv::Mat real_part(ComplexImage& image) {
  return {static_cast<int>(image.rows()), static_cast<int>(image.columns()), CV_32FC1, image.real(0)};
}

const FourierTransform& transform_of(const cv::Mat& values) {
  const auto fitting = [](int side) { return FourierTransform::fitting_length(static_cast<std::size_t>(side)); };
  const std::size_t rows = fitting(values.rows), columns = fitting(values.cols);
  thread_local std::optional<FourierTransform> transform;
  if (!transform || transform->rows() != rows || transform->columns() != columns) transform.emplace(rows, columns);
  return *transform;
}

Spectrum windowed_spectrum(const cv::Mat& values) {
  thread_local cv::Mat window;
  if (window.size() != values.size()) cv::createHanningWindow(window, values.size(), CV_32F);
  ComplexImage windowed(static_cast<std::size_t>(values.rows), static_cast<std::size_t>(values.cols));
  windowed.clear();
  cv::multiply(values, window, real_part(windowed));
  return transform_of(values).forward(windowed);
}

// How far the second image lies right of and below the first one. NaN without a peak.
cv::Point2d shift_from(const cv::Mat& correlation) {
  const int columns = correlation.cols, rows = correlation.rows;
  cv::Point peak;
  cv::minMaxLoc(correlation, nullptr, nullptr, nullptr, &peak);
  double weight = 0, right = 0, down = 0;
  for (int y = -kPeakReach_px; y <= kPeakReach_px; ++y) {
    for (int x = -kPeakReach_px; x <= kPeakReach_px; ++x) {  // it goes on at the opposite edge
      const double value = correlation.at<float>((peak.y + y + rows) % rows, (peak.x + x + columns) % columns);
      weight += value, right += value * x, down += value * y;
    }
  }
  const int wrapped_x = peak.x > columns / 2 ? peak.x - columns : peak.x;
  const int wrapped_y = peak.y > rows / 2 ? peak.y - rows : peak.y;
  return {-(wrapped_x + right / weight), -(wrapped_y + down / weight)};
}

// Pearson's coefficient of the overlap once `other` is moved by the shift, bilinearly. 0 for an image without
// structure, and for an overlap of less than a quarter of the tile.
double coefficient_at(const cv::Mat& one, const cv::Mat& other, const cv::Point2d& shift) {
  const int left = std::max(0, static_cast<int>(std::ceil(-shift.x))),
            top = std::max(0, static_cast<int>(std::ceil(-shift.y)));
  const int right = one.cols - std::max(0, static_cast<int>(std::ceil(shift.x)));
  const int bottom = one.rows - std::max(0, static_cast<int>(std::ceil(shift.y)));
  if (right - left < one.cols / 2 || bottom - top < one.rows / 2) return 0;
  const int whole_x = static_cast<int>(std::floor(shift.x)), whole_y = static_cast<int>(std::floor(shift.y));
  const auto part_x = static_cast<float>(shift.x - whole_x), part_y = static_cast<float>(shift.y - whole_y);
  const int next_x = part_x > 0 ? 1 : 0, next_y = part_y > 0 ? 1 : 0;
  double sum_one = 0, sum_other = 0, squares_one = 0, squares_other = 0, products = 0;
  for (int row = top; row < bottom; ++row) {
    const float* fixed = one.ptr<float>(row);
    const float* above = other.ptr<float>(row + whole_y) + whole_x;
    const float* below = other.ptr<float>(row + whole_y + next_y) + whole_x;
    float row_one = 0, row_other = 0, row_squares_one = 0, row_squares_other = 0, row_products = 0;
    for (int column = left; column < right; ++column) {
      const float a = fixed[column];
      const float upper = above[column] + part_x * (above[column + next_x] - above[column]);
      const float lower = below[column] + part_x * (below[column + next_x] - below[column]);
      const float b = upper + part_y * (lower - upper);
      row_one += a, row_other += b, row_squares_one += a * a, row_squares_other += b * b, row_products += a * b;
    }
    sum_one += double{row_one}, sum_other += double{row_other}, products += double{row_products};
    squares_one += double{row_squares_one}, squares_other += double{row_squares_other};
  }
  const double pixels = static_cast<double>(right - left) * (bottom - top);
  const double mean_one = sum_one / pixels, mean_other = sum_other / pixels;
  const double variances =
      (squares_one / pixels - mean_one * mean_one) * (squares_other / pixels - mean_other * mean_other);
  if (!(variances > 1e-18)) return 0;
  return (products / pixels - mean_one * mean_other) / std::sqrt(variances);
}

}  // namespace

FineStructure::FineStructure(const cv::Mat& grey)
    : values(without_local_means(grey)), spectrum(windowed_spectrum(values)) {}

Agreement compare_images(const FineStructure& one, const FineStructure& other) {
  ComplexImage correlation = transform_of(one.values).phase_correlation(one.spectrum, other.spectrum);
  const cv::Point2d shift = shift_from(real_part(correlation));
  if (!std::isfinite(shift.x) || !std::isfinite(shift.y)) return {};
  // No shift may be better than a false peak.
  const double there = coefficient_at(one.values, other.values, shift),
               here = coefficient_at(one.values, other.values, {});
  if (here >= there) return {.shift_px = 0, .correlation = here};
  return {.shift_px = hypotenuse(shift.x, shift.y), .correlation = there};
}

}  // namespace nadir
