#include "estimation/two_view_motion.hpp"

#include <gtest/gtest.h>

#include <Eigen/LU>
#include <cmath>

#include "base/random.hpp"
#include "geodesy/angles.hpp"

namespace nadir {
namespace {

struct Scene {
  CameraPose before{{0, 0}, 100, {radians(80), radians(4), radians(-3)}};
  CameraPose now{{38, 11}, 103, {radians(98), radians(-2), radians(7)}};
  Eigen::Vector2d slope = Eigen::Vector2d::Zero();  // of the ground; heights are above it, under each camera
};

// Rays by rotation and projection of random ground points between the two cameras; `noise` on the ray of the second.
std::vector<RayPair> pairs_of(const Scene& scene, int count, Random& random, double noise = 0) {
  std::vector<RayPair> pairs;
  while (static_cast<int>(pairs.size()) < count) {
    const PlanePoint ground{random.uniform(-20, 60), random.uniform(-50, 60)};
    const auto ray = [&](const CameraPose& pose) {
      const Eigen::Vector2d away(ground.east_m - pose.position.east_m, ground.north_m - pose.position.north_m);
      const Eigen::Vector3d to(away.x(), away.y(), scene.slope.dot(away) - pose.agl_m);
      const Eigen::Vector3d point = enu_from_camera(pose.attitude).transpose() * to;
      return Eigen::Vector3d(point / point.z());
    };
    Eigen::Vector3d after = ray(scene.now);
    after.x() += random.normal(0, noise);
    after.y() += random.normal(0, noise);
    pairs.push_back({ray(scene.before), after});
  }
  return pairs;
}

TwoViewPrior prior_of(const Scene& scene) {
  TwoViewPrior prior;
  prior.before = scene.before;
  prior.now = scene.now;
  prior.before.position = {500, 500};  // ignored
  prior.now.position = {-500, 0};
  return prior;
}

Eigen::Vector2d moved(const Scene& scene) {
  return {scene.now.position.east_m - scene.before.position.east_m,
          scene.now.position.north_m - scene.before.position.north_m};
}

TEST(TwoViewMotion, ExactRaysGiveTheMotion) {
  const Scene scene;
  Random random(1);
  const auto motion = solve_two_view_motion(pairs_of(scene, 60, random), prior_of(scene));
  ASSERT_TRUE(motion);
  EXPECT_LT((motion->displacement_m - moved(scene)).norm(), 1e-3);
  EXPECT_NEAR(motion->turn_rad, radians(18), 1e-6);
  EXPECT_EQ(motion->inliers, 60);
}

// Heading and height of the telemetry are off; tilt is known: the pictures correct both.
TEST(TwoViewMotion, CorrectsHeadingAndHeight) {
  const Scene scene;
  Random random(2);
  TwoViewPrior prior = prior_of(scene);
  prior.now.attitude.heading_rad += radians(5);
  prior.now.agl_m *= 1.03;
  prior.heading_sigma_rad = 1;
  prior.log_height_sigma = 1;
  prior.tilt_covariance_rad2 = Eigen::Matrix4d::Identity() * 1e-8;
  const auto motion = solve_two_view_motion(pairs_of(scene, 60, random), prior);
  ASSERT_TRUE(motion);
  EXPECT_LT((motion->displacement_m - moved(scene)).norm(), 0.01);
  EXPECT_NEAR(motion->turn_rad, radians(18), radians(0.02));
}

// The height is common to both: a wrong one scales the motion, and that is the caller's to know.
TEST(TwoViewMotion, ScalesWithTheHeight) {
  const Scene scene;
  Random random(3);
  TwoViewPrior prior = prior_of(scene);
  prior.before.agl_m *= 1.1;
  prior.now.agl_m *= 1.1;
  const auto motion = solve_two_view_motion(pairs_of(scene, 60, random), prior);
  ASSERT_TRUE(motion);
  EXPECT_LT((motion->displacement_m - 1.1 * moved(scene)).norm(), 0.01);
}

// Pictures that the telemetry turns the other way round show so: their own motion, and by how much they are turned.
TEST(TwoViewMotion, ATurnThatTheTelemetryContradictsIsReportedAsItIs) {
  for (const double lie_deg : {-150.0, 40.0, 90.0, 180.0}) {
    const Scene scene;
    Random random(6);
    TwoViewPrior prior = prior_of(scene);
    prior.now.attitude.heading_rad += radians(lie_deg);
    prior.tilt_covariance_rad2 = Eigen::Matrix4d::Identity() * 1e-8;
    const auto motion = solve_two_view_motion(pairs_of(scene, 60, random), prior);
    ASSERT_TRUE(motion) << lie_deg;
    EXPECT_LT((motion->displacement_m - moved(scene)).norm(), 0.5) << lie_deg;
    EXPECT_NEAR(wrap_pi(motion->turn_rad - radians(18)), 0, radians(0.5)) << lie_deg;
    EXPECT_NEAR(std::abs(wrap_pi(motion->solved[3])), radians(std::abs(lie_deg)), radians(0.5)) << lie_deg;
  }
}

// Every point moved in another direction: least squares has a solution, but it describes no motion.
TEST(TwoViewMotion, PairsThatFitNoMotionAreRejected) {
  const Scene scene;
  Random random(7);
  auto pairs = pairs_of(scene, 60, random);
  for (RayPair& pair : pairs) {
    pair.ray_now.x() = random.uniform(-0.6, 0.6);
    pair.ray_now.y() = random.uniform(-0.6, 0.6);
  }
  EXPECT_FALSE(solve_two_view_motion(pairs, prior_of(scene)));
}

TEST(TwoViewMotion, IgnoresOutliers) {
  const Scene scene;
  Random random(4);
  auto pairs = pairs_of(scene, 100, random, 0.001);
  for (std::size_t i = 0; i < pairs.size(); i += 3) {
    pairs[i].ray_now.x() += random.uniform(0.1, 0.4) * (random.chance(0.5) ? 1 : -1);
    pairs[i].ray_now.y() += random.uniform(-0.4, 0.4);
  }
  TwoViewPrior prior = prior_of(scene);
  prior.tilt_covariance_rad2 = Eigen::Matrix4d::Identity() * 1e-6;
  const auto motion = solve_two_view_motion(pairs, prior);
  ASSERT_TRUE(motion);
  EXPECT_LT((motion->displacement_m - moved(scene)).norm(), 0.01 * moved(scene).norm());
  EXPECT_LE(motion->inliers, 70);
  EXPECT_GE(motion->inliers, 60);
}

// Its covariance is meant to be careful (neighbouring features err alike): errors as large as it says at most.
TEST(TwoViewMotion, CovarianceIsConsistent) {
  Random random(5);
  constexpr int kTrials = 200;
  double nees = 0;
  const double tilt_sigma = 0.01, heading_sigma = 0.05, height_sigma = 0.02;
  for (int trial = 0; trial < kTrials; ++trial) {
    Scene scene;
    TwoViewPrior prior = prior_of(scene);
    prior.heading_sigma_rad = heading_sigma;
    prior.log_height_sigma = height_sigma;
    prior.tilt_covariance_rad2 = Eigen::Matrix4d::Identity() * tilt_sigma * tilt_sigma;
    for (CameraPose* pose : {&scene.before, &scene.now}) {
      pose->attitude.pitch_rad += random.normal(0, tilt_sigma);
      pose->attitude.roll_rad += random.normal(0, tilt_sigma);
    }
    scene.now.attitude.heading_rad += random.normal(0, heading_sigma);
    scene.now.agl_m *= std::exp(random.normal(0, height_sigma));
    const auto motion = solve_two_view_motion(pairs_of(scene, 80, random, 0.0015), prior);
    ASSERT_TRUE(motion);
    const Eigen::Vector2d off = motion->displacement_m - moved(scene);
    nees += off.dot(motion->covariance_m2.inverse() * off) / kTrials;
  }
  EXPECT_LT(nees, 2 + 3.3 * std::sqrt(4.0 / kTrials));
  EXPECT_GT(nees, 0.3) << "careful, but not useless";
}

// A hillside is no tilt, when it is known to be one.
TEST(TwoViewMotion, EstimatesTheSlopeOfTheGround) {
  Scene scene;
  scene.slope = {0.15, -0.1};
  Random random(7);
  const auto pairs = pairs_of(scene, 80, random);
  TwoViewPrior prior = prior_of(scene);
  prior.ground_slope = scene.slope;
  const auto motion = solve_two_view_motion(pairs, prior);
  ASSERT_TRUE(motion);
  EXPECT_LT((motion->displacement_m - moved(scene)).norm(), 1e-3);
  prior.ground_slope.setZero();
  const auto level = solve_two_view_motion(pairs, prior);
  ASSERT_TRUE(level);
  EXPECT_GT((level->displacement_m - moved(scene)).norm(), 0.5);
}

// With the priors taken away, however wrong they were, the pairs say what they always said.
TEST(TwoViewMotion, TheImagesInformationHoldsNoPriors) {
  const Scene scene;
  Random random(8);
  const auto pairs = pairs_of(scene, 200, random, 0.0005);
  TwoViewPrior prior = prior_of(scene);
  prior.tilt_covariance_rad2 = Eigen::Matrix4d::Identity() * 1e-4;
  prior.now.attitude.heading_rad += radians(2);
  prior.before.attitude.pitch_rad += radians(1);
  const auto motion = solve_two_view_motion(pairs, prior);
  ASSERT_TRUE(motion);
  // Strong opinions of the truth, as the flight filter would have them, instead of the wrong priors.
  Eigen::Matrix<double, 8, 8> information = motion->measurement_information;
  Eigen::Matrix<double, 8, 1> right = motion->measurement_information * motion->solved + motion->measurement_gradient;
  information.bottomRightCorner<4, 4>() += Eigen::Matrix4d::Identity() * 1e8;
  right[4] += 1e8 * radians(-1);
  const Eigen::Matrix<double, 8, 1> combined = information.inverse() * right;
  EXPECT_LT((combined.head<2>() - moved(scene)).norm(), 0.1);
  EXPECT_NEAR(combined[3], radians(-2), radians(0.1));
}

TEST(TwoViewMotion, NeedsEnough) {
  const Scene scene;
  Random random(6);
  EXPECT_FALSE(solve_two_view_motion({}, prior_of(scene)));
  EXPECT_FALSE(solve_two_view_motion(pairs_of(scene, 5, random), prior_of(scene)));
  auto pairs = pairs_of(scene, 20, random);
  pairs[3].ray_now = {1, 0, 0};  // sees no ground
  EXPECT_FALSE(solve_two_view_motion(pairs, prior_of(scene)));
}

}  // namespace
}  // namespace nadir
