#include <gtest/gtest.h>

#include "base/error.hpp"
#include "geodesy/angles.hpp"
#include "support/temporary_folder.hpp"
#include "vision/camera.hpp"

namespace nadir {
namespace {

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

TEST(CameraFile, TheAccelerometersSigmaMayBeLeftOut) {
  EXPECT_EQ(read(kGood).uncertainty.imu_dv_mps, 0.3);
  EXPECT_EQ(read(replaced(", tilt_deg: 2", ", tilt_deg: 2, imu_dv_mps: 0.05")).uncertainty.imu_dv_mps, 0.05);
  EXPECT_THAT(complaint(replaced(", tilt_deg: 2", ", tilt_deg: 2, imu_dv_mps: 0")), HasSubstr("above 0"));
}

TEST(CameraFile, LensAndUncertaintyMayBeLeftOut) {
  const CameraFile file = read("model: pinhole\nwidth: 640\nheight: 480\nfx: 500\nfy: 500\ncx: 320\ncy: 240\n");
  EXPECT_FALSE(file.camera.distorted());
  EXPECT_GT(file.uncertainty.heading_rad, 0);
  EXPECT_FALSE(read(replaced("[-0.1, 0.02, 0, 0]", "[]")).camera.distorted());
  EXPECT_EQ(read(replaced("[-0.1, 0.02, 0, 0]", "[-0.1, 0.02, 0, 0, 0.003]")).camera.distortion[4], 0.003);
}

TEST(CameraFile, EveryKeyIsNeeded) {
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

TEST_P(BadCamera, IsRefusedWithItsPlace) {
  const std::string text = complaint(replaced(GetParam().from, GetParam().to));
  EXPECT_THAT(text, HasSubstr(GetParam().says));
  EXPECT_THAT(text, HasSubstr("camera.yaml:")) << "file and line";
}

TEST(CameraFile, MissingOrOtherFile) {
  EXPECT_THROW(read_camera_file("/nonexistent/camera.yaml"), Error);
  EXPECT_THROW(read(""), UsageError);
  EXPECT_THROW(read("- a\n- b\n"), UsageError);
  EXPECT_THROW(read("{{{"), UsageError);
}

}  // namespace
}  // namespace nadir
