// The map is not of the place, or not of the day: no anchor is accepted that is wrong, and what is said is true.
#include <gtest/gtest.h>

#include <cmath>

#include "estimation/fault_maps.hpp"
#include "estimation/localizer_fixture.hpp"

namespace nadir {
namespace {

using namespace test;

bool carried(const Estimate& estimate) {
  return estimate.source == SourceLabel::dead_reckoned || estimate.source == SourceLabel::vo_extrapolated ||
         estimate.source == SourceLabel::no_fix;
}

std::vector<Moment> first_moments() { return {short_flight().begin(), short_flight().begin() + 2}; }

// A flight without any anchor: sigma only grows, the truth stays within it.
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
    EXPECT_GE(report.estimate.sigma_m, last_sigma) << "nothing was learnt";
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

// A start that the map hardly allows: what one frame said against it weighs as much with the next, although odometry
// has made the prediction vaguer meanwhile.
TEST(FaultyMap, AStartThatTheMapHardlyAllowsNeedsMoreThanOneFrame) {
  LocalizerConfig configured = config();
  configured.start_sigma_m = 12;
  const PlanePoint begin = short_flight()[0].truth.position;
  Localizer localizer(flight_camera(), LocalFrame(kOrigin), &landscape_tiles(),
                      place_of({begin.east_m + 36, begin.north_m - 9}), configured);
  double said = 0;
  for (const Moment& moment : first_moments()) {
    const FrameReport report = localizer.process(moment.image, moment.telemetry);
    EXPECT_EQ(report.anchor.verdict, AnchorVerdict::awaiting_votes);
    EXPECT_GT(report.anchor.chi2, configured.gates.chi2_99 - 1);
    EXPECT_LT(report.anchor.chi2, configured.gates.chi2_999);
    EXPECT_GE(report.anchor.chi2, said);
    said = report.anchor.chi2;
  }
}

}  // namespace
}  // namespace nadir
