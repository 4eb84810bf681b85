// In flight a frame is matched with the map while later frames are tracked: a late anchor must have the same effect as
// an immediate one.
#include <gtest/gtest.h>

#include <cmath>
#include <optional>
#include <thread>

#include "estimation/localizer.hpp"
#include "estimation/localizer_fixture.hpp"
#include "support/cancel_after.hpp"

namespace nadir {
namespace {

using namespace test;

Localizer fresh() { return {flight_camera(), LocalFrame(kOrigin), &landscape_tiles(), start(), config()}; }

TEST(LateAnchor, CountsForTheFrameThatItWasTakenFrom) {
  Localizer late = fresh();
  std::unique_ptr<AnchorJob> job;
  FrameReport last;
  for (const Moment& moment : short_flight()) {
    auto tracked = late.track(moment.image, moment.telemetry);
    EXPECT_EQ(tracked.report.anchor.verdict, AnchorVerdict::not_tried);
    EXPECT_EQ(tracked.job == nullptr, job != nullptr) << "one at a time";
    if (!job) job = std::move(tracked.job);
    last = tracked.report;
  }
  ASSERT_TRUE(job);
  const Moment& now = short_flight().back();
  const double before_m = off_m(last.estimate, now), before_sigma_m = last.estimate.sigma_m;
  job->run();
  const FrameReport report = late.finish(std::move(job));
  ASSERT_EQ(report.anchor.verdict, AnchorVerdict::accepted);
  EXPECT_EQ(report.estimate.frame, now.telemetry.frame) << "the estimate is of the last frame";
  EXPECT_EQ(report.estimate.source, SourceLabel::vo_extrapolated);
  EXPECT_DOUBLE_EQ(*report.estimate.anchor_age_s, now.telemetry.time_s - short_flight().front().telemetry.time_s);
  EXPECT_GT(before_m, 10) << "the start is 19 m off";
  EXPECT_LT(off_m(report.estimate, now), 4);
  EXPECT_LT(report.estimate.sigma_m, before_sigma_m);
  EXPECT_LT(off_m(report.estimate, now), 3 * report.estimate.sigma_m);
  expect_sound(report.estimate);
  const auto refined = late.refined();
  ASSERT_EQ(refined.size(), short_flight().size());
  for (std::size_t i = 0; i < refined.size(); ++i) EXPECT_LT(off_m(refined[i], short_flight()[i]), 4) << i;
}

TEST(LateAnchor, RunImmediatelyItEqualsProcess) {
  Localizer whole = fresh(), parts = fresh();
  for (const Moment& moment : short_flight()) {
    const FrameReport expected = whole.process(moment.image, moment.telemetry);
    auto tracked = parts.track(moment.image, moment.telemetry);
    ASSERT_TRUE(tracked.job);
    std::thread([&] { tracked.job->run(); }).join();
    const FrameReport found = parts.finish(std::move(tracked.job));
    EXPECT_EQ(found.anchor.verdict, expected.anchor.verdict);
    EXPECT_EQ(found.estimate.position->lon_deg, expected.estimate.position->lon_deg) << "bit for bit";
    EXPECT_EQ(found.estimate.position->lat_deg, expected.estimate.position->lat_deg);
    EXPECT_EQ(found.estimate.sigma_m, expected.estimate.sigma_m);
    EXPECT_EQ(found.estimate.source, expected.estimate.source);
  }
}

TEST(LateAnchor, FramesAreTrackedWhileItRuns) {
  Localizer localizer = fresh();
  auto first = localizer.track(short_flight()[0].image, short_flight()[0].telemetry);
  ASSERT_TRUE(first.job);
  std::thread matching([&] { first.job->run(); });
  for (std::size_t i = 1; i < short_flight().size(); ++i) {
    EXPECT_TRUE(localizer.track(short_flight()[i].image, short_flight()[i].telemetry).report.odometry.tracked);
  }
  matching.join();
  EXPECT_EQ(localizer.finish(std::move(first.job)).anchor.verdict, AnchorVerdict::accepted);
}

TEST(LateAnchor, ATrackThatBrokeMeanwhileIsAnchoredButDeadReckoned) {
  Localizer localizer = fresh();
  auto first = localizer.track(short_flight()[0].image, short_flight()[0].telemetry);
  first.job->run();
  const Moment& dark = short_flight()[1];
  EXPECT_FALSE(localizer.track(cv::Mat::zeros(dark.image.size(), CV_8UC1), dark.telemetry).report.odometry.tracked);
  const FrameReport report = localizer.finish(std::move(first.job));
  EXPECT_EQ(report.anchor.verdict, AnchorVerdict::accepted);
  EXPECT_EQ(report.estimate.source, SourceLabel::dead_reckoned);
  EXPECT_LT(off_m(report.estimate, dark), 3 * report.estimate.sigma_m);
  EXPECT_EQ(report.estimate.segment, 1);
}

TEST(LateAnchor, AHealthyFlightIsMatchedAfterSomeDistance) {
  LocalizerConfig sparing = config();
  sparing.anchor_every_m = 1000;
  sparing.anchor_above_sigma_m = 100;
  Localizer localizer(flight_camera(), LocalFrame(kOrigin), &landscape_tiles(), start(), sparing);
  std::vector<AnchorVerdict> verdicts;
  for (const Moment& moment : short_flight()) {
    const FrameReport report = localizer.process(moment.image, moment.telemetry);
    verdicts.push_back(report.anchor.verdict);
    EXPECT_LT(off_m(report.estimate, moment), 4);
  }
  EXPECT_EQ(verdicts, (std::vector{AnchorVerdict::accepted, AnchorVerdict::not_tried, AnchorVerdict::not_tried,
                                   AnchorVerdict::not_tried}));
}

// A start that a person gave may be wrong, which no sigma shows: one look alone does not settle it.
TEST(LateAnchor, ADoubtfulTrackIsMatchedAtOnce) {
  LocalizerConfig sparing = config();
  sparing.anchor_every_m = 1000;
  const double certain_m = sparing.anchor_above_sigma_m * std::sqrt(-2 * std::log(sparing.integrity_risk));
  Localizer localizer(flight_camera(), LocalFrame(kOrigin), &landscape_tiles(), start(), sparing);
  int doubtful = 0, certain = 0;
  std::optional<Estimate> before;
  for (const Moment& moment : flight(12)) {
    const FrameReport report = localizer.process(moment.image, moment.telemetry);
    if (before) {
      const bool doubt = !before->hpl_m || *before->hpl_m > 2 * certain_m;
      const bool sure = before->hpl_m && *before->hpl_m < certain_m;
      const bool tried = report.anchor.verdict != AnchorVerdict::not_tried;
      EXPECT_FALSE(doubt && !tried) << moment.telemetry.frame;
      EXPECT_FALSE(sure && tried) << moment.telemetry.frame;
      doubtful += doubt && before->sigma_m < sparing.anchor_above_sigma_m ? 1 : 0;
      certain += sure ? 1 : 0;
    }
    before = report.estimate;
  }
  EXPECT_GT(doubtful, 0);
  EXPECT_GT(certain, 0);
}

TEST(LateAnchor, TheStateEstimateIsReported) {
  Localizer localizer = fresh();
  FrameReport report;
  for (const Moment& moment : short_flight()) report = localizer.process(moment.image, moment.telemetry);
  EXPECT_NEAR(report.state.velocity_mps.norm(), 17, 2);
  EXPECT_LT(report.state.velocity_sigma_mps, 3);
  EXPECT_NEAR(report.state.agl_m, short_flight().back().truth.agl_m, 4 * report.state.agl_sigma_m);
  EXPECT_NEAR(report.state.heading_rad, short_flight().back().truth.attitude.heading_rad, 0.05);
}

TEST(LateAnchor, AJobThatNeverRanHasNoEffect) {
  Localizer localizer = fresh();
  auto first = localizer.track(short_flight()[0].image, short_flight()[0].telemetry);
  const FrameReport report = localizer.finish(std::move(first.job));
  EXPECT_EQ(report.anchor.verdict, AnchorVerdict::not_tried);
  EXPECT_EQ(report.estimate.sigma_m, first.report.estimate.sigma_m);
  EXPECT_TRUE(localizer.track(short_flight()[1].image, short_flight()[1].telemetry).job) << "the next one may";
}

// A cancelled match is not "not found": no verdict, no failed attempt that would widen the search.
TEST(LateAnchor, ACancelledJobIsOneThatNeverRan) {
  LocalizerConfig anywhere = config();
  anywhere.area = PlaneBox{-200, -200, 200, 200};
  for (const auto& [begin, where] :
       {std::pair{std::optional<LonLat>(), anywhere}, {std::optional(start()), config()}}) {
    Localizer given_up(flight_camera(), LocalFrame(kOrigin), &landscape_tiles(), begin, where);
    Localizer never_ran(flight_camera(), LocalFrame(kOrigin), &landscape_tiles(), begin, where);
    const Moment &first = short_flight()[0], &second = short_flight()[1];
    auto cut = given_up.track(first.image, first.telemetry), idle = never_ran.track(first.image, first.telemetry);
    CancelAfter after(2);
    EXPECT_THROW(cut.job->run(after.cancel()), Interrupted);
    EXPECT_FALSE(cut.job->match);
    const FrameReport nothing = given_up.finish(std::move(cut.job));
    EXPECT_EQ(nothing.anchor.verdict, AnchorVerdict::not_tried);
    EXPECT_EQ(nothing.estimate.source, never_ran.finish(std::move(idle.job)).estimate.source);
    const FrameReport one = given_up.process(second.image, second.telemetry);
    const FrameReport other = never_ran.process(second.image, second.telemetry);
    EXPECT_EQ(one.anchor.verdict, other.anchor.verdict);
    EXPECT_GT(one.anchor.log_likelihood_ratio, 3);
    EXPECT_EQ(one.anchor.place_doubt, other.anchor.place_doubt);
    EXPECT_EQ(one.anchor.window_radius_m, other.anchor.window_radius_m);
    EXPECT_EQ(one.estimate.sigma_m, other.estimate.sigma_m);
    EXPECT_EQ(one.estimate.position.has_value(), other.estimate.position.has_value());
    if (one.estimate.position) {
      EXPECT_EQ(one.estimate.position->lon_deg, other.estimate.position->lon_deg);
    }
  }
}

}  // namespace
}  // namespace nadir
