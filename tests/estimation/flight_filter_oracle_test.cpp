// The flight filter against oracles of its own: a dense Gaussian over all frames at once.
#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <cmath>

#include "base/random.hpp"
#include "estimation/flight_filter.hpp"
#include "geodesy/angles.hpp"

namespace nadir {
namespace {

using Eigen::Matrix2d;
using Eigen::MatrixXd;
using Eigen::Vector2d;
using Eigen::VectorXd;
using F = FlightFilter;

PoseMeasurement place(const Vector2d& at, const Matrix2d& covariance) {
  PoseMeasurement measurement;
  measurement.value << at, 0, 0, 0, 0;
  measurement.covariance = Eigen::Matrix<double, 6, 6>::Identity() * 1e8;
  measurement.covariance.topLeftCorner<2, 2>() = covariance;
  return measurement;
}

Matrix2d random_covariance(Random& random, double scale) {
  const Vector2d a(random.normal(), random.normal()), b(random.normal(), random.normal());
  return scale * (a * a.transpose() + b * b.transpose() + 0.2 * Matrix2d::Identity());
}

// Constant velocity with white acceleration, seen at some moments: (position, velocity) of all frames as one Gaussian.
struct Dense {
  VectorXd mean;
  MatrixXd covariance;

  Dense(const Vector2d& start, double sigma_m, double velocity_sigma_mps, int frames)
      : mean(VectorXd::Zero(4 * frames)), covariance(MatrixXd::Zero(4 * frames, 4 * frames)) {
    mean.head<2>() = start;
    covariance.topLeftCorner<2, 2>() = Matrix2d::Identity() * sigma_m * sigma_m;
    covariance.block<2, 2>(2, 2) = Matrix2d::Identity() * velocity_sigma_mps * velocity_sigma_mps;
  }

  void predict(int frame, double dt, double acceleration) {
    const int now = 4 * frame, before = now - 4;
    Eigen::Matrix4d move = Eigen::Matrix4d::Identity();
    move.topRightCorner<2, 2>() = Matrix2d::Identity() * dt;
    Eigen::Matrix4d noise;
    const double q = acceleration * acceleration;
    noise << Matrix2d::Identity() * (q * dt * dt * dt / 3), Matrix2d::Identity() * (q * dt * dt / 2),
        Matrix2d::Identity() * (q * dt * dt / 2), Matrix2d::Identity() * (q * dt);
    mean.segment<4>(now) = move * mean.segment<4>(before);
    covariance.block(now, 0, 4, now) = move * covariance.block(before, 0, 4, now);
    covariance.block(0, now, now, 4) = covariance.block(now, 0, 4, now).transpose();
    covariance.block<4, 4>(now, now) = move * covariance.block<4, 4>(before, before) * move.transpose() + noise;
  }

  void see(int frame, const Vector2d& at, const Matrix2d& noise) {
    const MatrixXd columns = covariance.middleCols(4 * frame, 2);
    const MatrixXd gain = columns * (covariance.block<2, 2>(4 * frame, 4 * frame) + noise).inverse();
    mean += gain * (at - mean.segment<2>(4 * frame));
    covariance -= gain * columns.transpose();
  }
};

TEST(FlightFilterOracle, EqualsTheDenseGaussianForwardsAndBackwards) {
  Random random(1);
  const F::Options options;
  for (int trial = 0; trial < 5; ++trial) {
    constexpr int kFrames = 15;
    F filter(TelemetryUncertainty{}, true, {3, -2}, 20);
    filter.keep_history();
    Dense dense({3, -2}, 20, options.start_velocity_sigma_mps, kFrames);
    for (int i = 0; i < kFrames; ++i) {
      const double dt = i == 0 ? 0 : random.uniform(0.3, 2);
      filter.predict(dt, std::nullopt);
      if (i > 0) dense.predict(i, dt, options.acceleration_mps2);
      if (i % 4 == 2) {
        const Vector2d at(30.0 * i + random.normal(0, 5), random.normal(0, 5));
        const Matrix2d noise = random_covariance(random, 9);
        filter.update_absolute(place(at, noise));
        dense.see(i, at, noise);
      }
      EXPECT_LT((filter.position().vector() - dense.mean.segment<2>(4 * i)).norm(), 1e-4) << i;
      EXPECT_LT((filter.position_covariance_m2() - dense.covariance.block<2, 2>(4 * i, 4 * i)).norm(), 1e-3) << i;
    }
    const auto smoothed = filter.smoothed();
    ASSERT_EQ(smoothed.size(), static_cast<std::size_t>(kFrames));
    for (int i = 0; i < kFrames; ++i) {
      const auto& frame = smoothed[static_cast<std::size_t>(i)];
      const Matrix2d expected = dense.covariance.block<2, 2>(4 * i, 4 * i);
      EXPECT_LT((frame.position.vector() - dense.mean.segment<2>(4 * i)).norm(), 1e-3) << i;
      EXPECT_LT((frame.covariance_m2 - expected).norm(), 1e-3 * expected.norm()) << i;
    }
  }
}

TEST(FlightFilterOracle, TheLastSmoothedFrameEqualsTheFiltered) {
  F filter(TelemetryUncertainty{}, true, {0, 0}, 20);
  filter.keep_history();
  for (int i = 0; i < 5; ++i) filter.predict(1, radians(10 * i));
  filter.update_absolute(place({9, 9}, Matrix2d::Identity()));
  EXPECT_EQ(filter.smoothed().back().position, filter.position());
  EXPECT_EQ(filter.smoothed().back().covariance_m2, filter.position_covariance_m2());
  EXPECT_EQ(F(TelemetryUncertainty{}, true, {1, 2}, 3).smoothed().size(), 1U);
}

}  // namespace
}  // namespace nadir
