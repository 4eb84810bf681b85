#include "flight/arrival_time.hpp"

#include <gtest/gtest.h>

#include <cmath>

namespace nadir {
namespace {

std::uint64_t us(double seconds) { return static_cast<std::uint64_t>(std::llround(seconds * 1e6)); }

constexpr double kAhead_s = 740;  // the autopilot's clock, of ours

// Sent every 20 ms, delayed by 3 ms, and read at once.
double flown_until(ArrivalTime& clock, double until_s, double rate = 1) {
  double sent_s = 0;
  for (; sent_s < until_s; sent_s += 0.02)
    EXPECT_NEAR(clock.arrived_s(sent_s - 0.015, sent_s + 0.003, us(kAhead_s + rate * sent_s)), sent_s + 0.003, 0.0181);
  return sent_s;
}

TEST(ArrivalTime, WhatWaitedForUsCameWhenItsStampSays) {
  ArrivalTime clock;
  const double held_from_s = flown_until(clock, 12), read_s = held_from_s + 1.5;
  for (double sent_s = held_from_s; sent_s < read_s - 0.004; sent_s += 0.02)
    EXPECT_NEAR(clock.arrived_s(held_from_s - 0.01, read_s, us(kAhead_s + sent_s)), sent_s + 0.003, 1e-5) << sent_s;
}

TEST(ArrivalTime, AfterAPauseLongerThanItRemembersToo) {
  ArrivalTime clock;
  const double held_from_s = flown_until(clock, 12), read_s = held_from_s + 20;
  for (double sent_s = held_from_s; sent_s < read_s - 0.004; sent_s += 0.02)
    EXPECT_NEAR(clock.arrived_s(held_from_s - 0.01, read_s, us(kAhead_s + sent_s)), sent_s + 0.003, 1e-5) << sent_s;
}

// A link that is late, a simulator that falls behind, messages that a radio keeps together: nobody knows how late they
// are.
TEST(ArrivalTime, WhatCameSinceTheLastLookCameSince) {
  ArrivalTime clock;
  flown_until(clock, 30, 0.8);
  ArrivalTime radio;
  flown_until(radio, 12);
  for (int i = 0; i < 25; ++i)
    EXPECT_GE(radio.arrived_s(12.49, 12.5, us(kAhead_s + 12 + 0.02 * i)), 12.49)
        << "half a second late, as it always was";
}

TEST(ArrivalTime, OneThatBeginsAnewHasAnotherClock) {
  ArrivalTime clock;
  flown_until(clock, 12);
  EXPECT_DOUBLE_EQ(clock.arrived_s(12.5, 14, us(1)), 14) << "restarted: the first message has no other";
  EXPECT_NEAR(clock.arrived_s(14, 15, us(1.4)), 14.4, 1e-9);
  EXPECT_NEAR(clock.arrived_s(15, 15.1, us(1e6)), 15.1, 1e-6) << "its clock was set";
  EXPECT_DOUBLE_EQ(clock.arrived_s(15.1, 15.2, us(2)), 15.2) << "and set back";
  EXPECT_DOUBLE_EQ(clock.arrived_s(16, 80, us(10)), 80) << "it stood still for a minute";
  EXPECT_NEAR(clock.arrived_s(80, 80.5, us(10.3)), 80.3, 1e-9);
}

TEST(ArrivalTime, StampsOfTheMessages) {
  EXPECT_EQ(stamp_us(AircraftAttitude{.boot_ms = 4'000'000'000}), 4'000'000'000'000U);
  EXPECT_EQ(stamp_us(GlobalPosition{.boot_ms = 7}), 7000U);
  EXPECT_EQ(stamp_us(GroundDistance{.boot_ms = 7}), 7000U);
  EXPECT_EQ(stamp_us(GimbalAttitude{.boot_ms = 7}), 7000U);
  EXPECT_EQ(stamp_us(ImuSample{.time_us = 7}), 7U);
  EXPECT_EQ(stamp_us(ImuSample{}), std::nullopt);
  EXPECT_EQ(stamp_us(GroundHeight{}), std::nullopt);
}

}  // namespace
}  // namespace nadir
