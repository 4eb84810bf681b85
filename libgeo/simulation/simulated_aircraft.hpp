// An aircraft that flies laps of a circuit by its estimate of its position, from its own GPS receiver and from the
// positions that it is given. docs/commands/simulate-loop.md has what it leaves out; the tests' simulated autopilot
// (tests/support/simulated_autopilot) is another program and has more of the real ones' rules.
#pragma once

#include <cstdint>
#include <optional>

#include "simulation/circuit.hpp"
#include "simulation/fixed_wing.hpp"
#include "simulation/position_filter.hpp"

namespace nadir {

// How two sources of positions are used.
enum class PositionRule {
  given_first,   // ArduPilot, GPS_AUTO_SWITCH 4: the given one leads while it has a fix, and another leader is taken
                 // over at once
  side_by_side,  // PX4: each is let in by its own gate
};

struct GivenPosition {
  PlanePoint place;
  double sigma_m = 1;
  std::optional<Eigen::Vector2d> velocity_mps{};  // east, north
  double velocity_sigma_mps = 0.5;
};

struct OwnGps {
  PlanePoint place;
  Eigen::Vector2d velocity_mps = Eigen::Vector2d::Zero();
};

struct AircraftOptions {
  double altitude_m = 0;
  double airspeed_mps = 22;
  Eigen::Vector2d wind_mps{-2, 3};  // blowing to east, north
  PositionRule rule = PositionRule::given_first;
  std::uint64_t seed = 1;
};

class SimulatedAircraft {
 public:
  static constexpr double kStep_s = 0.02;

  SimulatedAircraft(Circuit circuit, const AircraftOptions& options);

  void step();                               // a fiftieth of a second passes
  void receive(const GivenPosition& given);  // it arrives now
  void deny_gps() { denied_ = true; }
  void move_gps(const Eigen::Vector2d& offset_m) { gps_offset_m_ = offset_m; }
  void use_gps(bool used) { gps_used_ = used; }  // PX4's EKF2_GPS_CTRL

  FixedWing::Inertial take_inertial() { return body_.take_inertial(); }
  double now_s() const { return static_cast<double>(steps_) * kStep_s; }
  const FixedWing& body() const { return body_; }
  const Circuit& circuit() const { return circuit_; }
  const PositionFilter& filter() const { return filter_; }
  const std::optional<OwnGps>& own_gps() const { return own_; }  // five times a second anew; nullopt: no fix
  bool gps_rejected() const { return gps_rejected_; }            // the last one was beyond its gate
  bool by_given_position() const;
  Attitude estimated_attitude() const;
  double estimated_altitude_m() const { return body_.altitude_m() + height_error_.value(); }
  double off_track_m();  // the true distance from the plan

 private:
  double lateral_mps2();
  void receive_own_gps();

  Random random_;
  Circuit circuit_;
  PositionRule rule_;
  FixedWing body_;
  PositionFilter filter_;
  std::int64_t steps_ = 0;
  std::optional<std::ptrdiff_t> steered_, flown_;  // nearest points of the plan: to the estimated and the true place

  bool denied_ = false, gps_used_ = true, gps_rejected_ = false;
  Eigen::Vector2d gps_offset_m_ = Eigen::Vector2d::Zero();
  std::optional<OwnGps> own_;
  std::optional<double> given_s_, given_fused_s_, own_fused_s_;
  bool given_led_ = false;

  GaussMarkovProcess gps_east_, gps_north_, accelerometer_east_, accelerometer_north_, height_error_, roll_error_,
      pitch_error_;
  double compass_error_rad_, compass_deviation_rad_, compass_course_rad_;
};

}  // namespace nadir
