#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <opencv2/calib3d.hpp>
#include <opencv2/features2d.hpp>
#include <opencv2/imgproc.hpp>

#include "estimation/feature_matching.hpp"
#include "estimation/odometry.hpp"
#include "estimation/two_view_motion.hpp"

namespace nadir {
namespace {

// SIFT begins by doubling the picture. At half the size, with weaker contrasts let in, it costs a third and drifts
// less.
constexpr double kWorkingWidth_px = 450;
constexpr int kMaxFeatures = 1500;
constexpr double kLeastContrast = 0.007;
constexpr double kMatchRatio = 0.85;
constexpr int kMinInliers = 12;
constexpr double kHomographyThreshold_px = 3.0;
constexpr double kModelErrorShare = 0.01;  // of the motion

struct Seen {
  OdometryFrame frame;  // without its picture
  std::vector<cv::KeyPoint> points;
  FeatureDescriptors descriptors;
};

Seen look(const OdometryFrame& frame, cv::Feature2D& detector) {
  Seen seen{frame, {}, {}};
  const double factor = std::min(1.0, kWorkingWidth_px / std::max(frame.grey.cols, frame.grey.rows));
  cv::Mat small = frame.grey;
  if (factor < 1) {
    seen.frame.camera = frame.camera.scaled(factor);
    cv::resize(frame.grey, small, cv::Size(seen.frame.camera.width, seen.frame.camera.height), 0, 0, cv::INTER_AREA);
  }
  seen.frame.grey.release();
  cv::Mat descriptors;
  detector.detectAndCompute(small, cv::noArray(), seen.points, descriptors);
  seen.descriptors = FeatureDescriptors(descriptors);
  return seen;
}

std::vector<SharedSight> sights_of(const Seen& before, const Seen& now, const std::vector<FeatureMatch>& matches) {
  std::vector<cv::Point2f> from, to;
  for (const FeatureMatch& match : matches) {
    from.push_back(before.points[match.second].pt);
    to.push_back(now.points[match.first].pt);
  }
  std::vector<SharedSight> sights;
  if (from.size() < kMinInliers) return sights;
  std::vector<std::uint8_t> inlier;
  const cv::Mat homography =
      cv::findHomography(from, to, cv::USAC_MAGSAC, kHomographyThreshold_px, inlier, 5000, 0.999);
  if (homography.empty()) return sights;
  for (std::size_t i = 0; i < inlier.size(); ++i) {
    if (inlier[i] == 0) continue;
    sights.push_back(
        {before.frame.camera.ray_from_pixel({static_cast<double>(from[i].x), static_cast<double>(from[i].y)}),
         now.frame.camera.ray_from_pixel({static_cast<double>(to[i].x), static_cast<double>(to[i].y)})});
  }
  return sights;
}

TwoViewPrior prior_of(const Seen& before, const Seen& now) {
  TwoViewPrior prior;
  prior.before = {{}, before.frame.agl_m, before.frame.attitude};
  prior.now = {{}, now.frame.agl_m, now.frame.attitude};
  prior.heading_sigma_rad = now.frame.heading_sigma_rad;
  const Eigen::Matrix2d& shared = now.frame.boresight_covariance_rad2;
  prior.tilt_covariance_rad2 << shared, shared, shared, shared;
  prior.tilt_covariance_rad2.diagonal().array() += now.frame.tilt_sigma_rad * now.frame.tilt_sigma_rad;
  prior.ground_slope = (before.frame.ground_slope + now.frame.ground_slope) / 2;
  prior.relief_sigma_m = now.frame.relief_sigma_m;
  prior.log_height_sigma = now.frame.relative_height_sigma;
  return prior;
}

// Directions of which the sights say nothing get a variance that is as good as infinite.
MotionSight sight_of(const TwoViewMotion& motion, const Believed& before, const Believed& now) {
  Eigen::Matrix<double, 8, 1> vague;
  const double far_m = 100 * (1 + motion.moved_m.norm());
  vague << far_m, far_m, 1, 1, 1, 1, 1, 1;
  const Eigen::Matrix<double, 8, 8> weak = vague.cwiseProduct(vague).cwiseInverse().asDiagonal();
  MotionSight sight;
  sight.covariance = (motion.sighted_information + weak).inverse();
  sight.seen = motion.solved + sight.covariance * motion.sighted_pull;
  // What the model does not know: rolling shutter, the moment of the telemetry.
  sight.covariance.topLeftCorner<2, 2>().diagonal().array() +=
      kModelErrorShare * kModelErrorShare * motion.moved_m.squaredNorm();
  sight.covariance(3, 3) += kModelErrorShare * kModelErrorShare;
  sight.before = before;
  sight.now = now;
  return sight;
}

class FeatureOdometry final : public OdometryFrontEnd {
 public:
  std::optional<OdometryStep> track(const OdometryFrame& frame) override {
    Seen now = look(frame, *detector_);
    std::optional<OdometryStep> step;
    if (last_) step = step_between(*last_, now);
    last_ = std::move(now);
    return step;
  }

  void reset() override { last_.reset(); }

 private:
  static std::optional<OdometryStep> step_between(const Seen& before, const Seen& now) {
    const auto sights = sights_of(before, now, unambiguous_matches(now.descriptors, before.descriptors, kMatchRatio));
    if (static_cast<int>(sights.size()) < kMinInliers) return std::nullopt;
    const auto motion = solve_two_view_motion(sights, prior_of(before, now));
    if (!motion || motion->inliers < kMinInliers) return std::nullopt;
    OdometryStep step;
    step.moved_m = motion->moved_m;
    step.covariance_m2 = motion->covariance_m2;
    step.sight = sight_of(*motion, before.frame.believed, now.frame.believed);
    step.inliers = motion->inliers;
    const auto box = footprint_of(now.frame.camera, {{}, now.frame.agl_m, now.frame.attitude});
    if (box) {
      const double across = std::min(box->east_m - box->west_m, box->north_m - box->south_m);
      step.overlap = std::max(0.0, 1.0 - step.moved_m.norm() / across);
    }
    return step;
  }

  cv::Ptr<cv::Feature2D> detector_ = cv::SIFT::create(kMaxFeatures, 3, kLeastContrast);
  std::optional<Seen> last_;
};

}  // namespace

std::unique_ptr<OdometryFrontEnd> make_feature_odometry() { return std::make_unique<FeatureOdometry>(); }

}  // namespace nadir
