#include "vision/camera.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <cmath>
#include <fstream>

#include "base/error.hpp"
#include "geodesy/angles.hpp"
#include "support/temporary_folder.hpp"
#include "vision/synthetic_ground.hpp"

namespace nadir {
namespace {

using test::seen_by_pixel;
using test::small_camera;

CameraModel with_lens(std::array<double, 5> distortion) {
  CameraModel camera = small_camera();
  camera.width = 2000;
  camera.height = 1500;
  camera.fx = 1400;
  camera.fy = 1420;
  camera.cx = 1010;
  camera.cy = 735;
  camera.distortion = distortion;
  return camera;
}

double worst_round_trip_px(const CameraModel& camera) {
  double worst = 0;
  for (double x = 0; x < camera.width; x += 37) {
    for (double y = 0; y < camera.height; y += 41) {
      const Eigen::Vector3d ray = camera.ray_from_pixel({x, y});
      EXPECT_EQ(ray.z(), 1.0);
      worst = std::max(worst, (camera.pixel_from_point(7.5 * ray) - Eigen::Vector2d(x, y)).norm());
    }
  }
  return worst;
}

TEST(CameraModel, PixelsRoundTripOverTheWholeImage) {
  EXPECT_LT(worst_round_trip_px(with_lens({})), 1e-9);
  EXPECT_LT(worst_round_trip_px(with_lens({-0.28, 0.09, 0.0008, -0.0011, -0.01})), 1e-6) << "an action camera";
  EXPECT_LT(worst_round_trip_px(with_lens({0.12, 0.05, -0.001, 0.002, 0.03})), 1e-6) << "pincushion";
  EXPECT_LT(worst_round_trip_px(with_lens({0.4, 0.1, 0, 0, 0})), 1e-6) << "strong pincushion";
  EXPECT_LT(worst_round_trip_px(with_lens({-0.33, 0.05, 0, 0, 0})), 1e-6) << "nearly folding at the corners";
}

// Far outside of the image a barrel lens' polynomial turns back and would show the rim a second time.
TEST(CameraModel, OutsideStaysOutside) {
  for (const std::array<double, 5>& lens : {std::array<double, 5>{-0.3, 0, 0, 0, 0},
                                            {-0.28, 0.09, 0.0008, -0.0011, -0.01},
                                            {-0.2, -0.05, 0.001, 0, 0},
                                            {0.1, -0.2, 0, 0.001, 0.01}}) {
    CameraModel camera = with_lens(lens);
    camera.fx = camera.fy = 2000;
    for (const double direction : {0.0, 0.7, 2.5, 4.0}) {
      double last = 0;
      for (double r = 0.02; r < 20; r *= 1.1) {
        const Eigen::Vector2d pixel = camera.pixel_from_point({r * std::cos(direction), r * std::sin(direction), 1.0});
        const double out = (pixel - Eigen::Vector2d(camera.cx, camera.cy)).norm();
        EXPECT_GT(out, last) << r;
        last = out;
      }
      EXPECT_GT(last, 2000);
    }
  }
}

// Values computed by hand from OpenCV's formula: x = 0.2, y = -0.1, r² = 0.05.
TEST(CameraModel, DistortsAsOpencvDoes) {
  CameraModel camera;
  camera.width = camera.height = 1000;
  camera.fx = camera.fy = 1000;
  camera.cx = camera.cy = 500;
  camera.distortion = {0.2, -0.4, 0.01, -0.02, 0.8};
  const double radial = 1 + 0.2 * 0.05 - 0.4 * 0.0025 + 0.8 * 0.000125;
  const double x = 0.2 * radial + 2 * 0.01 * (0.2 * -0.1) - 0.02 * (0.05 + 2 * 0.04);
  const double y = -0.1 * radial + 0.01 * (0.05 + 2 * 0.01) + 2 * -0.02 * (0.2 * -0.1);
  const Eigen::Vector2d pixel = camera.pixel_from_point({0.4, -0.2, 2});
  EXPECT_NEAR(pixel.x(), 500 + 1000 * x, 1e-9);
  EXPECT_NEAR(pixel.y(), 500 + 1000 * y, 1e-9);
}

// A image and its reduced copy show the same things in the same directions: pixel edges scale, not centres.
TEST(CameraModel, ScaledCameraProjectsTheSame) {
  const CameraModel camera = with_lens({-0.28, 0.09, 0.0008, -0.0011, -0.01});
  for (const double factor : {0.5, 0.25, 0.371}) {
    const CameraModel half = camera.scaled(factor);
    EXPECT_EQ(half.width, std::lround(2000 * factor));
    EXPECT_EQ(half.height, std::lround(1500 * factor));
    for (const Eigen::Vector2d& pixel : {Eigen::Vector2d(0, 0), Eigen::Vector2d(1999, 3), Eigen::Vector2d(700, 1400)}) {
      const Eigen::Vector3d ray = camera.ray_from_pixel(pixel);
      const Eigen::Vector2d there = half.pixel_from_point(ray);
      EXPECT_NEAR((there.x() + 0.5) / half.width, (pixel.x() + 0.5) / camera.width, 1e-9);
      EXPECT_NEAR((there.y() + 0.5) / half.height, (pixel.y() + 0.5) / camera.height, 1e-9);
    }
  }
}

// By hand: what do image-right, image-down and the axis point to?
TEST(Attitude, LevelAndNorth) {
  const Eigen::Matrix3d m = enu_from_camera({});
  EXPECT_NEAR((m.col(0) - Eigen::Vector3d(1, 0, 0)).norm(), 0, 1e-12) << "image right is east";
  EXPECT_NEAR((m.col(1) - Eigen::Vector3d(0, -1, 0)).norm(), 0, 1e-12) << "image down is south";
  EXPECT_NEAR((m.col(2) - Eigen::Vector3d(0, 0, -1)).norm(), 0, 1e-12) << "the axis is down";
}

TEST(Attitude, HeadingIsClockwise) {
  const Eigen::Matrix3d m = enu_from_camera({radians(90), 0, 0});
  EXPECT_NEAR((-m.col(1) - Eigen::Vector3d(1, 0, 0)).norm(), 0, 1e-12) << "image up is east";
  EXPECT_NEAR((m.col(0) - Eigen::Vector3d(0, -1, 0)).norm(), 0, 1e-12) << "image right is south";
}

TEST(Attitude, NoseUpLooksAhead) {
  const Eigen::Vector3d axis = enu_from_camera({radians(90), radians(10), 0}).col(2);
  EXPECT_NEAR(axis.x(), std::sin(radians(10)), 1e-12) << "ahead is east";
  EXPECT_NEAR(axis.y(), 0, 1e-12);
}

TEST(Attitude, RightWingDownLooksLeft) {
  const Eigen::Vector3d axis = enu_from_camera({0, 0, radians(20)}).col(2);
  EXPECT_NEAR(axis.x(), -std::sin(radians(20)), 1e-12) << "left is west";
  EXPECT_NEAR(axis.y(), 0, 1e-12);
}

// Yaw, pitch, roll in the order of aviation: the pitch turns about the levelled right wing, the roll about the nose.
TEST(Attitude, OrderOfAviation) {
  const Eigen::Matrix3d m = enu_from_camera({radians(30), radians(10), radians(25)});
  EXPECT_NEAR(-m(2, 1), std::sin(radians(10)), 1e-12) << "the nose rises by the pitch, whatever the roll";
  EXPECT_NEAR(std::atan2(-m(0, 1), -m(1, 1)), radians(30), 1e-12) << "the nose's course is the heading";
  EXPECT_NEAR(-m(2, 0), std::sin(radians(25)) * std::cos(radians(10)), 1e-12) << "the right wing falls";
  EXPECT_NEAR(m.determinant(), 1, 1e-12);
}

TEST(Attitude, AgreesWithTheRayCaster) {
  const CameraModel camera = with_lens({-0.2, 0.05, 0.001, 0.001, 0});
  const CameraPose pose{{12, -7}, 130, {radians(200), radians(-8), radians(15)}};
  for (const Eigen::Vector2d& pixel : {Eigen::Vector2d(0, 0), Eigen::Vector2d(1999, 0), Eigen::Vector2d(300, 1200)}) {
    const auto ground = ground_from_ray(pose, camera.ray_from_pixel(pixel));
    ASSERT_TRUE(ground);
    const PlanePoint expected = seen_by_pixel(camera, pose, pixel.x(), pixel.y());
    EXPECT_NEAR(ground->east_m, expected.east_m, 1e-6);
    EXPECT_NEAR(ground->north_m, expected.north_m, 1e-6);
  }
}

using testing::HasSubstr;

const std::string kGood =
    "model: pinhole\nwidth: 640\nheight: 480\nfx: 500\nfy: 501.5\ncx: 320\ncy: 240\n"
    "distortion: [-0.1, 0.02, 0, 0]\nuncertainty: {heading_deg: 3, agl_relative: 0.07, tilt_deg: 2}\n";

std::string replaced(const std::string& from, const std::string& to) {
  std::string text = kGood;
  const auto at = text.find(from);
  EXPECT_NE(at, std::string::npos) << from;
  if (at != std::string::npos) text.replace(at, from.size(), to);
  return text;
}

CameraFile read(const std::string& text) {
  const test::TemporaryFolder folder;
  return read_camera_file(folder.write("camera.yaml", text));
}

std::string complaint(const std::string& text) {
  try {
    read(text);
  } catch (const UsageError& error) {
    return error.what();
  }
  return "no error";
}

TEST(CameraFile, ReadsAll) {
  const CameraFile file = read(kGood);
  EXPECT_EQ(file.camera.width, 640);
  EXPECT_EQ(file.camera.height, 480);
  EXPECT_EQ(file.camera.fx, 500);
  EXPECT_EQ(file.camera.fy, 501.5);
  EXPECT_EQ(file.camera.cx, 320);
  EXPECT_EQ(file.camera.cy, 240);
  EXPECT_EQ(file.camera.distortion, (std::array<double, 5>{-0.1, 0.02, 0, 0, 0}));
  EXPECT_DOUBLE_EQ(file.uncertainty.heading_rad, radians(3));
  EXPECT_EQ(file.uncertainty.agl_relative, 0.07);
  EXPECT_DOUBLE_EQ(file.uncertainty.tilt_rad, radians(2));
}

TEST(CameraFile, TheAccelerometerSigmaIsOptional) {
  EXPECT_EQ(read(kGood).uncertainty.imu_dv_mps, 0.3);
  EXPECT_EQ(read(replaced(", tilt_deg: 2", ", tilt_deg: 2, imu_dv_mps: 0.05")).uncertainty.imu_dv_mps, 0.05);
  EXPECT_THAT(complaint(replaced(", tilt_deg: 2", ", tilt_deg: 2, imu_dv_mps: 0")), HasSubstr("above 0"));
}

TEST(CameraFile, ARollingShutterIsReadByItsRows) {
  EXPECT_FALSE(read(kGood).readout);
  const std::string tail = "rolling_shutter: {row_time_s: 5.0e-5";
  const CameraFile down = read(kGood + tail + "}\n");
  ASSERT_TRUE(down.readout);
  EXPECT_DOUBLE_EQ(down.readout->duration_s, 480 * 5e-5);
  EXPECT_EQ(down.readout->direction, SensorReadout::Direction::down);
  EXPECT_DOUBLE_EQ(down.line_time_s(), 5e-5);
  const CameraFile left = read(kGood + tail + ", direction: left}\n");
  EXPECT_DOUBLE_EQ(left.readout->duration_s, 640 * 5e-5) << "of columns";
  EXPECT_EQ(name_of(left.readout->direction), "left");
  EXPECT_THAT(complaint(kGood + tail + ", direction: sideways}\n"), HasSubstr("down, up, right or left"));
  EXPECT_THAT(complaint(kGood + "rolling_shutter: {row_time_s: 0}\n"), HasSubstr("above 0"));
  EXPECT_THAT(complaint(kGood + "rolling_shutter: {row_time_s: 1.0e-3}\n"), HasSubstr("0.2 s"));
  EXPECT_THAT(complaint(kGood + "rolling_shutter: {direction: down}\n"), HasSubstr("row_time_s"));
  EXPECT_TRUE(read(kGood + "on_gimbal: true\n").on_gimbal);
  EXPECT_THAT(complaint(kGood + "on_gimbal: 7\n"), HasSubstr("true or false"));
}

TEST(CameraFile, LensAndUncertaintyAreOptional) {
  const CameraFile file = read("model: pinhole\nwidth: 640\nheight: 480\nfx: 500\nfy: 500\ncx: 320\ncy: 240\n");
  EXPECT_FALSE(file.camera.distorted());
  EXPECT_GT(file.uncertainty.heading_rad, 0);
  EXPECT_FALSE(read(replaced("[-0.1, 0.02, 0, 0]", "[]")).camera.distorted());
  EXPECT_EQ(read(replaced("[-0.1, 0.02, 0, 0]", "[-0.1, 0.02, 0, 0, 0.003]")).camera.distortion[4], 0.003);
}

TEST(CameraFile, EveryOtherKeyIsRequired) {
  for (const char* key : {"model: pinhole\n", "width: 640\n", "height: 480\n", "fx: 500\n", "fy: 501.5\n", "cx: 320\n",
                          "cy: 240\n", "heading_deg: 3, ", "agl_relative: 0.07, ", ", tilt_deg: 2"}) {
    const std::string name(key, std::string_view(key).find(':'));
    EXPECT_THAT(complaint(replaced(key, "")), HasSubstr(name.substr(name.find_first_not_of(", ")))) << key;
  }
}

struct Bad {
  const char* from;
  const char* to;
  const char* says;
};

class BadCamera : public testing::TestWithParam<Bad> {};
INSTANTIATE_TEST_SUITE_P(
    CameraFile, BadCamera,
    testing::Values(
        Bad{"fx: 500", "fx: .nan", "fx"}, Bad{"fx: 500", "fx: .inf", "fx"}, Bad{"fx: 500", "fx: -500", "above 0"},
        Bad{"fx: 500", "fx: 0", "above 0"}, Bad{"fx: 500", "fx: long", "long"}, Bad{"cx: 320", "cx: .nan", "cx"},
        Bad{"width: 640", "width: 0", "pixels"}, Bad{"width: 640", "width: 640.5", "640.5"},
        Bad{"width: 640", "width: 30000", "30000"}, Bad{"height: 480", "height: -480", "-480"},
        Bad{"model: pinhole", "model: fisheye", "fisheye"}, Bad{"cy: 240", "cy: 240\nfocal: 3", "focal"},
        Bad{"tilt_deg: 2", "tilt_deg: 0", "tilt_deg"}, Bad{"tilt_deg: 2", "tilt_deg: 2, yaw_deg: 1", "yaw_deg"},
        Bad{"[-0.1, 0.02, 0, 0]", "[-0.1, 0.02]", "distortion"},
        Bad{"[-0.1, 0.02, 0, 0]", "[-0.1, .nan, 0, 0]", "distortion"}, Bad{"[-0.1, 0.02, 0, 0]", "0.1", "distortion"},
        Bad{"[-0.1, 0.02, 0, 0]", "[-0.9, 0, 0, 0]", "inverted"},
        // One-to-one at the corners again, but folded on the way there.
        Bad{"[-0.1, 0.02, 0, 0]", "[-3.0, 3.5, 0, 0]", "inverted"},
        Bad{"height: 480", "height: 480\nheight: 480", "height"}));

TEST_P(BadCamera, IsRejectedWithItsPosition) {
  const std::string text = complaint(replaced(GetParam().from, GetParam().to));
  EXPECT_THAT(text, HasSubstr(GetParam().says));
  EXPECT_THAT(text, HasSubstr("camera.yaml:")) << "file and line";
}

TEST(CameraFile, MissingOrForeignFile) {
  EXPECT_THROW(read_camera_file("/nonexistent/camera.yaml"), Error);
  EXPECT_THROW(read(""), UsageError);
  EXPECT_THROW(read("- a\n- b\n"), UsageError);
  EXPECT_THROW(read("{{{"), UsageError);
}

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

TEST_F(AirframeFile, ReadsCameraMountAndIdentity) {
  const Airframe plain = read("");
  EXPECT_EQ(plain.id, "falcon-7");
  EXPECT_EQ(plain.camera.camera.width, 1920);
  EXPECT_EQ(plain.mount.heading_rad, 0);
  EXPECT_EQ(plain.component, 197);
  EXPECT_FALSE(plain.sequence || plain.expires) << "files of before these existed";
  const Airframe whole = read(R"(, "mount": {"yaw_deg": 90, "pitch_deg": 9.5, "roll_deg": -1}, "capture_delay_s": 0.08,
    "mavlink": {"system": 3, "autopilot": 1, "component": 191, "link": 2, "gps_id": 1,
                "parameters": [{"name": "EKF2_AGP0_CTRL", "value": 1}, {"name": "EKF2_GPS_CTRL", "value": 7}]},
    "sequence": 12, "expires": "2030-01-01T00:00:00Z")");
  EXPECT_EQ(whole.sequence, 12);
  EXPECT_EQ(whole.expires, UtcTime{1'893'456'000});
  EXPECT_DOUBLE_EQ(whole.mount.heading_rad, radians(90));
  EXPECT_DOUBLE_EQ(whole.mount.pitch_rad, radians(9.5));
  EXPECT_EQ(whole.capture_delay_s, 0.08);
  EXPECT_EQ(whole.system, 3);
  EXPECT_EQ(whole.component, 191);
  EXPECT_EQ(whole.link, 2);
  EXPECT_EQ(whole.gps_id, 1);
  ASSERT_EQ(whole.parameters.size(), 2U);
  EXPECT_EQ(whole.parameters[1].name, "EKF2_GPS_CTRL");
  EXPECT_EQ(whole.parameters[1].value, 7);
}

TEST_F(AirframeFile, AGimbalIsAnAddress) {
  EXPECT_FALSE(read("").gimbal);
  EXPECT_FALSE(read("").camera.on_gimbal);
  const Airframe usual = read(R"(, "gimbal": {})");
  ASSERT_TRUE(usual.gimbal);
  EXPECT_EQ(usual.gimbal->component, 154);
  EXPECT_EQ(usual.gimbal->device, 0);
  EXPECT_TRUE(usual.camera.on_gimbal);
  const Airframe other = read(R"(, "gimbal": {"component": 1, "device": 2})");
  EXPECT_EQ(other.gimbal->component, 1);
  EXPECT_EQ(other.gimbal->device, 2);
}

TEST_F(AirframeFile, NamesAMatcherByItsDigest) {
  const std::string digest(64, 'a');
  const Airframe airframe = read(R"(, "matcher": {"model": "xfeat.onnx", "sha256": ")" + digest + "\"}");
  ASSERT_TRUE(airframe.matcher);
  EXPECT_EQ(airframe.matcher->model, "xfeat.onnx");
  EXPECT_EQ(airframe.matcher->sha256.hex(), digest);
}

TEST_F(AirframeFile, ErrorsNameTheKey) {
  const std::pair<const char*, const char*> wrong[] = {
      {R"(, "mount": {"pitch_deg": 80})", "mount.pitch_deg"},
      {R"(, "mount": {"yaw_deg": ".nan"})", "mount.yaw_deg"},
      {R"(, "capture_delay_s": -1)", "capture_delay_s"},
      {R"(, "mavlink": {"system": 0})", "mavlink.system"},
      {R"(, "mavlink": {"component": 256})", "component"},
      {R"(, "mavlink": {"parameters": [{"name": "X Y", "value": 1}]})", "name"},
      {R"(, "mavlink": {"parameters": [{"name": "LONGER_THAN_16_BYTES", "value": 1}]})", "name"},
      {R"(, "mavlink": {"parameters": [{"name": "X"}]})", "value"},
      {R"(, "gimbal": {"component": 0})", "component"},
      {R"(, "gimbal": {"device": 300})", "device"},
      {R"(, "gimbal": {"yaw": 1})", "yaw"},
      {R"(, "matcher": {"model": "xfeat.onnx"})", "sha256"},
      {R"(, "matcher": {"model": "xfeat.onnx", "sha256": "7DD1"})", "sha256"},
      {R"(, "matcher": {"model": "", "sha256": "7dd1"})", "model"},
      {R"(, "wings": 2)", "wings"},
      {R"(, "mavlink": {"key": "secret"})", "key"},
      {R"(, "sequence": 0)", "sequence"},
      {R"(, "sequence": 1.5)", "sequence"},
      {R"(, "sequence": 99999999999)", "sequence"},
      {R"(, "expires": "soon")", "expires"},
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

// A gimbal's own axes: ahead, right, down; yaw, pitch and roll as of an aircraft.
Eigen::Matrix3d gimbal(double yaw_deg, double pitch_deg, double roll_deg) {
  return (Eigen::AngleAxisd(radians(yaw_deg), Eigen::Vector3d::UnitZ()) *
          Eigen::AngleAxisd(radians(pitch_deg), Eigen::Vector3d::UnitY()) *
          Eigen::AngleAxisd(radians(roll_deg), Eigen::Vector3d::UnitX()))
      .toRotationMatrix();
}

TEST(CameraAttitude, AGimbalThatLooksDownIsACameraThatLooksDown) {
  const Attitude down = camera_attitude_on_gimbal(gimbal(70, -90, 0), {});
  EXPECT_NEAR(down.heading_rad, radians(70), 1e-9);
  EXPECT_NEAR(down.pitch_rad, 0, 1e-9);
  EXPECT_NEAR(down.roll_rad, 0, 1e-9);
  const Attitude ahead = camera_attitude_on_gimbal(gimbal(70, -60, 0), {});
  EXPECT_NEAR(ahead.heading_rad, radians(70), 1e-9);
  EXPECT_NEAR(ahead.pitch_rad, radians(30), 1e-9) << "30 degrees ahead of nadir";
  // Where it looks, and which way is up in the image: the axes themselves.
  const Eigen::Matrix3d axes = gimbal(-130, -75, 8), camera = enu_from_camera(camera_attitude_on_gimbal(axes, {}));
  const auto enu = [](const Eigen::Vector3d& ned) { return Eigen::Vector3d(ned.y(), ned.x(), -ned.z()); };
  EXPECT_LT((camera.col(2) - enu(axes.col(0))).norm(), 1e-9) << "the optical axis";
  EXPECT_LT((camera.col(0) - enu(axes.col(1))).norm(), 1e-9) << "right";
  EXPECT_LT((camera.col(1) - enu(axes.col(2))).norm(), 1e-9) << "down the image";
  EXPECT_NEAR(camera_attitude_on_gimbal(gimbal(0, -90, 0), {radians(180), 0, 0}).heading_rad, radians(180), 1e-9)
      << "image-up backwards";
}

TEST(CameraAttitude, RatesAreThoseOfTheCamerasAxes) {
  const Attitude mount{radians(90), 0, 0};  // image-up to the right wing
  const Eigen::Vector3d rolling = camera_rate({0.5, 0, 0}, mount);
  EXPECT_NEAR(rolling.x(), 0, 1e-12);
  EXPECT_NEAR(rolling.y(), -0.5, 1e-12) << "the right wing goes down: image-up does";
  const Attitude before{0.4, 0.1, -0.2}, after{0.4, 0.1, -0.2 + 0.003};
  EXPECT_NEAR(camera_rate(before, after, 0.01).x(), 0.3, 1e-6);
  EXPECT_EQ(camera_rate(before, before, 0.01).norm(), 0);
}

TEST(CameraAttitude, ComposesAircraftAndMount) {
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
TEST(CameraAttitude, AgreesWithQuaternions) {
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
