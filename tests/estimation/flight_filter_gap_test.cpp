// Gaps of which only the ends are measured: photos far apart and nothing in between.
#include <gtest/gtest.h>

#include <Eigen/LU>
#include <cmath>

#include "base/random.hpp"
#include "estimation/flight_smoother.hpp"
#include "estimation/position_measurement.hpp"
#include "geodesy/angles.hpp"

namespace nadir {
namespace {

using Eigen::Matrix2d;
using Eigen::Vector2d;
using F = FlightFilter;
using test::position_measurement;

constexpr double kAirspeed_mps = 16, kGapTurn_rps = 0.35;  // bank of 30 degrees
constexpr int kLegFrames = 6;                              // a second apart, before the gap and after it

TelemetryUncertainty photo_sensors() {
  TelemetryUncertainty uncertainty;
  uncertainty.heading_rad = radians(5);
  uncertainty.tilt_rad = radians(3);
  uncertainty.agl_relative = 0.05;
  return uncertainty;
}

// What the aircraft does in the gap.
enum class Way { straight, half_circle, late_half_circle, there_and_back, circles, legs };

struct SparseFlight {
  Random random;
  Vector2d wind, at{0, 0};
  double heading;
  TelemetryUncertainty sensors = photo_sensors();
  double bias;

  explicit SparseFlight(std::uint64_t seed)
      : random(seed),
        wind(random.normal(0, 3.5), random.normal(0, 3.5)),
        heading(random.uniform(-kPi, kPi)),
        bias(random.normal(0, sensors.heading_rad)) {}

  Vector2d over_ground() const { return wind + kAirspeed_mps * Vector2d(std::sin(heading), std::cos(heading)); }
  double measured_rad() { return wrap_pi(heading - bias + random.normal(0, 0.5 * sensors.heading_rad)); }

  void fly(double seconds, double rate_rps) {
    constexpr double kTick_s = 0.05;
    for (double t = 0; t < seconds - 1e-9; t += kTick_s) {
      heading += rate_rps * kTick_s;
      at += over_ground() * kTick_s;
    }
  }

  // Headings each second as intervals, if the telemetry speaks.
  void fly_gap(Way way, double gap_s, std::vector<TelemetryInterval>& measured) {
    const double half_s = kPi / kGapTurn_rps, side = random.chance(0.5) ? 1 : -1;
    const double first_s = random.uniform(0, gap_s - 2 * half_s), leg_s = random.uniform(5, 15);
    const double second_s = random.uniform(first_s + half_s, gap_s - half_s);
    for (int i = 0; i < gap_s; ++i) {
      const auto turning = [i, half_s](double from_s) { return i >= from_s && i < from_s + half_s; };
      double rate = 0;
      if (way == Way::half_circle) rate = turning(first_s);
      if (way == Way::late_half_circle) rate = turning(gap_s - half_s);
      if (way == Way::there_and_back) rate = turning(first_s) - turning(second_s);
      if (way == Way::circles) rate = 1;
      if (way == Way::legs) rate = std::fmod(i, leg_s + half_s) > leg_s;
      fly(1, side * rate * kGapTurn_rps);
      measured.push_back({1, measured_rad(), std::nullopt});
    }
    measured.pop_back();
  }

  void fly_leg(F& filter) {
    for (int i = 0; i < kLegFrames; ++i) {
      const auto& x = filter.state();
      RelativeMotionMeasurement measurement;
      measurement.before = {x[F::log_height], x[F::heading], x[F::pitch], x[F::roll]};
      const Vector2d from = at;
      fly(1, 0);
      filter.predict(1, measured_rad());
      measurement.now = {x[F::log_height], x[F::heading], x[F::pitch], x[F::roll]};
      const double off_rad = measurement.before.heading_rad - heading;
      Matrix2d seen;
      seen << std::cos(off_rad), std::sin(off_rad), -std::sin(off_rad), std::cos(off_rad);
      measurement.value << seen * (at - from), 0, wrap_pi(measurement.before.heading_rad - measurement.now.heading_rad),
          0, 0, 0, 0;
      for (const int axis : {0, 1}) measurement.value[axis] += random.normal(0, 0.3);
      Eigen::Matrix<double, 8, 1> sigma;
      sigma << 0.3, 0.3, 0.01, 0.005, 1, 1, 1, 1;
      measurement.covariance = sigma.cwiseProduct(sigma).asDiagonal();
      filter.update_relative(measurement);
    }
  }
};

struct AfterGap {
  double nees, sigma_m, nees_later, sigma_later_m;  // at the first photo, and when the velocity is known again
};

AfterGap fly_over_gap(std::uint64_t seed, Way way, double gap_s, bool telemetry = false) {
  SparseFlight flight(seed);
  F filter(flight.sensors, true, {0, 0}, 5);
  filter.predict(0, flight.measured_rad());
  flight.fly_leg(filter);
  FlightStep step;
  step.seconds = gap_s;
  flight.fly_gap(way, gap_s, step.intervals);
  if (!telemetry) step.intervals.clear();
  step.measured_heading_rad = flight.measured_rad();
  apply_step(filter, step, true);
  const auto nees = [&] {
    const Vector2d error = filter.position().vector() - flight.at;
    return error.dot(filter.position_covariance_m2().inverse() * error);
  };
  AfterGap after{nees(), filter.position_sigma_m(), 0, 0};
  flight.fly_leg(filter);
  after.nees_later = nees();
  after.sigma_later_m = filter.position_sigma_m();
  return after;
}

// Whatever was flown in the gap, the truth is within the ellipse, and no velocity after it makes the position more
// certain than the airframe allows. The worst is an S that takes all of the gap, steeply banked all along: 89 %.
class FlightFilterGap : public ::testing::TestWithParam<double> {};
INSTANTIATE_TEST_SUITE_P(Seconds, FlightFilterGap, ::testing::Values(20.0, 40.0, 70.0));

TEST_P(FlightFilterGap, TheTruthIsWithinTheEllipse) {
  const double gap_s = GetParam();
  constexpr int kFlights = 100;
  int all = 0, all_later = 0, flights = 0;
  for (const Way way :
       {Way::straight, Way::half_circle, Way::late_half_circle, Way::there_and_back, Way::circles, Way::legs}) {
    int inside = 0, inside_later = 0;
    double nees = 0;
    for (std::uint64_t seed = 0; seed < kFlights; ++seed) {
      const AfterGap after = fly_over_gap(seed, way, gap_s);
      inside += after.nees < 5.991;
      inside_later += after.nees_later < 5.991;
      nees += after.nees_later / kFlights;
      EXPECT_GT(after.sigma_later_m, 0.25 * kAirspeed_mps * gap_s) << "no velocity shrinks it";
      EXPECT_LT(after.sigma_m, kAirspeed_mps * gap_s) << "and no aircraft flies farther";
    }
    EXPECT_GE(inside, 0.85 * kFlights) << static_cast<int>(way);
    EXPECT_GE(inside_later, 0.85 * kFlights) << static_cast<int>(way) << ", mean NEES " << nees;
    EXPECT_GT(nees, 0.3) << "and not by knowing nothing: " << static_cast<int>(way);
    all += inside, all_later += inside_later, flights += kFlights;
  }
  EXPECT_GE(all, 0.95 * flights);
  EXPECT_GE(all_later, 0.95 * flights);
}

TEST(FlightFilterSilence, HeadingsInTheGapInform) {
  double silent_m = 0, heard_m = 0;
  int inside = 0;
  constexpr int kFlights = 100;
  for (std::uint64_t seed = 0; seed < kFlights; ++seed) {
    silent_m += fly_over_gap(seed, Way::there_and_back, 40).sigma_later_m / kFlights;
    const AfterGap heard = fly_over_gap(seed, Way::there_and_back, 40, true);
    heard_m += heard.sigma_later_m / kFlights;
    inside += heard.nees < 5.991;
  }
  EXPECT_LT(heard_m, 0.5 * silent_m);
  EXPECT_GE(inside, 0.93 * kFlights);
}

F after_leg(double heading_rad) {
  F filter(photo_sensors(), true, {0, 0}, 5);
  filter.predict(0, heading_rad);
  for (int i = 1; i <= 5; ++i) {
    filter.predict(1, heading_rad);
    filter.update_absolute(position_measurement({9.6 * i, 12.8 * i}, 1));
  }
  return filter;
}

// Two seconds are no gap: nothing but the velocity's random walk is added. Beyond, the gap begins without a jump.
TEST(FlightFilterSilence, AUsualIntervalIsNoGap) {
  const F leg = after_leg(0.6);
  const auto& p = leg.covariance();
  for (const double dt : {0.3, 1.0, 2.0}) {
    F filter = leg;
    filter.predict(dt, std::nullopt);
    const double q = FlightFilterOptions{}.acceleration_mps2 * FlightFilterOptions{}.acceleration_mps2;
    for (int axis = 0; axis < 2; ++axis) {
      const int at = F::east + axis, v = F::velocity_east + axis;
      const double expected = p(at, at) + 2 * dt * p(at, v) + dt * dt * p(v, v) + q * dt * dt * dt / 3;
      EXPECT_NEAR(filter.covariance()(at, at), expected, 1e-9 * expected) << dt;
    }
  }
  for (const std::optional<double> heading_rad : {std::optional<double>(), std::optional(0.6)}) {
    F two = leg, barely_more = leg;
    two.predict(2, heading_rad);
    barely_more.predict(2 + 1e-6, heading_rad);
    EXPECT_LT((two.covariance() - barely_more.covariance()).norm(), 1e-3);
    EXPECT_LT((two.position() - barely_more.position()).norm(), 1e-3);
  }
}

// Intervals in which nothing was measured do not cut a gap into short ways.
TEST(FlightFilterSilence, SilentIntervalsAreOneGap) {
  F whole = after_leg(0.6), cut = after_leg(0.6);
  whole.predict(30, 0.6);
  for (int i = 0; i < 29; ++i) cut.propagate({1, std::nullopt, std::nullopt});
  cut.predict(1, 0.6);
  EXPECT_EQ(whole.covariance(), cut.covariance());
  EXPECT_EQ(whole.position(), cut.position());
}

// An accelerometer that begins late says nothing of the time before.
TEST(FlightFilterSilence, AnAccelerometerSpeaksForItsOwnIntervalOnly) {
  F silent = after_leg(0.6), late = after_leg(0.6), all_along = after_leg(0.6);
  silent.predict(29, std::nullopt);
  late.propagate({29, std::nullopt, std::nullopt});
  late.predict(1, 0.6, true, Vector2d::Zero());
  for (int i = 0; i < 29; ++i) all_along.propagate({1, 0.6, Vector2d::Zero()});
  all_along.predict(1, 0.6, true, Vector2d::Zero());
  EXPECT_GT(late.position_sigma_m(), silent.position_sigma_m());
  EXPECT_LT(all_along.position_sigma_m(), 0.5 * late.position_sigma_m());
}

// After the flight, anchors on both sides of the gap do not tell the way through it, but its ends.
TEST(FlightFilterSilence, AnAnchorAfterTheGapEndsIt) {
  F filter = after_leg(0.6);
  filter.predict(40, 0.6);
  const Vector2d off(150, -120);
  filter.update_absolute(position_measurement(filter.position().vector() + off, 3));
  EXPECT_LT(filter.position_sigma_m(), 3.1);
  EXPECT_LT(filter.state().segment<2>(F::velocity_east).norm(), 35) << "a detour is no speed";
}

}  // namespace
}  // namespace nadir
