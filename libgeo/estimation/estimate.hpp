// Results of the localizer for one frame: position, uncertainty, and why.
#pragma once

#include <Eigen/Core>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include <opencv2/core/mat.hpp>

#include "estimation/pose_measurements.hpp"
#include "estimation/source_label.hpp"
#include "geodesy/lon_lat.hpp"
#include "geodesy/plane_point.hpp"
#include "vision/map_search.hpp"
#include "vision/rectification.hpp"

namespace nadir {

// Why an anchor was accepted or not (map_look.hpp). The names are stable.
enum class AnchorVerdict {
  not_tried,  // not triggered for this frame
  accepted,
  frame_unfit,     // black, blown out, blurred, undecodable
  no_map,          // the window is off the map
  ambiguous,       // another place fits nearly as well (ratio)
  few_inliers,     // the patches do not agree on one pose
  bad_geometry,    // residual, tilt, height or coverage of the frame beyond what is credible
  off_prediction,  // contradicts a healthy filter (χ²)
  awaiting_votes,  // plausible, but needs support by other frames
};

std::string_view name_of(AnchorVerdict verdict);

struct AnchorReport {
  AnchorVerdict verdict = AnchorVerdict::not_tried;
  double score = -1;       // correlation of all channels at the best place, at most 1
  double ratio = 1;        // best elsewhere / best peak, smaller is better
  int inliers = 0;         // patches that agree with the pose
  int patches = 0;         // patches tried
  double residual_px = 0;  // RMS of the inliers, in pixels of the matching GSD
  double matching_gsd_m = 0;
  double log_likelihood_ratio = 0;      // true place over chance peak, nats (look_likelihood.hpp)
  double place_doubt = 1;               // weight of all hypotheses that are not at the match (belief.hpp)
  double chi2 = 0;                      // squared Mahalanobis distance to the prediction, 2 degrees of freedom
  std::optional<PlanePoint> camera;     // matched camera position in the map's plane (of rejected ones too)
  double heading_rad = 0;               // matched heading of image-up
  double window_radius_m = 0;           // half the side of the searched window
  std::vector<MatchHypothesis> places;  // that looked most like the frame, best first (not recorded)
  cv::Mat rectified;    // BGR or grey: the frame as it was matched, north-up (for reports; may be empty)
  cv::Mat matched_map;  // the same part of the map
};

struct OdometryReport {
  bool tracked = false;
  int inliers = 0;
  double step_m = 0;
};

struct Estimate {
  std::string frame;
  double time_s = 0;
  std::optional<LonLat> position;  // nothing with no_fix
  double sigma_m = 0;              // 1-σ error per axis of the equivalent circle, map error included
  Eigen::Matrix2d covariance_m2 = Eigen::Matrix2d::Zero();  // east, north
  // Protection level: outside this radius the aircraft is with the integrity risk at most (belief.hpp). Nothing: no
  // radius is known to hold it.
  std::optional<double> hpl_m;
  SourceLabel source = SourceLabel::no_fix;
  int segment = 0;  // grows each time tracking is lost
  std::optional<double> anchor_age_s;
  int anchor_inliers = 0;   // of the last accepted anchor
  double anchor_ratio = 1;  // of the last accepted anchor
  double latency_ms = 0;
};

// The state beside the position, at the estimate's frame.
struct StateEstimate {
  Eigen::Vector2d velocity_mps = Eigen::Vector2d::Zero();  // east, north
  double velocity_sigma_mps = 0;                           // one axis
  double heading_rad = 0;                                  // of image-up
  double heading_sigma_rad = 0;
  double agl_m = 0;
  double agl_sigma_m = 0;
};

// During the readout of a rolling shutter (vision/rolling_shutter.hpp).
struct CameraMotion {
  Eigen::Vector2d velocity_mps = Eigen::Vector2d::Zero();  // east, north
  Eigen::Vector3d rate_rad_s = Eigen::Vector3d::Zero();    // as Telemetry::rate_rad_s; zeros: not known
};

// Where the camera was when a frame was taken, for products made of the frame itself.
struct FramePose {
  CameraPose pose;                                          // in the map's plane
  Eigen::Matrix2d covariance_m2 = Eigen::Matrix2d::Zero();  // of the position, east and north, map error included
  double sigma_m = 0;                                       // one axis of the equivalent circular error
  SourceLabel source = SourceLabel::no_fix;
  double anchor_age_s = 0;
  // Another anchor supports this one: the prediction from it agrees, or (refined) odometry links both without a break.
  // Or this one is so clear in ratio and agreement at once that no wrong place ever came near (docs/safety.md).
  bool confirmed = false;
  bool refined = false;  // smoothed with all later measurements
  CameraMotion motion{};
};

// A frame after smoothing, and what vision measured of it: what an adjustment of the whole flight begins with.
struct SmoothedFrame {
  CameraPose pose;                                          // in the map's plane
  Eigen::Matrix2d covariance_m2 = Eigen::Matrix2d::Zero();  // of the position, east and north, map error excluded
  Eigen::Matrix2d shared_m2 = Eigen::Matrix2d::Zero();      // what no number of anchors averages out
  TelemetryReference reference;                             // that the anchor is relative to
  double tilt_sigma_rad = 0;              // of the measured tilt against the frames around it; as the flight showed
  std::optional<PoseMeasurement> anchor;  // accepted online; as the filter was given it
  bool continues_flight = false;          // odometry tracked it from the frame before
};

struct FrameReport {
  Estimate estimate;
  StateEstimate state;
  AnchorReport anchor;
  OdometryReport odometry;
  std::optional<FramePose> anchor_pose;  // of the frame that the anchor report is about, when it was accepted
};

}  // namespace nadir
