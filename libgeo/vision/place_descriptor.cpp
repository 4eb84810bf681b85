#include "vision/place_descriptor.hpp"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <numeric>
#include <opencv2/imgproc.hpp>
#include <vector>

#include "base/platform.hpp"
#include "vision/oriented_channels.hpp"

namespace nadir {
namespace {

constexpr auto kCells = static_cast<std::size_t>(kPlaceCells);

// What the pixels of a side weigh in a cell: from `first` on; the others nothing.
struct CellWeights {
  std::size_t first = 0;
  std::vector<float> of_pixels;

  float sum() const { return std::accumulate(of_pixels.begin(), of_pixels.end(), 0.0F); }
};

std::vector<CellWeights> cell_weights(int pixels) {
  std::vector<CellWeights> cells(kCells);
  for (int cell = 0; cell < kPlaceCells; ++cell) {
    CellWeights& weights = cells[static_cast<std::size_t>(cell)];
    for (int i = 0; i < pixels; ++i) {
      const double off = ((i + 0.5) * kPlaceCells / pixels - 0.5 - cell) / kCellSoftness;
      const double weight = std::exp(-0.5 * off * off);
      if (weight < kMinCellWeight) continue;
      if (weights.of_pixels.empty()) weights.first = static_cast<std::size_t>(i);
      weights.of_pixels.push_back(static_cast<float>(weight));
    }
  }
  return cells;
}

NADIR_FOR_WIDE_REGISTERS void add_weighted(const float* row, float weight, std::size_t count, float* __restrict sums) {
  for (std::size_t i = 0; i < count; ++i) sums[i] += weight * row[i];
}

// Weighted sums of an image's pixels for the cells, row by row, of each channel: first over the rows of the image, all
// columns side by side, then over the columns.
std::vector<float> pooled(const cv::Mat& image, const std::vector<CellWeights>& weights) {
  const auto channels = static_cast<std::size_t>(image.channels());
  const std::size_t line = static_cast<std::size_t>(image.cols) * channels;
  std::vector<float> sums(line), cells;
  for (const CellWeights& down : weights) {
    std::fill(sums.begin(), sums.end(), 0.0F);
    for (std::size_t i = 0; i < down.of_pixels.size(); ++i) {
      add_weighted(image.ptr<float>(static_cast<int>(down.first + i)), down.of_pixels[i], line, sums.data());
    }
    for (const CellWeights& across : weights) {
      for (std::size_t k = 0; k < channels; ++k) {
        float sum = 0;
        for (std::size_t i = 0; i < across.of_pixels.size(); ++i) {
          sum += across.of_pixels[i] * sums[(across.first + i) * channels + k];
        }
        cells.push_back(sum);
      }
    }
  }
  return cells;
}

}  // namespace

std::optional<RawPlaceDescriptor> describe_place(const PlacePatch& patch) {
  const Channels channels = oriented_channels(patch.grey, patch.mask, ChannelSet::six_orientations, {});
  const std::vector<CellWeights> weights = cell_weights(patch.grey.rows);
  cv::Mat shown;
  channels.mask.convertTo(shown, CV_32F, 1.0 / 255);
  const std::vector<float> area = pooled(shown, weights);
  std::vector<std::size_t> usable;  // cells
  for (std::size_t i = 0; i < area.size(); ++i) {
    const double whole =
        static_cast<double>(weights[i / kCells].sum()) * static_cast<double>(weights[i % kCells].sum());
    if (static_cast<double>(area[i]) > kMinCellShare * whole) usable.push_back(i);
  }
  if (usable.size() < kCells * kCells / 4) return std::nullopt;

  RawPlaceDescriptor descriptor{};
  double squared = 0;
  const std::size_t pairs = channels.pairs.size();
  for (std::size_t pair = 0; pair < pairs; ++pair) {
    const std::vector<float> sums = pooled(channels.pairs[pair], weights);
    for (const std::size_t half : {std::size_t{0}, std::size_t{1}}) {
      const auto value_of = [&](std::size_t cell) { return sums[2 * cell + half] / area[cell]; };
      double mean = 0;
      for (const std::size_t cell : usable) mean += static_cast<double>(value_of(cell));
      mean /= static_cast<double>(usable.size());
      const std::size_t orientation = pair + half * pairs;  // perpendicular ones share a pair
      for (const std::size_t cell : usable) {
        const double value = static_cast<double>(value_of(cell)) - mean;
        const double rooted = std::copysign(std::sqrt(std::abs(value)), value);
        descriptor[orientation * kCells * kCells + cell] = static_cast<float>(rooted);
        squared += rooted * rooted;
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
