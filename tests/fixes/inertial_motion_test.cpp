#include "fixes/inertial_motion.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

namespace nadir {
namespace {

constexpr double kGravity_mps2 = 9.80665;

// What an accelerometer feels that is turned so and accelerated so (north, east, down): its own rotation, written out.
ImuSample felt(const AircraftAttitude& a, double north, double east) {
  const double cr = std::cos(a.roll_rad), sr = std::sin(a.roll_rad), cp = std::cos(a.pitch_rad),
               sp = std::sin(a.pitch_rad), cy = std::cos(a.yaw_rad), sy = std::sin(a.yaw_rad);
  const double world[3] = {north, east, -kGravity_mps2};
  const double body_from_world[3][3] = {{cp * cy, cp * sy, -sp},
                                        {sr * sp * cy - cr * sy, sr * sp * sy + cr * cy, sr * cp},
                                        {cr * sp * cy + sr * sy, cr * sp * sy - sr * cy, cr * cp}};
  double body[3] = {};
  for (int i = 0; i < 3; ++i) {
    for (int j = 0; j < 3; ++j) body[i] += body_from_world[i][j] * world[j];
  }
  ImuSample sample;
  sample.acceleration_mps2 = {body[0], body[1], body[2]};
  return sample;
}

// A coordinated turn to the right at 22 m/s and 12 degrees a second, beginning northwards.
class Turn : public ::testing::Test {
 protected:
  static constexpr double kSpeed_mps = 22, kRate_rad_s = 12 * std::numbers::pi / 180;

  static double yaw(double time_s) { return kRate_rad_s * time_s; }
  void fly(double from_s, double to_s, double step_s = 0.02) {
    for (int i = 0; from_s + i * step_s <= to_s + 1e-9; ++i) {
      const double time_s = from_s + i * step_s;
      AircraftAttitude attitude;
      attitude.yaw_rad = yaw(time_s);
      attitude.roll_rad = std::atan(kSpeed_mps * kRate_rad_s / kGravity_mps2);
      attitude.pitch_rad = 0.04;
      motion_.on_message(time_s, attitude);
      const double push = kSpeed_mps * kRate_rad_s;
      motion_.on_message(time_s, felt(attitude, -push * std::sin(yaw(time_s)), push * std::cos(yaw(time_s))));
    }
  }

  InertialMotion motion_;
};

TEST_F(Turn, IsFollowedThroughABlackout) {
  fly(0, 20);
  InertialMotion::Moment from = motion_.moment(18);
  fly(20.02, 30);
  const InertialMotion::Gain gain = motion_.gain(from, 30);
  EXPECT_NEAR(gain.velocity_mps.east, kSpeed_mps * (std::sin(yaw(30)) - std::sin(yaw(18))), 0.1);
  EXPECT_NEAR(gain.velocity_mps.north, kSpeed_mps * (std::cos(yaw(30)) - std::cos(yaw(18))), 0.1);
  // The circle itself, less the straight line.
  const double radius_m = kSpeed_mps / kRate_rad_s;
  const double east_m = radius_m * (std::cos(yaw(18)) - std::cos(yaw(30))) - kSpeed_mps * std::sin(yaw(18)) * 12;
  const double north_m = radius_m * (std::sin(yaw(30)) - std::sin(yaw(18))) - kSpeed_mps * std::cos(yaw(18)) * 12;
  EXPECT_GT(std::hypot(east_m, north_m), 100) << "the line would be far off";
  EXPECT_NEAR(gain.displacement_m.east, east_m, 1.0);
  EXPECT_NEAR(gain.displacement_m.north, north_m, 1.0);
  EXPECT_NEAR(gain.unknown_s, 0, 1e-9);
}

TEST_F(Turn, AGapIsCountedAndBridgedStraight) {
  fly(0, 2);
  const auto from = motion_.moment(2);
  EXPECT_NEAR(motion_.gain(from, 2.1).unknown_s, 0, 1e-9) << "a sample stands for a moment longer";
  EXPECT_NEAR(motion_.gain(from, 5).unknown_s, 3 - kInertialGap_s, 1e-9);
  fly(5, 6);
  const InertialMotion::Gain gain = motion_.gain(from, 6);
  EXPECT_NEAR(gain.unknown_s, 3, 1e-9);
  EXPECT_NEAR(gain.velocity_mps.north, kSpeed_mps * (std::cos(yaw(6)) - std::cos(yaw(5))), 0.1);
}

TEST_F(Turn, BeforeTheFirstSampleEverythingIsUnknown) {
  EXPECT_NEAR(motion_.gain(motion_.moment(1), 3).unknown_s, 2, 1e-9);
  const auto from = motion_.moment(1);
  fly(4, 5);
  EXPECT_NEAR(motion_.gain(from, 5).unknown_s, 3, 1e-9);
  EXPECT_NEAR(motion_.gain(motion_.moment(1), 5).unknown_s, 3, 1e-9);
}

TEST_F(Turn, ImplausibleSamplesAreIgnored) {
  fly(0, 1);
  const auto from = motion_.moment(0);
  const InertialMotion::Gain before = motion_.gain(from, 1);
  AircraftAttitude level;
  motion_.on_message(1.01, level);
  ImuSample sample = felt(level, 0, 0);
  sample.acceleration_mps2.x = std::nan("");
  motion_.on_message(1.01, sample);
  sample.acceleration_mps2.x = 1e6;
  motion_.on_message(1.01, sample);
  sample = felt(level, 50, 0);
  motion_.on_message(0.5, sample);  // older than the last
  sample.instance = 2;
  motion_.on_message(1.01, sample);
  AircraftAttitude broken;
  broken.yaw_rad = std::nan("");
  motion_.on_message(1.02, broken);
  EXPECT_EQ(motion_.gain(from, 1).displacement_m.north, before.displacement_m.north);
  EXPECT_EQ(motion_.gain(from, 1).velocity_mps.east, before.velocity_mps.east);
}

TEST(InertialMotion, WithoutAttitudeSamplesAreIgnored) {
  InertialMotion motion;
  motion.on_message(1, felt({}, 3, 0));
  motion.on_message(1.02, felt({}, 3, 0));
  EXPECT_NEAR(motion.gain(motion.moment(1), 1.02).unknown_s, 0.02, 1e-9);
  AircraftAttitude old;
  motion.on_message(1.03, old);
  motion.on_message(5, felt({}, 3, 0));
  EXPECT_NEAR(motion.gain(motion.moment(1), 5).unknown_s, 4, 1e-9) << "an attitude of long ago turns nothing level";
}

TEST(InertialMotion, MemoryIsBoundedAndSumsStayExact) {
  InertialMotion motion;
  AircraftAttitude attitude;
  InertialMotion::Moment from;
  for (int i = 0; i <= 500'000; ++i) {  // almost three hours at 50 Hz, always pushed northwards
    const double time_s = 0.02 * i;
    motion.on_message(time_s, attitude);
    motion.on_message(time_s, felt(attitude, 0.1, 0));
    if (i == 499'000) from = motion.moment(time_s);
  }
  const InertialMotion::Gain gain = motion.gain(from, 10'000);
  EXPECT_NEAR(gain.velocity_mps.north, 2.0, 1e-6);
  EXPECT_NEAR(gain.displacement_m.north, 0.5 * 0.1 * 20 * 20, 1e-4);
}

}  // namespace
}  // namespace nadir
