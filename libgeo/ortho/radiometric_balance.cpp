#include "ortho/radiometric_balance.hpp"

#include <Eigen/SparseCholesky>
#include <algorithm>
#include <cmath>
#include <map>
#include <opencv2/imgproc.hpp>
#include <tuple>
#include <utility>

#include "geodesy/hypotenuse.hpp"
#include "vision/localizer_parameters.hpp"

namespace nadir {
namespace {

constexpr double kCellsAcross = 20;        // of the longer side of a footprint; chosen
constexpr int kReducedCell_px = 5;         // of the reduced image: odd, so that blurring moves nothing; chosen
constexpr float kLeastLevel = 8;           // grey levels: below it noise and the toe of the tone curve count; chosen
constexpr double kMostClippedShare = .02;  // of the pixels of a cell; chosen
constexpr double kPairSigma = 0.05;        // of ln level of a cell in two frames: texture, relief, noise; chosen
constexpr double kLinkSigma = 0.05;        // of all cells that two frames share: they err together; chosen
constexpr double kExposureSigma = 0.3;     // of e_f; chosen
constexpr double kSharedSigma = 0.5;       // of a and b; chosen
constexpr int kRounds = 8;                 // of reweighting; the weights change by less than 1 % after five
constexpr int kFalloffTerms = 3, kSharedTerms = kFalloffTerms + 2;
constexpr int kNodeStep_px = 16;

// From the principal point, in halves of the diagonal.
Eigen::Vector2d in_lens(const CameraModel& camera, double x, double y) {
  return Eigen::Vector2d(x - camera.cx, y - camera.cy) / (hypotenuse(camera.width, camera.height) / 2);
}

// The same ground in two frames, as differences of the one to the other.
struct Pair {
  std::uint32_t one = 0, other = 0;
  double weight = 1;
  Eigen::Matrix<double, kSharedTerms, 1> shared;  // the regressors of a and b
  Eigen::Vector3d log_level;                      // by channel
};

}  // namespace

double RadiometricCorrection::log_factor(std::size_t channel, const CameraModel& camera, double x, double y) const {
  const Eigen::Vector2d at = in_lens(camera, x, y);
  const auto& a = log_falloff[channel];
  const double r2 = at.squaredNorm();
  return log_gain[channel] - r2 * (a[0] + r2 * (a[1] + r2 * a[2])) - log_gradient[channel][0] * at.x() -
         log_gradient[channel][1] * at.y();
}

void RadiometricCorrection::apply(cv::Mat& bgr, const CameraModel& camera) const {
  if (*this == RadiometricCorrection()) return;
  // On a coarse grid, and bilinear between: the factor changes slowly.
  const cv::Size nodes(bgr.cols / kNodeStep_px + 2, bgr.rows / kNodeStep_px + 2);
  cv::Mat factors(nodes, CV_32FC3);
  for (int row = 0; row < nodes.height; ++row) {
    for (int column = 0; column < nodes.width; ++column) {
      for (std::size_t c = 0; c < 3; ++c) {
        factors.at<cv::Vec3f>(row, column)[static_cast<int>(c)] =
            static_cast<float>(std::exp(log_factor(c, camera, column * kNodeStep_px, row * kNodeStep_px)));
      }
    }
  }
  for (int row = 0; row < bgr.rows; ++row) {
    const int node_row = row / kNodeStep_px;
    const float v = static_cast<float>(row % kNodeStep_px) / kNodeStep_px;
    const auto *above = factors.ptr<cv::Vec3f>(node_row), *below = factors.ptr<cv::Vec3f>(node_row + 1);
    auto* pixel = bgr.ptr<cv::Vec3b>(row);
    for (int column = 0; column < bgr.cols; ++column) {
      const int node = column / kNodeStep_px;
      const float u = static_cast<float>(column % kNodeStep_px) / kNodeStep_px;
      for (int c = 0; c < 3; ++c) {
        const float factor = (1 - v) * ((1 - u) * above[node][c] + u * above[node + 1][c]) +
                             v * ((1 - u) * below[node][c] + u * below[node + 1][c]);
        pixel[column][c] = cv::saturate_cast<std::uint8_t>(static_cast<float>(pixel[column][c]) * factor);
      }
    }
  }
}

void RadiometricBalance::add(std::uint32_t frame, const cv::Mat& bgr, const CameraModel& camera,
                             const CameraPose& pose) {
  const auto seen = footprint_of(camera, pose);
  if (!seen) return;
  headings_rad_.emplace_back(frame, pose.attitude.heading_rad);
  const double cos_heading = std::cos(pose.attitude.heading_rad), sin_heading = std::sin(pose.attitude.heading_rad);
  if (cell_m_ == 0) cell_m_ = footprint_side_m(camera, pose.agl_m) / kCellsAcross;
  // Reduced so that a cell has kReducedCell_px pixels, and those averaged: a pixel is the mean of the cell around it.
  const double scale = std::min(1.0, kReducedCell_px * gsd_at(camera, pose.agl_m) / cell_m_);
  const cv::Size size(std::max(1, cvRound(scale * bgr.cols)), std::max(1, cvRound(scale * bgr.rows)));
  cv::Mat unclipped, clipped_share, levels, level_at;
  cv::inRange(bgr, cv::Scalar::all(kClippedDark + 1), cv::Scalar::all(kClippedBright - 1), unclipped);
  cv::resize(~unclipped, clipped_share, size, 0, 0, cv::INTER_AREA);
  cv::blur(clipped_share, clipped_share, {kReducedCell_px, kReducedCell_px});
  cv::resize(bgr, levels, size, 0, 0, cv::INTER_AREA);
  levels.convertTo(levels, CV_32FC3);
  cv::blur(levels, levels, {kReducedCell_px, kReducedCell_px});
  constexpr float kMargin_px = kReducedCell_px / 2;
  const cv::Rect2f inner(kMargin_px, kMargin_px, static_cast<float>(size.width - 1) - 2 * kMargin_px,
                         static_cast<float>(size.height - 1) - 2 * kMargin_px);
  const auto first = [&](double low_m) { return static_cast<std::int32_t>(std::ceil(low_m / cell_m_ - 0.5)); };
  const auto last = [&](double high_m) { return static_cast<std::int32_t>(std::floor(high_m / cell_m_ - 0.5)); };
  for (std::int32_t east = first(seen->west_m); east <= last(seen->east_m); ++east) {
    for (std::int32_t north = first(seen->south_m); north <= last(seen->north_m); ++north) {
      const PlanePoint middle((east + 0.5) * cell_m_, (north + 0.5) * cell_m_);
      const Eigen::Vector3d point = camera_from_ground(pose, middle, surface_);
      if (!(point.z() > 0)) continue;
      const Eigen::Vector2d pixel = camera.pixel_from_point(point);
      const cv::Point2f at(static_cast<float>((pixel.x() + 0.5) * size.width / bgr.cols - 0.5),
                           static_cast<float>((pixel.y() + 0.5) * size.height / bgr.rows - 0.5));
      if (!inner.contains(at)) continue;
      cv::getRectSubPix(levels, {1, 1}, at, level_at);
      const auto& level = level_at.at<cv::Vec3f>(0, 0);
      const bool clipped = clipped_share.at<std::uint8_t>(cvRound(at.y), cvRound(at.x)) > 255 * kMostClippedShare;
      if (clipped || std::min({level[0], level[1], level[2]}) < kLeastLevel) continue;
      const Eigen::Vector2d q = in_lens(camera, pixel.x(), pixel.y());
      samples_.push_back({east,
                          north,
                          frame,
                          static_cast<float>(q.squaredNorm()),
                          static_cast<float>(q.x() * cos_heading - q.y() * sin_heading),
                          static_cast<float>(-q.x() * sin_heading - q.y() * cos_heading),
                          {std::log(level[0]), std::log(level[1]), std::log(level[2])}});
    }
  }
}

std::vector<RadiometricCorrection> RadiometricBalance::solve(std::size_t frames) const {
  std::vector<RadiometricCorrection> corrections(frames);
  std::vector<Sample> samples = samples_;
  std::sort(samples.begin(), samples.end(), [](const Sample& a, const Sample& b) {
    return std::tie(a.east, a.north, a.frame) < std::tie(b.east, b.north, b.frame);
  });
  std::vector<Pair> pairs;
  const auto shared = [](const Sample& sample) {
    const double r2 = sample.r2;
    return Eigen::Matrix<double, kSharedTerms, 1>(r2, r2 * r2, r2 * r2 * r2, sample.q_east, sample.q_north);
  };
  const auto pair = [&](const Sample& a, const Sample& b) {
    Pair& found = pairs.emplace_back(Pair{a.frame, b.frame, 1, shared(a) - shared(b), {}});
    for (std::size_t c = 0; c < 3; ++c) {
      found.log_level[static_cast<Eigen::Index>(c)] =
          static_cast<double>(a.log_level[c]) - static_cast<double>(b.log_level[c]);
    }
  };
  // Each frame of a cell with the next one there, and with one half of them later, which is of another pass where there
  // were several: linear in the number of samples, however long a camera hovers.
  for (std::size_t begin = 0, end = 0; begin < samples.size(); begin = end) {
    while (end < samples.size() && samples[end].east == samples[begin].east &&
           samples[end].north == samples[begin].north)
      ++end;
    const std::size_t half = (end - begin) / 2;
    for (std::size_t i = begin; i + 1 < end; ++i) {
      pair(samples[i], samples[i + 1]);
      if (half > 1 && i + half < end) pair(samples[i], samples[i + half]);
    }
  }
  if (pairs.empty()) return corrections;
  std::map<std::pair<std::uint32_t, std::uint32_t>, double> cells;
  for (const Pair& each : pairs) ++cells[{each.one, each.other}];
  for (Pair& each : pairs) each.weight = 1 / (kLinkSigma * kLinkSigma * cells[{each.one, each.other}]);

  const auto count = static_cast<Eigen::Index>(frames), size = count + kSharedTerms;
  Eigen::MatrixXd solution = Eigen::MatrixXd::Zero(size, 3);  // by channel
  Eigen::SimplicialLDLT<Eigen::SparseMatrix<double>> solver;
  for (int round = 0; round < kRounds; ++round) {
    std::vector<Eigen::Triplet<double>> triplets;
    Eigen::VectorXd diagonal = Eigen::VectorXd::Constant(count, 1 / (kExposureSigma * kExposureSigma));
    Eigen::MatrixXd border = Eigen::MatrixXd::Zero(count, kSharedTerms), right = Eigen::MatrixXd::Zero(size, 3);
    Eigen::MatrixXd corner = Eigen::MatrixXd::Identity(kSharedTerms, kSharedTerms) / (kSharedSigma * kSharedSigma);
    for (const Pair& p : pairs) {
      const auto one = static_cast<Eigen::Index>(p.one), other = static_cast<Eigen::Index>(p.other);
      double weight = p.weight;
      if (round > 0) {
        const Eigen::Vector3d residual = p.log_level - (solution.row(one) - solution.row(other)).transpose() -
                                         solution.bottomRows<kSharedTerms>().transpose() * p.shared;
        weight /= 1 + residual.squaredNorm() / (3 * kPairSigma * kPairSigma);
      }
      diagonal[one] += weight, diagonal[other] += weight;
      triplets.emplace_back(std::max(one, other), std::min(one, other), -weight);
      border.row(one) += weight * p.shared, border.row(other) -= weight * p.shared;
      corner += weight * p.shared * p.shared.transpose();
      right.row(one) += weight * p.log_level, right.row(other) -= weight * p.log_level;
      right.bottomRows<kSharedTerms>() += weight * p.shared * p.log_level.transpose();
    }
    for (Eigen::Index i = 0; i < count; ++i) {
      triplets.emplace_back(i, i, diagonal[i]);
      for (Eigen::Index k = 0; k < kSharedTerms; ++k) triplets.emplace_back(count + k, i, border(i, k));
    }
    for (Eigen::Index k = 0; k < kSharedTerms; ++k) {
      for (Eigen::Index l = 0; l <= k; ++l) triplets.emplace_back(count + k, count + l, corner(k, l));
    }
    Eigen::SparseMatrix<double> normal(size, size);
    normal.setFromTriplets(triplets.begin(), triplets.end());
    solver.compute(normal);
    solution = solver.solve(right);
  }

  // As bright as before, on the mean of all samples.
  Eigen::RowVector3d level = Eigen::RowVector3d::Zero();
  for (const Sample& sample : samples) {
    level += solution.row(sample.frame) + shared(sample).transpose() * solution.bottomRows<kSharedTerms>();
  }
  level /= static_cast<double>(samples.size());
  std::vector<bool> known(frames, false);
  for (const Sample& sample : samples) known[sample.frame] = true;
  for (const auto& [frame, heading_rad] : headings_rad_) {
    if (!known[frame]) continue;
    RadiometricCorrection& correction = corrections[frame];
    const double cos_heading = std::cos(heading_rad), sin_heading = std::sin(heading_rad);
    for (std::size_t c = 0; c < 3; ++c) {
      const auto channel = static_cast<Eigen::Index>(c);
      correction.log_gain[c] = level[channel] - solution(static_cast<Eigen::Index>(frame), channel);
      for (std::size_t k = 0; k < kFalloffTerms; ++k) {
        correction.log_falloff[c][k] = solution(count + static_cast<Eigen::Index>(k), channel);
      }
      const double east = solution(size - 2, channel), north = solution(size - 1, channel);
      correction.log_gradient[c] = {east * cos_heading - north * sin_heading,
                                    -east * sin_heading - north * cos_heading};
    }
  }
  return corrections;
}

}  // namespace nadir
