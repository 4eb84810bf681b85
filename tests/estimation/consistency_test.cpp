// NEES and NIS: over many drawn flights errors are as large as they are said to be. `./run bench consistency` has more.
#include "estimation/consistency.hpp"

#include <gtest/gtest.h>

namespace nadir {
namespace {

using namespace test;

TEST(Consistency, TheIntervalMatchesThePublishedTables) {
  const auto [low, high] = chi2_mean_interval(50);  // chi-square with 100 degrees: 74.22 to 129.56
  EXPECT_NEAR(low, 74.22 / 50, 0.005);
  EXPECT_NEAR(high, 129.56 / 50, 0.005);
}

TEST(Consistency, ErrorsMatchTheStatedSigma) {
  DrawnOptions options;
  options.frames = 80;
  const Consistency flown = measure_consistency(60, 7, options);
  EXPECT_NEAR(flown.online.mean(), 2, 0.3);
  EXPECT_NEAR(flown.smoothed.mean(), 2, 0.3);
  EXPECT_NEAR(flown.anchors.mean(), 2, 0.3);
  EXPECT_NEAR(flown.online.share_50(), 0.5, 0.07);
  EXPECT_NEAR(flown.online.share_95(), 0.95, 0.03);
  EXPECT_LT(flown.smoothed_error_m2, 0.7 * flown.online_error_m2) << "what is learnt later helps";
}

// Tilt makes a single step's measurement metres wrong; what a wrong scale does to many steps must not follow that.
TEST(Consistency, AMinuteOfOdometryAlone) {
  DrawnOptions options;
  options.anchor_every = 60;
  const Consistency flown = measure_consistency(60, 3, options);
  EXPECT_NEAR(flown.online.mean(), 2, 0.4);
  EXPECT_NEAR(flown.anchors.mean(), 2, 0.7);
  EXPECT_NEAR(flown.online.share_95(), 0.95, 0.03);
}

TEST(Consistency, StretchesWithoutImagesAreCovered) {
  for (const bool imu : {false, true}) {
    DrawnOptions options;
    options.frames = 100;
    options.blind_every = 30;
    options.imu = imu;
    const Consistency flown = measure_consistency(40, 8, options);
    EXPECT_LT(flown.blind.mean(), imu ? 2.8 : 2) << imu;
    EXPECT_GT(flown.blind.share_95(), imu ? 0.88 : 0.95) << imu;
    EXPECT_NEAR(flown.anchors.mean(), 2, 0.6) << imu;
  }
}

// Wrong anchors that passed the gates mislead online; after the flight the others overrule them.
TEST(Consistency, SmoothingOverrulesWrongAnchors) {
  DrawnOptions options;
  options.frames = 200;
  options.wrong_anchor_share = 0.05;
  const Consistency flown = measure_consistency(20, 9, options);
  EXPECT_GT(flown.smoothed.share_95(), 0.9);
  EXPECT_LT(flown.smoothed_error_m2, 0.05 * flown.online_error_m2);
}

}  // namespace
}  // namespace nadir
