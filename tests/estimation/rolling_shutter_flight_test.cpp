// What a rolling shutter costs a flight in gusts, and what undoing it gains: the same flight photographed at one
// moment, and line after line by an oracle that shares no code with the correction.
#include <fmt/format.h>
#include <gtest/gtest.h>

#include <cmath>
#include <iostream>
#include <numbers>
#include <opencv2/core.hpp>

#include "base/random.hpp"
#include "estimation/localizer_fixture.hpp"
#include "geodesy/angles.hpp"

namespace nadir {
namespace rolling_shutter_flight {
namespace {

constexpr double kSpeed_mps = 25, kInterval_s = 0.5, kReadout_s = 0.03;
constexpr int kFrames = 12;

// To the north-east, rolling by ±12 degrees and pitching by ±4.
CameraPose pose_at(double time_s) {
  const double way_m = kSpeed_mps * time_s, heading = radians(45);
  const double swing = 2 * std::numbers::pi * time_s;
  return {.position = {-110 + way_m * std::sin(heading), -110 + way_m * std::cos(heading)},
          .agl_m = 100,
          .attitude = {heading + radians(3) * std::sin(0.3 * swing), radians(4) * std::sin(0.55 * swing + 1),
                       radians(12) * std::sin(0.8 * swing)}};
}

// Every line at its own moment; without a readout all at one.
cv::Mat photograph(double time_s, double readout_s) {
  const CameraModel camera = test::flight_camera().camera;
  const test::Ground ground = test::landscape_ground();
  cv::Mat image(camera.height, camera.width, CV_8UC1);
  for (int y = 0; y < camera.height; ++y) {
    const CameraPose pose = pose_at(time_s + readout_s * (y - (camera.height - 1) / 2.0) / camera.height);
    for (int x = 0; x < camera.width; ++x) {
      image.at<std::uint8_t>(y, x) = cv::saturate_cast<std::uint8_t>(ground(test::seen_by_pixel(camera, pose, x, y)));
    }
  }
  return image;
}

std::vector<test::Moment> fly(double readout_s) {
  std::vector<test::Moment> moments;
  Random random(5);
  for (int i = 0; i < kFrames; ++i) {
    const double time_s = i * kInterval_s;
    test::Moment moment;
    moment.truth = pose_at(time_s);
    moment.image = photograph(time_s, readout_s);
    Telemetry& t = moment.telemetry;
    t.frame = fmt::format("frame{}.jpg", i);
    t.time_s = 10 + time_s;
    t.agl_m = moment.truth.agl_m * 1.01;
    t.heading_rad = moment.truth.attitude.heading_rad - radians(1) + random.normal(0, radians(0.2));
    t.pitch_rad = moment.truth.attitude.pitch_rad + random.normal(0, radians(0.5));
    t.roll_rad = moment.truth.attitude.roll_rad + random.normal(0, radians(0.5));
    t.rate_rad_s = camera_rate(pose_at(time_s - 1e-3).attitude, pose_at(time_s + 1e-3).attitude, 2e-3);
    for (double& axis : *t.rate_rad_s) axis += random.normal(0, radians(0.5));
    moments.push_back(moment);
  }
  return moments;
}

struct Outcome {
  double rms_m = 0;    // over all frames but the first two: until then there is no velocity
  double drift_m = 0;  // of odometry alone, after the whole way
  int anchors = 0;
};

Outcome outcome(const std::vector<test::Moment>& moments, bool undone) {
  CameraFile camera = test::flight_camera();
  if (undone) camera.readout = SensorReadout{kReadout_s};
  Outcome result;
  const LonLat start = test::place_of(moments.front().truth.position);
  LocalizerConfig with_map = test::config();
  with_map.start_sigma_m = 5;
  Localizer localizer(camera, LocalFrame(test::kOrigin), &test::landscape_tiles(), start, with_map);
  Localizer blind(camera, LocalFrame(test::kOrigin), nullptr, start, with_map);
  double sum = 0;
  for (std::size_t i = 0; i < moments.size(); ++i) {
    const FrameReport report = localizer.process(moments[i].image, moments[i].telemetry);
    result.anchors += report.anchor.verdict == AnchorVerdict::accepted ? 1 : 0;
    const double off_m = test::off_m(report.estimate, moments[i]);
    if (i >= 2) sum += off_m * off_m;
    result.drift_m = test::off_m(blind.process(moments[i].image, moments[i].telemetry).estimate, moments[i]);
  }
  result.rms_m = std::sqrt(sum / static_cast<double>(moments.size() - 2));
  return result;
}

TEST(RollingShutterFlight, UndoneItCostsHardlyMoreThanAGlobalShutter) {
  const auto global = fly(0), rolling = fly(kReadout_s);
  const Outcome floor = outcome(global, false), undone = outcome(rolling, true), ignored = outcome(rolling, false);
  for (const auto& [name, one] : {std::pair("global shutter", floor), std::pair("rolling, undone", undone),
                                  std::pair("rolling, ignored", ignored)}) {
    std::cout << fmt::format("{:16}  rms {:5.2f} m  odometry alone, after {:.0f} m: {:5.2f} m  {} anchors of {}\n",
                             name, one.rms_m, kSpeed_mps * kInterval_s * (kFrames - 1), one.drift_m, one.anchors,
                             kFrames);
  }
  EXPECT_GT(ignored.rms_m, 2);
  EXPECT_LT(undone.rms_m, floor.rms_m + 0.3);
  EXPECT_LT(undone.drift_m, floor.drift_m + 1);
}

}  // namespace
}  // namespace rolling_shutter_flight
}  // namespace nadir
