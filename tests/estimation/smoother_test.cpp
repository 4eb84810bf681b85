#include "estimation/smoother.hpp"

#include <gtest/gtest.h>

#include <Eigen/LU>

#include "base/random.hpp"

namespace nadir {
namespace {

using Eigen::Matrix2d;
using Eigen::MatrixXd;
using Eigen::Vector2d;
using Eigen::VectorXd;

struct Flight {
  Vector2d start = {3, -2};
  Matrix2d start_m2 = Matrix2d::Identity() * 400;
  std::vector<Vector2d> moved;
  std::vector<Matrix2d> motion_m2;
  struct Anchor {
    std::size_t frame;
    Vector2d position;
    Matrix2d covariance;
  };
  std::vector<Anchor> anchors;
};

Matrix2d random_covariance(Random& random, double scale) {
  const Vector2d a(random.normal(), random.normal()), b(random.normal(), random.normal());
  return scale * (a * a.transpose() + b * b.transpose() + 0.2 * Matrix2d::Identity());
}

Flight random_flight(Random& random, std::size_t frames) {
  Flight flight;
  Vector2d truth(0, 0);
  for (std::size_t i = 0; i < frames; ++i) {
    if (i > 0) {
      flight.moved.emplace_back(random.normal(30, 5), random.normal(0, 5));
      flight.motion_m2.push_back(random_covariance(random, 4));
      truth += flight.moved.back();
    }
    if (i % 4 == 2) {
      flight.anchors.push_back(
          {i, truth + Vector2d(random.normal(0, 5), random.normal(0, 5)), random_covariance(random, 9)});
    }
  }
  return flight;
}

// A plain Kalman filter, forwards.
std::vector<TrackPoint> filtered(const Flight& flight) {
  std::vector<TrackPoint> track;
  Vector2d x = flight.start;
  Matrix2d p = flight.start_m2;
  for (std::size_t i = 0; i <= flight.moved.size(); ++i) {
    if (i > 0) {
      x += flight.moved[i - 1];
      p += flight.motion_m2[i - 1];
    }
    TrackPoint point;
    point.predicted_m = x;
    point.predicted_m2 = p;
    for (const auto& anchor : flight.anchors) {
      if (anchor.frame != i) continue;
      const Matrix2d gain = p * (p + anchor.covariance).inverse();
      x += gain * (anchor.position - x);
      p = ((Matrix2d::Identity() - gain) * p).eval();
    }
    point.position_m = x;
    point.covariance_m2 = p;
    track.push_back(point);
  }
  return track;
}

// All frames at once: the dense normal equations of start, motions and anchors.
struct Dense {
  VectorXd positions;
  MatrixXd covariance;
};

Dense least_squares(const Flight& flight) {
  const auto frames = static_cast<Eigen::Index>(flight.moved.size() + 1);
  MatrixXd information = MatrixXd::Zero(2 * frames, 2 * frames);
  VectorXd right = VectorXd::Zero(2 * frames);
  information.topLeftCorner<2, 2>() += flight.start_m2.inverse();
  right.head<2>() += flight.start_m2.inverse() * flight.start;
  for (Eigen::Index i = 1; i < frames; ++i) {
    const auto k = static_cast<std::size_t>(i - 1);
    const Matrix2d weight = flight.motion_m2[k].inverse();
    information.block<2, 2>(2 * i, 2 * i) += weight;
    information.block<2, 2>(2 * i - 2, 2 * i - 2) += weight;
    information.block<2, 2>(2 * i, 2 * i - 2) -= weight;
    information.block<2, 2>(2 * i - 2, 2 * i) -= weight;
    right.segment<2>(2 * i) += weight * flight.moved[k];
    right.segment<2>(2 * i - 2) -= weight * flight.moved[k];
  }
  for (const auto& anchor : flight.anchors) {
    const auto i = static_cast<Eigen::Index>(anchor.frame);
    information.block<2, 2>(2 * i, 2 * i) += anchor.covariance.inverse();
    right.segment<2>(2 * i) += anchor.covariance.inverse() * anchor.position;
  }
  const MatrixXd covariance = information.inverse();
  return {covariance * right, covariance};
}

TEST(Smoother, EqualsBatchLeastSquares) {
  Random random(1);
  for (int trial = 0; trial < 10; ++trial) {
    const Flight flight = random_flight(random, 15);
    const auto smoothed = smooth(filtered(flight));
    const Dense dense = least_squares(flight);
    ASSERT_EQ(smoothed.size(), 15U);
    for (std::size_t i = 0; i < smoothed.size(); ++i) {
      const auto k = static_cast<Eigen::Index>(2 * i);
      EXPECT_LT((smoothed[i].position_m - dense.positions.segment<2>(k)).norm(), 1e-6);
      const Matrix2d expected = dense.covariance.block<2, 2>(k, k);
      EXPECT_LT((smoothed[i].covariance_m2 - expected).norm(), 1e-6 * expected.norm());
    }
  }
}

TEST(Smoother, TheLastFrameStaysAsItIs) {
  Random random(2);
  const auto track = filtered(random_flight(random, 9));
  const auto smoothed = smooth(track);
  EXPECT_EQ(smoothed.back().position_m, track.back().position_m);
  EXPECT_EQ(smoothed.back().covariance_m2, track.back().covariance_m2);
}

TEST(Smoother, WithoutAnchorsNothingChanges) {
  Random random(3);
  Flight flight = random_flight(random, 9);
  flight.anchors.clear();
  const auto track = filtered(flight);
  const auto smoothed = smooth(track);
  for (std::size_t i = 0; i < track.size(); ++i) {
    EXPECT_LT((smoothed[i].position_m - track[i].position_m).norm(), 1e-9);
    EXPECT_LT((smoothed[i].covariance_m2 - track[i].covariance_m2).norm(), 1e-9);
  }
}

TEST(Smoother, EmptyAndSingle) {
  EXPECT_TRUE(smooth({}).empty());
  EXPECT_EQ(smooth({TrackPoint{}}).size(), 1U);
}

}  // namespace
}  // namespace nadir
