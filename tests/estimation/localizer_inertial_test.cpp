// Visual motions that the prediction contradicts; and the localizer with an inertial sensor, which carries dark
// stretches.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <opencv2/core.hpp>

#include "estimation/localizer.hpp"
#include "estimation/localizer_fixture.hpp"
#include "estimation/tracking_state.hpp"
#include "geodesy/angles.hpp"
#include "simulation/mems_imu.hpp"
#include "vision/localizer_parameters.hpp"

namespace nadir {
namespace {

using namespace test;
using Eigen::Vector2d;
using Eigen::Vector3d;

constexpr double kSample_s = 0.01, kSwing_s = 0.2;  // in which the velocity becomes that of the next stretch

Vector3d velocity_after(const std::vector<Moment>& moments, std::size_t i) {
  const std::size_t from = std::min(i, moments.size() - 2);
  const Vector2d way = moments[from + 1].truth.position - moments[from].truth.position;
  const Vector2d mean = way / (moments[from + 1].telemetry.time_s - moments[from].telemetry.time_s);
  return {mean.x(), mean.y(), 0};
}

// Between the frames i and i + 1: the attitude swings over, the velocity changes before the next frame.
BodyMotion body_at(const std::vector<Moment>& moments, std::size_t i, double time_s) {
  const Moment &a = moments[i], &b = moments[i + 1];
  const double seconds = b.telemetry.time_s - a.telemetry.time_s, into_s = time_s - a.telemetry.time_s;
  const double u = into_s / seconds, swing = u * u * (3 - 2 * u);
  const auto between = [&](double from, double to) { return from + swing * wrap_pi(to - from); };
  const Attitude &x = a.truth.attitude, &y = b.truth.attitude;
  const Eigen::Matrix3d camera = enu_from_camera(
      {between(x.heading_rad, y.heading_rad), between(x.pitch_rad, y.pitch_rad), between(x.roll_rad, y.roll_rad)});
  BodyMotion body{time_s, {}, {}};
  body.enu_from_body << -camera.col(1), camera.col(0), camera.col(2);
  const double changed = std::clamp((into_s - (seconds - kSwing_s)) / kSwing_s, 0.0, 1.0);
  body.velocity_mps = (1 - changed) * velocity_after(moments, i) + changed * velocity_after(moments, i + 1);
  return body;
}

std::vector<Moment> with_samples(std::vector<Moment> moments) {
  MemsImu imu({}, radians(kOrigin.lat_deg), Random(5));
  for (std::size_t i = 0; i + 1 < moments.size(); ++i) {
    const double from_s = moments[i].telemetry.time_s, to_s = moments[i + 1].telemetry.time_s;
    for (int k = 0; k < std::lround((to_s - from_s) / kSample_s); ++k) {
      const MeasuredRates sample =
          imu.measure(body_at(moments, i, from_s + k * kSample_s), body_at(moments, i, from_s + (k + 1) * kSample_s));
      moments[i + 1].telemetry.inertial.push_back({sample.time_s, sample.rate_rad_s, sample.force_mps2});
    }
  }
  return moments;
}

const std::vector<Moment>& plain_flight() {
  static const std::vector<Moment> moments = flight(14);
  return moments;
}
const std::vector<Moment>& inertial_flight() {
  static const std::vector<Moment> moments = with_samples(plain_flight());
  return moments;
}

// The real front end; of one frame, or of all (-1), it says something else.
class MistakenOdometry final : public OdometryFrontEnd {
 public:
  // inliers: that agree on it; nothing: as many as there are.
  MistakenOdometry(int frame, Vector2d off_m, std::optional<int> inliers)
      : frame_(frame), off_m_(std::move(off_m)), inliers_(inliers) {}
  std::optional<OdometryStep> track(const OdometryFrame& frame) override {
    auto step = real_->track(frame);
    if (step && (frame_ < 0 || frames_ == frame_)) {
      step->measurement.value.head<2>() += off_m_;
      step->inliers = inliers_.value_or(step->inliers);
    }
    ++frames_;
    return step;
  }
  void reset() override { real_->reset(); }

 private:
  std::unique_ptr<OdometryFrontEnd> real_ = make_feature_odometry();
  int frame_, frames_ = 0;
  Vector2d off_m_;
  std::optional<int> inliers_;
};

LocalizerConfig mistaken(int frame, const Vector2d& off_m, std::optional<int> inliers = {}) {
  LocalizerConfig mistaken = config();
  mistaken.odometry = [=] { return std::make_unique<MistakenOdometry>(frame, off_m, inliers); };
  return mistaken;
}

std::vector<FrameReport> fly(const std::vector<Moment>& moments, const LocalizerConfig& config,
                             const CameraFile& camera = flight_camera()) {
  Localizer localizer(camera, LocalFrame(kOrigin), nullptr, start(), config);
  std::vector<FrameReport> reports;
  for (const Moment& moment : moments) reports.push_back(localizer.process(moment.image, moment.telemetry));
  return reports;
}

// Without a map the start's error stays: what was flown since counts.
double drift_m(const std::vector<FrameReport>& flown, std::size_t from, std::size_t to) {
  const LocalFrame frame(kOrigin);
  const auto off = [&](std::size_t i) -> Vector2d {
    return frame.plane_from_lonlat(*flown[i].estimate.position) - plain_flight()[i].truth.position;
  };
  return (off(to) - off(from)).norm();
}

TEST(InertialFlight, OneWrongVisualMotionIsRefused) {
  const Vector2d off_m(9, -9);
  const auto fooled = fly(plain_flight(), mistaken(10, off_m)), found = fly(inertial_flight(), mistaken(10, off_m));
  EXPECT_TRUE(fooled[10].odometry.tracked);
  EXPECT_GT(drift_m(fooled, 9, 10), 8) << "nothing contradicted it";
  for (std::size_t i = 1; i < found.size(); ++i) EXPECT_EQ(found[i].odometry.tracked, i != 10) << i;
  EXPECT_LT(drift_m(found, 9, 10), 4);
  EXPECT_EQ(found[10].estimate.source, SourceLabel::dead_reckoned);
  EXPECT_GT(found[11].estimate.segment, found[9].estimate.segment);
  for (std::size_t i = 0; i < found.size(); ++i) expect_sound(found[i].estimate);
}

// Without the sensor's samples: a flight whose frames hardly overlapped was 600 m off with a protection level of 370 m,
// after a motion that 14 pairs of pixels agreed on by chance.
TEST(ChanceMotion, WhatFewPixelsAgreeOnMustFitThePrediction) {
  constexpr int kFew = 14, kMany = 100;
  const Vector2d wrong_m(25, -25);
  const auto few = fly(plain_flight(), mistaken(10, wrong_m, kFew)),
             many = fly(plain_flight(), mistaken(10, wrong_m, kMany)),
             right = fly(plain_flight(), mistaken(10, Vector2d::Zero(), kFew));
  EXPECT_FALSE(few[10].odometry.tracked);
  EXPECT_LT(drift_m(few, 9, 10), 8);
  EXPECT_LT(off_m(few.back().estimate, plain_flight().back()), 4 * few.back().estimate.sigma_m);
  EXPECT_TRUE(many[10].odometry.tracked);
  EXPECT_GT(drift_m(many, 9, 10), 20);
  EXPECT_TRUE(right[10].odometry.tracked);
}

// At the second frame the velocity is not known, and the prediction does not refuse a motion that is wrong by 17 m.
TEST(ChanceMotion, WhereThePredictionKnowsNothingTheLevelHoldsIt) {
  constexpr int kFew = 14, kMany = 100;
  const auto flown = [](int inliers) {
    LocalizerConfig config = mistaken(1, {12, -12}, inliers);
    config.integrity_risk = 1.01 * parameters::belief::kStartDoubt;  // the start itself is no better without a map
    return fly(plain_flight(), config);
  };
  const auto few = flown(kFew), many = flown(kMany);
  ASSERT_TRUE(few[1].odometry.tracked && many[1].odometry.tracked);
  EXPECT_GT(drift_m(few, 0, 1), 12);
  EXPECT_GT(few[1].estimate.hpl_m.value(), many[1].estimate.hpl_m.value() + 15);
  EXPECT_GT(few[2].estimate.sigma_m, 1.5 * many[2].estimate.sigma_m) << "the next motion does not fit";
}

TEST(ChanceMotion, IsTheMoreDoubtfulTheLessWasPredicted) {
  using parameters::tracking::kSureInliers;
  constexpr double kFrame_m2 = 50'000;
  const FlightFilter::MotionFit sharp{1, 5 * 5 * 0.05}, vague{1, 75 * 75 * 0.05}, off{6, 5 * 5 * 0.05};
  EXPECT_EQ(motion_doubt(vague, kSureInliers, kFrame_m2), 0);
  EXPECT_GT(motion_doubt(sharp, kSureInliers - 1, kFrame_m2), 0);
  EXPECT_LT(motion_doubt(sharp, kSureInliers - 1, kFrame_m2), 1e-4);
  EXPECT_GT(motion_doubt(vague, kSureInliers - 1, kFrame_m2), 1e-2);
  EXPECT_GT(motion_doubt(off, kSureInliers - 1, kFrame_m2), 10 * motion_doubt(sharp, kSureInliers - 1, kFrame_m2));
  EXPECT_GT(motion_doubt(vague, kSureInliers - 1, kFrame_m2 / 10),
            5 * motion_doubt(vague, kSureInliers - 1, kFrame_m2));
  EXPECT_LE(motion_doubt({0, 1e12}, 1, 1), 1);
}

TEST(InertialFlight, DarkFramesAreCarried) {
  std::vector<Moment> dark = inertial_flight(), without = plain_flight();
  const cv::Mat black = cv::Mat::zeros(dark[0].image.size(), CV_8UC1);
  for (std::size_t i = 9; i < dark.size(); ++i) dark[i].image = without[i].image = black;
  const auto carried = fly(dark, config()), lost = fly(without, config());
  const std::size_t last = dark.size() - 1;
  EXPECT_FALSE(carried[last].odometry.tracked);
  const auto grown_m2 = [last](const std::vector<FrameReport>& flown) {
    return std::pow(flown[last].estimate.sigma_m, 2) - std::pow(flown[8].estimate.sigma_m, 2);
  };
  EXPECT_LT(grown_m2(carried), 0.4 * grown_m2(lost));
  EXPECT_LT(drift_m(carried, 8, last), 12);
  EXPECT_LT(off_m(carried[last].estimate, dark[last]), 4 * carried[last].estimate.sigma_m);
  for (std::size_t i = 9; i <= last; ++i) {
    EXPECT_GT(carried[i].estimate.sigma_m, carried[i - 1].estimate.sigma_m) << i;
  }
}

// Wired the wrong way round.
std::vector<Moment> with_wrong_sensor() {
  std::vector<Moment> moments = inertial_flight();
  for (Moment& moment : moments) {
    for (InertialSample& sample : moment.telemetry.inertial) {
      sample.force_mps2.head<2>() = Vector2d(4, -5);
      sample.rate_rad_s = Vector3d(0.1, 0.2, -0.3);
    }
  }
  return moments;
}

// It is the sensor that is refused after three frames, and σ says so meanwhile.
TEST(InertialFlight, AWrongSensorDoesNotMislead) {
  const std::vector<Moment> moments = with_wrong_sensor();
  const auto flown = fly(moments, config());
  const auto tracked = std::ranges::count_if(flown, [](const FrameReport& report) { return report.odometry.tracked; });
  EXPECT_GE(tracked, 2) << "of each beginning one";
  EXPECT_LT(tracked, 8) << "and it was contradicted";
  for (std::size_t i = 0; i < flown.size(); ++i) {
    EXPECT_LT(off_m(flown[i].estimate, moments[i]), 4 * flown[i].estimate.sigma_m) << i;
    expect_sound(flown[i].estimate);
  }
}

// Motions that few pixels agree on contradict it as others do: they are not all taken for chance.
TEST(InertialFlight, AWrongSensorIsFoundOutByFewPixelsToo) {
  const std::vector<Moment> moments = with_wrong_sensor();
  constexpr int kFew = 14;
  const auto flown = fly(moments, mistaken(-1, Vector2d::Zero(), kFew));
  EXPECT_GT(flown[4].estimate.sigma_m, 3 * flown[3].estimate.sigma_m) << "after the third in a row";
  for (std::size_t i = 0; i < flown.size(); ++i) {
    if (!flown[i].estimate.position) continue;
    EXPECT_LT(off_m(flown[i].estimate, moments[i]), 4 * flown[i].estimate.sigma_m) << i;
  }
}

TEST(InertialFlight, WhatCannotBeUsedChangesNothing) {
  CameraFile on_gimbal = flight_camera();
  on_gimbal.on_gimbal = true;
  std::vector<Moment> useless = inertial_flight();
  for (Moment& moment : useless) {
    for (InertialSample& sample : moment.telemetry.inertial) sample.time_s -= 100;  // another clock
  }
  const auto plain = fly(plain_flight(), config()), gimbal = fly(inertial_flight(), config(), on_gimbal),
             late = fly(useless, config());
  for (std::size_t i = 0; i < plain.size(); ++i) {
    for (const auto* other : {&gimbal, &late}) {
      EXPECT_EQ((*other)[i].estimate.position->lon_deg, plain[i].estimate.position->lon_deg) << i;
      EXPECT_EQ((*other)[i].estimate.position->lat_deg, plain[i].estimate.position->lat_deg) << i;
      EXPECT_EQ((*other)[i].estimate.sigma_m, plain[i].estimate.sigma_m) << i;
    }
  }
}

TEST(InertialFlight, OverAMapItStaysAnchored) {
  Localizer localizer(flight_camera(), LocalFrame(kOrigin), &landscape_tiles(), start(), config());
  constexpr std::size_t kOverTheMap = 9;
  for (std::size_t i = 0; i < kOverTheMap; ++i) {
    const Moment& moment = inertial_flight()[i];
    const FrameReport report = localizer.process(moment.image, moment.telemetry);
    EXPECT_EQ(report.anchor.verdict, AnchorVerdict::accepted) << moment.telemetry.frame;
    EXPECT_LT(off_m(report.estimate, moment), 5);
    EXPECT_LT(off_m(report.estimate, moment), 4 * report.estimate.sigma_m);
  }
  const auto refined = localizer.refined();
  for (std::size_t i = 0; i < refined.size(); ++i) EXPECT_LT(off_m(refined[i], inertial_flight()[i]), 5) << i;
}

}  // namespace
}  // namespace nadir
