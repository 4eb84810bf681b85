#include "base/normal_distribution.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <numbers>

namespace nadir {
namespace {

TEST(NormalDistribution, AgreesWithTheLibrarysErrorFunction) {
  for (double z = -37; z < 9; z += 0.0101) {
    const double expected = std::erfc(-z / std::numbers::sqrt2) / 2;
    EXPECT_NEAR(normal_share_below(z) / expected, 1, 1e-12) << z;
  }
}

TEST(NormalDistribution, NeverDecreases) {
  double before = 0;
  for (double z = -5; z < 5; z += 1e-3) {
    const double share = normal_share_below(z);
    EXPECT_GE(share, before) << z;
    before = share;
  }
}

TEST(NormalDistribution, SameBitsOnEveryProcessor) {
  EXPECT_EQ(normal_share_below(-37), 0x1.eaccc6bfeadb9p-995);
  EXPECT_EQ(normal_share_below(-6.1), 0x1.238f0c064f082p-31);
  EXPECT_EQ(normal_share_below(-2.3), 0x1.5f685ae930dbp-7);
  EXPECT_EQ(normal_share_below(-0.4), 0x1.60d91f7ac901ap-2);
  EXPECT_EQ(normal_share_below(1.7), 0x1.e92eb735d787p-1);
}

TEST(NormalDistribution, ItsEnds) {
  constexpr double kInfinity = std::numeric_limits<double>::infinity();
  EXPECT_EQ(normal_share_below(-kInfinity), 0);
  EXPECT_EQ(normal_share_below(kInfinity), 1);
  EXPECT_EQ(normal_share_below(0), 0.5);
  EXPECT_TRUE(std::isnan(normal_share_below(std::numeric_limits<double>::quiet_NaN())));
}

}  // namespace
}  // namespace nadir
