#include "base/quantile.hpp"

#include <gtest/gtest.h>

#include <limits>

namespace nadir {
namespace {

using Values = std::vector<double>;

TEST(Quantile, IsTheNearestRank) {
  EXPECT_EQ(quantile(Values{5, 1, 3, 2, 4}, 0.5), 3);
  EXPECT_EQ(quantile(Values{1, 2, 3, 4}, 0.5), 2) << "half of them are not larger";
  EXPECT_EQ(quantile(Values{1, 2, 3, 4}, 0.51), 3);
  EXPECT_EQ(quantile(Values{1, 2, 3, 4}, 1), 4);
  EXPECT_EQ(quantile(Values{1, 2, 3, 4}, 0), 1);
  EXPECT_EQ(quantile(Values{7}, 0.95), 7);
  EXPECT_EQ(quantile(Values{}, 0.5), 0);
  constexpr double kInfinite = std::numeric_limits<double>::infinity();
  EXPECT_EQ(quantile(Values{kInfinite, 1, kInfinite}, 0.9), kInfinite);
}

TEST(Quantile, TheMedianOfAnEvenNumberIsTheUpperOfTheTwo) {
  EXPECT_EQ(median(Values{5, 1, 3}), 3);
  EXPECT_EQ(median(std::vector<float>{4, 1, 3, 2}), 3.0F);
  EXPECT_EQ(median(Values{}), 0);
}

TEST(Quantile, LeavesTheValuesAsTheyAre) {
  const Values values{3, 1, 2};
  EXPECT_EQ(median(values), 2);
  EXPECT_EQ(quantile(values, 1), 3);
  EXPECT_EQ(values, (Values{3, 1, 2}));
}

}  // namespace
}  // namespace nadir
