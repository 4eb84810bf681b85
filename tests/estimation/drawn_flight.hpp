// Flights without pictures: a truth drawn at random, what telemetry, odometry and anchors would say of it, and what the
// flight filter made of that. For tests and benches of its honesty.
#pragma once

#include "base/random.hpp"
#include "estimation/flight_smoother.hpp"

namespace nadir::test {

struct DrawnOptions {
  int frames = 120;
  double interval_s = 1;
  int anchor_every = 10;
  double wrong_anchor_share = 0;  // 80 to 400 m off, as sure as the others
  int blind_every = 0;            // after so many frames (0: never) no picture is usable …
  int blind_frames = 20;          // … for so many
  bool imu = false;
  TelemetryUncertainty uncertainty = {0.05, 0.04, 0.015, 0.3};
};

struct DrawnFrame {
  Eigen::Vector2d truth_m;
  Eigen::Vector2d online_m;      // estimated by the filter in flight
  Eigen::Vector2d velocity_mps;  // the same
  Eigen::Matrix2d covariance_m2;
  double nees = 0;                    // of online_m
  std::optional<double> anchor_chi2;  // of a right anchor's place against the prediction, two degrees of freedom
  bool blind = false;
};

struct DrawnFlight {
  FlightFilter fresh;  // before the first step
  std::vector<FlightStep> steps;
  std::vector<DrawnFrame> frames;
};

DrawnFlight draw_flight(Random random, const DrawnOptions& options);

// ---- The sensors of such flights

// A camera's place and attitude, and how wrong the telemetry is of it: constant and changing errors, as the filter's
// own model has them.
struct DrawnTruth {
  DrawnTruth(Random& random, const TelemetryUncertainty& sigma);

  // So much later, after a turn.
  void drift(Random& random, const TelemetryUncertainty& sigma, double turn, double seconds);
  double heading_error() const { return heading_bias + deviation.x(); }

  double heading_bias, log_height;
  Eigen::Vector2d tilt_bias, deviation, place;  // deviation: on this course, and on that abeam
  double heading = 0;
  Eigen::Vector2d tilt = Eigen::Vector2d::Zero();  // beyond the telemetry's
};

LinearizationPoint linearized_at(const FlightFilter& filter);
RelativeMotionMeasurement see_motion(Random& random, const LinearizationPoint& before, const LinearizationPoint& now,
                                     const DrawnTruth& was, const DrawnTruth& is);
PoseMeasurement see_place(Random& random, const DrawnTruth& truth, const Eigen::Vector2d& off_m);

double normalised_error(const Eigen::Vector2d& error_m, const Eigen::Matrix2d& covariance_m2);

}  // namespace nadir::test
