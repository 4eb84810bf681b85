// Faulty frames and clocks: no wrong anchor, the right verdict, and a consistent sigma.
#include <gtest/gtest.h>
#include <cmath>
#include <limits>
#include <opencv2/imgproc.hpp>

#include "base/random.hpp"
#include "estimation/fault_maps.hpp"
#include "estimation/localizer_fixture.hpp"
#include "geodesy/angles.hpp"

namespace nadir {
namespace {

using namespace test;

// Nothing that was accepted is wrong, and no label promises more than is true.
void expect_honest(const FrameReport& report, const Moment& moment) {
  expect_sound(report.estimate);
  const bool accepted = report.anchor.verdict == AnchorVerdict::accepted;
  EXPECT_EQ(report.estimate.source == SourceLabel::satellite_anchored, accepted);
  EXPECT_LT(off_m(report.estimate, moment), 3 * report.estimate.sigma_m) << moment.telemetry.frame;
  if (!accepted) return;
  const PlanePoint truth = moment.truth.position;
  EXPECT_LT(distance_m(*report.anchor.camera, truth), 8);
}

cv::Mat clouded(const cv::Mat& frame, double share) {
  Random random(4);
  cv::Mat cover(frame.size(), CV_8UC1, cv::Scalar(0)), result = frame.clone();
  while (cv::countNonZero(cover) < share * static_cast<double>(cover.total())) {
    cv::circle(cover, {random.integer(0, cover.cols), random.integer(0, cover.rows)}, random.integer(15, 50),
               cv::Scalar(255), cv::FILLED);
  }
  result.setTo(cv::Scalar(236), cover);
  cv::GaussianBlur(result, result, cv::Size(), 3);
  return result;
}

TEST(FaultyFrames, CloudsHideTheGround) {
  const Moment& moment = short_flight()[0];
  Localizer localizer(flight_camera(), LocalFrame(kOrigin), &landscape_tiles(), start(), config());
  const FrameReport hidden = localizer.process(clouded(moment.image, 0.95), moment.telemetry);
  EXPECT_NE(hidden.anchor.verdict, AnchorVerdict::accepted);
  EXPECT_EQ(hidden.estimate.source, SourceLabel::dead_reckoned);
  EXPECT_GE(hidden.estimate.sigma_m, config().start_sigma_m * 0.99) << "nothing was learnt";
  const FrameReport clear = localizer.process(short_flight()[1].image, short_flight()[1].telemetry);
  EXPECT_EQ(clear.anchor.verdict, AnchorVerdict::awaiting_votes) << "of these two frames one shows another place";
  const std::vector<Moment> moments = flight(7);
  AnchorVerdict last = clear.anchor.verdict;
  for (std::size_t i = 2; i < moments.size(); ++i) {
    const FrameReport next = localizer.process(moments[i].image, moments[i].telemetry);
    expect_honest(next, moments[i]);
    last = next.anchor.verdict;
  }
  EXPECT_EQ(last, AnchorVerdict::accepted);
}

// One frame of another place in the middle of a flight, as a mixed-up recording has them.
TEST(FaultyFrames, AFrameFromElsewhereIsRejectedAndForgotten) {
  const auto& moments = short_flight();
  Localizer localizer(flight_camera(), LocalFrame(kOrigin), &landscape_tiles(), start(), config());
  expect_honest(localizer.process(moments[0].image, moments[0].telemetry), moments[0]);
  const cv::Mat elsewhere = flight(10).back().image;  // some 200 m on: beyond the window, and no frame to track from
  const FrameReport report = localizer.process(elsewhere, moments[1].telemetry);
  EXPECT_NE(report.anchor.verdict, AnchorVerdict::accepted);
  EXPECT_FALSE(report.odometry.tracked);
  EXPECT_EQ(report.estimate.source, SourceLabel::dead_reckoned);
  expect_honest(report, moments[1]);
  const FrameReport after = localizer.process(moments[2].image, moments[2].telemetry);
  EXPECT_EQ(after.estimate.segment, 0) << "the track goes on";
  EXPECT_TRUE(after.odometry.tracked);
  expect_honest(after, moments[2]);
  const FrameReport next = localizer.process(moments[3].image, moments[3].telemetry);
  EXPECT_EQ(next.anchor.verdict, AnchorVerdict::accepted);
  expect_honest(next, moments[3]);
}

// A picture that overlaps the last one, but from farther on than anything flies meanwhile.
TEST(FaultyFrames, NoStepIsLongerThanTheAircraftCanFly) {
  const std::vector<Moment> moments = flight(5);
  for (const bool soon : {false, true}) {
    Localizer localizer(flight_camera(), LocalFrame(kOrigin), nullptr, start(), config());
    localizer.process(moments[0].image, moments[0].telemetry);
    Telemetry telemetry = moments[3].telemetry;
    if (soon) telemetry.time_s = moments[0].telemetry.time_s + 0.2;
    const FrameReport report = localizer.process(moments[3].image, telemetry);
    EXPECT_EQ(report.odometry.tracked, !soon);
    EXPECT_GT(report.odometry.step_m, 30) << "it was measured, and is reported";
    EXPECT_EQ(report.estimate.source, soon ? SourceLabel::dead_reckoned : SourceLabel::vo_extrapolated);
    expect_sound(report.estimate);
  }
}

// The same before anything is anchored, with a start so vague that the other place would do.
TEST(FaultyFrames, AFrameFromElsewhereIsNoFirstAnchor) {
  const std::vector<Moment> moments = flight(10);
  LocalizerConfig vague = config();
  vague.start_sigma_m = 120;
  Localizer localizer(flight_camera(), LocalFrame(kOrigin), &landscape_tiles(), start(), vague);
  const FrameReport first = localizer.process(clouded(moments[0].image, 0.9), moments[0].telemetry);
  EXPECT_NE(first.anchor.verdict, AnchorVerdict::accepted);
  Telemetry telemetry = moments[9].telemetry;
  telemetry.time_s = moments[1].telemetry.time_s;
  const FrameReport report = localizer.process(moments[9].image, telemetry);
  EXPECT_EQ(report.anchor.verdict, AnchorVerdict::awaiting_votes);
  EXPECT_LT(report.anchor.chi2, parameters::belief::kChi2_999) << "no gate could tell";
  expect_honest(report, moments[1]);
  for (const std::size_t i : {2U, 3U})
    expect_honest(localizer.process(moments[i].image, moments[i].telemetry), moments[i]);
}

TEST(FaultyFrames, OneFrameOfFiveIsBlack) {
  const std::vector<Moment> moments = flight(5);
  Localizer localizer(flight_camera(), LocalFrame(kOrigin), &landscape_tiles(), start(), config());
  double last_sigma = 0;
  for (std::size_t i = 0; i < moments.size(); ++i) {
    const bool black = i == 2;
    const FrameReport report =
        localizer.process(black ? cv::Mat(240, 320, CV_8UC1, cv::Scalar(1)) : moments[i].image, moments[i].telemetry);
    EXPECT_EQ(report.anchor.verdict, black ? AnchorVerdict::frame_unfit : AnchorVerdict::accepted) << i;
    expect_honest(report, moments[i]);
    if (black) {
      EXPECT_EQ(report.estimate.source, SourceLabel::dead_reckoned);
      EXPECT_GT(report.estimate.sigma_m, last_sigma) << "blind flight";
      EXPECT_GT(report.estimate.anchor_age_s, 0.0);
    }
    last_sigma = report.estimate.sigma_m;
  }
}

class JumpingClock : public testing::TestWithParam<double> {};
INSTANTIATE_TEST_SUITE_P(FaultyFrames, JumpingClock, testing::Values(300.0, -60.0, 0.0));

TEST_P(JumpingClock, AnchorsCorrectlyOrNotAtAll) {
  const auto& moments = short_flight();
  Localizer localizer(flight_camera(), LocalFrame(kOrigin), &landscape_tiles(), start(), config());
  for (std::size_t i = 0; i < 2; ++i) {
    Telemetry telemetry = moments[i].telemetry;
    if (i >= 1) telemetry.time_s = moments[0].telemetry.time_s + GetParam() + static_cast<double>(i - 1);
    expect_honest(localizer.process(moments[i].image, telemetry), moments[i]);
  }
}

// Blind, a clock that leaps ahead makes the position less certain, never more.
TEST(FaultyFrames, BlindLeapsOfTheClockNeverReduceUncertainty) {
  Localizer localizer(flight_camera(), LocalFrame(kOrigin), &landscape_tiles(), start(), config());
  double last_sigma = localizer.process(short_flight()[0].image, short_flight()[0].telemetry).estimate.sigma_m;
  Telemetry telemetry = short_flight()[1].telemetry;
  for (const double leap_s : {1.0, 60.0, -60.0, 0.0}) {
    telemetry.time_s += leap_s;
    const FrameReport report = localizer.process(cv::Mat(), telemetry);
    EXPECT_EQ(report.anchor.verdict, AnchorVerdict::frame_unfit);
    EXPECT_NE(report.estimate.source, SourceLabel::satellite_anchored);
    if (leap_s > 0) {
      EXPECT_GT(report.estimate.sigma_m, last_sigma);
    } else {
      EXPECT_GE(report.estimate.sigma_m, last_sigma);
    }
    last_sigma = report.estimate.sigma_m;
  }
}

// The same bits again are a frozen camera, not an aircraft that stands still.
TEST(FaultyFrames, AFrozenImageAnchorsNothing) {
  const auto& moments = short_flight();
  Localizer localizer(flight_camera(), LocalFrame(kOrigin), &landscape_tiles(), start(), config());
  double last_sigma = localizer.process(moments[0].image, moments[0].telemetry).estimate.sigma_m;
  for (std::size_t i = 1; i < moments.size(); ++i) {
    const FrameReport report = localizer.process(moments[0].image, moments[i].telemetry);
    EXPECT_NE(report.anchor.verdict, AnchorVerdict::accepted);
    EXPECT_NE(report.estimate.source, SourceLabel::satellite_anchored);
    EXPECT_GT(report.estimate.sigma_m, last_sigma);
    expect_honest(report, moments[i]);
    last_sigma = report.estimate.sigma_m;
  }
}

// The images continue straight while the telemetry turns around: one of them is wrong, and the track is broken.
TEST(FaultyFrames, ATurnThatTheImagesDoNotShowIsUncertain) {
  const std::vector<Moment>& moments = short_flight();
  Localizer localizer(flight_camera(), LocalFrame(kOrigin), nullptr, start(), config());
  for (std::size_t i = 0; i < moments.size(); ++i) {
    Telemetry telemetry = moments[i].telemetry;
    if (i >= 2) telemetry.heading_rad = wrap_pi(*telemetry.heading_rad + kPi);
    const FrameReport report = localizer.process(moments[i].image, telemetry);
    EXPECT_EQ(report.odometry.tracked, i != 0 && i != 2) << i;
    EXPECT_EQ(report.estimate.segment, i < 2 ? 0 : 1) << i;
    EXPECT_EQ(report.state.heading_sigma_rad > radians(60), i >= 2) << i;
    EXPECT_LT(off_m(report.estimate, moments[i]), 2 * report.estimate.sigma_m) << i;
  }
}

// Over its map such a flight finds its heading and its place again.
TEST(FaultyFrames, OverAMapAHeadingJumpIsRecovered) {
  std::vector<Moment> moments = flight(10);
  Localizer localizer(flight_camera(), LocalFrame(kOrigin), &landscape_tiles(), start(), config());
  for (std::size_t i = 0; i < moments.size(); ++i) {
    Moment& moment = moments[i];
    if (i >= 2) moment.telemetry.heading_rad = wrap_pi(*moment.telemetry.heading_rad + radians(100));
    const FrameReport report = localizer.process(moment.image, moment.telemetry);
    expect_honest(report, moment);
    if (i + 1 == moments.size()) {
      EXPECT_EQ(report.anchor.verdict, AnchorVerdict::accepted);
      EXPECT_LT(report.state.heading_sigma_rad, radians(5));
    }
  }
}

// Tilt that is no longer measured is not level flight.
TEST(FaultyFrames, AttitudeThatIsLostInABankIsUncertain) {
  std::vector<Moment> moments = short_flight();
  Localizer localizer(flight_camera(), LocalFrame(kOrigin), &landscape_tiles(), start(), config());
  for (std::size_t i = 0; i < moments.size(); ++i) {
    Moment& moment = moments[i];
    if (i >= 2) {
      moment.truth.attitude.roll_rad = radians(20);
      moment.image = photograph(landscape_ground(), flight_camera().camera, moment.truth);
      moment.telemetry.pitch_rad = moment.telemetry.roll_rad = std::numeric_limits<double>::quiet_NaN();
    }
    expect_honest(localizer.process(moment.image, moment.telemetry), moment);
  }
}

// The map is not of the place, or not of the day: no anchor is accepted that is wrong, and what is said is true.

bool carried(const Estimate& estimate) {
  return estimate.source == SourceLabel::dead_reckoned || estimate.source == SourceLabel::vo_extrapolated ||
         estimate.source == SourceLabel::no_fix;
}

std::vector<Moment> first_moments() { return {short_flight().begin(), short_flight().begin() + 2}; }

// A flight without any anchor: no look makes the start surer than it was given, sigma grows but for what an alternative
// that a chance peak opened had of it, and the truth stays within it.
void expect_no_anchor(const TileSource& tiles, double start_sigma_m) {
  LocalizerConfig configured = config();
  configured.start_sigma_m = start_sigma_m;
  Localizer localizer(flight_camera(), LocalFrame(kOrigin), &tiles, start(), configured);
  double last_sigma = 0;
  for (const Moment& moment : first_moments()) {
    const FrameReport report = localizer.process(moment.image, moment.telemetry);
    EXPECT_NE(report.anchor.verdict, AnchorVerdict::accepted)
        << moment.telemetry.frame << " " << report.anchor.ratio << " " << report.anchor.inliers;
    EXPECT_TRUE(carried(report.estimate)) << name_of(report.estimate.source);
    EXPECT_FALSE(report.estimate.anchor_age_s);
    EXPECT_GE(report.estimate.sigma_m, start_sigma_m) << "nothing was learnt";
    EXPECT_GE(report.estimate.sigma_m, 0.99 * last_sigma);
    EXPECT_LT(off_m(report.estimate, moment), 3 * report.estimate.sigma_m);
    expect_sound(report.estimate);
    last_sigma = report.estimate.sigma_m;
  }
}

TEST(FaultyMap, MirroredIsNotAnchored) { expect_no_anchor(mirrored_tiles(), 20); }

TEST(FaultyMap, CompletelyRebuiltGroundIsNotAnchored) { expect_no_anchor(rebuilt_tiles(), 20); }

// What is left of an old map may serve; then the place must be right.
TEST(FaultyMap, AnOutdatedMapAnchorsCorrectlyOrNotAtAll) {
  Localizer localizer(flight_camera(), LocalFrame(kOrigin), &outdated_tiles(), start(), config());
  for (const Moment& moment : first_moments()) {
    const FrameReport report = localizer.process(moment.image, moment.telemetry);
    expect_sound(report.estimate);
    EXPECT_LT(off_m(report.estimate, moment), 3 * report.estimate.sigma_m);
    const bool accepted = report.anchor.verdict == AnchorVerdict::accepted;
    EXPECT_EQ(report.estimate.source == SourceLabel::satellite_anchored, accepted);
    if (!accepted) continue;
    const PlanePoint truth = moment.truth.position;
    EXPECT_LT(distance_m(*report.anchor.camera, truth), 5);
  }
}

// What lies at p appears at p + shift. Seen from the map: the aircraft and its start lie at p - shift.
class ShiftedMap : public testing::TestWithParam<double> {};
INSTANTIATE_TEST_SUITE_P(FaultyMap, ShiftedMap, testing::Values(50.0, 200.0, 1000.0));

TEST_P(ShiftedMap, IsNotAnchoredWithAKnownStart) {
  const double shift = GetParam() / std::sqrt(2.0);
  const auto truth = [&](const Moment& moment) {
    return PlanePoint{moment.truth.position.east_m - shift, moment.truth.position.north_m - shift};
  };
  LocalizerConfig sure = config();
  sure.start_sigma_m = 10;
  const PlanePoint begin = truth(short_flight()[0]);
  Localizer localizer(flight_camera(), LocalFrame(kOrigin), &landscape_tiles(),
                      place_of({begin.east_m + 8, begin.north_m - 6}), sure);
  for (const Moment& moment : first_moments()) {
    const FrameReport report = localizer.process(moment.image, moment.telemetry);
    EXPECT_NE(report.anchor.verdict, AnchorVerdict::accepted);
    EXPECT_TRUE(carried(report.estimate));
    Moment there = moment;
    there.truth.position = truth(moment);
    EXPECT_LT(off_m(report.estimate, there), 3 * report.estimate.sigma_m);
  }
}

// A start that the map hardly allows: one frame does not overrule it.
TEST(FaultyMap, AStartThatTheMapHardlyAllowsNeedsMoreThanOneFrame) {
  LocalizerConfig configured = config();
  configured.start_sigma_m = 12;
  const PlanePoint begin = short_flight()[0].truth.position;
  Localizer localizer(flight_camera(), LocalFrame(kOrigin), &landscape_tiles(),
                      place_of({begin.east_m + 36, begin.north_m - 9}), configured);
  for (const Moment& moment : first_moments()) {
    const FrameReport report = localizer.process(moment.image, moment.telemetry);
    if (moment.telemetry.frame == first_moments().front().telemetry.frame) {
      EXPECT_EQ(report.anchor.verdict, AnchorVerdict::awaiting_votes);
      EXPECT_GT(report.anchor.chi2, 8);
      EXPECT_LT(report.anchor.chi2, parameters::belief::kChi2_999);
    }
    expect_honest(report, moment);
  }
}

}  // namespace
}  // namespace nadir
