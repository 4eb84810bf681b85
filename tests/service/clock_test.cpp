#include "service/clock.hpp"

#include <gtest/gtest.h>

#include <thread>

#include "support/manual_clock.hpp"

namespace nadir {
namespace {

TEST(SystemFlightClock, RunsForwardWithABootId) {
  const SystemFlightClock clock, again;
  EXPECT_EQ(clock.boot_id().size(), 36) << "a UUID";
  EXPECT_EQ(clock.boot_id(), again.boot_id());
  double last_s = clock.monotonic_s();
  for (int i = 0; i < 1000; ++i) {
    const double now_s = clock.monotonic_s();
    ASSERT_GE(now_s, last_s);
    last_s = now_s;
  }
  EXPECT_GT(clock.unix_us(), 1'700'000'000'000'000);
}

TEST(SystemFlightClock, WaitsUntilThenAndNotForThePast) {
  const SystemFlightClock clock;
  const double until_s = clock.monotonic_s() + 0.01;
  EXPECT_TRUE(clock.wait_until(until_s, {}));
  EXPECT_GE(clock.monotonic_s(), until_s);
  EXPECT_TRUE(clock.wait_until(until_s - 1000, {}));
}

TEST(SystemFlightClock, StopEndsTheWait) {
  const SystemFlightClock clock;
  bool reached = true;
  std::jthread waiting([&](std::stop_token stop) { reached = clock.wait_until(clock.monotonic_s() + 1e6, stop); });
  waiting.request_stop();
  waiting.join();
  EXPECT_FALSE(reached);
}

TEST(ManualClock, WaitersWakeAtTheirTime) {
  ManualClock clock(100);
  bool reached = false;
  std::jthread waiting([&](std::stop_token stop) { reached = clock.wait_until(105, stop); });
  clock.advance(3);
  clock.advance(2);
  waiting.join();
  EXPECT_TRUE(reached);
}

TEST(ManualClock, StepsOfUtcChangeTheLabelOnly) {
  ManualClock clock(100, 1'000'000);
  clock.step_utc(-3600);
  EXPECT_EQ(clock.monotonic_s(), 100);
  EXPECT_EQ(clock.unix_us(), 1'000'000 - 3'600'000'000);
  clock.advance(1);
  EXPECT_EQ(clock.unix_us(), 2'000'000 - 3'600'000'000);
}

TEST(Cadence, IsDueOnAGridAndOnceAfterAStall) {
  Cadence tenth(0.1, 50);
  int times = 0;
  for (int i = 0; i < 1000; ++i) times += tenth.due(50 + i * 0.01 + 0.001);
  EXPECT_EQ(times, 100);
  EXPECT_TRUE(tenth.due(75.03));
  EXPECT_FALSE(tenth.due(75.05));
  EXPECT_NEAR(tenth.next_s(), 75.1, 1e-9);
}

TEST(Cadence, IsNeverDueTwiceAtOneTime) {
  Cadence cadence(0.1, 0);
  for (int i = 0; i < 10000; ++i) {
    const double now_s = 0.1 * i;
    cadence.due(now_s);
    ASSERT_FALSE(cadence.due(now_s)) << i;
  }
}

}  // namespace
}  // namespace nadir
