// Extended Kalman filter of the flight: one Gaussian over position, velocity, height, heading and tilt of the current
// frame, and over the persistent errors of the telemetry.
//
// These quantities are coupled. One degree of tilt moves the image centre by 26 m from 1500 m, so that the error of an
// absolute position fix is largely that of the tilt; odometry links the tilts, heights and headings of two frames
// to the displacement between them. With all correlations kept, good odometry averages the tilts of many frames, and a
// boresight that is estimated late also corrects earlier frames.
//
// State (FlightState::Index; metres, m/s, radians):
//
//   p = (east, north)      position of the camera in the map's plane
//   v                      velocity, east and north
//   λ = ln(h / h_m)        true over measured height above ground
//   ψ                      heading of image-up, clockwise from north
//   τ = (θ, φ)             pitch and roll beyond the telemetry's
//   b_ψ, b_τ               persistent error of the telemetry's heading; boresight (persistent error of pitch and roll)
//   d, d⊥                  compass deviation on this course and on the one 90° to the right (coefficients B and C of
//   the
//                          Admiralty Manual for the Deviations of the Compass)
//
// Process model: flight_process_model.hpp.
//
// Measurements, both of the image alone, without any prior, so that nothing is counted twice:
//
//   update_absolute   z = (p, λ, ψ, τ) + r                      an accepted match with the map
//   update_relative   z = (m, Δλ, Δψ, τ_before, τ_now) + r      odometry, about linearization points ⁰ of both frames:
//                     m  = p_now - p_before - (λ_before - λ⁰) m - (ψ_before - ψ⁰) (m_north, -m_east)
//                     Δλ = (λ_now - λ_before) - (λ⁰_now - λ⁰_before), Δψ alike, τ less its linearization point
//
// Both are linear updates in Joseph's form. update_relative works on the joint density of two frames, so that the
// earlier one is corrected as well; it stays joint until marginalize_previous().
//
// With an inertial sensor's samples (inertial_preintegration.hpp) the filter also carries a strapdown attitude R
// (world, that is east, north, up, from the sensor's axes b) and biases b_g, b_a as nominal values, and their errors as
// states:
//
//   e = (φ, δb_g, δb_a, δM)    R_true = Exp(φ) R, b_true = b + δb …; zero after each update: that moves R, b, M
//
// and the process model of velocity, position and heading becomes, with t, ΔR, Δv, Δp, J and their covariance
// preintegrated between two moments, and the Earth's rate ω_e:
//
//   R'   = Exp(-ω_e t) R ΔR                    φ' = φ + R' J_Rg δb_g + R' w_φ + w_scale
//   v'   = v + [R Δv - 2 ω_e × v t]            + [-(R Δv) × φ + R (J_vg δb_g + J_va δb_a + w_v)] + w_scale
//   p'   = p + t v + [R Δp]                    + [-(R Δp) × φ + R (J_pg δb_g + J_pa δb_a + w_p)]
//   ψ'   = ψ + turn of R about the vertical    - [R' J_Rg δb_g]_up + w_ψ
//   z    = ψ_m = ψ - b_ψ - d + w               the measured heading is now a measurement
//   0    = angles of R - (ψ, θ + θ_m, φ + φ_m) + w    at each frame: the sensor turns with the camera
//
// where [ ] takes the horizontal part, so that gravity's own value does not matter: what leaks into the horizontal
// through φ is all in R Δv. A wind needs no state, and the velocity no airspeed. Level, heading and biases are learned
// from what odometry and anchors say of position and velocity, all of which are correlated with e; a bias and a tilt
// cannot be distinguished in straight flight, and need not be. w_scale is what the sensor's scale and misalignment make
// of a turn or of a change of velocity. The sensor's axes are the camera's: where it is mounted askew by a degree or
// two, that is in M and b_a, which are learned. With the last equation the tilt no longer changes from frame to frame
// as it pleases, and odometry measures velocity far better. The filter begins so at the first frame that has samples,
// heading and tilt, and ends where samples are missing; the velocity is then predicted as above, and the biases are
// kept for the next beginning. e is no state of the frame before: blocks P_xe and P_ee are added to the covariance of
// x, whose own equations are the same with G e as a further input (a Schmidt-Kalman filter's partition, with e updated
// as well). Without samples there is no e, and nothing of the above changes. The smoother works on x alone: between
// frames it takes G e for noise.
//
// One frame: propagate() for each interval of a long way to it, predict(), then update_relative() if odometry tracked
// it, then update_absolute() if a match with the map was accepted. smoothed() is Rauch-Tung-Striebel's smoother.
// Noise and its origins: localizer_parameters.hpp (telemetry, flight_filter, FlightFilterOptions).
#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "estimation/flight_process_model.hpp"
#include "estimation/pose_measurements.hpp"
#include "estimation/strapdown_step.hpp"
#include "estimation/telemetry.hpp"
#include "vision/camera.hpp"
#include "vision/localizer_parameters.hpp"

namespace nadir {

class FlightFilter {
 public:
  using enum FlightState::Index;
  using Index = FlightState::Index;
  using State = FlightState::Vector;
  using Covariance = FlightState::Covariance;

  using Options = FlightFilterOptions;

  // tilt_logged: the telemetry contains pitch and roll; otherwise the aircraft's own tilt is part of what changes.
  FlightFilter(const TelemetryUncertainty& uncertainty, bool tilt_logged, PlanePoint position, double sigma_m,
               const Options& options);
  FlightFilter(const TelemetryUncertainty& uncertainty, bool tilt_logged, PlanePoint position, double sigma_m)
      : FlightFilter(uncertainty, tilt_logged, position, sigma_m, Options{}) {}

  // Over an interval at whose end there is no frame; interval.seconds > 0. If it measured nothing, the next one begins
  // where it began.
  void propagate(const TelemetryInterval& interval);
  // To a new frame, so many seconds after the last one or after what was propagated. When the clock stands still or
  // runs backwards, the time is unknown: about the usual interval, or none. tilt_measured: the telemetry has pitch and
  // roll for this frame. imu_dv_mps: Telemetry's; with it the velocity's only noise is what the camera file states.
  void predict(double seconds, std::optional<double> measured_heading_rad, bool tilt_measured = true,
               const std::optional<Eigen::Vector2d>& imu_dv_mps = std::nullopt);
  // The same two by the inertial sensor, which must have begun: over a part of the way to a frame, and to it.
  void propagate(const PreintegratedMotion& motion);
  void predict(const PreintegratedMotion& motion, std::optional<double> measured_heading_rad,
               const std::optional<Eigen::Vector2d>& measured_tilt_rad);
  // After predict(): from the current frame on there are samples of an inertial sensor. measured_tilt_rad: pitch and
  // roll that the states are beyond. Does nothing while the heading is unknown, and after the sensor was refused too
  // often.
  void begin_inertial(const Eigen::Vector2d& measured_tilt_rad);
  // Images contradict it: the velocity is unknown, the position off by this σ, and the biases begin anew.
  void refuse_inertial(double sigma_m);
  // Where the flight is, for the Earth's rate.
  void set_latitude(double latitude_rad);
  bool inertial() const { return inertial_.has_value(); }
  InertialCalibration inertial_calibration() const {
    return inertial_ ? inertial_->calibration : InertialCalibration{};
  }
  // Mahalanobis distance² of what odometry says of displacement and turn (three degrees of freedom) to the prediction.
  double motion_chi2(const RelativeMotionMeasurement& measurement) const { return motion_fit(measurement).chi2; }
  struct MotionFit {
    double chi2 = 0;
    double spread = 0;  // √|S|, m² rad, S being the covariance of prediction and measurement: the room it leaves
  };
  MotionFit motion_fit(const RelativeMotionMeasurement& measurement) const;  // zeros before the second frame
  // Of the measured displacement, beyond the predicted one.
  double motion_innovation_m(const RelativeMotionMeasurement& measurement) const;
  double turn_sigma_rad() const;  // of the heading's change since the last frame
  // After predict(): this frame's measured height has another source than the last one's (or is assumed), so that
  // nothing estimated of the old one's error holds. log_sigma: of λ.
  void reset_height(double log_sigma);
  // The telemetry's headings may from now on be farther off, by this σ.
  void inflate_heading(double sigma_rad);
  // The position may be farther off (one axis): a measurement contradicts it.
  void inflate_position(double sigma_m);
  // Returns the correction of the previous frame's position (east, north; m): a displacement also measures heading,
  // tilt and height, and so the displacements before it.
  Eigen::Vector2d update_relative(const RelativeMotionMeasurement& measurement);
  void update_absolute(const PoseMeasurement& measurement);

  const State& state() const { return mean_; }
  const Covariance& covariance() const { return covariance_; }
  PlanePoint position() const { return PlanePoint(mean_.segment<2>(east)); }
  Eigen::Matrix2d position_covariance_m2() const { return covariance_.block<2, 2>(east, east); }
  Eigen::Matrix<double, 6, 6> pose_covariance() const;  // of what a PoseMeasurement measures
  double position_sigma_m() const;                      // one axis of the equivalent circle
  double sigma(Index index) const;

  // σ of w_τ, estimated from accepted anchors: a gimbal hardly changes, a bare airframe without logged attitude does.
  double white_tilt_sigma_rad() const;
  bool tilt_missing() const { return tilt_missing_; }  // of the current frame, although other frames had it

  // From now on every frame is kept for smoothed(): 4 kB each.
  void keep_history() { links_.emplace(); }

  // Every kept frame given all measurements (Rauch-Tung-Striebel); without keep_history() the last one alone.
  struct Smoothed {
    PlanePoint position;
    Eigen::Matrix2d covariance_m2;
    State state;
  };
  std::vector<Smoothed> smoothed() const;

 private:
  static constexpr int kStates = FlightState::states;  // gcc 12 fails on an enumerator of `using enum` in a template
  static constexpr int kJoint = 2 * kStates;
  using JointState = Eigen::Matrix<double, kJoint, 1>;
  using JointCovariance = Eigen::Matrix<double, kJoint, kJoint>;

  using Motion8 = Eigen::Matrix<double, 8, 1>;
  using Motion8Row = Eigen::Matrix<double, 8, kJoint>;
  static constexpr int kErrors = StrapdownStep::kErrors;
  using InertialError = Eigen::Matrix<double, kErrors, 1>;
  using InertialCross = Eigen::Matrix<double, states, kErrors>;

  struct Inertial {
    Eigen::Matrix3d world_from_sensor;  // R
    InertialCalibration calibration;
    StrapdownStep::ErrorMatrix covariance;               // of e
    InertialCross cross;                                 // of the current frame's state with e
    InertialCross cross_before = InertialCross::Zero();  // of the last frame's, while both are joint
  };
  struct CalibrationPrior {
    InertialCalibration mean;
    Eigen::Matrix<double, kErrors, 1> variance;
  };

  struct Link;
  void propagate_joint(const PreintegratedMotion& motion, bool tilt_measured);
  void update_measured_heading(double measured_heading_rad);
  void update_attitude(const Eigen::Vector2d& measured_tilt_rad, double rate_rad_s);
  void move_inertial(const InertialError& error);
  void end_inertial();
  std::pair<Motion8Row, Motion8> relative_innovation(const RelativeMotionMeasurement& measurement,
                                                     const Eigen::Vector2d& m) const;
  TelemetryInterval with_silence(TelemetryInterval interval);
  void propagate_joint(const TelemetryInterval& interval, bool tilt_measured);
  void marginalize_previous();
  void reset_velocity();
  Link link() const;
  void apply_relative_motion(const RelativeMotionMeasurement& measurement, const Eigen::Vector2d& m);
  void estimate_tilt_scatter(const PoseMeasurement& measurement);
  template <int Rows>
  void update_joint(const Eigen::Matrix<double, Rows, kJoint>& row, const Eigen::Matrix<double, Rows, 1>& innovation,
                    const Eigen::Matrix<double, Rows, Rows>& noise);

  TelemetryUncertainty uncertainty_;
  bool tilt_logged_;
  Options options_;
  FlightProcessModel process_model_;
  State mean_ = State::Zero();  // of the current frame
  Covariance covariance_ = Covariance::Zero();
  bool within_interval_ = false;  // propagated since the last frame
  double silent_s_ = 0;           // of intervals that measured nothing, not propagated yet
  bool tilt_missing_ = false;
  double tilt_scatter_sum_;  // of the white tilt's variance, weighted by its information; begins with the prior
  double tilt_scatter_weight_;

  std::optional<Inertial> inertial_;
  std::optional<CalibrationPrior> calibration_prior_;           // of an earlier stretch with samples
  Eigen::Vector3d earth_rate_rad_s_ = Eigen::Vector3d::Zero();  // east, north, up
  int inertial_refused_ = 0;

  // The last frame and the current one (or a point between them), until update_absolute() or the next frame.
  std::optional<std::pair<JointState, JointCovariance>> joint_;
  struct Link {  // of a frame to the one before it
    State before, now;
    Covariance before_covariance, now_covariance, gain;
  };
  std::optional<std::vector<Link>> links_;
};

// Of a filter's state, in the map's plane.
CameraPose camera_pose(const FlightFilter::State& state, const TelemetryReference& reference);

}  // namespace nadir
