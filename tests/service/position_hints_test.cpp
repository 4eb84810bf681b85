#include "service/position_hints.hpp"

#include <gtest/gtest.h>

#include <vector>

namespace nadir {
namespace {

// The figures are those of docs/onboard.md: three at once, one every 2 s.
TEST(HintAllowance, ThreeAtOnceThenOneEveryTwoSeconds) {
  HintAllowance allowance;
  int taken = 0;
  for (int i = 0; i < 10; ++i) taken += allowance.take(100) ? 1 : 0;
  EXPECT_EQ(taken, 3);
  EXPECT_FALSE(allowance.take(101.9));
  EXPECT_TRUE(allowance.take(102.1));
  EXPECT_FALSE(allowance.take(102.1));
  EXPECT_TRUE(allowance.take(1000));
}

TEST(HintRequest, AsksAfter15SecondsWithoutAPositionAndEveryMinuteThen) {
  HintRequest request;
  std::vector<double> asked_s;
  for (int i = 0; i <= 1500; ++i) {
    if (request.due(i * 0.1, true, false)) asked_s.push_back(i * 0.1);
  }
  ASSERT_EQ(asked_s.size(), 3U);
  EXPECT_NEAR(asked_s[0], 15, 0.15);
  EXPECT_NEAR(asked_s[1], 75, 0.25);
  EXPECT_NEAR(asked_s[2], 135, 0.35);
}

TEST(HintRequest, NeverWithAPositionOrOnTheGround) {
  HintRequest request;
  for (int i = 0; i <= 100; ++i) {
    EXPECT_FALSE(request.due(i, true, true));
    EXPECT_FALSE(request.due(i, false, false));
  }
}

TEST(HintRequest, APositionInBetweenBeginsAnew) {
  HintRequest request;
  EXPECT_FALSE(request.due(0, true, false));
  EXPECT_FALSE(request.due(14, true, false));
  EXPECT_FALSE(request.due(14.5, true, true));
  EXPECT_FALSE(request.due(16, true, false));
  EXPECT_FALSE(request.due(30, true, false));
  EXPECT_TRUE(request.due(31.1, true, false));
}

}  // namespace
}  // namespace nadir
