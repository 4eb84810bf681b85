#include "estimation/flight_smoother.hpp"

#include <gtest/gtest.h>

#include <utility>

#include "base/random.hpp"

namespace nadir {
namespace {

using Eigen::Matrix2d;
using Eigen::Vector2d;

// Straight east at 20 m/s, seen now and then to 3 m. odd: frames whose anchors are wrong, and by how much.
struct Flight {
  FlightFilter fresh{TelemetryUncertainty{}, true, {0, 0}, 10};
  std::vector<FlightStep> steps;
  std::vector<Vector2d> truth;

  explicit Flight(std::size_t frames, const std::vector<std::pair<std::size_t, Vector2d>>& odd = {}) {
    Random random(5);
    for (std::size_t i = 0; i < frames; ++i) {
      truth.emplace_back(20.0 * static_cast<double>(i), 0);
      FlightStep step;
      step.seconds = i == 0 ? 0 : 1;
      step.measured_heading_rad = 1.5708;
      if (i % 3 == 1) step.anchor = anchor(truth.back() + Vector2d(random.normal(0, 3), random.normal(0, 3)));
      for (const auto& [frame, off] : odd) {
        if (frame == i) step.anchor = anchor(truth.back() + off);
      }
      steps.push_back(step);
    }
  }

  static PoseMeasurement anchor(const Vector2d& at) {
    PoseMeasurement measurement;
    measurement.value << at, 0, 0, 0, 0;
    measurement.covariance = Eigen::Matrix<double, 6, 6>::Identity() * 1e6;
    measurement.covariance.topLeftCorner<2, 2>() = Matrix2d::Identity() * 9;
    return measurement;
  }

  double worst_m(const SmoothedFlight& smoothed) const {
    double worst = 0;
    for (std::size_t i = 0; i < truth.size(); ++i)
      worst = std::max(worst, (smoothed.frames[i].position.vector() - truth[i]).norm());
    return worst;
  }
};

TEST(FlightSmoother, AGoodFlightIsSmoothedAsTheFilterDoes) {
  const Flight flight(40);
  FlightFilter filter = flight.fresh;
  filter.keep_history();
  for (const FlightStep& step : flight.steps) {
    filter.predict(step.seconds, step.measured_heading_rad);
    if (step.anchor) filter.update_absolute(*step.anchor);
  }
  const SmoothedFlight smoothed = smooth_flight(flight.fresh, flight.steps);
  EXPECT_TRUE(smoothed.rejected_anchors.empty());
  const auto expected = filter.smoothed();
  ASSERT_EQ(smoothed.frames.size(), expected.size());
  for (std::size_t i = 0; i < expected.size(); ++i) EXPECT_EQ(smoothed.frames[i].position, expected[i].position);
}

TEST(FlightSmoother, AnchorsThatAllOthersContradictAreRejected) {
  const Flight flight(60, {{13, {0, 350}}, {40, {-80, 60}}});
  const SmoothedFlight smoothed = smooth_flight(flight.fresh, flight.steps);
  EXPECT_EQ(smoothed.rejected_anchors, (std::vector<std::size_t>{13, 40})) << "the worst one first";
  EXPECT_LT(flight.worst_m(smoothed), 10);
}

TEST(FlightSmoother, AWrongOneAtTheEndIsFoundAsWell) {
  const Flight flight(31, {{30, {120, 0}}});
  const SmoothedFlight smoothed = smooth_flight(flight.fresh, flight.steps);
  EXPECT_EQ(smoothed.rejected_anchors, (std::vector<std::size_t>{30}));
  EXPECT_LT(flight.worst_m(smoothed), 10);
}

TEST(FlightSmoother, AloneInAGapNothingContradictsIt) {
  Flight flight(5);
  for (FlightStep& step : flight.steps) {
    step.anchor.reset();
    step.seconds *= 60;
  }
  flight.steps[2].anchor = Flight::anchor({900, 300});
  EXPECT_TRUE(smooth_flight(flight.fresh, flight.steps).rejected_anchors.empty());
}

// Odometry of one step, exact to 10 cm.
RelativeMotionMeasurement motion(double east_m) {
  RelativeMotionMeasurement measurement;
  measurement.value.setZero();
  measurement.value[0] = east_m;
  measurement.covariance = Eigen::Matrix<double, 8, 8>::Identity() * 1e-2;
  measurement.before.heading_rad = measurement.now.heading_rad = 1.5708;
  return measurement;
}

// A frame that is skipped leaves nothing but its telemetry: the flight is the one without it, bit for bit.
TEST(FlightSmoother, AnOutlierIsAsIfThereHadBeenNoFrame) {
  Flight with(12);
  for (std::size_t i = 1; i < with.steps.size(); ++i) with.steps[i].relative_motion = motion(20);
  constexpr std::size_t kOutlier = 5;
  with.steps[kOutlier].relative_motion.reset();
  with.steps[kOutlier].measured_heading_rad = 1.6;
  with.steps[kOutlier].anchor.reset();
  with.steps[kOutlier + 1].relative_motion.reset();
  with.steps[kOutlier + 1].motion_over_outlier = motion(40);
  std::vector<FlightStep> without = with.steps;
  without[kOutlier + 1].seconds += without[kOutlier].seconds;
  without[kOutlier + 1].intervals = {{without[kOutlier].seconds, without[kOutlier].measured_heading_rad, std::nullopt}};
  without[kOutlier + 1].relative_motion = std::exchange(without[kOutlier + 1].motion_over_outlier, std::nullopt);
  without.erase(without.begin() + kOutlier);

  const auto found = smooth_flight(with.fresh, with.steps).frames, expected = smooth_flight(with.fresh, without).frames;
  ASSERT_EQ(found.size(), with.steps.size());
  ASSERT_EQ(expected.size(), with.steps.size() - 1);
  for (std::size_t i = 0; i < expected.size(); ++i) {
    const auto& frame = found[i < kOutlier ? i : i + 1];
    EXPECT_EQ(frame.state, expected[i].state) << i;
    EXPECT_EQ(frame.covariance_m2, expected[i].covariance_m2) << i;
  }
  EXPECT_NEAR(found[kOutlier].position.east_m, 100, 15) << "dead-reckoned";
  EXPECT_LT(with.worst_m(smooth_flight(with.fresh, with.steps)), 15);
}

TEST(FlightSmoother, AcceptsAnEmptyFlight) {
  const Flight flight(1);
  EXPECT_EQ(smooth_flight(flight.fresh, {}).frames.size(), 1U) << "the filter's own beginning";
}

}  // namespace
}  // namespace nadir
