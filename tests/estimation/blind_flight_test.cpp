// Flights whose camera goes blind: an inertial sensor carries the position, and knows how far off it is.
// `./run bench blind` has more of them.
#include "estimation/blind_flight.hpp"

#include <gtest/gtest.h>

#include <Eigen/Eigenvalues>
#include <algorithm>

#include "estimation/consistency.hpp"
#include "estimation/tracking_state.hpp"
#include "vision/localizer_parameters.hpp"

namespace nadir {
namespace {

using namespace test;
using Eigen::Vector2d;

struct BlindFlights {
  std::vector<double> errors_m, sigmas_m;
  Tally nees;
  int inertial = 0;
  int contradicted = 0;

  double median_m() {
    std::ranges::sort(errors_m);
    return errors_m[errors_m.size() / 2];
  }
};

BlindFlights fly_all(int flights, const BlindOptions& options) {
  BlindFlights flown;
  for (int i = 0; i < flights; ++i) {
    const BlindEnd end = fly_blind(Random(77).fork("flight", static_cast<std::uint64_t>(i)), options);
    flown.errors_m.push_back(end.error_m);
    flown.sigmas_m.push_back(end.sigma_m);
    flown.nees.add(end.nees);
    flown.inertial += end.inertial ? 1 : 0;
    flown.contradicted += end.contradicted;
  }
  return flown;
}

TEST(BlindFlight, AMinuteInTurnsIsCarried) {
  BlindOptions options;
  options.turns = 2;
  BlindFlights with = fly_all(40, options);
  options.imu = false;
  BlindFlights without = fly_all(40, options);
  EXPECT_EQ(with.inertial, 40);
  EXPECT_LT(with.median_m(), 60);
  EXPECT_LT(with.median_m(), 0.4 * without.median_m());
  EXPECT_GT(with.nees.share_95(), 0.9) << with.nees.mean();
  EXPECT_NEAR(with.nees.mean(), 2, 0.9) << "neither over- nor underconfident";
  EXPECT_LE(with.contradicted, 3) << "of 6000 right motions";
}

TEST(BlindFlight, WorseSensorsAreNoSurprise) {
  BlindOptions options;
  options.blind_s = 30;
  options.turns = 1;
  options.figures.force_noise_mps2 = 0.02;
  options.figures.rate_noise_rad_s = 1.5e-4;
  options.figures.rate_bias_rad_s = 0.01;
  options.figures.force_bias_mps2 = 0.2;
  options.rate_hz = 40;
  options.spoil = round_as_raw_imu;
  const BlindFlights flown = fly_all(40, options);
  EXPECT_GT(flown.nees.share_95(), 0.88) << flown.nees.mean();
  EXPECT_LT(flown.nees.mean(), 2.9);
}

// While it sees, half a second of samples is lost: the sensor ends, begins anew, and the flight stays consistent.
TEST(BlindFlight, LostSamplesEndItAndItBeginsAnew) {
  BlindOptions options;
  options.blind_s = 20;
  options.turns = 1;
  options.spoil = [](int second, std::vector<InertialSample>& samples) {
    if (second == 60 || second == 115) samples.erase(samples.begin() + 20, samples.begin() + 70);
  };
  BlindFlights flown = fly_all(40, options);
  EXPECT_EQ(flown.inertial, 40);
  EXPECT_GT(flown.nees.share_95(), 0.88) << flown.nees.mean();
  options.imu = false;
  EXPECT_LT(flown.median_m(), 0.6 * fly_all(40, options).median_m());
}

// The sensor fails in the middle of the blind stretch.
TEST(BlindFlight, WithoutSamplesTheOldModelGoesOn) {
  BlindOptions options;
  options.blind_s = 30;
  options.turns = 2;
  options.spoil = [&](int second, std::vector<InertialSample>& samples) {
    if (second > options.seen_s + 10) samples.clear();
  };
  const BlindFlights flown = fly_all(40, options);
  EXPECT_EQ(flown.inertial, 0);
  EXPECT_GT(flown.nees.share_95(), 0.93) << flown.nees.mean();
}

TEST(BlindFlight, SamplesThatNobodyCanUseChangeNothing) {
  BlindOptions none, saturated;
  none.blind_s = saturated.blind_s = 10;
  none.imu = false;
  saturated.spoil = [](int, std::vector<InertialSample>& samples) {
    for (InertialSample& sample : samples) sample.rate_rad_s.x() = 34.9;
  };
  const BlindEnd a = fly_blind(Random(3), none), b = fly_blind(Random(3), saturated);
  EXPECT_EQ(a.filter.state(), b.filter.state());
  EXPECT_EQ(a.filter.covariance(), b.filter.covariance());
}

// What no gate saw before: a motion that is wrong by what the velocity's σ alone would still allow.
TEST(BlindFlight, AWrongVisualMotionIsRefused) {
  BlindOptions options;
  options.blind_s = 1;
  for (std::uint64_t seed = 0; seed < 5; ++seed) {
    BlindEnd end = fly_blind(Random(seed), options);
    FlightFilter filter = end.filter;
    FlightStep next = end.steps.back();  // the same second once more, which it did not fly
    const LinearizationPoint before = linearized_at(filter);
    propagate_to(filter, next);
    ASSERT_TRUE(filter.inertial());
    RelativeMotionMeasurement motion;
    motion.before = before;
    motion.now = linearized_at(filter);
    motion.covariance = Eigen::Matrix<double, 8, 8>::Identity() * 1e-4;
    motion.covariance.topLeftCorner<2, 2>() *= 1e4;  // a metre
    motion.value.setZero();
    motion.value.head<2>() = filter.position().vector() - end.filter.position().vector();
    EXPECT_FALSE(contradicts_inertial(filter, motion)) << filter.motion_chi2(motion);
    RelativeMotionMeasurement longer = motion, turned = motion;
    longer.value[0] += 12;
    turned.value[3] += 0.15;
    EXPECT_TRUE(contradicts_inertial(filter, longer)) << filter.motion_chi2(longer);
    EXPECT_TRUE(contradicts_inertial(filter, turned)) << filter.motion_chi2(turned);
    EXPECT_NEAR(filter.motion_innovation_m(longer), 12, 0.5);
  }
}

// One that is wired wrongly is found out, and is no longer used when it was found out too often.
TEST(BlindFlight, AWrongSensorIsContradicted) {
  BlindOptions options;
  options.blind_s = 1;
  options.spoil = [](int, std::vector<InertialSample>& samples) {
    for (InertialSample& sample : samples) {
      sample.rate_rad_s = -sample.rate_rad_s;
      sample.force_mps2.head<2>() = -sample.force_mps2.head<2>();
    }
  };
  BlindEnd end = fly_blind(Random(9), options);
  EXPECT_GT(end.largest_chi2, parameters::inertial::kMotionGate_chi2);
  FlightFilter filter = end.filter;
  for (int i = 0; i < parameters::inertial::kMaxSensorRefused; ++i) {
    const double before_m = filter.position_sigma_m();
    filter.refuse_inertial(30);
    EXPECT_FALSE(filter.inertial());
    EXPECT_GT(filter.position_sigma_m(), std::max(29.0, before_m));
    EXPECT_GT(filter.sigma(FlightFilter::velocity_east), 10);
    FlightStep next = end.steps.back();
    propagate_to(filter, next);
  }
  EXPECT_FALSE(filter.inertial()) << "it was refused too often";
}

// Blind, no direction of the position ever becomes surer, and the covariance stays one.
TEST(BlindFlight, BlindTheCovarianceOnlyGrows) {
  BlindOptions options;
  options.turns = 2;
  const BlindEnd end = fly_blind(Random(5), options);
  FlightFilter filter = end.fresh;
  for (std::size_t i = 0; i < end.steps.size(); ++i) {
    const double before_m = filter.position_sigma_m();
    apply_step(filter, end.steps[i], true);
    if (i > static_cast<std::size_t>(options.seen_s)) {
      EXPECT_GT(filter.position_sigma_m(), before_m) << i;
    }
    const Eigen::SelfAdjointEigenSolver<FlightFilter::Covariance> values(filter.covariance());
    ASSERT_GT(values.eigenvalues()[0], -1e-9) << i;
  }
}

// The anchor at the end of a blind stretch reaches back over it.
TEST(BlindFlight, SmoothingUsesTheSamples) {
  BlindOptions options;
  options.turns = 1;
  Tally nees;
  double middle_m = 0;
  constexpr int kFlights = 15;
  for (std::uint64_t seed = 0; seed < kFlights; ++seed) {
    BlindEnd end = fly_blind(Random(seed), options);
    PoseMeasurement last;
    last.covariance = Eigen::Matrix<double, 6, 6>::Identity() * 4;
    last.value.setZero();
    last.value.head<2>() = end.truth_m.back() + Vector2d(1, -1);
    end.steps.back().anchor = last;
    const auto smoothed = smooth_flight(end.fresh, end.steps).frames;
    ASSERT_EQ(smoothed.size(), end.steps.size());
    const std::size_t middle = smoothed.size() - 30;
    const Vector2d error = smoothed[middle].position.vector() - end.truth_m[middle];
    middle_m += error.norm() / kFlights;
    nees.add(normalised_error(error, smoothed[middle].covariance_m2));
  }
  EXPECT_LT(middle_m, 40);
  EXPECT_LT(nees.mean(), 4);
}

}  // namespace
}  // namespace nadir
