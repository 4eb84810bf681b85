// The poses of frames that the map has confirmed: what tiles are made from.
#include <gtest/gtest.h>

#include <cmath>
#include <opencv2/imgproc.hpp>

#include "estimation/localizer.hpp"
#include "estimation/localizer_fixture.hpp"
#include "geodesy/angles.hpp"

namespace nadir {
namespace {

using namespace test;

void expect_near(const FramePose& pose, const Moment& moment) {
  const CameraPose& truth = moment.truth;
  const double off_m = distance_m(pose.pose.position, truth.position);
  EXPECT_LT(off_m, 3);
  EXPECT_LT(off_m, 4 * pose.sigma_m);
  EXPECT_NEAR(pose.pose.agl_m, truth.agl_m, 0.03 * truth.agl_m);
  EXPECT_NEAR(wrap_pi(pose.pose.attitude.heading_rad - truth.attitude.heading_rad), 0, radians(1.5));
  EXPECT_NEAR(pose.pose.attitude.pitch_rad, truth.attitude.pitch_rad, radians(1.5));
  EXPECT_NEAR(pose.pose.attitude.roll_rad, truth.attitude.roll_rad, radians(1.5));
  EXPECT_EQ(pose.source, SourceLabel::satellite_anchored);
  EXPECT_NEAR(pose.sigma_m * pose.sigma_m, 0.5 * pose.covariance_m2.trace(), 1e-9);
}

bool clear(const AnchorReport& anchor) {
  const GateLimits limits;
  return anchor.ratio < limits.clear_ratio && anchor.inliers >= limits.sure_inlier_share * anchor.patches;
}

TEST(LocalizerPoses, AreThoseOfTheAnchoredFrames) {
  Localizer localizer(flight_camera(), LocalFrame(kOrigin), &landscape_tiles(), start(), config());
  for (std::size_t i = 0; i < short_flight().size(); ++i) {
    const FrameReport report = localizer.process(short_flight()[i].image, short_flight()[i].telemetry);
    ASSERT_EQ(report.anchor_pose.has_value(), report.anchor.verdict == AnchorVerdict::accepted);
    ASSERT_TRUE(report.anchor_pose);
    expect_near(*report.anchor_pose, short_flight()[i]);
    EXPECT_EQ(report.anchor_pose->confirmed, i > 0 || clear(report.anchor)) << "the first one is on its own";
    EXPECT_FALSE(report.anchor_pose->refined);
    EXPECT_NEAR(report.anchor_pose->sigma_m, report.estimate.sigma_m, 1e-9);
  }
  const auto refined = localizer.refined_poses();
  const auto estimates = localizer.refined();
  ASSERT_EQ(refined.size(), short_flight().size());
  for (std::size_t i = 0; i < refined.size(); ++i) {
    ASSERT_TRUE(refined[i]);
    expect_near(*refined[i], short_flight()[i]);
    EXPECT_TRUE(refined[i]->confirmed);
    EXPECT_TRUE(refined[i]->refined);
    EXPECT_NEAR(refined[i]->sigma_m, estimates[i].sigma_m, 1e-9);
    const PlanePoint at = LocalFrame(kOrigin).plane_from_lonlat(*estimates[i].position);
    EXPECT_NEAR(refined[i]->pose.position.east_m, at.east_m, 1e-6);
  }
}

TEST(LocalizerPoses, FramesWithoutAnAnchorHaveNone) {
  Localizer localizer(flight_camera(), LocalFrame(kOrigin), &landscape_tiles(), start(), config());
  bool last_is_clear = false;
  for (std::size_t i = 0; i < short_flight().size(); ++i) {
    const cv::Mat black(short_flight()[i].image.size(), CV_8UC1, cv::Scalar(0));
    const FrameReport report = localizer.process(i == 2 ? black : short_flight()[i].image, short_flight()[i].telemetry);
    EXPECT_EQ(report.anchor_pose.has_value(), i != 2);
    last_is_clear = clear(report.anchor);
  }
  const auto refined = localizer.refined_poses();
  EXPECT_FALSE(refined[2]);
  ASSERT_TRUE(refined[3]);
  EXPECT_EQ(refined[3]->confirmed, last_is_clear) << "nothing leads to another anchor without a break";
  EXPECT_TRUE(refined[1]->confirmed);
}

TEST(LocalizerPoses, OfALateAnchorIsThatOfItsOwnFrame) {
  Localizer localizer(flight_camera(), LocalFrame(kOrigin), &landscape_tiles(), start(), config());
  localizer.process(short_flight()[0].image, short_flight()[0].telemetry);
  auto followed = localizer.track(short_flight()[1].image, short_flight()[1].telemetry);
  ASSERT_TRUE(followed.job);
  EXPECT_FALSE(followed.report.anchor_pose);
  followed.job->run();
  localizer.track(short_flight()[2].image, short_flight()[2].telemetry);
  const FrameReport report = localizer.finish(std::move(followed.job));
  ASSERT_TRUE(report.anchor_pose);
  expect_near(*report.anchor_pose, short_flight()[1]);
}

TEST(LocalizerPoses, WithoutAMapThereAreNone) {
  Localizer localizer(flight_camera(), LocalFrame(kOrigin), nullptr, start(), config());
  EXPECT_TRUE(localizer.refined_poses().empty());
  localizer.process(short_flight()[0].image, short_flight()[0].telemetry);
  ASSERT_EQ(localizer.refined_poses().size(), 1U);
  EXPECT_FALSE(localizer.refined_poses().front());
}

}  // namespace
}  // namespace nadir
