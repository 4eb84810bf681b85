#include "flight/gps_fusion_switch.hpp"

#include <gtest/gtest.h>

namespace nadir {
namespace {

constexpr MavlinkAddress kAutopilot{1, 1};
constexpr std::uint8_t kInt32 = 6;

ParameterValue control(double value) {
  return {
      .name = "EKF2_GPS_CTRL", .wire_value = wire_value(value, kInt32, ParameterEncoding::bytewise), .type = kInt32};
}

std::optional<double> set_to(const std::optional<OutgoingMessage>& message) {
  if (!message || !std::holds_alternative<ParameterSet>(*message)) return std::nullopt;
  const auto& set = std::get<ParameterSet>(*message);
  EXPECT_EQ(set.name, "EKF2_GPS_CTRL");
  return value_of({.wire_value = set.wire_value, .type = set.type}, ParameterEncoding::bytewise);
}

TEST(GpsFusionSwitch, TakesGpsOutAndGivesItBack) {
  GpsFusionSwitch gps({{"EKF2_GPS_CTRL", 7}}, kAutopilot);
  EXPECT_TRUE(std::holds_alternative<ParameterRequest>(*gps.turn(0, GpsVerdict::trusted)));
  EXPECT_FALSE(gps.on_message(control(7)));
  EXPECT_FALSE(gps.turn(1, GpsVerdict::trusted));
  EXPECT_EQ(set_to(gps.turn(2, GpsVerdict::spoofed)), 0);
  EXPECT_FALSE(gps.turn(2.1, GpsVerdict::spoofed)) << "not in every turn";
  EXPECT_EQ(set_to(gps.turn(2.6, GpsVerdict::spoofed)), 0) << "until it is confirmed";
  EXPECT_FALSE(gps.is_off());
  EXPECT_TRUE(gps.on_message(control(0)));
  EXPECT_TRUE(gps.is_off());
  EXPECT_FALSE(gps.on_message(control(0))) << "the operator is told once";
  EXPECT_FALSE(gps.turn(4, GpsVerdict::spoofed));
  EXPECT_FALSE(gps.turn(5, GpsVerdict::unknown)) << "only a trusted one comes back";
  EXPECT_EQ(set_to(gps.turn(6, GpsVerdict::trusted)), 7);
  EXPECT_TRUE(gps.on_message(control(7)));
  EXPECT_FALSE(gps.is_off());
  EXPECT_EQ(set_to(gps.turn(8, GpsVerdict::denied)), 0);
}

TEST(GpsFusionSwitch, ItsOwnChangeIsKnownAsSuchUntilItIsTakenBack) {
  GpsFusionSwitch gps({{"EKF2_GPS_CTRL", 7}}, kAutopilot);
  gps.on_message(control(7));
  EXPECT_FALSE(gps.is_ours(control(0))) << "before it changes anything";
  gps.turn(1, GpsVerdict::spoofed);
  EXPECT_TRUE(gps.is_ours(control(0)));
  EXPECT_FALSE(gps.is_ours(control(3))) << "another value is somebody else's";
  gps.on_message(control(0));
  gps.turn(2, GpsVerdict::unknown);
  EXPECT_TRUE(gps.is_ours(control(0)));
  gps.turn(3, GpsVerdict::trusted);
  EXPECT_TRUE(gps.is_ours(control(0))) << "PX4 has not confirmed it yet";
  gps.on_message(control(7));
  EXPECT_FALSE(gps.is_ours(control(0)));
  ParameterValue other = control(0);
  other.name = "EKF2_HGT_REF";
  gps.turn(4, GpsVerdict::denied);
  EXPECT_FALSE(gps.is_ours(other));
}

TEST(GpsFusionSwitch, AfterARestartInFlightTheAirframeFileSaysWhatIsUsual) {
  GpsFusionSwitch gps({{"EKF2_GPS_CTRL", 5}}, kAutopilot);
  EXPECT_TRUE(gps.on_message(control(0)));
  EXPECT_EQ(set_to(gps.turn(1, GpsVerdict::trusted)), 5);
}

TEST(GpsFusionSwitch, WhatTheOperatorSwitchedOffStaysOff) {
  GpsFusionSwitch gps({}, kAutopilot);
  EXPECT_FALSE(gps.on_message(control(0)));
  for (const GpsVerdict verdict : {GpsVerdict::trusted, GpsVerdict::spoofed, GpsVerdict::trusted}) {
    EXPECT_FALSE(gps.turn(10, verdict));
  }
}

}  // namespace
}  // namespace nadir
