// The figures are typed in from the design: alert limit 100 m, time to alert 3 s, told after half of it.
#include "service/position_usability.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <optional>
#include <vector>

#include "base/random.hpp"

namespace nadir {
namespace {

using Change = PositionUsability::Change;

class Usability : public ::testing::Test {
 protected:
  // The same level for so long, at twenty updates a second; what changed and when.
  void hold(double seconds, std::optional<double> hpl_m) {
    const int steps = static_cast<int>(std::lround(seconds * 20));
    for (int i = 0; i < steps; ++i) {
      now_s_ += 0.05;
      const Change change = monitor_.update(now_s_, hpl_m);
      if (change == Change::lost) lost_s_.push_back(now_s_);
      if (change == Change::regained) regained_s_.push_back(now_s_);
    }
  }

  PositionUsability monitor_{100, 3};
  double now_s_ = 1000;
  std::vector<double> lost_s_, regained_s_;
};

TEST_F(Usability, APositionWithinTheLimitIsUsableAtOnce) {
  EXPECT_FALSE(monitor_.usable());
  hold(0.05, 100);
  EXPECT_TRUE(monitor_.usable());
  hold(60, 20);
  EXPECT_TRUE(lost_s_.empty());
  EXPECT_TRUE(regained_s_.empty()) << "nothing had been lost";
}

TEST_F(Usability, TheOperatorIsToldWithinTheTimeToAlert) {
  hold(10, 20);
  const double left_s = now_s_;
  hold(0.05, 100.1);
  EXPECT_FALSE(monitor_.usable()) << "at once, whatever the operator knows";
  hold(60, 100.1);
  ASSERT_EQ(lost_s_.size(), 1U) << "once";
  EXPECT_GE(lost_s_[0] - left_s, 1.4);
  EXPECT_LE(lost_s_[0] - left_s, 1.7);
}

TEST_F(Usability, NoLevelIsBeyondEveryLimit) {
  for (const std::optional<double> none :
       {std::optional<double>(), std::optional(std::nan("")), std::optional(std::numeric_limits<double>::infinity()),
        std::optional(-1.0)}) {
    PositionUsability monitor(100, 3);
    monitor.update(0, 20);
    EXPECT_EQ(monitor.update(1, none), Change::none);
    EXPECT_FALSE(monitor.usable());
    EXPECT_EQ(monitor.update(2.6, none), Change::lost);
  }
}

TEST_F(Usability, AShortExcursionIsNoAlert) {
  hold(10, 20);
  hold(1.3, 300);
  EXPECT_FALSE(monitor_.usable());
  hold(10, 20);
  EXPECT_TRUE(monitor_.usable());
  EXPECT_TRUE(lost_s_.empty());
}

TEST_F(Usability, ItIsUsableAgainOnlyAfterItHeldForTheTimeToAlert) {
  hold(5, 20);
  hold(5, {});
  ASSERT_EQ(lost_s_.size(), 1U);
  hold(2.9, 20);
  EXPECT_FALSE(monitor_.usable());
  hold(0.1, 300);  // from the beginning
  const double back_s = now_s_;
  hold(2.9, 20);
  EXPECT_FALSE(monitor_.usable());
  EXPECT_TRUE(regained_s_.empty());
  hold(0.3, 20);
  EXPECT_TRUE(monitor_.usable());
  ASSERT_EQ(regained_s_.size(), 1U);
  EXPECT_NEAR(regained_s_[0] - back_s, 3, 0.11);
  EXPECT_EQ(lost_s_.size(), 1U);
}

// Abuse: a level that flickers across the limit must neither hide the loss nor chatter.
TEST_F(Usability, ALevelThatFlickersIsOneAlert) {
  hold(10, 20);
  for (int i = 0; i < 200; ++i) {
    hold(1.0, 150);
    hold(0.5, 50);
  }
  EXPECT_EQ(lost_s_.size(), 1U);
  EXPECT_LE(lost_s_.empty() ? 1e9 : lost_s_[0] - 1010, 3);
  EXPECT_TRUE(regained_s_.empty());
  EXPECT_FALSE(monitor_.usable());
}

// Whatever the level does, two messages of one kind never come in a row, and a return takes the time to alert.
TEST_F(Usability, MessagesAlternateWhateverTheLevelDoes) {
  Random random(5);
  for (int i = 0; i < 5000; ++i) {
    std::optional<double> level_m = random.uniform(0, 200);
    if (random.chance(0.1)) level_m.reset();
    hold(0.05 * random.integer(1, 120), level_m);
    ASSERT_LE(regained_s_.size(), lost_s_.size());
    ASSERT_LE(lost_s_.size(), regained_s_.size() + 1);
    ASSERT_TRUE(!monitor_.usable() || lost_s_.size() == regained_s_.size());
  }
  ASSERT_GT(regained_s_.size(), 50U);
  for (std::size_t i = 0; i < regained_s_.size(); ++i) EXPECT_GE(regained_s_[i] - lost_s_[i], 2.99);
}

}  // namespace
}  // namespace nadir
