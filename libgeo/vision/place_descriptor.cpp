#include "vision/place_descriptor.hpp"

#include <cmath>
#include <opencv2/imgproc.hpp>

#include "vision/oriented_channels.hpp"

namespace nadir {
namespace {

constexpr double kSoftness_cells = 0.6;  // sigma of a cell's weight
constexpr double kMinCellShare = 0.3;    // of a cell's weight that must lie on ground

// One row per cell: its weight for every pixel of a side.
cv::Mat cell_weights(int pixels) {
  cv::Mat weights(kPlaceCells, pixels, CV_32FC1);
  for (int cell = 0; cell < kPlaceCells; ++cell) {
    for (int i = 0; i < pixels; ++i) {
      const double off = ((i + 0.5) * kPlaceCells / pixels - 0.5 - cell) / kSoftness_cells;
      const double weight = std::exp(-0.5 * off * off);
      weights.at<float>(cell, i) = weight < 0.011 ? 0.0F : static_cast<float>(weight);
    }
  }
  return weights;
}

cv::Mat pooled(const cv::Mat& channel, const cv::Mat& weights, const cv::Mat& weights_t) {
  return weights * channel * weights_t;
}

}  // namespace

std::optional<RawPlaceDescriptor> describe_place(const PlacePatch& patch) {
  const Channels channels = oriented_channels(patch.grey, patch.mask, ChannelSet::six_orientations, {});
  const cv::Mat weights = cell_weights(patch.grey.rows);
  const cv::Mat weights_t = weights.t();
  cv::Mat seen;
  channels.mask.convertTo(seen, CV_32F, 1.0 / 255);
  const cv::Mat area = pooled(seen, weights, weights_t);
  const cv::Mat whole = pooled(cv::Mat(seen.size(), CV_32FC1, cv::Scalar(1)), weights, weights_t);
  const cv::Mat usable = area > kMinCellShare * whole;
  const int cells = cv::countNonZero(usable);
  if (cells < kPlaceCells * kPlaceCells / 4) return std::nullopt;

  RawPlaceDescriptor descriptor{};
  double squared = 0;
  const int pairs = kPlaceOrientations / 2;
  for (int pair = 0; pair < pairs; ++pair) {
    std::array<cv::Mat, 2> parts;
    cv::split(channels.pairs[static_cast<std::size_t>(pair)], parts.data());
    for (int half = 0; half < 2; ++half) {
      cv::Mat values = pooled(parts[static_cast<std::size_t>(half)], weights, weights_t);
      cv::divide(values, area, values);
      const double mean = cv::mean(values, usable)[0];
      const int orientation = pair + half * pairs;  // perpendicular ones share a pair
      for (int row = 0; row < kPlaceCells; ++row) {
        for (int column = 0; column < kPlaceCells; ++column) {
          if (usable.at<std::uint8_t>(row, column) == 0) continue;
          const double value = static_cast<double>(values.at<float>(row, column)) - mean;
          const double rooted = std::copysign(std::sqrt(std::abs(value)), value);
          const int index = (orientation * kPlaceCells + row) * kPlaceCells + column;
          descriptor[static_cast<std::size_t>(index)] = static_cast<float>(rooted);
          squared += rooted * rooted;
        }
      }
    }
  }
  if (!(squared > 1e-9)) return std::nullopt;
  const auto factor = static_cast<float>(1 / std::sqrt(squared));
  for (float& value : descriptor) value *= factor;
  return descriptor;
}

double texture_of(const PlacePatch& patch) {
  cv::Mat grey, x, y, valid;
  cv::GaussianBlur(patch.grey, grey, cv::Size(), 1.0, 1.0, cv::BORDER_REFLECT_101);
  cv::Sobel(grey, x, CV_32F, 1, 0, 3, 0.125);
  cv::Sobel(grey, y, CV_32F, 0, 1, 3, 0.125);
  cv::erode(patch.mask, valid, cv::Mat::ones(7, 7, CV_8UC1), cv::Point(-1, -1), 1, cv::BORDER_CONSTANT,
            cv::Scalar(255));
  if (cv::countNonZero(valid) == 0) return 0;
  return std::sqrt(cv::mean(x.mul(x) + y.mul(y), valid)[0]);
}

PatchCutter::PatchCutter(const cv::Mat& grey, const cv::Mat& mask, double pixels_per_px) : grey_(grey), mask_(mask) {
  constexpr double kAliasing = 1.3;
  if (pixels_per_px <= kAliasing) return;
  const double sigma = 0.45 * pixels_per_px;
  cv::GaussianBlur(grey, grey_, cv::Size(), sigma, sigma, cv::BORDER_REFLECT_101);
}

PlacePatch PatchCutter::cut(const PatchPlacement& placement) const {
  const double cosine = std::cos(placement.turn_rad) * placement.pixels_per_px;
  const double sine = std::sin(placement.turn_rad) * placement.pixels_per_px;
  const double middle = (placement.side_px - 1) / 2.0;
  const double x = placement.shift_px.x - middle, y = placement.shift_px.y - middle;
  // From pixel (c, r) of the patch to the picture, whose pixels OpenCV counts from their centres.
  const cv::Matx23d picture_from_patch{cosine, -sine,  placement.centre.x - 0.5 + cosine * x - sine * y,
                                       sine,   cosine, placement.centre.y - 0.5 + sine * x + cosine * y};
  PlacePatch patch;
  const cv::Size size(placement.side_px, placement.side_px);
  cv::warpAffine(grey_, patch.grey, picture_from_patch, size, cv::INTER_LINEAR | cv::WARP_INVERSE_MAP,
                 cv::BORDER_REPLICATE);
  cv::warpAffine(mask_, patch.mask, picture_from_patch, size, cv::INTER_NEAREST | cv::WARP_INVERSE_MAP,
                 cv::BORDER_CONSTANT, cv::Scalar(0));
  return patch;
}

}  // namespace nadir
