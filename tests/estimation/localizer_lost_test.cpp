// Without a position to begin with, and after one was lost.
#include <gtest/gtest.h>

#include <algorithm>

#include "estimation/localizer_fixture.hpp"

namespace nadir {
namespace {

using namespace test;

// Nothing is known but the area: nothing is told before the first anchor, and then the truth.
TEST(Localizer, ColdStartFindsItselfInTheArea) {
  LocalizerConfig anywhere = config();
  anywhere.area = PlaneBox{-200, -200, 200, 200};
  Localizer localizer(flight_camera(), LocalFrame(kOrigin), &landscape_tiles(), std::nullopt, anywhere);
  const cv::Mat black(240, 320, CV_8UC1, cv::Scalar(0));
  Telemetry before = short_flight()[0].telemetry;
  before.time_s -= 2;
  const Estimate nothing = localizer.process(black, before).estimate;
  EXPECT_EQ(nothing.source, SourceLabel::no_fix);
  EXPECT_FALSE(nothing.position);
  for (std::size_t i = 0; i < 2; ++i) {
    const FrameReport report = localizer.process(short_flight()[i].image, short_flight()[i].telemetry);
    expect_sound(report.estimate);
    EXPECT_EQ(report.anchor.verdict, AnchorVerdict::accepted)
        << name_of(report.anchor.verdict) << " " << report.anchor.ratio << " " << report.anchor.inliers;
    EXPECT_LT(off_m(report.estimate, short_flight()[i]), 3.0);
  }
}

// A few pixels of the map are everywhere.
TEST(Localizer, OnTheGroundItIsNotSearchedFor) {
  LocalizerConfig anywhere = config();
  anywhere.area = PlaneBox{-200, -200, 200, 200};
  Localizer localizer(flight_camera(), LocalFrame(kOrigin), &landscape_tiles(), std::nullopt, anywhere);
  Telemetry standing = short_flight()[0].telemetry;
  standing.time_s -= 1;
  standing.agl_m = 2;
  EXPECT_EQ(localizer.process(short_flight()[1].image, standing).anchor.verdict, AnchorVerdict::not_tried);
  localizer.hint(start(), 150);
  standing.time_s += 0.5;
  EXPECT_EQ(localizer.process(short_flight()[2].image, standing).anchor.verdict, AnchorVerdict::not_tried);
  EXPECT_NE(localizer.process(short_flight()[0].image, short_flight()[0].telemetry).anchor.verdict,
            AnchorVerdict::not_tried);
  EXPECT_EQ(localizer.process(short_flight()[1].image, short_flight()[1].telemetry).anchor.verdict,
            AnchorVerdict::accepted);
}

TEST(Localizer, ColdStartOverAnotherLandscapeTellsNothing) {
  const test::Landscape other(78, 160);
  LocalizerConfig anywhere = config();
  anywhere.area = PlaneBox{-200, -200, 200, 200};
  Localizer localizer(flight_camera(), LocalFrame(kOrigin), &landscape_tiles(), std::nullopt, anywhere);
  for (std::size_t i = 0; i < 2; ++i) {
    const cv::Mat image = test::photograph(other.ground(), flight_camera().camera, short_flight()[i].truth);
    const FrameReport report = localizer.process(image, short_flight()[i].telemetry);
    EXPECT_NE(report.anchor.verdict, AnchorVerdict::accepted) << report.anchor.ratio << " " << report.anchor.inliers;
    EXPECT_EQ(report.estimate.source, SourceLabel::no_fix);
  }
}

// The start is 45 m off and claims 5. Is it wrong, or the map? Nothing is anchored, but sigma owns up to both.
TEST(Localizer, AStartThatFramesContradictIsDoubted) {
  LocalizerConfig sure = config();
  sure.start_sigma_m = 5;
  const PlanePoint truth = short_flight()[0].truth.position;
  Localizer localizer(flight_camera(), LocalFrame(kOrigin), &landscape_tiles(),
                      place_of({truth.east_m + 30, truth.north_m + 33}), sure);
  for (std::size_t i = 0; i < 4; ++i) {
    const FrameReport report = localizer.process(short_flight()[i].image, short_flight()[i].telemetry);
    EXPECT_EQ(report.anchor.verdict, AnchorVerdict::off_prediction) << i << " " << name_of(report.anchor.verdict);
    if (i >= 2) {
      EXPECT_LT(off_m(report.estimate, short_flight()[i]), 2 * report.estimate.sigma_m) << i;
    }
  }
}

// The same after a restart in flight: the map has agreed with this flight before, so that several frames overrule what
// was saved.
TEST(Localizer, APlaceFromBeforeARestartIsOverruled) {
  LocalizerConfig resumed = config();
  resumed.start_sigma_m = 5;
  resumed.resumed = true;
  const std::vector<Moment> moments = flight(11);  // every second: voices must come from different ground
  const PlanePoint truth = moments[0].truth.position;
  Localizer localizer(flight_camera(), LocalFrame(kOrigin), &landscape_tiles(),
                      place_of({truth.east_m + 30, truth.north_m + 33}), resumed);
  std::vector<AnchorVerdict> verdicts;
  for (std::size_t i = 0; i < moments.size(); i += 2) {
    const Moment& moment = moments[i];
    const FrameReport report = localizer.process(moment.image, moment.telemetry);
    verdicts.push_back(report.anchor.verdict);
    if (verdicts.back() == AnchorVerdict::accepted) {
      EXPECT_LT(off_m(report.estimate, moment), 5.0);
    }
  }
  EXPECT_EQ(verdicts[0], AnchorVerdict::off_prediction) << "one frame alone overrules nothing";
  EXPECT_NE(std::find(verdicts.begin(), verdicts.end(), AnchorVerdict::accepted), verdicts.end());
}

// A start that is wrong by more than its sigma admits, and then a long time blind: the whole area is searched again.
TEST(Localizer, LostItSearchesTheArea) {
  LocalizerConfig vague = config();
  vague.start_sigma_m = 450;
  vague.max_search_radius_m = 300;
  vague.area = PlaneBox{-200, -200, 200, 200};
  Localizer localizer(flight_camera(), LocalFrame(kOrigin), &landscape_tiles(), place_of({150, 180}), vague);
  const FrameReport report = localizer.process(short_flight()[0].image, short_flight()[0].telemetry);
  EXPECT_EQ(report.anchor.verdict, AnchorVerdict::accepted) << name_of(report.anchor.verdict);
  EXPECT_LT(off_m(report.estimate, short_flight()[0]), 3.0);
}

}  // namespace
}  // namespace nadir
