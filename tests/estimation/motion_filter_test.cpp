#include "estimation/motion_filter.hpp"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <cmath>

#include "base/random.hpp"

namespace nadir {
namespace {

using Eigen::Matrix2d;
using Eigen::Vector2d;

double smallest_growth(const Matrix2d& before, const Matrix2d& after) {
  return Eigen::SelfAdjointEigenSolver<Matrix2d>(after - before).eigenvalues()[0];
}

MotionFilter::Step step_of(const Vector2d& moved, double sigma_m, double heading_sigma, double scale_sigma) {
  return {moved, Matrix2d::Identity() * sigma_m * sigma_m, heading_sigma, scale_sigma};
}

Vector2d noise(Random& random, double sigma) { return {random.normal(0, sigma), random.normal(0, sigma)}; }

// Bounds for the mean of n chi-square numbers with 2 degrees of freedom, at 3.3 of its standard deviation.
void expect_nees(double mean, int trials) { EXPECT_NEAR(mean, 2, 3.3 * std::sqrt(4.0 / trials)); }

TEST(MotionFilter, BlindItOnlyGrowsLessSure) {
  MotionFilter filter({3, 4}, 10);
  filter.advance(1, step_of({20, 5}, 0.3, 0.02, 0.01));
  filter.anchor({23, 9}, Matrix2d::Identity());
  for (int i = 0; i < 400; ++i) {
    const Matrix2d before = filter.covariance_m2();
    filter.advance(i % 3 == 0 ? 0.1 : 2.0);
    EXPECT_GE(smallest_growth(before, filter.covariance_m2()), -1e-9 * before.norm()) << i;
  }
  EXPECT_TRUE(filter.covariance_m2().allFinite());
}

TEST(MotionFilter, TimeThatDoesNotAdvanceChangesNothing) {
  MotionFilter filter({3, 4}, 10);
  filter.advance(1, step_of({20, 5}, 0.3, 0.02, 0.01));
  const Matrix2d before = filter.covariance_m2();
  const Vector2d at = filter.position_m();
  filter.advance(0);
  filter.advance(-5);
  EXPECT_EQ(filter.covariance_m2(), before);
  EXPECT_EQ(filter.position_m(), at);
}

TEST(MotionFilter, CarriesOnWithItsVelocity) {
  MotionFilter filter({0, 0}, 1);
  filter.advance(2, step_of({40, -10}, 0.3, 0, 0));
  EXPECT_NEAR((filter.velocity_mps() - Vector2d(20, -5)).norm(), 0, 1e-12);
  filter.advance(3);
  EXPECT_NEAR((filter.position_m() - Vector2d(100, -25)).norm(), 0, 1e-9);
}

// The errors that all steps share grow with the distance, the random ones with its root.
TEST(MotionFilter, SharedErrorsGrowLinearly) {
  const auto sigma_after = [](int steps, double random_m, double heading, double scale) {
    MotionFilter filter({0, 0}, 0);
    for (int i = 0; i < steps; ++i) filter.advance(1, step_of({30, 0}, random_m, heading, scale));
    return filter.covariance_m2();
  };
  EXPECT_NEAR(std::sqrt(sigma_after(10, 0, 0.02, 0)(1, 1)), 300 * 0.02, 1e-9) << "heading: across";
  EXPECT_NEAR(std::sqrt(sigma_after(40, 0, 0.02, 0)(1, 1)), 1200 * 0.02, 1e-9);
  EXPECT_NEAR(std::sqrt(sigma_after(10, 0, 0, 0.03)(0, 0)), 300 * 0.03, 1e-9) << "scale: along";
  EXPECT_NEAR(sigma_after(10, 0, 0, 0.03)(1, 1), 0, 1e-12);
  EXPECT_NEAR(std::sqrt(sigma_after(40, 0.5, 0, 0)(0, 0)), std::sqrt(40.0) * 0.5, 1e-9) << "random";
}

// There and back again: a shared error cancels.
TEST(MotionFilter, ARoundTripCancelsSharedErrors) {
  MotionFilter filter({0, 0}, 1);
  for (const Vector2d& leg : {Vector2d(100, 0), Vector2d(0, 100), Vector2d(-100, 0), Vector2d(0, -100)}) {
    filter.advance(5, step_of(leg, 0, 0.05, 0.05));
  }
  EXPECT_NEAR(filter.sigma_m(), 1, 1e-9);
}

TEST(MotionFilter, AnchorsShrinkWhatIsUnsure) {
  MotionFilter filter({0, 0}, 20);
  for (int i = 0; i < 10; ++i) filter.advance(1, step_of({30, 0}, 0.5, 0.05, 0.02));
  const Matrix2d before = filter.covariance_m2();
  Matrix2d measured;
  measured << 4, 1, 1, 9;
  filter.anchor({310, 5}, measured);
  EXPECT_LT(smallest_growth(filter.covariance_m2(), before) * -1, 0);
  EXPECT_GE(smallest_growth(filter.covariance_m2(), measured), 0) << "better than the anchor alone";
  // The textbook's answer for two independent opinions.
  const Matrix2d expected = (before.inverse() + measured.inverse()).inverse();
  EXPECT_LT((filter.covariance_m2() - expected).norm(), 1e-9);
  const Vector2d position = expected * (before.inverse() * Vector2d(300, 0) + measured.inverse() * Vector2d(310, 5));
  EXPECT_LT((filter.position_m() - position).norm(), 1e-9);
}

TEST(MotionFilter, AnchorsAfterABlindStretchCorrectTheVelocity) {
  MotionFilter filter({0, 0}, 1);
  filter.advance(10);
  filter.anchor({200, -50}, Matrix2d::Identity());
  EXPECT_NEAR(filter.velocity_mps().x(), 20, 1.0);
  EXPECT_NEAR(filter.velocity_mps().y(), -5, 0.5);
}

TEST(MotionFilter, Chi2IsTheMahalanobisDistance) {
  MotionFilter filter({10, 20}, 3);
  EXPECT_NEAR(filter.chi2({13, 24}, Matrix2d::Identity() * 16), (9.0 + 16.0) / 25.0, 1e-12);
  EXPECT_NEAR(filter.chi2({10, 20}, Matrix2d::Identity()), 0, 1e-12);
  for (int i = 0; i < 10; ++i) filter.advance(1, step_of({100, 0}, 0, 0.1, 0));  // 100 m across, by heading
  EXPECT_LT(filter.chi2({1010, 120}, Matrix2d::Identity()), 1.1) << "across the track much is possible";
  EXPECT_GT(filter.chi2({1110, 20}, Matrix2d::Identity()), 500) << "along it little";
}

TEST(MotionFilter, RestartKeepsTheVelocity) {
  MotionFilter filter({0, 0}, 50);
  filter.advance(1, step_of({25, 0}, 1, 0.1, 0.1));
  filter.restart({1000, 1000}, Matrix2d::Identity() * 9);
  EXPECT_EQ(filter.position_m(), Vector2d(1000, 1000));
  EXPECT_NEAR(filter.sigma_m(), 3, 1e-12);
  EXPECT_EQ(filter.velocity_mps(), Vector2d(25, 0));
}

// Draws from the filter's own model: start, shared heading and scale error of every leg between anchors, random noise.
TEST(MotionFilter, HonestWithOdometryAndAnchors) {
  Random random(7);
  constexpr int kTrials = 400;
  const double start = 20, heading = 0.03, scale = 0.02, random_m = 0.8, anchor_m = 3;
  double before_anchor = 0, after_anchor = 0, at_end = 0;
  const auto nees = [](const MotionFilter& filter, const Vector2d& truth) {
    const Vector2d off = filter.position_m() - truth;
    return off.dot(filter.covariance_m2().inverse() * off);
  };
  for (int trial = 0; trial < kTrials; ++trial) {
    Vector2d truth = noise(random, start);
    MotionFilter filter({0, 0}, start);
    const auto fly = [&](int steps) {
      const double turn = random.normal(0, heading), stretch = random.normal(0, scale);
      for (int i = 0; i < steps; ++i) {
        const Vector2d told(25 * std::cos(0.05 * i), 25 * std::sin(0.05 * i));
        truth += (1 + stretch) * told + turn * Vector2d(-told.y(), told.x()) + noise(random, random_m);
        filter.advance(1, step_of(told, random_m, heading, scale));
      }
    };
    fly(15);
    before_anchor += nees(filter, truth) / kTrials;
    filter.anchor(truth + noise(random, anchor_m), Matrix2d::Identity() * anchor_m * anchor_m);
    after_anchor += nees(filter, truth) / kTrials;
    fly(20);
    at_end += nees(filter, truth) / kTrials;
  }
  expect_nees(before_anchor, kTrials);
  expect_nees(after_anchor, kTrials);
  expect_nees(at_end, kTrials);
}

// White acceleration noise, drawn exactly over each interval (its integrals are correlated).
TEST(MotionFilter, HonestWhenBlind) {
  Random random(8);
  constexpr int kTrials = 400;
  const MotionOptions options;
  const double start = 5, anchor_m = 4;
  double blind = 0, anchored = 0, blind_again = 0;
  for (int trial = 0; trial < kTrials; ++trial) {
    Vector2d truth = noise(random, start), velocity = noise(random, options.start_velocity_sigma_mps);
    MotionFilter filter({0, 0}, start, options);
    const auto drift = [&](double seconds) {
      const double q = options.acceleration_mps2 * options.acceleration_mps2;
      Matrix2d covariance;
      covariance << q * std::pow(seconds, 3) / 3, q * seconds * seconds / 2, q * seconds * seconds / 2, q * seconds;
      const Matrix2d root = covariance.llt().matrixL();
      truth += velocity * seconds;
      for (int axis = 0; axis < 2; ++axis) {
        const Vector2d jolt = root * noise(random, 1);
        truth[axis] += jolt[0];
        velocity[axis] += jolt[1];
      }
      filter.advance(seconds);
    };
    const auto nees = [&] {
      const Vector2d off = filter.position_m() - truth;
      return off.dot(filter.covariance_m2().inverse() * off) / kTrials;
    };
    for (int i = 0; i < 6; ++i) drift(1.5);
    blind += nees();
    filter.anchor(truth + noise(random, anchor_m), Matrix2d::Identity() * anchor_m * anchor_m);
    anchored += nees();
    for (int i = 0; i < 4; ++i) drift(2.0);
    blind_again += nees();
  }
  expect_nees(blind, kTrials);
  expect_nees(anchored, kTrials);
  expect_nees(blind_again, kTrials);
}

}  // namespace
}  // namespace nadir
