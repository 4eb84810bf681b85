// Everything that is believed of the flight, in one Gaussian: position, velocity, height, heading and tilt of the frame
// in work, and the lasting errors of the telemetry behind them.
//
// They belong together. A degree of tilt moves what the camera sees at 1500 m by 26 m, so the error of an anchor is the
// tilt's error in disguise; odometry ties two frames' tilts, heights and headings to the motion between them. With all
// correlations kept, good odometry averages the tilts of many frames, and a boresight learnt late corrects the past.
//
// A frame's turn: carry() for each stretch of a long way to it, advance(), then moved() when odometry tracked it, then
// anchored() when the map confirmed it.
// Sights come without any prior in them (what the picture alone says), so that nothing is counted twice.
#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "estimation/pose_sights.hpp"
#include "estimation/telemetry.hpp"
#include "vision/camera.hpp"

namespace nadir {

struct FlightPrediction;

class FlightFilter {
 public:
  // In this order: position east, north (m); velocity east, north (m/s); log of true over told height; heading (rad);
  // pitch and roll beyond the telemetry's (rad); constant parts of the telemetry's errors in heading, pitch and roll;
  // and what of the heading's error turns with the course, as a ship's compass deviation of coefficients B and C does
  // (Admiralty Manual for the Deviations of the Compass): on this course, and on that 90 degrees to the right.
  enum Index {
    east,
    north,
    velocity_east,
    velocity_north,
    log_height,
    heading,
    pitch,
    roll,
    heading_bias,
    pitch_bias,
    roll_bias,
    deviation,
    deviation_quadrature,
    states
  };
  using State = Eigen::Matrix<double, states, 1>;
  using Covariance = Eigen::Matrix<double, states, states>;

  struct Options {
    double start_velocity_sigma_mps = 15;   // of each axis, when nothing is known
    double acceleration_mps2 = 1.5;         // of unmodelled changes of velocity (per root second), heading unknown …
    double steady_acceleration_mps2 = 1.0;  // … and known: a fixed wing keeps its airspeed through a turn
    double wind_sigma_mps = 5;              // what of the velocity does not turn with the aircraft
  };

  // tilt_logged: the telemetry carries pitch and roll; otherwise the aircraft's own tilt is in what changes as well.
  FlightFilter(const TelemetryUncertainty& uncertainty, bool tilt_logged, const Eigen::Vector2d& position_m,
               double sigma_m, const Options& options);
  FlightFilter(const TelemetryUncertainty& uncertainty, bool tilt_logged, const Eigen::Vector2d& position_m,
               double sigma_m)
      : FlightFilter(uncertainty, tilt_logged, position_m, sigma_m, Options{}) {}

  // So much further without a frame: the way to the next one where it is long, as the telemetry tells it. seconds above
  // 0.
  void carry(const TelemetryInterval& stretch);
  // A new frame, so many seconds after the last one or after what was carried. When the clock stands or runs backwards,
  // the time is unknown: about what passed between the frames before, or none. tilt_measured: the telemetry has pitch and
  // roll for this frame. imu_dv_mps: Telemetry's; with it the velocity does not drift but by what the camera file says
  // of the sensor.
  void advance(double seconds, std::optional<double> measured_heading_rad, bool tilt_measured = true,
               const std::optional<Eigen::Vector2d>& imu_dv_mps = std::nullopt);
  // After advance(): this frame's told height is not the last one's (another source, or a guess), so that nothing
  // learnt of the old one's error is true of it.
  void doubt_height(double log_sigma);
  // The telemetry's headings may from now on be so much farther off than believed.
  void doubt_heading(double sigma_rad);
  // The place may be so much farther off than believed (one axis): what it was learnt from is contradicted.
  void doubt_position(double sigma_m);
  // Returns how far what was learnt moved the place of the frame before (east, north; m): a step also tells of heading,
  // tilt and height, and so of the steps before it.
  Eigen::Vector2d moved(const RelativeMotionMeasurement& sight);
  void anchored(const PoseMeasurement& sight);

  const State& state() const { return mean_; }
  const Covariance& covariance() const { return covariance_; }
  Eigen::Vector2d position_m() const { return mean_.segment<2>(east); }
  Eigen::Matrix2d position_covariance_m2() const { return covariance_.block<2, 2>(east, east); }
  double position_sigma_m() const;  // one axis of the equivalent circle
  double sigma(Index index) const;

  // How much tilt changes from frame to frame beyond its constant part: learnt, because a gimbal hardly does and a bare
  // airframe without logged attitude does a lot.
  double changing_tilt_sigma_rad() const;
  bool tilt_missing() const { return tilt_missing_; }  // of the frame in work, though the telemetry has it otherwise

  // From now on every frame is kept for smoothed(): 4 kB each.
  void remember() { links_.emplace(); }

  // Every frame remembered with all that was learnt later (Rauch-Tung-Striebel); the last one alone without remember().
  struct Smoothed {
    Eigen::Vector2d position_m;
    Eigen::Matrix2d covariance_m2;
    State state;  // all of it
  };
  std::vector<Smoothed> smoothed() const;

 private:
  static constexpr int kJoint = 2 * states;
  using JointState = Eigen::Matrix<double, kJoint, 1>;
  using JointCovariance = Eigen::Matrix<double, kJoint, kJoint>;

  struct Link;
  void fly(const TelemetryInterval& stretch, bool tilt_measured);
  FlightPrediction foretell(const TelemetryInterval& stretch);
  void foretell_heading(FlightPrediction& prediction, const std::optional<double>& measured_heading_rad, double dt) const;
  void settle();
  void forget_velocity();
  Link link() const;
  void take_motion(const RelativeMotionMeasurement& sight, const Eigen::Vector2d& step);
  void learn_tilt_scatter(const PoseMeasurement& sight);
  template <int Rows>
  void update_joint(const Eigen::Matrix<double, Rows, kJoint>& row, const Eigen::Matrix<double, Rows, 1>& innovation,
                    const Eigen::Matrix<double, Rows, Rows>& noise);

  TelemetryUncertainty uncertainty_;
  bool tilt_logged_;
  Options options_;
  State mean_ = State::Zero();  // of the frame in work
  Covariance covariance_ = Covariance::Zero();
  std::optional<double> measured_heading_rad_;  // of the frame in work
  std::optional<double> last_measured_heading_rad_;
  bool first_ = true;
  bool on_the_way_ = false;    // carried since the last frame
  double blind_turn_rad_ = 0;  // turned since odometry or an anchor last told of the velocity …
  double blind_s_ = 0;         // … and flown
  bool tilt_missing_ = false;  // in the frame in work, though others had it
  double usual_seconds_ = 1;   // between frames
  double tilt_scatter_sum_;  // of the changing part's variance, weighted by how well it was seen; begins with the prior
  double tilt_scatter_weight_;

  // The last frame and the one in work (or a point on the way to it) together, until an anchor or the next frame comes.
  std::optional<std::pair<JointState, JointCovariance>> joint_;
  struct Link {  // of a frame to the one before it
    State before, now;
    Covariance before_covariance, now_covariance, gain;
  };
  std::optional<std::vector<Link>> links_;
};

}  // namespace nadir
