// How the flight filter's state (flight_filter.hpp) changes from one moment to the next, by what the telemetry measured
// of the way and by how an aircraft flies: x' = f(x), the Jacobian F = ∂f/∂x, and the process noise Q.
//
// Over Δt, with ψ_m the measured heading, Δψ its change, R(α) a clockwise rotation; w are white, and the
// first-order Gauss-Markov processes keep their stationary variance σ² by innovations of variance σ² (1 - a²):
//
//   λ'   = a_h λ + w                           a_h² = 1 - (share of innovation)²
//   b_τ' = a_τ b_τ + w                         a_τ = exp(-Δt / T_τ)
//   τ'   = b_τ' + w_τ                          w_τ: white tilt, estimated in flight
//   (d, d⊥)' = a_d R(Δψ) (d, d⊥) + w           a_d = exp(-Δt / T_d)
//   ψ'   = ψ_m + b_ψ + d' + w_ψ                without a measured heading: ψ' = ψ + w, any heading
//   v'   = R(ψ' - ψ) v + w_a + w_wind          an aircraft keeps its airspeed; the wind does not turn with it
//   p'   = p + Δt (v + v') / 2
//
// w_a is white acceleration: variance q Δt³/3 of position, q Δt²/2 jointly, q Δt of velocity. w_wind has the variance
// σ_wind² (Δψ)², summed coherently over a blind turn. With an accelerometer's change of velocity u, in axes rotated by
// the measured heading, v' = v + R(b_ψ + d) u + w, and w also holds gravity that leaks in through an attitude error.
//
// A gap is a Δt beyond T (kCourseHeld_s) of which only the ends are measured, without an accelerometer. In the rest of
// it, u = Δt - T, the aircraft may have turned there and back. Its velocity is an Ornstein-Uhlenbeck process of the
// correlation time τ and the variance V²/2 on each axis (speed V on any course), and its integral between two known
// ends a bridge:
//
//   p'   = p + c (v + v') + w_gap              c = T/2 + τ tanh(u / 2τ)
//   var(w_gap) = V² τ² (u/τ - 2 tanh(u / 2τ))  on each axis, independent of both velocities: none shrinks it;
//        + (u/2 - τ tanh(u / 2τ))² / 3 (v + v') (v + v')ᵀ  as c is somewhere up to the straight way's Δt / 2
//   v'   = e^(-u/τ) v + w                      without a heading at both ends
//   V²   = |v|² + tr P_v + 4 σ_wind²           over ground, on other courses
//   τ    = max(π V / (g tan φ), u / x*)        x* = argmax (x - 2 tanh(x/2)) / x² = 3.21
//
// How long an aircraft keeps a course is unknown: not shorter than half a circle takes at its steepest bank φ, else τ
// is what leaves the position least known. σ of w_gap across is V u √(u / 12τ) in a short gap and 0.36 V u in a long
// one. As u → 0 this is the process model above. (Uhlenbeck and Ornstein 1930; the bridge follows by conditioning on
// both ends.)
//
// Where an inertial sensor measures velocity, position and turn, strapdown_step.hpp takes the place of the last two
// lines.
#pragma once

#include <Eigen/Core>
#include <optional>

#include "estimation/telemetry.hpp"
#include "vision/camera.hpp"
#include "vision/localizer_parameters.hpp"

namespace nadir {

struct FlightState {
  // Order of the state; units and meaning in flight_filter.hpp.
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
  using Vector = Eigen::Matrix<double, states, 1>;
  using Covariance = Eigen::Matrix<double, states, states>;
};

struct FlightPrediction {
  FlightState::Vector now;
  FlightState::Covariance transition = FlightState::Covariance::Identity();  // F
  FlightState::Covariance noise = FlightState::Covariance::Zero();           // Q
};

// Remembers what was measured at the last moment, and for how long nobody has measured the velocity.
class FlightProcessModel {
 public:
  // tilt_logged: the telemetry contains pitch and roll; otherwise the aircraft's own tilt is part of what changes.
  FlightProcessModel(const TelemetryUncertainty& uncertainty, bool tilt_logged, const FlightFilterOptions& options)
      : uncertainty_(uncertainty), tilt_logged_(tilt_logged), options_(options) {}

  // Of a state with this mean and covariance, over an interval. The first one begins the flight, and takes no time.
  // When the clock stands still or runs backwards, the time is unknown: about the usual interval, or none.
  // white_tilt_rad: σ of w_τ.
  FlightPrediction predict(const FlightState::Vector& mean, const FlightState::Covariance& covariance,
                           const TelemetryInterval& interval, double white_tilt_rad);
  // Over an interval of which an inertial sensor measured this turn: all but what the sensor adds to velocity, position
  // and heading. on_measured_heading() follows.
  FlightPrediction predict_beside_inertial(const FlightState::Vector& mean, double seconds, double turn_rad,
                                           double white_tilt_rad);
  void on_measured_heading(const std::optional<double>& heading_rad);
  void on_velocity_measured() { blind_turn_rad_ = blind_s_ = 0; }

  bool begun() const { return begun_; }

 private:
  void predict_height_and_tilt(FlightPrediction& prediction, double dt, double white_tilt_rad) const;
  // Returns the variance of its innovation.
  double predict_deviation(FlightPrediction& prediction, double turn, double dt) const;
  void predict_heading(FlightPrediction& prediction, const std::optional<double>& measured_heading_rad,
                       double dt) const;

  TelemetryUncertainty uncertainty_;
  bool tilt_logged_;
  FlightFilterOptions options_;
  bool begun_ = false;
  std::optional<double> measured_heading_rad_;       // of the current moment
  std::optional<double> last_measured_heading_rad_;  // of the last moment that has one
  double blind_turn_rad_ = 0;                        // turned since the velocity was last measured …
  double blind_s_ = 0;                               // … and flown
  double usual_seconds_ = 1;                         // between frames
};

// Error of an accelerometer's change of velocity over an interval dt, as white acceleration per root second; blind_s:
// since the velocity was last measured. A constant error of attitude tilts gravity into the plane: an acceleration that
// stays, and that has no state here. White noise that grows with time never underestimates it: after t seconds the
// position's σ is at least t²/2 times the acceleration, the velocity's 1.2 times its integral.
double imu_dv_sigma_mps(const TelemetryUncertainty& uncertainty, double blind_s, double dt);

// Closing a loop cancels the effect of a wrong heading, and so does the algebra. But the loop is predicted, not
// observed: flying alone must never make the position more certain in any direction. By so much it would, as a
// variance; 0: not.
double blind_certainty_m2(const FlightState::Covariance& before, const FlightState::Covariance& after);

}  // namespace nadir
