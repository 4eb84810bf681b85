// A lost aircraft: it may be given suggestions of where to search, by an operator or by the place index, none of which
// is a position fix; without them it searches the area.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "base/error.hpp"
#include "estimation/localizer_fixture.hpp"
#include "geodesy/angles.hpp"

namespace nadir {
namespace {

using namespace test;

constexpr PlaneBox kArea{-200, -200, 200, 200};

LocalizerConfig anywhere() {
  LocalizerConfig c = config();
  c.area = kArea;
  return c;
}

// Names the given places, whatever it is asked.
class Parrot final : public PlaceRetrieval {
 public:
  explicit Parrot(std::vector<PlanePoint> places, double turn_rad = 0)
      : places_(std::move(places)), turn_rad_(turn_rad) {}
  std::vector<PlaceCandidate> query(const PlaceQuery& query, std::size_t count) const override {
    ++asked;
    any_heading = !query.heading_range_rad;
    EXPECT_EQ(query.grey.size(), query.mask.size());
    EXPECT_EQ(query.grey.type(), CV_8UC1);
    std::vector<PlaceCandidate> named;
    for (const PlanePoint& place : places_) {
      PlaceCandidate& candidate = named.emplace_back();
      candidate.centre = place_of(place);
      candidate.side_m = 110;
      candidate.turn_rad = turn_rad_;
    }
    named.resize(std::min(named.size(), count));
    return named;
  }
  mutable int asked = 0;
  mutable bool any_heading = false;

 private:
  std::vector<PlanePoint> places_;
  double turn_rad_;
};

Localizer lost_with(const LocalizerConfig& config) {
  return {flight_camera(), LocalFrame(kOrigin), &landscape_tiles(), std::nullopt, config};
}

FrameReport fly(Localizer& localizer, const Moment& moment) {
  return localizer.process(moment.image, moment.telemetry);
}

void expect_placed(const FrameReport& report, const Moment& moment) {
  EXPECT_EQ(report.anchor.verdict, AnchorVerdict::accepted)
      << name_of(report.anchor.verdict) << " " << report.anchor.ratio << " " << report.anchor.inliers;
  EXPECT_LT(off_m(report.estimate, moment), 3.0);
}

TEST(LostLocalizer, SearchesWhereThePlaceIndexPoints) {
  const Moment& first = short_flight()[0];
  const Parrot memory({{150, 150}, first.truth.position, {-150, 150}});
  LocalizerConfig c = anywhere();
  c.places = &memory;
  Localizer localizer = lost_with(c);
  expect_placed(fly(localizer, first), first);
  EXPECT_EQ(memory.asked, 1);
  expect_placed(fly(localizer, short_flight()[1]), short_flight()[1]);
  EXPECT_EQ(memory.asked, 1) << "it is not lost any more";
}

TEST(LostLocalizer, RecoversWhereThePlaceIndexIsWrongOrEmpty) {
  for (const std::vector<PlanePoint>& places : {std::vector<PlanePoint>{{150, 150}, {150, -150}}, {}, {{9e4, 0}}}) {
    const Parrot memory(places);
    LocalizerConfig c = anywhere();
    c.places = &memory;
    Localizer localizer = lost_with(c);
    expect_placed(fly(localizer, short_flight()[0]), short_flight()[0]);
    EXPECT_EQ(memory.asked, 1);
  }
}

// The heading is not measured. The camera's foot point lies off the picture's middle, on a side that turns with it.
TEST(LostLocalizer, UsesTheHeadingThatThePlaceIndexNames) {
  Moment first = short_flight()[0];
  first.telemetry.heading_rad = std::nullopt;
  const Parrot memory({first.truth.position}, first.truth.attitude.heading_rad + radians(4));  // assumed: north
  LocalizerConfig c = anywhere();
  c.places = &memory;
  Localizer localizer = lost_with(c);
  const FrameReport report = fly(localizer, first);
  EXPECT_TRUE(memory.any_heading);
  expect_placed(report, first);
}

// The ratio compares with all of the area: a memory that names one place only cannot make it look unique.
TEST(LostLocalizer, OverAnotherLandscapeNeitherPlaceIndexNorHintMakesAnAnchor) {
  const test::Landscape other(78, 160);
  const Parrot memory({short_flight()[0].truth.position});
  LocalizerConfig c = anywhere();
  c.places = &memory;
  Localizer localizer = lost_with(c);
  for (std::size_t i = 0; i < 3; ++i) {
    const Moment& moment = short_flight()[i];
    localizer.hint(place_of(moment.truth.position), 60);
    const cv::Mat image = photograph(other.ground(), flight_camera().camera, moment.truth);
    const FrameReport report = localizer.process(image, moment.telemetry);
    EXPECT_NE(report.anchor.verdict, AnchorVerdict::accepted) << report.anchor.ratio << " " << report.anchor.inliers;
    EXPECT_EQ(report.estimate.source, SourceLabel::no_fix);
  }
}

TEST(Hint, IsNoPosition) {
  Localizer localizer = lost_with(anywhere());
  localizer.hint(place_of({10, 20}), 50);
  const cv::Mat black(240, 320, CV_8UC1, cv::Scalar(0));
  const FrameReport report = localizer.process(black, short_flight()[0].telemetry);
  EXPECT_EQ(report.estimate.source, SourceLabel::no_fix);
  EXPECT_FALSE(report.estimate.position);
}

TEST(Hint, RightOrWrongTheFrameIsPlacedWhereItIs) {
  const Moment& first = short_flight()[0];
  const PlanePoint truth = first.truth.position;
  for (const PlanePoint said : {PlanePoint{truth.east_m + 40, truth.north_m - 30}, {140, 140}, {5000, 5000}}) {
    Localizer localizer = lost_with(anywhere());
    localizer.hint(place_of(said), 80);
    expect_placed(fly(localizer, first), first);
    expect_placed(fly(localizer, short_flight()[1]), short_flight()[1]);
  }
}

// The start claims 5 m and is 190 m off, so that no window around it holds the place. A hint makes it doubted.
TEST(Hint, InflatesAStartThatNoAnchorConfirmed) {
  LocalizerConfig sure = anywhere();
  sure.start_sigma_m = 5;
  const auto start = place_of({70, 90});
  const Moment& first = short_flight()[0];
  Localizer stubborn(flight_camera(), LocalFrame(kOrigin), &landscape_tiles(), start, sure);
  EXPECT_NE(fly(stubborn, first).anchor.verdict, AnchorVerdict::accepted);

  Localizer hinted(flight_camera(), LocalFrame(kOrigin), &landscape_tiles(), start, sure);
  hinted.hint(place_of({first.truth.position.east_m + 30, first.truth.position.north_m}), 60);
  expect_placed(fly(hinted, first), first);
}

TEST(Hint, DoesNotChangeWhatAnchorsConfirm) {
  Localizer one(flight_camera(), LocalFrame(kOrigin), &landscape_tiles(), start(), anywhere());
  Localizer other(flight_camera(), LocalFrame(kOrigin), &landscape_tiles(), start(), anywhere());
  fly(one, short_flight()[0]);
  ASSERT_EQ(fly(other, short_flight()[0]).anchor.verdict, AnchorVerdict::accepted);
  other.hint(place_of({190, -190}), 50);
  const Estimate plain = fly(one, short_flight()[1]).estimate, hinted = fly(other, short_flight()[1]).estimate;
  EXPECT_EQ(plain.position->lon_deg, hinted.position->lon_deg);
  EXPECT_EQ(plain.position->lat_deg, hinted.position->lat_deg);
  EXPECT_EQ(plain.sigma_m, hinted.sigma_m);
}

TEST(Hint, RejectsInvalidPositions) {
  Localizer localizer = lost_with(anywhere());
  const double nan = std::nan(""), infinity = std::numeric_limits<double>::infinity();
  using Said = std::array<double, 3>;
  for (const auto& [lon, lat, radius_m] :
       {Said{nan, 48, 50}, Said{11, nan, 50}, Said{11, 48, nan}, Said{11, 48, 0}, Said{11, 48, -5},
        Said{11, 48, infinity}, Said{181, 48, 50}, Said{11, 90.5, 50}}) {
    EXPECT_THROW(localizer.hint({lon, lat}, radius_m), UsageError) << lon << " " << lat << " " << radius_m;
  }
}

// ---- Without a position at the start, and after it was lost

// Nothing is known but the area: nothing is published before the first anchor, and then the truth.
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
TEST(Localizer, OnTheGroundItIsNotMatched) {
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

TEST(Localizer, ColdStartOverAnotherLandscapePublishesNothing) {
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
TEST(Localizer, AStartThatFramesContradictIsUncertain) {
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
TEST(Localizer, APositionFromBeforeARestartIsOverruled) {
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
