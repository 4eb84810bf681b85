// The flight filter against oracles of its own: a dense Gaussian over all frames at once, and truths drawn at random.
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

PoseSight place(const Vector2d& at, const Matrix2d& covariance) {
  PoseSight sight;
  sight.seen << at, 0, 0, 0, 0;
  sight.covariance = Eigen::Matrix<double, 6, 6>::Identity() * 1e8;
  sight.covariance.topLeftCorner<2, 2>() = covariance;
  return sight;
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
    Dense dense({3, -2}, 20, options.start_velocity_sigma_mps, kFrames);
    for (int i = 0; i < kFrames; ++i) {
      const double dt = i == 0 ? 0 : random.uniform(0.3, 2);
      filter.advance(dt, std::nullopt);
      if (i > 0) dense.predict(i, dt, options.acceleration_mps2);
      if (i % 4 == 2) {
        const Vector2d at(30.0 * i + random.normal(0, 5), random.normal(0, 5));
        const Matrix2d noise = random_covariance(random, 9);
        filter.anchored(place(at, noise));
        dense.see(i, at, noise);
      }
      EXPECT_LT((filter.position_m() - dense.mean.segment<2>(4 * i)).norm(), 1e-4) << i;
      EXPECT_LT((filter.position_covariance_m2() - dense.covariance.block<2, 2>(4 * i, 4 * i)).norm(), 1e-3) << i;
    }
    const auto smoothed = filter.smoothed();
    ASSERT_EQ(smoothed.size(), static_cast<std::size_t>(kFrames));
    for (int i = 0; i < kFrames; ++i) {
      const auto& frame = smoothed[static_cast<std::size_t>(i)];
      const Matrix2d expected = dense.covariance.block<2, 2>(4 * i, 4 * i);
      EXPECT_LT((frame.position_m - dense.mean.segment<2>(4 * i)).norm(), 1e-3) << i;
      EXPECT_LT((frame.covariance_m2 - expected).norm(), 1e-3 * expected.norm()) << i;
    }
  }
}

TEST(FlightFilterOracle, TheLastFrameIsSmoothAsItIs) {
  F filter(TelemetryUncertainty{}, true, {0, 0}, 20);
  for (int i = 0; i < 5; ++i) filter.advance(1, radians(10 * i));
  filter.anchored(place({9, 9}, Matrix2d::Identity()));
  EXPECT_EQ(filter.smoothed().back().position_m, filter.position_m());
  EXPECT_EQ(filter.smoothed().back().covariance_m2, filter.position_covariance_m2());
  EXPECT_EQ(F(TelemetryUncertainty{}, true, {1, 2}, 3).smoothed().size(), 1U);
}

// A flight drawn from what the filter believes of sensors: heading and height with a constant error and noise. Odometry
// measures in the frame of the telemetry, anchors see the truth. Errors must be as large as they are said to be.
struct DrawnFlight {
  TelemetryUncertainty uncertainty;
  double filter_nees = 0, blind_nees = 0, smooth_nees = 0, filter_error = 0, smooth_error = 0;
  int frames = 0, blind_frames = 0;

  void fly(Random& random) {
    const double bias = random.normal(0, uncertainty.heading_rad);
    Vector2d truth(random.normal(0, 20), random.normal(0, 20));
    F filter(uncertainty, true, {0, 0}, 20);
    std::vector<Vector2d> truths;
    double heading = radians(random.uniform(-180, 180));
    double log_height = random.normal(0, uncertainty.agl_relative);
    for (int i = 0; i < 60; ++i) {
      const double turn = i % 20 > 14 ? radians(15) : 0;
      const auto& x = filter.state();
      const Believed before{x[F::log_height], x[F::heading], x[F::pitch], x[F::roll]};
      const double heading_before = heading, height_before = log_height;
      heading += i > 0 ? turn : 0;
      log_height = 0.9682 * log_height + random.normal(0, 0.25 * uncertainty.agl_relative);
      const double told = wrap_pi(heading - bias + random.normal(0, 0.5 * uncertainty.heading_rad));
      filter.advance(i == 0 ? 0 : 1, told);
      if (i > 0) {
        const Vector2d step = 25 * Vector2d(std::sin(heading - turn / 2), std::cos(heading - turn / 2));
        truth += step;
        filter.moved(
            seen_by_odometry(random, filter, before, step, heading_before, heading, height_before, log_height));
      }
      if (i % 10 == 5) {
        PoseSight sight = place(truth + Vector2d(random.normal(0, 3), random.normal(0, 3)), Matrix2d::Identity() * 9);
        filter.anchored(sight);
      }
      truths.push_back(truth);
      const double nees = nees_of(filter.position_m(), filter.position_covariance_m2(), truth);
      filter_nees += nees;
      filter_error += (filter.position_m() - truth).squaredNorm();
      ++frames;
      if (i % 10 == 4) {
        blind_nees += nees;
        ++blind_frames;
      }
    }
    const auto smoothed = filter.smoothed();
    for (std::size_t i = 0; i < truths.size(); ++i) {
      smooth_nees += nees_of(smoothed[i].position_m, smoothed[i].covariance_m2, truths[i]);
      smooth_error += (smoothed[i].position_m - truths[i]).squaredNorm();
    }
  }

  static double nees_of(const Vector2d& at, const Matrix2d& covariance, const Vector2d& truth) {
    return (at - truth).dot(covariance.inverse() * (at - truth));
  }

  static MotionSight seen_by_odometry(Random& random, const F& filter, const Believed& before, const Vector2d& step,
                                      double heading_before, double heading, double height_before, double log_height) {
    const auto& x = filter.state();
    MotionSight sight;
    sight.before = before;
    sight.now = {x[F::log_height], x[F::heading], x[F::pitch], x[F::roll]};
    // In the scale and directions of what was believed of the frame before.
    const double turned = wrap_pi(before.heading_rad - heading_before),
                 scale = std::exp(before.log_height - height_before);
    const Vector2d told(std::cos(turned) * step.x() + std::sin(turned) * step.y(),
                        -std::sin(turned) * step.x() + std::cos(turned) * step.y());
    Eigen::Matrix<double, 8, 1> sigma;
    sigma << 0.5, 0.5, 0.005, 0.005, 1e3, 1e3, 1e3, 1e3;
    sight.seen.setZero();
    sight.seen.head<2>() = scale * told;
    sight.seen[2] = (log_height - height_before) - (sight.now.log_height - before.log_height);
    sight.seen[3] = wrap_pi((heading - heading_before) - (sight.now.heading_rad - before.heading_rad));
    for (int k = 0; k < 4; ++k) sight.seen[k] += random.normal(0, sigma[k]);
    sight.covariance = sigma.cwiseProduct(sigma).asDiagonal();
    return sight;
  }
};

TEST(FlightFilterOracle, ErrsAsMuchAsItSays) {
  Random random(7);
  DrawnFlight drawn;
  drawn.uncertainty.heading_rad = radians(3);
  drawn.uncertainty.agl_relative = 0.04;
  for (int trial = 0; trial < 60; ++trial) drawn.fly(random);
  EXPECT_NEAR(drawn.filter_nees / drawn.frames, 2, 0.4);
  EXPECT_NEAR(drawn.blind_nees / drawn.blind_frames, 2, 0.5) << "before an anchor";
  EXPECT_NEAR(drawn.smooth_nees / drawn.frames, 2, 0.4);
  EXPECT_LT(drawn.smooth_error, 0.7 * drawn.filter_error) << "what is learnt later helps";
}

}  // namespace
}  // namespace nadir
