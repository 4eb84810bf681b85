// Frame-to-frame motion over flat ground.
//
// Backend-neutral: a front end receives a frame with what is believed of its attitude and height and returns how the
// camera moved since the last one, in metres and in the world's directions as the telemetry's heading has them, or that
// it cannot tell. A visual-inertial estimator can stand behind the same interface.
#pragma once

#include <Eigen/Core>
#include <functional>
#include <memory>
#include <opencv2/core/mat.hpp>
#include <optional>

#include "estimation/pose_sights.hpp"
#include "vision/rectification.hpp"

namespace nadir {

struct OdometryFrame {
  cv::Mat grey;                     // CV_8UC1, full frame
  CameraModel camera;               // of `grey`
  Attitude attitude;                // as believed, boresight included
  double agl_m = 0;                 // as believed
  Believed believed;                // the same, as the flight filter has it; handed back with the step
  double heading_sigma_rad = 0.05;  // of this frame's heading against the last frame's
  double tilt_sigma_rad = 0.03;     // that changes from frame to frame
  Eigen::Matrix2d boresight_covariance_rad2 = Eigen::Matrix2d::Zero();  // of the tilt that all frames share
  Eigen::Vector2d ground_slope = Eigen::Vector2d::Zero();  // known rise of the ground to the east and north
  double relief_sigma_m = 1.5;                             // of the ground's height beyond a plane
  double relative_height_sigma = 0.02;                     // of this frame's height against the last frame's
};

struct OdometryStep {
  Eigen::Vector2d moved_m = Eigen::Vector2d::Zero();  // east, north, of the camera
  Eigen::Matrix2d covariance_m2 = Eigen::Matrix2d::Identity();
  // The same and what it says of both frames' attitudes and heights, without any prior in it.
  RelativeMotionMeasurement sight;
  int inliers = 0;
  double overlap = 0;  // share of the frame that both saw
};

class OdometryFrontEnd {
 public:
  virtual ~OdometryFrontEnd() = default;
  // The motion since the last frame given; nothing for the first frame, without overlap or when unhealthy.
  virtual std::optional<OdometryStep> track(const OdometryFrame& frame) = 0;
  // Forgets the last frame.
  virtual void reset() = 0;
};

using OdometryFactory = std::function<std::unique_ptr<OdometryFrontEnd>()>;

// SIFT features, a robust homography to choose the matches, then both cameras' attitudes and the motion in metres from
// the rays of the matches over a plane.
std::unique_ptr<OdometryFrontEnd> make_feature_odometry();

// No features: both pictures are resampled to the ground's north-up grid, correlated as wholes, and then patch by
// patch. Attitudes must be known to some degrees and a quarter of the picture be shared.
std::unique_ptr<OdometryFrontEnd> make_flow_odometry();

}  // namespace nadir
