// What pymavlink sends, in our units.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>

#include "geodesy/angles.hpp"
#include "mavlink/messages.hpp"
#include "mavlink/judge.hpp"

namespace nadir {
namespace {

std::optional<IncomingMessage> decoded(const std::string& json, int version = 2) {
  FrameReader reader;
  reader.add(test::frames_by_pymavlink(json, "--version " + std::to_string(version)).at(0));
  const auto frame = reader.next();
  return frame ? decode(*frame) : std::nullopt;
}

template <class Wanted>
Wanted as(const std::string& json, int version = 2) {
  const auto message = decoded(json, version);
  if (!message || !std::holds_alternative<Wanted>(*message)) {
    ADD_FAILURE() << "not what was expected: " << json;
    return {};
  }
  return std::get<Wanted>(*message);
}

TEST(Decode, Heartbeat) {
  const auto m = as<Heartbeat>(
      R"({"message":"HEARTBEAT","type":1,"autopilot":3,"base_mode":217,"custom_mode":10,"system_status":4})");
  EXPECT_TRUE(m.is_autopilot);
  EXPECT_TRUE(m.is_ardupilot);
  EXPECT_TRUE(m.armed);
  EXPECT_EQ(m.vehicle_type, 1);
  EXPECT_EQ(m.custom_mode, 10U);
  EXPECT_EQ(m.state, SystemState::active);
  EXPECT_FALSE(as<Heartbeat>(R"({"message":"HEARTBEAT","type":6,"autopilot":8})").is_autopilot);
  EXPECT_EQ(as<Heartbeat>(R"({"message":"HEARTBEAT","system_status":200})").state, SystemState::emergency);
}

TEST(Decode, SystemTimeKnowsNoDateBeforeThereIsOne) {
  EXPECT_EQ(as<SystemTime>(R"({"message":"SYSTEM_TIME","time_unix_usec":1730291696123456})").unix_us, 1730291696123456);
  const auto early = as<SystemTime>(R"({"message":"SYSTEM_TIME","time_unix_usec":61000000,"time_boot_ms":61000})");
  EXPECT_FALSE(early.unix_us);
  EXPECT_EQ(early.boot_ms, 61000U);
}

TEST(Decode, Positions) {
  const auto m = as<GlobalPosition>(
      R"({"message":"GLOBAL_POSITION_INT","time_boot_ms":5,"lat":-353621474,"lon":1491651746,"alt":584070,)"
      R"("relative_alt":-120,"vx":-512,"vy":7,"vz":-3,"hdg":35999})");
  EXPECT_DOUBLE_EQ(m.place.lat_deg, -35.3621474);
  EXPECT_DOUBLE_EQ(m.place.lon_deg, 149.1651746);
  EXPECT_DOUBLE_EQ(m.msl_m, 584.07);
  EXPECT_DOUBLE_EQ(m.above_home_m, -0.12);
  EXPECT_EQ(m.velocity, (NedVelocity{-5.12, 0.07, -0.03}));
  EXPECT_NEAR(*m.heading_rad, radians(359.99), 1e-12);
  EXPECT_FALSE(as<GlobalPosition>(R"({"message":"GLOBAL_POSITION_INT","hdg":65535})").heading_rad);
}

TEST(Decode, GpsWithAllItsUnknowns) {
  const auto m = as<GpsRaw>(
      R"({"message":"GPS_RAW_INT","time_usec":77,"fix_type":3,"lat":10000000,"lon":-20000000,"alt":1500,"eph":121,)"
      R"("epv":200,"vel":2500,"cog":9000,"satellites_visible":10,"h_acc":900,"v_acc":1200,"vel_acc":300,"yaw":36000})");
  EXPECT_EQ(m.receiver, 1);
  EXPECT_EQ(m.fix, GpsFix::three_d);
  EXPECT_DOUBLE_EQ(*m.hdop, 1.21);
  EXPECT_DOUBLE_EQ(*m.ground_speed_mps, 25.0);
  EXPECT_NEAR(*m.course_rad, kPi / 2, 1e-12);
  EXPECT_EQ(m.satellites, 10);
  EXPECT_DOUBLE_EQ(*m.horizontal_accuracy_m, 0.9);
  EXPECT_DOUBLE_EQ(*m.speed_accuracy_mps, 0.3);
  EXPECT_NEAR(*m.yaw_rad, 2 * kPi, 1e-12);

  const auto blind = as<GpsRaw>(
      R"({"message":"GPS2_RAW","eph":65535,"epv":65535,"vel":65535,"cog":65535,"satellites_visible":255,"yaw":65535})");
  EXPECT_EQ(blind.receiver, 2);
  EXPECT_EQ(blind.fix, GpsFix::no_gps);
  EXPECT_FALSE(blind.hdop || blind.vdop || blind.ground_speed_mps || blind.course_rad || blind.satellites ||
               blind.yaw_rad || blind.horizontal_accuracy_m);
}

TEST(Decode, FirstVersion) {
  const auto m = as<GpsRaw>(R"({"message":"GPS_RAW_INT","fix_type":3,"satellites_visible":9})", 1);
  EXPECT_EQ(m.satellites, 9);
  EXPECT_FALSE(m.horizontal_accuracy_m);
}

TEST(Decode, ImuInStandardUnits) {
  const auto m = as<ImuSample>(R"({"message":"RAW_IMU","time_usec":9,"xacc":1000,"zacc":-1000,"xgyro":500,"id":1})");
  EXPECT_EQ(m.instance, 2);
  EXPECT_NEAR(m.acceleration_mps2.x, 9.80665, 1e-12);
  EXPECT_NEAR(m.acceleration_mps2.z, -9.80665, 1e-12);
  EXPECT_NEAR(m.rate_rad_s.x, 0.5, 1e-12);
  EXPECT_EQ(as<ImuSample>(R"({"message":"SCALED_IMU2","time_boot_ms":9})").time_us, 9000U);
  EXPECT_EQ(as<ImuSample>(R"({"message":"SCALED_IMU3"})").instance, 3);
}

TEST(Decode, FilterAndSystemStatus) {
  const auto m = as<EkfStatus>(R"({"message":"EKF_STATUS_REPORT","flags":33599,"pos_horiz_variance":1.5})");
  EXPECT_TRUE(m.attitude && m.horizontal_position_absolute && m.gps_glitching);
  EXPECT_FALSE(m.constant_position || m.uninitialized);
  EXPECT_DOUBLE_EQ(m.horizontal_position_variance, 1.5);
  const auto status = as<SystemStatus>(
      R"({"message":"SYS_STATUS","onboard_control_sensors_present":32,"onboard_control_sensors_enabled":32})");
  EXPECT_TRUE(status.gps_present && status.gps_enabled);
  EXPECT_FALSE(status.gps_healthy);
}

TEST(Decode, TextsEndAtZeroOrAtTheFieldsEnd) {
  const auto m = as<ParameterValue>(
      R"({"message":"PARAM_VALUE","param_id":"EK3_SRC1_POSXY_X","param_value":3,"param_index":65535})");
  EXPECT_EQ(m.name, "EK3_SRC1_POSXY_X");  // 16 bytes, no zero
  EXPECT_EQ(m.index, -1);
  EXPECT_EQ(as<StatusText>(R"({"message":"STATUSTEXT","severity":200,"text":"x"})").severity, TextSeverity::debug);
}

TEST(Decode, SimulatorsTruthPrefersWholeNumbers) {
  const auto m = as<SimState>(
      R"({"message":"SIM_STATE","lat":47.5,"lon":8.25,"lat_int":471234567,"lon_int":81234567,"alt":500,"ve":20})");
  EXPECT_DOUBLE_EQ(m.place.lat_deg, 47.1234567);
  EXPECT_DOUBLE_EQ(m.velocity.east_mps, 20);
  EXPECT_DOUBLE_EQ(as<SimState>(R"({"message":"SIM_STATE","lat":47.5,"lon":8.25})").place.lon_deg, 8.25);
}

TEST(Decode, CommandsAndAnswers) {
  const auto m = as<CommandLong>(
      R"({"message":"COMMAND_LONG","target_system":1,"target_component":191,"command":512,"param1":148,"param7":null})");
  EXPECT_EQ(m.target, (MavlinkAddress{1, 191}));
  EXPECT_EQ(m.command, 512);
  EXPECT_TRUE(std::isnan(m.parameters[6]));
  EXPECT_EQ(as<CommandAck>(R"({"message":"COMMAND_ACK","command":512,"result":2})").result, CommandResult::denied);
  EXPECT_EQ(as<CommandAck>(R"({"message":"COMMAND_ACK","command":512,"result":9})").result, CommandResult::failed);
}

TEST(Decode, NumbersThatAreNoneMakeAMessageMalformed) {
  for (const char* json :
       {R"({"message":"ATTITUDE","yaw":null})", R"({"message":"VFR_HUD","airspeed":null})",
        R"({"message":"EKF_STATUS_REPORT","velocity_variance":null})", R"({"message":"SIM_STATE","vn":null})",
        R"({"message":"WIND","speed":null})", R"({"message":"TERRAIN_REPORT","terrain_height":null})"}) {
    EXPECT_FALSE(decoded(json)) << json;
  }
}

TEST(Decode, WhatWeDoNotUseIsNamedByItsNumber) {
  EXPECT_EQ(as<OtherMessage>(R"({"message":"RC_CHANNELS","chancount":8})").id, 65U);
  EXPECT_EQ(as<OtherMessage>(R"({"message":"DISTANCE_SENSOR","orientation":0})").id, 132U);
  EXPECT_NEAR(
      as<GroundDistance>(R"({"message":"DISTANCE_SENSOR","orientation":25,"current_distance":1250})").distance_m, 12.5,
      1e-12);
}

}  // namespace
}  // namespace nadir
