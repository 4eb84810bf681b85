// How the flight filter carries position and velocity from one frame to the next: by the inertial sensors where the
// telemetry carries their change of velocity, else at a velocity that turns with the aircraft and drifts.
#pragma once

#include "estimation/flight_filter.hpp"

namespace nadir {

struct FlightPrediction {
  FlightFilter::State now;
  FlightFilter::Covariance transition = FlightFilter::Covariance::Identity();
  FlightFilter::Covariance noise = FlightFilter::Covariance::Zero();
};

// Both want the heading's rows of the prediction in place. before: the state of the last frame. dt: seconds.
// turn_known: both frames' headings are told. blind_turn_rad: turned already since the velocity was last seen.
void carry_by_velocity(FlightPrediction& prediction, const FlightFilter::State& before, double dt, bool turn_known,
                       double blind_turn_rad, const FlightFilter::Options& options);

// What is wrong with the accelerometer's change of velocity.
struct InertialDoubt {
  double white_mps = 0;  // per root second
  // An attitude that is off by a constant tilts gravity into the plane: a push that stays, for blind_s already since
  // the velocity was last seen.
  double leak_mps2 = 0;
  double blind_s = 0;
};

// dv_mps: change of velocity since the last frame, east and north as the telemetry's heading has them.
void carry_by_imu(FlightPrediction& prediction, const FlightFilter::State& before, double dt, bool turn_known,
                  const Eigen::Vector2d& dv_mps, const InertialDoubt& doubt);

// Adds to the noise of the position what keeps it from becoming surer in any direction by flying alone.
void forbid_learning_blind(FlightPrediction& prediction, const FlightFilter::Covariance& before);

}  // namespace nadir
