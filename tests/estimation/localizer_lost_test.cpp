// Relocalization: without a position the localizer searches the whole area. An operator's hint or the place index
// (retrieval) say where to search first; neither is a position measurement.
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

constexpr PlaneBox kLostArea{-200, -200, 200, 200};

// No position at the start, only the area.
LocalizerConfig area_only() {
  LocalizerConfig c = config();
  c.area = kLostArea;
  return c;
}

// Retrieves the same candidates for every query.
class FixedRetrieval final : public PlaceRetrieval {
 public:
  explicit FixedRetrieval(std::vector<PlanePoint> places, double turn_rad = 0)
      : places_(std::move(places)), turn_rad_(turn_rad) {}
  std::vector<PlaceCandidate> query(const PlaceQuery& query, std::size_t count) const override {
    ++queries;
    any_heading = !query.heading_range_rad;
    EXPECT_EQ(query.grey.size(), query.mask.size());
    EXPECT_EQ(query.grey.type(), CV_8UC1);
    std::vector<PlaceCandidate> candidates;
    for (const PlanePoint& place : places_) {
      PlaceCandidate& candidate = candidates.emplace_back();
      candidate.centre = place_of(place);
      candidate.side_m = 110;
      candidate.turn_rad = turn_rad_;
    }
    candidates.resize(std::min(candidates.size(), count));
    return candidates;
  }
  mutable int queries = 0;
  mutable bool any_heading = false;

 private:
  std::vector<PlanePoint> places_;
  double turn_rad_;
};

Localizer without_start(const LocalizerConfig& config) {
  return {flight_camera(), LocalFrame(kOrigin), &landscape_tiles(), std::nullopt, config};
}

FrameReport fly(Localizer& localizer, const Moment& moment) {
  return localizer.process(moment.image, moment.telemetry);
}

void expect_localized(const FrameReport& report, const Moment& moment) {
  EXPECT_EQ(report.anchor.verdict, AnchorVerdict::accepted)
      << name_of(report.anchor.verdict) << " " << report.anchor.ratio << " " << report.anchor.inliers;
  EXPECT_LT(off_m(report.estimate, moment), 3.0);
}

// Without a position one look is not enough. Returns how many it took.
int localize(Localizer& localizer, const std::vector<Moment>& moments = short_flight()) {
  for (std::size_t i = 0; i < moments.size(); ++i) {
    const FrameReport report = fly(localizer, moments[i]);
    if (report.anchor.verdict != AnchorVerdict::accepted) continue;
    expect_localized(report, moments[i]);
    return static_cast<int>(i) + 1;
  }
  ADD_FAILURE() << "not localized by " << moments.size() << " frames";
  return 0;
}

TEST(LostLocalizer, SearchesTheRetrievedPlaces) {
  const Moment& first = short_flight()[0];
  const FixedRetrieval retrieval({{150, 150}, first.truth.position, {-150, 150}});
  LocalizerConfig c = area_only();
  c.places = &retrieval;
  Localizer localizer = without_start(c);
  const int looks = localize(localizer);
  EXPECT_EQ(retrieval.queries, looks);
  const Moment next = flight(6)[static_cast<std::size_t>(looks)];
  expect_localized(fly(localizer, next), next);
  EXPECT_EQ(retrieval.queries, looks) << "with a position the place index is not queried";
}

TEST(LostLocalizer, SearchesTheAreaWhenRetrievalIsWrongOrEmpty) {
  for (const std::vector<PlanePoint>& places : {std::vector<PlanePoint>{{150, 150}, {150, -150}}, {}, {{9e4, 0}}}) {
    const FixedRetrieval retrieval(places);
    LocalizerConfig c = area_only();
    c.places = &retrieval;
    Localizer localizer = without_start(c);
    EXPECT_EQ(localize(localizer), retrieval.queries);
  }
}

// No heading measurement. The camera's ground point is off the image centre, in a direction that turns with the
// heading.
TEST(LostLocalizer, UsesTheRetrievedHeading) {
  std::vector<Moment> moments = short_flight();
  for (Moment& moment : moments) moment.telemetry.heading_rad = std::nullopt;
  const Moment& first = moments.front();
  const FixedRetrieval retrieval({first.truth.position},
                                 first.truth.attitude.heading_rad + radians(4));  // from the assumed heading, north
  LocalizerConfig c = area_only();
  c.places = &retrieval;
  Localizer localizer = without_start(c);
  fly(localizer, first);
  EXPECT_TRUE(retrieval.any_heading);
  moments.erase(moments.begin());
  localize(localizer, moments);
}

// The ratio test compares with the whole area: a single retrieved place does not become distinctive by being alone.
TEST(LostLocalizer, OverAnotherLandscapeNeitherRetrievalNorHintGivesAnAnchor) {
  const test::Landscape other(78, 160);
  const FixedRetrieval retrieval({short_flight()[0].truth.position});
  LocalizerConfig c = area_only();
  c.places = &retrieval;
  Localizer localizer = without_start(c);
  for (std::size_t i = 0; i < 3; ++i) {
    const Moment& moment = short_flight()[i];
    localizer.hint(place_of(moment.truth.position), 60);
    const cv::Mat image = photograph(other.ground(), flight_camera().camera, moment.truth);
    const FrameReport report = localizer.process(image, moment.telemetry);
    EXPECT_NE(report.anchor.verdict, AnchorVerdict::accepted) << report.anchor.ratio << " " << report.anchor.inliers;
    EXPECT_EQ(report.estimate.source, SourceLabel::no_fix);
  }
}

TEST(Hint, IsNotAPositionMeasurement) {
  Localizer localizer = without_start(area_only());
  localizer.hint(place_of({10, 20}), 50);
  const cv::Mat black(240, 320, CV_8UC1, cv::Scalar(0));
  const FrameReport report = localizer.process(black, short_flight()[0].telemetry);
  EXPECT_EQ(report.estimate.source, SourceLabel::no_fix);
  EXPECT_FALSE(report.estimate.position);
}

TEST(Hint, RightOrWrongTheFrameIsLocalizedWhereItWasTaken) {
  const Moment& first = short_flight()[0];
  const PlanePoint truth = first.truth.position;
  for (const PlanePoint hinted : {PlanePoint{truth.east_m + 40, truth.north_m - 30}, {140, 140}, {5000, 5000}}) {
    Localizer localizer = without_start(area_only());
    localizer.hint(place_of(hinted), 80);
    localize(localizer);
  }
}

// A GPS that is trusted after take-off speaks while the first frame is being matched.
TEST(Hint, CountsForTheFrameThatIsBeingMatched) {
  const Moment& first = short_flight()[0];
  const auto level_after_the_first_frame = [&](bool hinted) {
    Localizer localizer = without_start(area_only());
    Localizer::TrackedFrame tracked = localizer.track(first.image, first.telemetry);
    if (hinted) localizer.hint(place_of({first.truth.position.east_m + 30, first.truth.position.north_m}), 150);
    tracked.job->run();
    return localizer.finish(std::move(tracked.job)).estimate.hpl_m;
  };
  EXPECT_FALSE(level_after_the_first_frame(false));
  EXPECT_TRUE(level_after_the_first_frame(true));
}

// The start states 5 m, 1 sigma, and is 190 m off, so that no search window around it contains the true place. A hint
// that contradicts it inflates its covariance.
TEST(Hint, InflatesAStartThatNoAnchorConfirmed) {
  LocalizerConfig confident = area_only();
  confident.start_sigma_m = 5;
  const auto start = place_of({70, 90});
  const Moment& first = short_flight()[0];
  Localizer unhinted(flight_camera(), LocalFrame(kOrigin), &landscape_tiles(), start, confident);
  for (const Moment& moment : short_flight()) EXPECT_NE(fly(unhinted, moment).anchor.verdict, AnchorVerdict::accepted);

  Localizer hinted(flight_camera(), LocalFrame(kOrigin), &landscape_tiles(), start, confident);
  hinted.hint(place_of({first.truth.position.east_m + 30, first.truth.position.north_m}), 60);
  localize(hinted);
}

TEST(Hint, DoesNotChangeWhatAnchorsConfirm) {
  Localizer one(flight_camera(), LocalFrame(kOrigin), &landscape_tiles(), start(), area_only());
  Localizer other(flight_camera(), LocalFrame(kOrigin), &landscape_tiles(), start(), area_only());
  fly(one, short_flight()[0]);
  ASSERT_EQ(fly(other, short_flight()[0]).anchor.verdict, AnchorVerdict::accepted);
  other.hint(place_of({190, -190}), 50);
  const Estimate plain = fly(one, short_flight()[1]).estimate, hinted = fly(other, short_flight()[1]).estimate;
  // Not the same bits: the hint changes the weights by which an anchor's association doubt is found. A hundredth of a
  // millimetre, and a part in 10⁶.
  constexpr double kSame_deg = 1e-10;
  EXPECT_NEAR(plain.position->lon_deg, hinted.position->lon_deg, kSame_deg);
  EXPECT_NEAR(plain.position->lat_deg, hinted.position->lat_deg, kSame_deg);
  EXPECT_NEAR(plain.sigma_m, hinted.sigma_m, 1e-6 * plain.sigma_m);
}

TEST(Hint, RejectsInvalidPositions) {
  Localizer localizer = without_start(area_only());
  const double nan = std::nan(""), infinity = std::numeric_limits<double>::infinity();
  using Hint = std::array<double, 3>;
  for (const auto& [lon, lat, radius_m] :
       {Hint{nan, 48, 50}, Hint{11, nan, 50}, Hint{11, 48, nan}, Hint{11, 48, 0}, Hint{11, 48, -5},
        Hint{11, 48, infinity}, Hint{181, 48, 50}, Hint{11, 90.5, 50}}) {
    EXPECT_THROW(localizer.hint({lon, lat}, radius_m), UsageError) << lon << " " << lat << " " << radius_m;
  }
}

// ---- cold start, wrong start, and relocalization after the position was lost

// Only the area is known: no position is published before the first anchor, and the right one from then on.
TEST(Localizer, ColdStartLocalizesInTheArea) {
  Localizer localizer(flight_camera(), LocalFrame(kOrigin), &landscape_tiles(), std::nullopt, area_only());
  const cv::Mat black(240, 320, CV_8UC1, cv::Scalar(0));
  Telemetry before = short_flight()[0].telemetry;
  before.time_s -= 2;
  const Estimate nothing = localizer.process(black, before).estimate;
  EXPECT_EQ(nothing.source, SourceLabel::no_fix);
  EXPECT_FALSE(nothing.position);
  const std::vector<Moment> moments = flight(6);
  bool localized = false;
  for (const Moment& moment : moments) {
    const FrameReport report = fly(localizer, moment);
    expect_sound(report.estimate);
    localized = localized || report.anchor.verdict == AnchorVerdict::accepted;
    if (localized) {
      expect_localized(report, moment);
    } else {
      EXPECT_EQ(report.anchor.verdict, AnchorVerdict::awaiting_votes);
      EXPECT_EQ(report.estimate.source, SourceLabel::no_fix);
      EXPECT_FALSE(report.estimate.hpl_m);
    }
  }
  EXPECT_TRUE(localized);
}

// On the ground a frame shows so few pixels of the map that they fit anywhere.
TEST(Localizer, FramesTakenOnTheGroundAreNotMatched) {
  Localizer localizer(flight_camera(), LocalFrame(kOrigin), &landscape_tiles(), std::nullopt, area_only());
  Telemetry standing = short_flight()[0].telemetry;
  standing.time_s -= 1;
  standing.agl_m = 2;
  EXPECT_EQ(localizer.process(short_flight()[1].image, standing).anchor.verdict, AnchorVerdict::not_tried);
  localizer.hint(start(), 150);
  standing.time_s += 0.5;
  EXPECT_EQ(localizer.process(short_flight()[2].image, standing).anchor.verdict, AnchorVerdict::not_tried);
  localize(localizer, flight(8));
}

TEST(Localizer, ColdStartOverAnotherLandscapePublishesNothing) {
  const test::Landscape other(78, 160);
  Localizer localizer(flight_camera(), LocalFrame(kOrigin), &landscape_tiles(), std::nullopt, area_only());
  for (std::size_t i = 0; i < 2; ++i) {
    const cv::Mat image = test::photograph(other.ground(), flight_camera().camera, short_flight()[i].truth);
    const FrameReport report = localizer.process(image, short_flight()[i].telemetry);
    EXPECT_NE(report.anchor.verdict, AnchorVerdict::accepted) << report.anchor.ratio << " " << report.anchor.inliers;
    EXPECT_EQ(report.estimate.source, SourceLabel::no_fix);
  }
}

// The start is 45 m off and states 5 m. Either it or the map is wrong: no frame is anchored, and sigma grows to cover
// both.
TEST(Localizer, ContradictedStartInflatesSigma) {
  LocalizerConfig confident = config();
  confident.start_sigma_m = 5;
  const PlanePoint truth = short_flight()[0].truth.position;
  Localizer localizer(flight_camera(), LocalFrame(kOrigin), &landscape_tiles(),
                      place_of({truth.east_m + 30, truth.north_m + 33}), confident);
  const std::vector<Moment> moments = flight(10);
  for (std::size_t i = 0; i < moments.size(); ++i) {
    const FrameReport report = fly(localizer, moments[i]);
    EXPECT_EQ(report.anchor.verdict, AnchorVerdict::off_prediction) << i << " " << name_of(report.anchor.verdict);
    EXPECT_FALSE(report.estimate.hpl_m && *report.estimate.hpl_m < off_m(report.estimate, moments[i])) << i;
    if (i >= 6) {
      EXPECT_LT(off_m(report.estimate, moments[i]), 2 * report.estimate.sigma_m) << i;
    }
  }
}

// The same after a restart in flight: the map has matched this flight before, so that several frames that agree
// overrule the saved position.
TEST(Localizer, FramesOverruleAWrongPositionFromBeforeARestart) {
  LocalizerConfig resumed = config();
  resumed.start_sigma_m = 5;
  resumed.resumed = true;
  const std::vector<Moment> moments = flight(11);  // every second one: votes must come from different ground
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
  EXPECT_EQ(verdicts[0], AnchorVerdict::off_prediction) << "a single frame does not overrule the saved position";
  EXPECT_NE(std::find(verdicts.begin(), verdicts.end(), AnchorVerdict::accepted), verdicts.end());
}

// With a sigma so large that its search window would exceed the maximum, the whole area is searched.
TEST(Localizer, SearchesTheAreaWhenTheWindowIsTooLarge) {
  LocalizerConfig vague = config();
  vague.start_sigma_m = 450;
  vague.max_search_radius_m = 300;
  vague.area = PlaneBox{-200, -200, 200, 200};
  Localizer localizer(flight_camera(), LocalFrame(kOrigin), &landscape_tiles(), place_of({150, 180}), vague);
  localize(localizer);
}

}  // namespace
}  // namespace nadir
