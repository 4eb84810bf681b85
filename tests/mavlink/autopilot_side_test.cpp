// What simulators send and hear: pymavlink reads the one, our own encoder writes the other.
#include "mavlink/autopilot_side.hpp"

#include <gtest/gtest.h>

#include <limits>

#include "mavlink/commands.hpp"
#include "mavlink/judge.hpp"

namespace nadir {
namespace {

constexpr MavlinkAddress kFrom{3, 1};

Bytes encoded(AutopilotType type, const IncomingMessage& message) {
  const auto bytes = encode_from_autopilot(type, message, kFrom, 9);
  if (!bytes) {
    ADD_FAILURE() << "not encoded";
    return {};
  }
  return *bytes;
}

nlohmann::json by_pymavlink(AutopilotType type, const IncomingMessage& message) {
  return test::read_by_pymavlink({encoded(type, message)}).at(0);
}

MavlinkFrame frame_of(const Bytes& bytes) {
  FrameReader reader;
  reader.add(bytes);
  return reader.next().value();
}

template <class Message>
Message there_and_back(AutopilotType type, const Message& message) {
  return std::get<Message>(decode(frame_of(encoded(type, message))).value());
}

CompanionMessage heard(const OutgoingMessage& message) {
  return decode_from_companion(frame_of(encode(message, {3, 197}, 1)));
}

TEST(AutopilotSide, NamesItsAutopilot) {
  const Heartbeat beat{
      .vehicle_type = 1, .is_autopilot = true, .armed = true, .custom_mode = 10, .state = SystemState::active};
  const auto plane = by_pymavlink(AutopilotType::ardupilot, beat);
  EXPECT_EQ(plane["mavpackettype"], "HEARTBEAT");
  EXPECT_EQ(plane["autopilot"], 3);
  EXPECT_EQ(plane["system"], 3);
  EXPECT_EQ(plane["sequence"], 9);
  EXPECT_EQ(plane["base_mode"].get<int>() & 128, 128);
  EXPECT_EQ(by_pymavlink(AutopilotType::px4, beat)["autopilot"], 12);
  EXPECT_EQ(there_and_back(AutopilotType::px4, beat).autopilot, AutopilotType::px4);
}

TEST(AutopilotSide, AccelerationsAsEachAutopilotSendsThem) {
  const ImuSample sample{1, 5'000'000, {0.5, -1, -9.80665}, {0.01, 0.02, -0.03}};
  const auto raw = by_pymavlink(AutopilotType::ardupilot, sample);
  EXPECT_EQ(raw["mavpackettype"], "RAW_IMU");
  EXPECT_EQ(raw["zacc"], -1000);
  EXPECT_EQ(raw["zgyro"], -30);
  const auto fine = by_pymavlink(AutopilotType::px4, sample);
  EXPECT_EQ(fine["mavpackettype"], "HIGHRES_IMU");
  EXPECT_NEAR(fine["xacc"].get<double>(), 0.5, 1e-6);
  for (const AutopilotType type : {AutopilotType::ardupilot, AutopilotType::px4}) {
    const ImuSample back = there_and_back(type, sample);
    EXPECT_EQ(back.instance, 1);
    EXPECT_NEAR(back.acceleration_mps2.y, -1, 0.006);
    EXPECT_NEAR(back.rate_rad_s.z, -0.03, 0.001);
  }
}

TEST(AutopilotSide, PositionsAndReceivers) {
  const GlobalPosition here{.boot_ms = 7,
                            .place = {149.1651746, -35.3621474},
                            .msl_m = 584.07,
                            .above_home_m = -0.12,
                            .velocity = {-5.12, 0.07, -0.03},
                            .heading_rad = -0.5};
  const GlobalPosition back = there_and_back(AutopilotType::ardupilot, here);
  EXPECT_EQ(back.place, here.place);
  EXPECT_DOUBLE_EQ(back.msl_m, here.msl_m);
  EXPECT_EQ(back.velocity, here.velocity);
  EXPECT_NEAR(*back.heading_rad, 2 * 3.14159265358979 - 0.5, 2e-4);

  GpsRaw gps{.receiver = 2, .time_us = 9, .fix = GpsFix::three_d, .place = {1, 2}, .msl_m = 3};
  EXPECT_EQ(by_pymavlink(AutopilotType::ardupilot, gps)["mavpackettype"], "GPS2_RAW");
  gps.receiver = 1;
  gps.ground_speed_mps = 22.25;
  gps.horizontal_accuracy_m = 1.2;
  gps.satellites = 14;
  const GpsRaw read = there_and_back(AutopilotType::px4, gps);
  EXPECT_EQ(read.receiver, 1);
  EXPECT_EQ(read.place, gps.place);
  EXPECT_EQ(read.ground_speed_mps, 22.25);
  EXPECT_DOUBLE_EQ(*read.horizontal_accuracy_m, 1.2);
  EXPECT_EQ(read.satellites, 14);
  EXPECT_FALSE(read.hdop);
  EXPECT_FALSE(read.course_rad);
  EXPECT_FALSE(read.vertical_accuracy_m);
}

TEST(AutopilotSide, TheRestComesBackAsItWasSent) {
  const auto type = AutopilotType::px4;
  EXPECT_EQ(there_and_back(type, SystemTime{1'750'000'000'000'000, 12}).unix_us, 1'750'000'000'000'000);
  EXPECT_NEAR(there_and_back(type, AircraftAttitude{1, 0.1, -0.2, 3, {}}).pitch_rad, -0.2, 1e-7);
  const EkfStatus ekf =
      there_and_back(type, EkfStatus{.attitude = true, .gps_glitching = true, .compass_variance = 0.5});
  EXPECT_TRUE(ekf.attitude && ekf.gps_glitching);
  EXPECT_FALSE(ekf.horizontal_position_absolute);
  EXPECT_EQ(ekf.compass_variance, 0.5);
  EXPECT_TRUE(there_and_back(type, EstimatorStatus{.horizontal_position_absolute = true}).horizontal_position_absolute);
  const ParameterValue value = there_and_back(type, ParameterValue{"EKF2_GPS_CTRL", 7, 6, 1, 0});
  EXPECT_EQ(value.name, "EKF2_GPS_CTRL");
  EXPECT_EQ(value.type, 6);
  EXPECT_EQ(there_and_back(type, AutopilotVersion{.flight_software = kPx4GlobalPosition}).flight_software,
            kPx4GlobalPosition);
  const SimState truth = there_and_back(type, SimState{.yaw_rad = 3, .place = {14.5, 48.5}, .msl_m = 555});
  EXPECT_EQ(truth.place, (LonLat{14.5, 48.5}));
  EXPECT_EQ(truth.msl_m, 555);
  EXPECT_FALSE(encode_from_autopilot(type, OtherMessage{}, kFrom, 0));
  EXPECT_FALSE(encode_from_autopilot(type, StatusText{}, kFrom, 0)) << "not sent by simulators";
}

TEST(AutopilotSide, HearsGivenPositions) {
  const GpsInput sent{.unix_us = 1'750'000'000'000'000,
                      .gps_id = 1,
                      .fix = GpsFix::three_d,
                      .place = {8.5, 47.4},
                      .velocity = GpsVelocity{3, -4, std::nullopt},
                      .horizontal_accuracy_m = 2.5};
  const auto input = std::get<GpsInput>(heard(sent));
  EXPECT_EQ(input.unix_us, sent.unix_us);
  EXPECT_EQ(input.gps_id, 1);
  EXPECT_EQ(input.place, sent.place);
  EXPECT_EQ(input.velocity, sent.velocity);
  EXPECT_EQ(input.horizontal_accuracy_m, 2.5);
  EXPECT_FALSE(input.msl_m);
  EXPECT_FALSE(input.yaw_rad);
  const auto position = std::get<GlobalPositionSensor>(
      heard(GlobalPositionSensor{.sensor_id = 2, .place = {8.5, 47.4}, .sigma_m = 4, .msl_m = 600}));
  EXPECT_EQ(position.sensor_id, 2);
  EXPECT_EQ(position.sigma_m, 4);
  EXPECT_EQ(position.msl_m, 600);
  EXPECT_FALSE(position.vertical_sigma_m);
}

TEST(AutopilotSide, IgnoresWhatIsNoNumber) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  EXPECT_TRUE(std::holds_alternative<std::monostate>(heard(GpsInput{.msl_m = nan})));
  EXPECT_TRUE(std::holds_alternative<std::monostate>(heard(GlobalPositionSensor{.sigma_m = nan})));
  EXPECT_TRUE(std::holds_alternative<std::monostate>(heard(StatusText{})));
}

TEST(AutopilotSide, HearsCommandsAndParameters) {
  const auto ask = [](const CommandLong& command) { return stream_request(std::get<CommandLong>(heard(command))); };
  const auto rate = ask(set_message_interval({1, 1}, StreamedMessage::attitude, 25));
  ASSERT_TRUE(rate && rate->period_s);
  EXPECT_EQ(rate->message_id, message_id(StreamedMessage::attitude));
  EXPECT_NEAR(*rate->period_s, 0.04, 1e-6);
  const auto once = ask(request_message({1, 1}, StreamedMessage::autopilot_version));
  ASSERT_TRUE(once);
  EXPECT_FALSE(once->period_s);
  EXPECT_FALSE(ask(restart_command({1, 1})));
  EXPECT_EQ(std::get<ParameterRequest>(heard(ParameterRequest{{1, 1}, "EKF2_GPS_CTRL"})).name, "EKF2_GPS_CTRL");
  const auto set = std::get<ParameterSet>(heard(ParameterSet{{1, 1}, "SIXTEEN_LETTERS_", 2.5F, 9}));
  EXPECT_EQ(set.name, "SIXTEEN_LETTERS_");
  EXPECT_EQ(set.wire_value, 2.5F);
}

}  // namespace
}  // namespace nadir
