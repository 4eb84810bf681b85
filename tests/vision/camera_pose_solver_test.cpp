#include "vision/camera_pose_solver.hpp"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <cmath>

#include "base/random.hpp"
#include "geodesy/angles.hpp"
#include "vision/synthetic_ground.hpp"

namespace nadir {
namespace {

using Vector6 = Eigen::Matrix<double, 6, 1>;
using Vector8 = Eigen::Matrix<double, 8, 1>;
using Matrix8 = Eigen::Matrix<double, 8, 8>;

// A camera whose pixels are its rays: the independent ray caster then answers for rays.
CameraModel ray_camera() {
  CameraModel camera;
  camera.fx = camera.fy = 1;
  return camera;
}

using Slope = Eigen::Vector2d;  // rise of the ground to the east and to the north

// The ground at `height_m` above the camera's foot point, rising from there.
PlanePoint hit_of(const CameraPose& pose, const Eigen::Vector3d& ray, const Slope& slope = Slope::Zero(),
                  double height_m = 0) {
  const PlanePoint flat = test::seen_by_pixel(ray_camera(), pose, ray.x(), ray.y());
  const Eigen::Vector2d run((flat.east_m - pose.position.east_m) / pose.agl_m,
                            (flat.north_m - pose.position.north_m) / pose.agl_m);
  const Eigen::Vector2d out = (pose.agl_m - height_m) / (1 + slope.dot(run)) * run;
  return {pose.position.east_m + out.x(), pose.position.north_m + out.y()};
}

// Rays over a image of 64 x 48 degrees, and what they hit.
std::vector<GroundCorrespondence> sights_from(const CameraPose& pose, double sigma_m, int columns = 9, int rows = 6,
                                              const Slope& slope = Slope::Zero()) {
  std::vector<GroundCorrespondence> correspondences;
  for (int j = 0; j < rows; ++j) {
    for (int i = 0; i < columns; ++i) {
      const Eigen::Vector3d ray(0.625 * (2.0 * i / (columns - 1) - 1), 0.445 * (2.0 * j / (rows - 1) - 1), 1);
      correspondences.push_back({ray, hit_of(pose, ray, slope), Eigen::Matrix2d::Identity() / (sigma_m * sigma_m)});
    }
  }
  return correspondences;
}

const CameraPose kTruth{{120, -340}, 110, {radians(160), radians(6), radians(-9)}};

double off_m(const CameraPose& a, const CameraPose& b) { return distance_m(a.position, b.position); }

constexpr double kLevel = 1e-5;  // slope: known to be none

PosePrior tight_prior() {
  PosePrior prior;
  prior.pose = kTruth;
  prior.pose.position = {90, -360};
  prior.pose.agl_m = 104;
  prior.pose.attitude.heading_rad += radians(4);
  prior.tilt_covariance_rad2 = Eigen::Matrix2d::Identity() * 1e-8;
  prior.slope_sigma = kLevel;
  return prior;
}

TEST(CameraPoseSolver, ExactCorrespondencesGiveThePose) {
  const auto solved = solve_camera_pose(sights_from(kTruth, 0.3), tight_prior(), {2.0, 0.1});
  ASSERT_TRUE(solved);
  EXPECT_LT(off_m(solved->pose, kTruth), 0.01);
  EXPECT_NEAR(solved->pose.agl_m, kTruth.agl_m, 0.02);
  EXPECT_NEAR(solved->pose.attitude.heading_rad, kTruth.attitude.heading_rad, 1e-4);
  EXPECT_EQ(solved->inliers, 54);
  EXPECT_LT(solved->rms_m, 0.02);
}

// With an idle prior the perspective alone tells tilt and position apart.
TEST(CameraPoseSolver, ExactCorrespondencesOvercomeAWrongTilt) {
  PosePrior prior = tight_prior();
  prior.pose.attitude.pitch_rad += radians(3);
  prior.pose.attitude.roll_rad -= radians(2);
  prior.tilt_covariance_rad2 = Eigen::Matrix2d::Identity() * 1.0;
  prior.log_agl_sigma = 1;
  prior.heading_sigma_rad = 1;
  const auto solved = solve_camera_pose(sights_from(kTruth, 0.05), prior, {2.0, 0.01});
  ASSERT_TRUE(solved);
  EXPECT_LT(off_m(solved->pose, kTruth), 0.05);
  EXPECT_NEAR(solved->pose.attitude.pitch_rad, kTruth.attitude.pitch_rad, radians(0.02));
}

TEST(CameraPoseSolver, IgnoresFortyPercentOutliers) {
  Random random(4);
  for (int trial = 0; trial < 20; ++trial) {
    auto correspondences = sights_from(kTruth, 0.3);
    std::vector<bool> good(correspondences.size(), true);
    for (std::size_t i = 0; i < correspondences.size(); ++i) {
      if (i % 5 < 2) {
        good[i] = false;
        const double far_m = random.uniform(9, 25), direction = random.uniform(0, 2 * kPi);
        correspondences[i].ground.east_m += far_m * std::cos(direction);
        correspondences[i].ground.north_m += far_m * std::sin(direction);
      }
    }
    PosePrior prior = tight_prior();
    prior.pose.position = {kTruth.position.east_m + 4, kTruth.position.north_m - 3};
    prior.pose.agl_m = 109;
    prior.pose.attitude.heading_rad = kTruth.attitude.heading_rad + radians(1);
    const auto solved = solve_camera_pose(correspondences, prior, {2.0, 0.3});
    ASSERT_TRUE(solved) << trial;
    EXPECT_LT(off_m(solved->pose, kTruth), 0.15) << trial;
    EXPECT_EQ(solved->inlier, good) << trial;
  }
}

// Normalised error squared over draws of prior and noise: a sum of chi-square with 6 degrees of freedom each.
TEST(CameraPoseSolver, CovarianceIsConsistent) {
  Random random(5);
  constexpr int kTrials = 300;
  const double sight_sigma = 0.8, floor_sigma = 0.6, agl_sigma = 0.03, heading_sigma = 0.05, slope_sigma = 0.02;
  Eigen::Matrix2d tilt_covariance;
  tilt_covariance << 4e-4, 1e-4, 1e-4, 6e-4;
  const Eigen::Matrix2d tilt_root = tilt_covariance.llt().matrixL();
  double all = 0, position = 0, sighted = 0;
  for (int trial = 0; trial < kTrials; ++trial) {
    PosePrior prior;
    prior.pose = {{5, 5}, 100, {radians(-70), radians(3), radians(2)}};
    prior.heading_sigma_rad = heading_sigma;
    prior.log_agl_sigma = agl_sigma;
    prior.tilt_covariance_rad2 = tilt_covariance;
    const Eigen::Vector2d tilt_off = tilt_root * Eigen::Vector2d(random.normal(), random.normal());
    CameraPose truth = prior.pose;
    truth.position = {random.normal(0, 3), random.normal(0, 3)};
    truth.agl_m *= std::exp(random.normal(0, agl_sigma));
    truth.attitude.heading_rad += random.normal(0, heading_sigma);
    truth.attitude.pitch_rad += tilt_off.x();
    truth.attitude.roll_rad += tilt_off.y();
    prior.slope_sigma = slope_sigma;
    const Slope slope(random.normal(0, slope_sigma), random.normal(0, slope_sigma));
    auto correspondences = sights_from(truth, sight_sigma, 5, 4, slope);
    for (GroundCorrespondence& correspondence : correspondences) {
      const double sigma = std::hypot(sight_sigma, floor_sigma);
      correspondence.ground.east_m += random.normal(0, sigma);
      correspondence.ground.north_m += random.normal(0, sigma);
    }
    const auto solved = solve_camera_pose(correspondences, prior, {60.0, floor_sigma});
    ASSERT_TRUE(solved);
    Vector6 error;
    error << solved->pose.position.east_m - truth.position.east_m,
        solved->pose.position.north_m - truth.position.north_m, std::log(solved->pose.agl_m / truth.agl_m),
        solved->pose.attitude.heading_rad - truth.attitude.heading_rad,
        solved->pose.attitude.pitch_rad - truth.attitude.pitch_rad,
        solved->pose.attitude.roll_rad - truth.attitude.roll_rad;
    all += error.dot(solved->covariance.inverse() * error) / kTrials;
    const Eigen::Vector2d at = error.head<2>();
    position += at.dot(solved->covariance.topLeftCorner<2, 2>().inverse() * at) / kTrials;
    // The information of the correspondences alone must be consistent as well.
    const Vector6 alone = error + solved->measurement_information.inverse() * solved->measurement_gradient;
    sighted += alone.dot(solved->measurement_information * alone) / kTrials;
  }
  // Standard deviation of the mean of n chi-square of k degrees: sqrt(2k / n); bounds at 3.3 of it.
  EXPECT_NEAR(all, 6, 3.3 * std::sqrt(12.0 / kTrials));
  EXPECT_NEAR(position, 2, 3.3 * std::sqrt(4.0 / kTrials));
  EXPECT_NEAR(sighted, 6, 3.3 * std::sqrt(12.0 / kTrials));
}

// Half the sum of squares of the correspondences and of the prior on the slope.
double cost(const std::vector<GroundCorrespondence>& correspondences, const PosePrior& prior, double floor_m,
            CameraPose pose, const Vector8& step) {
  pose.position.east_m += step[0];
  pose.position.north_m += step[1];
  pose.agl_m *= std::exp(step[2]);
  pose.attitude.heading_rad += step[3];
  pose.attitude.pitch_rad += step[4];
  pose.attitude.roll_rad += step[5];
  const Slope slope = step.tail<2>();
  double sum = 0.5 * slope.squaredNorm() / (prior.slope_sigma * prior.slope_sigma);
  for (const GroundCorrespondence& correspondence : correspondences) {
    const PlanePoint at = hit_of(pose, correspondence.ray, slope);
    const Eigen::Vector2d off(correspondence.ground.east_m - at.east_m, correspondence.ground.north_m - at.north_m);
    const Eigen::Matrix2d covariance =
        correspondence.information_m2.inverse() + floor_m * floor_m * Eigen::Matrix2d::Identity();
    sum += 0.5 * off.dot(covariance.inverse() * off);
  }
  return sum;
}

TEST(CameraPoseSolver, MeasurementInformationIsTheHessianWithoutPriors) {
  auto correspondences = sights_from(kTruth, 0.7, 6, 4);
  for (std::size_t i = 0; i < correspondences.size(); i += 2) {  // uneven: ridges, and more on one side
    correspondences[i].information_m2 << 3.0, 0.8, 0.8, 0.4;
  }
  PosePrior prior;
  prior.pose = kTruth;
  prior.log_agl_sigma = 0.04;
  prior.heading_sigma_rad = 0.06;
  prior.tilt_covariance_rad2 << 3e-4, -1e-4, -1e-4, 5e-4;
  const double floor_m = 0.4;
  const auto solved = solve_camera_pose(correspondences, prior, {5.0, floor_m});
  ASSERT_TRUE(solved);
  Vector8 scale;
  scale << 1e-2, 1e-2, 1e-4, 1e-4, 1e-4, 1e-4, 1e-4, 1e-4;
  Matrix8 hessian;
  for (int i = 0; i < 8; ++i) {
    for (int j = 0; j < 8; ++j) {
      const Vector8 a = scale[i] * Vector8::Unit(i), b = scale[j] * Vector8::Unit(j);
      const auto at = [&](const Vector8& step) { return cost(correspondences, prior, floor_m, solved->pose, step); };
      hessian(i, j) = (at(a + b) - at(a - b) - at(b - a) + at(-a - b)) / (4 * scale[i] * scale[j]);
    }
  }
  const Eigen::Matrix<double, 6, 2> with_slope = hessian.topRightCorner<6, 2>();
  const Eigen::Matrix<double, 6, 6> expected =
      hessian.topLeftCorner<6, 6>() - with_slope * hessian.bottomRightCorner<2, 2>().inverse() * with_slope.transpose();
  EXPECT_LT((solved->measurement_information - expected).norm(), 1e-3 * expected.norm())
      << solved->measurement_information << "\n\n"
      << expected;
  hessian(2, 2) += 1 / (prior.log_agl_sigma * prior.log_agl_sigma);
  hessian(3, 3) += 1 / (prior.heading_sigma_rad * prior.heading_sigma_rad);
  hessian.block<2, 2>(4, 4) += prior.tilt_covariance_rad2.inverse();
  const Eigen::Matrix<double, 6, 6> covariance = hessian.inverse().topLeftCorner<6, 6>();
  EXPECT_LT((solved->covariance - covariance).norm(), 1e-3 * covariance.norm());
}

TEST(CameraPoseSolver, TheMeasuredPoseIsIndependentOfThePrior) {
  const auto correspondences = sights_from(kTruth, 0.2);
  for (const double wrong : {-0.03, 0.0, 0.03}) {
    PosePrior prior;
    prior.pose = kTruth;
    prior.pose.attitude.pitch_rad += wrong;
    prior.tilt_covariance_rad2 = Eigen::Matrix2d::Identity() * 4e-4;
    prior.slope_sigma = kLevel;
    const auto solved = solve_camera_pose(correspondences, prior, {20.0, 0.5});
    ASSERT_TRUE(solved);
    const Vector6 step = solved->measurement_information.inverse() * solved->measurement_gradient;
    EXPECT_NEAR(solved->pose.attitude.pitch_rad + step[4], kTruth.attitude.pitch_rad, 0.001) << wrong;
    EXPECT_NEAR(solved->pose.attitude.roll_rad + step[5], kTruth.attitude.roll_rad, 0.001) << wrong;
    EXPECT_NEAR(solved->pose.position.east_m + step[0], kTruth.position.east_m, 0.1) << wrong;
    EXPECT_NEAR(solved->pose.position.north_m + step[1], kTruth.position.north_m, 0.1) << wrong;
  }
}

// Roofs and hills: a correspondence knows how high its ground lies.
TEST(CameraPoseSolver, UsesTerrainHeights) {
  auto correspondences = sights_from(kTruth, 0.3);
  for (std::size_t i = 0; i < correspondences.size(); ++i) {
    correspondences[i].height_m = i % 3 == 0 ? 12 : -4;
    correspondences[i].ground = hit_of(kTruth, correspondences[i].ray, Slope::Zero(), correspondences[i].height_m);
  }
  const auto solved = solve_camera_pose(correspondences, tight_prior(), {2.0, 0.1});
  ASSERT_TRUE(solved);
  EXPECT_LT(off_m(solved->pose, kTruth), 0.01);
}

// An unknown slope looks like a tilt: with a lax prior on it the correspondences say less about tilt, but the fit stays
// exact.
TEST(CameraPoseSolver, AnUnknownSlopeTakesInformationFromTheTilt) {
  PosePrior prior = tight_prior();
  prior.tilt_covariance_rad2 = Eigen::Matrix2d::Identity() * 4e-4;
  const auto level = solve_camera_pose(sights_from(kTruth, 0.3), prior, {2.0, 0.1});
  prior.slope_sigma = 0.05;
  const auto sloping = solve_camera_pose(sights_from(kTruth, 0.3, 9, 6, {0.03, -0.02}), prior, {2.0, 0.1});
  ASSERT_TRUE(level && sloping);
  const auto tilt_information = [](const SolvedPose& solved) {
    const Eigen::Matrix<double, 6, 6> spread = solved.measurement_information.inverse();
    return Eigen::Matrix2d(spread.block<2, 2>(4, 4).inverse()).trace();  // nothing else being known
  };
  EXPECT_LT(tilt_information(*sloping), 0.5 * tilt_information(*level));
  EXPECT_LT(sloping->rms_m, 0.05);
}

// Everything else is exact: the errors of the position are those that the slopes cause.
TEST(CameraPoseSolver, SaysWhichPartOfTheCovarianceTheSlopeCauses) {
  constexpr int kDraws = 300;
  PosePrior prior = tight_prior();
  prior.pose.attitude = kTruth.attitude;
  prior.pose.agl_m = kTruth.agl_m;
  prior.tilt_covariance_rad2 = Eigen::Matrix2d::Identity() * (radians(1) * radians(1));
  prior.slope_sigma = 0.01;
  Random random(3);
  Eigen::Matrix2d scatter_m2 = Eigen::Matrix2d::Zero(), stated_m2 = Eigen::Matrix2d::Zero();
  for (int i = 0; i < kDraws; ++i) {
    const Slope slope(random.normal(0, prior.slope_sigma), random.normal(0, prior.slope_sigma));
    const auto solved = solve_camera_pose(sights_from(kTruth, 0.3, 9, 6, slope), prior, {5.0, 0.1});
    ASSERT_TRUE(solved);
    const Eigen::Vector2d off = solved->pose.position - kTruth.position;
    scatter_m2 += off * off.transpose() / kDraws;
    stated_m2 += solved->slope_covariance_m2 / kDraws;
    const Eigen::Matrix2d rest_m2 = solved->covariance.topLeftCorner<2, 2>() - solved->slope_covariance_m2;
    EXPECT_TRUE(rest_m2(0, 0) > 0 && rest_m2.determinant() > 0) << "a part of it";
  }
  EXPECT_NEAR(scatter_m2(0, 0) / stated_m2(0, 0), 1, 0.2);
  EXPECT_NEAR(scatter_m2(1, 1) / stated_m2(1, 1), 1, 0.2);
  prior.slope_sigma = kLevel;
  EXPECT_LT(solve_camera_pose(sights_from(kTruth, 0.3), prior, {5.0, 0.1})->slope_covariance_m2.trace(), 1e-4);
}

TEST(CameraPoseSolver, RejectsWhatCannotBeSolved) {
  auto correspondences = sights_from(kTruth, 0.3);
  EXPECT_FALSE(solve_camera_pose({}, tight_prior(), {}));
  EXPECT_FALSE(solve_camera_pose({correspondences[0], correspondences[1], correspondences[2]}, tight_prior(), {}));
  correspondences[5].ray = {1, 0, 0};  // sees no ground
  EXPECT_FALSE(solve_camera_pose(correspondences, tight_prior(), {}));
}

}  // namespace
}  // namespace nadir
