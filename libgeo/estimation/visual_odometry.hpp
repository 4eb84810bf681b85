// Visual odometry: the camera's motion from one frame to the next over the ground.
//
// Backend-neutral: a front end receives a frame with its predicted attitude and height and returns how the camera moved
// since the last one, in metres and in the world's directions as the predicted heading has them, or nothing. A
// visual-inertial estimator can implement the same interface. tests/bench/flow_odometry.hpp is a second implementation,
// which the contract tests run as well.
#pragma once

#include <Eigen/Core>
#include <functional>
#include <memory>
#include <opencv2/core/mat.hpp>
#include <opencv2/core/types.hpp>
#include <optional>
#include <vector>

#include "estimation/pose_measurements.hpp"
#include "estimation/two_view_motion.hpp"
#include "vision/localizer_parameters.hpp"
#include "vision/rectification.hpp"
#include "vision/rolling_shutter.hpp"

namespace nadir {

struct OdometryFrame {
  cv::Mat grey;                            // CV_8UC1, full frame
  std::optional<UndoneShutter> undone{};   // how `grey` was made of what the camera gave; nothing: it is that
  CameraModel camera;                      // of `grey`
  Attitude attitude;                       // predicted, boresight included
  double agl_m = 0;                        // predicted
  LinearizationPoint linearization_point;  // the same, as the flight filter has it; returned with the step
  // Of this frame's heading against the last frame's.
  double heading_sigma_rad = parameters::visual_odometry::kDefaultHeadingSigma_rad;
  // Of the tilt that changes from frame to frame.
  double tilt_sigma_rad = parameters::visual_odometry::kDefaultTiltSigma_rad;
  Eigen::Matrix2d boresight_covariance_rad2 = Eigen::Matrix2d::Zero();         // of the tilt that all frames share
  Eigen::Vector2d ground_slope = Eigen::Vector2d::Zero();                      // rise over run to the east and north
  double relief_sigma_m = parameters::visual_odometry::kDefaultReliefSigma_m;  // of the ground beyond a plane
  // Of this frame's height against the last frame's.
  double relative_height_sigma = parameters::visual_odometry::kDefaultRelativeHeightSigma;
};

struct OdometryStep {
  Eigen::Vector2d displacement_m = Eigen::Vector2d::Zero();  // east, north, of the camera
  Eigen::Matrix2d covariance_m2 = Eigen::Matrix2d::Identity();
  RelativeMotionMeasurement measurement;  // the same with both frames' attitudes and heights, without any prior
  int inliers = 0;
  double overlap = 0;  // share of the frame that both saw
};

class OdometryFrontEnd {
 public:
  virtual ~OdometryFrontEnd() = default;
  // The motion since the last frame given; nothing for the first frame, without overlap or when unhealthy.
  virtual std::optional<OdometryStep> track(const OdometryFrame& frame) = 0;
  // After track(): the motion of the same frame since the one before the last, of which the last one is no continuation
  // (an outlier: a picture of another place). Nothing from a front end that keeps one frame only.
  virtual std::optional<OdometryStep> track_over_last() { return std::nullopt; }
  // Forgets all frames.
  virtual void reset() = 0;
};

using OdometryFactory = std::function<std::unique_ptr<OdometryFrontEnd>()>;

// SIFT features and a robust homography for the inliers, then measure_motion(). Where they show no motion, both frames
// are correlated as wholes (correlated_frames.hpp).
//
// An aircraft with fixed wings never stands still. What does, in the picture or relative to the aircraft, is not the
// ground: dirt on the lens, text in the picture, landing gear, the aircraft's own shadow, the sun in the water. It is
// all that a frame of water or fog shows, and is taken for no motion at all, not for one of zero metres.
std::unique_ptr<OdometryFrontEnd> make_feature_odometry();

// ---- What front ends that compare images have in common, however they find corresponding pixels.

// Pixels of both frames at working size, the same points in the same order, outliers among them.
struct PixelPairs {
  std::vector<cv::Point2f> before, now;
  double redundancy = 1;                                     // how many pairs show the same pixels and count as one
  double still_px = parameters::visual_odometry::kStill_px;  // who moved by less did not move over the ground
};

struct MeasuredMotion {
  OdometryStep step;
  TwoViewMotion motion;
};

// The frame with its image and camera reduced to the size that front ends work at.
OdometryFrame at_working_size(const OdometryFrame& frame);

// A robust homography (MAGSAC++) selects the inliers; both attitudes and the displacement follow from their rays
// (two_view_motion.hpp). The noise that the model lacks (lens, rolling shutter, relief) is added: a share of the
// displacement, and a share of the turn. Nothing when too few agree. The frames' images are not used.
std::optional<MeasuredMotion> measure_motion(const OdometryFrame& before, const OdometryFrame& now,
                                             const PixelPairs& pairs);

}  // namespace nadir
