// What we send, as pymavlink reads it.
#include <gtest/gtest.h>

#include <cmath>

#include "geodesy/angles.hpp"
#include "mavlink/messages.hpp"
#include "mavlink/commands.hpp"
#include "mavlink/judge.hpp"

namespace nadir {
namespace {

constexpr MavlinkAddress kUs{1, 191};
constexpr MavlinkAddress kAutopilot{1, 1};

std::vector<nlohmann::json> read(const std::vector<OutgoingMessage>& messages) {
  std::vector<Bytes> frames;
  for (const OutgoingMessage& message : messages) {
    frames.push_back(encode(message, kUs, static_cast<std::uint8_t>(frames.size() + 7)));
  }
  return test::read_by_pymavlink(frames);
}

TEST(Encode, PymavlinkAcceptsEveryMessage) {
  const std::vector<OutgoingMessage> messages{
      OwnHeartbeat{SystemState::active},
      GpsInput{.fix = GpsFix::three_d},
      Timesync{.answered_ns = 5, .sent_ns = 9},
      StatusText{TextSeverity::warning, "Nadir: vision position in use", 0, 0},
      request_message(kAutopilot, StreamedMessage::autopilot_version),
      external_position_estimate(kAutopilot, {.place = {8.5, 47.25}, .sigma_m = 6, .sent_s = 1001}),
      CommandAck{512, CommandResult::denied, {255, 190}},
      ParameterRequest{kAutopilot, "GPS1_TYPE"},
      ParameterListRequest{kAutopilot},
      ParameterSet{kAutopilot, "EK3_SRC1_POSXY", 3, 2},
      SigningSetup{kAutopilot, {1, 2, 3}, 77}};
  const auto got = read(messages);
  const std::vector<std::string> names{"HEARTBEAT",          "GPS_INPUT",   "TIMESYNC",     "STATUSTEXT",
                                       "COMMAND_LONG",       "COMMAND_INT", "COMMAND_ACK",  "PARAM_REQUEST_READ",
                                       "PARAM_REQUEST_LIST", "PARAM_SET",   "SETUP_SIGNING"};
  ASSERT_EQ(got.size(), std::variant_size_v<OutgoingMessage>);  // a new kind needs a line here
  for (std::size_t i = 0; i < got.size(); ++i) {
    EXPECT_EQ(got[i].value("mavpackettype", "refused"), names[i]) << got[i];
    EXPECT_EQ(got[i]["system"], 1);
    EXPECT_EQ(got[i]["component"], 191);
    EXPECT_EQ(got[i]["sequence"], i + 7);
  }
  EXPECT_EQ(got[0]["type"], 18);  // an onboard controller
  EXPECT_EQ(got[0]["autopilot"], 8);
  EXPECT_EQ(got[2]["ts1"], 9);
  EXPECT_EQ(got[3]["text"], "Nadir: vision position in use");
  EXPECT_EQ(got[4]["command"], 512);
  EXPECT_EQ(got[4]["param1"], 148);
  EXPECT_EQ(got[5]["command"], 43003);
  EXPECT_EQ(got[5]["x"], 472500000);
  EXPECT_EQ(got[5]["y"], 85000000);
  EXPECT_EQ(got[5]["param1"], 1);  // 1001 s, wrapped at 250
  EXPECT_EQ(got[5]["param3"], 6);
  EXPECT_EQ(got[7]["param_id"], "GPS1_TYPE");
  EXPECT_EQ(got[7]["param_index"], -1);
  EXPECT_EQ(got[9]["param_value"], 3);
  EXPECT_EQ(got[10]["initial_timestamp"], 77);
  EXPECT_EQ(got[10]["secret_key"][2], 3);
}

TEST(Encode, GpsInputFieldByField) {
  const auto got = read({GpsInput{.unix_us = 1730291696123456,
                                  .gps_week = 2338,
                                  .gps_week_ms = 304914123,
                                  .gps_id = 1,
                                  .fix = GpsFix::three_d,
                                  .place = {-8.1234567, 47.7654321},
                                  .msl_m = 612.5,
                                  .hdop = 0.75,
                                  .vdop = 1.25,
                                  .velocity = GpsVelocity{20.5, -3.25, 0.5},
                                  .horizontal_accuracy_m = 4.5,
                                  .vertical_accuracy_m = 6.5,
                                  .speed_accuracy_mps = 0.5,
                                  .satellites = 10,
                                  .yaw_rad = radians(271.5)}})
                       .at(0);
  EXPECT_EQ(got["time_usec"], 1730291696123456);
  EXPECT_EQ(got["time_week"], 2338);
  EXPECT_EQ(got["time_week_ms"], 304914123);
  EXPECT_EQ(got["gps_id"], 1);
  EXPECT_EQ(got["ignore_flags"], 0);
  EXPECT_EQ(got["fix_type"], 3);
  EXPECT_EQ(got["lat"], 477654321);
  EXPECT_EQ(got["lon"], -81234567);
  EXPECT_EQ(got["alt"], 612.5);
  EXPECT_EQ(got["hdop"], 0.75);
  EXPECT_EQ(got["vdop"], 1.25);
  EXPECT_EQ(got["vn"], 20.5);
  EXPECT_EQ(got["ve"], -3.25);
  EXPECT_EQ(got["vd"], 0.5);
  EXPECT_EQ(got["horiz_accuracy"], 4.5);
  EXPECT_EQ(got["vert_accuracy"], 6.5);
  EXPECT_EQ(got["speed_accuracy"], 0.5);
  EXPECT_EQ(got["satellites_visible"], 10);
  EXPECT_EQ(got["yaw"], 27150);
}

TEST(Encode, WhatIsUnknownIsSaidToBeIgnored) {
  EXPECT_EQ(read({GpsInput{}}).at(0)["ignore_flags"], 255);
  EXPECT_EQ(read({GpsInput{.msl_m = 0.0, .velocity = GpsVelocity{0, 0, 0}}}).at(0)["ignore_flags"], 255 - 1 - 8 - 16);
  // ArduPilot's filter takes a vertical velocity that is not ignored for true, and a zero for level flight.
  EXPECT_EQ(read({GpsInput{.velocity = GpsVelocity{20, 1, {}}}}).at(0)["ignore_flags"], 255 - 8);
}

TEST(Encode, YawOfNorthIsNotYawUnknown) {
  std::vector<OutgoingMessage> messages;
  for (const double yaw_deg : {0.0, 360.0, -0.001, 0.004, 359.999, 0.01, -90.0, 180.0, -180.0}) {
    messages.emplace_back(GpsInput{.yaw_rad = radians(yaw_deg)});
  }
  messages.emplace_back(GpsInput{});
  messages.emplace_back(GpsInput{.yaw_rad = std::nan("")});
  const std::vector<int> expected{36000, 36000, 36000, 36000, 36000, 1, 27000, 18000, 18000, 0, 0};
  const auto got = read(messages);
  for (std::size_t i = 0; i < got.size(); ++i) EXPECT_EQ(got[i]["yaw"], expected[i]) << i;
}

TEST(Encode, LongTextsAreCutBetweenCharacters) {
  const std::string text(49, 'a');
  const auto got =
      read({StatusText{TextSeverity::info, text + "bcd", 0, 0}, StatusText{TextSeverity::info, text + "σ", 0, 0},
            ParameterRequest{kAutopilot, "SEVENTEEN_LETTERS"}});
  EXPECT_EQ(got[0]["text"], text + "b");
  EXPECT_EQ(got[1]["text"], text);
  EXPECT_EQ(got[2]["param_id"], "SEVENTEEN_LETTER");
}

TEST(Encode, NumbersOutOfRangeStayInTheirFields) {
  const auto got = read({GpsInput{.place = {400, -1e9}, .satellites = 1000}, GpsInput{.place = {std::nan(""), 0}}});
  EXPECT_EQ(got[0]["lat"], -2147483648);
  EXPECT_EQ(got[0]["lon"], 2147483647);
  EXPECT_EQ(got[0]["satellites_visible"], 255);
  EXPECT_EQ(got[1]["lon"], 0);
}

TEST(Commands, OperatorsHint) {
  CommandInt command = external_position_estimate(kUs, {.place = {8.5, 47.25}, .sigma_m = 300});
  ASSERT_TRUE(position_hint(command));
  EXPECT_EQ(position_hint(command)->place, (LonLat{8.5, 47.25}));
  EXPECT_EQ(position_hint(command)->radius_m, 300);
  command.parameters[2] = std::nanf("");
  EXPECT_FALSE(position_hint(command));
  command.parameters[2] = 300;
  command.place.lat_deg = 91;
  EXPECT_FALSE(position_hint(command));
  command.place.lat_deg = 0;
  command.command = 512;
  EXPECT_FALSE(position_hint(command));
}

TEST(Commands, StreamsAreAskedForByMessage) {
  const CommandLong command = set_message_interval(kAutopilot, StreamedMessage::attitude, 25);
  EXPECT_EQ(command.command, 511);
  EXPECT_EQ(command.parameters[0], 30);
  EXPECT_EQ(command.parameters[1], 40000);
}

}  // namespace
}  // namespace nadir
