// The camera's own rhythm and the state machine that goes by it: cameras of all speeds, uneven ones and bursts, each
// flown for minutes with a clock that the test moves. The figures are the design's: a blackout is reported after 400 ms
// or when one picture is missing.
#include "service/service_machine.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <random>

#include "service/machine_driver.hpp"

namespace nadir {
namespace {

using SourceLabel::satellite_anchored;
using SourceLabel::vo_extrapolated;
using test::MachineDriver;
using Why = ServiceReason;

double limit_after(double interval_s, int pictures) {
  FrameIntervalMonitor monitor(1.0 / 3);
  for (int i = 0; i < pictures; ++i) monitor.on_frame(50 + i * interval_s);
  return monitor.silence_limit_s();
}

TEST(FrameIntervalMonitor, UsesTheDefaultUntilThreeIntervalsAreMeasured) {
  EXPECT_DOUBLE_EQ(FrameIntervalMonitor(1.0 / 3).silence_limit_s(), 0.4);
  EXPECT_DOUBLE_EQ(FrameIntervalMonitor(2).silence_limit_s(), 2.4);
  EXPECT_DOUBLE_EQ(limit_after(1, 3), 0.4);
  EXPECT_DOUBLE_EQ(limit_after(1, 4), 1.2);
}

TEST(FrameIntervalMonitor, MeasuresTheCamera) {
  EXPECT_NEAR(limit_after(0.02, 200), 0.4, 1e-9);
  EXPECT_NEAR(limit_after(0.1, 50), 0.4, 1e-9);
  EXPECT_NEAR(limit_after(1.0 / 3, 50), 0.4, 1e-9);
  EXPECT_NEAR(limit_after(0.5, 50), 0.6, 1e-9);
  EXPECT_NEAR(limit_after(1, 50), 1.2, 1e-9);
  EXPECT_NEAR(limit_after(100, 50), 3, 1e-9) << "what is slower is no camera";
}

TEST(FrameIntervalMonitor, AGapIsNotTheInterval) {
  FrameIntervalMonitor monitor(1.0 / 3);
  double now_s = 0;
  for (int i = 0; i < 100; ++i) {
    now_s += i % 4 == 3 ? 5.0 : 1.0 / 3;  // every fourth picture comes after a blackout
    monitor.on_frame(now_s);
  }
  EXPECT_LE(monitor.silence_limit_s(), 2.0 / 3 + 1e-9);
}

TEST(FrameIntervalMonitor, InvalidOrBackwardTimesAreIgnored) {
  FrameIntervalMonitor monitor(1.0 / 3);
  for (int i = 0; i < 20; ++i) {
    monitor.on_frame(i);
    monitor.on_frame(std::nan(""));
    monitor.on_frame(std::numeric_limits<double>::infinity());
    monitor.on_frame(i - 10);
  }
  EXPECT_DOUBLE_EQ(monitor.silence_limit_s(), 1.2);
}

// A flight with a camera of this rhythm; the conductor's twenty turns a second between the pictures.
class Rhythm {
 public:
  Rhythm() { flight_.boot_to_normal(); }

  void picture_after(double seconds) {
    const double at_s = flight_.now_s + seconds;
    while (flight_.now_s + 0.05 < at_s) {
      flight_.now_s += 0.05;
      flight_.tick();
    }
    flight_.now_s = at_s;
    flight_.frame(vo_extrapolated);
  }
  // How long after its last picture a camera that stops is reported.
  double reported_after_s() {
    const double from_s = flight_.now_s;
    while (flight_.state() == ServiceState::normal && flight_.now_s < from_s + 10) {
      flight_.now_s += 0.005;
      flight_.tick();
    }
    return flight_.now_s - from_s;
  }
  int silences() const { return flight_.count(Why::camera_silent); }
  ServiceState state() const { return flight_.state(); }

 private:
  MachineDriver flight_;
};

struct Camera {
  double interval_s;
  double jitter;         // of the interval, both ways
  double reported_by_s;  // a camera that stops is reported by then: 400 ms, or one picture missing
};

class UnevenCamera : public ::testing::TestWithParam<Camera> {};

TEST_P(UnevenCamera, IsCalledSilentOnlyWhenItIs) {
  const Camera camera = GetParam();
  std::mt19937 random(7);
  std::uniform_real_distribution<double> share(-camera.jitter, camera.jitter);
  Rhythm flight;
  const auto interval_s = [&] { return camera.interval_s * (1 + share(random)); };
  for (int i = 0; i < 40; ++i) flight.picture_after(interval_s());  // it is got to know
  const int before = flight.silences();
  for (double flown_s = 0; flown_s < 300; flown_s += camera.interval_s) flight.picture_after(interval_s());
  EXPECT_EQ(flight.state(), ServiceState::normal);
  EXPECT_LE(flight.silences() - before, 1) << "in five minutes";
  EXPECT_LE(flight.reported_after_s(), camera.reported_by_s);
}

INSTANTIATE_TEST_SUITE_P(Cameras, UnevenCamera,
                         ::testing::Values(Camera{1, 0, 1.21}, Camera{1, 0.3, 1.6}, Camera{1.0 / 3, 0, 0.41},
                                           Camera{1.0 / 3, 0.15, 0.47}, Camera{1.0 / 3, 0.3, 2.0 / 3 + 0.01},
                                           Camera{0.1, 0, 0.41}, Camera{0.1, 0.5, 0.41}, Camera{1.0 / 30, 0.5, 0.41},
                                           Camera{2, 0.1, 2.7}));

TEST(CameraSilence, BurstsDoNotChangeTheIntervalOfASlowCamera) {
  Rhythm flight;
  for (int i = 0; i < 20; ++i) flight.picture_after(1);
  const int before = flight.silences();
  for (int i = 0; i < 60; ++i) {
    flight.picture_after(1);
    for (int k = 0; k < 9; ++k) flight.picture_after(0.008);
  }
  EXPECT_EQ(flight.silences(), before);
  EXPECT_EQ(flight.state(), ServiceState::normal);
}

// Ten times as many pictures for five seconds, then as before.
TEST(CameraSilence, AFastPeriodCostsASlowCameraOneDeadReckoningAtMost) {
  for (const double interval_s : {1.0 / 3, 1.0}) {
    Rhythm flight;
    for (int i = 0; i < 20; ++i) flight.picture_after(interval_s);
    const int before = flight.silences();
    for (double s = 0; s < 5; s += interval_s / 10) flight.picture_after(interval_s / 10);
    for (int i = 0; i < 30; ++i) flight.picture_after(interval_s);
    EXPECT_LE(flight.silences() - before, 1) << interval_s;
    EXPECT_EQ(flight.state(), ServiceState::normal);
  }
}

TEST(CameraSilence, ASlowerCameraIsAcceptedWithoutOscillation) {
  Rhythm flight;
  for (int i = 0; i < 50; ++i) flight.picture_after(0.1);
  const int before = flight.silences();
  for (int i = 0; i < 30; ++i) flight.picture_after(1);
  EXPECT_EQ(flight.silences() - before, 1);
  EXPECT_EQ(flight.state(), ServiceState::normal);
}

TEST(CameraSilence, EveryLongGapOfAnyCameraIsReported) {
  Rhythm flight;
  for (int gap = 0; gap < 20; ++gap) {
    for (int i = 0; i < 8; ++i) flight.picture_after(1.0 / 3);
    EXPECT_EQ(flight.state(), ServiceState::normal) << gap;
    flight.picture_after(2);
    EXPECT_EQ(flight.silences(), gap + 1);
  }
}

}  // namespace
}  // namespace nadir
