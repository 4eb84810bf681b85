#include "estimation/visual_odometry.hpp"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <opencv2/calib3d.hpp>
#include <utility>

#include "estimation/correlated_frames.hpp"
#include "estimation/odometry_features.hpp"
#include "geodesy/angles.hpp"
#include "geodesy/hypotenuse.hpp"
#include "vision/area_resize.hpp"
#include "vision/feature_matching.hpp"

namespace nadir {
namespace {

using namespace parameters::visual_odometry;

std::vector<RayPair> ray_pairs_of(const OdometryFrame& before, const OdometryFrame& now, const PixelPairs& pairs) {
  std::vector<RayPair> rays;
  if (pairs.before.size() < kMinInliers) return rays;
  std::vector<std::uint8_t> inlier;
  const cv::Mat homography = cv::findHomography(pairs.before, pairs.now, cv::USAC_MAGSAC, kHomographyThreshold_px,
                                                inlier, kHomographyIterations, kHomographyConfidence);
  if (homography.empty()) return rays;
  const auto ray = [](const CameraModel& camera, const cv::Point2f& pixel) {
    return camera.ray_from_pixel({static_cast<double>(pixel.x), static_cast<double>(pixel.y)});
  };
  for (std::size_t i = 0; i < inlier.size(); ++i) {
    if (inlier[i] == 0) continue;
    rays.push_back({ray(before.camera, pairs.before[i]), ray(now.camera, pairs.now[i])});
  }
  return rays;
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

// Directions that the images do not constrain get a practically infinite variance.
RelativeMotionMeasurement measurement_of(const TwoViewMotion& motion, const OdometryFrame& frame_before,
                                         const OdometryFrame& frame_now) {
  const LinearizationPoint &before = frame_before.linearization_point, &now = frame_now.linearization_point;
  Eigen::Matrix<double, 8, 1> vague;
  const double far_m = parameters::pose_measurement::kVagueMotionLengths * (1 + motion.displacement_m.norm());
  vague << far_m, far_m, 1, 1, 1, 1, 1, 1;
  const Eigen::Matrix<double, 8, 8> weak = vague.cwiseProduct(vague).cwiseInverse().asDiagonal();
  RelativeMotionMeasurement measurement;
  measurement.covariance = (motion.measurement_information + weak).inverse();
  measurement.value = motion.solved + measurement.covariance * motion.measurement_gradient;
  // What the model lacks (lens, rolling shutter, relief) grows with the displacement in the image.
  const double unmodelled_m = kModelErrorShare * motion.displacement_m.norm();
  const double turn_rad = wrap_pi(now.heading_rad - before.heading_rad + measurement.value[3]);
  const double unmodelled_rad = hypotenuse(unmodelled_m / frame_now.agl_m, kTurnErrorShare * turn_rad);
  measurement.covariance.topLeftCorner<2, 2>().diagonal().array() += unmodelled_m * unmodelled_m;
  measurement.covariance(3, 3) += unmodelled_rad * unmodelled_rad;
  measurement.before = before;
  measurement.now = now;
  return measurement;
}

}  // namespace

OdometryFrame at_working_size(const OdometryFrame& frame) {
  OdometryFrame reduced = frame;
  const double factor = std::min(1.0, kWorkingWidth_px / std::max(frame.grey.cols, frame.grey.rows));
  if (factor < 1) {
    reduced.camera = frame.camera.scaled(factor);
    reduced.grey = area_resized(frame.grey, {reduced.camera.width, reduced.camera.height});
  }
  return reduced;
}

std::optional<MeasuredMotion> measure_motion(const OdometryFrame& before, const OdometryFrame& now,
                                             const PixelPairs& pairs) {
  const auto rays = ray_pairs_of(before, now, pairs);
  if (static_cast<int>(rays.size()) < kMinInliers) return std::nullopt;
  TwoViewPrior prior = prior_of(before, now);
  prior.redundancy = pairs.redundancy;
  const auto motion = solve_two_view_motion(rays, prior);
  if (!motion || motion->inliers < kMinInliers) return std::nullopt;
  MeasuredMotion measured{{}, *motion};
  OdometryStep& step = measured.step;
  step.displacement_m = motion->displacement_m;
  step.covariance_m2 = motion->covariance_m2;
  step.measurement = measurement_of(*motion, before, now);
  step.inliers = motion->inliers;
  const auto box = footprint_of(now.camera, {{}, now.agl_m, now.attitude});
  if (box) {
    const double across = std::min(box->east_m - box->west_m, box->north_m - box->south_m);
    step.overlap = std::max(0.0, 1.0 - step.displacement_m.norm() / across);
  }
  return measured;
}

namespace {

// With its image.
OdometryFeatures described(const OdometryFrame& frame) {
  OdometryFeatures result{at_working_size(frame), {}};
  result.features = sift_features(result.frame.grey, {kMaxFeatures, kOctaveLayers, kSiftContrast});
  return result;
}

}  // namespace

OdometryFeatures odometry_features(const OdometryFrame& frame) {
  OdometryFeatures result = described(frame);
  result.frame.grey.release();
  return result;
}

PixelPairs similar_pixels(const OdometryFeatures& frame_before, const OdometryFeatures& frame_now) {
  const SiftFeatures &before = frame_before.features, &now = frame_now.features;
  PixelPairs pairs;
  for (const FeatureMatch& match : unambiguous_matches(now.descriptors, before.descriptors, kMatchRatio)) {
    pairs.before.push_back(before.points[match.second]);
    pairs.now.push_back(now.points[match.first]);
  }
  return pairs;
}

namespace {

// Without those that stand still in the picture.
PixelPairs moving(const PixelPairs& pairs) {
  PixelPairs result;
  result.redundancy = pairs.redundancy;
  result.still_px = pairs.still_px;
  for (std::size_t i = 0; i < pairs.now.size(); ++i) {
    if (cv::norm(pairs.now[i] - pairs.before[i]) < pairs.still_px) continue;
    result.before.push_back(pairs.before[i]);
    result.now.push_back(pairs.now[i]);
  }
  return result;
}

// Relative to the ground.
bool stands_still(const OdometryStep& step, const OdometryFrame& now, double still_px) {
  return step.displacement_m.norm() * now.camera.fx / now.agl_m < still_px;
}

class FeatureOdometry final : public OdometryFrontEnd {
 public:
  std::optional<OdometryStep> track(const OdometryFrame& frame) override {
    before_last_ = std::move(last_);
    last_ = std::exchange(now_, described(frame));
    if (now_->frame.grey.data == frame.grey.data) now_->frame.grey = frame.grey.clone();  // the caller's may change
    return motion_since(last_);
  }

  std::optional<OdometryStep> track_over_last() override { return motion_since(before_last_); }

  void reset() override {
    now_.reset();
    last_.reset();
    before_last_.reset();
  }

 private:
  std::optional<OdometryStep> motion_since(const std::optional<OdometryFeatures>& before) const {
    if (!before || !now_) return std::nullopt;
    const OdometryFrame &one = before->frame, &other = now_->frame;
    const auto motion = motion_of(one, other, similar_pixels(*before, *now_));
    return motion ? motion : motion_of(one, other, correlated_pixels(one, other));
  }

  static std::optional<OdometryStep> motion_of(const OdometryFrame& before, const OdometryFrame& now,
                                               const PixelPairs& pairs) {
    const auto measured = measure_motion(before, now, moving(pairs));
    if (!measured || stands_still(measured->step, now, pairs.still_px)) return std::nullopt;
    return measured->step;
  }

  std::optional<OdometryFeatures> now_, last_, before_last_;
};

}  // namespace

std::unique_ptr<OdometryFrontEnd> make_feature_odometry() { return std::make_unique<FeatureOdometry>(); }

}  // namespace nadir
