#include "vision/place_descriptor.hpp"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>

#include "vision/oriented_channels.hpp"

namespace nadir {
namespace {

// One row per cell: its weight for every pixel of a side.
cv::Mat cell_weights(int pixels) {
  cv::Mat weights(kPlaceCells, pixels, CV_32FC1);
  for (int cell = 0; cell < kPlaceCells; ++cell) {
    for (int i = 0; i < pixels; ++i) {
      const double off = ((i + 0.5) * kPlaceCells / pixels - 0.5 - cell) / kCellSoftness;
      const double weight = std::exp(-0.5 * off * off);
      weights.at<float>(cell, i) = weight < kMinCellWeight ? 0.0F : static_cast<float>(weight);
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
  cv::Mat shown;
  channels.mask.convertTo(shown, CV_32F, 1.0 / 255);
  const cv::Mat area = pooled(shown, weights, weights_t);
  const cv::Mat whole = pooled(cv::Mat(shown.size(), CV_32FC1, cv::Scalar(1)), weights, weights_t);
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
  if (!(squared > kMinDescriptorEnergy)) return std::nullopt;
  const auto factor = static_cast<float>(1 / std::sqrt(squared));
  for (float& value : descriptor) value *= factor;
  return descriptor;
}

double texture_of(const PlacePatch& patch) {
  cv::Mat grey, valid;
  cv::GaussianBlur(patch.grey, grey, cv::Size(), kTextureSigma_px, kTextureSigma_px, cv::BORDER_REFLECT_101);
  const auto [x, y] = image_gradient(grey);
  cv::erode(patch.mask, valid, cv::Mat::ones(kTextureMargin_px, kTextureMargin_px, CV_8UC1), cv::Point(-1, -1), 1,
            cv::BORDER_CONSTANT, cv::Scalar(255));
  if (cv::countNonZero(valid) == 0) return 0;
  return std::sqrt(cv::mean(x.mul(x) + y.mul(y), valid)[0]);
}

PatchCutter::PatchCutter(const cv::Mat& grey, const cv::Mat& mask, double pixels_per_px) : grey_(grey), mask_(mask) {
  if (pixels_per_px <= kAliasingScale) return;
  const double sigma = kAliasingSigma * pixels_per_px;
  cv::GaussianBlur(grey, grey_, cv::Size(), sigma, sigma, cv::BORDER_REFLECT_101);
}

PlacePatch PatchCutter::cut(const PatchPlacement& placement) const {
  const double cosine = std::cos(placement.turn_rad) * placement.pixels_per_px;
  const double sine = std::sin(placement.turn_rad) * placement.pixels_per_px;
  const double middle = (placement.side_px - 1) / 2.0;
  const double x = placement.shift_px.x - middle, y = placement.shift_px.y - middle;
  // From pixel (c, r) of the patch to the image, whose pixels OpenCV counts from their centres.
  const cv::Matx23d image_from_patch{cosine, -sine,  placement.centre.x - 0.5 + cosine * x - sine * y,
                                     sine,   cosine, placement.centre.y - 0.5 + sine * x + cosine * y};
  PlacePatch patch;
  const cv::Size size(placement.side_px, placement.side_px);
  cv::warpAffine(grey_, patch.grey, image_from_patch, size, cv::INTER_LINEAR | cv::WARP_INVERSE_MAP,
                 cv::BORDER_REPLICATE);
  cv::warpAffine(mask_, patch.mask, image_from_patch, size, cv::INTER_NEAREST | cv::WARP_INVERSE_MAP,
                 cv::BORDER_CONSTANT, cv::Scalar(0));
  return patch;
}

PlaceVector PlaceProjection::project(const RawPlaceDescriptor& descriptor) const {
  using Row = Eigen::Matrix<float, 1, Eigen::Dynamic>;
  using Rows = Eigen::Matrix<float, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
  const auto size = static_cast<Eigen::Index>(kRawPlaceSize);
  const Row centred = Eigen::Map<const Row>(descriptor.data(), size) - Eigen::Map<const Row>(mean.data(), size);
  const Eigen::Map<const Rows> components(basis.data(), static_cast<Eigen::Index>(kPlaceSize), size);
  PlaceVector result{};
  Eigen::Map<Eigen::VectorXf> vector(result.data(), static_cast<Eigen::Index>(kPlaceSize));
  vector = components * centred.transpose();
  const float length = vector.norm();
  if (length > kMinVectorLength) vector /= length;
  return result;
}

PlaceProjection train_projection(std::span<const RawPlaceDescriptor> samples) {
  const auto size = static_cast<Eigen::Index>(kRawPlaceSize);
  Eigen::MatrixXd rows(static_cast<Eigen::Index>(samples.size()), size);
  for (std::size_t i = 0; i < samples.size(); ++i) {
    for (std::size_t k = 0; k < kRawPlaceSize; ++k) {
      rows(static_cast<Eigen::Index>(i), static_cast<Eigen::Index>(k)) = static_cast<double>(samples[i][k]);
    }
  }
  const Eigen::RowVectorXd mean = rows.colwise().mean();
  rows.rowwise() -= mean;
  // In parts that Eigen does not divide further: where it divides depends on the processor, and with it the last bits.
  constexpr Eigen::Index kRowsAtOnce = 64;
  Eigen::MatrixXd covariance = Eigen::MatrixXd::Zero(size, size);
  for (Eigen::Index first = 0; first < rows.rows(); first += kRowsAtOnce) {
    const auto part = rows.middleRows(first, std::min(kRowsAtOnce, rows.rows() - first));
    covariance.noalias() += part.transpose() * part;
  }
  covariance /= static_cast<double>(std::max<std::size_t>(1, samples.size() - 1));
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> solver(covariance);

  PlaceProjection projection;
  projection.mean.resize(kRawPlaceSize);
  projection.basis.resize(kPlaceSize * kRawPlaceSize);
  for (Eigen::Index k = 0; k < size; ++k) {
    projection.mean[static_cast<std::size_t>(k)] = static_cast<float>(mean[k]);
  }
  double kept = 0;
  for (std::size_t row = 0; row < kPlaceSize; ++row) {
    const Eigen::Index from = size - 1 - static_cast<Eigen::Index>(row);  // eigenvalues come in rising order
    Eigen::VectorXd component = solver.eigenvectors().col(from);
    Eigen::Index largest = 0;
    component.cwiseAbs().maxCoeff(&largest);
    if (component[largest] < 0) component = -component;
    for (Eigen::Index k = 0; k < size; ++k) {
      projection.basis[row * kRawPlaceSize + static_cast<std::size_t>(k)] = static_cast<float>(component[k]);
    }
    kept += std::max(0.0, solver.eigenvalues()[from]);
  }
  const double all = solver.eigenvalues().cwiseMax(0).sum();
  projection.kept = all > 0 ? kept / all : 1;
  return projection;
}

}  // namespace nadir
