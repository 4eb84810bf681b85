#include "estimation/blind_flight.hpp"

#include <algorithm>
#include <cmath>

#include "estimation/tracking_state.hpp"
#include "geodesy/angles.hpp"
#include "simulation/fixed_wing.hpp"
#include "vision/localizer_parameters.hpp"

namespace nadir::test {
namespace {

using Eigen::Vector2d;
namespace model = parameters::telemetry;

constexpr double kLatitude_rad = radians(48), kStart_m = 20;
constexpr double kLateral_mps2 = 3.57;                 // a bank of 20 degrees
constexpr double kTurn_s = 9.7, kBetweenTurns_s = 27;  // 90 degrees

// Forward, right, down in east, north, up.
Eigen::Matrix3d enu_from_body(const Attitude& attitude) {
  const Eigen::Matrix3d camera = enu_from_camera(attitude);
  Eigen::Matrix3d body;
  body << -camera.col(1), camera.col(0), camera.col(2);
  return body;
}

// Wanted acceleration to the right: while it sees, a turn each 27 s, to both sides.
double lateral_mps2(double time_s, const BlindOptions& options) {
  if (time_s < options.seen_s) {
    const double in_leg_s = std::fmod(time_s, kBetweenTurns_s);
    const int leg = static_cast<int>(time_s / kBetweenTurns_s);
    const bool turning = in_leg_s > kBetweenTurns_s - kTurn_s - 2 && in_leg_s < kBetweenTurns_s - 2;
    return turning ? (leg % 3 == 2 ? -kLateral_mps2 : kLateral_mps2) : 0;
  }
  const double blind_s = time_s - options.seen_s, room_s = options.blind_s;
  const auto within = [&](double share) {
    return std::abs(blind_s - share * room_s) < std::min(kTurn_s, 0.4 * room_s) / 2;
  };
  if (options.turns == 1 && within(0.5)) return options.turn_sign * kLateral_mps2;
  if (options.turns == 2 && within(0.3)) return options.turn_sign * kLateral_mps2;
  if (options.turns == 2 && within(0.75)) return -options.turn_sign * kLateral_mps2;
  return 0;
}

BodyMotion motion_of(const FixedWing& wing, double time_s) {
  return {time_s, enu_from_body(wing.attitude()), {wing.velocity_mps().x(), wing.velocity_mps().y(), 0}};
}

}  // namespace

void round_as_raw_imu(int, std::vector<InertialSample>& samples) {
  constexpr double kRate_rad_s = 1e-3, kForce_mps2 = 9.80665e-3;
  for (InertialSample& sample : samples) {
    for (double& rate : sample.rate_rad_s) rate = std::round(rate / kRate_rad_s) * kRate_rad_s;
    for (double& force : sample.force_mps2) force = std::round(force / kForce_mps2) * kForce_mps2;
  }
}

BlindEnd fly_blind(Random random, const BlindOptions& options) {
  const TelemetryUncertainty& sigma = options.uncertainty;
  DrawnTruth is(random, sigma);
  const Vector2d wind(random.normal(0, 5), random.normal(0, 5));
  FixedWing wing({.place = PlanePoint(is.place),
                  .altitude_m = 200,
                  .heading_rad = random.uniform(-kPi, kPi),
                  .airspeed_mps = 22,
                  .wind_mps = wind},
                 random.fork("wing"));
  MemsImu imu(options.figures, kLatitude_rad, random.fork("imu"));
  Random mounting = random.fork("mount");
  const Eigen::Matrix3d camera_from_sensor =
      rotation_of(options.mount_sigma_rad * Eigen::Vector3d(mounting.normal(), mounting.normal(), mounting.normal()));
  FlightFilter filter(sigma, true, {0, 0}, kStart_m);
  filter.set_latitude(kLatitude_rad);
  is.heading = wing.attitude().heading_rad;
  BlindEnd end{.fresh = filter, .filter = filter, .steps = {}, .truth_m = {}};
  const int last = options.seen_s + options.blind_s;
  const double dt = 1.0 / static_cast<double>(options.rate_hz);
  for (int second = 0; second <= last; ++second) {
    const DrawnTruth was = is;
    std::vector<InertialSample> samples;
    if (second > 0) {
      for (std::size_t i = 0; i < options.rate_hz; ++i) {
        const double time_s = second - 1 + static_cast<double>(i) * dt;
        const BodyMotion before = motion_of(wing, time_s);
        wing.step(dt, lateral_mps2(time_s, options));
        const MeasuredRates measured = imu.measure(before, motion_of(wing, time_s + dt));
        samples.push_back(
            {measured.time_s, camera_from_sensor * measured.rate_rad_s, camera_from_sensor * measured.force_mps2});
      }
      is.drift(random, sigma, wrap_pi(wing.attitude().heading_rad - was.heading), 1);
    }
    is.place = wing.place().vector();
    is.heading = wing.attitude().heading_rad;
    is.tilt = is.tilt_bias + model::kWhiteTiltShareLogged * sigma.tilt_rad * Vector2d(random.normal(), random.normal());
    FlightStep step;
    step.seconds = second > 0 ? 1 : 0;
    step.measured_heading_rad =
        wrap_pi(is.heading - is.heading_error() - random.normal(0, model::kWhiteHeadingShare * sigma.heading_rad));
    step.reference.tilt_rad = Vector2d(wing.attitude().pitch_rad, wing.attitude().roll_rad) - is.tilt;
    if (options.spoil) options.spoil(second, samples);
    if (options.imu && second > 0) {
      step.inertial = preintegrate_parts(usable_samples(samples, second - 1), second - 1, second);
    }
    const LinearizationPoint before = linearized_at(filter);
    propagate_to(filter, step);
    if (second > 0 && second <= options.seen_s) {
      step.relative_motion = see_motion(random, before, linearized_at(filter), was, is);
      if (filter.inertial()) end.largest_chi2 = std::max(end.largest_chi2, filter.motion_chi2(*step.relative_motion));
      if (contradicts_inertial(filter, *step.relative_motion)) ++end.contradicted;
      filter.update_relative(*step.relative_motion);
      if (second % 10 == 5) {
        step.anchor = see_place(random, is, Vector2d::Zero());
        filter.update_absolute(*step.anchor);
      }
    }
    end.steps.push_back(step);
    end.truth_m.push_back(is.place);
  }
  const Vector2d error = filter.position().vector() - is.place;
  end.error_m = error.norm();
  end.sigma_m = filter.position_sigma_m();
  end.nees = normalised_error(error, filter.position_covariance_m2());
  end.velocity_error_mps = (filter.state().segment<2>(FlightFilter::velocity_east) - wing.velocity_mps()).norm();
  end.inertial = filter.inertial();
  end.filter = filter;
  return end;
}

}  // namespace nadir::test
