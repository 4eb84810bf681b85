#include "commands/simulate/mavlink_poses.hpp"

#include <gtest/gtest.h>

namespace nadir {
namespace {

constexpr std::int64_t kMachine_us = 1'760'000'000'000'000;    // this machine's UTC at monotonic 0
constexpr std::int64_t kAutopilot_us = 1'750'000'000'000'000;  // the autopilot's, at its boot

class PoseAssemblerTest : public ::testing::Test {
 protected:
  std::optional<LivePose> on_message(const IncomingMessage& message, std::int64_t at_us) {
    return assembler_.on_message(message, at_us, kMachine_us + at_us);
  }
  static GlobalPosition position(std::uint32_t boot_ms) {
    return {.boot_ms = boot_ms, .place = {14, 48}, .msl_m = 600, .velocity = {.north_mps = 20, .down_mps = -2}};
  }
  static AircraftAttitude attitude(std::uint32_t boot_ms) {
    return {.boot_ms = boot_ms, .roll_rad = 0.1, .pitch_rad = 0.2, .yaw_rad = 0.3};
  }
  static SimState truth() {
    return {.roll_rad = -0.1,
            .pitch_rad = 0.05,
            .yaw_rad = 3,
            .place = {14.5, 48.5},
            .msl_m = 555,
            .velocity = {.north_mps = 1, .east_mps = 2, .down_mps = 3}};
  }

  PoseAssembler assembler_;
};

TEST_F(PoseAssemblerTest, UsesTheSimulatorsTruthUnchanged) {
  const auto pose = on_message(truth(), 5'000'000);
  ASSERT_TRUE(pose);
  EXPECT_EQ(pose->place.lon_deg, 14.5);
  EXPECT_EQ(pose->place.lat_deg, 48.5);
  EXPECT_EQ(pose->height_m, 555);
  EXPECT_EQ(pose->attitude.heading_rad, 3);
  EXPECT_EQ(pose->attitude.pitch_rad, 0.05);
  EXPECT_EQ(pose->attitude.roll_rad, -0.1);
  EXPECT_EQ(pose->velocity_enu_mps, Eigen::Vector3d(2, 1, -3));
  EXPECT_EQ(pose->unix_us, kMachine_us + 5'000'000);
}

TEST_F(PoseAssemblerTest, UsesTheAutopilotsTimeOnceItIsKnown) {
  EXPECT_FALSE(on_message(SystemTime{.unix_us = kAutopilot_us + 7'000'000, .boot_ms = 7000}, 1'000'000));
  EXPECT_EQ(on_message(truth(), 1'030'000)->unix_us, kAutopilot_us + 7'030'000);
  EXPECT_FALSE(on_message(SystemTime{.unix_us = {}, .boot_ms = 9000}, 3'000'000));  // unknown: the old tie holds
  EXPECT_EQ(on_message(truth(), 3'000'000)->unix_us, kAutopilot_us + 9'000'000);
}

TEST_F(PoseAssemblerTest, PropagatesThePositionToTheTimeOfTheAttitude) {
  on_message(SystemTime{.unix_us = kAutopilot_us + 7'000'000, .boot_ms = 7000}, 0);
  EXPECT_FALSE(on_message(attitude(9000), 0));  // no position yet
  EXPECT_FALSE(on_message(position(9000), 0));
  const auto pose = on_message(attitude(9500), 0);
  ASSERT_TRUE(pose);
  // Half a second at 20 m/s north and 2 m/s up; a degree of the meridian at 48° is 111 200 m.
  EXPECT_NEAR((pose->place.lat_deg - 48) * 111'200, 10, 0.02);
  EXPECT_NEAR(pose->place.lon_deg, 14, 1e-9);
  EXPECT_NEAR(pose->height_m, 601, 1e-9);
  EXPECT_EQ(pose->attitude.heading_rad, 0.3);
  EXPECT_EQ(pose->unix_us, kAutopilot_us + 9'500'000);
}

TEST_F(PoseAssemblerTest, AnOldPositionIsIgnored) {
  on_message(position(9000), 0);
  EXPECT_TRUE(on_message(attitude(10'000), 0));
  EXPECT_FALSE(on_message(attitude(10'001), 0));
  EXPECT_FALSE(on_message(attitude(7'900), 0));  // the autopilot has booted again
}

TEST_F(PoseAssemblerTest, EstimatesAreUsedOnlyWithoutTruth) {
  on_message(truth(), 0);
  on_message(position(9000), 100'000);
  EXPECT_FALSE(on_message(attitude(9000), 1'900'000));
  EXPECT_TRUE(on_message(attitude(9000), 2'100'000));
  EXPECT_FALSE(on_message(Heartbeat{}, 2'100'000));
}

}  // namespace
}  // namespace nadir
