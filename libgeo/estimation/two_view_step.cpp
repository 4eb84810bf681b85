#include "estimation/two_view_step.hpp"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <opencv2/calib3d.hpp>
#include <opencv2/imgproc.hpp>

#include "geodesy/angles.hpp"

namespace nadir {
namespace {

// SIFT begins by doubling the picture. At half the size, with weaker contrasts let in, it costs a third and drifts
// less.
constexpr double kWorkingWidth_px = 450;
constexpr int kMinInliers = 12;
constexpr double kHomographyThreshold_px = 3.0;
constexpr double kModelErrorShare = 0.01;  // of the motion
constexpr double kTurnErrorShare = 0.05;   // of the turn: hills under a banked camera (`bench turns`)

std::vector<RayPair> sights_of(const OdometryFrame& before, const OdometryFrame& now, const SharedPixels& shared) {
  std::vector<RayPair> sights;
  if (shared.before.size() < kMinInliers) return sights;
  std::vector<std::uint8_t> inlier;
  const cv::Mat homography =
      cv::findHomography(shared.before, shared.now, cv::USAC_MAGSAC, kHomographyThreshold_px, inlier, 5000, 0.999);
  if (homography.empty()) return sights;
  const auto ray = [](const CameraModel& camera, const cv::Point2f& pixel) {
    return camera.ray_from_pixel({static_cast<double>(pixel.x), static_cast<double>(pixel.y)});
  };
  for (std::size_t i = 0; i < inlier.size(); ++i) {
    if (inlier[i] == 0) continue;
    sights.push_back({ray(before.camera, shared.before[i]), ray(now.camera, shared.now[i])});
  }
  return sights;
}

TwoViewPrior prior_of(const OdometryFrame& before, const OdometryFrame& now) {
  TwoViewPrior prior;
  prior.before = {{}, before.agl_m, before.attitude};
  prior.now = {{}, now.agl_m, now.attitude};
  prior.heading_sigma_rad = now.heading_sigma_rad;
  const Eigen::Matrix2d& shared = now.boresight_covariance_rad2;
  prior.tilt_covariance_rad2 << shared, shared, shared, shared;
  prior.tilt_covariance_rad2.diagonal().array() += now.tilt_sigma_rad * now.tilt_sigma_rad;
  prior.ground_slope = (before.ground_slope + now.ground_slope) / 2;
  prior.relief_sigma_m = now.relief_sigma_m;
  prior.log_height_sigma = now.relative_height_sigma;
  return prior;
}

// Directions of which the sights say nothing get a variance that is as good as infinite.
RelativeMotionMeasurement sight_of(const TwoViewMotion& motion, const OdometryFrame& frame_before, const OdometryFrame& frame_now) {
  const Believed &before = frame_before.believed, &now = frame_now.believed;
  Eigen::Matrix<double, 8, 1> vague;
  const double far_m = 100 * (1 + motion.moved_m.norm());
  vague << far_m, far_m, 1, 1, 1, 1, 1, 1;
  const Eigen::Matrix<double, 8, 8> weak = vague.cwiseProduct(vague).cwiseInverse().asDiagonal();
  RelativeMotionMeasurement sight;
  sight.covariance = (motion.measurement_information + weak).inverse();
  sight.seen = motion.solved + sight.covariance * motion.measurement_gradient;
  // What the model does not know: the lens, rolling shutter, hills. It grows with how far things move in the picture.
  const double unknown_m = kModelErrorShare * motion.moved_m.norm();
  const double turn_rad = wrap_pi(now.heading_rad - before.heading_rad + sight.seen[3]);
  const double unknown_rad = std::hypot(unknown_m / frame_now.agl_m, kTurnErrorShare * turn_rad);
  sight.covariance.topLeftCorner<2, 2>().diagonal().array() += unknown_m * unknown_m;
  sight.covariance(3, 3) += unknown_rad * unknown_rad;
  sight.before = before;
  sight.now = now;
  return sight;
}

}  // namespace

OdometryFrame at_working_size(const OdometryFrame& frame) {
  OdometryFrame reduced = frame;
  const double factor = std::min(1.0, kWorkingWidth_px / std::max(frame.grey.cols, frame.grey.rows));
  if (factor < 1) {
    reduced.camera = frame.camera.scaled(factor);
    reduced.grey = cv::Mat();
    cv::resize(frame.grey, reduced.grey, cv::Size(reduced.camera.width, reduced.camera.height), 0, 0, cv::INTER_AREA);
  }
  return reduced;
}

std::optional<MeasuredStep> measure_step(const OdometryFrame& before, const OdometryFrame& now,
                                         const SharedPixels& shared) {
  const auto sights = sights_of(before, now, shared);
  if (static_cast<int>(sights.size()) < kMinInliers) return std::nullopt;
  const auto motion = solve_two_view_motion(sights, prior_of(before, now));
  if (!motion || motion->inliers < kMinInliers) return std::nullopt;
  MeasuredStep measured{{}, *motion};
  OdometryStep& step = measured.step;
  step.moved_m = motion->moved_m;
  step.covariance_m2 = motion->covariance_m2;
  step.sight = sight_of(*motion, before, now);
  step.inliers = motion->inliers;
  const auto box = footprint_of(now.camera, {{}, now.agl_m, now.attitude});
  if (box) {
    const double across = std::min(box->east_m - box->west_m, box->north_m - box->south_m);
    step.overlap = std::max(0.0, 1.0 - step.moved_m.norm() / across);
  }
  return measured;
}

}  // namespace nadir
