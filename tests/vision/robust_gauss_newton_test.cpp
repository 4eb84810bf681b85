#include "vision/robust_gauss_newton.hpp"

#include <gtest/gtest.h>

#include "base/random.hpp"

namespace nadir {
namespace {

using Eigen::Vector2d;

std::vector<Vector2d> scattered(Random& random, int count) {
  std::vector<Vector2d> places;
  for (int i = 0; i < count; ++i) places.emplace_back(random.uniform(0, 100), random.uniform(0, 100));
  return places;
}

TEST(EffectiveSampleSize, IndependentMeasurementsCountFully) {
  Random random(1);
  double mean = 0;
  for (int trial = 0; trial < 20; ++trial) {
    const auto places = scattered(random, 200);
    std::vector<Vector2d> residuals;
    for (int i = 0; i < 200; ++i) residuals.emplace_back(random.normal(), random.normal());
    mean += effective_sample_size(places, residuals) / 20;
  }
  EXPECT_GT(mean, 120) << "noise in the estimated correlation lowers it, which is conservative";
  EXPECT_LE(mean, 200);
}

// Twenty-five cells of twelve that share their error are about twenty-five independent measurements, not three hundred.
TEST(EffectiveSampleSize, MeasurementsThatShareAnErrorCountAsOne) {
  Random random(2);
  double mean = 0;
  for (int trial = 0; trial < 20; ++trial) {
    std::vector<Vector2d> places, residuals;
    for (int cell = 0; cell < 25; ++cell) {
      const Vector2d error(random.normal(), random.normal());
      for (int i = 0; i < 12; ++i) {
        places.emplace_back(20 * (cell % 5) + random.uniform(0, 5), 20 * (cell / 5) + random.uniform(0, 5));
        residuals.push_back(error);
      }
    }
    mean += effective_sample_size(places, residuals) / 20;
  }
  EXPECT_GT(mean, 12);
  EXPECT_LT(mean, 40);
}

TEST(EffectiveSampleSize, OneCommonErrorIsOneMeasurement) {
  Random random(3);
  const auto places = scattered(random, 500);  // more than are looked at
  EXPECT_LT(effective_sample_size(places, std::vector<Vector2d>(500, Vector2d(1, 0.5))), 3);
}

TEST(EffectiveSampleSize, DoesNotDependOnUnits) {
  Random random(4);
  auto places = scattered(random, 100);
  std::vector<Vector2d> residuals;
  for (const Vector2d& place : places) residuals.emplace_back(std::sin(place.x() / 9), random.normal());
  const double count = effective_sample_size(places, residuals);
  for (Vector2d& place : places) place *= 0.001;
  for (Vector2d& residual : residuals) residual *= 1000;
  EXPECT_NEAR(effective_sample_size(places, residuals), count, 1e-6 * count);
}

TEST(EffectiveSampleSize, FewOrExactOrCoincident) {
  EXPECT_EQ(effective_sample_size({}, {}), 0);
  EXPECT_EQ(effective_sample_size({{1, 1}}, {{3, 3}}), 1);
  EXPECT_EQ(effective_sample_size({{1, 1}, {2, 2}}, {{0, 0}, {0, 0}}), 2)
      << "without residuals there is nothing shared";
  EXPECT_EQ(effective_sample_size({{1, 1}, {1, 1}, {1, 1}}, {{1, 0}, {0, 1}, {1, 1}}), 1);
}

}  // namespace
}  // namespace nadir
