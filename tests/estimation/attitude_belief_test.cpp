#include "estimation/attitude_belief.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "base/random.hpp"
#include "geodesy/angles.hpp"

namespace nadir {
namespace {

double off_deg(double a_rad, double b_rad) { return std::abs(degrees(wrap_pi(a_rad - b_rad))); }

TEST(HeadingBelief, StartsWithTheTelemetry) {
  HeadingBelief belief(radians(3));
  belief.advance(radians(120), std::nullopt);
  EXPECT_LT(off_deg(belief.heading_rad(), radians(120)), 0.01);
  EXPECT_NEAR(belief.sigma_rad(), std::hypot(radians(3), radians(1.5)), radians(0.05)) << "bias and noise";
}

TEST(HeadingBelief, UnknownHeadingIsUnsure) {
  HeadingBelief belief(radians(3));
  belief.advance(std::nullopt, std::nullopt);
  EXPECT_GT(belief.sigma_rad(), radians(90));
  belief.observe(radians(-100), radians(1));
  EXPECT_LT(off_deg(belief.heading_rad(), radians(-100)), 0.1) << "an anchor tells it";
  EXPECT_LT(belief.sigma_rad(), radians(1.1));
}

// Anchors show the compass' bias; afterwards the telemetry alone is right.
TEST(HeadingBelief, LearnsAConstantBias) {
  Random random(1);
  HeadingBelief belief(radians(4));
  double truth = radians(30);
  for (int i = 0; i < 60; ++i) {
    truth += radians(2);
    belief.advance(truth - radians(5) + random.normal(0, radians(0.5)), HeadingBelief::Turn{radians(2), radians(0.3)});
    if (i % 3 == 0) belief.observe(truth + random.normal(0, radians(0.6)), radians(0.6));
  }
  EXPECT_NEAR(degrees(belief.bias_rad()), 5, 0.6);
  const double sure = belief.sigma_rad();
  belief.advance(wrap_pi(radians(-77) - radians(5)), std::nullopt);  // odometry lost, heading elsewhere
  EXPECT_LT(off_deg(belief.heading_rad(), radians(-77)), 0.6);
  EXPECT_GT(belief.sigma_rad(), sure) << "the frame's own noise is back";
  EXPECT_LT(belief.sigma_rad(), radians(3));
}

TEST(HeadingBelief, PredictsTurnsWithoutTelemetry) {
  HeadingBelief belief(radians(2));
  belief.advance(radians(10), std::nullopt);
  const double before = belief.sigma_rad();
  for (int i = 0; i < 10; ++i) belief.advance(std::nullopt, HeadingBelief::Turn{radians(-9), radians(0.5)});
  EXPECT_LT(off_deg(belief.heading_rad(), radians(-80)), 1e-6);
  EXPECT_NEAR(belief.sigma_rad(), std::sqrt(before * before + 10 * radians(0.5) * radians(0.5)), 1e-9);
}

// A circle flown twice, told in (−180°, 180°]: no jump where the telemetry jumps.
TEST(HeadingBelief, CrossesSouthWithoutAJump) {
  HeadingBelief belief(radians(2));
  double truth = radians(150);
  belief.advance(wrap_pi(truth), std::nullopt);
  for (int i = 0; i < 72; ++i) {
    truth += radians(10);
    belief.advance(wrap_pi(truth), HeadingBelief::Turn{radians(10), radians(0.5)});
    if (i % 5 == 0) belief.observe(wrap_pi(truth), radians(0.5));
    ASSERT_LT(off_deg(belief.heading_rad(), truth), 0.01) << i;
    ASSERT_LT(off_deg(belief.bias_rad(), 0), 0.01) << i;
  }
  // From the other side, and with telemetry that counts 0 to 360 degrees.
  HeadingBelief other(radians(2));
  other.advance(radians(181), std::nullopt);
  other.advance(radians(359 - 180), HeadingBelief::Turn{radians(-2), radians(0.5)});
  other.observe(radians(-181), radians(0.5));
  EXPECT_LT(off_deg(other.heading_rad(), radians(179)), 0.01);
}

TEST(HeightBelief, LearnsAScaleAndForgetsSlowly) {
  HeightBelief belief(0.05);
  EXPECT_EQ(belief.scale(), 1);
  EXPECT_NEAR(belief.sigma(), 0.05, 1e-12);
  for (int i = 0; i < 30; ++i) {
    belief.advance();
    belief.observe(std::log(1.06), 0.01);
  }
  EXPECT_NEAR(belief.scale(), 1.06, 0.002);
  const double sure = belief.sigma();
  EXPECT_LT(sure, 0.02);
  double last = sure;
  for (int i = 0; i < 500; ++i) {
    belief.advance();
    EXPECT_GE(belief.sigma(), last);
    last = belief.sigma();
  }
  EXPECT_NEAR(last, 0.05, 1e-9) << "the terrain may be another now, but no worse than the telemetry's sigma";
}

SolvedPose sight_of(double pitch_rad, double roll_rad, double sigma_rad) {
  SolvedPose solved;
  solved.sighted_tilt_rad = {pitch_rad, roll_rad};
  solved.tilt_information_rad2 = Eigen::Matrix2d::Identity() / (sigma_rad * sigma_rad);
  return solved;
}

TEST(BoresightBelief, LearnsTheMounting) {
  Random random(2);
  BoresightBelief belief(radians(5), true);
  for (int i = 0; i < 80; ++i) {
    const Eigen::Vector2d telemetry(random.normal(0, radians(3)), random.normal(0, radians(8)));
    const double n = radians(0.8);
    belief.observe(
        sight_of(telemetry.x() + radians(6) + random.normal(0, n), telemetry.y() - radians(2) + random.normal(0, n), n),
        telemetry);
  }
  EXPECT_NEAR(degrees(belief.tilt_rad().x()), 6, 0.35);
  EXPECT_NEAR(degrees(belief.tilt_rad().y()), -2, 0.35);
  EXPECT_LT(belief.changing_sigma_rad(), radians(0.8)) << "the sights' own noise is no change";
  EXPECT_LT(std::sqrt(belief.constant_covariance_rad2()(0, 0)), radians(0.3));
}

// A bare airframe without logged attitude: every frame is tilted anew, and no number of anchors takes that away.
TEST(BoresightBelief, LearnsHowMuchChanges) {
  Random random(3);
  BoresightBelief belief(radians(5), false);
  for (int i = 0; i < 200; ++i) {
    const double n = radians(0.5), wobble = radians(4);
    belief.observe(sight_of(random.normal(radians(3), wobble) + random.normal(0, n),
                            random.normal(0, wobble) + random.normal(0, n), n),
                   Eigen::Vector2d::Zero());
  }
  EXPECT_NEAR(degrees(belief.changing_sigma_rad()), 4, 0.6);
  EXPECT_NEAR(degrees(belief.tilt_rad().x()), 3, 1.2);
  EXPECT_GE(belief.frame_covariance_rad2()(0, 0), belief.changing_sigma_rad() * belief.changing_sigma_rad());
}

TEST(BoresightBelief, VagueSightsTeachNothing) {
  BoresightBelief belief(radians(5), true);
  const Eigen::Matrix2d before = belief.frame_covariance_rad2();
  for (int i = 0; i < 50; ++i) belief.observe(sight_of(radians(60), radians(-60), radians(2000)), {0, 0});
  EXPECT_LT(belief.tilt_rad().norm(), radians(0.3));
  EXPECT_LT((belief.frame_covariance_rad2() - before).norm(), 0.1 * before.norm());
  SolvedPose blind = sight_of(0, 0, 1);
  blind.tilt_information_rad2.setZero();
  belief.observe(blind, {0, 0});
  EXPECT_TRUE(belief.frame_covariance_rad2().allFinite());
}

}  // namespace
}  // namespace nadir
