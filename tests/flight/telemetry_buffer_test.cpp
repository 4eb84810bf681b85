#include "flight/telemetry_buffer.hpp"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>
#include <limits>

#include "geodesy/angles.hpp"

namespace nadir {
namespace {

constexpr double kGravity = 9.80665;

AircraftAttitude attitude(double roll_deg, double pitch_deg, double yaw_deg) {
  return {0, radians(roll_deg), radians(pitch_deg), radians(yaw_deg), {}};
}

TEST(TelemetryBuffer, AttitudeIsInterpolatedToTheFrame) {
  TelemetryBuffer buffer({});
  buffer.on_message(10.0, attitude(0, 4, 350));
  buffer.on_message(10.2, attitude(20, 0, 10));
  const Telemetry telemetry = buffer.at(10.05);
  EXPECT_NEAR(degrees(*telemetry.heading_rad), -5, 1e-9) << "the short way round";
  EXPECT_NEAR(degrees(*telemetry.roll_rad), 5, 1e-9);
  EXPECT_NEAR(degrees(*telemetry.pitch_rad), 3, 1e-9);
  EXPECT_NEAR(degrees(*buffer.at(10.2).roll_rad), 20, 1e-9);
  EXPECT_FALSE(buffer.at(9.9).heading_rad) << "before all that is known";
}

// Of a gimbal with these angles, as of an aircraft.
GimbalAttitude gimbal(double roll_deg, double pitch_deg, double yaw_deg, bool from_north) {
  const Eigen::Quaterniond q = Eigen::AngleAxisd(radians(yaw_deg), Eigen::Vector3d::UnitZ()) *
                               Eigen::AngleAxisd(radians(pitch_deg), Eigen::Vector3d::UnitY()) *
                               Eigen::AngleAxisd(radians(roll_deg), Eigen::Vector3d::UnitX());
  return {0, 0, {q.w(), q.x(), q.y(), q.z()}, from_north, false};
}

TEST(TelemetryBuffer, OnAGimbalTheCameraHasItsAttitudeAlone) {
  TelemetryBuffer buffer({}, {.gimbal = true});
  buffer.on_message(1, attitude(40, -10, 100));
  EXPECT_FALSE(buffer.at(1).heading_rad) << "the aircraft's is not the camera's";
  buffer.on_message(1, gimbal(0, -80, 20, false));
  const Telemetry from_heading = buffer.at(1);
  EXPECT_NEAR(degrees(*from_heading.pitch_rad), 10, 1e-6);
  EXPECT_NEAR(degrees(*from_heading.roll_rad), 0, 1e-6);
  TelemetryBuffer other({}, {.gimbal = true});
  other.on_message(2, attitude(0, 0, 100));
  other.on_message(2, gimbal(0, -80, 20, true));
  EXPECT_NEAR(degrees(*other.at(2).heading_rad), 20, 1e-6) << "from north";
  TelemetryBuffer relative({}, {.gimbal = true});
  relative.on_message(2, attitude(0, 0, 100));
  relative.on_message(2, gimbal(0, -80, 20, false));
  EXPECT_NEAR(degrees(*relative.at(2).heading_rad), 120, 1e-6) << "from the nose";
}

TEST(TelemetryBuffer, AGimbalIsInterpolatedAndHeldForATenthOfASecond) {
  TelemetryBuffer buffer({}, {.gimbal = true});
  buffer.on_message(1.0, gimbal(0, -90, 0, true));
  buffer.on_message(1.2, gimbal(0, -70, 0, true));
  EXPECT_NEAR(degrees(*buffer.at(1.05).pitch_rad), 5, 1e-6);
  EXPECT_NEAR(degrees(*buffer.at(1.29).pitch_rad), 20, 1e-6);
  EXPECT_FALSE(buffer.at(1.31).pitch_rad) << "it may look elsewhere by now";
  buffer.on_message(1.8, gimbal(0, -70, 0, true));
  EXPECT_FALSE(buffer.at(1.5).pitch_rad) << "what was in between nobody knows";
  GimbalAttitude faulty = gimbal(0, -70, 0, true);
  faulty.faulty = true;
  buffer.on_message(1.9, faulty);
  EXPECT_FALSE(buffer.at(1.95).pitch_rad);
  buffer.on_message(2.0, gimbal(0, -70, 0, false));
  buffer.on_message(2.0, attitude(0, 0, 0));
  EXPECT_FALSE(buffer.at(1.9).pitch_rad) << "from north, then from the nose";
}

// The filter takes a turn of the camera for one of the aircraft where no accelerometer says otherwise.
TEST(TelemetryBuffer, OnAGimbalThereIsNoHeadingWithoutAccelerations) {
  TelemetryBuffer buffer({}, {.gimbal = true});
  buffer.on_message(1.0, attitude(0, 0, 0));
  buffer.on_message(1.0, gimbal(0, -90, 0, true));
  EXPECT_TRUE(buffer.at(1.0).heading_rad);
  buffer.on_message(1.1, gimbal(0, -90, 50, true));
  const Telemetry blind = buffer.at(1.1);
  EXPECT_TRUE(blind.pitch_rad);
  EXPECT_FALSE(blind.heading_rad);
  for (const double time_s : {1.1, 1.15, 1.2}) {
    buffer.on_message(time_s, attitude(0, 0, 0));
    buffer.on_message(time_s, ImuSample{1, 0, {0, 0, -kGravity}, {}});
  }
  buffer.on_message(1.2, gimbal(0, -90, 50, true));
  EXPECT_TRUE(buffer.at(1.2).heading_rad);
}

TEST(TelemetryBuffer, RatesAreThereForARollingShutterAlone) {
  AircraftAttitude turning = attitude(0, 0, 0);
  turning.rate_rad_s = {0.2, 0, 0};
  TelemetryBuffer buffer({radians(90), 0, 0}, {.turn_rate = true});
  buffer.on_message(1.0, turning);
  turning.rate_rad_s = {0.4, 0, 0};
  buffer.on_message(1.1, turning);
  const auto rate = buffer.at(1.05).rate_rad_s;
  ASSERT_TRUE(rate);
  EXPECT_NEAR(rate->y(), -0.3, 1e-9) << "image-up is the right wing";
  EXPECT_NEAR(buffer.at(1.2).rate_rad_s->y(), -0.4, 1e-9) << "the last one holds";
  EXPECT_FALSE(buffer.at(2).rate_rad_s);
  TelemetryBuffer without({});
  without.on_message(1.0, turning);
  EXPECT_FALSE(without.at(1.0).rate_rad_s);
  TelemetryBuffer moving({}, {.gimbal = true, .turn_rate = true});
  for (int i = 0; i < 10; ++i) moving.on_message(0.04 * i, gimbal(0, -90 + i, 0, true));
  EXPECT_NEAR(moving.at(0.2).rate_rad_s->y(), radians(1) / 0.04, 1e-6);
}

ImuSample stamped(double stamp_s, double rate_rad_s = 0) {
  return {1, static_cast<std::uint64_t>(std::llround(stamp_s * 1e6)), {0.5, 0, -kGravity}, {rate_rad_s, 0, 0}};
}

// They count from the autopilot's stamps: messages that were held up and come at once are still a tenth of a second
// apart.
TEST(TelemetryBuffer, InertialSamplesCountFromTheirStamps) {
  TelemetryBuffer buffer({radians(90), 0, 0});
  EXPECT_TRUE(buffer.at(0.99).inertial.empty());
  for (int i = 0; i <= 100; ++i) {
    const double due_s = 1 + 0.01 * i, arrival_s = i >= 30 && i < 40 ? 1.4 : due_s;
    buffer.on_message(arrival_s, stamped(500 + 0.01 * i, 0.2));
    buffer.on_message(arrival_s, ImuSample{2, 500'000'000, {50, 0, 0}, {}});
  }
  const auto samples = buffer.at(1.5).inertial;
  ASSERT_EQ(samples.size(), 51U);
  for (std::size_t i = 1; i < samples.size(); ++i) EXPECT_NEAR(samples[i].time_s - samples[i - 1].time_s, 0.01, 1e-4);
  EXPECT_NEAR(samples.back().time_s, 1.5, 1e-3);
  EXPECT_NEAR(samples[7].rate_rad_s.y(), -0.2, 1e-9) << "image-up is the right wing";
  EXPECT_NEAR(samples[7].force_mps2.y(), -0.5, 1e-9);
  EXPECT_NEAR(samples[7].force_mps2.z(), -kGravity, 1e-9);
  const auto rest = buffer.at(5).inertial;
  EXPECT_EQ(samples.size() + rest.size(), 101U) << "each once";
}

TEST(TelemetryBuffer, InertialSamplesOfAnAutopilotThatRestarted) {
  TelemetryBuffer buffer({});
  buffer.at(0.5);
  for (int i = 0; i < 50; ++i) buffer.on_message(1 + 0.01 * i, stamped(500 + 0.01 * i));
  for (int i = 0; i < 50; ++i) buffer.on_message(3 + 0.01 * i, stamped(2 + 0.01 * i));
  buffer.on_message(3.5, ImuSample{1, 0, {0, 0, -kGravity}, {}});  // without a stamp
  const auto samples = buffer.at(4).inertial;
  ASSERT_EQ(samples.size(), 50U) << "of the clock from before nothing is known any more";
  EXPECT_NEAR(samples.front().time_s, 3, 1e-3);
  TelemetryBuffer on_gimbal({}, {.gimbal = true});
  on_gimbal.at(0.5);
  on_gimbal.on_message(1, stamped(500));
  EXPECT_TRUE(on_gimbal.at(2).inertial.empty()) << "the camera does not turn with the sensor";
}

TEST(TelemetryBuffer, TheMountRotatesTheCamera) {
  TelemetryBuffer buffer({radians(180), radians(0), 0});
  buffer.on_message(1, attitude(0, 10, 30));
  const Telemetry telemetry = buffer.at(1);
  EXPECT_NEAR(degrees(wrap_pi(*telemetry.heading_rad - radians(210))), 0, 1e-9);
  EXPECT_NEAR(degrees(*telemetry.pitch_rad), -10, 1e-9) << "image-up is the tail, which is down";
}

TEST(TelemetryBuffer, TheReceiverPositionIsPassedOnForTheRecord) {
  TelemetryBuffer buffer({});
  const auto fix = [](double lon_deg, double lat_deg, GpsFix kind = GpsFix::three_d) {
    GpsRaw raw;
    raw.fix = kind;
    raw.place = {lon_deg, lat_deg};
    return raw;
  };
  EXPECT_FALSE(buffer.at(9).gps_position);
  buffer.on_message(10.0, fix(8.0, 47.0));
  EXPECT_FALSE(buffer.at(10.1).gps_position) << "nothing is carried on";
  buffer.on_message(10.2, fix(8.1, 47.2));
  buffer.on_message(10.3, fix(50, 50, GpsFix::two_d));
  const Telemetry telemetry = buffer.at(10.05);
  ASSERT_TRUE(telemetry.gps_position);
  EXPECT_NEAR(telemetry.gps_position->lon_deg, 8.025, 1e-9);
  EXPECT_NEAR(telemetry.gps_position->lat_deg, 47.05, 1e-9);
  EXPECT_EQ(buffer.at(10.2).gps_position->lat_deg, 47.2);
  buffer.on_message(12, fix(8.1, 47.2));
  EXPECT_FALSE(buffer.at(11).gps_position) << "what was in between nobody knows";
  // Over the date line.
  buffer.on_message(13, fix(179.9, 0));
  buffer.on_message(13.5, fix(-179.9, 0));
  EXPECT_NEAR(std::abs(buffer.at(13.25).gps_position->lon_deg), 180, 1e-9);
}

TEST(TelemetryBuffer, AnOldAttitudeIsNotUsed) {
  TelemetryBuffer buffer({});
  buffer.on_message(10, attitude(0, 0, 90));
  EXPECT_TRUE(buffer.at(10 + kAttitudeGap_s).heading_rad) << "the next message is on its way";
  EXPECT_FALSE(buffer.at(10.01 + kAttitudeGap_s).heading_rad);
  buffer.on_message(12, attitude(0, 0, 90));
  EXPECT_FALSE(buffer.at(11).heading_rad) << "what happened in between nobody knows";
}

TEST(TelemetryBuffer, ARangeFinderHasPrecedence) {
  TelemetryBuffer buffer({});
  EXPECT_FALSE(buffer.at(1).agl_m);
  buffer.on_message(1, GlobalPosition{0, {8, 47}, 500, 120, {}, {}});
  EXPECT_FALSE(buffer.at(1).agl_m) << "above home is not above ground";
  EXPECT_EQ(buffer.above_home_m(1.5), 120);
  EXPECT_EQ(buffer.msl_m(1.5), 500);
  EXPECT_FALSE(buffer.above_home_m(1.1 + kHeightGap_s));
  buffer.on_message(1, GroundHeight{{8, 47}, 400, 115});
  EXPECT_EQ(buffer.at(1).agl_m, 115);
  buffer.on_message(1, GroundDistance{0, 100, 0.2, 50});
  EXPECT_EQ(buffer.at(1).agl_m, 115) << "beyond its range";
  buffer.on_message(1.1, attitude(20, 0, 0));
  buffer.on_message(1.1, GroundDistance{0, 100, 0.2, 150});
  EXPECT_NEAR(*buffer.at(1.1).agl_m, 100 * std::cos(radians(20)), 1e-9) << "it looks along the aircraft's own axis";
}

// A coordinated turn: the specific force is along the aircraft's own axis, and tilted with it.
TEST(TelemetryBuffer, AccelerationsIntegrateToAVelocityChange) {
  TelemetryBuffer buffer({});
  const double bank = radians(30), inwards = kGravity * std::tan(bank), along_axis = kGravity / std::cos(bank);
  EXPECT_FALSE(buffer.at(0).imu_dv_mps) << "no picture before";
  for (double t = 0; t <= 1.001; t += 0.02) {
    buffer.on_message(t, attitude(30, 0, 0));
    buffer.on_message(t, ImuSample{1, 0, {0, 0, -along_axis}, {}});
    buffer.on_message(t, ImuSample{2, 0, {50, 0, 0}, {}});
  }
  const auto change = buffer.at(1.0).imu_dv_mps;
  ASSERT_TRUE(change);
  EXPECT_NEAR(change->x(), inwards, 1e-6) << "right wing down, heading north: it turns east";
  EXPECT_NEAR(change->y(), 0, 1e-6);
  EXPECT_FALSE(buffer.at(2.0).imu_dv_mps) << "a stretch without samples";
}

// Half round to the right and back to the left between two pictures: both ends tell nothing of it.
TEST(TelemetryBuffer, ALongPathIsSplitIntoIntervals) {
  TelemetryBuffer buffer({radians(90), 0, 0});
  const auto yaw_deg = [](double t) { return t < 5 ? 36 * t : 36 * (10 - t); };
  for (double t = 0; t <= 10.001; t += 0.02) {
    buffer.on_message(t, attitude(0, 0, yaw_deg(t)));
    buffer.on_message(t, ImuSample{1, 0, {3, 0, -kGravity}, {}});  // along the nose
  }
  EXPECT_TRUE(buffer.at(0).intervals.empty()) << "the first";
  EXPECT_TRUE(buffer.at(0.9).intervals.empty()) << "a usual step";
  const Telemetry telemetry = buffer.at(9.9);
  ASSERT_EQ(telemetry.intervals.size(), 8);
  double end_s = 0.9;
  for (const TelemetryInterval& stretch : telemetry.intervals) {
    EXPECT_NEAR(stretch.seconds, 1, 1e-9);
    end_s += stretch.seconds;
    ASSERT_TRUE(stretch.heading_rad && stretch.imu_dv_mps);
    EXPECT_NEAR(degrees(wrap_pi(*stretch.heading_rad - radians(yaw_deg(end_s) + 90))), 0, 1e-6) << "of the camera";
    const double middle_rad = radians(yaw_deg(end_s - 0.5));
    if (std::abs(end_s - 5.5) < 0.55) continue;  // it turns back there
    EXPECT_NEAR(stretch.imu_dv_mps->x(), 3 * std::sin(middle_rad), 0.1);
    EXPECT_NEAR(stretch.imu_dv_mps->y(), 3 * std::cos(middle_rad), 0.1);
  }
  ASSERT_TRUE(telemetry.imu_dv_mps);
  EXPECT_LT(telemetry.imu_dv_mps->norm(), 3.1) << "of the last stretch alone";
}

TEST(TelemetryBuffer, OfTheTimeBeforeTheBufferOnlyItsLengthIsKnown) {
  TelemetryBuffer buffer({});
  buffer.on_message(0, attitude(0, 0, 90));
  buffer.at(0);
  for (double t = 1; t <= 600; t += 0.1) buffer.on_message(t, attitude(0, 0, 90));
  const Telemetry telemetry = buffer.at(600);
  ASSERT_EQ(telemetry.intervals.size(), kTelemetryKept_s / kMaxTelemetryInterval_s);
  EXPECT_NEAR(telemetry.intervals.front().seconds, 600 - kTelemetryKept_s, 1e-6);
  EXPECT_FALSE(telemetry.intervals.front().imu_dv_mps);
  double sum_s = 0;
  for (const TelemetryInterval& stretch : telemetry.intervals) sum_s += stretch.seconds;
  EXPECT_LT(sum_s, 600);
  EXPECT_GT(sum_s, 600 - 1.001 * kMaxTelemetryInterval_s);
}

TEST(TelemetryBuffer, InvalidValuesAreIgnored) {
  TelemetryBuffer buffer({});
  buffer.on_message(std::numeric_limits<double>::quiet_NaN(), attitude(0, 0, 90));
  buffer.on_message(10, attitude(0, 0, 90));
  buffer.on_message(9, attitude(0, 0, 0));
  EXPECT_NEAR(degrees(*buffer.at(10).heading_rad), 90, 1e-9) << "older than the last one";
  for (int i = 0; i < 100'000; ++i) buffer.on_message(10 + i * 0.01, attitude(0, 0, 90));
  EXPECT_FALSE(buffer.at(10).heading_rad) << "what is kept is bounded";
}

}  // namespace
}  // namespace nadir
