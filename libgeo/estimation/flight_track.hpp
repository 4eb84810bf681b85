// The track of a flight by telemetry and odometry, from frame to frame, and the log of all that the flight filter was
// given. The map is none of its business: an anchor is a measurement at one of its frames, which may lie some frames
// back. The filter then returns to that frame, is updated, and applies the later steps again.
//
//   predict() → update_with_odometry()                              each frame
//   return_to() → update_absolute() → repeat_later_steps()          each anchor
#pragma once

#include <memory>
#include <opencv2/core/mat.hpp>
#include <optional>
#include <vector>

#include "estimation/belief.hpp"
#include "estimation/estimate.hpp"
#include "estimation/flight_filter.hpp"
#include "estimation/flight_smoother.hpp"
#include "estimation/telemetry.hpp"
#include "estimation/tracking_state.hpp"
#include "estimation/visual_odometry.hpp"
#include "vision/camera.hpp"
#include "vision/ground_surface.hpp"
#include "vision/rolling_shutter.hpp"

namespace nadir {

struct TrackStart {
  PlanePoint position{};
  double sigma_m = 0;  // one axis
  bool known = false;  // or anywhere in the area
  double latitude_rad = 0;
  double assumed_agl_m = 0;  // until telemetry has a height
};

// What odometry made of a frame.
struct TrackedMotion {
  cv::Mat grey;  // the frame as it would be with a global shutter
  OdometryReport odometry;
  // A motion that the filter took, for the belief.
  struct Taken {
    Eigen::Vector2d correction_m = Eigen::Vector2d::Zero();  // of the track's past
    TrackPrediction track;                                   // with it
    MotionEvidence evidence;
  };
  std::optional<Taken> taken;
};

// A frame that was looked up on the map.
struct LastLook {
  double time_s = 0;
  int segment = 0;
  PlanePoint position;  // of the track
};

class FlightTrack {
 public:
  // surface must outlive the track.
  FlightTrack(const CameraFile& camera, const GroundSurface& surface, std::unique_ptr<OdometryFrontEnd> odometry,
              const TrackStart& start);

  // ---- The steps of a frame, in order

  // Returns the seconds since the last frame.
  double predict(const Telemetry& measured);
  // as_read: grey, as the camera gave it. What is not usable is no measurement, and odometry begins anew after it.
  TrackedMotion update_with_odometry(const cv::Mat& as_read, bool usable);

  // ---- The steps of an anchor, in order

  // Of the frame, as the filter was then. Returns the heading that the last frame was processed with.
  double return_to(std::size_t step, const FlightFilter& then);
  void update_absolute(std::size_t step, const PoseMeasurement& anchor);
  // The frames that were tracked meanwhile, again. segment: the track's when the frame was matched.
  void repeat_later_steps(std::size_t step, int segment, double heading_before_rad);

  // ---- What else moves it

  void inflate_for_hint(double sigma_m);
  void on_look(const LastLook& look) { last_look_ = look; }

  // ---- What is known of it

  bool begun() const { return filter_.has_value(); }  // from the first telemetry on
  const FlightFilter& filter() const { return *filter_; }
  const FlightFilter& initial() const { return *initial_; }  // before the first frame
  const std::vector<FlightStep>& steps() const { return steps_; }
  FlightStep& step(std::size_t i) { return steps_[i]; }  // what it says of the map is the caller's
  const TrackingState& tracking() const { return tracking_; }
  const Telemetry& telemetry() const { return telemetry_.last; }
  const TelemetryReference& reference() const { return telemetry_.reference; }
  // Corrections of the past that odometry has made since the last anchor. They are withheld from what is published: a
  // track that odometry propagates jumps only at anchors, and smoothing applies them.
  const Eigen::Vector2d& withheld_m() const { return withheld_m_; }
  const Eigen::Vector2d& corrected_m() const { return corrected_m_; }  // by odometry, so far, withheld or not
  double footprint_m() const;                                          // longer side
  double new_ground() const;  // share of the footprint that the last look did not show, as far as is known

 private:
  // What the telemetry gave the filter so far.
  struct TelemetryState {
    Telemetry last;
    std::optional<double> last_time_s;
    TelemetryReference reference;  // of this frame; where it measures no height, the last one, or an assumed one
    bool height_measured = false;  // in this frame
    bool height_steady = false;    // in this frame and in the one before
    bool tilt_logged = false;      // pitch and roll are measured, if not in each frame
  };
  // The track as it was before a frame: where it goes on if that frame turns out to show another place.
  struct TrackBefore {
    FlightFilter filter;
    Eigen::Vector2d withheld_m;
    std::optional<LastLook> last_look;
  };

  cv::Mat at_one_moment(const cv::Mat& as_read);
  cv::Mat at_one_moment_again(const cv::Mat& as_read, const cv::Mat& grey);
  OdometryFrame odometry_frame(const cv::Mat& grey) const;
  RelativeMotionMeasurement measured_motion(const OdometryStep& motion, const OdometryFrame& seen) const;
  bool update_with_motion(const OdometryFrame& seen, TrackedMotion& result);
  bool update_over_outlier(const OdometryFrame& seen, TrackedMotion& result);
  MotionEvidence motion_evidence(const FlightFilter& predicted, const RelativeMotionMeasurement& measurement,
                                 int inliers) const;
  TrackedMotion::Taken taken(const Eigen::Vector2d& correction_m, MotionEvidence evidence) const;
  void watch_course(bool turn_contradicted, double step_m);

  CameraModel camera_;
  std::optional<SensorReadout> readout_;
  bool on_gimbal_;
  TelemetryUncertainty uncertainty_;
  const GroundSurface* surface_;
  std::unique_ptr<OdometryFrontEnd> odometry_;
  TrackStart start_;

  std::optional<FlightFilter> filter_, initial_;  // made with the first telemetry, which shows whether tilt is logged
  std::vector<FlightStep> steps_;                 // a frame each
  std::optional<TrackBefore> before_now_, before_last_;  // before the current frame, and before the one before it
  TelemetryState telemetry_;
  ShutterMotion shutter_motion_;  // by which the last frame's shutter was undone
  TrackingState tracking_;
  CourseAmbiguity course_;
  int inertial_contradictions_ = 0;  // visual motions in a row that the inertial sensor contradicts
  Eigen::Vector2d withheld_m_ = Eigen::Vector2d::Zero(), corrected_m_ = Eigen::Vector2d::Zero();
  std::optional<LastLook> last_look_;
};

}  // namespace nadir
