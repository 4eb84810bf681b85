#include "adjustment/residuals.hpp"

#include <ceres/cost_function.h>
#include <ceres/loss_function.h>

#include <Eigen/Cholesky>
#include <cmath>
#include <memory>

#include "base/random.hpp"
#include "drawn_block.hpp"
#include "geodesy/angles.hpp"

using namespace nadir;
using namespace nadir::test;

namespace {

CameraModel some_camera() {
  CameraModel camera;
  camera.width = 1200, camera.height = 900;
  camera.fx = 1000, camera.fy = 1010;
  camera.cx = 590, camera.cy = 455;
  camera.distortion = {-0.1, 0.04, 0.001, -0.0007, 0.01};
  return camera;
}

FrameBlock some_frame(Random& random) {
  FrameBlock frame;
  frame.values = {random.uniform(-50, 50),   random.uniform(-50, 50),   150 + random.uniform(-20, 20),
                  random.uniform(-0.2, 0.2), random.uniform(-0.2, 0.2), random.uniform(-0.2, 0.2)};
  frame.reference = enu_from_camera({random.uniform(-3, 3), random.uniform(-0.2, 0.2), random.uniform(-0.2, 0.2)});
  return frame;
}

// Largest difference between the derivatives of a cost function and central differences, over the size of either.
double derivative_error(const ceres::CostFunction& cost, std::vector<std::vector<double>> blocks) {
  const int rows = cost.num_residuals();
  std::vector<std::vector<double>> jacobians;
  std::vector<double*> jacobian_pointers;
  std::vector<const double*> pointers;
  for (const auto& block : blocks) {
    jacobians.emplace_back(static_cast<std::size_t>(rows) * block.size());
    pointers.push_back(block.data());
  }
  for (auto& jacobian : jacobians) jacobian_pointers.push_back(jacobian.data());
  std::vector<double> residual(static_cast<std::size_t>(rows)), more = residual, less = residual;
  if (!cost.Evaluate(pointers.data(), residual.data(), jacobian_pointers.data())) return 1e9;
  double worst = 0;
  for (std::size_t b = 0; b < blocks.size(); ++b) {
    for (std::size_t i = 0; i < blocks[b].size(); ++i) {
      const double value = blocks[b][i], step = 1e-5 * std::max(1.0, std::abs(value));
      blocks[b][i] = value + step;
      EXPECT_TRUE(cost.Evaluate(pointers.data(), more.data(), nullptr));
      blocks[b][i] = value - step;
      EXPECT_TRUE(cost.Evaluate(pointers.data(), less.data(), nullptr));
      blocks[b][i] = value;
      for (std::size_t r = 0; r < residual.size(); ++r) {
        const double numeric = (more[r] - less[r]) / (2 * step), own = jacobians[b][r * blocks[b].size() + i];
        worst = std::max(worst, std::abs(numeric - own) / (1 + std::abs(numeric)));
      }
    }
  }
  return worst;
}

std::vector<double> values_of(const FrameBlock& frame) { return {frame.values.begin(), frame.values.end()}; }

}  // namespace

TEST(AdjustmentResiduals, TheirDerivativesAreThoseOfTheirValues) {
  const CameraModel camera = some_camera();
  const AdjustableLens lens(camera);
  const RollingGround ground;
  Random random(5);
  for (int i = 0; i < 30; ++i) {
    const FrameBlock frame = some_frame(random), other = some_frame(random);
    const std::vector<double> distortion(camera.distortion.begin(), camera.distortion.end());
    const double reach = i % 3 == 2 ? 400 : 80;  // also far outside of the image
    const Eigen::Vector3d point =
        frame.centre_m() +
        frame.world_from_camera() * Eigen::Vector3d(random.uniform(-reach, reach), random.uniform(-reach, reach), 150);
    const std::vector<double> place{point.x(), point.y(), point.z()};
    const std::unique_ptr<ceres::CostFunction> reprojection(reprojection_cost(lens, frame, {300, 400}, 0.5));
    // Outside, the polynomial's straight continuation has only approximate derivatives.
    const bool outside = std::hypot(place[0] - frame.values[0], place[1] - frame.values[1]) > 100;
    if (!outside) {
      EXPECT_LT(derivative_error(*reprojection, {values_of(frame), {0.02}, distortion, place}), 1e-5) << i;
    }

    const std::unique_ptr<ceres::CostFunction> attitude(attitude_cost(frame, other.world_from_camera(), 0.01, 0.02));
    EXPECT_LT(derivative_error(*attitude, {values_of(frame), {0.01, -0.02, 0.03}}), 1e-5) << i;
    const std::unique_ptr<ceres::CostFunction> height(height_cost(ground, 140, 0.02));
    EXPECT_LT(derivative_error(*height, {values_of(frame), {0.01}}), 1e-3) << i;  // the slope is over 10 m
    const std::unique_ptr<ceres::CostFunction> terrain(terrain_cost(ground, 3));
    EXPECT_LT(derivative_error(*terrain, {place}), 1e-3) << i;
    Eigen::Matrix2d covariance;
    covariance << 9, 2, 2, 4;
    const std::unique_ptr<ceres::CostFunction> position(position_cost({3, 4}, covariance));
    EXPECT_LT(derivative_error(*position, {values_of(frame)}), 1e-6) << i;
    Eigen::Matrix<double, 6, 6> whole = Eigen::Matrix<double, 6, 6>::Identity();
    whole.topLeftCorner<2, 2>() = covariance;
    whole(0, 4) = whole(4, 0) = 0.02, whole(2, 2) = whole(3, 3) = whole(4, 4) = whole(5, 5) = 1e-3;
    const std::unique_ptr<ceres::CostFunction> pose(pose_cost(ground, frame, {{3, 4}, 140, {1, 0.1, -0.2}}, whole));
    EXPECT_LT(derivative_error(*pose, {values_of(frame)}), 5e-3) << i;  // likewise
    const std::unique_ptr<ceres::CostFunction> motion(motion_cost({3, 4, 5}, 2));
    EXPECT_LT(derivative_error(*motion, {values_of(frame), values_of(other)}), 1e-6) << i;
    const std::unique_ptr<ceres::CostFunction> control(control_cost({3, 4}, 5));
    EXPECT_LT(derivative_error(*control, {place}), 1e-6) << i;
  }
}

TEST(AdjustmentResiduals, AnAnchorsSquareIsItsMahalanobisDistance) {
  Eigen::Matrix2d covariance;
  covariance << 9, 2, 2, 4;
  const std::unique_ptr<ceres::CostFunction> cost(position_cost({3, 4}, covariance));
  const std::vector<double> frame{5, 3, 100, 0, 0, 0};
  const double* blocks[] = {frame.data()};
  Eigen::Vector2d residual;
  ASSERT_TRUE(cost->Evaluate(blocks, residual.data(), nullptr));
  const Eigen::Vector2d off(2, -1);
  EXPECT_NEAR(residual.squaredNorm(), off.dot(covariance.llt().solve(off)), 1e-12);
}

TEST(AdjustmentResiduals, TheLensIsTheCameraModels) {
  const CameraModel camera = some_camera();
  const AdjustableLens lens(camera);
  Random random(6);
  for (int i = 0; i < 200; ++i) {
    const Eigen::Vector2d pixel(random.uniform(0, 1199), random.uniform(0, 899));
    const Eigen::Vector3d point = random.uniform(50, 500) * camera.ray_from_pixel(pixel);
    const Eigen::Vector2d own = lens.project(point, 0, camera.distortion.data(), nullptr, nullptr, nullptr);
    EXPECT_LT((own - pixel).norm(), 1e-6);
    EXPECT_LT((own - camera.pixel_from_point(point)).norm(), 1e-9);
  }
  // Far outside nothing appears inside, whatever the polynomial does there.
  for (int i = 0; i < 200; ++i) {
    const double azimuth = random.uniform(0, 2 * kPi), off = random.uniform(1, 20);
    const Eigen::Vector2d own = lens.project({off * std::cos(azimuth), off * std::sin(azimuth), 1}, 0,
                                             camera.distortion.data(), nullptr, nullptr, nullptr);
    EXPECT_GT((own - Eigen::Vector2d(camera.cx, camera.cy)).norm(), 800);
  }
}

TEST(AdjustmentResiduals, BehindTheCameraNothingIsSeen) {
  const CameraModel camera = some_camera();
  const AdjustableLens lens(camera);
  FrameBlock frame;
  frame.values = {0, 0, 100, 0, 0, 0};
  frame.reference = enu_from_camera({});
  EXPECT_TRUE(project(lens, {}, frame, {0, 0, 0}));
  EXPECT_FALSE(project(lens, {}, frame, {0, 0, 200}));
  const std::unique_ptr<ceres::CostFunction> cost(reprojection_cost(lens, frame, {300, 400}, 0.5));
  const std::vector<double> focal{0}, distortion(5, 0), above{0, 0, 200};
  const double* blocks[] = {frame.values.data(), focal.data(), distortion.data(), above.data()};
  double residual[2];
  EXPECT_FALSE(cost->Evaluate(blocks, residual, nullptr));
}

TEST(AdjustmentResiduals, AMeasuredAttitudeWithItsBoresightHasNoResidual) {
  Random random(7);
  const FrameBlock frame = some_frame(random);
  const Eigen::Vector3d boresight(0.02, -0.03, 0.05);
  const Eigen::Matrix3d measured = frame.world_from_camera() * rotation_from_vector(boresight).transpose();
  const std::unique_ptr<ceres::CostFunction> cost(attitude_cost(frame, measured, 0.01, 0.02));
  const double* blocks[] = {frame.values.data(), boresight.data()};
  Eigen::Vector3d residual;
  ASSERT_TRUE(cost->Evaluate(blocks, residual.data(), nullptr));
  EXPECT_LT(residual.norm(), 1e-9);
  // A turn about the vertical is heading's alone.
  const Eigen::Matrix3d turned = rotation_from_vector({0, 0, 0.04}) * measured;
  const std::unique_ptr<ceres::CostFunction> off(attitude_cost(frame, turned, 0.01, 0.02));
  ASSERT_TRUE(off->Evaluate(blocks, residual.data(), nullptr));
  EXPECT_NEAR(residual.z(), -2, 1e-9);
  EXPECT_LT(residual.head<2>().norm(), 1e-9);
}

TEST(AdjustmentResiduals, AttitudesThereAndBack) {
  Random random(8);
  for (int i = 0; i < 100; ++i) {
    const Attitude attitude{random.uniform(-3.1, 3.1), random.uniform(-1.4, 1.4), random.uniform(-3.1, 3.1)};
    const Attitude back = attitude_from_matrix(enu_from_camera(attitude));
    EXPECT_NEAR(back.heading_rad, attitude.heading_rad, 1e-9);
    EXPECT_NEAR(back.pitch_rad, attitude.pitch_rad, 1e-9);
    EXPECT_NEAR(back.roll_rad, attitude.roll_rad, 1e-9);
  }
}

TEST(AdjustmentResiduals, ASwitchableAnchorCountsFullyUpToItsBoundAndFarAwayNotAtAll) {
  double bound = 9;
  const std::unique_ptr<ceres::LossFunction> loss(switchable_loss(bound));
  double rho[3];
  loss->Evaluate(8.9, rho);
  EXPECT_EQ(rho[0], 8.9);
  EXPECT_EQ(rho[1], 1);
  loss->Evaluate(9 + 1e-9, rho);
  EXPECT_NEAR(rho[0], 9, 1e-6);  // without a step
  EXPECT_NEAR(rho[1], 1, 1e-6);
  loss->Evaluate(1e6, rho);
  EXPECT_LT(rho[0], 27);          // 3 Φ
  EXPECT_LT(rho[1] * 1e3, 1e-3);  // the pull s² r
  // The derivatives are those of the value, and the weight is the square of the switch.
  for (const double chi2 : {10.0, 50.0, 400.0}) {
    double more[3], less[3];
    loss->Evaluate(chi2 + 1e-4, more);
    loss->Evaluate(chi2 - 1e-4, less);
    loss->Evaluate(chi2, rho);
    EXPECT_NEAR(rho[1], (more[0] - less[0]) / 2e-4, 1e-6);
    EXPECT_NEAR(rho[2], (more[1] - less[1]) / 2e-4, 1e-6);
    EXPECT_NEAR(rho[1], switch_value(chi2, bound) * switch_value(chi2, bound), 1e-12);
  }
  bound = 900;  // is read again
  loss->Evaluate(400, rho);
  EXPECT_EQ(rho[1], 1);
}
