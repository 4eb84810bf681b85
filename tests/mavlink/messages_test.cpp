// Messages, with pymavlink as the other end.
#include "mavlink/messages.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>

#include "geodesy/angles.hpp"
#include "mavlink/commands.hpp"
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
  EXPECT_EQ(m.autopilot, AutopilotType::ardupilot);
  EXPECT_TRUE(m.armed);
  EXPECT_EQ(m.vehicle_type, 1);
  EXPECT_EQ(m.custom_mode, 10U);
  EXPECT_EQ(m.state, SystemState::active);
  const auto station = as<Heartbeat>(R"({"message":"HEARTBEAT","type":6,"autopilot":8})");
  EXPECT_FALSE(station.is_autopilot);
  EXPECT_EQ(station.autopilot, AutopilotType::none);
  EXPECT_EQ(as<Heartbeat>(R"({"message":"HEARTBEAT","autopilot":12})").autopilot, AutopilotType::px4);
  const auto other = as<Heartbeat>(R"({"message":"HEARTBEAT","autopilot":18})");
  EXPECT_EQ(other.autopilot, AutopilotType::other);
  EXPECT_EQ(other.autopilot_number, 18);
  EXPECT_EQ(as<Heartbeat>(R"({"message":"HEARTBEAT","system_status":200})").state, SystemState::emergency);
}

TEST(Decode, SystemTimeWithoutDate) {
  EXPECT_EQ(as<SystemTime>(R"({"message":"SYSTEM_TIME","time_unix_usec":1730291696123456})").unix_us, 1730291696123456);
  const auto early = as<SystemTime>(R"({"message":"SYSTEM_TIME","time_unix_usec":61000000,"time_boot_ms":61000})");
  EXPECT_FALSE(early.unix_us);
  EXPECT_EQ(early.boot_ms, 61000U);
}

// The flags as ArduPilot, PX4 and gimbals of before the newer flags set them.
TEST(Decode, GimbalAttitude) {
  const auto status = [](int flags, const std::string& more = {}) {
    return R"({"message":"GIMBAL_DEVICE_ATTITUDE_STATUS","time_boot_ms":4000,"q":[0.70710678,0,-0.70710678,0],"flags":)" +
           std::to_string(flags) + more + "}";
  };
  const auto m = as<GimbalAttitude>(status(4 + 8 + 32, R"(,"gimbal_device_id":2)"));
  EXPECT_EQ(m.boot_ms, 4000U);
  EXPECT_EQ(m.device, 2);
  EXPECT_FALSE(m.from_north) << "YAW_IN_VEHICLE_FRAME";
  EXPECT_FALSE(m.faulty);
  EXPECT_NEAR(m.level_from_gimbal[0], std::sqrt(0.5), 1e-7);
  EXPECT_NEAR(m.level_from_gimbal[2], -std::sqrt(0.5), 1e-7);
  EXPECT_TRUE(as<GimbalAttitude>(status(4 + 8 + 64)).from_north) << "YAW_IN_EARTH_FRAME";
  EXPECT_FALSE(as<GimbalAttitude>(status(4 + 8 + 16 + 32)).from_north) << "locked, and yet from the heading";
  EXPECT_TRUE(as<GimbalAttitude>(status(4 + 8 + 16)).from_north) << "YAW_LOCK without the newer flags";
  EXPECT_FALSE(as<GimbalAttitude>(status(4 + 8)).from_north);
  EXPECT_FALSE(as<GimbalAttitude>(status(32, R"(,"failure_flags":1)")).faulty) << "at a limit";
  EXPECT_TRUE(as<GimbalAttitude>(status(32, R"(,"failure_flags":8)")).faulty) << "an encoder";
  EXPECT_FALSE(decoded(status(32 + 64))) << "of both frames at once";
  EXPECT_FALSE(decoded(R"({"message":"GIMBAL_DEVICE_ATTITUDE_STATUS","flags":32,"q":[0.5,0,0,0]})")) << "no rotation";
  EXPECT_FALSE(decoded(R"({"message":"GIMBAL_DEVICE_ATTITUDE_STATUS","flags":32,"q":[NaN,0,0,0]})"));
}

TEST(Decode, CamerasAndTheirStreams) {
  const auto camera = as<CameraInformation>(R"({"message":"CAMERA_INFORMATION","vendor_name":[69,120,0)" + [] {
    std::string zeros;
    for (int i = 0; i < 29; ++i) zeros += ",0";
    return zeros;
  }() + R"(],"flags":257,"focal_length":NaN,"sensor_size_h":NaN,"sensor_size_v":NaN})");
  EXPECT_EQ(camera.vendor, "Ex");
  EXPECT_TRUE(camera.has_video_stream);
  const auto stream = as<VideoStream>(
      R"({"message":"VIDEO_STREAM_INFORMATION","stream_id":2,"count":3,"type":0,"flags":1,"resolution_h":1280,)"
      R"("resolution_v":720,"framerate":NaN,"name":"nadir","uri":"rtsp://192.168.1.9:554/nadir"})");
  EXPECT_EQ(stream.kind, VideoStream::Kind::rtsp);
  EXPECT_EQ(stream.id, 2);
  EXPECT_EQ(stream.count, 3);
  EXPECT_EQ(stream.width, 1280);
  EXPECT_TRUE(stream.running);
  EXPECT_EQ(stream.name, "nadir");
  EXPECT_EQ(stream.uri, "rtsp://192.168.1.9:554/nadir");
  EXPECT_EQ(as<VideoStream>(R"({"message":"VIDEO_STREAM_INFORMATION","type":77})").kind, VideoStream::Kind::other);
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
  EXPECT_EQ(as<ImuSample>(R"({"message":"SCALED_IMU","time_boot_ms":9})").time_us, 9000U);
  EXPECT_EQ(as<ImuSample>(R"({"message":"SCALED_IMU"})").instance, 1);
}

TEST(Decode, FilterStatus) {
  const auto m = as<EkfStatus>(R"({"message":"EKF_STATUS_REPORT","flags":33599,"pos_horiz_variance":1.5})");
  EXPECT_TRUE(m.attitude && m.horizontal_position_absolute && m.gps_glitching);
  EXPECT_FALSE(m.constant_position || m.uninitialized);
  EXPECT_DOUBLE_EQ(m.horizontal_position_variance, 1.5);
}

TEST(Decode, TelemetryOfPx4) {
  const auto imu = as<ImuSample>(
      R"({"message":"HIGHRES_IMU","time_usec":7000,"xacc":0.5,"yacc":-0.25,"zacc":-9.75,"xgyro":0.125,"id":1})");
  EXPECT_EQ(imu.instance, 2);
  EXPECT_EQ(imu.time_us, 7000U);
  EXPECT_EQ(imu.acceleration_mps2, (Vector3{0.5, -0.25, -9.75}));
  EXPECT_EQ(imu.rate_rad_s.x, 0.125);
  EXPECT_FALSE(decoded(R"({"message":"HIGHRES_IMU","xacc":null})"));
  const auto filter = as<EstimatorStatus>(
      R"({"message":"ESTIMATOR_STATUS","flags":1041,"pos_horiz_ratio":0.25,"pos_horiz_accuracy":null})");
  EXPECT_TRUE(filter.horizontal_position_absolute && filter.gps_glitching);
  EXPECT_EQ(filter.horizontal_position_ratio, 0.25);
  EXPECT_TRUE(std::isnan(filter.horizontal_accuracy_m)) << "not an error: PX4 may not know it";
  const auto origin = as<LocalOrigin>(
      R"({"message":"GPS_GLOBAL_ORIGIN","latitude":472500000,"longitude":-85000000,"altitude":512300})");
  EXPECT_EQ(origin.place, (LonLat{-8.5, 47.25}));
  EXPECT_DOUBLE_EQ(origin.msl_m, 512.3);
}

TEST(Decode, TextsEndAtNulOrAtTheEndOfTheField) {
  const auto m = as<ParameterValue>(
      R"({"message":"PARAM_VALUE","param_id":"EK3_SRC1_POSXY_X","param_value":3,"param_index":65535})");
  EXPECT_EQ(m.name, "EK3_SRC1_POSXY_X");  // 16 bytes, no zero
  EXPECT_EQ(m.index, -1);
  EXPECT_EQ(as<StatusText>(R"({"message":"STATUSTEXT","severity":200,"text":"x"})").severity, TextSeverity::debug);
}

TEST(Decode, SimulatorTruthPrefersIntegers) {
  const auto m = as<SimState>(
      R"({"message":"SIM_STATE","lat":47.5,"lon":8.25,"lat_int":471234567,"lon_int":81234567,"alt":500,"ve":20})");
  EXPECT_DOUBLE_EQ(m.place.lat_deg, 47.1234567);
  EXPECT_DOUBLE_EQ(m.velocity.east_mps, 20);
  EXPECT_DOUBLE_EQ(as<SimState>(R"({"message":"SIM_STATE","lat":47.5,"lon":8.25})").place.lon_deg, 8.25);
}

TEST(Decode, Commands) {
  const auto m = as<CommandInt>(
      R"({"message":"COMMAND_INT","target_system":1,"target_component":191,"command":43003,"frame":0,"param1":148,)"
      R"("param4":null,"x":472500000,"y":-85000000,"z":3})");
  EXPECT_EQ(m.target, (MavlinkAddress{1, 191}));
  EXPECT_EQ(m.command, 43003);
  EXPECT_EQ(m.parameters[0], 148);
  EXPECT_TRUE(std::isnan(m.parameters[3]));
  EXPECT_EQ(m.place, (LonLat{-8.5, 47.25}));
  EXPECT_EQ(m.z, 3);
}

TEST(Decode, NonFiniteNumbersMakeAMessageMalformed) {
  for (const char* json :
       {R"({"message":"ATTITUDE","yaw":null})", R"({"message":"EKF_STATUS_REPORT","velocity_variance":null})",
        R"({"message":"SIM_STATE","vn":null})", R"({"message":"TERRAIN_REPORT","terrain_height":null})"}) {
    EXPECT_FALSE(decoded(json)) << json;
  }
}

TEST(Decode, UnusedMessagesAreIdentifiedByNumber) {
  EXPECT_EQ(as<OtherMessage>(R"({"message":"RC_CHANNELS","chancount":8})").id, 65U);
  EXPECT_EQ(as<OtherMessage>(R"({"message":"DISTANCE_SENSOR","orientation":0})").id, 132U);
  EXPECT_NEAR(
      as<GroundDistance>(R"({"message":"DISTANCE_SENSOR","orientation":25,"current_distance":1250})").distance_m, 12.5,
      1e-12);
}

constexpr MavlinkAddress kSender{1, 191};
constexpr MavlinkAddress kAutopilot{1, 1};

std::vector<nlohmann::json> read(const std::vector<OutgoingMessage>& messages) {
  std::vector<Bytes> frames;
  for (const OutgoingMessage& message : messages) {
    frames.push_back(encode(message, kSender, static_cast<std::uint8_t>(frames.size() + 7)));
  }
  return test::read_by_pymavlink(frames);
}

TEST(Encode, PymavlinkAcceptsEveryMessage) {
  const std::vector<OutgoingMessage> messages{
      OwnHeartbeat{SystemState::active},
      GpsInput{.fix = GpsFix::three_d},
      GlobalPositionSensor{},
      LocalPosition{},
      SetLocalOrigin{},
      NamedValue{5, "NDR_SIGMA", 2.5F},
      StatusText{TextSeverity::warning, "Nadir: vision position in use", 0, 0},
      request_message(kAutopilot, StreamedMessage::autopilot_version),
      external_position_estimate(kAutopilot, {.place = {8.5, 47.25}, .sigma_m = 6, .sent_s = 1001}),
      CommandAck{512, CommandResult::denied, {255, 190}},
      ParameterRequest{kAutopilot, "GPS1_TYPE"},
      ParameterSet{kAutopilot, "EK3_SRC1_POSXY", 3, 2},
      SigningSetup{kAutopilot, {1, 2, 3}, 77}};
  const auto got = read(messages);
  const std::vector<std::string> names{
      "HEARTBEAT",          "GPS_INPUT",  "GLOBAL_POSITION_SENSOR", "ODOMETRY",    "SET_GPS_GLOBAL_ORIGIN",
      "NAMED_VALUE_FLOAT",  "STATUSTEXT", "COMMAND_LONG",           "COMMAND_INT", "COMMAND_ACK",
      "PARAM_REQUEST_READ", "PARAM_SET",  "SETUP_SIGNING"};
  ASSERT_EQ(got.size(), std::variant_size_v<OutgoingMessage>);  // a new kind needs a line here
  for (std::size_t i = 0; i < got.size(); ++i) {
    EXPECT_EQ(got[i].value("mavpackettype", "refused"), names[i]) << got[i];
    EXPECT_EQ(got[i]["system"], 1);
    EXPECT_EQ(got[i]["component"], 191);
    EXPECT_EQ(got[i]["sequence"], i + 7);
  }
  EXPECT_EQ(got[0]["type"], 18);  // an onboard controller
  EXPECT_EQ(got[0]["autopilot"], 8);
  EXPECT_EQ(got[5]["name"], "NDR_SIGMA");
  EXPECT_EQ(got[5]["value"], 2.5);
  EXPECT_EQ(got[6]["text"], "Nadir: vision position in use");
  EXPECT_EQ(got[7]["command"], 512);
  EXPECT_EQ(got[7]["param1"], 148);
  EXPECT_EQ(got[8]["command"], 43003);
  EXPECT_EQ(got[8]["x"], 472500000);
  EXPECT_EQ(got[8]["y"], 85000000);
  EXPECT_EQ(got[8]["param1"], 1);  // 1001 s, wrapped at 250
  EXPECT_EQ(got[8]["param3"], 6);
  EXPECT_EQ(got[10]["param_id"], "GPS1_TYPE");
  EXPECT_EQ(got[10]["param_index"], -1);
  EXPECT_EQ(got[11]["param_value"], 3);
  EXPECT_EQ(got[12]["initial_timestamp"], 77);
  EXPECT_EQ(got[12]["secret_key"][2], 3);
}

TEST(Encode, GlobalPositionSensorFieldByField) {
  const auto got = read({GlobalPositionSensor{.target = kAutopilot,
                                              .sensor_id = 2,
                                              .unix_us = 1730291696123456,
                                              .processing_s = 0.25,
                                              .place = {-8.1234567, 47.7654321},
                                              .sigma_m = 3.5,
                                              .msl_m = 612.5,
                                              .vertical_sigma_m = 2.5},
                         GlobalPositionSensor{.place = {8, 47}, .sigma_m = 1}});
  EXPECT_EQ(got[0]["target_system"], 1);
  EXPECT_EQ(got[0]["target_component"], 1);
  EXPECT_EQ(got[0]["id"], 2);
  EXPECT_EQ(got[0]["time_usec"], 1730291696123456);
  EXPECT_EQ(got[0]["processing_time"], 250'000);
  EXPECT_EQ(got[0]["source"], 2);  // vision
  EXPECT_EQ(got[0]["flags"], 0);
  EXPECT_EQ(got[0]["lat"], 477654321);
  EXPECT_EQ(got[0]["lon"], -81234567);
  EXPECT_EQ(got[0]["eph"], 3.5);
  EXPECT_EQ(got[0]["epv"], 2.5);
  EXPECT_EQ(got[0]["alt"], 612.5);
  for (const char* unknown : {"alt", "alt_ellipsoid", "epv"}) EXPECT_EQ(got[1][unknown], "nan") << unknown;
}

TEST(Encode, OdometryHasAPositionAndNothingElse) {
  const auto got = read({LocalPosition{.unix_us = 1730291696123456,
                                       .north_m = 1500.5,
                                       .east_m = -20.25,
                                       .down_m = -300,
                                       .sigma_m = 3,
                                       .vertical_sigma_m = 5,
                                       .reset_counter = 7}})[0];
  EXPECT_EQ(got["frame_id"], 1);        // local NED
  EXPECT_EQ(got["estimator_type"], 2);  // vision
  EXPECT_EQ(got["reset_counter"], 7);
  EXPECT_EQ(got["x"], 1500.5);
  EXPECT_EQ(got["y"], -20.25);
  EXPECT_EQ(got["z"], -300);
  for (const char* unknown : {"vx", "vy", "vz", "rollspeed", "pitchspeed", "yawspeed"}) {
    EXPECT_EQ(got[unknown], "nan") << unknown;
  }
  for (const auto& q : got["q"]) EXPECT_EQ(q, "nan");
  for (const auto& element : got["velocity_covariance"]) EXPECT_EQ(element, "nan");
  const auto& covariance = got["pose_covariance"];
  EXPECT_EQ(covariance[0], 9);
  EXPECT_EQ(covariance[6], 9);
  EXPECT_EQ(covariance[11], 25);
  for (const int zero : {1, 2, 7}) EXPECT_EQ(covariance[static_cast<std::size_t>(zero)], 0);
  for (const int unknown : {3, 8, 12, 15, 20}) EXPECT_EQ(covariance[static_cast<std::size_t>(unknown)], "nan");
}

TEST(Encode, OriginOfTheLocalFrame) {
  const auto got = read({SetLocalOrigin{3, {8.5, 47.25}, 512.25}})[0];
  EXPECT_EQ(got["target_system"], 3);
  EXPECT_EQ(got["latitude"], 472500000);
  EXPECT_EQ(got["longitude"], 85000000);
  EXPECT_EQ(got["altitude"], 512250);
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

TEST(Encode, UnknownFieldsAreMarkedAsIgnored) {
  EXPECT_EQ(read({GpsInput{}}).at(0)["ignore_flags"], 255);
  EXPECT_EQ(read({GpsInput{.msl_m = 0.0, .velocity = GpsVelocity{0, 0, 0}}}).at(0)["ignore_flags"], 255 - 1 - 8 - 16);
  // ArduPilot's filter takes a vertical velocity that is not ignored for true, and a zero for level flight.
  EXPECT_EQ(read({GpsInput{.velocity = GpsVelocity{20, 1, {}}}}).at(0)["ignore_flags"], 255 - 8);
}

TEST(Encode, NorthIsNotUnknownYaw) {
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

TEST(Encode, NumbersOutOfRangeAreClamped) {
  const auto got = read({GpsInput{.place = {400, -1e9}, .satellites = 1000}, GpsInput{.place = {std::nan(""), 0}}});
  EXPECT_EQ(got[0]["lat"], -2147483648);
  EXPECT_EQ(got[0]["lon"], 2147483647);
  EXPECT_EQ(got[0]["satellites_visible"], 255);
  EXPECT_EQ(got[1]["lon"], 0);
}

TEST(Commands, OperatorHint) {
  CommandInt command = external_position_estimate(kSender, {.place = {8.5, 47.25}, .sigma_m = 300});
  ASSERT_TRUE(is_position_hint(command));
  const auto hint = std::get<PositionHint>(position_hint(command));
  EXPECT_EQ(hint.place, (LonLat{8.5, 47.25}));
  EXPECT_EQ(hint.radius_m, 300);
  const auto refused = [](const CommandInt& changed) { return std::get<std::string>(position_hint(changed)); };
  CommandInt other = command;
  other.parameters[2] = std::nanf("");
  EXPECT_EQ(refused(other), "no accuracy");
  other = command;
  other.parameters[1] = std::nanf("");
  EXPECT_EQ(refused(other), "no valid age");
  other.parameters[1] = -1;
  EXPECT_EQ(refused(other), "no valid age");
  other = command;
  other.place.lat_deg = 91;
  EXPECT_EQ(refused(other), "no valid place");
  other.place = {std::nan(""), 0};
  EXPECT_EQ(refused(other), "no valid place");
  other = command;
  other.frame = 1;  // MAV_FRAME_LOCAL_NED
  EXPECT_EQ(refused(other), "its frame is not global");
  other.command = 512;
  EXPECT_FALSE(is_position_hint(other));
}

TEST(Commands, StreamsAreRequestedByMessage) {
  const CommandLong command = set_message_interval(kAutopilot, StreamedMessage::attitude, 25);
  EXPECT_EQ(command.command, 511);
  EXPECT_EQ(command.parameters[0], 30);
  EXPECT_EQ(command.parameters[1], 40000);
}

}  // namespace
}  // namespace nadir
