// Blind flight by the accelerometer, and without one: both must know how far off they are.
#include <gtest/gtest.h>
#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <cmath>
#include <functional>

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

constexpr double kStep_s = 0.5, kSpeed_mps = 22, kRate_rps = 0.17;  // a turn with a bank of 21 degrees

TelemetryUncertainty sensors() {
  TelemetryUncertainty uncertainty;
  uncertainty.heading_rad = radians(3);
  uncertainty.tilt_rad = radians(0.3);  // an attitude that levels well; the intervals below have another
  uncertainty.imu_dv_mps = 0.1;
  return uncertainty;
}

// One draw a statement: compilers evaluate the arguments of a call in different orders, arm64's other than amd64's.
Vector2d drawn(Random& random, double sigma) {
  const double second = random.normal(0, sigma);
  return {random.normal(0, sigma), second};
}

struct Blackout {
  std::vector<FlightStep> steps;
  std::vector<Vector2d> truth;
  std::size_t blind_from = 0;

  // Ten seconds with anchors, then 20 s blind, with a turn of 100 degrees after a third of them.
  Blackout(std::uint64_t seed, bool imu) {
    Random random(seed);
    const TelemetryUncertainty sigma = sensors();
    const double bias = random.normal(0, sigma.heading_rad);
    double heading = random.uniform(-kPi, kPi);
    const Vector2d wind = drawn(random, 2.5);
    const auto over_ground = [&]() -> Vector2d {
      return wind + kSpeed_mps * Vector2d(std::sin(heading), std::cos(heading));
    };
    Vector2d at(0, 0), velocity = over_ground();
    for (int i = 0; i <= 60; ++i) {
      const Vector2d before = velocity;
      const bool turning = i > 33 && i * kStep_s < 27;
      if (i > 0) {  // the arc in small steps, which the filter does not have
        for (int k = 0; k < 50; ++k) {
          if (turning) heading += kRate_rps * kStep_s / 50;
          velocity = over_ground();
          at += velocity * kStep_s / 50;
        }
      }
      FlightStep step;
      step.seconds = i > 0 ? kStep_s : 0;
      step.measured_heading_rad = wrap_pi(heading + bias + random.normal(0, radians(0.5)));
      Vector2d dv = velocity - before;
      dv = Vector2d(std::cos(bias) * dv.x() + std::sin(bias) * dv.y(),
                    -std::sin(bias) * dv.x() + std::cos(bias) * dv.y());
      for (double& axis : dv) axis += random.normal(0, sigma.imu_dv_mps * std::sqrt(kStep_s));
      if (imu) step.imu_dv_mps = dv;
      if (i <= 20) step.anchor = position_measurement(at + drawn(random, 3), 3);
      steps.push_back(step);
      truth.push_back(at);
    }
    blind_from = 21;
  }
};

struct End {
  double error_m, sigma_m, nees;
};

// Flies, and demands that blind the position only becomes less sure, in whatever direction.
End fly(const Blackout& flight) {
  F filter(sensors(), true, {0, 0}, 20);
  for (std::size_t i = 0; i < flight.steps.size(); ++i) {
    const FlightStep& step = flight.steps[i];
    const Matrix2d before = filter.position_covariance_m2();
    filter.predict(step.seconds, step.measured_heading_rad, step.tilt_measured, step.imu_dv_mps);
    const Matrix2d grown = filter.position_covariance_m2() - before;
    if (i >= flight.blind_from) {
      EXPECT_GE(Eigen::SelfAdjointEigenSolver<Matrix2d>(grown).eigenvalues()[0], -1e-9 * before.norm()) << i;
    }
    if (step.anchor) filter.update_absolute(*step.anchor);
  }
  const Vector2d error = filter.position().vector() - flight.truth.back();
  return {error.norm(), filter.position_sigma_m(), error.dot(filter.position_covariance_m2().inverse() * error)};
}

TEST(FlightFilterImu, PropagatesThroughABlackoutWithATurn) {
  double imu_error = 0, imu_nees = 0, velocity_error = 0, velocity_nees = 0;
  int imu_inside = 0, velocity_inside = 0;
  constexpr int kFlights = 200;
  for (std::uint64_t seed = 0; seed < kFlights; ++seed) {
    const End imu = fly(Blackout(seed, true)), velocity = fly(Blackout(seed, false));
    EXPECT_LT(imu.sigma_m, velocity.sigma_m);
    imu_error += imu.error_m / kFlights, velocity_error += velocity.error_m / kFlights;
    imu_nees += imu.nees / kFlights, velocity_nees += velocity.nees / kFlights;
    imu_inside += imu.nees < 5.991, velocity_inside += velocity.nees < 5.991;
  }
  EXPECT_LT(imu_error, 0.6 * velocity_error);
  EXPECT_GE(imu_inside, 0.9 * kFlights) << "truth within the 95 % ellipse, mean NEES " << imu_nees;
  EXPECT_GE(velocity_inside, 0.93 * kFlights) << "constant velocity, consistent, mean NEES " << velocity_nees;
  EXPECT_NEAR(imu_nees, 2, 0.8);
  RecordProperty("imu_error_m", std::to_string(imu_error));
  RecordProperty("velocity_error_m", std::to_string(velocity_error));
}

// Two whole circles: a wrong heading's share of the error comes and goes, but nobody has seen it go.
TEST(FlightFilterImu, FlyingCirclesDoesNotReduceUncertainty) {
  F filter(sensors(), true, {0, 0}, 2);
  filter.predict(0, 0.0);
  for (int i = 0; i < 10; ++i) {
    filter.predict(1, 0.0, true, Vector2d::Zero());
    filter.update_absolute(position_measurement({0, 20.0 * (i + 1)}, 2));
  }
  for (int i = 1; i <= 72; ++i) {
    const auto direction = [](int k) -> Vector2d {
      return 20 * Vector2d(std::sin(radians(10 * k)), std::cos(radians(10 * k)));
    };
    const Matrix2d before = filter.position_covariance_m2();
    filter.predict(1, wrap_pi(radians(10 * i)), true, direction(i) - direction(i - 1));
    const Matrix2d grown = filter.position_covariance_m2() - before;
    ASSERT_GE(Eigen::SelfAdjointEigenSolver<Matrix2d>(grown).eigenvalues()[0], -1e-9 * before.norm()) << i;
  }
  EXPECT_TRUE(filter.covariance().allFinite());
}

// The blind stretch between two anchors: smoothing replays the accelerometer as well.
TEST(FlightFilterImu, SmoothingReplaysIt) {
  Blackout flight(3, true);
  flight.steps.back().anchor = position_measurement(flight.truth.back(), 3);
  const F fresh(sensors(), true, {0, 0}, 20);
  const auto with = smooth_flight(fresh, flight.steps).frames;
  for (FlightStep& step : flight.steps) step.imu_dv_mps.reset();
  const auto without = smooth_flight(fresh, flight.steps).frames;
  const std::size_t middle = 40;
  EXPECT_LT((with[middle].position.vector() - flight.truth[middle]).norm(),
            3 * std::sqrt(with[middle].covariance_m2(0, 0)) + 3);
  EXPECT_LT(with[middle].covariance_m2.trace(), 0.5 * without[middle].covariance_m2.trace());
}

// With a clock that stands the change of velocity is still true, but not how far it led.
TEST(FlightFilterImu, AStoppedClockInflatesThePositionButNotTheVelocity) {
  F filter(sensors(), true, {0, 0}, 5);
  filter.predict(0, 0.0);
  for (int i = 0; i < 5; ++i) {
    filter.predict(1, 0.0, true, Vector2d::Zero());
    filter.update_absolute(position_measurement({0, 20.0 * (i + 1)}, 1));
  }
  const Vector2d at = filter.position().vector();
  filter.predict(0, 0.0, true, Vector2d(4, 0));
  EXPECT_LT((filter.position().vector() - at).norm(), 1e-9);
  EXPECT_NEAR(filter.state()[F::velocity_east], 4, 0.5);
  EXPECT_GT(filter.position_sigma_m(), 15);
}

// A long way without a frame, known from the telemetry alone: turns there and back, which the headings and the change
// of velocity at both ends know nothing of.

constexpr double kGravity_mps2 = 9.80665, kGroundSpeed_mps = 22, kTurnRate_rps = 0.17, kTick_s = 0.02;
constexpr int kSeen_s = 12, kGap_s = 33;  // anchors each second; then nothing, but for the frame at the end

TelemetryUncertainty interval_sensors() {
  TelemetryUncertainty uncertainty;
  uncertainty.heading_rad = radians(3);
  uncertainty.tilt_rad = radians(2.5);
  uncertainty.imu_dv_mps = 0.1;
  return uncertainty;
}

Vector2d turned_clockwise(const Vector2d& v, double angle) {
  return {std::cos(angle) * v.x() + std::sin(angle) * v.y(), -std::sin(angle) * v.x() + std::cos(angle) * v.y()};
}

struct Gap {
  std::vector<FlightStep> steps;
  Vector2d end{0, 0};

  // In the gap: half round to the right, on for a while, half round to the left.
  Gap(std::uint64_t seed, bool imu) {
    Random random(seed);
    const TelemetryUncertainty sigma = interval_sensors();
    const double bias = random.normal(0, sigma.heading_rad);
    const double level_rad = 0.3 * sigma.tilt_rad;
    const Vector2d lean = drawn(random, level_rad);  // forward, right
    double heading = random.uniform(-kPi, kPi);
    const Vector2d wind = drawn(random, 4);
    const auto over_ground = [&]() -> Vector2d {
      return wind + kGroundSpeed_mps * Vector2d(std::sin(heading), std::cos(heading));
    };
    Vector2d velocity = over_ground();
    const auto fly_second = [&](double rate_rps) {
      TelemetryInterval interval{1, std::nullopt, Vector2d::Zero()};
      for (int i = 0; i < std::lround(1 / kTick_s); ++i) {
        heading += rate_rps * kTick_s;
        const Vector2d before = velocity;
        velocity = over_ground();
        end += velocity * kTick_s;
        const Vector2d leak = kGravity_mps2 * kTick_s *
                              (lean.x() * Vector2d(std::sin(heading), std::cos(heading)) +
                               lean.y() * Vector2d(std::cos(heading), -std::sin(heading)));
        *interval.imu_dv_mps += turned_clockwise(velocity - before + leak, -bias);
      }
      for (double& axis : *interval.imu_dv_mps) axis += random.normal(0, sigma.imu_dv_mps);
      interval.heading_rad = wrap_pi(heading + bias + random.normal(0, radians(0.5)));
      if (!imu) interval.imu_dv_mps.reset();
      return interval;
    };
    steps.emplace_back().measured_heading_rad = wrap_pi(heading + bias);
    for (int i = 0; i < kSeen_s; ++i) {
      const TelemetryInterval interval = fly_second(0);
      FlightStep& step = steps.emplace_back();
      step.seconds = interval.seconds;
      step.measured_heading_rad = interval.heading_rad;
      step.imu_dv_mps = interval.imu_dv_mps;
      step.anchor = position_measurement(end + drawn(random, 3), 3);
    }
    const double half_s = kPi / kTurnRate_rps / 2;
    FlightStep& last = steps.emplace_back();
    last.seconds = kGap_s;
    for (int i = 0; i < kGap_s; ++i) {
      const double turn = i < half_s ? kTurnRate_rps : i >= kGap_s - half_s ? -kTurnRate_rps : 0;
      last.intervals.push_back(fly_second(turn));
    }
    last.measured_heading_rad = last.intervals.back().heading_rad;
    last.imu_dv_mps = last.intervals.back().imu_dv_mps;
    last.intervals.pop_back();
  }
};

// The same, measured only at its end.
FlightStep without_way(FlightStep step) {
  for (const TelemetryInterval& stretch : step.intervals) {
    if (step.imu_dv_mps) *step.imu_dv_mps += *stretch.imu_dv_mps;
  }
  step.intervals.clear();
  return step;
}

struct IntervalEnd {
  double error_m, nees;
};

IntervalEnd fly(
    const Gap& flight, const std::function<FlightStep(FlightStep)>& altered = [](const FlightStep& s) { return s; }) {
  F filter(interval_sensors(), true, {0, 0}, 20);
  for (const FlightStep& step : flight.steps) apply_step(filter, altered(step), true);
  const Vector2d error = filter.position().vector() - flight.end;
  return {error.norm(), error.dot(filter.position_covariance_m2().inverse() * error)};
}

class FlightFilterIntervals : public ::testing::TestWithParam<bool> {};
INSTANTIATE_TEST_SUITE_P(Sensors, FlightFilterIntervals, ::testing::Bool(),
                         [](const auto& test) { return test.param ? "Inertial" : "HeadingsAlone"; });

TEST_P(FlightFilterIntervals, OppositeTurnsArePropagated) {
  constexpr int kFlights = 200;
  double error_m = 0, ends_alone_m = 0, nees = 0;
  int inside = 0;
  for (std::uint64_t seed = 0; seed < kFlights; ++seed) {
    const Gap flight(seed, GetParam());
    const IntervalEnd end = fly(flight);
    error_m += end.error_m / kFlights, nees += end.nees / kFlights;
    inside += end.nees < 5.991;
    ends_alone_m += fly(flight, without_way).error_m / kFlights;
  }
  EXPECT_LT(error_m, 0.5 * ends_alone_m);
  EXPECT_GE(inside, 0.93 * kFlights) << "truth within the 95 % ellipse, mean NEES " << nees;
  EXPECT_GT(nees, 0.3) << "and not by knowing nothing";
  RecordProperty("error_m", std::to_string(error_m));
}

// What is thought over later sees the same way.
TEST(FlightFilterInterval, AnAnchorAtItsEndReachesBackOverIt) {
  Gap flight(5, true);
  flight.steps.back().anchor = position_measurement(flight.end, 2);
  const F fresh(interval_sensors(), true, {0, 0}, 20);
  const auto smoothed = smooth_flight(fresh, flight.steps).frames;
  ASSERT_EQ(smoothed.size(), flight.steps.size()) << "the way has no frames";
  EXPECT_LT((smoothed.back().position.vector() - flight.end).norm(), 6);
  EXPECT_LT(smoothed[kSeen_s].covariance_m2.trace(), 2 * 9);
}

// One step in two halves is that step: what the last frame is tied to is not lost on the way.
TEST(FlightFilterInterval, AnIntervalIsPartOfTheStep) {
  F whole(interval_sensors(), true, {0, 0}, 5), halves(interval_sensors(), true, {0, 0}, 5);
  for (F* filter : {&whole, &halves}) {
    filter->predict(0, 0.3);
    for (int i = 0; i < 4; ++i) {
      filter->predict(1, 0.3, true, Vector2d::Zero());
      filter->update_absolute(position_measurement({6.0 * i, 19.0 * i}, 2));
    }
  }
  whole.predict(2, 0.3, true, Vector2d(0.5, 0));
  halves.propagate({1, 0.3, Vector2d(0.25, 0)});
  halves.predict(1, 0.3, true, Vector2d(0.25, 0));
  EXPECT_LT((whole.position() - halves.position()).norm(), 0.1);
  RelativeMotionMeasurement measurement;
  measurement.value << 12, 38, 0, 0, 0, 0, 0, 0;
  measurement.covariance = Eigen::Matrix<double, 8, 8>::Identity() * 1e-4;
  whole.update_relative(measurement);
  halves.update_relative(measurement);
  EXPECT_LT((whole.position() - halves.position()).norm(), 0.3);
  EXPECT_NEAR(whole.position_sigma_m(), halves.position_sigma_m(), 0.05 * whole.position_sigma_m());
}

TEST(FlightFilterInterval, BeforeTheFirstFrameIntervalsAreIgnored) {
  F filter(interval_sensors(), true, {3, 4}, 5);
  filter.propagate({10, 0.0, Vector2d(1, 1)});
  filter.predict(0, 0.0);
  EXPECT_EQ(filter.position().vector(), Vector2d(3, 4));
}

}  // namespace
}  // namespace nadir
