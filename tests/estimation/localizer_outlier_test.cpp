// Pictures of another place in the middle of a flight: they are skipped, and the track goes on.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <opencv2/core.hpp>

#include "estimation/localizer.hpp"
#include "estimation/localizer_fixture.hpp"
#include "estimation/tracking_state.hpp"

namespace nadir {
namespace {

using namespace test;

// Where the landscape is, 350 m from where the flight begins.
cv::Mat picture_350_m_away() {
  const CameraPose elsewhere{{187, 203}, 60, {0.7, 0, 0}};
  EXPECT_NEAR(distance_m(elsewhere.position, short_flight()[0].truth.position), 350, 2);
  return photograph(landscape_ground(), flight_camera().camera, elsewhere);
}

std::vector<FrameReport> fly(const std::vector<Moment>& moments, const TileSource* tiles) {
  Localizer localizer(flight_camera(), LocalFrame(kOrigin), tiles, start(), config());
  std::vector<FrameReport> reports;
  for (const Moment& moment : moments) reports.push_back(localizer.process(moment.image, moment.telemetry));
  return reports;
}

TEST(Outliers, ThePictureAfterAnOutlierIsTrackedByOdometryAlone) {
  const std::vector<Moment> moments = flight(7);
  std::vector<Moment> disturbed = moments;
  disturbed[3].image = picture_350_m_away();
  const auto clean = fly(moments, nullptr), found = fly(disturbed, nullptr);
  EXPECT_FALSE(found[3].odometry.tracked);
  EXPECT_EQ(found[3].estimate.segment, 1) << "it belongs to nothing";
  for (const std::size_t i : {4U, 5U, 6U}) {
    EXPECT_TRUE(found[i].odometry.tracked) << i;
    EXPECT_EQ(found[i].estimate.segment, 0) << i;
    EXPECT_EQ(found[i].estimate.source, SourceLabel::vo_extrapolated) << i;
    EXPECT_LT(off_m(found[i].estimate, moments[i]), 50) << i;
    EXPECT_NEAR(off_m(found[i].estimate, moments[i]), off_m(clean[i].estimate, moments[i]), 2) << i;
    EXPECT_NEAR(found[i].estimate.sigma_m, clean[i].estimate.sigma_m, 0.05 * clean[i].estimate.sigma_m) << i;
  }
  EXPECT_GT(found[4].odometry.step_m, 1.8 * found[5].odometry.step_m) << "two steps at once";
  EXPECT_GT(found[3].estimate.sigma_m, clean[3].estimate.sigma_m);
}

TEST(Outliers, OverAMapTheTrackStaysAnchored) {
  const std::vector<Moment> moments = flight(9);
  std::vector<Moment> disturbed = moments;
  disturbed[2].image = picture_350_m_away();
  cv::flip(picture_350_m_away(), disturbed[5].image, -1);
  disturbed[7].image = moments[0].image;
  Localizer localizer(flight_camera(), LocalFrame(kOrigin), &landscape_tiles(), start(), config());
  for (std::size_t i = 0; i < moments.size(); ++i) {
    const bool outlier = i == 2 || i == 5 || i == 7;
    const FrameReport report = localizer.process(disturbed[i].image, moments[i].telemetry);
    EXPECT_EQ(report.odometry.tracked, i != 0 && !outlier) << i;
    EXPECT_EQ(report.anchor.verdict == AnchorVerdict::accepted, !outlier) << i;
    EXPECT_LT(off_m(report.estimate, moments[i]), outlier ? 30 : 5) << i;
    EXPECT_LT(off_m(report.estimate, moments[i]), 4 * report.estimate.sigma_m) << i;
    EXPECT_EQ(report.estimate.segment == 0, !outlier) << i;
    expect_sound(report.estimate);
  }
  const auto refined = localizer.refined();
  ASSERT_EQ(refined.size(), moments.size());
  for (std::size_t i = 0; i < refined.size(); ++i) {
    EXPECT_LT(off_m(refined[i], moments[i]), i == 2 || i == 5 || i == 7 ? 30 : 4) << i;
  }
  EXPECT_FALSE(localizer.refined_poses()[5]);
}

// The flight without that frame, but with its telemetry.
TEST(Outliers, TheTrackIsThatOfAFlightWithoutTheFrame) {
  std::vector<Moment> disturbed = flight(6);
  disturbed[3].image = picture_350_m_away();
  std::vector<Moment> shorter = disturbed;
  const Telemetry& skipped = shorter[3].telemetry;
  shorter[4].telemetry.intervals = {
      {skipped.time_s - shorter[2].telemetry.time_s, skipped.heading_rad, skipped.imu_dv_mps}};
  shorter.erase(shorter.begin() + 3);
  const auto with = fly(disturbed, nullptr), without = fly(shorter, nullptr);
  const LocalFrame frame(kOrigin);
  for (const std::size_t i : {4U, 5U}) {
    const PlanePoint found = frame.plane_from_lonlat(*with[i].estimate.position);
    const PlanePoint expected = frame.plane_from_lonlat(*without[i - 1].estimate.position);
    EXPECT_LT(distance_m(found, expected), 0.5) << i;
    EXPECT_NEAR(with[i].estimate.sigma_m, without[i - 1].estimate.sigma_m, 0.1) << i;
  }
}

// In flight anchors are late: whatever frames were tracked meanwhile, the track is the same in the end.
TEST(Outliers, LateAnchorsFindTheTrackOverTheOutlier) {
  const std::vector<Moment> moments = flight(6);
  for (const std::size_t taken : {0U, 1U, 2U, 3U}) {
    Localizer localizer(flight_camera(), LocalFrame(kOrigin), &landscape_tiles(), start(), config());
    std::unique_ptr<AnchorJob> job;
    for (std::size_t i = 0; i < 5; ++i) {
      auto tracked = localizer.track(i == 3 ? picture_350_m_away() : moments[i].image, moments[i].telemetry);
      if (i == taken) {
        job = std::move(tracked.job);
      } else if (tracked.job && i < taken) {
        tracked.job->run();
        localizer.finish(std::move(tracked.job));
      }
    }
    ASSERT_TRUE(job) << taken;
    job->run();
    const FrameReport late = localizer.finish(std::move(job));
    EXPECT_EQ(late.anchor.verdict == AnchorVerdict::accepted, taken != 3) << taken;
    EXPECT_LT(off_m(late.estimate, moments[4]), taken == 3 ? 15 : 6) << taken;
    const FrameReport next = localizer.process(moments[5].image, moments[5].telemetry);
    EXPECT_TRUE(next.odometry.tracked) << taken;
    EXPECT_EQ(next.anchor.verdict, AnchorVerdict::accepted) << taken;
    EXPECT_LT(off_m(next.estimate, moments[5]), 5) << taken;
  }
}

// A camera that was turned to other ground shows it from then on: the frames continue each other, not the old ones.
TEST(Outliers, TwoFramesOfAnotherPlaceAreNoOutlier) {
  const std::vector<Moment> moments = flight(10);
  std::vector<Moment> cut{moments[0], moments[1], moments[8], moments[9]};
  for (const std::size_t i : {2U, 3U}) {
    cut[i].telemetry = moments[i].telemetry;
    cut[i].telemetry.frame = "cut" + std::to_string(i);
  }
  const auto found = fly(cut, nullptr);
  EXPECT_FALSE(found[2].odometry.tracked);
  EXPECT_TRUE(found[3].odometry.tracked);
  EXPECT_EQ(found[3].estimate.segment, 1) << "a new segment";
  EXPECT_EQ(found[3].estimate.source, SourceLabel::vo_extrapolated);
}

// ---- The state machine by itself

constexpr FrameLink kFirst{.first = true, .comparable = true};
constexpr FrameLink kTracked{.comparable = true, .expected_overlap = true, .tracked = true};
constexpr FrameLink kLost{.comparable = true, .expected_overlap = true};
constexpr FrameLink kOverOutlier{.comparable = true, .over_outlier = true};
constexpr FrameLink kUnfit{.expected_overlap = true};

TrackingState after(std::initializer_list<FrameLink> links) {
  TrackingState state(true);
  for (const FrameLink& link : links) state.on_frame(link);
  return state;
}

TEST(TrackingStates, ASkippedFrameLeavesTheTrackAsItWas) {
  const TrackingState outlier = after({kFirst, kTracked, kLost});
  EXPECT_TRUE(outlier.broken());
  EXPECT_FALSE(outlier.unbroken());
  EXPECT_EQ(outlier.segment(), 1);
  const TrackingState skipped = after({kFirst, kTracked, kLost, kOverOutlier});
  EXPECT_TRUE(skipped.unbroken());
  EXPECT_TRUE(skipped.tracked());
  EXPECT_FALSE(skipped.broken());
  EXPECT_EQ(skipped.segment(), 0);
  EXPECT_EQ(after({kFirst, kLost, kOverOutlier, kLost}).segment(), 2) << "numbers are given once";
  EXPECT_EQ(after({kFirst, kLost, kOverOutlier, kLost, kOverOutlier}).segment(), 0);
  EXPECT_EQ(after({kFirst, kUnfit}).segment(), 1);
  EXPECT_FALSE(after({kFirst, kUnfit}).broken());
  EXPECT_EQ(after({kFirst, kLost, kLost}).segment(), 2);
}

}  // namespace
}  // namespace nadir
