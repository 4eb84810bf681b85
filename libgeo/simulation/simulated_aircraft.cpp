#include "simulation/simulated_aircraft.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include "geodesy/angles.hpp"

namespace nadir {
namespace {

constexpr double kLookAhead_s = 3.6;     // at the ground speed: the steering's aim
constexpr double kFresh_s = 1;           // a source that has been let in since then leads
constexpr double kGivenTimeout_s = 0.5;  // of silence: the own receiver leads again
constexpr double kGate = 5, kResetAfter_s = 7;
constexpr double kLeastGivenSigma_m = 1, kOwnSigma_m = 1.2, kOwnVelocitySigma_mps = 0.3;
constexpr std::int64_t kOwnGpsSteps = 10, kAirspeedSteps = 10;

bool within(const std::optional<double>& since_s, double now_s, double seconds) {
  return since_s && now_s - *since_s < seconds;
}

FixedWingStart start_of(const Circuit& circuit, const AircraftOptions& options) {
  return {circuit.point(0), options.altitude_m, circuit.heading_rad(0), options.airspeed_mps, options.wind_mps};
}

}  // namespace

SimulatedAircraft::SimulatedAircraft(Circuit circuit, const AircraftOptions& options)
    : random_(Random(options.seed).fork("aircraft")),
      circuit_(std::move(circuit)),
      rule_(options.rule),
      body_(start_of(circuit_, options), Random(options.seed).fork("body")),
      filter_(body_.place(), body_.velocity_mps()),
      gps_east_(random_, 0.9, 60),
      gps_north_(random_, 0.9, 60),
      accelerometer_east_(random_, 0.06, 120),
      accelerometer_north_(random_, 0.06, 120),
      height_error_(random_, 1, 120),
      roll_error_(random_, radians(0.35), 60),
      pitch_error_(random_, radians(0.35), 60),
      compass_error_rad_(random_.normal(0, radians(1.2))),
      compass_deviation_rad_(radians(2)),
      compass_course_rad_(random_.uniform(-kPi, kPi)) {}

bool SimulatedAircraft::by_given_position() const {
  const bool given = within(given_fused_s_, now_s(), kFresh_s);
  return given && (rule_ == PositionRule::given_first || !within(own_fused_s_, now_s(), kFresh_s));
}

Attitude SimulatedAircraft::estimated_attitude() const {
  const Attitude& t = body_.attitude();
  const double compass = compass_error_rad_ + compass_deviation_rad_ * std::cos(t.heading_rad - compass_course_rad_);
  return {wrap_pi(t.heading_rad + compass), t.pitch_rad + pitch_error_.value(), t.roll_rad + roll_error_.value()};
}

double SimulatedAircraft::off_track_m() {
  flown_ = circuit_.nearest(body_.place(), flown_);
  return circuit_.off_track_m(body_.place(), *flown_);
}

// Pursuit of a point ahead (Park, Deyst, How 2004), from the estimated position.
double SimulatedAircraft::lateral_mps2() {
  const PlanePoint here = filter_.place();
  steered_ = circuit_.nearest(here, steered_);
  const Eigen::Vector2d& velocity = filter_.velocity_mps();
  const double speed = std::max(5.0, velocity.norm()), ahead_m = speed * kLookAhead_s;
  const Eigen::Vector2d to_target =
      circuit_.point(*steered_ + std::lround(ahead_m / Circuit::kSpacing_m)).vector() - here.vector();
  const double error = wrap_pi(std::atan2(to_target.x(), to_target.y()) - std::atan2(velocity.x(), velocity.y()));
  const double distance_m = std::max(ahead_m / 3, to_target.norm());
  return 2 * speed * speed / distance_m * std::sin(std::clamp(error, -kPi / 2, kPi / 2));
}

void SimulatedAircraft::step() {
  ++steps_;
  body_.step(kStep_s, lateral_mps2());
  const double error_north = accelerometer_north_.step(kStep_s, random_);
  const Eigen::Vector2d error(accelerometer_east_.step(kStep_s, random_), error_north);
  for (GaussMarkovProcess* process : {&height_error_, &roll_error_, &pitch_error_}) process->step(kStep_s, random_);
  filter_.predict(kStep_s, body_.acceleration_mps2() + error);
  if (steps_ % kAirspeedSteps == 0) {
    const bool aided = within(given_fused_s_, now_s(), kFresh_s) || within(own_fused_s_, now_s(), kFresh_s);
    filter_.hold_airspeed(body_.air_velocity_mps(), aided);
  }
  if (steps_ % kOwnGpsSteps == 0) receive_own_gps();
}

void SimulatedAircraft::receive_own_gps() {
  constexpr double kPeriod_s = static_cast<double>(kOwnGpsSteps) * kStep_s;
  const double drift_north = gps_north_.step(kPeriod_s, random_);
  const Eigen::Vector2d drift(gps_east_.step(kPeriod_s, random_), drift_north);
  const double white_north = random_.normal(0, 0.2);
  const Eigen::Vector2d white(random_.normal(0, 0.2), white_north);
  own_.reset();
  if (denied_) return;
  own_ = OwnGps{body_.place() + (gps_offset_m_ + drift + white), body_.velocity_mps() + white / 4};
  const bool given_leads = within(given_s_, now_s(), kGivenTimeout_s);
  if (!gps_used_ || (rule_ == PositionRule::given_first && given_leads)) return;
  if (rule_ == PositionRule::given_first && given_led_) filter_.reset(own_->place, kOwnSigma_m);
  given_led_ = false;
  gps_rejected_ = !filter_.fuse(own_->place, kOwnSigma_m, kGate);
  if (gps_rejected_ && (within(own_fused_s_, now_s(), kResetAfter_s) || within(given_fused_s_, now_s(), kResetAfter_s)))
    return;
  if (gps_rejected_) filter_.reset(own_->place, kOwnSigma_m);
  filter_.fuse_velocity(own_->velocity_mps, kOwnVelocitySigma_mps);
  own_fused_s_ = now_s();
}

void SimulatedAircraft::receive(const GivenPosition& given) {
  const double sigma_m = std::max(kLeastGivenSigma_m, given.sigma_m);
  given_s_ = now_s();
  if (rule_ == PositionRule::given_first && !given_led_) filter_.reset(given.place, sigma_m);
  given_led_ = true;
  if (!filter_.fuse(given.place, sigma_m, kGate)) {
    if (within(given_fused_s_, now_s(), kResetAfter_s) || within(own_fused_s_, now_s(), kResetAfter_s)) return;
    filter_.reset(given.place, sigma_m);
  }
  if (given.velocity_mps) filter_.fuse_velocity(*given.velocity_mps, given.velocity_sigma_mps);
  given_fused_s_ = now_s();
}

}  // namespace nadir
