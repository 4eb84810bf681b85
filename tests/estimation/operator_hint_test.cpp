#include "estimation/search_window.hpp"

#include <gtest/gtest.h>

namespace nadir {
namespace {

const PlaneBox kArea{-1000, -500, 1000, 500};

void expect_box(const std::optional<PlaneBox>& box, double west, double south, double east, double north) {
  ASSERT_TRUE(box);
  EXPECT_DOUBLE_EQ(box->west_m, west);
  EXPECT_DOUBLE_EQ(box->south_m, south);
  EXPECT_DOUBLE_EQ(box->east_m, east);
  EXPECT_DOUBLE_EQ(box->north_m, north);
}

TEST(OperatorHint, IsLookedAtWithinItsRadius) {
  const OperatorHint hint({200, 100}, 150);
  EXPECT_FALSE(hint.propagating());
  expect_box(hint.box({0, 0}, 900, std::nullopt), 50, -50, 350, 250);
}

TEST(OperatorHint, IsNeverSoNarrowThatNothingCompetes) {
  expect_box(OperatorHint({200, 100}, 0.5).box({0, 0}, 900, std::nullopt), 100, 0, 300, 200);
}

// 3-4-5: the variance grew by 30 squared; three sigma are 90 m.
TEST(OperatorHint, IsCarriedByOdometryAndGrowsVague) {
  OperatorHint hint({200, 100}, 150);
  hint.start_propagation({-700, 40}, 40);
  EXPECT_TRUE(hint.propagating());
  expect_box(hint.box({-700, 40}, 40, std::nullopt), 50, -50, 350, 250);
  expect_box(hint.box({-690, 20}, 50, std::nullopt), 60 - 90, -70 - 90, 360 + 90, 230 + 90);
  expect_box(hint.box({-700, 40}, 10, std::nullopt), 50, -50, 350, 250);
}

TEST(OperatorHint, EndsWhereTheAreaEnds) {
  expect_box(OperatorHint({900, 450}, 200).box({0, 0}, 9, kArea), 700, 250, 1000, 500);
  EXPECT_FALSE(OperatorHint({1300, 0}, 200).box({0, 0}, 9, kArea));
  EXPECT_FALSE(OperatorHint({0, -1e7}, 200).box({0, 0}, 9, kArea));
}

}  // namespace
}  // namespace nadir
