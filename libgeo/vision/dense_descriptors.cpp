#include "vision/dense_descriptors.hpp"

#include <fmt/format.h>

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

#include "base/error.hpp"
#include "vision/localizer_parameters.hpp"

namespace nadir {

using namespace parameters::learned_matching;

namespace {

int rounded_up(int length, int multiple) { return (length + multiple - 1) / multiple * multiple; }

// A part of a picture that the network is shown, and the cells that are taken from there.
struct Part {
  int begin = 0, end = 0;               // shown, in cells
  int first_taken = 0, last_taken = 0;  // of the picture
};

// Along one side of so many cells.
std::vector<Part> parts_along(int cells) {
  const int most = kDescribedPart_px / kDescriptorCell_px, margin = kDescribedMargin_px / kDescriptorCell_px;
  std::vector<Part> parts;
  for (int first = 0; first < cells; first += most) {
    const int last = std::min(cells, first + most);
    parts.push_back({std::max(0, first - margin), std::min(cells, last + margin), first, last});
  }
  return parts;
}

[[noreturn]] void reject(const DenseDescriptorNetwork& network, const std::string& expected, const std::string& found) {
  throw Error({.what = "the descriptor network gives what it should not",
               .where = network.name(),
               .expected = expected,
               .found = found,
               .fix = "fly without it, or use another model"});
}

// Describes a part, filled up to the sides that a network takes. Unit vectors are written to `cells`.
void describe_part(DenseDescriptorNetwork& network, const cv::Mat& part, cv::Mat cells) {
  cv::Mat shown;
  cv::copyMakeBorder(part, shown, 0, rounded_up(part.rows, kDescriptorSide_px) - part.rows, 0,
                     rounded_up(part.cols, kDescriptorSide_px) - part.cols, cv::BORDER_REPLICATE);
  const cv::Mat found = network.describe(shown);
  const cv::Size size(shown.cols / kDescriptorCell_px, shown.rows / kDescriptorCell_px);
  if (found.size() != size || found.type() != CV_32FC(network.channels())) {
    reject(network, fmt::format("{} x {} cells of {} channels", size.width, size.height, network.channels()),
           fmt::format("{} x {} cells of {} channels", found.cols, found.rows, found.channels()));
  }
  const auto channels = static_cast<std::size_t>(network.channels());
  for (int r = 0; r < cells.rows; ++r) {
    const auto* from = found.ptr<float>(r);
    auto* to = cells.ptr<float>(r);
    for (int c = 0; c < cells.cols; ++c, from += channels, to += channels) {
      float squares = 0;
      for (std::size_t k = 0; k < channels; ++k) squares += from[k] * from[k];
      if (!std::isfinite(squares)) reject(network, "finite numbers", "NaN or infinity");
      const float factor = squares > 0 ? 1 / std::sqrt(squares) : 0;
      for (std::size_t k = 0; k < channels; ++k) to[k] = from[k] * factor;
    }
  }
}

// Cells of which nearly all pixels are valid, and those around them as well: a network sees farther than its cell.
cv::Mat valid_cells(const cv::Mat& mask, cv::Size cells) {
  if (mask.empty()) return {cells, CV_8UC1, cv::Scalar(255)};
  cv::Mat share, valid;
  cv::resize(mask(cv::Rect(0, 0, cells.width * kDescriptorCell_px, cells.height * kDescriptorCell_px)), share, cells, 0,
             0, cv::INTER_AREA);
  cv::threshold(share, valid, kLeastCellShare * 255, 255, cv::THRESH_BINARY);
  cv::erode(valid, valid, cv::getStructuringElement(cv::MORPH_RECT, {3, 3}), {-1, -1}, 1, cv::BORDER_CONSTANT,
            cv::Scalar(255));
  return valid;
}

}  // namespace

DescribedPicture described(DenseDescriptorNetwork& network, const cv::Mat& grey, const cv::Mat& mask,
                           const Cancel& cancel) {
  const cv::Size size(grey.cols / kDescriptorCell_px, grey.rows / kDescriptorCell_px);
  DescribedPicture picture;
  picture.cells.create(size, CV_32FC(network.channels()));
  if (size.empty()) {
    picture.mask.create(size, CV_8UC1);
    return picture;
  }
  picture.mask = valid_cells(mask, size);
  cv::Mat filled = grey;
  if (!mask.empty() && cv::countNonZero(mask) < static_cast<int>(mask.total())) {
    filled = cv::Mat(grey.size(), CV_8UC1, cv::mean(grey, mask));
    grey.copyTo(filled, mask);
  }
  for (const Part& rows : parts_along(size.height)) {
    for (const Part& columns : parts_along(size.width)) {
      cancel.check();
      const cv::Rect shown(columns.begin, rows.begin, columns.end - columns.begin, rows.end - rows.begin);
      const cv::Rect taken(columns.first_taken, rows.first_taken, columns.last_taken - columns.first_taken,
                           rows.last_taken - rows.first_taken);
      if (cv::countNonZero(picture.mask(taken)) == 0) {
        picture.cells(taken).setTo(0);
        continue;
      }
      const cv::Rect pixels(shown.x * kDescriptorCell_px, shown.y * kDescriptorCell_px,
                            shown.width * kDescriptorCell_px, shown.height * kDescriptorCell_px);
      cv::Mat cells(shown.size(), picture.cells.type());
      describe_part(network, filled(pixels), cells);
      cells(taken - shown.tl()).copyTo(picture.cells(taken));
    }
  }
  for (int r = 0; r < size.height; ++r) {
    const auto* valid = picture.mask.ptr<std::uint8_t>(r);
    auto* cell = picture.cells.ptr<float>(r);
    for (int c = 0; c < size.width; ++c, cell += network.channels()) {
      if (valid[c] == 0) std::fill_n(cell, network.channels(), 0.0F);
    }
  }
  return picture;
}

PrincipalChannels::PrincipalChannels(const DescribedPicture& of, int count) {
  const int channels = of.cells.channels();
  if (count >= channels) return;
  Eigen::VectorXd sum = Eigen::VectorXd::Zero(channels);
  Eigen::MatrixXd products = Eigen::MatrixXd::Zero(channels, channels);
  double cells = 0;
  for (int r = 0; r < of.cells.rows; ++r) {
    for (int c = 0; c < of.cells.cols; ++c) {
      if (of.mask.at<std::uint8_t>(r, c) == 0) continue;
      const Eigen::VectorXd cell =
          Eigen::Map<const Eigen::VectorXf>(of.cells.ptr<float>(r) + c * channels, channels).cast<double>();
      sum += cell;
      products.selfadjointView<Eigen::Lower>().rankUpdate(cell);
      ++cells;
    }
  }
  if (cells == 0) return;
  const Eigen::VectorXd mean = sum / cells;
  Eigen::MatrixXd covariance = products.selfadjointView<Eigen::Lower>();
  covariance = covariance / cells - mean * mean.transpose();
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> solver(covariance);  // in increasing order
  if (solver.info() != Eigen::Success) return;
  directions_ = solver.eigenvectors().rightCols(count).rowwise().reverse().cast<float>();
}

DescribedPicture PrincipalChannels::project(const DescribedPicture& picture) const {
  if (directions_.size() == 0) return picture;
  const auto channels = static_cast<Eigen::Index>(picture.cells.channels()), kept = directions_.cols();
  DescribedPicture projected{cv::Mat(picture.cells.size(), CV_32FC(static_cast<int>(kept))), picture.mask};
  using Rows = Eigen::Matrix<float, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
  for (int r = 0; r < picture.cells.rows; ++r) {
    Eigen::Map<Rows>(projected.cells.ptr<float>(r), picture.cells.cols, kept).noalias() =
        Eigen::Map<const Rows>(picture.cells.ptr<float>(r), picture.cells.cols, channels) * directions_;
  }
  return projected;
}

Channels channels_of(const DescribedPicture& picture) {
  Channels channels;
  channels.mask = picture.mask;
  const int count = picture.cells.channels();
  for (int first = 0; first < count; first += 2) {
    cv::Mat pair = cv::Mat::zeros(picture.cells.size(), CV_32FC2);
    for (int r = 0; r < pair.rows; ++r) {
      const auto* from = picture.cells.ptr<float>(r);
      auto* to = pair.ptr<float>(r);
      for (int c = 0; c < pair.cols; ++c) {
        to[2 * c] = kDescriptorScale * from[c * count + first];
        if (first + 1 < count) to[2 * c + 1] = kDescriptorScale * from[c * count + first + 1];
      }
    }
    channels.pairs.push_back(pair);
  }
  return channels;
}

}  // namespace nadir
