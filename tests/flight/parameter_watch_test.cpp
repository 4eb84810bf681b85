#include "flight/parameter_watch.hpp"

#include <gtest/gtest.h>

#include <set>

namespace nadir {
namespace {

constexpr MavlinkAddress kWatchedAutopilot{1, 1};
constexpr std::uint8_t kParamInt32 = 6, kReal32 = 9;
constexpr Heartbeat kDisarmed{.is_autopilot = true, .autopilot = AutopilotType::px4};

ParameterValue px4_int(const std::string& name, double value) {
  return {.name = name, .wire_value = wire_value(value, kParamInt32, ParameterEncoding::bytewise), .type = kParamInt32};
}

TEST(ParameterWatch, AsksForAllOfThemWhileDisarmed) {
  ParameterWatch watch({{"A", 1}, {"B", 2}, {"C", 3}, {"D", 4}}, kWatchedAutopilot);
  std::multiset<std::string> asked;
  for (int beat = 0; beat < 4; ++beat) {
    for (const OutgoingMessage& request : watch.on_heartbeat(kDisarmed)) {
      EXPECT_EQ(std::get<ParameterRequest>(request).target, kWatchedAutopilot);
      asked.insert(std::get<ParameterRequest>(request).name);
    }
  }
  for (const char* name : {"A", "B", "C", "D"}) EXPECT_EQ(asked.count(name), 3U) << "again and again";
  Heartbeat armed = kDisarmed;
  armed.armed = true;
  EXPECT_TRUE(watch.on_heartbeat(armed).empty());
}

TEST(ParameterWatch, WithNothingExpectedNothingIsAsked) {
  EXPECT_TRUE(ParameterWatch({}, kWatchedAutopilot).on_heartbeat(kDisarmed).empty());
}

TEST(ParameterWatch, ReportsEachDifferenceOnceAndItsEnd) {
  ParameterWatch watch({{"EKF2_AGP0_CTRL", 1}, {"EKF2_AGP0_GATE", 5.1}}, kWatchedAutopilot);
  static_cast<void>(watch.on_heartbeat(kDisarmed));
  EXPECT_FALSE(watch.on_message(px4_int("EKF2_AGP0_CTRL", 1)));
  EXPECT_FALSE(watch.on_message({.name = "EKF2_AGP0_GATE", .wire_value = 5.1F, .type = kReal32})) << "single precision";
  const auto changed = watch.on_message(px4_int("EKF2_AGP0_CTRL", 0));
  ASSERT_TRUE(changed);
  EXPECT_EQ(changed->name, "EKF2_AGP0_CTRL");
  EXPECT_EQ(changed->expected, 1);
  EXPECT_EQ(changed->found, 0);
  EXPECT_FALSE(watch.on_message(px4_int("EKF2_AGP0_CTRL", 0)));
  EXPECT_TRUE(watch.on_message(px4_int("EKF2_AGP0_CTRL", 2)));
  const auto restored = watch.on_message(px4_int("EKF2_AGP0_CTRL", 1));
  ASSERT_TRUE(restored);
  EXPECT_TRUE(restored->restored());
  EXPECT_FALSE(watch.on_message(px4_int("EKF2_AGP0_CTRL", 1)));
  EXPECT_FALSE(watch.on_message(px4_int("ANOTHER", 0)));
}

TEST(ParameterWatch, ArduPilotsIntegersAreNumbers) {
  ParameterWatch watch({{"GPS1_TYPE", 14}}, kWatchedAutopilot);
  static_cast<void>(watch.on_heartbeat({.is_autopilot = true, .autopilot = AutopilotType::ardupilot}));
  EXPECT_FALSE(watch.on_message({.name = "GPS1_TYPE", .wire_value = 14, .type = 2}));
  EXPECT_TRUE(watch.on_message({.name = "GPS1_TYPE", .wire_value = 1, .type = 2}));
}

}  // namespace
}  // namespace nadir
