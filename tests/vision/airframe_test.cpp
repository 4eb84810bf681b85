#include "vision/camera.hpp"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <fstream>

#include "base/error.hpp"
#include "geodesy/angles.hpp"

namespace nadir {
namespace {

namespace fs = std::filesystem;

constexpr const char* kCamera =
    R"("camera": {"model": "pinhole", "width": 1920, "height": 1080, "fx": 1500, "fy": 1500, "cx": 959.5, "cy": 539.5})";

class AirframeFile : public testing::Test {
 protected:
  AirframeFile() : path_(fs::temp_directory_path() / ("airframe-" + std::to_string(::getpid()) + ".json")) {}
  ~AirframeFile() override { fs::remove(path_); }

  Airframe read(const std::string& rest) {
    std::ofstream(path_) << R"({"format": "nadir.airframe/1", "airframe": "falcon-7", )" << kCamera << rest << "}";
    return read_airframe(path_);
  }

  fs::path path_;
};

TEST_F(AirframeFile, TellsCameraMountAndWhoItIs) {
  const Airframe plain = read("");
  EXPECT_EQ(plain.id, "falcon-7");
  EXPECT_EQ(plain.camera.camera.width, 1920);
  EXPECT_EQ(plain.mount.heading_rad, 0);
  EXPECT_EQ(plain.component, 197);
  const Airframe whole = read(R"(, "mount": {"yaw_deg": 90, "pitch_deg": 9.5, "roll_deg": -1}, "capture_delay_s": 0.08,
    "mavlink": {"system": 3, "autopilot": 1, "component": 191, "link": 2, "gps_id": 1})");
  EXPECT_DOUBLE_EQ(whole.mount.heading_rad, radians(90));
  EXPECT_DOUBLE_EQ(whole.mount.pitch_rad, radians(9.5));
  EXPECT_EQ(whole.capture_delay_s, 0.08);
  EXPECT_EQ(whole.system, 3);
  EXPECT_EQ(whole.component, 191);
  EXPECT_EQ(whole.link, 2);
  EXPECT_EQ(whole.gps_id, 1);
}

TEST_F(AirframeFile, WhatIsWrongIsNamed) {
  const std::pair<const char*, const char*> wrong[] = {
      {R"(, "mount": {"pitch_deg": 80})", "mount.pitch_deg"}, {R"(, "mount": {"yaw_deg": ".nan"})", "mount.yaw_deg"},
      {R"(, "capture_delay_s": -1)", "capture_delay_s"},      {R"(, "mavlink": {"system": 0})", "mavlink.system"},
      {R"(, "mavlink": {"component": 256})", "component"},    {R"(, "wings": 2)", "wings"},
      {R"(, "mavlink": {"key": "secret"})", "key"},
  };
  for (const auto& [text, where] : wrong) {
    try {
      read(text);
      ADD_FAILURE() << text;
    } catch (const UsageError& error) {
      EXPECT_NE(std::string(error.what()).find(where), std::string::npos) << error.what();
    }
  }
  std::ofstream(path_) << R"({"format": "nadir.airframe/2", "airframe": "a"})";
  EXPECT_THROW(read_airframe(path_), UsageError);
  std::ofstream(path_) << R"({"format": "nadir.airframe/1", "airframe": "../a", )" << kCamera << "}";
  EXPECT_THROW(read_airframe(path_), UsageError);
}

TEST(CameraAttitude, IsTheAircraftsTurnedByTheMount) {
  const Attitude level{radians(30), 0, 0};
  const Attitude ahead = camera_attitude(level, {0, radians(9), 0});
  EXPECT_NEAR(ahead.heading_rad, radians(30), 1e-12);
  EXPECT_NEAR(ahead.pitch_rad, radians(9), 1e-12);
  const Attitude sideways = camera_attitude({radians(30), radians(5), 0}, {radians(90), 0, 0});
  EXPECT_NEAR(sideways.heading_rad, radians(120), 1e-12);
  EXPECT_NEAR(sideways.pitch_rad, 0, 1e-12);
  EXPECT_NEAR(sideways.roll_rad, radians(5), 1e-12) << "nose up: its right side is down";
  const Attitude any{radians(-160), radians(-12), radians(25)};
  EXPECT_EQ(camera_attitude(any, {}).roll_rad, any.roll_rad);
}

// The optical axis by quaternions, in north-east-down axes.
TEST(CameraAttitude, TheAxisIsWhereQuaternionsTakeIt) {
  const auto turn = [](const Attitude& a) {
    return Eigen::AngleAxisd(a.heading_rad, Eigen::Vector3d::UnitZ()) *
           Eigen::AngleAxisd(a.pitch_rad, Eigen::Vector3d::UnitY()) *
           Eigen::AngleAxisd(a.roll_rad, Eigen::Vector3d::UnitX());
  };
  const Attitude aircraft{0.7, -0.2, 0.4}, mount{-0.3, 0.15, -0.05};
  const Eigen::Vector3d ned = turn(aircraft) * (turn(mount) * Eigen::Vector3d::UnitZ());
  const Eigen::Vector3d enu = enu_from_camera(camera_attitude(aircraft, mount)).col(2);
  EXPECT_NEAR(enu.x(), ned.y(), 1e-12);
  EXPECT_NEAR(enu.y(), ned.x(), 1e-12);
  EXPECT_NEAR(enu.z(), -ned.z(), 1e-12);
}

}  // namespace
}  // namespace nadir
