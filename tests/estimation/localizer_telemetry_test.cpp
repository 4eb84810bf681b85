// What a confused autopilot tells must not reach the estimate.
#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <limits>

#include "estimation/localizer_fixture.hpp"
#include "geodesy/angles.hpp"

namespace nadir {
namespace {

using namespace test;

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

// Telemetry as it comes from a confused autopilot. Whatever it says, the estimate stays sound, and when the telemetry
// recovers the localizer does.
struct Broken {
  const char* name;
  std::function<void(Telemetry&)> damage;
};

class BrokenTelemetry : public testing::TestWithParam<Broken> {};
INSTANTIATE_TEST_SUITE_P(
    Localizer, BrokenTelemetry,
    testing::Values(Broken{"NanHeight", [](Telemetry& telemetry) { telemetry.agl_m = kNaN; }},
                    Broken{"NegativeHeight", [](Telemetry& telemetry) { telemetry.agl_m = -30; }},
                    Broken{"ZeroHeight", [](Telemetry& telemetry) { telemetry.agl_m = 0; }},
                    Broken{"InfiniteHeight",
                           [](Telemetry& telemetry) { telemetry.agl_m = std::numeric_limits<double>::infinity(); }},
                    Broken{"HugeHeight", [](Telemetry& telemetry) { telemetry.agl_m = 1e9; }},
                    Broken{"NoHeight", [](Telemetry& telemetry) { telemetry.agl_m.reset(); }},
                    Broken{"NanHeading", [](Telemetry& telemetry) { telemetry.heading_rad = kNaN; }},
                    Broken{"HugeHeading", [](Telemetry& telemetry) { telemetry.heading_rad = 1e300; }},
                    Broken{"NanPitch", [](Telemetry& telemetry) { telemetry.pitch_rad = kNaN; }},
                    Broken{"NanRoll", [](Telemetry& telemetry) { telemetry.roll_rad = kNaN; }},
                    Broken{"UpsideDown", [](Telemetry& telemetry) { telemetry.roll_rad = kPi; }},
                    Broken{"NoTilt",
                           [](Telemetry& telemetry) { telemetry.pitch_rad.reset(), telemetry.roll_rad.reset(); }},
                    Broken{"NanImu",
                           [](Telemetry& telemetry) {
                             telemetry.imu_dv_mps = {0, kNaN};
                           }},
                    Broken{"HugeImu",
                           [](Telemetry& telemetry) {
                             telemetry.imu_dv_mps = {-1e9, 3};
                           }},
                    Broken{"WayOfNoLength",
                           [](Telemetry& telemetry) {
                             telemetry.intervals = {{kNaN, 0.0, {}}, {-3, 0.0, {}}};
                           }},
                    Broken{"WayLongerThanTheTime",
                           [](Telemetry& telemetry) {
                             telemetry.intervals = {{1e6, 0.0, {}}};
                           }},
                    Broken{"WayOfNonsense",
                           [](Telemetry& telemetry) {
                             telemetry.intervals = {{1e-3, kNaN, Eigen::Vector2d(kNaN, 1e9)}, {1e-3, 1e300, {}}};
                           }},
                    Broken{"NanTime", [](Telemetry& telemetry) { telemetry.time_s = kNaN; }},
                    Broken{"BackInTime", [](Telemetry& telemetry) { telemetry.time_s -= 100; }},
                    Broken{"FarFuture", [](Telemetry& telemetry) { telemetry.time_s += 1e7; }},
                    Broken{"SameTime", [](Telemetry& telemetry) { telemetry.time_s = 10; }}),
    [](const auto& test) { return test.param.name; });

TEST_P(BrokenTelemetry, NeverThrowsAndRecovers) {
  const auto& moments = short_flight();
  Localizer localizer(flight_camera(), LocalFrame(kOrigin), nullptr, start(), config());
  for (std::size_t i = 0; i < 3; ++i) {
    Telemetry telemetry = moments[i].telemetry;
    if (i == 1) GetParam().damage(telemetry);
    FrameReport report;
    ASSERT_NO_THROW(report = localizer.process(moments[i].image, telemetry));
    expect_sound(report.estimate);
    if (report.estimate.position) {
      EXPECT_LT(off_m(report.estimate, moments[i]), 4 * report.estimate.sigma_m) << i;
    }
  }
  for (const Estimate& estimate : localizer.refined()) expect_sound(estimate);
}

// The very first frame may already be the broken one.
TEST_P(BrokenTelemetry, FromTheFirstFrame) {
  Localizer localizer(flight_camera(), LocalFrame(kOrigin), nullptr, start(), config());
  Telemetry telemetry = short_flight()[0].telemetry;
  GetParam().damage(telemetry);
  for (int i = 0; i < 1; ++i) {
    FrameReport report;
    ASSERT_NO_THROW(report = localizer.process(short_flight()[0].image, telemetry));
    expect_sound(report.estimate);
  }
}

// The same over a map, one damage after the other.
TEST(Localizer, BrokenTelemetryOverAMap) {
  const auto& moments = short_flight();
  Localizer localizer(flight_camera(), LocalFrame(kOrigin), &landscape_tiles(), start(), config());
  const std::vector<std::function<void(Telemetry&)>> damages = {
      [](Telemetry& telemetry) { telemetry.agl_m = kNaN; }, [](Telemetry& telemetry) { telemetry.agl_m = 1e9; },
      [](Telemetry& telemetry) { telemetry.heading_rad = kNaN; },
      [](Telemetry& telemetry) { telemetry.roll_rad = kPi; }};
  for (const auto& damage : damages) {
    Telemetry telemetry = moments[0].telemetry;
    damage(telemetry);
    FrameReport report;
    ASSERT_NO_THROW(report = localizer.process(moments[0].image, telemetry));
    expect_sound(report.estimate);
  }
  const FrameReport after = localizer.process(moments[1].image, moments[1].telemetry);
  expect_sound(after.estimate);
  EXPECT_LT(off_m(after.estimate, moments[1]), std::max(4.0, 4 * after.estimate.sigma_m));
}

}  // namespace
}  // namespace nadir
