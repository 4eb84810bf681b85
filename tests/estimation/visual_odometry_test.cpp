// What every odometry front end must do: a known motion is recovered, and without one to be seen nothing is made up.
#include <gtest/gtest.h>

#include <Eigen/LU>
#include <cmath>
#include <opencv2/imgproc.hpp>

#include "base/random.hpp"
#include "bench/flow_odometry.hpp"
#include "estimation/correlated_frames.hpp"
#include "estimation/odometry_features.hpp"
#include "estimation/visual_odometry.hpp"
#include "geodesy/angles.hpp"
#include "simulation/camera_sensor.hpp"
#include "vision/synthetic_ground.hpp"

namespace nadir {
namespace {

using test::Landscape;

CameraModel camera() {
  CameraModel model;
  model.width = 480;
  model.height = 360;
  model.fx = model.fy = 320;
  model.cx = 241;
  model.cy = 178.5;
  model.distortion = {-0.08, 0.01, 0.0005, -0.0005, 0};
  return model;
}

const Landscape& landscape() {
  static const Landscape world(9, 220);
  return world;
}

OdometryFrame frame_at(const CameraPose& pose) {
  OdometryFrame frame;
  frame.grey = test::photograph(landscape().ground(), camera(), pose);
  frame.camera = camera();
  frame.attitude = pose.attitude;
  frame.agl_m = pose.agl_m;
  frame.heading_sigma_rad = 0.05;
  frame.tilt_sigma_rad = 0.002;
  return frame;
}

struct FrontEnd {
  const char* name;
  std::unique_ptr<OdometryFrontEnd> (*make)();
  bool measures_standstill;
};

class Odometry : public testing::TestWithParam<FrontEnd> {
 protected:
  static std::unique_ptr<OdometryFrontEnd> make() { return GetParam().make(); }
  static std::optional<OdometryStep> step_between(const CameraPose& a, const CameraPose& b);
  static void expect_step(const CameraPose& a, const CameraPose& b);
};

INSTANTIATE_TEST_SUITE_P(FrontEnds, Odometry,
                         testing::Values(FrontEnd{"features", make_feature_odometry, false},
                                         FrontEnd{"flow", make_flow_odometry, true}),
                         [](const auto& tested) { return tested.param.name; });

std::optional<OdometryStep> Odometry::step_between(const CameraPose& a, const CameraPose& b) {
  const auto odometry = make();
  EXPECT_FALSE(odometry->track(frame_at(a))) << "the first frame has nothing to compare with";
  return odometry->track(frame_at(b));
}

void Odometry::expect_step(const CameraPose& a, const CameraPose& b) {
  const auto step = step_between(a, b);
  ASSERT_TRUE(step);
  const Eigen::Vector2d truth(b.position.east_m - a.position.east_m, b.position.north_m - a.position.north_m);
  EXPECT_LT((step->displacement_m - truth).norm(), 0.01 * truth.norm()) << step->displacement_m.transpose();
  EXPECT_NEAR(step->measurement.value[3], 0, radians(0.3)) << "the heading's change was measured as it was";
  EXPECT_GE(step->inliers, 15);
  EXPECT_GT(step->covariance_m2.determinant(), 0);
}

// 120 m above ground the picture covers 180 m x 135 m.
TEST_P(Odometry, StraightAhead) {
  expect_step({{-20, -10}, 120, {radians(30), 0, 0}}, {{0, 25}, 120, {radians(30), 0, 0}});
}

TEST_P(Odometry, ThirtyPercentOverlap) {
  const double heading = radians(60), step_m = 0.7 * 135;
  expect_step({{-40, -20}, 120, {heading, 0, 0}},
              {{-40 + step_m * std::sin(heading), -20 + step_m * std::cos(heading)}, 120, {heading, 0, 0}});
}

TEST_P(Odometry, ATurnOfTwentyFiveDegrees) {
  expect_step({{-20, -10}, 120, {radians(-10), 0, 0}}, {{-12, 28}, 121, {radians(15), 0, 0}});
}

TEST_P(Odometry, Tilted) {
  expect_step({{-20, -10}, 120, {radians(75), radians(6), radians(-4)}},
              {{18, -2}, 118, {radians(82), radians(-3), radians(12)}});
}

// A tilt of the telemetry that is off by 2 degrees in one frame is found out, as far as its sigma lets it be.
TEST_P(Odometry, CorrectsAWrongTilt) {
  const CameraPose a{{-20, -10}, 120, {radians(75), 0, 0}}, b{{18, -2}, 120, {radians(75), 0, 0}};
  const auto odometry = make();
  OdometryFrame first = frame_at(a), second = frame_at(b);
  second.attitude.roll_rad += radians(2);  // 4.2 m on the ground
  first.tilt_sigma_rad = second.tilt_sigma_rad = radians(2);
  EXPECT_FALSE(odometry->track(first));
  const auto step = odometry->track(second);
  ASSERT_TRUE(step);
  EXPECT_LT((step->displacement_m - Eigen::Vector2d(38, 8)).norm(), 1.5);
}

TEST_P(Odometry, NothingWithoutOverlap) { EXPECT_FALSE(step_between({{-120, -100}, 120, {}}, {{110, 120}, 120, {}})); }

// The same ground in the frame before and in the one now, but over another landscape: nothing is shared.
TEST_P(Odometry, NothingOverAnotherLandscape) {
  static const Landscape other(10, 220);
  const CameraPose a{{-20, -10}, 120, {}}, b{{0, 15}, 120, {}};
  OdometryFrame elsewhere = frame_at(b);
  elsewhere.grey = test::photograph(other.ground(), camera(), b);
  const auto odometry = make();
  EXPECT_FALSE(odometry->track(frame_at(a)));
  EXPECT_FALSE(odometry->track(elsewhere));
}

// The error is what the covariance says: a motion in each direction, within its ellipse.
TEST_P(Odometry, TheCovarianceCoversTheError) {
  for (const double course : {0.3, 1.9, 3.4, 5.2}) {
    const CameraPose a{{0, 0}, 120, {course, radians(2), radians(-3)}};
    const CameraPose b{{35 * std::sin(course), 35 * std::cos(course)}, 121, {course + 0.05, radians(-1), radians(2)}};
    const auto step = step_between(a, b);
    ASSERT_TRUE(step) << course;
    const Eigen::Vector2d off = step->displacement_m - Eigen::Vector2d(b.position.east_m, b.position.north_m);
    EXPECT_LT(off.dot(step->covariance_m2.inverse() * off), 13.8) << course << ": " << off.transpose();
  }
}

TEST_P(Odometry, NothingInTheDark) {
  const CameraPose pose{{0, 0}, 120, {}};
  const auto odometry = make();
  OdometryFrame dark = frame_at(pose);
  dark.grey.setTo(0);
  EXPECT_FALSE(odometry->track(frame_at(pose)));
  EXPECT_FALSE(odometry->track(dark));
  EXPECT_FALSE(odometry->track(frame_at(pose))) << "the dark frame has nothing to compare with";
  EXPECT_TRUE(odometry->track(frame_at({{15, 5}, 120, {}})));
}

// A motion of nothing, or none for those who take what stands still for the camera's own picture.
TEST_P(Odometry, ACameraThatStandsStillDoesNotMove) {
  const CameraPose pose{{10, 5}, 120, {radians(200), radians(3), 0}};
  const auto step = step_between(pose, pose);
  ASSERT_EQ(step.has_value(), GetParam().measures_standstill);
  if (!step) return;
  EXPECT_LT(step->displacement_m.norm(), 0.05);
  EXPECT_NEAR(step->measurement.value[3], 0, 1e-3);
  EXPECT_NEAR(step->overlap, 1, 0.01);
}

TEST_P(Odometry, ForgetsWhenReset) {
  const CameraPose pose{{10, 5}, 120, {}};
  const auto odometry = make();
  EXPECT_FALSE(odometry->track(frame_at(pose)));
  odometry->reset();
  EXPECT_FALSE(odometry->track(frame_at(pose)));
}

// As a camera at night gives it: little light, and noise that is stronger than what the light shows.
OdometryFrame at_night(OdometryFrame frame, Random& random) {
  for (int row = 0; row < frame.grey.rows; ++row) {
    for (int column = 0; column < frame.grey.cols; ++column) {
      std::uint8_t& value = frame.grey.at<std::uint8_t>(row, column);
      value = cv::saturate_cast<std::uint8_t>(12 + 0.035 * value + random.normal(0, 6));
    }
  }
  return frame;
}

TEST(FeatureOdometry, CorrelatesFramesWhoseFeaturesDrownInNoise) {
  Random random(5);
  for (int i = 0; i < 6; ++i) {
    const CameraPose a{{4.0 * i, -10}, 120, {radians(40.0 * i), radians(2), 0}};
    const CameraPose b{{4.0 * i + 20, 12}, 121, {radians(40.0 * i + 2), 0, radians(-1)}};
    const OdometryFrame before = at_night(frame_at(a), random), now = at_night(frame_at(b), random);
    const OdometryFeatures one = odometry_features(before), other = odometry_features(now);
    EXPECT_FALSE(measure_motion(one.frame, other.frame, similar_pixels(one, other))) << "features suffice: no test";
    const auto odometry = make_feature_odometry();
    EXPECT_FALSE(odometry->track(before));
    const auto step = odometry->track(now);
    ASSERT_TRUE(step) << i;
    const Eigen::Vector2d off = step->displacement_m - Eigen::Vector2d(20, 22);
    EXPECT_LT(off.norm(), 3) << i;
    EXPECT_LT(off.dot(step->covariance_m2.inverse() * off), 13.8) << i << ": " << off.transpose();
  }
}

// Whatever telemetry says of one frame and the next, nothing is found and nothing ends the program.
TEST(FeatureOdometry, NothingFromHeightsAndTiltsThatDoNotFit) {
  Random random(7);
  const CameraPose level{{0, 0}, 120, {}};
  for (const CameraPose& odd : {CameraPose{{0, 0}, 30'000, {}}, CameraPose{{0, 0}, 1, {}},
                                CameraPose{{0, 0}, 120, {0, radians(58), radians(40)}}}) {
    for (const bool first : {true, false}) {
      OdometryFrame before = at_night(frame_at(level), random), now = at_night(frame_at(level), random);
      OdometryFrame& changed = first ? before : now;
      changed.agl_m = odd.agl_m;
      changed.attitude = odd.attitude;
      EXPECT_TRUE(correlated_pixels(before, now).now.empty()) << odd.agl_m << " m, first: " << first;
      const auto odometry = make_feature_odometry();
      odometry->track(before);
      EXPECT_FALSE(odometry->track(now));
    }
  }
}

TEST(FeatureOdometry, MakesNoMotionOfNoise) {
  static const Landscape other(10, 220);
  Random random(6);
  for (int i = 0; i < 6; ++i) {
    const CameraPose a{{4.0 * i, -10}, 120, {}}, b{{4.0 * i + 20, 12}, 120, {}};
    OdometryFrame elsewhere = frame_at(b);
    elsewhere.grey = test::photograph(other.ground(), camera(), b);
    const auto odometry = make_feature_odometry();
    EXPECT_FALSE(odometry->track(at_night(frame_at(a), random)));
    EXPECT_FALSE(odometry->track(at_night(elsewhere, random))) << i;
    elsewhere.grey.setTo(0);
    EXPECT_FALSE(odometry->track(at_night(elsewhere, random))) << i << ": nothing but noise";
    EXPECT_FALSE(odometry->track(at_night(elsewhere, random))) << i << ": twice";
  }
}

// Water, fog, snow: all that such frames share is the camera's own picture, which stands still. A lens that darkens
// towards its corners once made a flight over a lake stand still, and its level with it.
class OverNothing : public testing::Test {
 protected:
  // picture: of the camera's size, grey; changed as lens and sensor do, another noise for each.
  OdometryFrame seen(cv::Mat picture, const CameraPose& pose) {
    cv::Mat colour;
    cv::cvtColor(picture, colour, cv::COLOR_GRAY2BGR);
    sensor_.expose(colour, {.gain = random_.uniform(0.97, 1.03)}, number_++);
    OdometryFrame frame = frame_at(pose);
    cv::cvtColor(colour, frame.grey, cv::COLOR_BGR2GRAY);
    return frame;
  }

  cv::Mat water(double level) const { return {camera().height, camera().width, CV_8UC1, cv::Scalar(level)}; }

  static void print_overlay(cv::Mat& picture) {
    const std::pair<const char*, cv::Point> texts[] = {
        {"FALCON-7", {15, 30}}, {"14.8V 62%", {310, 30}}, {"AGL 120", {15, 190}},  {"GS 22.4", {360, 190}},
        {"LOITER", {190, 330}}, {"00:17:53", {330, 330}}, {"RSSI -71", {15, 330}}, {"+", {232, 190}}};
    for (const auto& [text, place] : texts) {
      cv::putText(picture, text, place, cv::FONT_HERSHEY_SIMPLEX, 0.8, cv::Scalar(255), 2);
    }
  }

  static constexpr CameraPose kBefore{{0, 0}, 120, {}};
  CameraPose now(int i) const {
    return {{4.0 * i - 8, 15}, 120, {radians(2.0 * i - 4), radians(1.5 * i - 3), radians(0.7 * i)}};
  }

 private:
  CameraSensor sensor_{{camera().width, camera().height}, camera().fx, 3};
  Random random_{8};
  std::uint64_t number_ = 0;
};

TEST_F(OverNothing, ALensThatDarkensTowardsItsCornersIsNoMotion) {
  for (int i = 0; i < 8; ++i) {
    const double level = 40 + 20 * i;
    const auto odometry = make_feature_odometry();
    EXPECT_FALSE(odometry->track(seen(water(level), kBefore)));
    EXPECT_FALSE(odometry->track(seen(water(level), now(i)))) << i;
  }
}

TEST_F(OverNothing, TextInThePictureIsNoMotion) {
  cv::Mat picture = water(90);
  print_overlay(picture);
  for (int i = 0; i < 5; ++i) {
    const OdometryFrame one = seen(picture, kBefore), other = seen(picture, now(i));
    EXPECT_TRUE(measure_motion(one, other, similar_pixels(odometry_features(one), odometry_features(other))))
        << "no features in the text: no test";
    const auto odometry = make_feature_odometry();
    EXPECT_FALSE(odometry->track(one));
    EXPECT_FALSE(odometry->track(other)) << i;
  }
}

TEST_F(OverNothing, APatternOfTheSensorIsNoMotion) {
  Random random(12);
  cv::Mat picture = water(60);
  for (int row = 0; row < picture.rows; ++row) {
    for (int column = 0; column < picture.cols; ++column) {
      picture.at<std::uint8_t>(row, column) = cv::saturate_cast<std::uint8_t>(60 + random.normal(0, 4));
    }
  }
  for (int i = 0; i < 5; ++i) {
    const auto odometry = make_feature_odometry();
    EXPECT_FALSE(odometry->track(seen(picture, kBefore)));
    EXPECT_FALSE(odometry->track(seen(picture, now(i)))) << i;
  }
}

TEST_F(OverNothing, TheGroundBeneathTextStillMoves) {
  for (int i = 0; i < 5; ++i) {
    cv::Mat one = frame_at(kBefore).grey, other = frame_at(now(i)).grey;
    print_overlay(one);
    print_overlay(other);
    const auto odometry = make_feature_odometry();
    EXPECT_FALSE(odometry->track(seen(one, kBefore)));
    const auto step = odometry->track(seen(other, now(i)));
    ASSERT_TRUE(step) << i;
    EXPECT_LT((step->displacement_m - Eigen::Vector2d(4.0 * i - 8, 15)).norm(), 1) << i;
  }
}

// A picture of another place between two that overlap.
TEST(FeatureOdometry, ComparesAFrameWithTheOneBeforeAnOutlier) {
  const CameraPose first{{0, 0}, 100, {}}, outlier{{150, 150}, 100, {}}, second{{22, 13}, 100, {}};
  const auto direct = make_feature_odometry(), over = make_feature_odometry();
  direct->track(frame_at(first));
  const auto expected = direct->track(frame_at(second));
  ASSERT_TRUE(expected);
  EXPECT_FALSE(over->track(frame_at(first)));
  EXPECT_FALSE(over->track_over_last()) << "there is no frame before the last";
  EXPECT_FALSE(over->track(frame_at(outlier)));
  EXPECT_FALSE(over->track_over_last());
  EXPECT_FALSE(over->track(frame_at(second)));
  const auto step = over->track_over_last();
  ASSERT_TRUE(step);
  EXPECT_EQ(step->displacement_m, expected->displacement_m) << "bit for bit";
  EXPECT_EQ(step->measurement.covariance, expected->measurement.covariance);
  over->reset();
  EXPECT_FALSE(over->track(frame_at(second)));
  EXPECT_FALSE(over->track_over_last());
}

}  // namespace
}  // namespace nadir
