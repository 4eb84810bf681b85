// Continuity of the track from frame to frame: whether odometry has tracked every frame since the last anchor, whether
// a frame contradicts the one before it, and what a contradicted turn means for the position.
//
//   unbroken      odometry has tracked every frame since the last anchor or the start
//   segment       a new number, the highest so far, each time tracking is lost
//   linked        the last frame was the first one, or odometry tracked it: the next one should continue it
//   broken        this frame does not continue a linked one although they should overlap: one of the two shows another
//                 place (a mixed-up recording, a camera that delivers an old image), and it is unknown which
//   outlier       the next frame does not continue the broken one, but the one before it: the broken one showed another
//                 place. It is skipped, and the track goes on, in the segment that it had
#pragma once

#include <optional>

#include "estimation/flight_filter.hpp"

namespace nadir {

// How a frame relates to the previous one.
struct FrameLink {
  bool first = false;             // there is no previous one
  bool comparable = false;        // the frame is usable and its attitude is known
  bool expected_overlap = false;  // TrackingState::expects_overlap(), before odometry
  bool tracked = false;           // odometry measured the motion between them
  bool over_outlier = false;      // … or, the previous one being broken, since the one before it
};

class TrackingState {
 public:
  explicit TrackingState(bool start_known) : unbroken_(start_known) {}

  // Between two images of the same ground odometry hardly fails once and then continues. The frame should continue the
  // previous one if that is linked and the aircraft cannot have flown half a footprint. flight: predicted.
  bool expects_overlap(const FlightFilter& flight, double seconds, double footprint_m) const;

  void on_frame(const FrameLink& link);
  void on_anchor(bool same_track) { unbroken_ = same_track; }
  // The last frame was processed with a heading so far off that no motion from it is linear about the present state.
  void unlink() { linked_ = false; }

  bool unbroken() const { return unbroken_; }
  bool tracked() const { return tracked_; }  // by odometry, the last frame, be it over an outlier
  bool broken() const { return broken_; }
  int segment() const { return segment_; }

 private:
  bool unbroken_;
  bool linked_ = false;
  bool tracked_ = false;
  bool broken_ = false;
  int segment_ = 0;
  int highest_segment_ = 0;
  bool unbroken_before_ = false;  // before tracking was lost last
  int segment_before_ = 0;
};

// No turn and no gust moves an aircraft so far in this time: the images overlap, but one of them was not taken there
// and then. With a stopped clock the speed is unknown.
bool exceeds_reach(const FlightFilter& flight, double step_m, double seconds, double footprint_m);

// The images turned and the telemetry did not, or the other way round: a compass that jumped, or a camera that rotates
// its images. turn_rad: of the images beyond the telemetry.
bool contradicts_turn(double turn_rad, double heading_sigma_rad);

// A motion that few pairs of pixels agree on may be chance, where two frames show nothing or not the same ground: it
// must agree with the prediction. inliers: OdometryStep's.
bool is_chance_motion(const FlightFilter& flight, const RelativeMotionMeasurement& measurement, int inliers);
// Of one that is not: that it is chance nevertheless, 0 to 1. Chance finds motions that end anywhere in the frame, and
// turns that the telemetry does not contradict, all alike; right ones are as the flight predicts.
double motion_doubt(const FlightFilter::MotionFit& fit, int inliers, double frame_m2);

// Where an inertial sensor predicts the motion: displacement and turn are beyond what both sides' noise explains.
bool contradicts_inertial(const FlightFilter& flight, const RelativeMotionMeasurement& measurement);

// After a contradicted turn the aircraft may fly another course than estimated, until the heading is known again: with
// every step the position's σ grows by twice its length.
class CourseAmbiguity {
 public:
  // The σ to inflate the position by (one axis), if any.
  std::optional<double> on_step(bool turn_contradicted, double heading_sigma_rad, double step_m);

 private:
  bool open_ = false;
  double astray_m_ = 0;
};

}  // namespace nadir
