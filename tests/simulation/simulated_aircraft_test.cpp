#include "simulation/simulated_aircraft.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "base/error.hpp"

namespace nadir {
namespace {

const std::vector<PlanePoint> kSquare{{0, 0}, {0, 1000}, {1000, 1000}, {1000, 0}};

TEST(Circuit, RoundsItsCorners) {
  const Circuit circuit(kSquare, 100);
  // Each corner's arc of a quarter replaces two legs of its radius.
  EXPECT_NEAR(circuit.length_m(), 4000 - 8 * 100 + 2 * std::acos(-1) * 100, 5);
  EXPECT_DOUBLE_EQ(circuit.tightest_turn_m(), 100);
  double nearest_to_corner_m = 1e9;
  for (int i = 0; i < 1000; ++i)
    nearest_to_corner_m = std::min(nearest_to_corner_m, distance_m(circuit.point(i), {0, 0}));
  EXPECT_NEAR(nearest_to_corner_m, 100 * (std::sqrt(2) - 1), 1);
}

TEST(Circuit, ShortLegsHaveTighterTurns) { EXPECT_NEAR(Circuit(kSquare, 700).tightest_turn_m(), 490, 1); }

TEST(Circuit, MeasuresTheDistanceFromTheTrack) {
  const Circuit circuit(kSquare, 100);
  const std::ptrdiff_t index = circuit.nearest({-30, 500}, std::nullopt);
  EXPECT_NEAR(circuit.off_track_m({-30, 500}, index), 30, 0.1);
  EXPECT_EQ(circuit.nearest({-30, 500}, index), index);
  const std::ptrdiff_t far = circuit.nearest({1020, 500}, index);  // it is not near there any more
  EXPECT_NEAR(circuit.off_track_m({1020, 500}, far), 20, 0.1);
}

TEST(Circuit, RejectsWhatIsNoCircuit) {
  EXPECT_THROW(Circuit(std::vector<PlanePoint>{{0, 0}, {9, 9}}, 100), UsageError);
  EXPECT_THROW(Circuit(std::vector<PlanePoint>{{0, 0}, {0, 0}, {9, 9}}, 100), UsageError);
}

class SimulatedAircraftTest : public ::testing::TestWithParam<PositionRule> {
 protected:
  static SimulatedAircraft aircraft(PositionRule rule, std::uint64_t seed = 1) {
    AircraftOptions options;
    options.rule = rule;
    options.seed = seed;
    return {Circuit(kSquare, 130), options};
  }

  // The truth, moved by so much, ten times a second; the largest distance from the plan in that time.
  static double fly(SimulatedAircraft& flown, double seconds, std::optional<Eigen::Vector2d> given_off_m = {}) {
    double worst_m = 0;
    for (const double end_s = flown.now_s() + seconds; flown.now_s() < end_s;) {
      flown.step();
      const bool due = std::fmod(flown.now_s() + 1e-6, 0.1) < SimulatedAircraft::kStep_s / 2;
      if (given_off_m && due) flown.receive({.place = flown.body().place() + *given_off_m, .sigma_m = 3});
      worst_m = std::max(worst_m, flown.off_track_m());
    }
    return worst_m;
  }
};

TEST_P(SimulatedAircraftTest, FliesItsPlanByItsOwnGps) {
  SimulatedAircraft flown = aircraft(GetParam());
  EXPECT_LT(fly(flown, 300), 15);
  EXPECT_FALSE(flown.by_given_position());
}

TEST_P(SimulatedAircraftTest, FliesItsPlanByGivenPositionsWithoutGps) {
  SimulatedAircraft flown = aircraft(GetParam());
  flown.deny_gps();
  EXPECT_LT(fly(flown, 300, Eigen::Vector2d::Zero()), 15);
  EXPECT_TRUE(flown.by_given_position());
  EXPECT_FALSE(flown.own_gps());
}

TEST_P(SimulatedAircraftTest, AWrongPositionMovesIt) {
  SimulatedAircraft flown = aircraft(GetParam());
  fly(flown, 5);
  flown.deny_gps();
  fly(flown, 20, Eigen::Vector2d(60, 0));  // beyond the gate first
  EXPECT_GT(fly(flown, 60, Eigen::Vector2d(60, 0)), 45);
}

TEST_P(SimulatedAircraftTest, WithoutAnyPositionItDriftsOff) {
  SimulatedAircraft flown = aircraft(GetParam());
  fly(flown, 30);
  flown.deny_gps();
  const double before_m = flown.filter().sigma_m();
  fly(flown, 60);
  EXPECT_GT(flown.filter().sigma_m(), 10 * before_m);
  EXPECT_GT(distance_m(flown.filter().place(), flown.body().place()), 3);
}

TEST_P(SimulatedAircraftTest, TheSameSeedFliesTheSame) {
  SimulatedAircraft a = aircraft(GetParam(), 7), b = aircraft(GetParam(), 7), other = aircraft(GetParam(), 8);
  for (SimulatedAircraft* flown : {&a, &b, &other}) fly(*flown, 30);
  EXPECT_EQ(a.body().place(), b.body().place());
  EXPECT_NE(a.body().place(), other.body().place());
}

INSTANTIATE_TEST_SUITE_P(Rules, SimulatedAircraftTest,
                         ::testing::Values(PositionRule::given_first, PositionRule::side_by_side));

// A GPS that jumps by 300 m: ArduPilot does not ask it while ours has a fix, PX4 rejects it while ours is let in.
TEST(SimulatedAircraft, AJumpOfGpsDoesNotMoveIt) {
  for (const PositionRule rule : {PositionRule::given_first, PositionRule::side_by_side}) {
    AircraftOptions options;
    options.rule = rule;
    SimulatedAircraft flown(Circuit(kSquare, 130), options);
    double worst_m = 0;
    for (int step = 0; step < 6000; ++step) {
      flown.step();
      if (step == 1500) flown.move_gps({300, 0});
      if (step % 5 == 0) flown.receive({.place = flown.body().place(), .sigma_m = 3});
      worst_m = std::max(worst_m, flown.off_track_m());
    }
    EXPECT_LT(worst_m, 15);
    EXPECT_TRUE(flown.by_given_position());
    EXPECT_EQ(flown.gps_rejected(), rule == PositionRule::side_by_side);
  }
}

// PX4's EKF2_GPS_CTRL 0.
TEST(SimulatedAircraft, GpsThatIsNotUsedIsReportedAndNotBelieved) {
  AircraftOptions options;
  options.rule = PositionRule::side_by_side;
  SimulatedAircraft flown(Circuit(kSquare, 130), options);
  flown.use_gps(false);
  for (int step = 0; step < 200; ++step) {
    flown.step();
    if (step % 5 == 0) flown.receive({.place = flown.body().place(), .sigma_m = 3});
  }
  EXPECT_TRUE(flown.own_gps());
  EXPECT_TRUE(flown.by_given_position());
}

}  // namespace
}  // namespace nadir
